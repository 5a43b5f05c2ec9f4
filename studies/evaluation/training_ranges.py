"""Comparison of scenarios with the ranges that experts train in."""

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.diagrams.scenario import Scenario

RANDOMIZED = DomainRandomization()
"""The ranges that `glassgait train` draws from by default."""


def outside_training(scenario: Scenario, ranges: DomainRandomization = RANDOMIZED) -> list[str]:
    """Lists the settings of a scenario outside of the training ranges, commands excepted."""
    drawn, groups, ground = ranges.randomization, ranges.groups, ranges.groups.terrains
    station, terrain = scenario.station, scenario.station.terrain
    stiffness, damping = ranges.station.gains(scenario.robot_of())
    within = {
        "latency": (scenario.latency, *drawn.latency),
        "push_speed": (scenario.push_speed, 0.0, drawn.push_speed),
        "encoder_bias": (scenario.encoder_bias, 0.0, drawn.encoder_bias),
        "contact_flips": (scenario.contact_flips, 0.0, drawn.contact_flips),
        "sensor_noise": (scenario.sensor_noise, 0.0, drawn.sensor_noise),
        # In training at most one contact sensor is stuck.
        "stuck sensors": (len({*scenario.stuck_open, *scenario.stuck_closed}), 0, 1),
        "true_body_state": (scenario.true_body_state, False, False),
        "friction": (station.friction, *drawn.friction),
        "payload": (station.payload, *groups.payload),
        "payload_position": (max(map(abs, station.payload_position)), 0.0, groups.payload_offset),
        "motor_strength": (station.motor_strength, *groups.motor_strength),
        "armature": (station.armature, *groups.armature),
        "relaxation_time": (station.relaxation_time, *groups.relaxation_time),
        "stiffness": ((station.stiffness or stiffness) / stiffness, *groups.gains),
        "damping": ((station.damping or damping) / damping, *groups.gains),
        # A shorter step only solves the same physics more exactly.
        "time_step": (station.time_step, 0.0, ranges.station.time_step),
        "slope": (abs(terrain.slope), 0.0, ground.slope),
        "patches": (terrain.patches, 0.0, ground.patches),
        "amplitude": (terrain.amplitude * (terrain.kind != "plane"), 0.0, ground.amplitude),
        "height": (abs(terrain.height) * (terrain.kind == "steps"), 0.0, ground.height),
    }
    # Training does not vary these.
    same = ("contact_solver", "ground_stiffness", "dissipation", "contact_force", "contact_time")
    changed = [key for key in same if getattr(station, key) != getattr(ranges.station, key)]
    tiny = 1e-12
    beyond = (key for key, (at, low, high) in within.items() if not low - tiny <= at <= high + tiny)
    return [*beyond, *changed]
