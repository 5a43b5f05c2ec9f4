"""Writes a formula file as LaTeX, and the estimator and limits of its header as programs."""

import re
from collections.abc import Iterator, Sequence

from glassgait.models import GRAVITY
from glassgait.models.estimation.odometry import SLIP, Odometry
from glassgait.models.estimation.sensors import LOW, UNCHANGED_STEPS
from glassgait.models.formulas.expression import Expression
from glassgait.models.formulas.file import FormulaFile, header_lines
from glassgait.models.formulas.grammar import SIGNS, Notation, formula_tokens, written_number
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import Vocabulary
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import TargetLimits
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.observation import entries_of

TERMS_OF_A_LINE = 4


def programs_of(file: FormulaFile) -> dict[str, list[str]]:
    """Returns the lines of a header's programs by title, in the order in which they run."""
    programs, limits = {}, file.joint_law.limits
    if file.odometry is not None:
        programs |= {"contacts": contacts_program(), "odometry": odometry_program(file.odometry)}
    if limits is not None:
        programs["limits"] = limits_program(limits)
    return programs


def contacts_program() -> list[str]:
    """Writes the handling of contact sensors; see `glassgait.models.estimation.sensors`."""
    seconds = written_number(UNCHANGED_STEPS * CONTROL_PERIOD)
    return [
        "# For each foot: sensed, whether its sensor reads contact; expected, its height (m) that",
        "# odometry predicts from the previous step.",
        f"unchanged = min(unchanged + 1, {UNCHANGED_STEPS}) if sensed == sensed.before else 0",
        f"stuck = unchanged == {UNCHANGED_STEPS}    # for {seconds} s, longer than any stance",
        f"low = expected < {written_number(LOW)}",
        "touching = low if stuck else sensed    # for odometry",
        "contact = low if stuck else sensed or sensed.before    # for the machine",
    ]


def odometry_program(odometry: Odometry) -> list[str]:
    """Writes the estimator of velocity and heights; see `glassgait.models.estimation.odometry`."""
    period, gain = written_number(CONTROL_PERIOD), written_number(odometry.gain)
    gravity, slip = written_number(GRAVITY), written_number(SLIP)
    return [
        "# In the trunk's frame: w, angular velocity (rad/s); dv, sum of the accelerometer over a",
        "# step (m/s); g, direction of gravity; p, position of a foot (m); dp, its velocity (m/s)",
        "# and dr, the shank's angular velocity (rad/s), by the joints; radius of a foot (m).",
        f"predicted = v - {period}*cross(w, v) + dv + {period}*{gravity}*g    # m/s, by the IMU",
        "sole = dp + cross(w, p) + radius*cross(w + dr, g)    # m/s, of a foot's lowest point",
        "stood = touching and touching.before    # a foot that has just come down still moves",
        f"near = stood and norm(predicted + sole) < {slip}    # it neither swings nor slips",
        "standing = near if any(near) else stood",
        "measured = mean(-sole, standing)    # m/s, by the feet that stand and roll",
        f"v = predicted + {gain}*(measured - predicted) if any(standing) else predicted",
        f"foothold = p if touching else foothold - {period}*(v + cross(w, foothold))    # m",
        "normal = unit(cross(foothold.FR - foothold.RL, foothold.FL - foothold.RR))",
        "h = dot(normal, p - mean(foothold))    # m, each foot's height over that plane",
    ]


def limits_program(limits: TargetLimits) -> list[str]:
    """Writes the limits of targets; see `glassgait.models.robots.robot`."""
    stiffness, margin = written_number(limits.stiffness), written_number(limits.margin)
    return [
        "# asked: value of a formula; before: target of the previous step; q: angle of the joint,",
        "# rad. torque: greatest torque of its motor, N m; lowest, highest: ends of its range,",
        "# rad. If the value of any formula is not finite, every joint keeps its target.",
        f"reach = torque/{stiffness}    # rad, at which a joint at rest demands the full torque",
        f"wanted = asked if g.z < -cos({written_number(limits.lean)}) else q    # degrees of lean",
        "weak = clip(wanted, q - reach, q + reach)",
        "slow = clip(weak, before - reach, before + reach)    # at most reach per step",
        f"target = clip(slow, lowest + {margin}, highest - {margin})",
    ]


def symbols_of(vocabulary: Vocabulary) -> tuple[str, ...]:
    """Returns the LaTeX symbols of the variables of formulas."""
    observed = (entry.latex for entry in entries_of(vocabulary.names))
    defined = (_defined(definition.symbol) for definition in vocabulary.definitions)
    # Put a symbol with an exponent in braces, so that it can be squared.
    return tuple(f"{{{symbol}}}" if "^" in symbol else symbol for symbol in (*observed, *defined))


def to_latex(file: FormulaFile) -> str:
    """Writes a controller as a LaTeX document that needs amsmath."""
    lines = [
        f"% {file.gait}: the whole controller; joint targets in rad. Made from its formula file.",
        r"\documentclass{article}",
        r"\usepackage[margin=1.8cm]{geometry}",
        r"\usepackage{amsmath}",
        r"\allowdisplaybreaks",
        r"\begin{document}",
    ]
    for title, text in {"header": header_lines(file), **programs_of(file)}.items():
        lines += [_section(title), r"{\small\begin{verbatim}", *text, r"\end{verbatim}}"]
    lines += [*_symbols(file), *_definitions(file), *_targets(file), r"\end{document}"]
    return "\n".join(lines) + "\n"


