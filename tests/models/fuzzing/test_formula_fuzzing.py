"""Forged formula files are refused in one sentence that names the place, or work."""

import re

import pytest

from glassgait.models.formulas.file import SUFFIX

BAD = (
    "tanh(" * 10_000 + "cmd.v" + ")" * 10_000,
    "tanh(" * 150 + "cmd.v" + ")" * 150,
    "(" * 10_000,
    "-" * 10_000 + "cmd.v",
    "+".join(["cmd.v"] * 20_000),
    "+".join(["cmd.v"] * 500),
    "1" * 400,
    "1" * 5000,
    "1e999",
    "-1e999",
    "1e300*cmd.v",
    "nan",
    "inf",
    "1j",
    "s9",
    "cmd",
    "cmd.v.v",
    "cmd.v**1000",
    "cmd.v**0.5",
    "cmd.v^2",
    "9**9**9",
    "__import__('os').getpid()",
    "cmd.v.__class__",
    "(cmd.v)(3)",
    "tanh",
    "tanh(cmd.v, t)",
    "tanh(x=t)",
    "neg(t)",
    "t\0",
    "",
    "# t",
    "t if t else t",
    "t < 3",
    "t and t",
    "[t]",
    "f'{t}'",
    "True",
    "t := 3",
    "yield",
    "lambda: t",
    "t\nt",
)

GOOD = (
    "*".join(f"(cmd.v + {i + 1}.5)" for i in range(22)),
    "*".join(["(t - 2.5)"] * 90),
    "tanh(" * 90 + "t" + ")" * 90,
    "1/t",
    "log(t - t)",
    "1e20*1e20*t",
    "(t\n  + # more\n\n  1)",
    "-(-(-t))",
    "+t",
    "2**2",
)


@pytest.fixture
def forged(sound_policies):
    """A sound file of each kind, with another formula for one joint."""

    def make(kind: str, formula: str) -> str:
        text = sound_policies[kind].to_text()
        return re.sub(r"(?m)^RL_thigh = .*(\n    .*)*", lambda _: f"RL_thigh = {formula}", text)

    return make


@pytest.mark.parametrize("kind", ["symbolic", "statewise_symbolic"])
@pytest.mark.parametrize("formula", BAD, ids=range(len(BAD)))
def test_what_is_no_formula_is_refused(kind, formula, forged, assert_refused_or_works):
    data = forged(kind, formula).encode(errors="surrogatepass")
    assert_refused_or_works(data, formula[:60], False, True, SUFFIX)


@pytest.mark.parametrize("kind", ["symbolic", "statewise_symbolic"])
@pytest.mark.parametrize("formula", GOOD, ids=range(len(GOOD)))
def test_strange_formulas_work(kind, formula, forged, assert_refused_or_works):
    assert_refused_or_works(forged(kind, formula).encode(), formula[:60], True, False, SUFFIX)
