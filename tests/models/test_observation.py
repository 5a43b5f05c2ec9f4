"""The observation: names, order, scales."""

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import body_state
from glassgait.models.task.observation import (
    ObservationLayout,
    entries_of,
    entry_of,
    indices_of,
    overdue,
    proprioception,
)

A1 = load_robot()
STILL = {
    "command": np.zeros(2),
    "joint_position": np.zeros(12),
    "joint_velocity": np.zeros(12),
    "previous_action": np.zeros(12),
    "rm_state": np.zeros(2),
    "rm_iterations": np.array(0.0),
    "commanded_dwell": np.array(8.0),
}


def test_the_time_in_a_state_is_held_two_control_steps_after_the_commanded_one():
    counts = zip((0, 8, 9, 11, 100), (7, 7, 7, 9, 9), strict=True)
    values = np.array(
        [
            proprioception(A1, **STILL | {"rm_iterations": spent, "commanded_dwell": commanded})
            for spent, commanded in counts
        ]
    )
    held = values[:, ObservationLayout(2).names.index("RM Iters")]
    np.testing.assert_allclose(held, [0.0, 0.8, 0.9, 1.1, 1.1])
    assert overdue(values, ObservationLayout(2).names).tolist() == [False, False, True, True, True]


def test_an_entry_divided_by_its_scale_is_the_quantity_in_its_unit(standing):
    generator = np.random.default_rng(0)
    layout = ObservationLayout(3)
    action, command = generator.normal(size=12), np.array([0.5, -0.25])
    state = standing.copy()
    state[quadruped.JOINT_POSITION] += 0.1 * generator.normal(size=12)
    state[quadruped.JOINT_VELOCITY] = generator.normal(size=12)
    state[quadruped.LINEAR_VELOCITY] = [0.5, 0.2, -0.1]
    observation = np.concatenate(
        [
            proprioception(
                A1,
                command=command,
                joint_position=state[quadruped.JOINT_POSITION],
                joint_velocity=state[quadruped.JOINT_VELOCITY],
                previous_action=action,
                rm_state=np.array([0.0, 1.0, 0.0]),
                rm_iterations=np.array(7),
                commanded_dwell=np.array(9),
            ),
            body_state(A1, state),
        ]
    )
    quantities = {
        "commanded velocity": command,
        "joint position": state[quadruped.JOINT_POSITION] - A1.default_stance,
        "joint velocity": state[quadruped.JOINT_VELOCITY],
        "previous action": A1.joint_targets(action) - A1.default_stance,
        "machine state": [0.0, 1.0, 0.0],
        "iterations": [7],
        "commanded iterations": [9],
        "base velocity": kinematics.base_velocity(state)[0],
        "foot height": kinematics.foot_heights(A1, state),
    }
    scales = np.array([entry.scale(A1) for entry in layout.entries])
    for group, expected in quantities.items():
        columns = list(indices_of(group, layout.names))
        np.testing.assert_allclose((observation / scales)[columns], expected, atol=1e-12)
    assert sum(len(indices_of(group, layout.names)) for group in quantities) == layout.size == 50
    assert layout.n_proprioceptive == 43


@pytest.mark.parametrize(
    ("name", "group", "leg", "symbol", "latex", "unit"),
    [
        ("Command X", "commanded velocity", None, "cmd.v", "v_x^{*}", "m/s"),
        ("DoF Pos FR Thigh", "joint position", "FR", "q.FR_thigh", r"q_{\mathrm{FR\,thigh}}",
         "rad from the default stance"),
        ("DoF Vel RR Calf", "joint velocity", "RR", "dq.RR_calf", r"\dot q_{\mathrm{RR\,calf}}",
         "0.05 · rad/s"),
        ("Prev Action FL Hip", "previous action", "FL", "a.FL_hip",
         r"a^{-}_{\mathrm{FL\,hip}}", "0.25 rad of joint target"),
        ("RM State 1", "machine state", None, "s1", "s_{1}", "0 or 1"),
        ("RM Iters", "iterations", None, "t", "n", "0.1 · control steps"),
        ("Base Lin Vel Z", "base velocity", None, "v.z", r"\hat v_{z}", "2 · m/s"),
        ("Foot Height RL", "foot height", "RL", "h.RL", r"\hat h_{\mathrm{RL}}", "m"),
    ],
)  # fmt: skip
def test_entries_describe_each_number(name, group, leg, symbol, latex, unit):
    entry = entry_of(name)
    assert (entry.name, entry.group, entry.leg) == (name, group, leg)
    assert (entry.symbol, entry.latex, entry.scaled_unit(A1)) == (symbol, latex, unit)


@pytest.mark.parametrize("name", ["DoF Pos", "DoF Pos FL Knee", "RM State", "RM State 32", "Speed"])
def test_names_of_no_entry_are_refused(name):
    with pytest.raises(InputError, match=f"no observation is called '{name}'; make the policy"):
        entries_of(("Command X", name))
