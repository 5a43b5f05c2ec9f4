"""Ports of every leaf system: their names and sizes, feedthrough, docstrings and clones."""

import importlib
import inspect
import pkgutil
import re
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

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
    PolicySystem,
    TargetLimitsSystem,
)
from glassgait.systems.base import FunctionSystem, MealySystem
from glassgait.systems.commands import GivenCommand, MeshcatCommand, RandomCommand
from glassgait.systems.estimation import OdometrySystem, StateEstimator
from glassgait.systems.gait_display import GaitDisplay
from glassgait.systems.observation import (
    ContactTrustSystem,
    Proprioception,
    RewardMachineSystem,
)
from glassgait.systems.reward import FallMonitor, RewardSystem
from glassgait.systems.sensors import (
    BodyStateSensor,
    ContactSensor,
    FootSensor,
    ImuSensor,
    JointSensor,
    SensorBias,
    WorldState,
)

A1, TROT = load_robot(), load_gait("trot")
LAYOUT = ObservationLayout(TROT.n_states)
POLICY = LinearPolicy("trot", LAYOUT.names, np.ones((12, 49)), np.zeros(12))
EXPERT, STUDENT = InputPortIndex(1), InputPortIndex(2)

ABSTRACT = 0
"""Drake's size of a port that holds no vector."""

COMMAND = {"command": 2, "commanded_dwell": 1}
FEET = {"foot_contact": 4, "foot_height": 4}
MACHINE = {"rm_state": 2, "rm_iterations": 1, "reward_multiplier": 1, "served_dwell": 1}


class Ports(NamedTuple):
    make: Callable[..., LeafSystem]
    """Makes the system; its arguments are fixtures."""
    inputs: Mapping[str, int]
    outputs: Mapping[str, int]
    feedthrough: set[tuple[str, str]] | None = None
    """Pairs of input and output port; None where they are all."""


