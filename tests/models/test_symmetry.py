"""Left-right symmetry of gaits, observations and actions."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glassgait.models.errors import InputError
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait, parse_formula
from glassgait.models.task.ground import body_state
from glassgait.models.task.observation import (
    MIRRORED_LEGS,
    REFLECT_JOINTS,
    ObservationLayout,
    proprioception,
    reflect_observation,
)
from glassgait.models.task.reward_machine import RewardMachine
from glassgait.models.task.symmetry import mirrored_states

A1 = load_robot()


EXPECTED = {
    "trot": (1, 0),
    "pace": (1, 0),
    "bound": (0, 1),
    "walk": (2, 3, 0, 1),
    "three_one": (2, 3, 0, 1),
    "half_bound": (2, 3, 0, 1, 5, 4),
}
MIRROR_LEGS = [quadruped.LEGS.index(MIRRORED_LEGS[leg]) for leg in quadruped.LEGS]


@pytest.mark.parametrize("name", EXPECTED)
def test_the_machines_that_ship_are_their_own_mirror_images(name):
    assert mirrored_states(load_gait(name)) == EXPECTED[name]


@pytest.mark.parametrize("change", ["dwell", "grace", "when"])
def test_a_machine_that_favours_a_side_has_no_mirror_image(change):
    gait = load_gait("walk")
    first, *others = gait.transitions
    changed = {
        "dwell": replace(first, dwell=0.5),
        "grace": replace(first, grace=3),
        "when": replace(first, when=parse_formula("FR & RL & ~FL")),
    }
    lopsided = replace(gait, transitions=(changed[change], *others))
    assert mirrored_states(lopsided) is None


def test_a_fault_is_its_own_mirror_image():
    gait = load_gait("trot")
    edges = (
        replace(gait.transitions[i], target="lost", when=parse_formula(feet))
        for i, feet in enumerate(("~FL & ~FR & ~RL & ~RR", "~FL & ~FR & ~RL & ~RR"))
    )
    fatal = replace(gait, states=("q0", "q1", "lost"), transitions=(*gait.transitions, *edges))
    assert mirrored_states(replace(fatal, faults=("lost",))) == (1, 0, 2)
    # If only one of two mirror images is a fault, it has no mirror image.
    assert mirrored_states(replace(gait, faults=("q1",))) is None


@given(
    steps=st.lists(st.tuples(st.integers(0, 15), st.floats(0.0, 0.1)), min_size=1, max_size=60),
    name=st.sampled_from(sorted(EXPECTED)),
)
def test_a_mirrored_robot_runs_through_the_mirrored_states(steps, name):
    gait = load_gait(name)
    image = np.array(mirrored_states(gait))
    machine = RewardMachine(gait)
    own = machine.initial()
    other = own._replace(state=image[own.state])
    for code, height in steps:
        contact = np.array([bool(code >> i & 1) for i in range(4)])
        heights = np.where(contact, 0.0, height)
        own = machine.step(
            own, foot_contact=contact, foot_height=heights, commanded_dwell=6
        ).machine
        other = machine.step(
            other,
            foot_contact=contact[MIRROR_LEGS],
            foot_height=heights[MIRROR_LEGS],
            commanded_dwell=6,
        ).machine
        assert other.state == image[own.state]
        assert other.iterations == own.iterations


def _mirrored_plant(state):
    """Mirrors plant states (n, 37) at the plane of x and z."""
    image = state.copy()
    image[:, quadruped.QUATERNION] *= [1, -1, 1, -1]
    image[:, quadruped.POSITION] *= [1, -1, 1]
    image[:, quadruped.ANGULAR_VELOCITY] *= [-1, 1, -1]
    image[:, quadruped.LINEAR_VELOCITY] *= [1, -1, 1]
    for joints in (quadruped.JOINT_POSITION, quadruped.JOINT_VELOCITY):
        image[:, joints] = REFLECT_JOINTS(state[:, joints])
    return image


def test_what_a_mirrored_robot_observes_is_the_mirrored_observation(random_states, generator):
    state = random_states(20)
    action, command = generator.normal(size=(20, 12)), generator.normal(size=(20, 2))
    states, n = EXPECTED["walk"], 4

    def observe(state, command, action, number):
        own = proprioception(
            A1,
            command=command,
            joint_position=state[:, quadruped.JOINT_POSITION],
            joint_velocity=state[:, quadruped.JOINT_VELOCITY],
            previous_action=action,
            rm_state=np.eye(n)[number],
            rm_iterations=np.arange(20.0),
            commanded_dwell=np.full(20, 7.0),
        )
        return np.concatenate([own, body_state(A1, state)], axis=1)

    numbers = generator.integers(n, size=20)
    seen = observe(state, command, action, numbers)
    seen_in_mirror = observe(
        _mirrored_plant(state), command * [1, -1], REFLECT_JOINTS(action), np.array(states)[numbers]
    )
    reflect = reflect_observation(ObservationLayout(n).names, states)
    np.testing.assert_allclose(reflect(seen), seen_in_mirror, atol=1e-12)
    np.testing.assert_array_equal(reflect(reflect(seen)), seen)


@pytest.mark.parametrize("states", [(0,), (1, 1), (1, 2), "10", (1.0, 0.0), 5])
def test_states_that_are_no_mirror_images_are_refused(neural, states):
    names = neural.observation_names
    with pytest.raises(InputError, match="mirrored_states"):
        NeuralPolicy("trot", names, neural.actor, neural.estimator, states)


def test_an_experts_mirror_image_acts_as_the_expert_does(small_expert, trot, generator):
    expert, plain = (small_expert(trot, mirrored=mirrored) for mirrored in (True, False))
    reflect = reflect_observation(expert.observation_names, (1, 0))
    observation = generator.normal(size=(30, len(expert.observation_names)))
    image = REFLECT_JOINTS(expert(reflect(observation)))
    np.testing.assert_allclose(image, expert(observation), atol=1e-12)
    assert np.abs(REFLECT_JOINTS(plain(reflect(observation))) - plain(observation)).max() > 0.1
