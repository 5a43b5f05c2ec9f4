"""The robot is found, placed and pushed in every diagram that holds it."""

import numpy as np
import pytest
from pydrake.systems.framework import DiagramBuilder

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.plant_state import (
    find_locomotion,
    push,
    set_plant_state,
)
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import MakeStation
from glassgait.models.errors import InputError
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot

A1 = load_robot()


CALM = Scenario(command=FixedCommand(), sensor_noise=0.0, true_body_state=True)


def nested(diagram, depth=2):
    for level in range(depth):
        builder = DiagramBuilder()
        builder.AddNamedSystem(f"level {level}", diagram)
        diagram = builder.Build()
    return diagram


def test_the_robot_is_placed_and_pushed_in_any_context_that_holds_it(trot, make_policy, standing):
    diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
    whole = nested(diagram)
    assert find_locomotion(whole) is diagram
    root = whole.CreateDefaultContext()
    own = diagram.GetMyMutableContextFromRoot(root)
    for i, (part, context) in enumerate([(whole, root), (diagram, root), (diagram, own)]):
        standing[4] = i
        set_plant_state(part, context, standing)
        push(part, context, np.array([0.5, 0.0, i]))
        state = diagram.GetOutputPort("state").Eval(own)
        np.testing.assert_array_equal(state[: quadruped.LINEAR_VELOCITY.start], standing[:22])
        np.testing.assert_array_equal(state[quadruped.LINEAR_VELOCITY], [0.5, 0.0, i])


def test_contexts_of_other_diagrams_are_refused(trot, make_policy):
    diagram, other = (MakeLocomotion(trot, CALM, policy=make_policy(trot)) for _ in range(2))
    with pytest.raises(InputError, match="Locomotion"):
        set_plant_state(diagram, other.CreateDefaultContext())


@pytest.mark.parametrize("n_robots", [0, 2])
def test_diagrams_of_no_robot_or_of_two_are_refused(n_robots, trot, make_policy):
    builder = DiagramBuilder()
    builder.AddNamedSystem("station", MakeStation(A1))
    for i in range(n_robots):
        diagram = MakeLocomotion(trot, CALM, policy=make_policy(trot))
        builder.AddNamedSystem(f"robot {i}", diagram)
    with pytest.raises(InputError, match=f"holds {n_robots} of what MakeLocomotion builds"):
        find_locomotion(builder.Build())
