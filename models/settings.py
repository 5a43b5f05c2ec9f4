"""Settings that check themselves: frozen dataclasses whose annotations state their ranges.

A range stands in the annotation of its field, such as `Annotated[int, Ge(1)]`, and is checked here
and nowhere else: whether settings come from the command line, from a file or from Python.
"""

import json
from dataclasses import fields
from functools import cache
from typing import Annotated, Any, ClassVar, Self, get_type_hints

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    TypeAdapter,
    ValidationError,
    create_model,
)

from models.errors import InputError, shown

_KEYS = {
    "missing": "missing key {key!r}; add it",
    "missing_argument": "missing key {key!r}; add it",
    "unexpected_keyword_argument": "unknown key {key!r}; remove it",
}


def _in_order(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise ValueError("the least, then the greatest")
    return ends


Interval = Annotated[tuple[float, float], AfterValidator(_in_order)]
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
        """Checks every field.

        Raises:
            InputError: if a value does not fit its annotation; the message names the field.
        """
        model = _model(type(self))
        values = {name: getattr(self, name) for name in model.model_fields}
        try:
            model.model_validate(values)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            name = str(first["loc"][0])
            raise InputError(f"{self.title}: {name} {_told(values[name], first)}") from error

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
            # As JSON, so that lists are tuples and nothing else is taken for what it is not.
            return TypeAdapter(cls).validate_json(json.dumps(values), strict=True)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(str(part) for part in first["loc"])
            if first["type"] in _KEYS:
                raise InputError(f"{where}: {_KEYS[first['type']].format(key=key)}") from error
            told = _told(first["input"], first)
            raise InputError(f"{where}: {f'key {key!r} ' if key else ''}{told}") from error
        except (InputError, TypeError, ValueError, RecursionError) as error:
            raise InputError(f"{where}: {error}") from error


@cache
def _model(kind: type[Settings]) -> type[BaseModel]:
    # Settings inside of settings have checked themselves: pydantic takes instances as they are.
    hints = get_type_hints(kind, include_extras=True)
    config = ConfigDict(strict=True, allow_inf_nan=False, arbitrary_types_allowed=True)
    own = {field.name: (hints[field.name], ...) for field in fields(kind)}  # type: ignore[arg-type]
    return create_model(kind.__name__, __config__=config, **own)  # type: ignore[call-overload]


def _told(value: Any, error: Any) -> str:
    """Tells what is wrong with a value."""
    if error["type"] == "too_short":
        return "is empty; name one or more"
    wanted = error["msg"].removeprefix("Input should be ").removeprefix("Value error, ")
    return f"is {shown(value)}; it must be {wanted}"
