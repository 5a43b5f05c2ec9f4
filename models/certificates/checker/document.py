"""The document: the certificate, and the files of gait, policy and robot that it is of.

Each key of a claim is refused where it is of no use, misspelt or of another kind.
"""

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from .formulas import Formulas
from .gait import MOST_STATES, Gait, is_involution
from .limits import KEEPS, Limits
from .robot import (
    COUNTED,
    DEFAULT_ROBOT,
    JOINTS,
    Box,
    RefusedError,
    Robot,
    is_number,
    is_robot_name,
    read_bytes,
    read_json,
    read_yaml,
    refuse_unless,
    symbols,
)
from .text import FormulaText

MODELS = Path(__file__).parents[2]

SLACK = 1e-9
"""By how much (rad) a witness may reach less than is said."""

TOP = ("format", "gait", "states", "mirror", "policy", "boxes", "claims", "statements", "sha256")

OUTCOMES = ("proved", "refuted", "undecided")
BOXES = ("operating", "physical")
WRITTEN = ("name", "kind", "outcome", "worst", "claimed", "where", "witnesses")
"""What every claim says."""

SCOPE = ("joints", "states", "box")
"""What any claim may say."""

KINDS = {
    "kept": (("keeps",), ("most",)),
    "limits": ((), ("least", "most", "stuck")),
    "torque": ((), ("most", "stuck")),
    "never": (("observations", "never"), ("most", "stuck")),
    "effect": (("observations", "most"), ("stuck",)),
    "independent": (("observations",), ()),
    "mirror": ((), ()),
    "change": (("changes",), ("most",)),
}
"""What claims of each kind must say, and what they may say."""


class Policy(NamedTuple):
    """What a policy's file says.

    Attributes:
        targets: What it asks for.
        mirror: What the machine's states are in the mirror, where it says so.
        stiffness: The joints' stiffness, where that is not the robot's.
        limits: What comes last, where the file has limits.
        machine: The gait, where the file holds it.
    """

    targets: Formulas
    mirror: Any = None
    stiffness: float | None = None
    limits: Limits | None = None
    machine: Gait | None = None


def read_policy(
    robot: Robot, data: bytes, kind: str, gait: str, n_states: int, imu: bool
) -> Policy:
    """Reads a policy's file.

    Raises:
        RefusedError: if the policy is of another robot, gait or kind.
    """
    known = kind in ("symbolic", "statewise_symbolic")
    refuse_unless(known, f"a policy of kind {kind!r} is not checked")
    text = FormulaText.read(data.decode("ascii"))
    refuse_unless(text.header["gait"] == gait, "the policy is of another gait")
    of = text.header.get("robot", DEFAULT_ROBOT)
    refuse_unless(of == robot.name, "the policy is of another robot")
    refuse_unless(text.n_states == n_states, "the policy has other states")
    refuse_unless(text.imu == imu, "the policy has other senses than the boxes")
    refuse_unless(text.kinds == {kind == "symbolic"}, "the policy is of another kind")
    formulas = Formulas.read(robot, text)
    return Policy(formulas, text.image, text.stiffness, text.limits, text.machine)


