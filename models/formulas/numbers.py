"""The numbers of formulas and of formula files, from left to right, and others in their place."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise, repeat

from glassgait.models.errors import InputError
from glassgait.models.formulas.expression import (
    ZERO,
    Expression,
    canonical,
    constant,
    negated,
    plus,
    variable,
)
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.mirror import Place
from glassgait.models.formulas.quantities import Definition
from glassgait.models.formulas.tape import Tape


def numbers_of(formula: Expression) -> Iterator[float]:
    """Lists the constants of a formula, from left to right."""
    if formula.operator == "constant":
        yield formula.value
    for operand in formula.operands:
        yield from numbers_of(operand)


def with_numbers(formula: Expression, numbers: Iterator[float]) -> Expression:
    """Puts the next of `numbers` in the place of a formula's constants."""
    return _with_leaves(formula, map(constant, numbers))


@dataclass(frozen=True)
class WeightedSum:
    """A formula as a sum of terms, each multiplied by a number of its own.

    Attributes:
        terms: What each of the formula's numbers multiplies, from left to right.
        rest: What no number multiplies.
    """

    terms: tuple[Expression, ...]
    rest: Expression

    @classmethod
    def of(cls, formula: Expression) -> "WeightedSum | None":
        """Splits a formula; returns None where a number is in a function or multiplies another."""
        first = max(formula.variables, default=-1) + 1
        numbers = range(first, first + len([*numbers_of(formula)]))
        opened = _with_leaves(formula, map(variable, numbers))
        terms = tuple(map(opened.derivative, numbers))
        if any(not term.variables.isdisjoint(numbers) for term in terms):
            return None
        return cls(terms, without_zeros(with_numbers(formula, repeat(0.0))))


def without_zeros(formula: Expression) -> Expression:
    """Leaves out what is multiplied by 0."""
    if not formula.operands:
        return formula
    operands = tuple(without_zeros(operand) for operand in formula.operands)
    match formula.operator, operands:
        case "add", (left, right):
            return plus(left, right)
        case "sub", (left, right) if ZERO in (left, right):
            return left if right == ZERO else negated(right)
        case "mul", _ if ZERO in operands:
            return ZERO
        case (("div" | "neg"), (left, *_)) if left == ZERO:
            return ZERO
        case operator, _:
            return Expression(operator, operands)


@dataclass(frozen=True)
class FileNumbers:
    """The numbers of a formula file: those of its definitions, then those of its formulas.

    What the file leaves out, as the mirror image of what it holds, has no numbers of its own.

    Attributes:
        file: The file.
    """

    file: FormulaFile

    @cached_property
    def definitions(self) -> tuple[Definition, ...]:
        """The definitions that the file holds."""
        return self.file.written_definitions()

    @cached_property
    def formulas(self) -> dict[Place, Expression]:
        """The formulas that the file holds."""
        return self.file.written()

    @cached_property
    def start(self) -> tuple[float, ...]:
        """The numbers as they stand in the file (p)."""
        held = [*(own.formula for own in self.definitions), *self.formulas.values()]
        return tuple(number for formula in held for number in numbers_of(formula))

    @cached_property
    def spans(self) -> tuple[range, ...]:
        """Which numbers are of each formula that the file holds, in their order."""
        first = sum(len([*numbers_of(own.formula)]) for own in self.definitions)
        counts = [len([*numbers_of(formula)]) for formula in self.formulas.values()]
        ends = [*accumulate(counts, initial=first)]
        return tuple(range(*ends_of) for ends_of in pairwise(ends))

    @cached_property
    def open(self) -> FormulaFile:
        """The file with variables in the place of its numbers.

        Number i is the variable `n_symbols` + i, behind all that the file's vocabulary names.
        """
        first = self.n_symbols
        return self._filled(variable(first + i) for i in range(len(self.start)))

    @property
    def n_symbols(self) -> int:
        """Number of the names that formulas may hold."""
        return len(self.file.vocabulary.symbols)

    def replaced(self, numbers: Sequence[float]) -> FormulaFile:
        """Returns the file with other numbers (p), without what they multiply by 0.

        Raises:
            InputError: if there are more or fewer numbers.
        """
        if len(numbers) != len(self.start):
            raise InputError(f"numbers: are {len(numbers)}; the file has {len(self.start)}")
        # Where nothing has changed, the file stays as it is, with what it multiplies by 0.
        if tuple(numbers) == self.start:
            return self.file
        return self._filled(map(constant, numbers), tidy=True)

    def tape(self, formulas: Iterable[Expression]) -> Tape:
        """Compiles formulas of the open file, or parts of them, for any numbers.

        Returns:
            What maps the observed quantities and the numbers behind them (..., n + p) to the
            formulas' values. It acts as a policy of the replaced file does, to the last bit.
        """
        vocabulary, first = self.open.vocabulary, self.n_symbols
        n = len(vocabulary.names)
        places = {first + i: variable(n + i) for i in range(len(self.start))}
        expanded = [vocabulary.expanded(formula).replaced(places) for formula in formulas]
        return Tape(expanded, n + len(self.start))

    def _filled(self, leaves: Iterable[Expression], *, tidy: bool = False) -> FormulaFile:
        """Puts the next of `leaves` in the place of each number, and completes the mirror."""
        file, remaining = self.file, iter(leaves)

        def filled(formula: Expression) -> Expression:
            own = _with_leaves(formula, remaining)
            return canonical(without_zeros(own) if tidy else own)

        definitions = [replace(own, formula=filled(own.formula)) for own in self.definitions]
        formulas = {place: filled(formula) for place, formula in self.formulas.items()}
        return file.with_written(definitions, formulas)


def _with_leaves(formula: Expression, leaves: Iterator[Expression]) -> Expression:
    if formula.operator == "constant":
        return next(leaves)
    if not formula.operands:
        return formula
    operands = tuple(_with_leaves(operand, leaves) for operand in formula.operands)
    return Expression(formula.operator, operands)
