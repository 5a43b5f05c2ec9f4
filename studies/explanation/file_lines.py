"""Which lines of a formula file act."""

from typing import Any

from glassgait.models.formulas.file import formula_lines
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped


def file_lines(policy: FormulaPolicy, n_states: int) -> dict[str, Any]:
    """Returns a policy's file by lines, and those of each state and joint.

    Args:
        policy: The policy.
        n_states: Number of states of the gait's machine.

    Returns:
        `lines`; `acting` (n_states, 12), the first line of a formula and the one after its last;
        and `mirrored` (n_states, 12), the lines of the formula that acts where it is the mirror
        image of those of the file, or None where the file's own act.
    """
    file, lines = policy.to_file(), policy.to_text().splitlines()
    spans: dict[tuple[int, ...], tuple[int, int]] = {}
    start = 0
    for place in file.written():
        own = formula_lines(file, place)
        start = lines.index(own[0], start)
        spans[place] = (start, start + len(own))
        start += len(own)
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
