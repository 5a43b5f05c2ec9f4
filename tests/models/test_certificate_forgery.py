"""Forged certificates and policies: no observation refutes a claim that the checker accepts."""

import json
import os
from copy import deepcopy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glassgait.models.certificates.box import ObservationBox, physical_box
from glassgait.models.certificates.certificate import (
    certificate,
    certificate_text,
    check_certificate,
    content_digest,
)
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.prover import Prover
from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import REFLECT_JOINTS, ObservationLayout, reflect_observation
from glassgait.models.task.symmetry import mirrored_states

A1 = load_robot()


GAIT = load_gait("trot")
LAYOUT = ObservationLayout(GAIT.n_states, imu=True)
SYMBOLS = [entry.symbol for entry in LAYOUT.entries]
UNITS = RobotUnits.of(A1, LAYOUT.names)
TEXT = (STUDENT_DIRECTORY / "trot" / "formulas.formulas").read_text()

WIDE = Claim(
    "wide", "limits", joints=("FL_calf",), states=("q0",), least=-50.0, most=50.0, box="physical"
)

CLAIMS = (
    WIDE,
    Claim("thigh", "limits", joints=("FR_thigh",), states=("q0",), least=-1.2, most=2.6),
    Claim("calf", "limits", joints=("FL_calf",), states=("q0",), least=-2.6965, most=-0.9163),
    Claim(
        "far", "limits", joints=("FR_thigh",), states=("q0",), least=-9.0, most=9.0, box="physical"
    ),
    Claim("damped", "never", joints=("FL_thigh",), observations=("dq.own",), never="rises"),
    Claim(
        "stuck", "effect", joints=("FL_calf",), observations=("h.FL",), most=1.7, stuck=("h.FL",)
    ),
    Claim("blind", "effect", joints=("FL_hip",), observations=("cmd.v", "cmd.t"), most=0.0),
    Claim("deaf", "effect", joints=("FR_hip",), observations=("cmd.t",), states=("q0",), most=0.0),
    Claim("fast", "effect", joints=("FL_calf",), observations=("cmd.v",), most=0.0),
    Claim("alike", "mirror", joints=("FL_hip", "FL_calf")),
    Claim("noise", "change", joints=("FL_hip",), changes={"q": 0.02, "dq": 3.0}, most=10.0),
)

SAMPLES = 1000

TOLERANCE = 2e-9
"""Difference between the exact target of a claim and double precision (rad)."""


@cache
def forged_from() -> str:
    """Returns a certificate with claims of every kind about the short formulas of the trot."""
    path = STUDENT_DIRECTORY / "trot" / "formulas.formulas"
    prover = Prover(load_policy(path), GAIT)
    verdicts = [prover.decide(claim) for claim in CLAIMS]
    return json.dumps(certificate(prover, [one for one in verdicts if one], path))


def checked(content: dict[str, Any], policy: Path, folder: Path) -> str:
    path = folder / "certificate.json"
    path.write_text(certificate_text({**content, "sha256": content_digest(content)}))
    return check_certificate(path, policy)


def samples(box: ObservationBox, state: int, generator: np.random.Generator) -> np.ndarray:
    """Draws observations in a box, with half of their quantities at the ends of their ranges."""
    inside = box.in_state(state)
    drawn = inside.random(SAMPLES, generator)
    ends = np.where(generator.random(drawn.shape) < 0.5, inside.lower, inside.upper)
    return UNITS.observed(np.where(generator.random(drawn.shape) < 0.5, ends, drawn))


