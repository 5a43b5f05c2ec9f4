"""Writes formulas as C, in the notation of their file."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from glassgait.models.export.c_language import (
    LINE_LENGTH,
    CArray,
    Real,
    commented,
    function,
    is_identifier,
    number,
    rendered,
)
from glassgait.models.export.c_policies import Code, Style, policy_code, reflection_arrays
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.grammar import Notation, written_lines
from glassgait.models.formulas.quantities import Definition, Range, Vocabulary
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import REFLECT_JOINTS, reflect_observation, symbols_of

RESERVED = frozenset(
    {"state", "observation", "action", "target", "joints", "feet", "act", "square", "cube"}
    | {"tanh", "exp", "log", "sqrt", "sin", "cos", "tan", "fabs", "abs", "y0", "y1", "yn", "j0"}
    | {"nearest", "nearest_joints", "j1", "jn", "gamma", "signgam", "main"}
)
"""Names that definitions cannot have in C."""

_TYPES = {"Axes": "xyz", "Feet": quadruped.LEGS, "Joints": quadruped.JOINTS}

_JOINT_QUANTITIES = ("q", "dq")

_UNLIMITED = "-HUGE_VAL, HUGE_VAL"


class Group(NamedTuple):
    """Definitions that share the part of their names before the dot, `lifted` in lifted.FL."""

    name: str
    type: str  # C type with these members; empty if there is none
    members: tuple[str, ...]  # parts of the names after the dot; empty for a single number
    lines: tuple[str, ...]


class Mirror(NamedTuple):
    """Mirror images, which replace the formulas that the file leaves out."""

    signature: str  # declaration of the function that evaluates the formulas in the file
    states: tuple[str, ...]
    written: tuple[str, ...]  # joints that have a formula in each state, one bit per joint
    arrays: tuple[CArray, ...]


@policy_code.register
def formula_code(policy: FormulaPolicy, style: Style) -> Code:
    """Writes the formulas of all joints, one set for all RM states or one set per state.

    Joints whose formulas the file leaves out use the formulas of the mirrored robot.
    """
    real, vocabulary, per_state = style.real, policy.vocabulary, policy.per_state
    written = policy.to_file().written()

    # Collect the formulas of each state, and the definitions and quantities that they use.
    rows = [
        {place[-1]: formula for place, formula in written.items() if place[:-1] in ((), (state,))}
        for state in range(len(policy.formulas_by_state))
    ]
    used = frozenset().union(*(formula.variables for formula in written.values()))
    n = len(vocabulary.names)
    definitions = [item for i, item in enumerate(vocabulary.definitions, start=n) if i in used]
    observed = used.union(*(definition.formula.variables for definition in definitions))
    quantities = _quantities(vocabulary.names, observed)
    ranges = policy.readings.ranges if policy.readings else ()
    has_range = {kind.partition(".")[0] for kind, _ in ranges}
    limited = tuple(name for name in quantities if name in has_range)

    # Write them as C.
    symbols = _symbols(vocabulary)
    groups = _groups(definitions, vocabulary, symbols, real)
    formulas = [_state_lines(row, symbols, real, per_state=per_state) for row in rows]
    all_formulas = [definition.formula for definition in definitions] + list(written.values())
    mirror = _mirror(policy, rows, style) if policy.mirror else None
    signature = style.signature(takes_state=per_state)
    kind = "each RM state and joint" if per_state else "each joint"
    return Code(
        f"Formulas of the joints' targets, one for {kind}: {policy.n_terms()} terms"
        + (", and their mirror images." if policy.mirror else "."),
        rendered(
            "formulas.c",
            real,
            **_helpers(all_formulas, quantities, groups, limited),
            signature=mirror.signature if mirror else signature,
            outer_signature=signature,
            per_state=per_state,
            groups=groups,
            quantities=quantities,
            ranges=_ranges(ranges, limited, real),
            limited=limited,
            states=[pair for pair in zip(style.constants, formulas, strict=False) if pair[1]],
            mirror=mirror,
        ),
        takes_state=per_state,
    )


def _mirror(
    policy: FormulaPolicy, rows: Sequence[Mapping[int, Expression]], style: Style
) -> Mirror:
    assert policy.mirror is not None
    observation = reflect_observation(policy.vocabulary.names, policy.mirror)
    return Mirror(
        style.signature(takes_state=policy.per_state, name="formulas", writes="target"),
        tuple(style.constants[image] for image in policy.mirror),
        tuple(f"0x{sum(1 << joint for joint in row):03x}" for row in rows),
        (
            *reflection_arrays("OBSERVATION", observation),
            *reflection_arrays("TARGET", REFLECT_JOINTS),
        ),
    )


def _ranges(
    ranges: Sequence[tuple[str, Range]], limited: Sequence[str], real: Real
) -> tuple[str, ...]:
    ends = {kind: ", ".join(number(end, real) for end in pair) for kind, pair in ranges}
    lines: list[str] = []
    for name in limited:
        if name in _JOINT_QUANTITIES:
            pairs = (ends.get(f"{name}.{part}", _UNLIMITED) for part in quadruped.LEG_JOINTS)
            lines.append(f"{name} = nearest_joints({name}, {', '.join(pairs)});")
            continue
        for kind, pair in ends.items():
            first, _, axis = kind.partition(".")
            for member in (axis,) if axis else _TYPES["Feet"]:
                if first == name:
                    lines.append(f"{name}.{member} = nearest({name}.{member}, {pair});")
    return tuple(lines)


def _helpers(
    formulas: Sequence[Expression],
    quantities: Sequence[str],
    groups: Sequence[Group],
    limited: Sequence[str],
) -> dict[str, object]:
    """Returns the types and functions that formulas need besides those of math.h."""
    types = {group.type for group in groups}
    return {
        "powers": [power for power in ("square", "cube") if _uses(formulas, power)],
        "needs_axes": "Axes" in types or bool({"v", "g", "w"} & set(quantities)),
        "needs_feet": "Feet" in types or "h" in quantities,
        "needs_joints": "Joints" in types or bool({"q", "dq", "a"} & set(quantities)),
        "limits_joints": bool({*_JOINT_QUANTITIES} & {*limited}),
        "legs": quadruped.LEGS,
        "joints": quadruped.JOINTS,
    }


def _symbols(vocabulary: Vocabulary) -> tuple[str, ...]:
    """Names all variables as in the formulas, except where a name is not free in C."""
    observed = symbols_of(vocabulary.names)
    taken = {symbol.partition(".")[0] for symbol in observed}
    defined = [definition.symbol for definition in vocabulary.definitions]
    plain = {symbol for symbol in defined if "." not in symbol}
    names = []
    for place, symbol in enumerate(defined):
        first, dot, member = symbol.partition(".")
        is_valid = is_identifier(first) and (not dot or is_identifier(member)) and first.islower()
        is_taken = first in taken | RESERVED or (dot and first in plain)
        names.append(symbol if is_valid and not is_taken else f"own_{place}")
    return (*observed, *names)


def _quantities(names: Sequence[str], used: frozenset[int]) -> tuple[str, ...]:
    symbols = (symbol for i, symbol in enumerate(symbols_of(names)) if i in used)
    return tuple(dict.fromkeys(symbol.partition(".")[0] for symbol in symbols))


def _groups(
    definitions: Sequence[Definition], vocabulary: Vocabulary, symbols: Sequence[str], real: Real
) -> list[Group]:
    # Group the definitions by the part of their names before the dot.
    by_name: dict[str, list[tuple[str, Definition]]] = {}
    for definition in definitions:
        symbol = symbols[vocabulary.symbols.index(definition.symbol)]
        by_name.setdefault(symbol.partition(".")[0], []).append((symbol, definition))

    # Write their lines, and a note that several members share only once.
    groups = []
    for name, defined in by_name.items():
        members, lines, notes = [], [], set()
        for symbol, definition in defined:
            _, dot, member = symbol.partition(".")
            start, indent = (f".{member} = ", 8) if dot else (f"const {real} {symbol} = ", 4)
            members += [member] if dot else []
            formula = _lines(start, definition.formula, symbols, real, indent)
            renamed = "" if symbol == definition.symbol else f"{definition.symbol}: "
            note = commented(renamed + definition.note)
            lines += _noted(formula, "," if dot else ";", "" if dot and note in notes else note)
            notes.add(note)
        types = (key for key, parts in _TYPES.items() if members and {*members} <= {*parts})
        groups.append(Group(name, next(types, ""), tuple(members), tuple(lines)))
    return groups


def _noted(lines: Sequence[str], end: str, note: str) -> list[str]:
    """Adds a comment after a formula, or on the line before if it does not fit there."""
    *others, last = lines
    whole = f"{last}{end} /* {note} */"
    if not note or len(whole) > LINE_LENGTH:
        indent = lines[0][: len(lines[0]) - len(lines[0].lstrip())]
        before = [f"{indent}/* {note} */"] if note else []
        return [*before, *others, f"{last}{end}"]
    return [*others, whole]


def _notation(real: Real) -> Notation:
    def named(operator: str) -> str:
        whole = operator in ("square", "cube")
        return operator if whole else function("fabs" if operator == "abs" else operator, real)

    return Notation(lambda value: number(value, real), named, has_powers=False)


def _state_lines(
    row: Mapping[int, Expression], symbols: Sequence[str], real: Real, *, per_state: bool
) -> list[tuple[str, ...]]:
    indent = 8 if per_state else 4
    return [
        _lines(f"target[{quadruped.JOINTS[joint].upper()}] = ", formula, symbols, real, indent)
        for joint, formula in row.items()
    ]


def _lines(
    start: str, formula: Expression, symbols: Sequence[str], real: Real, indent: int
) -> tuple[str, ...]:
    style = {"width": LINE_LENGTH - 1, "indent": indent}
    return tuple(written_lines(start, formula, symbols, _notation(real), **style))


def _uses(formulas: Sequence[Expression], operator: str) -> bool:
    return any(
        formula.operator == operator or _uses(formula.operands, operator) for formula in formulas
    )
