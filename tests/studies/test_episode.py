"""The one loop over control steps: what observers see, what events do, and that it stays alone."""

import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from glassgait import studies
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.episode import Observer, episode, give, push

CALM = Scenario(sensor_noise=0.0, command=FixedCommand(0.5))


class Steps(Observer):
    """Keeps everything."""

    def __init__(self):
        self.steps = []

    def observe(self, step):
        self.steps.append(step)


def play(controller, scenario=CALM, *, n_robots=3, n_steps=6, **more):
    recorded = Steps()
    more["observers"] = [recorded, *more.get("observers", ())]
    gait = more.pop("gait", load_gait("trot"))
    more = {"seed": 1} | more
    ended = episode(gait, controller, scenario, n_robots=n_robots, n_steps=n_steps, **more)
    return recorded.steps, ended


def far(at, robots):
    """An event that throws robots beyond what is survived."""

    def throw(step, simulator):
        if step == at:
            plant = simulator.state.plant.copy()
            plant[robots, quadruped.QUATERNION] = 0.0, 1.0, 0.0, 0.0
            simulator.restore(simulator.state._replace(plant=plant))

    return throw


def test_observers_see_each_step_from_its_state_to_the_next(expert):
    steps, ended = play(expert)
    assert [step.step for step in steps] == list(range(6))
    for one, other in pairwise(steps):
        assert one.after is other.before
        np.testing.assert_array_equal(one.action, expert(one.observation))
    assert steps[-1].after is ended.state
    assert ended.fell.tolist() == [6, 6, 6]


def test_an_episode_goes_on_from_a_state_as_it_went(expert):
    steps, whole = play(expert)
    _, ended = play(expert, n_steps=2, start=steps[4].before)
    expected = whole.state.as_arrays()
    for name, values in ended.state.as_arrays().items():
        np.testing.assert_array_equal(values, expected[name], err_msg=name)


def test_robots_go_on_from_a_state_among_others(expert):
    """A network sums a row's products in an order that depends on the row's place."""
    whole, end = play(expert)
    start = whole[4].before.of_robots(np.array([2, 0]))
    steps, ended = play(expert, n_robots=2, n_steps=2, start=start)
    np.testing.assert_array_equal(steps[0].observation, whole[4].observation[[2, 0]])
    np.testing.assert_allclose(ended.state.plant, end.state.plant[[2, 0]], rtol=0, atol=1e-9)


def test_a_fallen_robot_rests_and_the_others_go_on(expert):
    steps, ended = play(expert, events=[far(2, [1])])
    assert ended.fell.tolist() == [6, 2, 6]
    assert steps[2].action[1].any() and not steps[3].action[1].any()
    assert steps[3].action[0].any()
    steps, _ = play(expert, events=[far(2, [1])], when_fallen="go on")
    assert steps[3].action[1].any()


def test_robots_that_fell_are_left_out_from_time_to_time(expert):
    steps, ended = play(expert, events=[far(0, [1])], leave_out_every=2)
    assert [step.robots.tolist() for step in steps] == [[0, 1, 2]] * 2 + [[0, 2]] * 4
    assert ended.fell.tolist() == [6, 0, 6] and len(ended.state.steps) == 2
    steps, ended = play(expert, events=[far(0, [0, 1, 2])], leave_out_every=2)
    assert len(steps) == 2 and ended.fell.tolist() == [0, 0, 0]


def test_an_episode_ends_with_an_observer_that_needs_no_more(expert):
    class Twice(Observer):
        def observe(self, step):
            self.done = step.step == 1

    assert len(play(expert, observers=[Twice()])[0]) == 2


def test_a_push_comes_before_its_step(expert):
    plain, _ = play(expert)
    pushed, _ = play(expert, events=[push(3, np.array([0.0, 0.4, 0.0]))])
    difference = pushed[3].before.plant - plain[3].before.plant
    assert difference[:, quadruped.LINEAR_VELOCITY][:, 1] == pytest.approx([0.4] * 3, abs=1e-12)
    np.testing.assert_array_equal(pushed[2].before.plant, plain[2].before.plant)


def test_a_command_holds_from_its_step_on(expert):
    steps, _ = play(expert, events=[give(2, FixedCommand(0.3, 0.3, 9))])
    assert [float(step.before.command.velocity[0, 1]) for step in steps] == [0, 0, *[0.3] * 4]


def test_no_other_module_of_studies_loops_over_control_steps():
    """Reinforcement learning's environment takes one step at a time, with what it explores."""
    files = Path(studies.__path__[0]).rglob("*.py")
    stepping = re.compile(r"simulator\.(step|observe)\(")
    found = {"/".join(path.parts[-2:]) for path in files if stepping.search(path.read_text())}
    assert found == {"common/episode.py", "training/environment.py"}
