"""The batch simulator's controllers and the exported C take the same control steps."""

import numpy as np
import pytest

from glassgait.diagrams.batch import BatchSimulator
from glassgait.diagrams.physics import make_physics
from glassgait.diagrams.scenario import load_scenario
from glassgait.diagrams.task import TaskConfig
from glassgait.models.control import Sensors
from glassgait.models.policies.library import load_student
from glassgait.models.robots.library import load_robot
from glassgait.models.task.command import Command

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
