"""Reading certificates back, and telling in words what became of each claim."""

import json

import pytest

from glassgait.models.certificates.certificate import (
    box_in_words,
    certificate_text,
    claimed_joint,
    content_digest,
    finding_in_words,
    read_certificate,
    shipped_certificates,
)
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.observation_box import operating_box, physical_box
from glassgait.models.certificates.prover import Verdict
from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.policies.library import STUDENT_DIRECTORY
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait

A1 = load_robot()
PATH = next(path for path in shipped_certificates() if path.name == "trot_sparse_formula.json")
TEXT = PATH.read_text()


def test_says_what_the_file_says():
    content, gait = json.loads(TEXT), load_gait("trot")
    found = read_certificate(PATH)
    assert [verdict.claim.name for verdict in found.verdicts] == [
        c["name"] for c in content["claims"]
    ]
    for verdict, claim in zip(found.verdicts, content["claims"], strict=True):
        assert verdict.outcome == claim["outcome"]
        assert (verdict.worst, verdict.claimed) == (claim["worst"], claim["claimed"])
        assert list(verdict.witnesses) == claim["witnesses"]
    assert sum(found.counts().values()) == len(content["claims"])
    operating = operating_box(gait, A1)
    boxes = {"operating": operating, "physical": physical_box(gait, operating)}
    for name, box in boxes.items():
        assert found.boxes[name].lines() == box.lines()


def test_is_of_the_policy_whose_file_has_its_digest_and_of_no_other():
    found, gait = read_certificate(PATH), load_gait("trot")
    assert found.is_of(gait, digest(STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas"))
    assert not found.is_of(gait, digest(STUDENT_DIRECTORY / "trot" / "symbolic.formulas"))
    assert not found.is_of(load_gait("pace"), found.policy_digest)


def without_a_sensor(content):
    refuted = next(claim for claim in content["claims"] if claim["witnesses"])
    del refuted["witnesses"][0]["h.FL"]


def of_an_unknown_outcome(content):
    content["claims"][0]["outcome"] = "perhaps"


def of_no_number(content):
    content["claims"][0]["worst"] = "much"


def of_an_empty_box(content):
    content["boxes"]["operating"]["v.x"] = [1.0, -1.0]


def of_an_unknown_kind(content):
    content["claims"][0]["kind"] = "hope"


@pytest.mark.parametrize(
    "change",
    [without_a_sensor, of_an_unknown_outcome, of_no_number, of_an_empty_box, of_an_unknown_kind],
)
def test_refuses_what_no_certificate_says(tmp_path, change):
    content = json.loads(TEXT)
    change(content)
    path = tmp_path / "certificate.json"
    path.write_text(certificate_text({**content, "sha256": content_digest(content)}))
    with pytest.raises(InputError, match="version"):
        read_certificate(path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TEXT.replace('"bound": 0.', '"bound": 1.', 1), "is damaged"),
        ("{}", "is no certificate; make one"),
        ("[" * 100_000, "is no certificate; make one"),
        ('{"format": ', "is no certificate; make one"),
    ],
)
def test_refuses_a_file_that_is_damaged_or_another(tmp_path, text, message):
    path = tmp_path / "certificate.json"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as refused:
        read_certificate(path)
    assert str(path) in str(refused.value)


def verdict(kind, outcome, worst, claimed, where, **keys):
    return Verdict(Claim("a claim", kind, **keys), outcome, worst, claimed, where)


OWN = {"observations": ("dq.own",), "never": "rises"}


@pytest.mark.parametrize(
    ("own", "message"),
    [
        (
            verdict("limits", "refuted", -5.67079, -2.6965, "FR_calf, q0"),
            "FR calf in q0: target of −5.67 rad, where at least −2.6965 rad is claimed.",
        ),
        (
            verdict("limits", "refuted", 3.05748, -0.9163, "FR_calf, q0"),
            "FR calf in q0: target of 3.057 rad, where at most −0.9163 rad is claimed.",
        ),
        (
            verdict("torque", "proved", -90.79344, -100.5, "FR_calf, q0"),
            "Closest is FR calf in q0: torque at rest always at least −90.8 N·m, where at least "
            "−100.5 N·m is claimed.",
        ),
        (
            verdict("never", "refuted", 0.0096999, 0.0, "FL_calf, q1, dq.FL_calf", **OWN),
            "FL calf in q1: slope of 0.009699 rad/(rad/s) by dq.FL_calf, where at most 0 is "
            "claimed.",
        ),
        (
            verdict("change", "undecided", 301.3054, 60.0, "state q1", changes={"q": 0.1}),
            "Squared change of the action proved to be at most 301.4 only; at most 60 is claimed, "
            "and nothing found breaks it.",
        ),
        (
            verdict("mirror", "refuted", 0.25, 0.0, "FL_hip and its image"),
            "FL hip and its image: difference of left and right of 0.25 rad, where at most 0 is "
            "claimed.",
        ),
        (
            verdict("mirror", "proved", 0.0, 0.0, "each formula is its image's image"),
            "Each formula is its image's image.",
        ),
    ],
)
def test_findings_are_reported_with_what_is_claimed(own, message):
    assert finding_in_words(own) == message


def test_slopes_of_tables_are_reported_as_steps():
    own = verdict("never", "refuted", 0.02, 0.0, "FL_calf, q1, dq.FL_calf", **OWN)
    assert "step of 0.02 rad by dq.FL_calf" in finding_in_words(own, steps=True)


@pytest.mark.parametrize(("outcome", "message"), [("proved", "0.1001 rad"), ("refuted", "0.1 rad")])
def test_bounds_are_rounded_outward_and_witnesses_inward(outcome, message):
    claimed = 1.0 if outcome == "proved" else 0.05
    own = verdict("limits", outcome, 0.10003, claimed, "FL_hip, q0")
    assert message in finding_in_words(own)


def test_the_joint_and_the_box_of_a_claim_are_reported():
    own = verdict("torque", "refuted", 40.0, 33.5, "RL_thigh, q0", stuck=("q.FL_hip", "h.FL"))
    assert claimed_joint(own) == 7
    assert box_in_words(own.claim) == (
        "over the operating box, q.FL_hip, h.FL anywhere in the physical box"
    )
    assert (
        claimed_joint(verdict("change", "proved", 1.0, 60.0, "state q0", changes={"q": 1})) is None
    )