PORTS: dict[Any, Ports] = {
    ActionHold: Ports(
        lambda: ActionHold(0.03, 0.01),
        {"asked_action": 12, "action": 12},
        {"held_action": 12, "previous_action": 12, "is_sound": 1, "delayed_action": 12},
        set(),
    ),
    AlternationSchedule: Ports(
        lambda: AlternationSchedule(2, EXPERT, STUDENT), {}, {"port_selector": ABSTRACT}
    ),
    BodyStateSensor: Ports(lambda: BodyStateSensor(A1), {"state": 37}, {"body_state": 7}),
    ContactSensor: Ports(
        lambda: ContactSensor(0.1), {"touching": 4, "uniform_noise": 4}, {"sensed_contact": 4}
    ),
    ContactTrustSystem: Ports(
        ContactTrustSystem,
        {"touching": 4, "foot_height": 4},
        {"believed_contact": 4, "believed_touching": 4},
    ),
    FallMonitor: Ports(
        lambda: FallMonitor(A1),
        {"state": 37, "action": 12, "previous_action": 12, "is_sound": 1},
        {"failures": 7},
    ),
    FootSensor: Ports(lambda: FootSensor(A1), {"state": 37}, {**FEET, "touching": 4}),
    GaitDisplay: Ports(
        lambda meshcat: GaitDisplay(A1, TROT, meshcat),
        {"state": 37, "rm_state": 2, "foot_contact": 4},
        {},
    ),
    GivenCommand: Ports(
        lambda: GivenCommand(TROT),
        {**COMMAND, "drawn_command": 2, "drawn_dwell": 1},
        COMMAND,
        # Apart: a planner may choose the speed by the machine's state, which depends on the dwell.
        {
            ("command", "command"),
            ("drawn_command", "command"),
            ("commanded_dwell", "commanded_dwell"),
            ("drawn_dwell", "commanded_dwell"),
        },
    ),
    ImuSensor: Ports(
        lambda: ImuSensor(np.array([0.0, 0.0, -9.81]), delay=2),
        {"state": 37, "uniform_noise": 9, "imu_bias": 9},
        {"imu": 9},
    ),
    JointSensor: Ports(
        lambda: JointSensor(0.5),
        {"state": 37, "uniform_noise": 24, "encoder_bias": 12},
        {"joints": 24},
    ),
    JointTargets: Ports(
        lambda: JointTargets(A1, quadruped.JOINTS), {"action": 12}, {"desired_state": 24}
    ),
    MeshcatCommand: Ports(lambda meshcat: MeshcatCommand(TROT, meshcat), {}, COMMAND),
    OdometrySystem: Ports(
        lambda: OdometrySystem(A1, Odometry()),
        {"joints": 24, "imu": 9, "touching": 4},
        {"body_state": 7, "previous_foot_height": 4, "expected_foot_height": 4},
        {
            *((source, "body_state") for source in ("joints", "imu", "touching")),
            ("joints", "expected_foot_height"),
        },
    ),
    PolicySystem: Ports(lambda: PolicySystem(POLICY), {"observation": 49}, {"action": 12}),
    Proprioception: Ports(
        lambda: Proprioception(A1, ObservationLayout(2, imu=True)),
        {
            "joints": 24,
            **COMMAND,
            "previous_action": 12,
            "rm_state": 2,
            "rm_iterations": 1,
            "imu": 9,
        },
        {"proprioception": 48},
    ),
    RandomCommand: Ports(lambda: RandomCommand(TROT), {"seed": 1}, COMMAND),
    RewardMachineSystem: Ports(
        lambda: RewardMachineSystem(TROT), {**FEET, "commanded_dwell": 1}, MACHINE
    ),
    RewardSystem: Ports(
        lambda: RewardSystem(A1),
        {
            "state": 37,
            "command": 2,
            "action": 12,
            "previous_action": 12,
            "foot_contact": 4,
            "foot_height": 4,
            "reward_multiplier": 1,
        },
        {"reward": 1, "plain_reward": 1, "reward_terms": 12},
    ),
    SensorBias: Ports(
        lambda: SensorBias(Randomization()), {"seed": 1}, {"encoder_bias": 12, "imu_bias": 9}
    ),
    StateEstimator: Ports(
        lambda: StateEstimator(lambda own: own[:7], 42),
        {"proprioception": 42},
        {"body_state": 7, "previous_foot_height": 4},
        {("proprioception", "body_state")},
    ),
    TargetLimitsSystem: Ports(
        lambda: TargetLimitsSystem(A1, TargetLimits(40.0)),
        {"action": 12, "previous_action": 12, "joints": 24, "imu": 9},
        {"limited_action": 12},
    ),
    WorldState: Ports(WorldState, {"plant_state": 37}, {"state": 37}),
}


@pytest.fixture(scope="module")
def meshcat():
    return open_meshcat()


@pytest.fixture(scope="module", params=PORTS, ids=lambda documented: documented.__name__)
def documented(request):
    """The class, or the function that makes a system of Drake's."""
    return request.param


@pytest.fixture(scope="module")
def system(documented, request):
    make = PORTS[documented].make
    return make(*map(request.getfixturevalue, inspect.signature(make).parameters))


def input_ports(system):
    return [system.get_input_port(index) for index in range(system.num_input_ports())]


def output_ports(system):
    return [system.get_output_port(index) for index in range(system.num_output_ports())]


def sizes(ports):
    """Names and sizes in the ports' order."""
    return [(port.get_name(), port.size()) for port in ports]


def test_names_sizes_and_feedthrough(system, documented):
    _, inputs, outputs, feedthrough = PORTS[documented]
    assert sizes(input_ports(system)) == list(inputs.items())
    assert sizes(output_ports(system)) == list(outputs.items())
    if feedthrough is None:
        feedthrough = {(source, target) for source in inputs for target in outputs}
    assert feedthrough == {
        (source.get_name(), target.get_name())
        for source in input_ports(system)
        for target in output_ports(system)
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
    assert found - {FunctionSystem, MealySystem} == set(PORTS)
