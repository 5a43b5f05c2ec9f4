"""The batch simulator's controllers and the exported C take the same control steps."""

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import load_scenario
from glassgait.diagrams.task import TaskConfig
from glassgait.models.control import ControlStep, Sensors
from glassgait.models.policies.library import load_student
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command
from glassgait.models.task.reward_machine import RewardMachine

N_ROBOTS, N_STEPS = 4, 60


@pytest.mark.parametrize("name", ["nominal", "slope_15", "rear_stuck_open"])
def test_c_acts_as_the_batch_on_what_every_robot_senses(name, trot, compiled_page):
    page, scenario = load_student("trot", "formulas"), load_scenario(name)
    simulator = BatchSimulator(
        TaskConfig.of_scenario(trot, scenario, page),
        make_physics(load_robot(), scenario.station_of(page)),
        n_robots=N_ROBOTS,
        generator=np.random.default_rng(2),
        estimator=page.estimator,
    )
    memories = [compiled_page.initial() for _ in range(N_ROBOTS)]
    for step in range(N_STEPS):
        before, observation = simulator.state, simulator.observe()
        simulator.step(page(observation))
        sensors, after = before.sensors(), simulator.state.memory
        for robot in range(N_ROBOTS):
            reading = Sensors(*(values[robot] for values in sensors))
            command = Command(*(values[robot] for values in before.command))
            stepped = compiled_page.step(memories[robot], reading, command)
            memories[robot] = stepped.memory
            for part, values in before.memory.machine._asdict().items():
                assert stepped.memory[part] == values[robot], f"{part} at step {step}"
            np.testing.assert_allclose(
                stepped.memory["action"],
                after.action[robot],
                rtol=0,
                atol=1e-12,
                err_msg=f"action at step {step}",
            )


@pytest.mark.parametrize("bad", [np.nan, -np.inf, 1e300])
@pytest.mark.parametrize("sensor", ["joint_position", "joint_velocity", "imu"])
def test_joints_keep_their_targets_while_a_sensor_reads_nonsense(trot, compiled_page, sensor, bad):
    page, robot = load_student("trot", "formulas"), load_robot()
    control = ControlStep(robot, RewardMachine(trot), page.joint_law, page.estimator, True)
    gravity = np.array([0, 0, 0, 0, 0, 0.2, 0, 0, -1.0])
    sound = Sensors(1.02 * robot.default_stance, np.zeros(12), np.ones(4, dtype=bool), gravity)
    command = Command(np.array([0.5, 0.1]), np.array(8.0))
    before, memory = control.step(None, sound, command, page)
    compiled = compiled_page.step(compiled_page.initial(), sound, command)
    np.testing.assert_allclose(compiled.targets, before, rtol=0, atol=1e-12)
    assert np.abs(before - robot.default_stance).max() > 0.01
    reading = getattr(sound, sensor).copy()
    reading[-2] = bad
    broken = sound._replace(**{sensor: reading})
    with np.errstate(all="ignore"):
        after, _ = control.step(memory, broken, command, page)
    np.testing.assert_array_equal(after, before)
    kept = compiled_page.step(compiled.memory, broken, command)
    np.testing.assert_array_equal(kept.targets, compiled.targets)
