"""The ground in both engines and in the diagram: robots stand on it, and it repeats."""

from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.rollout import make_simulator, recenter, record, set_plant_state
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.diagrams.task import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.ground import Ground
from glassgait.models.task.randomization import NOMINAL
from glassgait.models.task.terrain import Terrain, grid_of

A1 = load_robot()
ROUGH = {
    "blocks": Terrain("blocks", amplitude=0.05),
    "uneven": Terrain("uneven", amplitude=0.05),
    "steps": Terrain("steps", height=0.05),
    "endless steps": Terrain("steps", height=0.05, endless=True),
    "patches": Terrain(patches=0.4, patch_friction=0.5),
}
ENGINES = {"drake": {}, "mujoco": {"engine": "mujoco", "time_step": 0.002}}
CALM = Scenario(sensor_noise=0.0, command=FixedCommand(speed=0.5))


def station(terrain, engine="drake"):
    return StationConfig(terrain=terrain, **ENGINES[engine])


def started(ground, count=6, seed=0):
    states = np.tile(kinematics.standing_state(A1), (count, 1))
    places = ground.draw_places(count, np.random.default_rng(seed))
    states[:, quadruped.POSITION][:, :2] = places
    return ground.stand(A1, states), np.tile(A1.default_stance, (count, 1))


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ROUGH)
def test_robots_stand_on_the_ground(name, engine):
    physics = make_physics(A1, station(ROUGH[name], engine))
    states, targets = started(physics.ground(6))
    for _ in range(40):
        step = physics.step(states, targets)
        states = step.states
    ground = physics.ground(6)
    feet = ground.clearance(kinematics.world_feet(A1, states), A1.foot_radius)
    assert feet.min() > -0.006
    assert np.all(ground.clearances(A1, states, 0.5).trunk > 0.2)
    assert np.all(step.touching.sum(axis=1) >= 3)
    # What a foot's force says is what its place says.
    assert np.mean(step.touching == (feet < 0.001)) > 0.9


@pytest.mark.parametrize("engine", ENGINES)
def test_no_foot_is_caught_between_two_boxes(engine):
    physics = make_physics(A1, station(Terrain(patches=0.5, patch_friction=1.0), engine))
    states, targets = started(physics.ground(60), count=60)
    states[:, quadruped.POSITION][:, 2] -= 0.026
    for _ in range(50):
        states = physics.step(states, targets).states
    assert physics.ground(60).foot_heights(A1, states).min() > -0.006


@pytest.mark.parametrize("engine", ENGINES)
def test_patches_alone_are_slippery(engine):
    everywhere, nowhere = (Terrain(patches=share, patch_friction=0.05) for share in (1.0, 0.01))
    slid = []
    for terrain in (everywhere, nowhere, Terrain()):
        physics = make_physics(A1, station(terrain, engine))
        physics.set_friction(np.array([0.8]))
        states, targets = started(Ground([Terrain()]))
        states[:, quadruped.LINEAR_VELOCITY] = [1.0, 0.0, 0.0]
        for _ in range(15):
            states = physics.step(states, targets).states
        slid.append(states[:, quadruped.POSITION][:, 0].mean())
    assert slid[0] > slid[1] + 0.05
    assert slid[1] == pytest.approx(slid[2], abs=0.02)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("name", ROUGH)
def test_robots_many_periods_away_move_alike(name, engine, generator):
    terrain = ROUGH[name]
    physics, grid = make_physics(A1, station(terrain, engine)), grid_of(terrain)
    near, targets = started(physics.ground(4), 4)
    away = np.append([3, -2] * grid.period, 3 * grid.rise)
    far = near.copy()
    far[:, quadruped.POSITION] += away
    for _ in range(10):
        asked = targets + 0.2 * generator.normal(size=targets.shape)
        steps = [physics.step(states, asked) for states in (near, far)]
        near, far = (step.states for step in steps)
        np.testing.assert_array_equal(steps[0].touching, steps[1].touching)
    moved = far.copy()
    moved[:, quadruped.POSITION] -= away
    np.testing.assert_allclose(moved, near, atol=1e-8)


