"""An IMU and odometry in the closed loop: diagram and batch simulator agree, whatever is wrong."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.batch_physics import BatchPhysics
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.controller import Senses
from glassgait.diagrams.engines import make_physics
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import push
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task_config import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.estimation.imu import IMU_NOISE, ImuErrors
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.controller import AlternatingController
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.robots.library import load_robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.observation import JOINT_NOISE
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.terrain import Terrain

A1 = load_robot()
N_STEPS = 100
PUSHED_AT, PUSH = 50, np.array([0.5, -0.4, 0.0])
COMMAND = FixedCommand(speed=0.4, yaw_rate=0.2, dwell=8)
QUIET = Scenario(command=COMMAND, sensor_noise=0.0)
BIASED = ImuErrors(gyroscope_bias=0.1, accelerometer_bias=0.5, attitude_bias=0.03, delay=2)
WORLDS = {
    "quiet": QUIET,
    "slope": replace(QUIET, station=StationConfig(terrain=Terrain(slope=8.0))),
    "blocks": replace(QUIET, station=StationConfig(terrain=Terrain(kind="blocks", amplitude=0.03))),
    "noise": replace(QUIET, sensor_noise=1.0),
    "late readings": replace(QUIET, imu=ImuErrors(delay=3)),
    "stuck sensors": replace(QUIET, stuck_open=("RL",), stuck_closed=("FR",)),
    "30 ms late": replace(QUIET, latency=0.03),
    "40 ms late": replace(QUIET, latency=0.04),
    "32.5 ms late": replace(QUIET, latency=0.0325, station=StationConfig(time_step=0.0025)),
    "all at once": replace(
        QUIET, sensor_noise=1.0, contact_flips=0.02, encoder_bias=0.02, imu=BIASED, latency=0.03
    ),
}


class Replayed:
    """Draws for a batch of one robot what its diagram has drawn."""

    def __init__(self, scenario, diagram, context):
        self._scenario, self._diagram, self._context = scenario, diagram, context
        self.push = np.zeros(3)

    def __getattr__(self, name):
        return getattr(self._scenario.randomization(), name)

    def _drawn(self, system, port):
        own = self._diagram.GetSubsystemByName(system)
        return own.GetOutputPort(port).Eval(own.GetMyContextFromRoot(self._context))

    def _noise(self, system, half_width):
        factor = self._scenario.sensor_noise
        if factor == 0:
            return np.zeros((1, len(half_width)))
        return factor * half_width * (2.0 * self._drawn(system, "output")[None] - 1.0)

    def joint_noise(self, count, generator):
        return self._noise("sensor_noise", JOINT_NOISE)

    def imu_noise(self, count, generator):
        return self._noise("imu_noise", IMU_NOISE)

    def biases(self, count, generator):
        if not self._diagram.HasSubsystemNamed("sensor_bias"):
            return np.zeros((1, 21))
        drawn = [self._drawn("sensor_bias", name) for name in ("encoder_bias", "imu_bias")]
        return np.concatenate(drawn)[None]

    def wrong_contacts(self, count, generator):
        share = self._scenario.contact_flips
        if share == 0:
            return np.zeros((1, 4), dtype=bool)
        return self._drawn("contact_noise", "output")[None] < share

    def pushes(self, count, generator):
        return self.push[None]


def batch_beside(gait, policy, scenario, drawn, state):
    """Makes a batch of one robot that draws what the diagram draws."""
    task = TaskConfig.of_scenario(gait, scenario, policy)
    simulator = BatchSimulator(
        SimpleNamespace(**(vars(task) | {"randomization": drawn})),
        BatchPhysics(A1, scenario.station),
        n_robots=1,
        generator=np.random.default_rng(0),
        estimator=policy.estimator,
    )
    command = Command(np.array([[COMMAND.speed, COMMAND.yaw_rate]]), np.array([8.0]))
    simulator.start_at(state[None], command)
    return simulator


def assert_agreement(gait, policy, scenario, seed):
    """Steps both side by side, with a push.

    Returns:
        The estimates (n, 7), and which actions were limited (n, 12).
    """
    (state,) = NOMINAL.initial_states(A1, 1, np.random.default_rng(seed))
    diagram = MakeLocomotion(gait, scenario, policy=policy)
    running = make_simulator(diagram, state=state, seed=seed)
    context = running.get_mutable_context()
    drawn = Replayed(scenario, diagram, context)
    simulator = batch_beside(gait, policy, scenario, drawn, state)
    estimates, limited = [], []
    for step in range(1, N_STEPS + 1):
        observation = simulator.observe()
        for found, port in [
            (simulator.state.plant, "state"),
            (observation, "observations"),
            (simulator.state.imu[:, -1], "imu"),
            (simulator.machine.one_hot(simulator.state.machine.state), "rm_state"),
        ]:
            np.testing.assert_allclose(
                found[0],
                diagram.GetOutputPort(port).Eval(context),
                rtol=0,
                atol=1e-9,
                err_msg=f"{port} at step {step}",
            )
        estimates.append(observation[0, -7:])
        running.AdvanceTo(step * CONTROL_PERIOD)
        drawn.push = PUSH * (step == PUSHED_AT)
        push(diagram, context, drawn.push)
        asked = policy(observation)
        simulator.step(asked)
        limited.append(simulator.state.action[0] != asked[0])
    return np.array(estimates), np.array(limited)


# With other seeds the robot of stuck sensors stumbles, and what rounding leaves grows beyond 1e-9.
SEEDS = {"stuck sensors": (6, 7), "all at once": (1, 2, 3)}
ALIKE = ("blocks", "40 ms late")
"""Worlds that others hold the like of."""


@pytest.mark.parametrize(
    ("world", "seed"),
    [
        pytest.param(world, seed, marks=pytest.mark.slow if i or world in ALIKE else ())
        for world in WORLDS
        for i, seed in enumerate(SEEDS.get(world, (1,)))
    ],
)
def test_they_agree_with_odometry_in_the_loop(world, seed, trot, odometry_expert):
    estimates, _ = assert_agreement(trot, odometry_expert, WORLDS[world], seed)
    assert np.ptp(estimates[:, 0]) > 0.1 and estimates[:, 3:].max() > 0.02


@pytest.mark.parametrize(
    "world",
    [*(pytest.param(own, marks=pytest.mark.slow) for own in ("quiet", "slope")), "all at once"],
)
def test_they_agree_where_the_imu_is_observed(world, trot, imu_expert):
    assert_agreement(trot, imu_expert, WORLDS[world], seed=3)


@pytest.mark.parametrize("world", [pytest.param("quiet", marks=pytest.mark.slow), "all at once"])
def test_they_agree_where_limits_hold_a_policy_back(world, trot, imu_expert, generator):
    layout = imu_expert.layout
    weights = 0.6 * generator.normal(size=(12, layout.size))
    asking = LinearPolicy("trot", layout.names, weights, np.zeros(12))
    limited = asking.with_estimator_of(imu_expert).with_joint_law(JointLaw().with_limits(A1))
    _, limited = assert_agreement(trot, limited, WORLDS[world], seed=3)
    assert limited.any(axis=0).all() and not limited.all()


def test_biases_are_drawn_by_the_seed_and_hold(trot, odometry_expert):
    scenario = replace(QUIET, encoder_bias=0.02, imu=BIASED)
    diagram = MakeLocomotion(trot, scenario, policy=odometry_expert)
    draws = []
    for seed, seconds in ((1, 2.0), (1, 0.02), (2, 0.02)):
        running = make_simulator(diagram, seed=seed)
        drawn = Replayed(scenario, diagram, running.get_context())
        first = drawn.biases(1, None).copy()
        running.AdvanceTo(seconds)
        np.testing.assert_array_equal(drawn.biases(1, None), first)
        draws.append(first)
    np.testing.assert_array_equal(draws[0], draws[1])
    assert np.all(draws[0] != draws[2])


def test_an_imu_draws_no_other_noise_for_the_joints(trot, odometry_expert):
    noisy = replace(QUIET, sensor_noise=1.0, contact_flips=0.1)
    drawn = []
    for senses in (Senses(), Senses(observes_imu=True, estimator=Odometry())):
        diagram = MakeLocomotion(trot, noisy, senses=senses)
        replayed = Replayed(noisy, diagram, make_simulator(diagram, seed=4).get_context())
        drawn.append((replayed.joint_noise(1, None), replayed._drawn("contact_noise", "output")))
    for plain, beside in zip(*drawn, strict=True):
        np.testing.assert_array_equal(plain, beside)


def test_a_student_that_observes_no_imu_is_refused_beside_an_expert_that_does(
    trot, imu_expert, make_policy
):
    controller = AlternatingController(imu_expert, make_policy(trot), 2)
    with pytest.raises(InputError, match="Gravity X"):
        MakeLocomotion(trot, QUIET, policy=controller)


@pytest.mark.parametrize("engine", ["drake", "mujoco"])
def test_odometry_is_near_the_truth_in_either_engine(engine, trot, odometry_expert):
    station = StationConfig(time_step=0.002 if engine == "mujoco" else 0.01, engine=engine)
    scenario = replace(QUIET, sensor_noise=1.0, station=station)
    simulator = BatchSimulator(
        TaskConfig.of_scenario(trot, scenario, odometry_expert),
        make_physics(A1, station),
        n_robots=6,
        generator=np.random.default_rng(0),
        estimator=odometry_expert.estimator,
    )
    errors = []
    for _ in range(150):
        observation = simulator.observe()
        errors.append(observation[:, -7:] - simulator.body_state())
        assert not simulator.step(odometry_expert(observation)).terminated.any()
    rms = np.sqrt(np.mean(np.square(errors), axis=(0, 1)))
    # Velocities are scaled by 2.
    assert np.all(rms[:3] < 2 * 0.15) and np.all(rms[3:] < 0.012)
