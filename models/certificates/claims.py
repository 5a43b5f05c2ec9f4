"""Claims about what a policy never does, read from a YAML file."""

from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import Annotated, ClassVar, Literal

from annotated_types import MaxLen, MinLen

from glassgait.models.errors import InputError, shown
from glassgait.models.files import read_yaml
from glassgait.models.robots import quadruped
from glassgait.models.robots.robot import JointLaw, Robot
from glassgait.models.settings import DISTINCT, FEW, Positive, Settings, checked
from glassgait.models.task.gait import Gait
from glassgait.models.task.observation import ObservationLayout

DEFAULT_CLAIMS = Path(__file__).parent / "claims.yaml"

IMU_CLAIMS = DEFAULT_CLAIMS.with_name("claims_imu.yaml")
"""Further claims, about policies that observe an IMU."""

JOINT_SUFFIX = ".own"
"""Suffix of the quantities of the joint whose target is bounded, such as dq.own."""

Names = Annotated[tuple[str, ...], FEW, DISTINCT]

ClaimKind = Literal["limits", "never", "effect", "mirror", "change"]

_KEYS: dict[ClaimKind, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "limits": (("least", "most"), ("stuck",)),
    "never": (("observations", "never"), ("most", "limit", "stuck")),
    "effect": (("observations",), ("most", "limit", "stuck")),
    "mirror": ((), ()),
    "change": (("changes", "most"), ()),
}
"""Keys that a claim of each kind must have, and those that it may have."""