class Document:
    """A certificate, the robot, the gait and the policy that it is of.

    Attributes:
        content: What the certificate says.
        robot: What the robot's file says.
        gait: What the gait's file says.
        targets: What the policy asks for.
        mirror: What the machine's states are in the mirror, where the policy's file says so.
        target_limits: What comes last between the policy and the joints; None without.
    """

    def __init__(
        self, certificate: Path, policy: Path | None, gait: Path | None, robot: Path | None
    ) -> None:
        self.content = read_json(read_bytes(certificate))
        self.check_contents()
        self.robot = self.read_robot(robot)
        states = self.content["states"]
        counted = isinstance(states, list) and 0 < len(states) <= MOST_STATES
        refuse_unless(counted, "the certificate names no states")
        # What a robot senses is what a box of its observations is of.
        self.n_states, self.imu = len(states), "g.x" in self.content["boxes"]["operating"]
        self.names = symbols(self.n_states, self.imu)
        read = self.read_certified(policy)
        self.gait = self.read_gait(gait, read.machine)
        same = self.gait.states == states
        refuse_unless(same, f"the {self.content['gait']} has other states: {self.gait.states}")
        self.check_mirror()
        self.check_boxes()

    def check_contents(self) -> None:
        sound = isinstance(self.content, dict) and {*self.content} - {"robot"} == {*TOP}
        refuse_unless(sound, "it is no certificate")
        rest = {key: value for key, value in self.content.items() if key != "sha256"}
        text = json.dumps(rest, sort_keys=True, separators=(",", ":"))
        refuse_unless(
            hashlib.sha256(text.encode()).hexdigest() == self.content["sha256"],
            "the certificate was changed: its digest is of other contents",
        )
        of = self.content["format"]
        refuse_unless(type(of) is int and of == 1, "the certificate is of another format")

    def read_robot(self, given: Path | None) -> Robot:
        """Reads the file of the robot that the certificate names, and refuses that of another."""
        name = self.content.get("robot", DEFAULT_ROBOT)
        refuse_unless(is_robot_name(name), f"{str(name)[:60]!r} is no name of a robot")
        shipped = MODELS / "robots" / name / "robot.yaml"
        refuse_unless(
            given or shipped.is_file(),
            f"no robot {name!r} ships with the project; name its file by --robot",
        )
        path = given or shipped
        robot = Robot.read(path)
        same = not (given and shipped.is_file()) or robot == Robot.read(shipped)
        refuse_unless(same, f"{path} is not the {name} that ships; give your robot another name")
        refuse_unless(robot.name == name, f"{path} is the file of another robot than the {name}")
        return robot

    def shipped_in(self, folder: str, rest: str) -> Path:
        """Returns where a file of a robot and gait ships; the default robot's are not apart."""
        own = [] if self.robot.name == DEFAULT_ROBOT else [self.robot.name]
        return MODELS.joinpath(folder, *own, rest)

    @property
    def plain(self) -> bool:
        """Whether the gait's name may be that of a file that ships."""
        name = self.content["gait"]
        return isinstance(name, str) and bool(re.fullmatch(r"[A-Za-z0-9_]+", name))

    def read_gait(self, given: Path | None, own: Gait | None) -> Gait:
        """Reads the gait's file, where the policy's file does not hold the gait itself."""
        if given is None and own is not None:
            return own
        if given is not None and given.suffix == ".formulas":
            raise RefusedError(
                f"{given} is no gait's file; a policy that holds its gait needs no --gait"
            )
        name = self.content["gait"]
        shipped = MODELS / "task" / "gaits" / f"{name}.yaml" if self.plain else None
        ships = shipped is not None and shipped.is_file()
        path = given or (shipped if ships else None)
        if path is None:
            raise RefusedError(f"no gait {name!r} ships with the project; name its file by --gait")
        refuse_unless(path.stem == name, f"{path} is the file of another gait than the {name}")
        found = Gait.load(path)
        if own is not None:
            refuse_unless(own.acts_as(found), f"{path} is not the gait that the policy holds")
        elif shipped is not None and ships:
            same = path == shipped or read_yaml(path) == read_yaml(shipped)
            refuse_unless(same, f"{path} is not the {name} that ships; give your gait another name")
        return found

    def read_certified(self, policy: Path | None) -> Policy:
        """Reads the policy's file, and refuses another one than the certificate's."""
        own, name = self.content["policy"], self.content["gait"]
        path = policy or self.shipped_policy(str(own["file"]))
        data = read_bytes(path)
        refuse_unless(
            hashlib.sha256(data).hexdigest() == own["sha256"],
            f"the policy {path} is not the one that was certified",
        )
        read = read_policy(self.robot, data, own["kind"], name, self.n_states, self.imu)
        self.targets = read.targets
        self.mirror, self.target_limits = read.mirror, read.limits
        if read.stiffness is not None:
            self.robot = replace(self.robot, stiffness=read.stiffness)
        if read.limits is not None:
            read.limits.check(self.robot)
        return read

    def check_mirror(self) -> None:
        image = self.content["mirror"]
        refuse_unless(
            image is None or is_involution(image, self.n_states),
            "its mirror does not name each state's image",
        )
        refuse_unless(self.gait.mirrors(image), "its mirror is not that of the gait's machine")
        # Formulas that a file leaves out are the images of others in this mirror.
        own = self.mirror in (None, image)
        refuse_unless(own, "the policy's mirror is not that of the gait's machine")

    def shipped_policy(self, file: str) -> Path:
        plain = self.plain and re.fullmatch(r"[A-Za-z0-9_]+\.[a-z]+", file)
        place = "students", f"{self.content['gait']}/{file}"
        ships = plain and self.shipped_in(*place).is_file()
        refuse_unless(
            ships, f"no policy {file!r} ships with the project; name its file by --policy"
        )
        return self.shipped_in(*place)

    def check_boxes(self) -> None:
        boxes = self.content["boxes"]
        refuse_unless({*boxes} == {*BOXES}, "there must be an operating and a physical box")
        for name, box in boxes.items():
            sound = list(box) == self.names and all(
                len(ends) == 2 and all(map(is_number, ends)) and ends[0] <= ends[1]
                for ends in box.values()
            )
            refuse_unless(sound, f"the {name} box is no box of this gait's observations")
        expected = self.gait.physical(self.robot, boxes["operating"])
        near = all(
            abs(mine - theirs) <= SLACK
            for name, ends in expected.items()
            for mine, theirs in zip(ends, boxes["physical"][name], strict=True)
        )
        refuse_unless(near, "the physical box is not what the robot and its sensors can be")
        # Not by a hair narrower than it must be.
        boxes["physical"] = {
            name: [min(low, boxes["physical"][name][0]), max(high, boxes["physical"][name][1])]
            for name, (low, high) in expected.items()
        }
        for name in COUNTED:
            low, high = self.gait.limits(self.robot, name)
            ends = boxes["operating"][name]
            whole = all(end == int(end) and low <= end <= high for end in ends)
            refuse_unless(whole, f"the operating box of {name} holds other counts than there are")

    def box_ships(self) -> bool:
        name = f"{self.content['gait']}.yaml"
        path, gait = self.shipped_in("certificates/boxes", name), MODELS / "task" / "gaits" / name
        # The box that ships was measured with the machine that ships.
        return (
            path.is_file()
            and gait.is_file()
            and self.gait.acts_as(Gait.load(gait))
            and read_yaml(path)["ranges"] == self.content["boxes"]["operating"]
        )

    def box(self, where: str, stuck: list[str], state: int) -> Box:
        """Returns a box with the machine's state held."""
        boxes = self.content["boxes"]
        ranges = boxes[where] | {name: boxes["physical"][name] for name in stuck}
        box: Box = {name: (float(low), float(high)) for name, (low, high) in ranges.items()}
        return box | {f"s{i}": (float(i == state), float(i == state)) for i in range(self.n_states)}

    def names_sensed(self) -> list[str]:
        """Returns the quantities without the machine's states, which are held."""
        return [name for name in self.names if not re.fullmatch(r"s\d+", name)]


