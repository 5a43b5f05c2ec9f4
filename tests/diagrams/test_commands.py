"""Commands: fixed, drawn, or from sliders, and which are refused."""

from dataclasses import replace

import numpy as np
import pytest
from gymnasium.spaces import Box
from pydrake.common import RandomGenerator
from pydrake.gym import DrakeGymEnv
from pydrake.systems.analysis import MonteCarloSimulation, Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem

from glassgait.diagrams.commands import DrawnCommands, FixedCommand, SliderCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import quadruped

CALM = Scenario(command=FixedCommand(), sensor_noise=0.0, true_body_state=True)
DRAWN = replace(CALM, command=DrawnCommands())


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"speed": 1.5}, "speed is 1.5; give -1 to 1, the range of gait 'trot'"),
        ({"yaw_rate": -2.0}, "yaw_rate is -2.0; give -1 to 1"),
        ({"dwell": 5}, "dwell is 5; give 6 to 11"),
        ({"dwell": 0}, "dwell is 0; it must be greater than or equal to 1"),
        ({"speed": float("nan")}, "speed is nan; it must be a finite number"),
        ({"dwell": 8.5}, "dwell is 8.5; it must be a valid integer"),
    ],
)
def test_commands_that_the_gait_is_not_made_for_are_refused(trot, values, message):
    with pytest.raises(InputError, match=f"command: {message}"):
        MakeLocomotion(trot, replace(CALM, command=FixedCommand(**values)))


def test_drawn_speeds_that_the_gait_is_not_made_for_are_refused(trot):
    scenario = replace(CALM, command=DrawnCommands((0.0, 1.5)))
    with pytest.raises(InputError, match="speed_range"):
        MakeLocomotion(trot, scenario)


def test_sliders_need_a_meshcat(trot):
    with pytest.raises(InputError, match="need a Meshcat"):
        MakeLocomotion(trot, replace(CALM, command=SliderCommand()))


def start_of(diagram, context):
    ports = ("command", "commanded_dwell", "state")
    return np.concatenate([diagram.GetOutputPort(port).Eval(context) for port in ports])


def test_monte_carlo_draws_command_and_pose_for_every_simulation(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))

    def drawn(seed):
        starts = []

        def output(system, context):
            starts.append(start_of(system, context))
            return 0.0

        MonteCarloSimulation(
            make_simulator=lambda generator: Simulator(diagram),
            output=output,
            final_time=0.0,
            num_samples=6,
            generator=RandomGenerator(seed),
        )
        return np.array(starts)

    first = drawn(1)
    np.testing.assert_array_equal(first, drawn(1))
    assert not np.array_equal(first, drawn(2))
    yaw_rate, first_joint, last_joint = 1, 3 + 7, 3 + 18
    for column in (yaw_rate, first_joint, last_joint):
        assert len(set(first[:, column])) == 6
    assert len(set(first[:, 2])) > 1


def test_drakes_gym_environment_draws_command_and_pose_for_every_seed(trot):
    diagram = MakeLocomotion(trot, DRAWN)
    env = DrakeGymEnv(
        simulator=Simulator(diagram),
        time_step=0.02,
        action_space=Box(-1.0, 1.0, (12,), np.float64),
        observation_space=Box(-np.inf, np.inf, (47 + trot.n_states,), np.float64),
        reward="reward",
        action_port_id="actions",
        observation_port_id="observations",
    )
    first, again, other = (env.reset(seed=seed)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    commands, joints = slice(0, 2), slice(2, 14)
    for part in (commands, joints):
        assert not np.any(first[part] == other[part])
    observation, *_ = env.step(np.zeros(12))
    np.testing.assert_array_equal(observation[commands], other[commands])


def test_commands_change_with_time_but_not_with_the_updates(trot, make_policy):
    diagram = MakeLocomotion(trot, DRAWN, policy=make_policy(trot))
    simulator = make_simulator(diagram, seed=3)
    commands = record(simulator, 510, stop_on_failure=False)["command"]
    assert len(np.unique(commands[:500], axis=0)) == 1
    assert len(np.unique(commands[500:], axis=0)) == 1
    assert np.all(commands[499] != commands[500])


class Planner(LeafSystem):
    """Asks for what depends on where the robot is, and in which half of its stride."""

    def __init__(self, n_states):
        super().__init__()
        self.state = self.DeclareVectorInputPort("state", 37)
        self.rm_state = self.DeclareVectorInputPort("rm_state", n_states)
        self.DeclareVectorOutputPort("command", 2, self.calc)

    def calc(self, context, output):
        far = self.state.Eval(context)[quadruped.POSITION][0] > 0.5
        turn = 0.1 * self.rm_state.Eval(context)[0]
        output.SetFromVector([-0.5 if far else 9.0, turn])


def test_a_planner_that_sees_the_robot_drives_it_to_and_fro(trot):
    builder = DiagramBuilder()
    loop = builder.AddSystem(MakeLocomotion(trot, Scenario(), policy=load_expert("trot")))
    planner = builder.AddSystem(Planner(trot.n_states))
    for name in ("state", "rm_state"):
        builder.Connect(loop.GetOutputPort(name), planner.GetInputPort(name))
    builder.Connect(planner.get_output_port(), loop.GetInputPort("command"))
    rollout = record(make_simulator(builder.Build(), seed=3), 150)
    assert not rollout.failed
    x = rollout["state"][:, quadruped.POSITION][:, 0]
    # The gait's greatest speed stands in for one that no gait is made for.
    np.testing.assert_array_equal(rollout["command"][:, 0], np.where(x > 0.5, -0.5, 1.0))
    np.testing.assert_array_equal(rollout["command"][:, 1], 0.1 * rollout["rm_state"][:, 0])
    assert 0.5 < x.max() < 0.9
    # The rhythm, which is not connected, is drawn as without a planner.
    drawn = record(make_simulator(MakeLocomotion(trot, policy=load_expert("trot")), seed=3), 0)
    assert set(rollout["commanded_dwell"][:, 0]) == set(drawn["commanded_dwell"][:, 0])
