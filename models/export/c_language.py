"""The notation of C: numbers, names, comments, constant arrays and templates."""

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import jinja2
import numpy as np
from numpy.typing import NDArray

from glassgait.models.formulas.grammar import written_number

Real = Literal["double", "float"]  # the type that a controller computes in

LINE_LENGTH = 100

SMALLEST = 1e-37  # numbers closer to 0 than this are written as 0 in single precision

KEYWORDS = frozenset(
    re.findall(
        r"\w+",
        "auto break case char const continue default do double else enum extern float for goto if "
        "inline int long register restrict return short signed sizeof static struct switch typedef "
        "union unsigned void volatile while",
    )
)

_IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

_TEMPLATES = Path(__file__).parent / "templates"


def is_identifier(name: str) -> bool:
    return bool(_IDENTIFIER.fullmatch(name)) and name not in KEYWORDS


def number(value: float, real: Real) -> str:
    """Writes a number that C reads as the same value, or as the nearest in single precision."""
    if real == "float" and 0.0 < abs(value) < SMALLEST:
        value = 0.0
    text = written_number(value)
    whole = text if set(text) & set(".e") else f"{text}.0"
    return f"{whole}f" if real == "float" else whole


def function(name: str, real: Real) -> str:
    return f"{name}f" if real == "float" else name


def commented(text: str) -> str:
    """Converts a text to one line that is valid in a comment and cannot end it."""
    line = " ".join(text.split())
    plain = "".join(sign if " " <= sign <= "~" else "?" for sign in line)
    return plain.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")


def comment(text: str) -> str:
    return "/* " + "\n * ".join(textwrap.wrap(text, LINE_LENGTH - 6)) + " */"


@dataclass(frozen=True)
class CArray:
    """A constant array of any shape, and the comment beside it."""

    name: str
    values: NDArray[Any]
    type: str
    note: str

    @classmethod
    def of_reals(cls, name: str, values: NDArray[Any], real: Real, note: str) -> "CArray":
        """Makes an array of real numbers, in single precision if that represents them exactly."""
        with np.errstate(over="ignore"):
            narrow = values.astype(np.float32)
        if real == "float" or np.array_equal(narrow, values):
            return cls(name, narrow, "float", note)
        return cls(name, values, "double", note)

    @classmethod
    def of_indices(cls, name: str, values: NDArray[Any], note: str) -> "CArray":
        kind = "unsigned char" if values.max(initial=0) <= 255 else "unsigned short"
        return cls(name, values, kind, note)

    @property
    def declaration(self) -> str:
        sizes = "".join(f"[{size}]" for size in self.values.shape)
        return f"static const {self.type} {self.name}{sizes}"

    @property
    def definition(self) -> str:
        written = self.values.astype(str)
        if self.type == "float":
            # Write only the digits that distinguish numbers in single precision.
            written = np.char.add(self.values.astype(np.float32).astype(str), "f")
        written = np.where(np.isinf(self.values), "INFINITY", written)
        return "\n".join([f"{self.declaration} = {{", *_rows(written), "};"])


def _rows(written: NDArray[Any]) -> Iterator[str]:
    """Writes the lines between an array's braces; an inner array begins on a new line."""
    if written.ndim > 1:
        for inner in written:
            yield "{"
            yield from _rows(inner)
            yield "},"
        return
    # Put as many entries on a line as fit if all have the greatest width.
    width = max(len(entry) for entry in written.tolist()) + 2
    count = max(1, LINE_LENGTH // width)
    entries = written.tolist()
    for start in range(0, len(entries), count):
        yield ", ".join(entries[start : start + count]) + ","


def rendered(template: str, real: Real, /, **values: Any) -> str:
    """Fills a template of code that computes in the type `real`.

    The filter `number` writes numbers, and `function` writes names of functions of math.h.
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(_TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["number"] = lambda value: number(value, real)
    environment.filters["comment"] = comment
    environment.filters["function"] = lambda name: function(name, real)
    return environment.get_template(template).render(real=real, **values)
