"""Which lines of a formula file act."""

import pytest

from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.studies.explanation.policy_data import file_lines

MIRRORED = "format: 1\ngait: trot\nstates: 2\nmirror: 1 0\n\nstate 0\n" + "".join(
    f"{joint} = 0.{place + 1}*q.{joint}\n" for place, joint in enumerate(quadruped.JOINTS)
)


@pytest.mark.parametrize("kind", ["symbolic", "statewise_symbolic"])
def test_every_joint_has_its_lines_in_every_state(kind):
    policy = load_student("trot", kind)
    assert isinstance(policy, FormulaPolicy)
    file = file_lines(policy, 2)
    assert file["lines"] == policy.to_text().splitlines()
    for state in range(2):
        for joint, (first, end) in zip(quadruped.JOINTS, file["acting"][state], strict=True):
            own = file["lines"][first:end]
            assert own[0].startswith(f"{joint} = ")
            assert all(line.startswith("    ") for line in own[1:])
            assert not file["lines"][end : end + 1] or not file["lines"][end].startswith(" ")
    assert not any(map(any, file["mirrored"]))
    assert (file["acting"][0] == file["acting"][1]) == (kind == "symbolic")


def test_a_mirror_images_lines_are_those_of_the_other_side():
    file = file_lines(FormulaPolicy.from_file(read_formulas(MIRRORED)), 2)
    stored, mirrored = file["mirrored"]
    assert stored == [None] * 12
    assert all(
        lines[0].startswith(f"{j} = ") for j, lines in zip(quadruped.JOINTS, mirrored, strict=True)
    )
    left, right = quadruped.JOINTS.index("FL_calf"), quadruped.JOINTS.index("FR_calf")
    assert file["acting"][1][right] == file["acting"][0][left]
    first, _ = file["acting"][1][right]
    assert file["lines"][first].startswith("FL_calf = ")
