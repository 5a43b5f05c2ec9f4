"""Formulas for people: observation names for variables, three digits, like terms together."""

import sympy

from models.policies.expression import Expression

DIGITS = 3


def readable_formula(formula: Expression, names: tuple[str, ...]) -> str:
    """Writes a formula as text, its terms from the heaviest constant down.

    Args:
        formula: The formula.
        names: Names of the observations.
    """
    symbols = tuple(sympy.Symbol(name) for name in names)
    rounded = _rounded(formula.to_sympy(symbols))
    terms = sympy.Add.make_args(rounded)
    text = ""
    for term in sorted(terms, key=lambda term: -abs(_weight(term))):
        minus = term.could_extract_minus_sign()
        body = str(-term if minus else term)
        text += (" − " if minus else " + ") + body if text else ("−" if minus else "") + body
    return text


def _rounded(expression: sympy.Expr) -> sympy.Expr:
    floats = {number: sympy.Float(number, DIGITS) for number in expression.atoms(sympy.Float)}
    return expression.xreplace(floats)


def _weight(term: sympy.Expr) -> float:
    coefficient, rest = term.as_coeff_Mul()
    return float(coefficient) if rest != 1 else 0.0
