"""Every robot that ships: it moves alike in both executions."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot, robot_names
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout


@pytest.mark.parametrize("name", robot_names())
def test_diagram_and_batch_agree_on_a_scripted_motion(name):
    robot, gait = load_robot(name), load_gait("trot")
    scenario = replace(
        Scenario(), robot=name, sensor_noise=0.0, command=FixedCommand(speed=0.4, dwell=8)
    )
    start = kinematics.standing_state(robot)
    diagram = MakeLocomotion(gait, scenario)
    simulator = make_simulator(diagram)
    context = simulator.get_mutable_context()
    batch = BatchSimulator(
        TaskConfig.of_scenario(gait, scenario),
        make_physics(robot, scenario.station),
        n_robots=1,
        generator=np.random.default_rng(0),
        estimator=None,
    )
    batch.start_at(start[None], Command(np.array([[0.4, 0.0]]), np.array([8.0])))
    ports = {port: diagram.GetOutputPort(port) for port in ("state", "observations", "reward")}
    shown = {port: [] for port in ports}
    mine = {port: [] for port in ports}
    for step in range(50):
        # Diagonal legs are lifted in turn, each by its thigh and calf.
        lift = 1.6 * np.sin(np.pi * (step % 16) / 16.0)
        legs = (0, 3) if step % 32 < 16 else (1, 2)
        action = np.zeros((quadruped.N_LEGS, 3))
        action[list(legs), 1:] = [lift, -1.5 * lift]
        diagram.GetInputPort("actions").FixValue(context, action.ravel())
        simulator.AdvanceTo((step + 1) * CONTROL_PERIOD)
        outcome = batch.step(action.ravel()[None])
        for port, own in ports.items():
            shown[port].append(own.Eval(context).copy())
        mine["state"].append(batch.state.plant[0])
        mine["observations"].append(batch.observe()[0])
        mine["reward"].append(outcome.reward)
    for port in ports:
        np.testing.assert_allclose(mine[port], shown[port], rtol=0, atol=1e-9)
    assert np.ptp(np.array(mine["state"])[:, quadruped.JOINT_POSITION], axis=0).max() > 0.2


def test_a_policy_moves_its_own_robot_and_no_other():
    gait, go2 = load_gait("trot"), load_robot("go2")
    names = ObservationLayout(gait.n_states).names
    weights = np.zeros((quadruped.N_JOINTS, len(names)))
    policy = LinearPolicy("trot", names, weights, np.zeros(quadruped.N_JOINTS), robot=go2)
    assert TaskConfig.of_scenario(gait, Scenario(), policy).robot is go2
    with pytest.raises(InputError, match=r"'a1'.* made for 'go2'"):
        TaskConfig.of_scenario(gait, Scenario(robot="a1"), policy)
    with pytest.raises(InputError, match="'b2'"):
        Scenario(robot="b2")