def walked(gait, terrain, n_steps):
    scenario = replace(CALM, station=StationConfig(terrain=terrain))
    expert = load_expert("trot")
    (start,) = NOMINAL.initial_states(A1, 1, np.random.default_rng(3), Ground([terrain]))
    start[quadruped.POSITION][:2] = 0.0
    (start,) = Ground([terrain]).stand(A1, start[None])
    diagram = MakeLocomotion(gait, scenario, policy=expert)
    simulator = make_simulator(diagram, state=start)
    return diagram, simulator, record(simulator, n_steps)


def test_outputs_show_where_the_robot_has_gone_to(trot):
    terrain = Terrain("steps", height=0.01, endless=True, flight=1, landing=0.3)
    period = grid_of(terrain).period[0]
    diagram, simulator, rollout = walked(trot, terrain, 150)
    x, z = rollout["state"][:, quadruped.POSITION][:, [0, 2]].T
    assert not rollout.failed
    assert x[-1] > 2 * period
    assert np.abs(np.diff(x)).max() < 0.1
    # Every period is a step higher.
    risen = 0.01 * (x[-1] - x[50]) / period
    assert z[-1] - z[50] == pytest.approx(risen, abs=0.02)
    assert risen > 0.02
    plant = diagram.GetSubsystemByName("plant")
    context = simulator.get_mutable_context()
    recenter(diagram, context)
    own = plant.GetPositions(plant.GetMyContextFromRoot(context))[quadruped.POSITION]
    assert 0.0 <= own[0] - grid_of(terrain).origin[0] < period
    state = diagram.GetOutputPort("state").Eval(context)
    np.testing.assert_allclose(state, rollout["state"][-1], atol=1e-9)


def test_a_robot_is_put_anywhere_in_the_world(trot):
    terrain = ROUGH["blocks"]
    diagram = MakeLocomotion(trot, replace(CALM, station=StationConfig(terrain=terrain)))
    context = diagram.CreateDefaultContext()
    state = kinematics.standing_state(A1)
    state[quadruped.POSITION][:2] = [17.3, -40.1]
    state = Ground([terrain]).stand(A1, state)
    set_plant_state(diagram, context, state)
    np.testing.assert_allclose(diagram.GetOutputPort("state").Eval(context), state, atol=1e-12)
    feet = diagram.GetOutputPort("foot_height").Eval(context)
    np.testing.assert_allclose(feet, Ground([terrain]).foot_heights(A1, state), atol=1e-9)
    set_plant_state(diagram, context)
    found = diagram.GetOutputPort("state").Eval(context)
    assert not Ground([terrain]).touching(A1, found).any()


def test_ground_grows_under_robots_that_go_on(trot):
    flat, rough = (
        [StationConfig(terrain=own) for own in (Terrain(), terrain)]
        for terrain in (ROUGH["blocks"].scaled(0.0), ROUGH["blocks"])
    )
    simulator = BatchSimulator(
        TaskConfig(trot, NOMINAL),
        make_physics(A1, *flat),
        n_robots=6,
        generator=np.random.default_rng(0),
        estimator=None,
    )
    for _ in range(5):
        simulator.step(np.zeros((6, 12)))
    before = simulator.state.plant
    simulator.change_ground(make_physics(A1, *rough))
    after = simulator.state.plant
    np.testing.assert_array_equal(after[:3], before[:3])
    ground = simulator.physics.ground(6)
    feet = ground.clearance(kinematics.world_feet(A1, after), A1.foot_radius)
    assert (feet[3:] >= 0.0).all()
    np.testing.assert_array_equal(after[3:, :6], before[3:, :6])
    assert not simulator.step(np.zeros((6, 12))).terminated.any()


@pytest.mark.parametrize("engine", ENGINES)
def test_ground_too_high_for_the_robot_is_refused(engine):
    with pytest.raises(InputError, match="amplitude"):
        make_physics(A1, station(Terrain("blocks", amplitude=0.5), engine))


def test_the_force_of_a_contact_is_mujocos():
    with pytest.raises(InputError, match="contact_force"):
        StationConfig(contact_force=5.0)
    physics = make_physics(A1, replace(station(Terrain(), "mujoco"), contact_force=500.0))
    states, targets = started(Ground([Terrain()]))
    for _ in range(20):
        step = physics.step(states, targets)
        states = step.states
    assert not step.touching.any()
