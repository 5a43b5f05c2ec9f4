"""The closed loop as a diagram; `tests/agreement` compares it with the batch simulator."""

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario, load_scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import Controller, alone
from glassgait.models.policies.function import FunctionPolicy
from glassgait.models.policies.library import (
    STUDENT_DIRECTORY,
    load_expert,
    load_policy,
    load_student,
)
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import JointLaw
from glassgait.models.task.gait import load_gait
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.systems import commands, reward, sensors

A1 = load_robot()
CALM = Scenario(command=FixedCommand(), sensor_noise=0.0)
TRUE = replace(CALM, true_body_state=True)
"""For policies without an estimator."""


def first_observation(gait, scenario, seed=0, **controller):
    diagram = MakeLocomotion(gait, scenario, **controller)
    return record(make_simulator(diagram, seed=seed), 0)["observation"][0]


def test_an_action_acts_at_the_instant_it_is_computed(trot):
    # Were it a plant step late, the joints would follow their old targets for one step more.
    diagram = MakeLocomotion(trot, replace(CALM, station=StationConfig(time_step=0.02)))
    simulator = make_simulator(diagram)
    context = simulator.get_mutable_context()
    diagram.GetInputPort("action").FixValue(context, np.full(12, 2.0))
    before = diagram.GetOutputPort("state").Eval(context)[7:19]
    simulator.AdvanceTo(0.02)
    assert np.all(diagram.GetOutputPort("state").Eval(context)[7:19] - before > 0.02)


def test_a_function_observes_and_moves_as_an_expert_does(trot):
    expert = load_expert("trot")
    given, named = (
        record(make_simulator(MakeLocomotion(gait, scenario, policy=policy)), 20)
        for gait, scenario, policy in (
            (trot, load_scenario("slope_15"), expert),
            ("trot", "slope_15", expert.__call__),
        )
    )
    assert set(given) == set(named)
    for name, values in given.items():
        np.testing.assert_array_equal(values, named[name])


def test_a_system_outside_of_the_diagram_acts_as_a_function_does(trot):
    # A constant action is that of all robots.
    action = np.linspace(-5.0, 5.0, 12)
    inside = MakeLocomotion(trot, CALM, policy=lambda observation: action)
    outside = MakeLocomotion(trot, CALM)
    simulators = [make_simulator(diagram) for diagram in (inside, outside)]
    outside.GetInputPort("action").FixValue(simulators[1].get_mutable_context(), action)
    found, expected = (record(own, 10, stop_on_failure=False) for own in simulators)
    for name, values in expected.items():
        np.testing.assert_array_equal(values, found[name])


@pytest.mark.parametrize("period", [1, 3, 0])
def test_alternation_lets_the_right_policy_act(trot, make_policy, period):
    expert, student = make_policy(trot, seed=1), make_policy(trot, seed=2)
    diagram = MakeLocomotion(trot, TRUE, policy=Controller(expert, student, period))
    rollout = record(make_simulator(diagram), 12, stop_on_failure=False)
    for step in range(13):
        acts = expert if period and step % period == 0 else student
        expected = acts(rollout["observation"][step])
        np.testing.assert_allclose(rollout["action"][step], expected, atol=1e-12)


def test_joints_have_a_policys_gains_unless_the_scenario_names_some(trot, make_policy):
    firm = make_policy(trot).with_joint_law(JointLaw((31.0, 0.9)))
    for station, gains in (
        (StationConfig(), (31.0, 0.9)),
        (StationConfig(damping=0.4), (31.0, 0.4)),
        (StationConfig(stiffness=17.0, damping=0.4), (17.0, 0.4)),
    ):
        diagram = MakeLocomotion(trot, replace(TRUE, station=station), policy=firm)
        plant = diagram.GetSubsystemByName("plant")
        found = plant.get_joint_actuator(plant.GetJointActuatorIndices()[0]).get_controller_gains()
        assert (found.p, found.d) == gains


@pytest.mark.parametrize(("limit_targets", "limited"), [(None, True), (False, False)])
def test_targets_are_limited_as_the_policy_learned_unless_the_scenario_says_so(
    trot, limit_targets, limited
):
    # It kicks: every joint is at an end of its range.
    page = load_student("trot", "formulas")
    size = len(page.observation_names)
    wild = LinearPolicy("trot", page.observation_names, np.zeros((12, size)), np.full(12, 12.0))
    wild.joint_law = replace(page.joint_law, limits=None)
    diagram = MakeLocomotion(trot, replace(TRUE, limit_targets=limit_targets), policy=wild)
    system = diagram.GetSubsystemByName("joint_targets")
    context = system.CreateDefaultContext()
    system.get_input_port().FixValue(context, np.full(12, 12.0))
    followed = np.sort(system.get_output_port().Eval(context)[:12])
    asked = np.sort(A1.joint_targets(np.full(12, 12.0)))
    assert np.array_equal(followed, asked) is not limited


