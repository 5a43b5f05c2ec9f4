"""The policies of several gaits as one, for a robot that changes its gait while it walks."""

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from glassgait.models.arrays import Array
from glassgait.models.errors import InputError
from glassgait.models.policies.controller import AlternatingController, Estimator
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.joint_law import JointLaw
from glassgait.models.task.gait_switch import GaitSwitch
from glassgait.models.task.observation import (
    N_ESTIMATED,
    ObservationLayout,
    indices_of,
    machine_state_entries,
)
from glassgait.models.task.odometry import Odometry

GREATEST_CHANGE = 50.0
"""Greatest squared change of the action in a control step; one of 60 ends an episode."""


class SwitchedPolicy(Policy):
    """Acts by the policy of the gait that runs, and observes by that gait's own estimator.

    Where a gait begins, its policy may ask for an action far from the last one of the gait before.
    The action then goes there as far as one step may go, and on in the next.

    It observes the state of a `GaitSwitch`, by which the gait is known; each gait's policy observes
    the states of its own gait alone, as it did when it learned. It is put together from policies
    that have files, and has none itself.

    Attributes:
        switch: The gaits.
        policies: The policy that acts in each.
        controllers: The controller of each gait, whose policy that is.
        greatest_change: Greatest squared change of the action in a control step.
        estimator: Maps proprioception (..., 40 + n_states) to the body state (..., 7).
    """

    kind = "switched"

    def __init__(
        self,
        switch: GaitSwitch,
        controllers: Sequence[AlternatingController],
        greatest_change: float = GREATEST_CHANGE,
    ) -> None:
        """
        Args:
            controllers: The controller of each, in their order: one policy alone.
            greatest_change: Greatest squared change of the action in a control step.

        Raises:
            InputError: if a controller is of another gait or of two policies, or has no estimator;
                or one is missing or left over.
        """
        layout = ObservationLayout(switch.n_states, imu=_observes_imu(controllers))
        robot = controllers[0].robot if controllers else None
        super().__init__(switch.gait.name, layout.names, robot=robot)
        if len(controllers) != len(switch.gaits):
            raise InputError(
                f"switched policy: {len(controllers)} policies cannot act in {len(switch.gaits)} "
                "gaits; give one for each"
            )
        self.switch, self.machine = switch, switch.gait
        self.policies = [_acting(controller) for controller in controllers]
        for gait, policy in zip(switch.gaits, self.policies, strict=True):
            names = ObservationLayout(gait.n_states, imu=layout.imu).names
            policy.check(robot=self.robot, gait=gait, observation_names=names)
        self.controllers = tuple(controllers)
        self.joint_law = _common_law(controllers)
        self._digests = [controller.expert.digest() for controller in controllers]
        self._digests += [policy.digest() for policy in self.policies]
        self._odometry = _common_odometry(controllers)
        estimators = [_estimator(controller) for controller in controllers]
        self._estimates = [own for own in estimators if not isinstance(own, Odometry)]
        self.greatest_change = greatest_change
        self._previous_action = list(indices_of("previous action", layout.names))
        self._states = machine_state_entries(layout.names)
        self._gait_of = switch.gait_of(np.arange(switch.n_states))
        self._columns = [_columns(layout, self._gait_of == i) for i in range(len(controllers))]

    def __call__(self, observation: Array) -> Array:
        action = self._by_gait(observation, self.policies, self._columns, quadruped.N_JOINTS)
        previous = observation[..., self._previous_action]
        change = action - previous
        length = np.sqrt(np.sum(np.square(change), axis=-1, keepdims=True))
        share = np.sqrt(self.greatest_change) / np.maximum(length, 1e-9)
        return np.where(share < 1.0, previous + share * change, action)

    @property
    def estimator(self) -> Estimator:
        """Odometry, or what maps proprioception (..., 40 + n_states) to the body state (..., 7)."""
        return self._odometry or self._estimate

    def _estimate(self, proprioception: Array) -> Array:
        sensed = [columns[:-N_ESTIMATED] for columns in self._columns]
        return self._by_gait(proprioception, self._estimates, sensed, N_ESTIMATED)

    def _by_gait(
        self,
        observed: Array,
        functions: Sequence[Callable[[Array], Array]],
        columns: Sequence[NDArray[np.intp]],
        size: int,
    ) -> Array:
        """Applies each gait's function to the rows (..., n) in which it runs."""
        rows = observed.reshape(-1, observed.shape[-1])
        running = self._gait_of[rows[:, self._states].argmax(axis=1)]
        result = np.empty((len(rows), size))
        for i, function in enumerate(functions):
            mine = running == i
            if mine.any():
                result[mine] = function(rows[np.ix_(mine, columns[i])])
        return result.reshape(*observed.shape[:-1], size)

    def to_arrays(self) -> NoReturn:
        """
        Raises:
            InputError: always; each gait's policy has a file of its own.
        """
        raise InputError("switched policy: has no file; save the policy of each gait")

    def digest(self) -> str:
        """Returns a digest that differs between policies that would not act alike."""
        own = [self.kind, self.gait, self.greatest_change, *self._digests]
        return hashlib.sha256(json.dumps(own).encode()).hexdigest()[:16]


def _acting(controller: AlternatingController) -> Policy:
    if len(controller.policies) > 1:
        raise InputError(
            "switched policy: expert and student by turns cannot act in a gait; give one of them"
        )
    return controller.policy


def _estimator(controller: AlternatingController) -> Estimator:
    if controller.estimator is None:
        raise InputError(
            f"switched policy: the {controller.expert.kind} expert of the "
            f"{controller.expert.gait} has no estimator; give one that has"
        )
    return controller.estimator


def _observes_imu(controllers: Sequence[AlternatingController]) -> bool:
    return any(controller.expert.layout.imu for controller in controllers)


def _common_odometry(controllers: Sequence[AlternatingController]) -> Odometry | None:
    """Returns the odometry that all observe by, or None if none does.

    Raises:
        InputError: if some do and others do not.
    """
    estimators = [_estimator(controller) for controller in controllers]
    found = [own for own in estimators if isinstance(own, Odometry)]
    if found and any(own != found[0] for own in estimators):
        raise InputError(
            "switched policy: some policies observe by odometry and others by another one, or by a "
            "network; give policies that were trained with the same senses"
        )
    return found[0] if found else None


def _common_law(controllers: Sequence[AlternatingController]) -> JointLaw:
    """Returns the law of the joints in every gait, which limits targets if that of each does.

    Limits that one gait's policy has hold in all.

    Raises:
        InputError: if gains differ, which cannot change while robots walk, or limits do.
    """
    laws, robot = [own.joint_law for own in controllers], controllers[0].robot
    if len({law.gains_of(robot) for law in laws}) > 1:
        raise InputError(
            "switched policy: the policies' joints have different gains; give policies that were "
            "trained with the same stiffness and damping"
        )
    limits = {law.limits for law in laws} - {None}
    if len(limits) > 1:
        raise InputError(
            "switched policy: the policies have different limits of their targets; give policies "
            "of the same"
        )
    limited = all(law.limited for law in laws)
    return replace(laws[0], limited=limited, limits=next(iter(limits), None))


def _columns(layout: ObservationLayout, mine: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Returns where the entries stand that a gait's own layout has."""
    kept = np.ones(layout.size, dtype=bool)
    kept[machine_state_entries(layout.names)] = mine
    return np.flatnonzero(kept)