class Truth:
    """Checks claims by sampling a policy over the boxes of a certificate."""

    def __init__(self, content: dict[str, Any], policy: Path) -> None:
        self.policy = load_policy(policy)
        operating = ObservationBox.of_ranges(A1, LAYOUT.names, content["operating"])
        self.boxes = {"operating": operating, "physical": physical_box(GAIT, operating)}
        self.generator = np.random.default_rng(0)

    def targets(self, observations: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"):
            return A1.joint_targets(self.policy(observations))

    def drawn(self, box: str, stuck: list[str], state: int) -> np.ndarray:
        free = [SYMBOLS.index(name) for name in stuck]
        return samples(self.boxes[box].updated(free, self.boxes["physical"]), state, self.generator)

    def rise(self, seen: np.ndarray, name: str, joint: int, box: str, stuck: list[str], state: int):
        """Returns the rise of a target (n) with a quantity, and the rise of that quantity (n)."""
        index, other = SYMBOLS.index(name), seen.copy()
        other[:, index] = self.drawn(box, stuck, state)[:, index]
        rise = (self.targets(other) - self.targets(seen))[:, joint]
        by = (UNITS.quantities(other) - UNITS.quantities(seen))[:, index]
        return np.where(by < 0.0, -rise, rise), np.abs(by)

    def assert_holds(self, content: dict[str, Any]) -> None:
        for message in content["claims"]:
            if message["outcome"] == "proved":
                keys = Claim.__dataclass_fields__
                claim = Claim.from_plain({k: v for k, v in message.items() if k in keys}, "a claim")
                for state in claim.state_indices(GAIT):
                    self.assert_claim(claim, state)

    def assert_claim(self, claim: Claim, state: int) -> None:
        joints, place = list(claim.joint_indices()), (claim.box, list(claim.stuck))
        seen = self.drawn(*place, state)
        reached = self.targets(seen)[:, joints]
        assert np.isfinite(reached).all()
        match claim.kind:
            case "limits":
                assert claim.least is not None and claim.most is not None
                assert claim.least <= reached.min() <= reached.max() <= claim.most
            case "never" | "effect":
                sign, most = -1.0 if claim.never == "falls" else 1.0, claim.most or 0.0
                for joint in joints:
                    for index in claim.observations_of(joint, SYMBOLS):
                        rise, by = self.rise(seen, SYMBOLS[index], joint, *place, state)
                        if claim.kind == "never":
                            assert np.all(sign * rise <= most * by + TOLERANCE)
                        else:
                            assert np.abs(rise).max() <= most
            case "mirror":
                images = mirrored_states(GAIT)
                assert images is not None
                image = REFLECT_JOINTS(self.policy(reflect_observation(LAYOUT.names, images)(seen)))
                difference = A1.action_scale * np.abs(self.policy(seen) - image)
                assert difference[:, joints].max() <= TOLERANCE
            case "change":
                inside = self.boxes[claim.box].in_state(state)
                changes = np.array([claim.change_of(symbol) for symbol in SYMBOLS])
                other = UNITS.quantities(seen)
                other += self.generator.choice([-1.0, 0.0, 1.0], seen.shape) * changes
                other = np.clip(other, inside.lower, inside.upper)
                action = self.policy(UNITS.observed(other)) - self.policy(seen)
                assert np.square(action[:, joints]).sum(axis=-1).max() <= claim.most


NUMBERS = (0, 1, -1, 0.0, 1e-9, 1e9, 1e300, 10**400, True, "0", None, [], {}, 0.5, 2, 1e18)
WORDS = (
    *("proved", "refuted", "undecided", "q0", "q1", "FL_hip", "FR_hip", "RL_calf", "operating"),
    *("physical", "target", "slope", "effect", "limits", "never", "mirror"),
    *("change", "rises", "falls", "dq.own", "cmd.v", "s0", "h.FL", "t", "trot", ""),
    *("/etc/passwd", "../trot", "symbolic_per_state", "symbolic", "formulas.formulas"),
)
KEYS = (*Claim.__dataclass_fields__, "x")


def places(whole: Any) -> list[tuple[Any, Any]]:
    """Lists the places of all values in nested containers, as a container and a key."""
    found, pending = [], [whole]
    while pending:
        own = pending.pop()
        keys = list(own) if isinstance(own, dict) else range(len(own))
        for key in keys:
            found.append((own, key))
            if isinstance(own[key], dict | list):
                pending.append(own[key])
    return found


def forge(content: dict[str, Any], generator: np.random.Generator) -> None:
    """Changes a certificate in one to three places."""
    for _ in range(generator.integers(1, 4)):
        # Choose a claim, a box or the head with equal probability, whatever their number.
        part = str(generator.choice(["claims", "operating", "physical", "head"]))
        branch = content if part == "head" else content[part]
        if isinstance(branch, list) and branch:
            branch = branch[generator.integers(len(branch))]
        spots = places(branch)
        if not spots:
            continue
        own, key = spots[generator.integers(len(spots))]
        value = own[key]
        match generator.integers(7):
            case 0 if isinstance(value, int | float):
                scale = float(generator.choice([0.5, 0.9, 1.1, 2.0, -1.0]))
                own[key] = value * scale if type(value) is float else value + 1
            case 1 if isinstance(value, int | float):
                own[key] = NUMBERS[generator.integers(len(NUMBERS))]
            case 2 | 3 if isinstance(value, str):
                own[key] = str(generator.choice(WORDS))
            case 4 if isinstance(value, list) and value:
                value.append(deepcopy(value[generator.integers(len(value))]))
            case 5 if isinstance(own, dict):
                del own[key]
            case 6 if isinstance(own, dict):
                new = str(generator.choice(KEYS))
                own[new] = deepcopy(NUMBERS[generator.integers(len(NUMBERS))])
                if generator.random() < 0.5:
                    own[new] = [str(generator.choice(WORDS))]
            case _:
                if isinstance(value, list) and len(value) > 1:
                    value[0], value[-1] = value[-1], value[0]


ATTACKS = (
    "50*q.FL_hip - ((50*q.FL_hip + 1e25) - 1e25)",
    "0*sqrt(v.x)",
    "sqrt(v.x) - sqrt(v.x)",
    "0*log(v.x)",
    "0*(1/(v.x - v.x))",
    "0*exp(2000*cmd.v)",
    "0/v.x",
    "(1e16 + q.FL_hip) - 1e16",
    "(1e30*1e30*1e30)*1e30*1e30*1e30*1e30*1e30*1e30*1e30*1e30*v.x*0",
)


def attacked(term: str, joint: str = "FL_hip") -> str:
    return TEXT.replace(f"\n{joint} = ", f"\n{joint} = {term} + ", 1)


def forge_text(text: str, generator: np.random.Generator) -> str:
    """Changes a policy in one to three places."""
    for _ in range(generator.integers(1, 4)):
        digits = [i for i, sign in enumerate(text) if sign.isdigit()]
        place = int(generator.choice(digits))
        lines = text.split("\n")
        row = int(generator.integers(len(lines)))
        match generator.integers(6):
            case 0 | 1:
                text = text[:place] + str(generator.integers(10)) + text[place + 1 :]
            case 2:
                text = text[:place] + str(generator.choice(list("+-*/(). #\n"))) + text[place + 1 :]
            case 3:
                joint, term = generator.choice(quadruped.JOINTS), generator.choice(ATTACKS)
                text = text.replace(f"\n{joint} = ", f"\n{joint} = {term} + ", 1)
            case 4:
                lines[row] += str(
                    generator.choice([" # no", "\u2028", "\nstate 1", "\n    + h.FL"])
                )
                text = "\n".join(lines)
            case 5:
                other = int(generator.integers(len(lines)))
                lines[row], lines[other] = lines[other], lines[row]
                text = "\n".join(lines)
    return text


def assert_no_forgery_counts(folder: Path, seed: int, count: int) -> int:
    """Checks random forgeries of certificates and policies; returns how many are accepted."""
    generator, accepted = np.random.default_rng(seed), 0
    sound, policy = json.loads(forged_from()), folder / "formulas.formulas"
    for number in range(count):
        content, text = deepcopy(sound), TEXT
        if number % 2:
            text = forge_text(text, generator)
        else:
            forge(content, generator)
        policy.write_text(text)
        if isinstance(content.get("policy"), dict) and number % 2:
            content["policy"]["sha256"] = digest(policy)
        try:
            checked(content, policy, folder)
        except InputError:
            continue
        Truth(content, policy).assert_holds(content)
        accepted += 1
    return accepted


def test_what_forgeries_are_made_from_holds(tmp_path):
    content = json.loads(forged_from())
    outcomes = {claim["outcome"] for claim in content["claims"]}
    assert {"proved", "refuted"} <= outcomes
    path = STUDENT_DIRECTORY / "trot" / "formulas.formulas"
    report = checked(content, path, tmp_path)
    assert report.count("not a claim that ships") == len(CLAIMS)
    assert "least -1.2, most 2.6" in report
    Truth(content, path).assert_holds(content)


@pytest.mark.parametrize(
    ("seed", "count"),
    [(0, 16), *(pytest.param(seed, 200, marks=pytest.mark.slow) for seed in (1, 2))],
)
def test_no_forgery_proves_what_observations_refute(tmp_path, seed, count):
    # Some are harmless, such as another name of a claim, or a digit of a formula without claims.
    assert assert_no_forgery_counts(tmp_path, seed, count) < count / 2


@pytest.mark.parametrize("term", ATTACKS)
@pytest.mark.parametrize("joint", ["FL_hip", pytest.param("RR_calf", marks=pytest.mark.slow)])
def test_refuses_formulas_that_double_precision_makes_other_ones(tmp_path, term, joint):
    policy = tmp_path / "formulas.formulas"
    policy.write_text(attacked(term, joint))
    content = json.loads(forged_from())
    content["policy"]["sha256"] = digest(policy)
    # Claim only that the target has some bound.
    limits = {"kind": "limits", "joints": [joint], "least": -1e3, "most": 1e3}
    content["claims"] = [{"name": "loose", **limits, "outcome": "proved"}]
    refused = r"double precision|may be|may overflow|divides|belong|knows no function|infinite"
    with pytest.raises(InputError, match=refused):
        checked(content, policy, tmp_path)
    with pytest.raises(InputError, match=r"double precision|may be|may overflow|are proved of"):
        prover = Prover(load_policy(policy), GAIT)
        prover.decide(replace(WIDE, joints=(joint,)))


def proved(content: dict[str, Any], kind: str) -> dict[str, Any]:
    """Returns the first proved claim of a kind."""
    own = (claim for claim in content["claims"] if claim["kind"] == kind)
    return next(claim for claim in own if claim["outcome"] == "proved")


def refuted(content: dict[str, Any]) -> dict[str, Any]:
    """Returns the first refuted claim."""
    return next(claim for claim in content["claims"] if claim["outcome"] == "refuted")


def split(content: dict[str, Any]) -> list[Any]:
    """Returns the first tree of splits of a claim."""
    trees = (tree for claim in content["claims"] for tree in claim.get("splits", {}).values())
    return next(trees)


def at_a_point(box: dict[str, list[float]]) -> dict[str, list[float]]:
    return {name: [least, least] for name, (least, _) in box.items()}


SHIPPED_NAME = "Noise of joint sensors alone is never an abrupt action"

FALSE = {
    "states of other names": lambda c: c.update(states=["q0", "stand"]),
    "another mirror": lambda c: c.update(mirror=[0, 1]),
    "no mirror": lambda c: c.update(mirror=None),
    "a mirror that is none": lambda c: c.update(mirror=[1, 1]),
    "a physical box of a point": lambda c: c.update(physical=at_a_point(c["operating"])),
    "a box of other quantities": lambda c: c["operating"].pop("h.FL"),
    "a box that is empty": lambda c: c["operating"].update({"h.FL": [0.1, 0.0]}),
    "joints twice": lambda c: proved(c, "limits").update(joints=proved(c, "limits")["joints"] * 2),
    "changed commands": lambda c: proved(c, "change").update(changes={"cmd": 2.0}),
    "changed states": lambda c: proved(c, "change").update(changes={"s0": 1.0}),
    "nothing changed": lambda c: proved(c, "change").update(changes={}),
    "an effect of states": lambda c: proved(c, "effect").update(observations=["s0", "s1"]),
    "an effect of nothing": lambda c: proved(c, "effect").update(observations=[]),
    "an unknown sensor stuck": lambda c: proved(c, "limits").update(stuck=["h.tail"]),
    "a state stuck": lambda c: proved(c, "limits").update(stuck=["s0"]),
    "an unknown box": lambda c: proved(c, "limits").update(box="tiny"),
    "a misspelt key": lambda c: proved(c, "limits").update(mosst=proved(c, "limits").pop("most")),
    "a missing key": lambda c: proved(c, "never").pop("never"),
    "a key of another kind": lambda c: proved(c, "mirror").update(most=1.0),
    "truth for a number": lambda c: c["numbers"].update(damping=True),
    "a path for a gait": lambda c: c.update(gait="/work/trot"),
    "another robot": lambda c: c.update(robot="go2"),
    "a stronger motor": lambda c: c["numbers"].update(torque=1e3),
    "a claim of a slope of counts": lambda c: proved(c, "never").update(observations=["t"]),
    "less than nothing": lambda c: proved(c, "effect").update(most=-1.0),
    "counts beyond the gait": lambda c: c["operating"].update(t=[0.0, 60000.0]),
    "a huge number": lambda c: proved(c, "limits").update(most=10**400),
    "a claim turned to refuted": lambda c: proved(c, "effect").update(outcome="refuted"),
    "a claim turned to proved": lambda c: refuted(c).update(outcome="proved", witnesses=[]),
    "a tighter claim": lambda c: proved(c, "effect").update(most=1e-3),
    "a split that is moved out": lambda c: split(c).__setitem__(1, 1e3),
    "a split of another bound": lambda c: proved(c, "never").update(splits={"FL_hip 0 t": []}),
    "a claim without its splits": lambda c: [claim.pop("splits", 0) for claim in c["claims"]],
    "no claims": lambda c: c.update(claims=[]),
    "claims that are none": lambda c: c.update(claims={}),
    "a claim twice": lambda c: c["claims"].append(proved(c, "mirror")),
    "the name of a claim that ships": lambda c: proved(c, "mirror").update(name=SHIPPED_NAME),
    "a shipped claim of another number": lambda c: proved(c, "change").update(
        name=SHIPPED_NAME, most=1e3
    ),
    "a wider box": lambda c: c["operating"].update(
        {f"a.{j}": [-9.0, 9.0] for j in quadruped.JOINTS}
    ),
}


@pytest.mark.parametrize("change", FALSE.values(), ids=FALSE)
def test_refuses_what_was_once_taken_on_trust(tmp_path, change):
    content = json.loads(forged_from())
    change(content)
    with pytest.raises(InputError):
        checked(content, STUDENT_DIRECTORY / "trot" / "formulas.formulas", tmp_path)


def test_refuses_a_key_that_is_given_twice(tmp_path):
    path = tmp_path / "certificate.json"
    path.write_text(forged_from().replace('"gait": "trot"', '"gait": "pace", "gait": "trot"', 1))
    with pytest.raises(InputError, match=r"given twice|digest"):
        check_certificate(path)


@pytest.mark.parametrize("file", ["/dev/zero", "pipe"])
def test_refuses_what_is_no_regular_file(tmp_path, file):
    path = tmp_path / file if file == "pipe" else Path(file)
    if file == "pipe":
        os.mkfifo(path)
    certificate_path = tmp_path / "certificate.json"
    certificate_path.write_text(certificate_text(json.loads(forged_from())))
    for arguments in ((path, None), (certificate_path, path)):
        with pytest.raises(InputError, match="regular file"):
            check_certificate(*arguments)


DISTINCT = "1e-12*" + "*".join(f"({name} + 2)" for name in SYMBOLS[:20])


@pytest.mark.parametrize("term", ["(" * 30 + "3" + ")**3" * 30, DISTINCT])
def test_refuses_what_takes_too_much_work(tmp_path, term):
    policy = tmp_path / "formulas.formulas"
    policy.write_text(attacked(term))
    content = json.loads(forged_from())
    content["policy"]["sha256"] = digest(policy)
    refused = r"multiplies too often|may overflow|too many terms|nested more"
    with pytest.raises(InputError, match=refused):
        checked(content, policy, tmp_path)


def test_a_mirror_is_proved_where_its_image_has_values_alone(tmp_path):
    """The operating box may differ from its mirror image."""
    text = attacked("0/(v.y + 0.71)")
    policy = tmp_path / "formulas.formulas"
    policy.write_text(text)
    content = json.loads(forged_from())
    content["policy"]["sha256"] = digest(policy)
    claims = [own for own in content["claims"] if own["kind"] == "mirror"]
    content["claims"] = claims
    assert content["operating"]["v.y"] == [-0.7043, 0.9215]
    with pytest.raises(InputError, match="divides"):
        checked(content, policy, tmp_path)