def test_noise_repeats_with_its_seed_and_has_a_factor(trot):
    found = {
        (factor, seed): first_observation(trot, replace(TRUE, sensor_noise=factor), seed)
        for factor in (0.0, 1.0, 2.5)
        for seed in (1, 2)
    }
    noise = found[1.0, 1] - found[0.0, 1]
    assert np.abs(noise).max() > 0.01
    np.testing.assert_allclose(found[2.5, 1] - found[0.0, 1], 2.5 * noise, atol=1e-12)
    again = first_observation(trot, replace(TRUE, sensor_noise=1.0), 1)
    np.testing.assert_array_equal(again, found[1.0, 1])
    assert not np.array_equal(found[1.0, 1], found[1.0, 2])


def test_an_imu_draws_no_other_noise_for_the_joints(trot, make_policy):
    noisy, joints = replace(TRUE, sensor_noise=1.0), slice(2, 26)
    plain = first_observation(trot, noisy, 4, policy=make_policy(trot))
    beside = first_observation(trot, noisy, 4)
    np.testing.assert_array_equal(plain[joints], beside[joints])


def test_policies_that_do_not_fit_are_refused(trot, make_policy, imu_expert):
    trees = load_policy(STUDENT_DIRECTORY / "trot" / "gbm.safetensors")
    for policy, message in (
        (make_policy(load_gait("pace")), "pace"),
        (trees, "load_student"),
        (Controller(imu_expert, make_policy(trot), 2), "Gravity X"),
        (load_expert("trot", robot=load_robot("go2")), "made for 'go2'"),
        ("expert", "policy is 'expert'"),
    ):
        with pytest.raises(InputError, match=message):
            MakeLocomotion(trot, replace(CALM, robot="a1"), policy=policy)
    for gait, scenario, message in (("tort", CALM, "tort"), (trot, "slope", "unknown scenario")):
        with pytest.raises(InputError, match=message):
            MakeLocomotion(gait, scenario)
    answers = np.zeros(11), None, 0.0, np.zeros(12, complex)
    for answer, message in zip(answers, (r"\(11,\)", "None", r"0\.0", "complex128"), strict=True):
        named = FunctionPolicy(lambda observation, own=answer: own, "trot")
        diagram = MakeLocomotion(trot, CALM, policy=named)
        with pytest.raises(InputError, match=message + r".* return an array of shape \(12,\)"):
            record(make_simulator(diagram), 1)


def test_the_true_body_state_is_observed_where_the_scenario_says_so(trot):
    expert = load_expert("trot")
    np.testing.assert_array_equal(first_observation(trot, TRUE, policy=expert)[-7:-4], np.zeros(3))
    diagram = MakeLocomotion(trot, CALM, policy=expert)
    rollout = record(make_simulator(diagram), 0)
    position = rollout["state"][0, quadruped.JOINT_POSITION]
    begun = expert.estimator.begin(A1, position)
    estimate = expert.estimator.body_state(A1, begun, position)
    np.testing.assert_array_equal(rollout["observation"][0, -7:], estimate)


def test_a_student_alone_acts_as_beside_its_expert(trot):
    page = load_student("trot", "formulas")
    single, both = (
        record(make_simulator(MakeLocomotion(trot, CALM, policy=policy)), 20)
        for policy in (page, alone(page, load_expert("trot")))
    )
    for name in single:
        np.testing.assert_array_equal(single[name], both[name])


def test_a_simulator_made_by_hand_starts_on_its_feet(trot):
    diagram = MakeLocomotion(trot, CALM, policy=load_expert("trot"))
    simulator = Simulator(diagram)
    context = simulator.get_context()
    before = diagram.GetOutputPort("state").Eval(context).copy()
    simulator.AdvanceTo(2.0)
    assert not diagram.GetOutputPort("failures").Eval(context).any()
    assert diagram.GetOutputPort("state").Eval(context)[4] - before[4] > 0.5


@pytest.mark.parametrize("recorded", [True, False])
def test_every_part_is_computed_once_a_control_step(trot, make_policy, monkeypatch, recorded):
    counts, n_steps = {}, 30

    def count(owner, name):
        function, counts[name] = getattr(owner, name), 0

        def call(*arguments, **keywords):
            counts[name] += 1
            return function(*arguments, **keywords)

        monkeypatch.setattr(owner, name, call)

    count(sensors, "sense_feet")
    count(reward, "step_reward")
    count(RewardMachine, "step")
    count(commands, "sample_commands")
    diagram = MakeLocomotion(trot, Scenario(true_body_state=True), policy=make_policy(trot))
    simulator = make_simulator(diagram)
    if recorded:
        # The start is an instant as well.
        record(simulator, n_steps, stop_on_failure=False)
    else:
        simulator.AdvanceTo(0.02 * n_steps)
    assert counts.pop("sample_commands") == 1  # A command holds for longer.
    assert set(counts.values()) == {n_steps + recorded}


@pytest.mark.parametrize(
    ("names", "most"), [("models", 2), ("models.policies.library", 16), ("diagrams.locomotion", 36)]
)
def test_imports_stay_few(names, most):
    code = f"import sys, glassgait.{names}; print(*sys.modules, sep='\\n')"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    modules = set(found.stdout.split())
    assert sum(name.partition(".")[0] == "glassgait" for name in modules) <= most
    assert not modules & {"torch", "pandas", "matplotlib", *["pydrake"] * (most < 36)}
