"""Terms of a policy of formulas that can be read: a weight times one input, alone or in gates."""

from collections.abc import Iterator
from dataclasses import dataclass

from glassgait.models.formulas.expression import Expression, canonical, constant, times, variable
from glassgait.models.formulas.file import FormulaFile
from glassgait.models.formulas.grammar import write_formula
from glassgait.models.formulas.mirror import FormulaMirror, Place
from glassgait.models.formulas.quantities import GATES, Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import Group, entries_of

INPUTS: tuple[Group, ...] = (
    "commanded velocity",
    "commanded iterations",
    "gravity",
    "angular velocity",
    "base velocity",
    "foot height",
)
"""What a robot is commanded, and how its trunk lies and moves, and its feet.

Readings of joints are left out: they are how a servo goes on, and say little to a person.
"""

CLOCKS: tuple[Group, ...] = ("iterations", "machine state")
"""What encodes when, not what: a definition that uses one of these is no input."""


@dataclass(frozen=True)
class Term:
    """A term that a person can read.

    Attributes:
        place: Where its formula stands.
        input: Index of the variable that it speaks of.
        gates: Indices of the variables that say when it counts.
        mirrored: Whether the file holds its formula for the mirror image too.
    """

    place: Place
    weight: float
    input: int
    gates: tuple[int, ...] = ()
    mirrored: bool = False

    @property
    def joint(self) -> int:
        """Index of the joint whose target it is part of."""
        return self.place[-1]

    @property
    def state(self) -> int | None:
        """State of the machine that its formula acts in; none where it acts in all."""
        return self.place[0] if len(self.place) > 1 else None

    def with_input(self, weight: float) -> Expression:
        """Returns a weight times its gates and its input."""
        return times(self.with_gates(weight), variable(self.input))

    def with_gates(self, weight: float) -> Expression:
        """Returns a weight times its gates."""
        product = constant(weight)
        for gate in self.gates:
            product = times(product, variable(gate))
        return product

    def text(self, symbols: tuple[str, ...]) -> str:
        """Writes the term with the given names of variables, such as 0.43*v.z."""
        return write_formula(canonical(self.with_input(self.weight)), symbols)

    @property
    def joint_name(self) -> str:
        """Name of the joint, such as FL_hip."""
        return quadruped.JOINTS[self.joint]


def readable_terms(file: FormulaFile) -> list[Term]:
    """Lists the terms of a file's written formulas that can be read, in the file's order.

    Products of sums are multiplied out. A term of another form is left out: one with a function or
    a quotient, with two inputs or with readings of joints. Terms of the same input and gates in one
    formula are one.
    """
    inputs, gates = _inputs(file.vocabulary), _gates(file.vocabulary)
    return [
        term
        for place, formula in sorted(file.written().items())
        for term in _terms_of(place, formula, inputs, gates, mirrored=has_image(file, place))
    ]


def has_image(file: FormulaFile, place: Place) -> bool:
    """Returns whether the formula elsewhere in the mirror is this one's mirror image.

    Raises:
        InputError: if a definition has no mirror image.
    """
    if file.mirror is None:
        return False
    mirror = FormulaMirror.of(file.vocabulary, file.mirror)
    image = mirror.formula(file.formulas[place], place[-1])
    return file.formulas[mirror.place(place)] == image


def _terms_of(
    place: Place,
    formula: Expression,
    inputs: frozenset[int],
    gates: frozenset[int],
    *,
    mirrored: bool,
) -> Iterator[Term]:
    weights: dict[tuple[int, tuple[int, ...]], float] = {}
    for whole in formula.terms():
        read = _product(whole)
        if read is None:
            continue
        weight, factors = read
        own = [factor for factor in factors if factor in inputs]
        when = sorted(factor for factor in factors if factor in gates)
        # A gate that counts twice, such as late*late, has no sign any more.
        if len(own) == 1 and len(own) + len(set(when)) == len(factors):
            key = (own[0], tuple(when))
            weights[key] = weights.get(key, 0.0) + weight
    for (own_input, when), weight in weights.items():
        yield Term(place, weight, own_input, when, mirrored)


def _product(formula: Expression) -> tuple[float, list[int]] | None:
    """Reads a formula as a number times variables; none if it is anything else."""
    match formula.operator:
        case "constant":
            return formula.value, []
        case "variable":
            return 1.0, [formula.variable]
        case "neg" | "mul":
            weight, factors = (-1.0, []) if formula.operator == "neg" else (1.0, [])
            for operand in formula.operands:
                read = _product(operand)
                if read is None:
                    return None
                weight, factors = weight * read[0], factors + read[1]
            return weight, factors
        case _:
            return None


def _gates(vocabulary: Vocabulary) -> frozenset[int]:
    """Returns the variables that say when: the known gates, and the machine's states."""
    observed = entries_of(vocabulary.names)
    states = [i for i, entry in enumerate(observed) if entry.group == "machine state"]
    symbols = vocabulary.symbols
    return frozenset([*states, *(symbols.index(gate) for gate in GATES if gate in symbols)])


def _inputs(vocabulary: Vocabulary) -> frozenset[int]:
    observed = entries_of(vocabulary.names)
    inputs = [i for i, entry in enumerate(observed) if entry.group in INPUTS]
    clocks = {i for i, entry in enumerate(observed) if entry.group in CLOCKS}
    defined = [
        len(observed) + i
        for i, definition in enumerate(vocabulary.definitions)
        if definition.symbol not in GATES and not definition.formula.variables & clocks
    ]
    return frozenset([*inputs, *defined])
