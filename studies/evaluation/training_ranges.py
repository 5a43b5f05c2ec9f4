"""Which scenarios lie within the ranges that experts learn in."""

from collections.abc import Iterator
from dataclasses import fields

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.settings import Range
from glassgait.models.task.terrain import Terrain

RANDOMIZED = DomainRandomization()
"""The ranges that `glassgait train` draws from by default."""


def outside_training(scenario: Scenario, ranges: DomainRandomization = RANDOMIZED) -> list[str]:
    """Lists the settings of a scenario that no training draws; commands are not compared."""
    drawn = ranges.randomization
    within = {
        "latency": drawn.latency,
        "push_speed": (0.0, drawn.push_speed),
        "heading": (0.0, drawn.heading),
        "encoder_bias": (0.0, drawn.encoder_bias),
        "contact_flips": (0.0, drawn.contact_flips),
        "sensor_noise": (0.0, drawn.sensor_noise),
        "true_body_state": (0.0, 0.0),
    }
    names = [name for name, range_ in within.items() if not _lies(getattr(scenario, name), range_)]
    stuck = [*scenario.stuck_open, *scenario.stuck_closed]
    names += ["stuck sensors"] if len(stuck) > (drawn.stuck_share > 0.0) else []
    errors, drawn_errors = vars(scenario.imu), vars(drawn.imu)
    names += [f"imu.{key}" for key, error in errors.items() if error > drawn_errors[key]]
    return [*names, *_of_station(scenario, ranges), *_of_ground(scenario.station.terrain, ranges)]


def _of_station(scenario: Scenario, ranges: DomainRandomization) -> Iterator[str]:
    station, groups, base = scenario.station, ranges.groups, ranges.station
    stiffness, damping = base.gains(scenario.robot_of())
    within: dict[str, Range] = {
        "friction": ranges.randomization.friction,
        "payload": groups.payload,
        "motor_strength": groups.motor_strength,
        "armature": groups.armature,
        "relaxation_time": groups.relaxation_time,
        "stiffness": (stiffness * groups.gains[0], stiffness * groups.gains[1]),
        "damping": (damping * groups.gains[0], damping * groups.gains[1]),
        # A shorter step only solves the same physics more exactly.
        "time_step": (0.0, base.time_step),
    }
    for own in fields(StationConfig):
        value = getattr(station, own.name)
        if own.name in within:
            is_inside = value is None or _lies(value, within[own.name])
        elif own.name == "payload_position":
            is_inside = max(map(abs, value)) <= groups.payload_offset
        else:
            is_inside = own.name in ("terrain", "engine", "feet_only") or value == own.default
        if not is_inside:
            yield f"station.{own.name}"


def _of_ground(ground: Terrain, ranges: DomainRandomization) -> Iterator[str]:
    drawn = ranges.groups.terrains
    if ground.kind not in drawn.kinds:
        yield "terrain.kind"
    if abs(ground.slope) > drawn.slope:
        yield "terrain.slope"
    if ground.patches > drawn.patches:
        yield "terrain.patches"
    if ground.kind in ("blocks", "uneven") and ground.amplitude > drawn.amplitude:
        yield "terrain.amplitude"
    if ground.kind == "steps" and abs(ground.height) > drawn.height:
        yield "terrain.height"


def _lies(value: float, range_: Range) -> bool:
    return range_[0] - 1e-12 <= value <= range_[1] + 1e-12