def _symbols(file: FormulaFile) -> Iterator[str]:
    symbols, kinds = symbols_of(file.vocabulary), dict[str, str]()
    used = file.variables()
    # List one symbol of each kind; all joints share a kind such as dq.
    for index, entry in enumerate(entries_of(file.vocabulary.names)):
        kind = entry.symbol if entry.leg is None else entry.symbol.split(".")[0]
        if index in used and kind not in kinds:
            unit = f", {entry.unit}" if entry.unit else ""
            name = _escaped(entry.symbol)
            kinds[kind] = rf"${symbols[index]}$, in the file \texttt{{{name}}}: {entry.group}{unit}"
    yield _section("symbols")
    yield "A greater angle of a hip turns the leg to the left, of a thigh swings it back, of a calf"
    yield "stretches the knee."
    yield r"\begin{itemize}"
    yield from (rf"\item {line}" for line in kinds.values())
    yield r"\end{itemize}"


def _definitions(file: FormulaFile) -> Iterator[str]:
    symbols, n = symbols_of(file.vocabulary), len(file.vocabulary.names)
    if file.vocabulary.definitions:
        yield _section("definitions")
    for symbol, definition in zip(symbols[n:], file.vocabulary.definitions, strict=True):
        if definition.note:
            yield f"{_escaped(definition.note)}:"
        yield from _aligned(symbol, definition.formula, symbols)


def _targets(file: FormulaFile) -> Iterator[str]:
    symbols, written, state = symbols_of(file.vocabulary), file.written(), None
    mirror = None if file.mirror is None else FormulaMirror.of(file.vocabulary, file.mirror)
    yield _section("targets")
    for place in sorted(file.formulas):
        joint = _joint(quadruped.JOINTS[place[-1]])
        # Write a heading for each state, and name the formula that an image mirrors.
        if len(place) > 1 and place[0] != state:
            state = place[0]
            yield rf"\subsection*{{State {state}}}"
        if mirror is not None and place not in written:
            *states, image = mirror.place(place)
            in_state = f" in state {states[0]}" if states else ""
            yield f"The mirror image of {_escaped(quadruped.JOINTS[image])}{in_state}:"
        yield from _aligned(rf"q^{{*}}_{{\mathrm{{{joint}}}}}", file.formulas[place], symbols)


def _aligned(left: str, formula: Expression, symbols: Sequence[str]) -> Iterator[str]:
    pieces = _pieces(formula, symbols)
    starts = range(0, len(pieces), TERMS_OF_A_LINE)
    lines = ["".join(pieces[start : start + TERMS_OF_A_LINE]) for start in starts]
    yield r"\begin{align*}"
    yield rf"  {left} ={{}}&" + " \\\\\n  &".join(lines)
    yield r"\end{align*}"


def _pieces(formula: Expression, symbols: Sequence[str]) -> list[str]:
    """Splits a formula before the signs between its terms."""
    tokens, pieces = [*formula_tokens(formula, symbols, _NOTATION)], [""]
    # Write a dot between a factor and a number, and a thin space between others.
    for token, following in zip(tokens, [*tokens[1:], ""], strict=True):
        if token in SIGNS:
            pieces.append("")
        between = r" \cdot " if following[:1].isdigit() else r" \, "
        pieces[-1] += between if token == "*" else token.replace("**", "^")
    return pieces


def _number(value: float) -> str:
    mantissa, _, exponent = written_number(value).partition("e")
    return rf"{mantissa} \cdot 10^{{{int(exponent)}}}" if exponent else mantissa


_NOTATION = Notation(number=_number, function=r"\operatorname{{{}}}".format)


def _defined(symbol: str) -> str:
    kind, _, member = symbol.partition(".")
    if member in quadruped.LEGS and kind in _OF_LEGS:
        return rf"{_OF_LEGS[kind]}_{{\mathrm{{{member}}}}}"
    if member in quadruped.JOINTS and kind == "sent":
        return rf"\sigma_{{\mathrm{{{_joint(member)}}}}}"
    return _DEFINED.get(symbol) or rf"\mathrm{{{_escaped(symbol)}}}"


_DEFINED = {"late": r"\ell", "phase": r"\varphi", "e.v": "e_v"}
_OF_LEGS = {"lifted": "u", "x": "x", "z": "z"}


def _section(title: str) -> str:
    return rf"\section*{{{title.capitalize()}}}"


def _joint(name: str) -> str:
    return name.replace("_", r"\,")


def _escaped(text: str) -> str:
    return re.sub(r"[\\{}$&#^_%~]", lambda sign: _ESCAPES.get(sign[0], f"\\{sign[0]}"), text)


_ESCAPES = {"\\": r"\textbackslash{}", "^": r"\^{}", "~": r"\textasciitilde{}"}
