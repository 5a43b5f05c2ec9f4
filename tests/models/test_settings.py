"""Settings: accepted and refused values."""

from dataclasses import field, replace
from datetime import date
from pathlib import Path
from typing import Annotated, ClassVar, Literal

import pytest
from annotated_types import MinLen

from glassgait.models.errors import InputError
from glassgait.models.settings import DISTINCT, Count, Positive, Range, Settings, Share, checked


@checked
class Inner(Settings):
    title: ClassVar[str] = "inner"

    share: Share = 1.0
    kind: Literal["a", "b"] = "a"


@checked
class Outer(Settings):
    title: ClassVar[str] = "outer"

    count: Count = 1
    counts: Annotated[tuple[Count, ...], MinLen(1), DISTINCT] = (1,)
    bounds: Range | None = None
    scale: Positive = 1.0
    on: bool = False
    path: Path | None = None
    inner: Inner = field(default_factory=Inner)

    def __post_init__(self) -> None:
        if self.count == 13:
            raise InputError("outer: count is 13; name another")


REFUSED = [
    ({"count": 0}, "count is 0; it must be greater than or equal to 1"),
    ({"count": True}, "count is True; it must be a valid integer"),
    ({"count": "1"}, "count is '1'; it must be a valid integer"),
    ({"count": 2**31}, "count is 2147483648; it must be less than 2147483648"),
    ({"scale": 0.0}, "scale is 0.0; it must be greater than 0"),
    ({"scale": "1e-5"}, "YAML reads it as text; write it like 1.0e-5"),
    ({"scale": float("nan")}, "scale is nan; it must be a finite number"),
    ({"on": 1}, "on is 1; it must be a valid boolean"),
    ({"cuont": 1}, "unknown key 'cuont'; write 'count', or remove it"),
]
BY_HAND = [
    *REFUSED,
    ({"counts": (2, 0)}, "counts[1] is 0; it must be greater than or equal to 1"),
    ({"counts": (2, 2)}, "counts is (2, 2); it must be a list without duplicates"),
    ({"bounds": (2.0, 1.0)}, "bounds is (2.0, 1.0); it must be the least, then the greatest"),
    ({"inner": 3}, "inner is 3; it must be an instance of Inner"),
]
FROM_FILE = [
    *REFUSED,
    ({"inner": {"share": 2}}, "inner.share is 2; it must be less than or equal to 1"),
    ({"inner": {"kind": "c"}}, "inner.kind is 'c'; it must be 'a' or 'b'"),
    ({"inner": {"kind": False}}, "inner.kind is False; YAML reads yes, no, on and off as true"),
    ({"count": date(2020, 1, 2)}, "it must be a valid integer"),
    ({"count": 10**5000}, "holds a value that cannot be read"),
    ({"count": 13}, "outer: count is 13; name another"),
    ([1], "is [1]; it must be an object"),
]


@pytest.mark.parametrize(("values", "message"), BY_HAND)
def test_refuses_what_does_not_fit_its_annotation(values, message):
    with pytest.raises(InputError) as refused:
        Outer(**values)
    assert str(refused.value).startswith("outer: ")
    assert message in str(refused.value)


@pytest.mark.parametrize(("values", "message"), FROM_FILE)
def test_refuses_a_file_by_its_name_and_key(values, message):
    with pytest.raises(InputError) as refused:
        Outer.from_plain(values, "run.yaml")
    assert str(refused.value).startswith("run.yaml: ")
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_reads_lists_numbers_and_settings_inside_of_settings():
    values = {"counts": [1, 2], "bounds": [0, 1], "inner": {"kind": "b"}, "path": "runs"}
    assert Outer.from_plain(values, "") == Outer(
        counts=(1, 2), bounds=(0.0, 1.0), inner=Inner(kind="b"), path=Path("runs")
    )


def test_checks_values_that_are_replaced_or_given_by_position():
    with pytest.raises(InputError, match="count is 0"):
        replace(Outer(), count=0)
    with pytest.raises(InputError, match="outer: count is 0"):
        Outer(0)


def test_makes_a_float_of_a_whole_number():
    # scikit-learn reads a share of 1 as one observation, and of 1.0 as all.
    assert type(Outer(scale=1).scale) is float
    assert type(Outer.from_plain({"scale": 1}, "").scale) is float
