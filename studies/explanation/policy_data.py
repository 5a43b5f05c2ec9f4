"""Data of a policy for pages: its variables, and the active lines of its file."""

from typing import Any

import numpy as np

from glassgait.models.formulas.file import formula_lines
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.task.observation import entries_of, symbols_of


def variables_of(
    policy: Policy, observations: np.ndarray
) -> tuple[tuple[str, ...], tuple[str, ...], np.ndarray]:
    """Returns names (k), units (k) and values (n_steps, k) of the variables of a policy's terms."""
    names = policy.observation_names
    entries, symbols = entries_of(names), symbols_of(names)
    units = tuple(entry.unit for entry in entries)
    match policy:
        case FormulaPolicy(vocabulary=vocabulary):
            notes = (definition.note for definition in vocabulary.definitions)
            quantities = policy.quantities(observations)
            return vocabulary.symbols, (*units, *notes), quantities
        case AdditivePolicy():
            # Its terms are functions without weights, so that values may have any unit.
            quantities = RobotUnits.of(policy.robot, names).quantities(observations)
            return symbols, units, quantities
    return symbols, tuple(entry.scaled_unit(policy.robot) for entry in entries), observations


def file_lines(policy: FormulaPolicy, n_states: int) -> dict[str, Any]:
    """Returns a policy's file by lines, and the lines of each RM state and joint.

    `acting` (n_states, 12) has a formula's first line and the line after its last; `mirrored`
    (n_states, 12) has the lines of formulas that are mirror images of written ones, else None.
    """
    # Find the lines of each formula.
    file, lines = policy.to_file(), policy.to_text().splitlines()
    spans: dict[tuple[int, ...], tuple[int, int]] = {}
    start = 0
    for place in file.written():
        written = formula_lines(file, place)
        start = lines.index(written[0], start)
        spans[place] = (start, start + len(written))
        start += len(written)

    # Look up the active lines in each state.
    mirror = FormulaMirror.of(policy.vocabulary, policy.mirror) if policy.mirror else None
    acting, mirrored = [], []
    for state in range(n_states):
        places = [
            (joint,) if file.n_states is None else (state, joint)
            for joint in range(quadruped.N_JOINTS)
        ]
        mirrored.append([None if p in spans else formula_lines(file, p) for p in places])
        acting.append([spans[mirror.place(p) if mirror and p not in spans else p] for p in places])
    return {"lines": lines, "acting": acting, "mirrored": mirrored}
