"""The future that was and the one of another observation, and what the leg does in them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from glassgait.diagrams.rollout import Rollout
from glassgait.models.arrays import Array
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.robot import Robot
from glassgait.models.task import CONTROL_PERIOD
from glassgait.models.task.palette import COLORS
from glassgait.studies.common.figures import COLUMN_WIDTH, styled, subplots

BEFORE, AFTER = 15, 75
"""Control steps that are shown before the moment and after it."""

SOON = 10
"""Control steps in which the joint is expected to follow its target; half a step of the gait."""

WAS, WOULD_BE = COLORS[0], COLORS[-1]
"""Blue and vermilion, which colour-blind readers distinguish too."""


@dataclass(frozen=True)
class Futures:
    """Two rollouts that are the same up to a moment.

    Attributes:
        would_be: The rollout whose policy was given another observation.
        step: Control step of the moment.
        joint: Index of the joint that was asked about.
    """

    was: Rollout
    would_be: Rollout
    step: int
    joint: int
    robot: Robot

    @property
    def leg(self) -> int:
        """Index of the joint's leg."""
        return self.joint // len(quadruped.LEG_JOINTS)

    def shown(self) -> tuple[Rollout, Rollout]:
        """Returns the part of both that is drawn and replayed."""
        return part_of(self.was, self.step), part_of(self.would_be, self.step)

    def outcome(self, by: float) -> dict[str, Any]:
        """Returns what came of it.

        Args:
            by: By how much the target was to change (rad).

        Returns:
            `target` and `joint`, the changes of target and joint angle where the joint goes
            farthest the way that was asked within `SOON` steps (rad); `after`, when that is (s);
            `forward` and `height`, the foot's changes then (m); whether the robot `fell`, and
            whether it `fell_before`, without another observation.
        """
        n = min(len(self.was.time), len(self.would_be.time), self.step + SOON + 1)
        joints = self._difference(lambda rollout: _angles(rollout)[:, self.joint])[:n]
        later = np.sign(by) * joints[self.step :]
        farthest = self.step + int(later.argmax())
        targets = self._difference(lambda rollout: _targets(self.robot, rollout)[:, self.joint])
        feet = self._difference(lambda rollout: foot_course(self.robot, rollout, self.leg))
        return {
            "target": float(targets[self.step]),
            "joint": float(joints[farthest]),
            "after": (farthest - self.step) * CONTROL_PERIOD,
            "forward": float(feet[farthest, 0]),
            "height": float(feet[farthest, 1]),
            "fell": self.would_be.failed,
            "fell_before": self.was.failed,
        }

    def _difference(self, course: Callable[[Rollout], Array]) -> Array:
        was, would_be = course(self.was), course(self.would_be)
        n = min(len(was), len(would_be))
        return would_be[:n] - was[:n]


def part_of(rollout: Rollout, step: int) -> Rollout:
    """Cuts out what is shown around a moment."""
    part = slice(max(step - BEFORE, 0), step + AFTER + 1)
    return Rollout(rollout.time[part], {name: own[part] for name, own in rollout.values.items()})


def foot_course(robot: Robot, rollout: Rollout, leg: int) -> Array:
    """Returns how far a foot is before the trunk's centre, and how high above ground (n, 2; m)."""
    forward = kinematics.foot_positions(robot, _angles(rollout))[:, leg, 0]
    return np.stack([forward, rollout["foot_height"][:, leg]], axis=1)


@styled
def course_figure(futures: Futures) -> Figure:
    """Draws the joint's target and angle, and its foot's height and way, in both futures."""
    figure, axes = subplots(3, 1, figsize=(2 * COLUMN_WIDTH, 5.2), sharex=True)
    parts = futures.shown()
    moment = futures.step * CONTROL_PERIOD
    drawn = zip(parts, (WAS, WOULD_BE), ("as it was", "with the other observation"), strict=True)
    for part, color, label in drawn:
        targets, angles = (
            _targets(futures.robot, part)[:, futures.joint],
            _angles(part)[:, futures.joint],
        )
        axes[0].step(part.time, targets, where="post", color=color, label=f"target, {label}")
        axes[0].plot(part.time, angles, color=color, linestyle=":", label=f"angle, {label}")
        feet = foot_course(futures.robot, part, futures.leg)
        axes[1].plot(part.time, 100 * feet[:, 1], color=color)
        axes[2].plot(part.time, 100 * feet[:, 0], color=color)
    for axis in axes:
        axis.axvline(moment, color="0.4", linewidth=0.8)
    name = quadruped.JOINTS[futures.joint].replace("_", " ")
    axes[0].set(ylabel=f"{name} (rad)")
    axes[1].set(ylabel="foot's height (cm)")
    axes[2].set(ylabel="foot, forward (cm)", xlabel="time (s)")
    axes[0].legend(ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    return figure


def _targets(robot: Robot, rollout: Rollout) -> Array:
    return robot.joint_targets(rollout["actions"])


def _angles(rollout: Rollout) -> Array:
    return rollout["state"][:, quadruped.JOINT_POSITION]
