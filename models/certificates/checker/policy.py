"""Reads formula files: the header, definitions and formulas.

A formula is parsed as a Python expression with few kinds of nodes, and never run.
"""

import ast
import operator
import re
from collections.abc import Callable
from functools import reduce
from typing import Any

import yaml

from .files import RefusedError, refuse_unless

LEGS, PARTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
MIRRORED = {"FL": "FR", "FR": "FL", "RL": "RR", "RR": "RL"}
TURNED = ("cmd.yaw", "v.y", "g.y", "w.x", "w.z")
"""Quantities that change their sign in the mirror, besides hips."""

TITLE = re.compile(r"^(definitions|every state|state [0-9]{1,2}) *(?:#.*)?$", re.MULTILINE)
COMMENT = re.compile(r" *(#.*)?$", re.MULTILINE)
WORD = r"[A-Za-z_][A-Za-z0-9_]*"
NAME = rf"{WORD}(?:\.{WORD})?(?!\.)"
NUMBER = r"(?:(?:0|[1-9][0-9]*)(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?(?![A-Za-z0-9_.])"
STATEMENT = re.compile(rf"({NAME}) *=(?!=)(.*)")
FORMULA = re.compile(
    rf"(?> *(?:{NUMBER}|{NAME}|\*\* *[23](?![A-Za-z0-9_.])|\*(?!\*)|/(?!/)|[-+()]))*+ *"
)
FUNCTIONS = ("sin", "cos", "tanh")
SIGNS: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg}

Box = dict[str, tuple[float, float]]


def image_of(name: str, image: list[int]) -> tuple[str, int]:
    """Returns the mirror image of a quantity or joint, and -1 if its sign changes, else 1."""
    new = re.sub(r"(FL|FR|RL|RR)", lambda leg: MIRRORED[leg[1]], name)
    new = re.sub(r"^s(\d+)$", lambda state: f"s{image[int(state[1])]}", new)
    return new, -1 if name.endswith("_hip") or name in TURNED else 1


def evaluate(node: ast.expr, algebra: Any, value_of: Callable[[str], Any]) -> Any:
    """Evaluates a formula in an algebra, given the values of names."""
    match node:
        case ast.Constant(value=int(number) | float(number)) if type(number) is not bool:
            return algebra.number(float(number))
        case ast.Name() | ast.Attribute():
            return value_of(ast.unparse(node))
        case ast.UnaryOp(op=op, operand=inner) if type(op) in SIGNS:
            return SIGNS[type(op)](evaluate(inner, algebra, value_of))
        case ast.Call(func=ast.Name(id=function), args=[inner]) if function in FUNCTIONS:
            return algebra.function(function, evaluate(inner, algebra, value_of))
        case ast.BinOp(left=base, op=ast.Pow(), right=ast.Constant(value=int(power))):
            return reduce(algebra.product, [evaluate(base, algebra, value_of)] * power)
        case ast.BinOp(left=left, op=op, right=right):
            operations = {ast.Add: operator.add, ast.Sub: operator.sub}
            operations |= {ast.Mult: algebra.product, ast.Div: algebra.quotient}
            operands = (evaluate(operand, algebra, value_of) for operand in (left, right))
            return operations[type(op)](*operands)
    raise ValueError(f"{ast.unparse(node)[:60]!r} does not belong in a formula")


class FormulaFile:
    """The parts of a formula file that a proof needs; mirror images of formulas may be missing.

    The reader that robots use checks the rest of the header.
    """

    def __init__(self, text: str, quantities: list[str]) -> None:
        refuse_unless(not re.search(r"[^\n -~]", text), "the policy is not printable ASCII")
        header, *sections = TITLE.split(text)
        keys = yaml.safe_load(header)
        refuse_unless(keys["format"] == 2, "the policy has another format")
        self.names, self.mirror = quantities, keys.get("mirror")
        self.states = keys["machine"]["states"]
        self.readings = ranges_of(keys.get("readings") or {}, quantities)

        # Definitions apply in all states. An indented line continues the one above.
        self.formulas: dict[tuple[str, int], ast.expr] = {}
        for title, body in zip(sections[::2], sections[1::2], strict=True):
            lines = re.sub(r"\n+ ", " ", COMMENT.sub("", body)).split("\n")
            for line in filter(None, lines):
                match = STATEMENT.fullmatch(line)
                if match is None or FORMULA.fullmatch(match[2]) is None:
                    raise RefusedError(f"{line[:60]!r} holds what does not belong in a formula")
                formula = ast.parse(match[2].strip(), mode="eval").body
                for state in [int(title[6:])] if title[:6] == "state " else range(len(self.states)):
                    once = (match[1], state) not in self.formulas
                    refuse_unless(once, f"{match[1][:40]!r} has two formulas")
                    self.formulas[match[1], state] = formula

    def evaluate(self, algebra: Any, joint: str, state: int, mirrored: bool = False) -> Any:
        """Evaluates a target, given the quantities or their mirror images."""
        cache: dict[tuple[str, int, bool], Any] = {}

        def cached(name: str, state: int, mirrored: bool) -> Any:
            key = name, state, mirrored
            if key not in cache:
                refuse_unless(name not in JOINTS, f"{name} does not belong in a formula")
                cache[key] = value(*key)
            return cache[key]

        def value(name: str, state: int, mirrored: bool) -> Any:
            sign = 1
            if name in self.names:
                image, sign = image_of(name, self.mirror or []) if mirrored else (name, 1)
                result = algebra.quantity(image)
                return result if sign > 0 else -result
            if (name, state) not in self.formulas and self.mirror is not None:
                # A file may hold only one of two mirror images.
                image, sign = image_of(name, self.mirror)
                sign = sign if name in JOINTS else 1
                name, state, mirrored = image, self.mirror[state], not mirrored
            if (formula := self.formulas.get((name, state))) is None:
                raise RefusedError(f"{name[:40]!r} does not belong in a formula")
            result = evaluate(formula, algebra, lambda inner: cached(inner, state, mirrored))
            return result if sign > 0 else -result

        return value(joint, state, mirrored)

    def read(self, box: Box) -> Box:
        """Clips a box to the ranges in which the formulas read quantities."""
        clipped = {
            name: (min(max(box[name][0], low), high), min(max(box[name][1], low), high))
            for name, (low, high) in self.readings.items()
        }
        return box | clipped


def ranges_of(readings: dict[str, list[float]], names: list[str]) -> Box:
    """Returns the ranges in which quantities are read; `readings` gives them by kind."""
    ends: Box = {}
    for name in names:
        head, _, member = name.partition(".")
        kind = "h" if head == "h" else f"{head}.{member.rpartition('_')[2]}"
        if kind in readings:
            low, high = map(float, readings[kind])
            # Right hips have the opposite sign of left hips.
            ends[name] = (-high, -low) if re.search(r"\.[FR]R_hip$", name) else (low, high)
    return ends
