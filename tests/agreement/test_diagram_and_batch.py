"""The diagram and the batch simulator take the same control steps."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.rollout import make_simulator, push, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task import TaskConfig
from glassgait.models.estimation.sensors import IMU_NOISE, ImuErrors
from glassgait.models.policies.controller import Controller, estimator_in_loop
from glassgait.models.policies.described import load_described
from glassgait.models.policies.function import FunctionPolicy
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert, load_student
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.command import Command
from glassgait.models.task.gait import gait_names, load_gait, parse_gait
from glassgait.models.task.observation import JOINT_NOISE
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.reward import RewardWeights
from glassgait.models.task.terrain import Terrain

A1 = load_robot()
TOLERANCE = 1e-9
"""Tolerance for rounding differences between batch and diagram, which contacts amplify."""

COMMAND = FixedCommand(speed=0.4, yaw_rate=0.2, dwell=7)
PUSHED_AT, PUSH = 40, np.array([0.5, -0.4, 0.0])
QUIET = Scenario(command=COMMAND, sensor_noise=0.0)
TRUE = replace(QUIET, true_body_state=True)
BIASED = ImuErrors(gyroscope_bias=0.1, accelerometer_bias=0.5, attitude_bias=0.03, delay=2)
FINE = StationConfig(time_step=0.0025)
SIMILAR = StationConfig(
    time_step=0.001, contact_solver="similar", ground_stiffness=8000.0, dissipation=2.0
)
WEIGHTS = RewardWeights(tracking_time=0.3, high_swing=-2.0, tilt=-2.0, slip=-0.1)


def on(**station):
    return replace(QUIET, station=StationConfig(**station))


SCENARIOS = {
    "quiet": QUIET,
    "true body state": TRUE,
    "late": replace(QUIET, latency=0.01),
    "later": replace(QUIET, latency=0.0325, station=FINE),
    "a period late": replace(QUIET, latency=0.02),
    "latest": replace(QUIET, latency=0.04),
    "motors": on(motor_strength=0.8, stiffness=24.0, damping=0.6, armature=0.01),
    "payload": on(payload=2.0, payload_position=(0.05, 0.02, 0.0), friction=0.4),
    "soft ground": replace(QUIET, station=SIMILAR),
    "slope": on(terrain=Terrain(slope=6.0, direction=200.0)),
    "blocks": on(terrain=Terrain("blocks", amplitude=0.03, cells=2)),
    "steps": on(terrain=Terrain("steps", height=0.03, flight=1, landing=0.3)),
    "uneven": on(terrain=Terrain("uneven", cells=4, slope=4.0, direction=100.0)),
    "patches": on(terrain=Terrain(patches=0.5, patch_friction=0.3)),
    "limited targets": replace(QUIET, limit_targets=True, latency=0.01),
    "reward": replace(QUIET, weights=WEIGHTS),
    "noise": replace(QUIET, sensor_noise=1.0),
    "late readings": replace(QUIET, imu=ImuErrors(delay=3)),
    "stuck sensors": replace(QUIET, stuck_open=("RL",), stuck_closed=("FR",)),
    "wrong sensors": replace(QUIET, contact_flips=1.0),
    "all at once": replace(
        QUIET, sensor_noise=1.0, contact_flips=0.02, encoder_bias=0.02, imu=BIASED, latency=0.03
    ),
}
LOOPED = """
description: A machine with edges side by side and one that returns to its state.
max_speed: 1.0
max_yaw_rate: 1.0
dwell: [6, 11]
clearance: 0.03
states: [q0, q1]
initial: q0
transitions:
  - {from: q0, to: q1, when: FL & FR & RL & RR, dwell: 0.5}
  - {from: q0, to: q1, when: FL & RR & ~FR & ~RL}
  - {from: q1, to: q1, when: FL & FR & RL & RR, dwell: 0.3}
  - {from: q1, to: q0, when: ~FL | ~FR | ~RL | ~RR, dwell: 0}
"""


class Replayed:
    """Gives a batch of one robot the random numbers that its diagram has drawn."""

    def __init__(self, scenario, diagram, context):
        self._scenario, self._diagram, self._context = scenario, diagram, context
        self.push = np.zeros(3)

    def __getattr__(self, name):
        return getattr(self._scenario.randomization(), name)

    def _drawn(self, system, port):
        found = self._diagram.GetSubsystemByName(system)
        return found.GetOutputPort(port).Eval(found.GetMyContextFromRoot(self._context))

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
    """Makes a batch of one robot that uses the diagram's random numbers."""
    task = TaskConfig.of_scenario(gait, scenario, policy)
    simulator = BatchSimulator(
        SimpleNamespace(**(vars(task) | {"randomization": drawn})),
        make_physics(policy.robot, scenario.station_of(policy)),
        n_robots=1,
        generator=np.random.default_rng(0),
        estimator=estimator_in_loop(policy, true_body_state=scenario.true_body_state),
    )
    simulator.start_at(state[None], scenario.command.of_robots(1))
    return simulator


