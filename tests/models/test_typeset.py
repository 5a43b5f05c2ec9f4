"""Typeset formulas: LaTeX and MathML say what the text says."""

import re

import pytest

from glassgait.models.formulas.typeset import Latex, MathML, Typesetter
from glassgait.models.policies.library import load_student

SYMBOLS = {
    "q.FL_hip": r"q_{\mathrm{FL\,hip}}",
    "dq.FL_hip": r"\dot q_{\mathrm{FL\,hip}}",
    "w.x": r"\omega_{x}",
    "t": "n",
    "cmd.t": "n^{*}",
    "LEAN": r"60^{\circ}",
}
LATEX, MATHML = (Typesetter(markup, SYMBOLS) for markup in (Latex(), MathML()))


@pytest.mark.parametrize(
    ("text", "latex"),
    [
        ("-0.3*t*w.x - 2", r"-0.3 \, n \, \omega_{x} - 2"),
        ("0.02*9.81*t", r"0.02 \cdot 9.81 \, n"),
        ("t/cmd.t", r"\frac{n}{n^{*}}"),
        ("(t + 1)*(w.x - t)", r"(n + 1)(\omega_{x} - n)"),
        ("t - (w.x - 1)", r"n - (\omega_{x} - 1)"),
        ("(t + 1)**2*dq.FL_hip", r"{(n + 1)}^{2} \, \dot q_{\mathrm{FL\,hip}}"),
        ("tanh(5*q.FL_hip - 4)", r"\tanh\left(5 \, q_{\mathrm{FL\,hip}} - 4\right)"),
        ("2e-07*t", r"2 \cdot 10^{-7} \, n"),
        ("-cos(LEAN)", r"-\cos\left(60^{\circ}\right)"),
        ("low if stuck else 0", None),
        ("FL & ~RR", r"\mathrm{FL} \wedge \neg \mathrm{RR}"),
        ("near and norm(v - p) < 1", r"\mathrm{near} \wedge \left\|v - p\right\| < 1"),
        ("dot(n, p - cross(w, v))", r"n \cdot (p - w \times v)"),
        ("stood.before", r"\mathrm{stood}^{-}"),
        ("foothold.FL", r"\mathrm{foothold}_{\mathrm{FL}}"),
    ],
)
def test_latex_says_what_the_text_says(text, latex):
    written = LATEX.whole(text)
    if latex is None:
        latex = (
            r"\begin{cases} \mathrm{low} & \text{if } \mathrm{stuck} \\ "
            r"0 & \text{else} \end{cases}"
        )
    assert written == latex


def test_mathml_has_indices_accents_and_signs():
    assert MATHML.name("q.FL_hip") == "<msub><mi>q</mi><mtext>FL&nbsp;hip</mtext></msub>"
    assert "<mi class='accented'>q\N{COMBINING DOT ABOVE}</mi>" in MATHML.name("dq.FL_hip")
    assert MATHML.name("LEAN") == "<msup><mn>60</mn><mo>∘</mo></msup>"
    first, second = MATHML.pieces("2 - t")
    assert (first, second) == ("<mn>2</mn>", "<mo form='infix'>−</mo><mi>n</mi>")


def test_a_bracket_breaks_between_its_terms():
    assert LATEX.pieces("1 - t*(2*w.x - 3)") == ["1", r" - n(2 \, \omega_{x}", " - 3)"]


def test_a_truth_is_no_equation():
    assert LATEX.relation("unchanged == 50").strip() == r"\Leftrightarrow"
    assert LATEX.relation("1 + 1").strip() == "="


@pytest.mark.parametrize("gait", ["walk", "trot", "pace", "bound"])
def test_every_number_of_a_page_is_typeset_in_its_place(gait):
    policy = load_student(gait, "sparse_formula")
    for line in re.findall(r"^\w+_\w+ = ((?:.*\n)(?:    .*\n)*)", policy.to_text(), re.MULTILINE):
        text = " ".join(line.split())
        # 2e-05 is typeset as 2 times a power of 10.
        text = re.sub(r"(?<=[0-9])e-0?[0-9]", " 10 ", text)
        numbers = [float(own) for own in re.findall(r"(?<![\w.])[0-9.]+", text)]
        typeset = Typesetter(MathML()).whole(re.sub(r" 10 ", "e-5", text))
        assert [float(own) for own in re.findall(r"<mn>([0-9.]+)</mn>", typeset)] == numbers
        assert typeset.count("<mo form='prefix' stretchy='false'>(") == text.count("*(")
