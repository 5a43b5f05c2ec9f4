"""Settings: what they accept, and how they refuse the rest."""

from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest
from annotated_types import MinLen

from glassgait.models.errors import InputError
from glassgait.models.settings import (
    DISTINCT,
    Count,
    NotNegative,
    Positive,
    Range,
    Seed,
    Settings,
    Share,
)


@dataclass(frozen=True)
class Inner(Settings):
    title: ClassVar[str] = "inner"

    share: Share = 1.0
    kind: Literal["a", "b"] = "a"


@dataclass(frozen=True)
class Outer(Settings):
    title: ClassVar[str] = "outer"

    count: Count = 1
    seed: Seed = 0
    counts: Annotated[tuple[Count, ...], MinLen(1), DISTINCT] = (1,)
    bounds: Range | None = None
    scale: Positive = 1.0
    weight: NotNegative = 0.0
    on: bool = False
    text: str = ""
    path: Path | None = None
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.count == 13:
            raise InputError("outer: count is 13; name another")


REFUSED = [
    ({"count": 0}, "count is 0; it must be 1 or more"),
    ({"count": True}, "count is True; it must be a whole number"),
    ({"count": 1.0}, "count is 1.0; it must be a whole number"),
    ({"count": "1"}, "count is '1'; it must be a whole number"),
    ({"count": None}, "count is None; it must be a whole number"),
    ({"count": 2**31}, "count is 2147483648; it must be less than 2147483648"),
    ({"seed": -1}, "seed is -1; it must be 0 or more"),
    ({"scale": 0.0}, "scale is 0.0; it must be more than 0"),
    ({"scale": "x"}, "scale is 'x'; it must be a number"),
    ({"weight": -0.5}, "weight is -0.5; it must be 0 or more"),
    ({"weight": float("nan")}, "weight is nan; it must be a finite number"),
    ({"weight": float("inf")}, "weight is inf; it must be a finite number"),
    ({"on": 1}, "on is 1; it must be true or false"),
    ({"text": 1}, "text is 1; it must be text"),
]
BY_HAND = [
    *REFUSED,
    ({"counts": ()}, "counts is empty; name one or more"),
    ({"counts": (2, 0)}, "counts is (2, 0); it must be 1 or more"),
    ({"counts": (2, 2)}, "counts is (2, 2); it must be a list that names nothing twice"),
    ({"bounds": (1.0,)}, "bounds is (1.0,); it must be longer"),
    ({"bounds": (1.0, 2.0, 3.0)}, "it must be of 2 values at most"),
    ({"bounds": (2.0, 1.0)}, "bounds is (2.0, 1.0); it must be the least, then the greatest"),
    ({"path": "a"}, "path is 'a'; it must be a path"),
    ({"inner": 3}, "inner is 3; it must be a mapping of settings"),
]
FROM_FILE = [
    *((values, message.replace(" is ", "' is ", 1)) for values, message in REFUSED),
    ({"counts": 3}, "key 'counts' is 3; it must be a list"),
    ({"counts": [2, 2]}, "it must be a list that names nothing twice"),
    ({"bounds": [1.0]}, "key 'bounds' is [1.0]; it must be longer"),
    ({"inner": {"share": 2}}, "key 'inner.share' is 2; it must be 1 or less"),
    ({"inner": {"kind": "c"}}, "key 'inner.kind' is 'c'; it must be 'a' or 'b'"),
    ({"inner": {"other": 1}}, "unknown key 'inner.other'; remove it"),
    ({"inner": [1]}, "key 'inner' is [1]; it must be a mapping of settings"),
    ({"count": date(2020, 1, 2)}, "it must be a whole number"),
    ({1: 2}, "unknown key '1'; remove it"),
    ({(1, 2): 2}, "is not a mapping of settings; mend it"),
    ({"count": 13}, "outer: count is 13; name another"),
    (None, "is None; it must be a mapping of settings"),
    ([1], "is [1]; it must be a mapping of settings"),
]


@pytest.mark.parametrize(("values", "message"), BY_HAND)
def test_refuses_what_does_not_fit_its_annotation(values, message):
    with pytest.raises(InputError) as refused:
        Outer(**values)
    assert str(refused.value).startswith("outer: ")
    assert str(refused.value).endswith(message)


@pytest.mark.parametrize(("values", "message"), FROM_FILE)
def test_refuses_a_file_by_its_name_and_key(values, message):
    with pytest.raises(InputError) as refused:
        Outer.from_plain(values, "run.yaml")
    assert str(refused.value).startswith("run.yaml: ")
    assert str(refused.value).endswith(message)
    assert "\n" not in str(refused.value)


def test_reads_lists_numbers_and_settings_inside_of_settings():
    values = {"counts": [1, 2], "bounds": [0, 1], "inner": {"kind": "b"}, "path": "runs"}
    assert Outer.from_plain(values, "") == Outer(
        counts=(1, 2), bounds=(0.0, 1.0), inner=Inner(kind="b"), path=Path("runs")
    )


def test_makes_a_float_of_a_whole_number():
    # scikit-learn takes a share of 1 for one observation, and of 1.0 for all.
    assert type(Outer(scale=1).scale) is float
    assert type(Outer.from_plain({"scale": 1}, "").scale) is float
