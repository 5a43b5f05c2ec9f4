"""Boolean formulas over the feet."""

import pytest

from glassgait.models.errors import InputError
from glassgait.models.task.gait import STANCES, parse_formula, stance_code


def test_table_agrees_with_python_on_every_stance():
    formula = parse_formula("(FL | FR) & ~(RL & RR)")
    for contact in STANCES:
        fl, fr, rl, rr = contact
        assert formula.table[int(stance_code(contact))] == ((fl or fr) and not (rl and rr))


def test_swing_feet_are_those_that_must_be_in_the_air():
    assert parse_formula("FL & RR & ~FR & ~RL").swing_feet == (False, True, True, False)
    assert parse_formula("FL").swing_feet == (False, False, False, False)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("FX & FL", "unknown foot 'FX'; the feet are FL, FR, RL, RR"),
        ("FL &", "cannot be read"),
        ("FL & ~FL", "can never hold"),
        ("FL + FR", "does not belong"),
        ("FL and FR", "does not belong"),
        ("FL | " * 5000 + "FL", "longer than 1000 characters"),
        ("(" * 400 + "FL" + ")" * 400, "cannot be read"),
    ],
)
def test_bad_formulas_are_refused_in_one_sentence(text, message):
    with pytest.raises(InputError, match=message.replace("'", ".")) as raised:
        parse_formula(text)
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) < 300


def test_line_breaks_in_a_formula_are_spaces():
    assert parse_formula("FL &\n  ~FR\n").text == "FL & ~FR"
