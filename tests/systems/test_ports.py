"""Ports of every leaf system: feedthrough, and docstrings that list them."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import pytest
import yaml
from pydrake.systems.framework import InputPortIndex, LeafSystem

import glassgait.systems
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.robots.robot import TargetLimits
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout
from glassgait.models.task.randomization import Randomization
from glassgait.systems.action import (
    ActionHold,
    AlternationSchedule,
    JointTargets,
    PolicyMemory,
    PolicySystem,
    TargetLimitsSystem,
)
from glassgait.systems.base import FunctionSystem, MealySystem
from glassgait.systems.commands import GivenCommand, MeshcatCommand, RandomCommand
from glassgait.systems.estimation import OdometrySystem, StateEstimator
from glassgait.systems.gait_display import GaitDisplay
from glassgait.systems.observation import ContactTrustSystem, Proprioception, RewardMachineSystem
from glassgait.systems.reward import FallMonitor, RewardSystem
from glassgait.systems.sensors import (
    BodyStateSensor,
    ContactSensor,
    FootSensor,
    ImuSensor,
    JointSensor,
    ReadingCheck,
    SensorBias,
    WorldState,
)

A1, TROT = load_robot(), load_gait("trot")
LAYOUT = ObservationLayout(TROT.n_states)
POLICY = LinearPolicy("trot", LAYOUT.names, np.ones((12, 49)), np.zeros(12))
EXPERT, STUDENT = InputPortIndex(1), InputPortIndex(2)

SYSTEMS: dict[Any, Callable[..., LeafSystem]] = {
    ActionHold: lambda: ActionHold(0.03, 0.01),
    AlternationSchedule: lambda: AlternationSchedule(2, EXPERT, STUDENT),
    BodyStateSensor: lambda: BodyStateSensor(A1),
    ContactSensor: lambda: ContactSensor(0.1),
    ContactTrustSystem: ContactTrustSystem,
    FallMonitor: lambda: FallMonitor(A1),
    FootSensor: lambda: FootSensor(A1),
    GaitDisplay: lambda meshcat: GaitDisplay(A1, TROT, meshcat),
    GivenCommand: lambda: GivenCommand(TROT),
    ImuSensor: lambda: ImuSensor(np.array([0.0, 0.0, -9.81]), delay=2),
    JointSensor: lambda: JointSensor(0.5),
    JointTargets: lambda: JointTargets(A1, quadruped.JOINTS),
    MeshcatCommand: lambda meshcat: MeshcatCommand(TROT, meshcat),
    OdometrySystem: lambda: OdometrySystem(A1, Odometry()),
    PolicyMemory: lambda: PolicyMemory(POLICY),
    PolicySystem: lambda: PolicySystem(POLICY),
    Proprioception: lambda: Proprioception(A1, ObservationLayout(2, imu=True)),
    RandomCommand: lambda: RandomCommand(TROT),
    ReadingCheck: ReadingCheck,
    RewardMachineSystem: lambda: RewardMachineSystem(TROT),
    RewardSystem: lambda: RewardSystem(A1),
    SensorBias: lambda: SensorBias(Randomization()),
    StateEstimator: lambda: StateEstimator(lambda own: own[:7], 42),
    TargetLimitsSystem: lambda: TargetLimitsSystem(A1, TargetLimits(40.0)),
    WorldState: WorldState,
}
"""Functions that make each system; their arguments are fixtures."""

FEEDTHROUGH = {
    ActionHold: set(),
    # Apart: a planner may choose the speed by the machine's state, which depends on the dwell.
    GivenCommand: {
        ("command", "command"),
        ("drawn_command", "command"),
        ("commanded_dwell", "commanded_dwell"),
        ("drawn_dwell", "commanded_dwell"),
    },
    OdometrySystem: {
        *((source, "body_state") for source in ("joints", "imu", "touching")),
        ("joints", "expected_foot_height"),
    },
    StateEstimator: {("proprioception", "body_state")},
}
"""Pairs of input and output port, where they are not all."""


@pytest.fixture(scope="module")
def meshcat():
    return open_meshcat()


@pytest.fixture(scope="module", params=SYSTEMS, ids=lambda documented: documented.__name__)
def documented(request):
    """The class, or the function that makes a system of Drake's."""
    return request.param


@pytest.fixture(scope="module")
def system(documented, request):
    make = SYSTEMS[documented]
    return make(*map(request.getfixturevalue, inspect.signature(make).parameters))


def input_ports(system):
    return [system.get_input_port(index) for index in range(system.num_input_ports())]


def output_ports(system):
    return [system.get_output_port(index) for index in range(system.num_output_ports())]


def test_feedthrough(system, documented):
    pairs = list(product(input_ports(system), output_ports(system)))
    names = {(source.get_name(), target.get_name()) for source, target in pairs}
    assert FEEDTHROUGH.get(documented, names) == {
        (source.get_name(), target.get_name())
        for source, target in pairs
        if system.HasDirectFeedthrough(source.get_index(), target.get_index())
    }


def test_docstrings_list_the_ports(system, documented):
    block = re.search(r"\.\. pydrake_system::\n\n((?: {4}.*\n)+)", inspect.getdoc(documented) or "")
    assert block
    listed = yaml.safe_load(block[1])
    assert listed.pop("name") == type(system).__name__.removesuffix("_[float]")
    assert listed == {
        key: [port.get_name() for port in ports]
        for key, ports in (
            ("input_ports", input_ports(system)),
            ("output_ports", output_ports(system)),
        )
        if ports
    }


def test_every_system_is_in_the_table():
    found = set()
    for name in pkgutil.walk_packages(glassgait.systems.__path__, "glassgait.systems."):
        for value in vars(importlib.import_module(name.name)).values():
            defined_here = getattr(value, "__module__", None) == name.name
            is_system = isinstance(value, type) and issubclass(value, LeafSystem)
            makes_one = ".. pydrake_system::" in (inspect.getdoc(value) or "")
            if defined_here and (is_system or makes_one):
                found.add(value)
    # Their ports are their subclasses'.
    assert found - {FunctionSystem, MealySystem} == set(SYSTEMS)
