"""The loop that a compiled controller closes in Drake."""

import copy
from dataclasses import replace

import numpy as np
import pytest

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.compiled_locomotion import MakeCompiledLocomotion
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.errors import InputError
from glassgait.models.export.controller import write_controller
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.task.gait import load_gait
from glassgait.models.task.imu import ImuErrors
from glassgait.models.task.odometry import Odometry
from glassgait.models.task.terrain import PLANE, Terrain
from glassgait.studies.export.files import has_compiler, load_controller

N_STEPS = 60

REQUESTED = (0, 2, 1)
"""Walk, bound and trot, by their numbers."""


@pytest.mark.parametrize("terrain", [PLANE, Terrain("blocks", amplitude=0.01, cells=2)])
def test_the_robot_moves_as_by_the_python_policy(trot, compiled_page, terrain):
    station, command = (
        StationConfig(terrain=terrain),
        FixedCommand(speed=0.5, yaw_rate=0.0, dwell=8),
    )
    scenario = Scenario(sensor_noise=0.0, station=station, command=command)
    policy = alone(load_student("trot", "sparse_formula"), load_expert("trot"))
    diagrams = [
        MakeLocomotion(trot, scenario, policy=policy),
        MakeCompiledLocomotion(trot, scenario, compiled_page),
    ]
    python, compiled = (record(make_simulator(one), N_STEPS) for one in diagrams)
    np.testing.assert_allclose(compiled["state"], python["state"], rtol=0, atol=1e-9)
    assert not compiled.failed
    assert len(compiled.time) == N_STEPS + 1
    # It walks: feet were lifted, and the trunk went on.
    assert compiled["foot_contact"][20:].min() == 0
    assert compiled["state"][-1, 4] > 0.05


def test_odometry_moves_the_robot_as_in_python(trot, tmp_path):
    if not has_compiler():
        pytest.skip("needs a C compiler, cc")
    own = copy.copy(load_student("trot", "sparse_formula"))
    own.observes_by, own._estimator = None, Odometry()
    written = write_controller(trot, alone(own), name="page", policy_name="page", version="0")
    compiled, scenario = load_controller(written, tmp_path), Scenario(sensor_noise=0.0)
    diagrams = [
        MakeLocomotion(trot, scenario, policy=alone(own)),
        MakeCompiledLocomotion(trot, scenario, compiled),
    ]
    python, by_c = (record(make_simulator(one), N_STEPS) for one in diagrams)
    np.testing.assert_allclose(by_c["state"], python["state"], rtol=0, atol=1e-9)
    assert by_c["foot_contact"][20:].min() == 0
    biased = replace(scenario, imu=ImuErrors(gyroscope_bias=0.1))
    with pytest.raises(InputError, match="imu"):
        MakeCompiledLocomotion(trot, biased, compiled)


@pytest.mark.parametrize(
    "noise", [{"sensor_noise": 1.0}, {"contact_flips": 0.01}, {"stuck_closed": ("RR",)}]
)
def test_noise_that_it_has_no_port_for_is_refused(noise, compiled_page):
    scenario = Scenario(**({"sensor_noise": 0.0} | noise))
    with pytest.raises(InputError, match="stuck_open"):
        MakeCompiledLocomotion(load_gait("trot"), scenario, compiled_page)


def test_gaits_change_as_by_the_python_policy(switched_pages, compiled_pages):
    scenario, switch = Scenario(sensor_noise=0.0), switched_pages.switch
    diagrams = [
        MakeLocomotion(switch, scenario, policy=alone(switched_pages)),
        MakeCompiledLocomotion(switch, scenario, compiled_pages),
    ]
    rolled = []
    for diagram in diagrams:
        simulator = make_simulator(diagram)
        port = diagram.GetInputPort("requested_gait")
        parts = []
        for number in REQUESTED:
            port.FixValue(simulator.get_mutable_context(), [number])
            parts.append(record(simulator, N_STEPS)["state"])
        rolled.append(np.concatenate(parts))
    python, compiled = rolled
    np.testing.assert_allclose(compiled, python, rtol=0, atol=1e-9)


def test_it_ran_all_gaits_that_were_requested(switched_pages, compiled_pages):
    switch = switched_pages.switch
    diagram = MakeCompiledLocomotion(switch, Scenario(sensor_noise=0.0), compiled_pages)
    simulator, ran = make_simulator(diagram), []
    acting = diagram.GetSubsystemByName("compiled_controller")
    for number in REQUESTED:
        context = simulator.get_mutable_context()
        diagram.GetInputPort("requested_gait").FixValue(context, [number])
        simulator.AdvanceTo(context.get_time() + 1.0)
        memory = acting.GetMyContextFromRoot(context).get_discrete_state(0).value()
        ran.append(switch.gaits[compiled_pages.gait_of(memory)].name)
    assert ran == ["walk", "bound", "trot"]