def assert_agreement(gait, policy, scenario=QUIET, *, n_steps=70, seed=3, pushed=True, spoiled=()):
    """Steps both, with a push and spoiled readings; returns how often the RM state changed."""
    ground = scenario.station.ground
    (state,) = NOMINAL.initial_states(policy.robot, 1, np.random.default_rng(seed), ground)
    diagram = MakeLocomotion(gait, scenario, policy=policy)
    running = make_simulator(diagram, state=state, seed=seed)
    context = running.get_mutable_context()
    drawn = Replayed(scenario, diagram, context)
    spoil(diagram, context, dict(spoiled).get(0))
    simulator = batch_beside(gait, policy, scenario, drawn, state)
    fired, controller = 0, policy if isinstance(policy, Controller) else Controller(policy)
    memory = controller.begin(1)
    for step in range(1, n_steps + 1):
        observation = simulator.observe()
        action, _, memory = controller.advance(step - 1, observation, memory)
        machine = simulator.state.memory.machine
        found = {
            "state": simulator.state.plant[0],
            "observation": observation[0],
            "rm_state": simulator.machine.one_hot(machine.state)[0],
            "action": simulator.limited(action)[0],
        }
        if diagram.HasOutputPort("imu"):
            found["imu"] = simulator.state.imu[0, -1]
        assert_same(found, diagram, context, step)
        running.AdvanceTo(step * CONTROL_PERIOD)
        spoil(diagram, context, dict(spoiled).get(step))
        drawn.push = PUSH * (pushed and step == PUSHED_AT)
        outcome = simulator.step(action)
        # Compare reward and failures before the push.
        found = {
            "reward": outcome.reward,
            "plain_reward": outcome.plain_reward,
            "reward_terms": outcome.terms[0],
            "served_dwell": outcome.served_dwell,
            "failures": outcome.failures[0],
        }
        assert_same(found, diagram, context, step)
        push(diagram, context, drawn.push)
        fired += int(outcome.fired[0])
    return fired


def spoil(diagram, context, value):
    if value is not None:
        source = diagram.GetSubsystemByName("sensor_noise").GetMyContextFromRoot(context)
        noise = source.get_discrete_state_vector().value().copy()
        noise[-4] = value
        source.SetDiscreteState(noise)


def assert_same(found, diagram, context, step):
    for port, values in found.items():
        np.testing.assert_allclose(
            values,
            diagram.GetOutputPort(port).Eval(context),
            rtol=0,
            atol=TOLERANCE,
            err_msg=f"{port} at step {step}",
        )


def slow_but(names, kept):
    """Marks all names slow except those kept, which cover similar cases."""
    return [pytest.param(name, marks=() if name in kept else pytest.mark.slow) for name in names]


EXPERTS = sorted(path.stem for path in EXPERT_DIRECTORY.glob("*.safetensors"))


@pytest.mark.parametrize("name", slow_but(gait_names(), ("walk",)))
def test_they_agree_on_every_gait(name, make_policy):
    gait = load_gait(name)
    assert_agreement(gait, make_policy(gait), TRUE)


def test_they_agree_on_edges_side_by_side_and_on_edges_to_the_same_state(make_policy):
    gait = parse_gait(LOOPED, name="looped")
    assert assert_agreement(gait, make_policy(gait), TRUE) > 10


@pytest.mark.parametrize("name", slow_but(EXPERTS, ("walk",)))
def test_they_agree_with_the_expert_while_its_gait_runs(name):
    assert assert_agreement(load_gait(name), load_expert(name)) > 5


FAST = ("true body state", "later", "payload", "slope", "uneven", "stuck sensors", "all at once")


@pytest.mark.parametrize("scenario", slow_but(SCENARIOS, FAST))
def test_they_agree_in_every_scenario(scenario, trot):
    # In the diagram, a push comes before the reward stores the speeds that it averages.
    pushed = scenario != "reward"
    fired = assert_agreement(trot, load_expert("trot"), SCENARIOS[scenario], pushed=pushed)
    assert fired > 2 or scenario == "wrong sensors"


@pytest.mark.parametrize("scenario", slow_but(("quiet", "slope", "all at once"), ("all at once",)))
def test_they_agree_where_the_imu_is_observed(scenario, trot, imu_expert):
    assert_agreement(trot, imu_expert, SCENARIOS[scenario])


def test_they_agree_on_another_robot(trot, make_policy):
    other = make_policy(trot)
    other.robot = load_robot("go2")
    assert_agreement(trot, other, TRUE)


