"""Settings that check themselves: frozen dataclasses whose annotations state their ranges.

A range stands in the annotation of its field, such as `Annotated[int, Ge(1)]`, and is checked here
and nowhere else: whether settings come from the command line, from a file or from Python.
"""

import json
import re
from dataclasses import fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from typing import Annotated, Any, ClassVar, Self, TypeVar, get_type_hints

from annotated_types import Ge, Gt, Le, Lt, MaxLen
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    TypeAdapter,
    ValidationError,
    create_model,
)

from glassgait.models.errors import InputError, shown

T = TypeVar("T", bound=tuple[Any, ...])


def _distinct(values: T) -> T:
    if len(set(values)) < len(values):
        raise ValueError("a list that names nothing twice")
    return values


def _in_order(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError("the least, then the greatest")
    return ends


Count = Annotated[int, Ge(1), Lt(2**31)]
"""How many of something; libraries count in 32 bits."""

Natural = Annotated[int, Ge(0), Lt(2**31)]
"""The same, where there may be none."""

Seed = Annotated[int, Ge(0), Lt(2**31)]
"""A seed: libraries take 32 bits, and the seeds of joints and rollouts are counted on from it."""

Positive = Annotated[float, Gt(0.0)]
NotNegative = Annotated[float, Ge(0.0)]
Share = Annotated[float, Gt(0.0), Le(1.0)]

DISTINCT = AfterValidator(_distinct)
"""Annotates a list that names nothing twice."""

IN_ORDER = AfterValidator(_in_order)
"""Annotates a pair of which the first is at most the second."""

FEW = MaxLen(100)
"""Bounds a list, which a run records and reads back."""

Range = Annotated[tuple[float, float], IN_ORDER]
"""The least and the greatest of a range; they may be the same."""


class Settings:
    """Base of dataclasses that refuse a value of the wrong kind or out of range.

    A subclass that checks how its fields fit together calls `super().__post_init__()` first.

    Attributes:
        title: What a refusal calls the settings.
    """

    title: ClassVar[str] = "settings"
    __pydantic_config__: ClassVar[ConfigDict] = ConfigDict(extra="forbid", allow_inf_nan=False)

    def __post_init__(self) -> None:
        """Checks every field, and makes a float of a whole number that stands for one.

        Raises:
            InputError: if a value does not fit its annotation; the message names the field.
        """
        model = _model(type(self))
        values = {name: getattr(self, name) for name in model.model_fields}
        try:
            checked = model.model_validate(values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name = str(first["loc"][0])
            problem = _problem(values[name], first)
            raise InputError(f"{self.refused_as()}: {name} {problem}") from error
        for name in values:
            object.__setattr__(self, name, getattr(checked, name))

    def refused_as(self) -> str:
        """Returns what a refusal calls the settings."""
        return self.title

    @classmethod
    def from_plain(cls, values: Any, where: str) -> Self:
        """Builds settings from the plain values that YAML and JSON hold.

        Args:
            values: Fields by name; those left out keep their defaults.
            where: What an error calls the source.

        Raises:
            InputError: if a key is unknown, or a value is of another kind or out of range.
        """
        try:
            # As JSON, so that lists are tuples and nothing else is taken for what it is not: a
            # date, which YAML knows and JSON does not, is text.
            text = json.dumps(values, default=str)
            return _adapter(cls).validate_json(text, strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            raise InputError(f"{where}: {_problem_of_key(first, cls)}") from error
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
        except (TypeError, ValueError, RecursionError) as error:
            raise InputError(f"{where}: is not a mapping of settings; mend it") from error


@cache
def _adapter(kind: type[Settings]) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


@cache
def _model(kind: type[Settings]) -> type[BaseModel]:
    # Settings inside of settings have checked themselves: pydantic takes instances as they are.
    hints = get_type_hints(kind, include_extras=True)
    config = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    own = {field.name: (hints[field.name], ...) for field in fields(kind)}  # type: ignore[arg-type]
    return create_model(kind.__name__, __config__=config, **own)  # type: ignore[call-overload]


_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?[eE][-+]?\d+")
"""Numbers that YAML 1.1 takes for text: those with an exponent, but without a point or its sign."""

_WANTED = {
    "greater_than": "more than {gt}",
    "greater_than_equal": "{ge} or more",
    "less_than": "less than {lt}",
    "less_than_equal": "{le} or less",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "string_type": "text",
    "literal_error": "{expected}",
    "tuple_type": "a list",
    "missing": "longer",
    "too_long": "of {max_length} values at most",
    "path_type": "a path",
    "is_instance_of": "a path",
    "dataclass_type": "a mapping of settings",
    "dataclass_exact_type": "a mapping of settings",
    "value_error": "{error}",
}
"""What a value must be, by pydantic's name of the error."""


def _problem(value: Any, error: Any) -> str:
    """Returns what is wrong with a value."""
    if error["type"] == "too_short":
        return "is empty; name one or more"
    if error["type"] == "float_type" and isinstance(value, str) and _NUMBER.fullmatch(value):
        return f"is {shown(value)}, which YAML takes for text; write it as 1.0e-5 is written"
    bounds = {
        name: int(bound) if isinstance(bound, float) and bound.is_integer() else bound
        for name, bound in error.get("ctx", {}).items()
    }
    wanted = _WANTED.get(error["type"], "another value").format(**bounds)
    return f"is {shown(value)}; it must be {wanted}"


def _problem_of_key(error: Any, kind: type[Settings]) -> str:
    """Returns what is wrong with a key, or with the value that it has."""
    path = [part for part in error["loc"] if isinstance(part, str)]
    key = ".".join(path)
    match error["type"]:
        case "unexpected_keyword_argument":
            near = _nearest(path[-1], _settings_at(kind, path[:-1]))
            remedy = f"write {near!r}, or remove it" if near else "remove it"
            return f"unknown key {shown(key)}; {remedy}"
        case _ if not key:
            return _problem(error["input"], error)
        case _:
            return f"key {shown(key)} {_problem(error['input'], error)}"


def _settings_at(kind: Any, path: list[str]) -> Any:
    """Finds the class of the settings that stand at a path inside of others."""
    for part in path:
        kind = get_type_hints(kind).get(part)
    return kind


def _nearest(key: str, kind: Any) -> str | None:
    """Finds the key that was meant, among those of settings or of the settings inside of them."""
    if not is_dataclass(kind):
        return None
    hints = get_type_hints(kind)
    names = [field.name for field in fields(kind)]
    inner = {
        own.name: f"{name}: {{{own.name}: …}}"
        for name in names
        if is_dataclass(hints[name])
        for own in fields(hints[name])
    }
    if near := get_close_matches(key, names, n=1):
        return near[0]
    near = get_close_matches(key, inner, n=1)
    return inner[near[0]] if near else None