@checked
class Claim(Settings):
    """A statement about a policy's targets before limits, over all observations of a box.

    Attributes:
        kind: `limits`: targets stay from `least` to `most` rad.
            `never`: a target never rises (or falls) as an observation rises; with `most`, by at
            most `most` rad per unit. `effect`: one observation moves a target by at most `most`
            rad. `mirror`: left and right are treated alike. `change`: if observations change by
            `changes`, the squared change of the action is at most `most`.
        joints: The joints; all by default.
        states: Names of the machine's states; all by default.
        box: The `operating` box that robots were measured in, or the `physical` one.
        stuck: Observations, by symbol, that vary over the physical box instead.
        observations: The observations by symbol; `q.own`, `dq.own` and `a.own` are the joint's.
        limit: The robot's quantity that replaces the number `most`: the `torque` of its weakest
            motor or the `damping` of the servos, each divided by the servos' stiffness.
        changes: Greatest change of each observation, or of all of a kind such as `dq`, in the
            robot's units.
    """

    title: ClassVar[str] = "claim"

    name: Annotated[str, MinLen(1), MaxLen(200)]
    kind: ClaimKind
    joints: Names = ()
    states: Names = ()
    box: Literal["operating", "physical"] = "operating"
    stuck: Names = ()
    observations: Names = ()
    never: Literal["rises", "falls"] | None = None
    least: float | None = None
    most: float | None = None
    limit: Literal["torque", "damping"] | None = None
    changes: dict[str, Positive] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Each kind has required and optional keys, and no others.
        for joint in self.joints:
            quadruped.joint_index(joint)
        needed, allowed = _KEYS[self.kind]
        for key in ("stuck", "observations", "never", "least", "most", "limit", "changes"):
            given = getattr(self, key) not in ((), None, {})
            if key in needed and not given:
                raise InputError(f"a claim of kind {self.kind!r} needs the key {key!r}; add it")
            if given and key not in (*needed, *allowed):
                raise InputError(f"a claim of kind {self.kind!r} has no key {key!r}; remove it")

        # Numbers must agree.
        if self.kind == "effect" and self.most is None and self.limit is None:
            raise InputError("a claim of kind 'effect' needs the key 'most'; add it, or 'limit'")
        if self.limit is not None and self.most is not None:
            raise InputError("most and limit exclude each other; remove one of them")
        if self.kind != "limits" and self.most is not None and self.most < 0.0:
            raise InputError(f"most is {self.most:g}; give 0 or more")
        if self.least is not None and self.most is not None and self.least > self.most:
            raise InputError("least is above most; give the least, then the greatest")

    def refused_as(self) -> str:
        return f"claim {shown(self.name)}"

    def number(self, robot: Robot, law: JointLaw) -> float:
        """Returns the number that `most` or `limit` gives."""
        if self.limit is None:
            return self.most or 0.0
        stiffness, damping = law.worst_gains(robot)
        return (float(robot.effort.min()) if self.limit == "torque" else damping) / stiffness

    def joint_indices(self) -> tuple[int, ...]:
        return tuple(quadruped.joint_index(joint) for joint in self.joints or quadruped.JOINTS)

    def state_indices(self, gait: Gait) -> tuple[int, ...]:
        return tuple(gait.states.index(state) for state in self.states or gait.states)

    def observations_of(self, joint: int, symbols: Sequence[str]) -> tuple[int, ...]:
        """Returns the indices of the claim's observations, for a joint."""
        return tuple(symbols.index(_of_joint(name, joint)) for name in self.observations)

    def change_of(self, symbol: str) -> float:
        """Returns the greatest change of an observation, in the robot's units."""
        kind = symbol.partition(".")[0]
        return self.changes.get(symbol, 0.0 if kind == "cmd" else self.changes.get(kind, 0.0))

    def refuse_unknown(self, gait: Gait, *, imu: bool = False) -> None:
        """Refuses unknown states and observations."""
        # States must be those of the gait.
        if unknown := sorted({*self.states} - {*gait.states}):
            raise InputError(
                f"{self.refused_as()}: the {gait.name} has no state {shown(unknown[0])}; its "
                f"states are {', '.join(gait.states)}"
            )

        # Observations must be known, and must have slopes if the claim is about slopes.
        entries = ObservationLayout(gait.n_states, imu=imu).entries
        counted = {entry.symbol for entry in entries if "iterations" in entry.group}
        if self.kind == "never" and (sloped := sorted({*self.observations} & counted)):
            raise InputError(
                f"{self.refused_as()}: {sloped[0]} has no slope; use kind 'effect' instead"
            )
        symbols = {entry.symbol for entry in entries if entry.group != "machine state"}
        kinds = {symbol.partition(".")[0] for symbol in symbols} - {"cmd"}
        named = {_of_joint(name, 0) for name in self.observations} | {*self.stuck}
        if unknown := sorted((named - symbols) | ({*self.changes} - symbols - kinds)):
            raise InputError(
                f"{self.refused_as()}: no observation is called {shown(unknown[0])}; the names are "
                "those of formula files, such as q.FL_hip, or q.own"
            )


def claim_files(*, imu: bool) -> tuple[Path, ...]:
    """Returns the files of the shipped claims about policies with or without an IMU."""
    return (DEFAULT_CLAIMS, IMU_CLAIMS) if imu else (DEFAULT_CLAIMS,)


def load_claims(path: Path) -> tuple[Claim, ...]:
    """Loads the claims that a YAML file lists."""
    content = read_yaml(path)
    listed = content.get("claims") if isinstance(content, dict) else None
    if not isinstance(listed, list) or not listed or len(content) > 1:
        raise InputError(f"{path}: must hold the key 'claims' with a list of claims, and no other")
    claims = []
    for index, values in enumerate(listed):
        name = values.get("name") if isinstance(values, dict) else None
        where = f"{path}: claim {shown(name) if isinstance(name, str) else index + 1}"
        if isinstance(values, dict) and "name" not in values:
            raise InputError(f"{where}: needs the key 'name'; add it")
        claims.append(Claim.from_plain(values, where))
    names = [claim.name for claim in claims]
    if twice := [name for name in names if names.count(name) > 1]:
        raise InputError(f"{path}: two claims are called {shown(twice[0])}; rename one")
    return tuple(claims)


def _of_joint(symbol: str, joint: int) -> str:
    if not symbol.endswith(JOINT_SUFFIX):
        return symbol
    return f"{symbol.removesuffix(JOINT_SUFFIX)}.{quadruped.JOINTS[joint]}"
