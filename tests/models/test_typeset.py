"""Typeset formulas: LaTeX says what the text says."""

import pytest

from glassgait.models.formulas.typeset import Latex, Typesetter

SYMBOLS = {
    "q.FL_hip": r"q_{\mathrm{FL\,hip}}",
    "dq.FL_hip": r"\dot q_{\mathrm{FL\,hip}}",
    "w.x": r"\omega_{x}",
    "t": "n",
    "cmd.t": "n^{*}",
    "LEAN": r"60^{\circ}",
}
LATEX = Typesetter(Latex(), SYMBOLS)


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


def test_a_bracket_breaks_between_its_terms():
    assert LATEX.pieces("1 - t*(2*w.x - 3)") == ["1", r" - n(2 \, \omega_{x}", " - 3)"]


def test_a_truth_is_no_equation():
    assert LATEX.relation("unchanged == 50").strip() == r"\Leftrightarrow"
    assert LATEX.relation("1 + 1").strip() == "="
