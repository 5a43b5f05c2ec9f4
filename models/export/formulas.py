"""The C of formulas: they stand there as they stand in their file."""

from collections.abc import Sequence
from dataclasses import dataclass

from glassgait.models.export.code import Code, Style, reflection_arrays
from glassgait.models.export.language import (
    LINE_LENGTH,
    CArray,
    Real,
    commented,
    function,
    is_identifier,
    number,
    rendered,
)
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.quantities import Definition, Vocabulary
from glassgait.models.formulas.readings import Readings
from glassgait.models.formulas.text import Notation, written_lines
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of, symbols_of
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

RESERVED = frozenset(
    {"state", "observation", "action", "target", "joints", "feet", "act", "square", "cube"}
    | {"tanh", "exp", "log", "sqrt", "sin", "cos", "tan", "fabs", "abs", "y0", "y1", "yn", "j0"}
    | {"nearest", "nearest_joints", "j1", "jn", "gamma", "signgam", "main"}
)
"""Names that a definition cannot have in C."""


_TYPES = {"Axes": "xyz", "Feet": quadruped.LEGS, "Joints": quadruped.JOINTS}
"""Types of C that formulas share, with their members."""

_OF_JOINTS = ("q", "dq")
"""What is sensed of joints."""

_ANY = "-HUGE_VAL, HUGE_VAL"
"""The range of what has none."""


@dataclass(frozen=True)
class Group:
    """Definitions that share what stands before the dot, such as lifted.FL: a struct of C.

    Attributes:
        name: What stands before the dot, or the name itself.
        type: Type of C that has such members, if the file has one; else nothing.
        members: What stands behind the dot, for each; none of a plain number.
        lines: Their formulas, with their notes.
    """

    name: str
    type: str
    members: tuple[str, ...]
    lines: tuple[str, ...]


def formula_code(policy: FormulaPolicy, style: Style) -> Code:
    """Writes formulas of each joint, the same always or others in each state.

    Those that the policy's file leaves out as mirror images are left out as well: the robot is seen
    in the mirror instead.
    """
    own, real = style.own, style.real
    statewise = len(policy.dims) == 2
    vocabulary = policy.vocabulary
    written = policy.to_file().written()
    rows = [
        {place[-1]: formula for place, formula in written.items() if place[:-1] in ((), (state,))}
        for state in range(len(policy.formulas_by_state))
    ]
    used = frozenset().union(*(formula.variables for formula in written.values()))
    n = len(vocabulary.names)
    definitions = [one for i, one in enumerate(vocabulary.definitions, start=n) if i in used]
    symbols = _symbols(vocabulary)
    indent = 8 if statewise else 4
    formulas = [
        [
            _lines(f"target[{quadruped.JOINTS[joint].upper()}] = ", formula, symbols, real, indent)
            for joint, formula in row.items()
        ]
        for row in rows
    ]
    observed = used.union(*(one.formula.variables for one in definitions))
    quantities = _quantities(vocabulary.names, observed)
    ranges = policy.readings.ranges if policy.readings else ()
    has_range = {kind.partition(".")[0] for kind, _ in ranges}
    limited = tuple(name for name in quantities if name in has_range)
    groups = _groups(definitions, vocabulary, symbols, real)
    everything = [one.formula for one in definitions] + list(written.values())
    kind = "each state of the machine and joint" if statewise else "each joint"
    mirror = _mirror(policy, [frozenset(row) for row in rows], style) if policy.mirror else None
    signature = style.signature(takes_state=statewise)
    return Code(
        f"Formulas of the joints' targets, one for {kind}: {policy.n_terms()} terms"
        + (", and their mirror images." if policy.mirror else "."),
        rendered(
            "formulas.c",
            real,
            OWN=style.begin,
            own=own,
            signature=mirror.inner_signature if mirror else signature,
            outer_signature=signature,
            statewise=statewise,
            groups=groups,
            quantities=quantities,
            ranges=_ranges(policy.readings, limited, real),
            limited=limited,
            states=[pair for pair in zip(style.constants, formulas, strict=False) if pair[1]],
            mirror=mirror,
        ),
        takes_state=statewise,
        helpers=_helpers(everything, quantities, groups, real, limited=limited),
    )


