"""Formulas as polynomials of what the robot senses and of functions of it.

A formula such as `late*(0.1 - 0.2*cmd.yaw) + lifted.FL*q.FL_hip` is multiplied out to monomials,
each a number times powers of *factors*: quantities, and functions such as tanh(0.5*t - 2) of other
polynomials. Coefficients are fractions: nothing is rounded, and what cancels is gone.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import Expression

MOST_MONOMIALS = 20_000
"""Greatest number of monomials that a formula is multiplied out to."""

Monomial = tuple[tuple[int, int], ...]
"""Factors by number, in order, each with its power."""

Polynomial = Mapping[Monomial, Fraction]

_POWERS = {"square": 2, "cube": 3}


@dataclass(frozen=True)
class Factor:
    """A quantity, or a function of one argument.

    Attributes:
        function: "variable", "inverse", or the function's name.
        variable: The quantity's index, of a variable.
        argument: What a function is of, its monomials in order.
    """

    function: str
    variable: int = -1
    argument: tuple[tuple[Monomial, Fraction], ...] = ()


@dataclass
class PolynomialRing:
    """Numbers the factors that polynomials are made of.

    Attributes:
        factors: The factors by number.
    """

    factors: list[Factor] = field(default_factory=list)
    _numbers: dict[Factor, int] = field(default_factory=dict)
    _variables: dict[int, frozenset[int]] = field(default_factory=dict)

    def polynomial(self, formula: Expression) -> Polynomial:
        """Multiplies a formula of observed quantities out.

        Raises:
            InputError: if it has too many monomials.
        """
        operands = [self.polynomial(operand) for operand in formula.operands]
        match formula.operator, operands:
            case "constant", _:
                return _of_number(Fraction(formula.value))
            case "variable", _:
                return self._of_factor(Factor("variable", formula.variable))
            case "neg", [inner]:
                return combined(inner, factor=Fraction(-1))
            case "add", [left, right]:
                return combined(left, right)
            case "sub", [left, right]:
                return combined(left, combined(right, factor=Fraction(-1)))
            case "mul", [left, right]:
                return product(left, right)
            case "div", [left, right]:
                return product(left, self._inverse(right))
            case operator, [inner] if operator in _POWERS:
                whole = inner
                for _ in range(_POWERS[operator] - 1):
                    whole = product(whole, inner)
                return whole
            case operator, [inner]:
                return self._of_factor(Factor(operator, argument=tuple(sorted(inner.items()))))
        raise AssertionError(formula.operator)

    def variables(self, factor: int) -> frozenset[int]:
        """Returns the quantities that a factor is of."""
        if factor not in self._variables:
            own = self.factors[factor]
            inner = {number for monomial, _ in own.argument for number, _ in monomial}
            self._variables[factor] = (
                frozenset([own.variable])
                if own.function == "variable"
                else frozenset().union(*(self.variables(number) for number in inner))
            )
        return self._variables[factor]

    def _inverse(self, divisor: Polynomial) -> Polynomial:
        number = divisor.get((), Fraction(0))
        if set(divisor) == {()} and number:
            return _of_number(1 / number)
        return self._of_factor(Factor("inverse", argument=tuple(sorted(divisor.items()))))

    def _of_factor(self, factor: Factor) -> Polynomial:
        if factor not in self._numbers:
            self._numbers[factor] = len(self.factors)
            self.factors.append(factor)
        return {((self._numbers[factor], 1),): Fraction(1)}


def combined(*polynomials: Polynomial, factor: Fraction = Fraction(1)) -> Polynomial:
    """Adds polynomials, and multiplies their sum by a number."""
    whole: dict[Monomial, Fraction] = {}
    for polynomial in polynomials:
        for monomial, coefficient in polynomial.items():
            whole[monomial] = whole.get(monomial, Fraction(0)) + factor * coefficient
    return {monomial: coefficient for monomial, coefficient in whole.items() if coefficient}


def product(left: Polynomial, right: Polynomial) -> Polynomial:
    """Multiplies two polynomials.

    Raises:
        InputError: if the product has too many monomials.
    """
    if len(left) * len(right) > MOST_MONOMIALS:
        raise InputError(
            f"a formula has more than {MOST_MONOMIALS} terms when it is multiplied out; write a "
            "simpler one"
        )
    whole: dict[Monomial, Fraction] = {}
    for one, a in left.items():
        for other, b in right.items():
            powers = dict(one)
            for factor, power in other:
                powers[factor] = powers.get(factor, 0) + power
            monomial = tuple(sorted(powers.items()))
            whole[monomial] = whole.get(monomial, Fraction(0)) + a * b
    return {monomial: coefficient for monomial, coefficient in whole.items() if coefficient}


def _of_number(number: Fraction) -> Polynomial:
    return {(): number} if number else {}
