"""Robots, the task, estimation and policies, without Drake, loops over time or printing."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from glassgait.models.policies.controller import Controller  # noqa: F401
    from glassgait.models.policies.function import FunctionPolicy  # noqa: F401
    from glassgait.models.policies.library import load_expert, load_policy, load_student  # noqa: F401
    from glassgait.models.robots.library import load_robot  # noqa: F401
    from glassgait.models.task.gait import load_gait  # noqa: F401

CONTROL_PERIOD = 0.02  # time between two actions (s)
BASE_VELOCITY_SCALE = 2.0  # factor on the trunk's velocity as policies observe it
GRAVITY = 9.81  # acceleration by gravity (m/s²)

_MODULES = {
    "policies.controller": ("Controller",),
    "policies.function": ("FunctionPolicy",),
    "policies.library": ("load_expert", "load_policy", "load_student"),
    "robots.library": ("load_robot",),
    "task.gait": ("load_gait",),
}


def __getattr__(name: str) -> object:
    # Imported lazily, so that each subpackage can be used without the others.
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
