"""One way to write each formula: where minus signs stand.

Two trees may say the same, such as x + (-2)·y and x - 2·y. A formula in canonical form is the tree
that its own text reads back as, so that writing and reading change nothing. Canonical form changes
no value, not even in its last digit, since it moves nothing but signs; of a zero alone it may
change the sign, and so of what is divided by it.
"""

from glassgait.models.formulas.expression import Expression, constant


def canonical(formula: Expression) -> Expression:
    """Returns the formula in canonical form: of the same value, its minus signs in front.

    Signs stand before what leads a product or a quotient, before divisors, or between terms; never
    before a right factor, and never before a sum.
    """
    operands = tuple(canonical(operand) for operand in formula.operands)
    match formula.operator, operands:
        case "constant", _:
            # There is no zero below zero in a text.
            return formula if formula.value else constant(0.0)
        case "neg", (inner,):
            return negative(inner)
        case "mul", (left, right) if is_negative(right):
            return Expression("mul", (negative(left), negative(right)))
        case "add", (left, right) if is_negative(right):
            return Expression("sub", (left, negative(right)))
        case "sub", (left, right) if is_negative(right):
            return Expression("add", (left, negative(right)))
        case "variable", _:
            return formula
        case operator, _:
            # What is canonical already stays the same object, with what it knows of itself.
            pairs = zip(operands, formula.operands, strict=True)
            same = all(own is before for own, before in pairs)
            return formula if same else Expression(operator, operands)


def negative(formula: Expression) -> Expression:
    """Returns the negative of a canonical formula, in canonical form."""
    match formula:
        case Expression("constant", value=value):
            return constant(0.0 - value)
        case Expression("neg", (inner,)):
            return inner
        case Expression("add", (left, right)):
            return Expression("sub", (negative(left), right))
        case Expression("sub", (left, right)):
            return Expression("add", (negative(left), right))
        case Expression(("mul" | "div") as operator, (left, right)):
            return Expression(operator, (negative(left), right))
        case _:
            return Expression("neg", (formula,))


def is_negative(formula: Expression) -> bool:
    """Tells whether a canonical formula begins with a minus sign that stands for all of it."""
    match formula:
        case Expression("constant", value=value):
            return value < 0.0
        case Expression("neg"):
            return True
        case Expression("mul" | "div", (left, _)):
            return is_negative(left)
        case _:
            return False
