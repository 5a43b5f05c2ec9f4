"""Diagrams of the station and the locomotion loop, the batch simulator, and visualization."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from glassgait.diagrams.commands import DrawnCommands, FixedCommand  # noqa: F401
    from glassgait.diagrams.locomotion import MakeLocomotion  # noqa: F401
    from glassgait.diagrams.rollout import make_simulator, push, record  # noqa: F401
    from glassgait.diagrams.scenario import Scenario, load_scenario  # noqa: F401
    from glassgait.diagrams.station import StationConfig  # noqa: F401
    from glassgait.diagrams.visualization import open_meshcat, save_replay  # noqa: F401

_MODULES = {
    "commands": ("DrawnCommands", "FixedCommand"),
    "locomotion": ("MakeLocomotion",),
    "rollout": ("make_simulator", "push", "record"),
    "scenario": ("Scenario", "load_scenario"),
    "station": ("StationConfig",),
    "visualization": ("open_meshcat", "save_replay"),
}


def __getattr__(name: str) -> object:
    # Import lazily, so that each module can be used without the others.
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