def test_they_agree_with_a_learned_estimator(trot, learned_expert):
    assert_agreement(trot, learned_expert, SCENARIOS["noise"])


def test_they_agree_with_formulas(trot):
    assert assert_agreement(trot, load_student("trot", "formulas")) > 3


@pytest.mark.parametrize("scenario", ["quiet", "all at once"])
def test_they_agree_with_a_described_network_and_its_history(scenario, describe):
    scenario = replace(SCENARIOS[scenario], command=FixedCommand(0.4, 0.2))
    by_kind = describe(("stiffness: 30.0", "stiffness: {hip: 20, thigh: 20, calf: 40}"))
    assert_agreement(load_gait("free"), load_described(by_kind), scenario)


def test_a_described_network_remembers_what_its_student_acted_on(trot, describe):
    expert = load_described(describe(), trot)
    weights = np.full((12, len(expert.observation_names)), 0.01)
    student = LinearPolicy(
        "trot", expert.observation_names, weights, np.zeros(12), robot=expert.robot
    )
    student = student.with_joint_law(expert.joint_law)
    assert_agreement(trot, Controller(expert, student.with_estimator_of(expert), 3))


@pytest.mark.parametrize("bad", [np.nan, 1e300])
def test_a_described_network_begins_again_after_an_unsound_reading(describe, bad):
    spoiled, trot = dict.fromkeys((0, 30), bad), load_gait("trot")
    assert_agreement(trot, load_described(describe(), trot), SCENARIOS["noise"], spoiled=spoiled)


@pytest.mark.parametrize("limited", [True, False])
def test_they_agree_where_limits_hold_a_policy_back(trot, imu_expert, generator, limited):
    layout = imu_expert.layout
    weights = 0.6 * generator.normal(size=(12, layout.size))
    asking = LinearPolicy("trot", layout.names, weights, np.zeros(12))
    asking = asking.with_estimator_of(imu_expert)
    law = JointLaw().with_limits(A1) if limited else JointLaw((31.0, 0.9), limited=True)
    assert_agreement(trot, asking.with_joint_law(law), SCENARIOS["all at once"])


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300, 5e6])
@pytest.mark.parametrize("learned", [True, False])
def test_they_agree_where_a_reading_is_not_sound(trot, learned_expert, learned, bad):
    policy = learned_expert if learned else load_student("trot", "formulas")
    spoiled = dict.fromkeys((0, 1, 30), bad)
    assert assert_agreement(trot, policy, SCENARIOS["noise"], spoiled=spoiled) > 3 or learned


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300])
@pytest.mark.parametrize("limited", [True, False])
def test_they_agree_where_an_action_is_not_sound(trot, bad, limited):
    def sways(observation):
        observation[...] = bad
        # One action has an unsound entry.
        if (calls := next(count)) == 20:
            return np.where(np.arange(12) == 2, bad, 0.5)
        return np.full(12, 0.5 * np.sin(0.1 * calls))

    count = iter(np.repeat(np.arange(100), 2))  # batch and diagram call the policy in turn
    policy = FunctionPolicy(sways, trot)
    if not limited:
        policy = policy.with_joint_law(JointLaw())
    assert_agreement(trot, policy, n_steps=40, pushed=False)
    lost = MakeLocomotion(trot, QUIET, policy=lambda observation: np.full(12, bad))
    rollout = record(make_simulator(lost), 5)
    assert rollout.to_frame()[["failures_6", "action_2"]].to_numpy().tolist() == [[0, 0], [1, 0]]


def test_they_agree_where_a_command_changes(trot):
    expert = load_expert("trot")
    diagram = MakeLocomotion(trot, QUIET, policy=expert)
    running = make_simulator(diagram)
    context = running.get_mutable_context()
    drawn = Replayed(QUIET, diagram, context)
    state = diagram.GetOutputPort("state").Eval(context).copy()
    simulator = batch_beside(trot, expert, QUIET, drawn, state)
    for step in range(60):
        if step % 20 == 0:
            # In both, the machine uses the new dwell from the next instant on.
            velocity, dwell = np.array([0.1 * step / 20, 0.1]), 6.0 + step / 20
            diagram.GetInputPort("command").FixValue(context, velocity)
            diagram.GetInputPort("commanded_dwell").FixValue(context, [dwell])
            command = Command(velocity[None], np.array([dwell]))
            if step == 0:
                simulator.start_at(state[None], command)
            simulator.set_command(command)
        observation = simulator.observe()
        assert_same({"observation": observation[0]}, diagram, context, step)
        running.AdvanceTo((step + 1) * CONTROL_PERIOD)
        simulator.step(expert(observation))
