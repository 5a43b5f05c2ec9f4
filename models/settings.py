"""Settings: frozen dataclasses that pydantic checks.

The annotation of a field holds its range, such as `Annotated[int, Ge(1)]`. It is checked whether
settings come from the command line, from a file or from Python. An error of pydantic becomes an
`InputError` of one sentence: the source, the key, the value and what it must be.
"""

import json
import re
from collections.abc import Callable
from dataclasses import field, fields, is_dataclass
from difflib import get_close_matches
from functools import cache, wraps
from typing import Annotated, Any, ClassVar, Self, TypeVar, dataclass_transform, get_type_hints

from annotated_types import Ge, Gt, Le, Lt, MaxLen
from pydantic import AfterValidator, ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass

from glassgait.models.errors import InputError, brief, shown

T = TypeVar("T", bound=tuple[Any, ...])


def _distinct(values: T) -> T:
    if len(set(values)) < len(values):
        raise ValueError("a list without duplicates")
    return values


def _in_order(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError("the least, then the greatest")
    return ends


Count = Annotated[int, Ge(1), Lt(2**31)]  # a number of something; libraries count in 32 bits
Natural = Annotated[int, Ge(0), Lt(2**31)]  # a number of something that may be zero

Seed = Annotated[int, Ge(0), Lt(2**31)]
"""A seed. Libraries take 32 bits; joints and rollouts use the numbers that follow it."""

Positive = Annotated[float, Gt(0.0)]
NotNegative = Annotated[float, Ge(0.0)]
Share = Annotated[float, Gt(0.0), Le(1.0)]

DISTINCT = AfterValidator(_distinct)  # annotates a list without duplicates
IN_ORDER = AfterValidator(_in_order)  # annotates a pair whose first number is at most the second
FEW = MaxLen(100)  # limits the length of a list, since runs record it

Range = Annotated[tuple[float, float], IN_ORDER]
"""Least and greatest value of a range; they may be equal."""

# Numbers that YAML 1.1 reads as text: their exponent has no sign, or there is no decimal point.
_EXPONENT = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")

_CONFIG = ConfigDict(
    strict=True,
    extra="forbid",
    allow_inf_nan=False,
    arbitrary_types_allowed=True,
    validate_default=True,
    validate_by_name=True,
    validate_by_alias=True,
)


class Settings:
    """Base of settings. Decorate subclasses with `checked`."""

    title: ClassVar[str] = "settings"  # in errors

    @classmethod
    def from_plain(cls, values: Any, where: str = "") -> Self:
        """Builds settings from plain values, as in YAML and JSON, by the fields' names.

        Refuses unknown keys, and values of another type or out of range. Errors begin with `where`,
        the name of the source.
        """
        prefix = f"{where}: " if where else ""
        try:
            # Validated as JSON: lists become tuples and strings paths, but no string a number.
            return _adapter_of(cls).validate_json(json.dumps(values, default=str))
        except ValidationError as error:
            raise InputError(f"{prefix}{_sentence(error, cls)}") from error
        except InputError as error:
            raise InputError(f"{prefix}{error}") from error
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(
                f"{prefix}holds a value that cannot be read ({brief(str(error))})"
            ) from error


S = TypeVar("S", bound=type[Settings])


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def checked(kind: S) -> S:
    """Turns a class of settings into a frozen dataclass that checks every field on creation."""
    made: Any = dataclass(frozen=True, config=_CONFIG)(kind)
    initialize: Callable[..., None] = made.__init__

    @wraps(initialize)
    def initialize_or_refuse(self: Any, *args: Any, **values: Any) -> None:
        try:
            initialize(self, *args, **values)
        except ValidationError as error:
            raise InputError(f"{kind.title}: {_sentence(error, kind)}") from error

    made.__init__ = initialize_or_refuse
    return made


_adapter_of = cache(TypeAdapter)  # making one takes longer than a validation


def _sentence(error: ValidationError, kind: type[Settings]) -> str:
    """Describes the first value that pydantic refuses, and what it must be."""
    # A misspelt key also leaves a key missing, and a list with a bad number also is no number;
    # report the misspelling and the bad number first.
    errors = sorted(
        error.errors(include_url=False),
        key=lambda item: (
            item["type"] == "missing",
            item["type"] == "float_type" and isinstance(item["input"], list | dict),
        ),
    )
    # The path of a union's error also names the alternative.
    first, path = errors[0], [part for part in errors[0]["loc"] if "float" not in str(part)]
    if path and isinstance(path[0], int):
        # A positional argument.
        path[0] = fields(kind)[path[0]].name  # type: ignore[arg-type]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)[1:]
    if first["type"] == "unexpected_keyword_argument":
        near = get_close_matches(str(path[-1]), _names_at(kind, path[:-1]), n=1)
        remedy = f"write {near[0]!r}, or remove it" if near else "remove it"
        return f"unknown key {shown(key)}; {remedy}"
    if first["type"] == "missing":
        return f"lacks the key {key!r}; add it"
    wanted = first["msg"].replace(" after validation", "")
    wanted = re.sub(r"^\w+ should", "it must", wanted).replace("Value error,", "it must be")
    if isinstance(first["input"], bool) and first["type"] in ("string_type", "literal_error"):
        wanted = "YAML reads yes, no, on and off as true and false; quote the word"
    if first["type"] == "float_type" and _EXPONENT.fullmatch(str(first["input"])):
        wanted = "YAML reads it as text; write it like 1.0e-5"
    return f"{key} is {shown(first['input'])}; {wanted}".lstrip()


def _names_at(kind: Any, path: list[Any]) -> list[str]:
    """Lists the keys of the nested settings at a path."""
    for name in path:
        kind = get_type_hints(kind).get(name) if is_dataclass(kind) else None
    return [item.name for item in fields(kind)] if is_dataclass(kind) else []
