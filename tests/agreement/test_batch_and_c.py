"""The batch simulator's controllers and the exported C take the same control steps."""

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import load_scenario
from glassgait.diagrams.task import TaskConfig
from glassgait.models.arrays import map_arrays
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


@pytest.mark.parametrize("bad", [np.nan, -np.inf, 1e300, 5e6])
@pytest.mark.parametrize("sensor", ["joint_position", "joint_velocity", "imu"])
def test_a_robot_keeps_all_while_a_sensor_reads_nonsense(
    trot, compiled_page, generator, sensor, bad
):
    page, robot = load_student("trot", "formulas"), load_robot()
    control = ControlStep(robot, RewardMachine(trot), page.joint_law, page.estimator, True)
    command = Command(np.tile([0.5, 0.1], (3, 1)), np.full(3, 8.0))
    memory, before = control.initial((3,)), np.tile(robot.default_stance, (3, 1))
    alone, compiled = [None] * 3, [compiled_page.initial() for _ in range(3)]
    for step in range(8):
        # One robot reads nonsense at first, and two do later.
        broken = {0: [1], 1: [1], 4: [0, 1]}.get(step, [])
        position = robot.default_stance + generator.uniform(-0.05, 0.05, (3, 12))
        touching, velocity = generator.random((3, 4)) < 0.5, np.zeros((3, 12))
        imu = np.tile([0, 0, 0, 0, 0, 0.2, 0, 0, -1.0], (3, 1))
        sensors = Sensors(position, velocity, touching, imu)
        getattr(sensors, sensor)[broken, -4] = bad
        last, (targets, memory) = memory, control.step(memory, sensors, command, page)
        for k in range(3):
            read, told, mine, was = (
                map_arrays(lambda values, k=k: values[k], of_all)
                for of_all in (sensors, command, memory, last)
            )
            target, alone[k] = control.step(alone[k], read, told, page)
            in_c = compiled_page.step(compiled[k], read, told)
            if k in broken:
                assert in_c.memory == compiled[k]
                map_arrays(np.testing.assert_array_equal, mine, was)
                np.testing.assert_array_equal(targets[k], before[k])
            else:
                assert np.abs(targets[k] - before[k]).max() > 0.001
            # The batch, each robot alone and C agree.
            compiled[k] = in_c.memory
            map_arrays(near, mine, alone[k])
            near(targets[k], target)
            near(targets[k], in_c.targets)
            for name, value in (mine.trust._asdict() | mine.machine._asdict()).items():
                near(in_c.memory[name], value)
        before = targets


def near(ours, theirs):
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-12)
