"""The second simulator: the same robot, behind the same face."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.mujoco_physics import make_model
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import Scenario, load_scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.terrain import PLANE, Terrain

A1 = load_robot()

STATION = StationConfig(time_step=0.002, engine="mujoco")
DRAKE = StationConfig(time_step=0.002)


def standing(count, lift=0.0):
    states = kinematics.standing_state(A1, np.tile(A1.default_stance, (count, 1)))
    states[:, 6] += lift
    return states, np.tile(A1.default_stance, (count, 1))


def after(station, states, targets, n_steps=1):
    physics = make_physics(A1, station)
    for _ in range(n_steps):
        step = physics.step(states, targets)
        states = step.states
    return step


@pytest.mark.parametrize(
    "change",
    [
        {},
        {"payload": 2.0, "payload_position": (0.1, 0.02, 0.0)},
        {"motor_strength": 0.8},
        {"stiffness": 16.0, "damping": 0.4},
        {"stiffness": (20.0, 20.0, 40.0) * 4, "damping": (0.5, 0.4, 0.8) * 4},
        {"armature": 0.01},
        {"terrain": Terrain(slope=5.0, direction=130.0)},
    ],
)
def test_both_engines_move_a_flying_robot_alike(change, random_states, generator):
    states = random_states(5)
    states[:, 6] = 5.0
    states[:, quadruped.JOINT_POSITION] = A1.default_stance
    states[:, quadruped.N_POSITIONS :] = generator.normal(size=(5, 18))
    targets = A1.default_stance + 0.2 * generator.normal(size=(5, 12))
    # Both converge to the same motion, from steps that are far from exact.
    fine = {"time_step": 0.00025}
    fields = vars(STATION) | change | fine, vars(DRAKE) | change | fine
    ours, theirs = (
        after(StationConfig(**one), states, targets, n_steps=3).states for one in fields
    )
    still = np.abs(theirs - states).max()
    assert still > 0.1
    np.testing.assert_allclose(ours[:, :19], theirs[:, :19], atol=0.002)
    np.testing.assert_allclose(ours[:, 19:], theirs[:, 19:], atol=0.08)


def test_what_cannot_be_advanced_does_not_start_anew():
    states, targets = standing(2)
    states[1, 19:] = 1e200
    found = after(STATION, states, targets).states
    assert np.isfinite(found[0]).all()
    assert not np.isfinite(found[1]).all() or np.abs(found[1]).max() > 1e6


def test_targets_come_late():
    physics = make_physics(A1, STATION)
    states, targets = standing(3, lift=0.3)
    moved = targets + 0.3
    step = physics.step(
        states, moved, previous_targets=targets, latency=np.array([0.0, 0.01, 0.02])
    )
    knees = step.states[:, 9] - states[:, 9]
    assert knees[0] > 2 * knees[1] > 10 * abs(knees[2])


@pytest.mark.parametrize("strength", [1.0, 0.8])
def test_its_motors_give_no_more_than_their_effort(strength):
    model = make_model(A1, StationConfig(time_step=0.002, engine="mujoco", motor_strength=strength))
    data = mujoco.MjData(model)
    data.ctrl[:] = np.tile([30.0, -30.0], quadruped.N_JOINTS // 2)
    mujoco.mj_forward(model, data)
    torque = np.sign(data.ctrl) * strength * A1.effort[0]
    np.testing.assert_allclose(data.actuator_force, torque)
    np.testing.assert_allclose(np.sort(data.qfrc_actuator[6:]), np.sort(torque))


def test_an_expert_trots_there(trot):
    expert = load_expert("trot")
    task = TaskConfig.of_scenario(trot, load_scenario("mujoco"), expert)
    simulator = BatchSimulator(
        task,
        make_physics(A1, STATION),
        n_robots=4,
        generator=np.random.default_rng(0),
        estimator=expert.estimator,
    )
    fired = np.zeros(4)
    for _ in range(200):
        step = simulator.step(expert(simulator.observe()))
        assert not step.terminated.any()
        fired += step.fired
    assert fired.min() > 10


def test_a_diagram_is_drakes(trot):
    with pytest.raises(InputError, match="a diagram needs Drake"):
        MakeLocomotion(trot, Scenario(station=STATION))


def test_groups_of_two_engines_move_as_those_of_each(generator):
    quick = StationConfig(engine="mujoco", time_step=0.005)
    terrains = PLANE, Terrain(slope=9.0), Terrain(kind="blocks"), Terrain(kind="uneven")
    stations = [*(replace(quick, terrain=one, payload=1.0) for one in terrains), quick, STATION]
    stations.append(StationConfig(friction=0.6))
    states = NOMINAL.initial_states(A1, 16, generator)
    targets = A1.default_stance + 0.1 * generator.normal(size=(16, 12))
    mixed = make_physics(A1, *stations)
    parts = [make_physics(A1, station) for station in stations]
    for frictions in (None, np.linspace(0.3, 0.8, 7)):
        if frictions is not None:
            for physics, own in ((mixed, frictions), *zip(parts, frictions[:, None], strict=True)):
                physics.set_friction(own)
        moved = mixed.step(states, targets)
        alone = [
            part.step(states[index], targets[index])
            for part, index in zip(parts, mixed.members(16), strict=True)
        ]
        np.testing.assert_array_equal(moved.states, np.concatenate([own.states for own in alone]))
        np.testing.assert_array_equal(
            moved.touching, np.concatenate([own.touching for own in alone])
        )


@pytest.mark.parametrize("engine", ["drake", "mujoco"])
@pytest.mark.parametrize("terrain", [PLANE, Terrain(kind="blocks", amplitude=0.01)])
def test_bodies_sink_into_the_ground_where_feet_alone_collide(engine, terrain):
    state = kinematics.standing_state(A1)
    state[quadruped.QUATERNION] = 0.0, 1.0, 0.0, 0.0
    state[quadruped.POSITION] = 0.0, 0.0, 0.06
    for feet_only in (False, True):
        station = StationConfig(
            engine=engine, time_step=0.005, feet_only=feet_only, terrain=terrain
        )
        physics, lying = make_physics(A1, station), state[None]
        for _ in range(10):
            lying = physics.step(lying, A1.default_stance[None]).states
        on_boxes = engine == "drake" and not terrain.is_plane
        assert (lying[0, 6] < 0.0) == (feet_only or on_boxes)