@dataclass(frozen=True)
class Mirror:
    """How formulas that were left out are had from those that stand.

    Attributes:
        function: Name of the function of the formulas that stand.
        inner_signature: Its declaration.
        states: Constant of the state that each state is in the mirror.
        written: Which joints have a formula of their own in each state, a bit a joint.
        arrays: What an observation is in the mirror, and what targets are.
    """

    function: str
    inner_signature: str
    states: tuple[str, ...]
    written: tuple[str, ...]
    arrays: tuple[CArray, ...]


def _mirror(policy: FormulaPolicy, written: Sequence[frozenset[int]], style: Style) -> Mirror:
    assert policy.mirror is not None
    statewise = len(policy.dims) == 2
    reflections = {
        "OBSERVATION": reflect_observation(policy.vocabulary.names, policy.mirror),
        "TARGET": REFLECT_JOINTS,
    }
    return Mirror(
        f"{style.own}formulas",
        style.signature(takes_state=statewise, name="formulas", writes="target"),
        tuple(style.constants[image] for image in policy.mirror),
        tuple(f"0x{sum(1 << joint for joint in joints):03x}" for joints in written),
        tuple(
            array
            for what, reflection in reflections.items()
            for array in reflection_arrays(f"{style.begin}{what}", reflection)
        ),
    )


def _ranges(readings: Readings | None, limited: Sequence[str], real: Real) -> tuple[str, ...]:
    """Writes the statements that keep what formulas use within its range.

    Args:
        readings: The ranges.
        limited: What stands before the dot of those that formulas use.
        real: The type that is computed in.
    """
    ends = {
        kind: ", ".join(number(end, real) for end in own)
        for kind, own in (readings.ranges if readings else ())
    }
    lines: list[str] = []
    for name in limited:
        if name in _OF_JOINTS:
            parts = (ends.get(f"{name}.{part}", _ANY) for part in quadruped.LEG_JOINTS)
            lines.append(f"{name} = nearest_joints({name}, {', '.join(parts)});")
            continue
        for kind, text in ends.items():
            first, _, member = kind.partition(".")
            for one in (member,) if member else _TYPES["Feet"]:
                if first == name:
                    lines.append(f"{name}.{one} = nearest({name}.{one}, {text});")
    return tuple(lines)


def _helpers(
    formulas: Sequence[Expression],
    quantities: Sequence[str],
    groups: Sequence[Group],
    real: Real,
    *,
    limited: Sequence[str],
) -> tuple[str, ...]:
    """Writes the types of C that formulas need, and the functions besides those of math.h."""
    powers = [power for power in ("square", "cube") if _asks_for(formulas, power)]
    texts = [rendered("power.c", real, power=power) for power in powers]
    types = {group.type for group in groups}
    if "Axes" in types or {"v", "g", "w"} & set(quantities):
        texts.append(rendered("axes.c", real))
    if "Feet" in types or "h" in quantities:
        texts.append(rendered("feet.c", real, legs=quadruped.LEGS))
    if "Joints" in types or {"q", "dq", "a"} & set(quantities):
        texts.append(rendered("joints.c", real, joints=quadruped.JOINTS))
        if {*_OF_JOINTS} & {*limited}:
            texts.append(rendered("nearest_joints.c", real, joints=quadruped.JOINTS))
    return tuple(texts)


def _symbols(vocabulary: Vocabulary) -> tuple[str, ...]:
    """Names all variables as C can: as the formulas do, but for names that C has other uses for."""
    observed = symbols_of(vocabulary.names)
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
        members, lines, said = [], [], set()
        for symbol, definition in own:
            _, dot, member = symbol.partition(".")
            start, indent = (f".{member} = ", 8) if dot else (f"const {real} {symbol} = ", 4)
            members += [member] if dot else []
            formula = _lines(start, definition.formula, symbols, real, indent)
            renamed = "" if symbol == definition.symbol else f"{definition.symbol}: "
            note = commented(renamed + definition.note)
            # What was said of a member is not said again of another.
            lines += _noted(formula, "," if dot else ";", "" if dot and note in said else note)
            said.add(note)
        groups.append(Group(name, _type_of(members), tuple(members), tuple(lines)))
    return groups


def _type_of(members: Sequence[str]) -> str:
    for name, all_members in _TYPES.items():
        if members and set(members) <= set(all_members):
            return name
    return ""


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