def is_list_of(value: Any, known: list[str]) -> bool:
    """Returns whether a value lists known names, none of them twice."""
    return (
        isinstance(value, list)
        and all(isinstance(own, str) and own in known for own in value)
        and len({*value}) == len(value)
    )


def check_keys(claim: Any, states: list[str], names: list[str]) -> None:
    """Refuses a claim that is not one.

    Args:
        claim: The claim.
        states: Names of the machine's states.
        names: The quantities, without the machine's states: of these nothing can be claimed, since
            each state is decided by itself.
    """
    refuse_unless(isinstance(claim, dict), "a claim is no mapping")
    name, kind = repr(claim.get("name"))[:60], claim.get("kind")
    refuse_unless(kind in KINDS, f"{name}: a claim of kind {kind!r} is not known")
    must, may = KINDS[kind]
    needed = {*WRITTEN, *must}
    known = {*needed, *SCOPE, *may}
    refuse_unless(needed <= {*claim}, f"{name}: lacks the keys {sorted(needed - {*claim})}")
    unsigned = kind in ("limits",) or claim.get("most", 0.0) >= 0.0
    refuse_unless(unsigned, f"{name}: its 'most' is below 0")
    whole = claim.get("keeps") in ("range", "finite") and "most" in claim
    refuse_unless(not whole, f"{name}: has keys of no use, ['most']")
    counted = kind == "never" and {*claim["observations"]} & {*COUNTED}
    refuse_unless(not counted, f"{name}: counts of steps have no slope; claim an effect")
    refuse_unless({*claim} <= known, f"{name}: has keys of no use, {sorted({*claim} - known)}")
    own = [*names, *(f"{kind}.own" for kind in ("q", "dq", "a"))]
    kinds = {name.partition(".")[0] for name in names} - {"cmd"}
    sound = {
        "name": lambda value: isinstance(value, str) and value,
        "kind": lambda value: True,
        "outcome": lambda value: value in OUTCOMES,
        "worst": is_number,
        "claimed": is_number,
        "where": lambda value: isinstance(value, str),
        "witnesses": lambda value: isinstance(value, list) and all(map(is_point, value)),
        "joints": lambda value: is_list_of(value, JOINTS),
        "states": lambda value: is_list_of(value, states),
        "box": lambda value: value in BOXES,
        "stuck": lambda value: is_list_of(value, names),
        "observations": lambda value: value and is_list_of(value, own),
        "keeps": lambda value: value in KEEPS,
        "never": lambda value: value in ("rises", "falls"),
        "least": is_number,
        "most": is_number,
        "changes": lambda value: (
            isinstance(value, dict)
            and value
            and {*value} <= {*names, *kinds}
            and all(is_number(most) and most >= 0.0 for most in value.values())
        ),
    }
    for key, value in claim.items():
        refuse_unless(sound[key](value), f"{name}: its {key!r} is not what it must be")


def is_point(value: Any) -> bool:
    return isinstance(value, dict) and all(map(is_number, value.values()))


def observations(claim: dict[str, Any], joint: str) -> list[str]:
    """Names the quantities that a claim is of, for a joint."""
    return [re.sub(r"\.own$", f".{joint}", name) for name in claim["observations"]]
