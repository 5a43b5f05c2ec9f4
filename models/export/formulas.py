"""The C of formulas: they stand there as they stand in their file."""

from collections.abc import Sequence
from dataclasses import dataclass

from glassgait.models.export.code import Code, Style
from glassgait.models.export.language import (
    LINE_LENGTH,
    Real,
    commented,
    function,
    is_identifier,
    number,
    rendered,
)
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.formulas.text import Notation, written_lines
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of

RESERVED = frozenset(
    {"state", "observation", "action", "target", "joints", "feet", "act", "square", "cube"}
    | {"tanh", "exp", "log", "sqrt", "sin", "cos", "tan", "fabs", "abs", "y0", "y1", "yn", "j0"}
    | {"j1", "jn", "gamma", "signgam", "main"}
)
"""Names that a definition cannot have in C."""


@dataclass(frozen=True)
class Group:
    """Definitions that share what stands before the dot, such as lifted.FL: a struct of C.

    Attributes:
        name: What stands before the dot, or the name itself.
        members: What stands behind it, for each; none of a plain number.
        lines: Their formulas, with their notes.
    """

    name: str
    members: tuple[str, ...]
    lines: tuple[str, ...]


def formula_code(policy: FormulaPolicy, style: Style) -> Code:
    """Writes formulas of each joint, the same always or others in each state."""
    own, real = style.own, style.real
    statewise = len(policy.dims) == 2
    vocabulary, rows = policy.vocabulary, policy.formulas_by_state
    used = frozenset().union(*(formula.variables for row in rows for formula in row))
    n = len(vocabulary.names)
    definitions = [one for i, one in enumerate(vocabulary.definitions, start=n) if i in used]
    symbols = _symbols(vocabulary)
    formulas = [
        [
            _lines(f"target[{joint.upper()}] = ", formula, symbols, real, 8 if statewise else 4)
            for joint, formula in zip(quadruped.JOINTS, row, strict=True)
        ]
        for row in rows
    ]
    observed = used.union(*(one.formula.variables for one in definitions))
    quantities = _quantities(vocabulary.names, observed)
    everything = [one.formula for one in definitions] + [one for row in rows for one in row]
    kind = "each state of the machine and joint" if statewise else "each joint"
    return Code(
        f"Formulas of the joints' targets, one for {kind}: {policy.n_terms()} terms"
        + (", and their mirror images." if policy.mirror else "."),
        rendered(
            "formulas.c",
            real,
            OWN=style.begin,
            own=own,
            signature=style.signature(takes_state=statewise),
            statewise=statewise,
            groups=_groups(definitions, vocabulary, symbols, real),
            quantities=quantities,
            states=list(zip(style.constants, formulas, strict=False)),
            mirror=[style.constants[image] for image in policy.mirror] if policy.mirror else None,
        ),
        takes_state=statewise,
        helpers=_helpers(everything, quantities, real),
    )


def _helpers(
    formulas: Sequence[Expression], quantities: Sequence[str], real: Real
) -> tuple[str, ...]:
    """Writes the functions that formulas call besides those of math.h."""
    powers = [power for power in ("square", "cube") if _asks_for(formulas, power)]
    texts = [rendered("power.c", real, power=power) for power in powers]
    if {"q", "dq", "a"} & set(quantities):
        texts.append(rendered("joints.c", real, joints=quadruped.JOINTS))
    return tuple(texts)


def _symbols(vocabulary: Vocabulary) -> tuple[str, ...]:
    """Names all variables as C can: as the formulas do, but for names that C has other uses for."""
    observed = [entry.symbol for entry in entries_of(vocabulary.names)]
    taken = {symbol.partition(".")[0] for symbol in observed}
    defined = [definition.symbol for definition in vocabulary.definitions]
    plain = {symbol for symbol in defined if "." not in symbol}
    names = []
    for place, symbol in enumerate(defined):
        first, dot, member = symbol.partition(".")
        fit = is_identifier(first) and (not dot or is_identifier(member)) and first.islower()
        clash = first in taken | RESERVED or (dot and first in plain)
        names.append(symbol if fit and not clash else f"own_{place}")
    return (*observed, *names)


def _quantities(names: Sequence[str], used: frozenset[int]) -> tuple[str, ...]:
    """Lists the observed quantities that formulas use, by what stands before the dot."""
    entries = entries_of(names)
    return tuple(
        dict.fromkeys(
            entries[index].symbol.partition(".")[0] for index in sorted(used) if index < len(names)
        )
    )


def _groups(
    definitions: Sequence[Definition], vocabulary: Vocabulary, symbols: Sequence[str], real: Real
) -> list[Group]:
    by_name: dict[str, list[tuple[str, Definition]]] = {}
    for definition in definitions:
        symbol = symbols[vocabulary.symbols.index(definition.symbol)]
        by_name.setdefault(symbol.partition(".")[0], []).append((symbol, definition))
    groups = []
    for name, own in by_name.items():
        members, lines = [], []
        for symbol, definition in own:
            _, dot, member = symbol.partition(".")
            start, indent = (f".{member} = ", 8) if dot else (f"const {real} {symbol} = ", 4)
            members += [member] if dot else []
            formula = _lines(start, definition.formula, symbols, real, indent)
            renamed = "" if symbol == definition.symbol else f"{definition.symbol}: "
            note = commented(renamed + definition.note)
            lines += _noted(formula, "," if dot else ";", note)
        groups.append(Group(name, tuple(members), tuple(lines)))
    return groups


def _noted(lines: Sequence[str], end: str, note: str) -> list[str]:
    """Adds a comment behind a formula, or before it where the line is too short for both."""
    *others, last = lines
    whole = f"{last}{end} /* {note} */"
    if not note or len(whole) > LINE_LENGTH:
        indent = lines[0][: len(lines[0]) - len(lines[0].lstrip())]
        before = [f"{indent}/* {note} */"] if note else []
        return [*before, *others, f"{last}{end}"]
    return [*others, whole]


def _notation(real: Real) -> Notation:
    def named(operator: str) -> str:
        if operator in ("square", "cube"):
            return operator
        return function("fabs" if operator == "abs" else operator, real)

    return Notation(lambda value: number(value, real), named, has_powers=False)


def _lines(
    start: str, formula: Expression, symbols: Sequence[str], real: Real, indent: int
) -> tuple[str, ...]:
    style = {"width": LINE_LENGTH - 1, "indent": indent}
    return tuple(written_lines(start, formula, symbols, _notation(real), **style))


def _asks_for(formulas: Sequence[Expression], operator: str) -> bool:
    return any(
        formula.operator == operator or _asks_for(formula.operands, operator)
        for formula in formulas
    )
