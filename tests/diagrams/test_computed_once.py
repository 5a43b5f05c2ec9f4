"""What several ports and an update need is computed once a control step."""

import pytest

from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import set_plant_state
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.systems import command, foot_sensor, reward

N_STEPS = 30
FUNCTIONS = [
    (foot_sensor, "sense_feet"),
    (reward, "step_reward"),
    (RewardMachine, "step"),
    (command, "sample_commands"),
]
DRAWS = "sample_commands"


@pytest.fixture
def calls(monkeypatch):
    """Counts the calls of each function by name."""
    counts = {}

    def counted(name, function):
        def call(*arguments, **keywords):
            counts[name] += 1
            return function(*arguments, **keywords)

        return call

    for owner, name in FUNCTIONS:
        counts[name] = 0
        monkeypatch.setattr(owner, name, counted(name, getattr(owner, name)))
    return counts


@pytest.fixture
def simulator(trot, make_policy):
    scenario = Scenario(true_body_state=True)
    return make_simulator(MakeLocomotion(trot, scenario, policy=make_policy(trot)))


def test_once_a_control_step_even_where_every_port_is_recorded(calls, simulator):
    # The start is an instant as well, and the step that the last instant begins is not taken.
    record(simulator, N_STEPS, stop_on_failure=False)
    assert calls.pop(DRAWS) == 1  # A command holds for longer.
    assert set(calls.values()) == {N_STEPS + 1}


def test_once_a_control_step_where_nothing_is_recorded(calls, simulator):
    simulator.AdvanceTo(0.02 * N_STEPS)
    assert calls.pop(DRAWS) == 1
    assert set(calls.values()) == {N_STEPS}


def test_a_robot_that_is_placed_anew_is_sensed_anew(calls, simulator, standing):
    diagram, context = simulator.get_system(), simulator.get_mutable_context()
    height = diagram.GetOutputPort("foot_height")
    before = height.Eval(context).copy()
    standing[6] += 0.25
    set_plant_state(diagram, context, standing)
    assert height.Eval(context) == pytest.approx(before + 0.25, abs=1e-12)
    assert calls["sense_feet"] == 2
