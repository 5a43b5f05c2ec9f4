"""The checker of tables and trees: what was proved holds, and what is false does not."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from glassgait.models.certificates.certificate import (
    certificate,
    certificate_text,
    content_digest,
)
from glassgait.models.certificates.checker import RefusedError, check
from glassgait.models.certificates.checker.robot import JOINTS, BoundQuery, Robot
from glassgait.models.certificates.checker.tables import Tables, Trees, greatest_sum, read_arrays
from glassgait.models.certificates.claims import Claim
from glassgait.models.certificates.observation_box import operating_box
from glassgait.models.certificates.prover import Prover
from glassgait.models.errors import InputError
from glassgait.models.files import digest
from glassgait.models.formulas.quantities import RobotUnits
from glassgait.models.policies.additive import AdditivePolicy
from glassgait.models.policies.boosting import BoostedTreesPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout

pytestmark = pytest.mark.usefixtures("answered_once")

A1 = load_robot()
RESTATED = Robot.read(yaml.safe_load(Path(A1.path).read_text()), A1.path)


GAIT = load_gait("trot")
NAMES = ObservationLayout(2, imu=True).names
FEW = ("FL_hip", "RR_calf")
CLAIMS = (
    Claim("hips", "limits", joints=("FL_hip", "FR_hip")),
    Claim("far", "limits", joints=FEW, least=-50.0, most=50.0, box="physical"),
    Claim("torque", "torque", joints=("FL_calf",)),
    Claim("damped", "never", observations=("dq.own",), never="rises"),
    Claim("stuck", "effect", joints=FEW, observations=("h.FL",), most=0.05, stuck=("h.FL",)),
    Claim("count", "effect", joints=FEW, observations=("t",), most=20.0),
    Claim("blind", "independent", observations=("cmd.yaw",)),
    Claim("alike", "mirror"),
    Claim("noise", "change", joints=FEW, changes={"q": 0.02, "dq": 3.0}),
    Claim("step", "change", joints=FEW, changes={"q": 0.02, "dq": 3.0}, most=1e6),
)


def tables(generator: np.random.Generator) -> AdditivePolicy:
    """Random tables of all observations, and three pairs a joint."""
    n, pairs = len(NAMES), 3 * quadruped.N_JOINTS
    cuts = np.sort(generator.uniform(-1.0, 1.0, (n, 6)), axis=1)
    paired = np.array([generator.choice(n, 2, replace=False) for _ in range(pairs)])
    sizes = (quadruped.N_JOINTS, n, 7), (pairs, 4, 4)
    return AdditivePolicy(
        "trot",
        NAMES,
        cuts=cuts,
        pair_cuts=np.sort(generator.uniform(-1.0, 1.0, (n, 3)), axis=1),
        tables=generator.normal(0.0, 0.2, sizes[0]),
        pairs=paired,
        pair_joints=np.repeat(np.arange(quadruped.N_JOINTS), 3),
        pair_tables=generator.normal(0.0, 0.2, sizes[1]),
        deviations=np.zeros(sizes[0]),
        pair_deviations=np.zeros(sizes[1]),
        intercepts=generator.normal(0.0, 0.1, quadruped.N_JOINTS),
    )


def trees(generator: np.random.Generator) -> BoostedTreesPolicy:
    """Twenty random trees a joint, three questions deep; some of their branches end early."""
    shape = (quadruped.N_JOINTS, 20, 7)
    thresholds = generator.uniform(-1.0, 1.0, shape).astype(np.float32).astype(float)
    thresholds[..., 5][generator.random(shape[:2]) < 0.3] = np.inf
    return BoostedTreesPolicy(
        "trot",
        NAMES,
        features=generator.integers(0, len(NAMES), shape),
        thresholds=thresholds,
        leaves=generator.normal(0.0, 0.2, (*shape[:2], 8)),
        intercepts=generator.normal(0.0, 0.1, quadruped.N_JOINTS),
        importances=np.full((quadruped.N_JOINTS, len(NAMES)), 1.0 / len(NAMES)),
    )


@pytest.fixture(scope="module", params=[tables, trees], ids=["tables", "trees"])
def certified(request, tmp_path_factory):
    """A policy, its file, and what a certificate of it says."""
    policy = request.param(np.random.default_rng(3))
    path = tmp_path_factory.mktemp("policy") / "policy.safetensors"
    policy.save(path)
    prover = Prover(policy, GAIT)
    decided = [prover.decide(claim) for claim in CLAIMS]
    return policy, path, certificate(prover, [one for one in decided if one], path)


def checked(content, policy, folder) -> str:
    path = folder / "certificate.json"
    path.write_text(certificate_text({**content, "sha256": content_digest(content)}))
    return check(path, policy)


def test_what_was_proved_holds(certified, tmp_path):
    _, path, content = certified
    reported = checked(content, path, tmp_path)
    outcomes = [claim["outcome"] for claim in content["claims"]]
    assert reported.startswith(f"{len(content['statements'])} bounds hold")
    for outcome in ("proved", "refuted"):
        assert outcomes.count(outcome) > 1
        assert f"{outcomes.count(outcome)} {outcome}" in reported


def test_a_bound_that_is_too_low_does_not_hold(certified, tmp_path):
    _, path, content = certified
    for number in np.random.default_rng(5).choice(len(content["statements"]), 5, replace=False):
        false = json.loads(json.dumps(content))
        false["statements"][number]["bound"] -= 1e-8
        with pytest.raises(RefusedError, match="is not proved"):
            checked(false, path, tmp_path)


@pytest.mark.parametrize("number", range(len(CLAIMS)))
def test_a_claim_that_is_turned_about_does_not_hold(certified, tmp_path, number):
    _, path, content = certified
    false = json.loads(json.dumps(content))
    claim = false["claims"][number]
    claim["outcome"] = "proved" if claim["outcome"] != "proved" else "refuted"
    with pytest.raises(RefusedError):
        checked(false, path, tmp_path)


@pytest.mark.parametrize(
    ("number", "key", "value"),
    [
        (3, "observations", ["dq.tail"]),
        (6, "observations", ["cmd.roll"]),
        (9, "changes", {"q": -0.02, "dq": 3.0}),
        (9, "changes", {"qq": 0.02}),
    ],
)
def test_a_claim_of_an_unknown_observation_is_refused(certified, tmp_path, number, key, value):
    _, path, content = certified
    false = json.loads(json.dumps(content))
    false["claims"][number] |= {key: value, "outcome": "proved", "witnesses": []}
    with pytest.raises(RefusedError, match="must be"):
        checked(false, path, tmp_path)


def test_a_policy_with_another_number_is_refused(certified, tmp_path):
    policy, path, content = certified
    other = tmp_path / path.name
    intercepts = policy.intercepts.copy()
    intercepts[3] = np.nextafter(intercepts[3], 1.0)
    arrays = {name: getattr(policy, name) for name in policy.array_specs}
    type(policy)("trot", NAMES, **{**arrays, "intercepts": intercepts}).save(other)
    with pytest.raises(RefusedError, match="certified"):
        checked(content, other, tmp_path)


def test_no_observation_reaches_more_than_the_checker_says(certified):
    policy, path, content = certified
    _, arrays = read_arrays(path.read_bytes())
    own = (Tables if isinstance(policy, AdditivePolicy) else Trees)(RESTATED, arrays, 2, imu=True)
    box = operating_box(GAIT, A1).in_state(1)
    reported = {name: tuple(ends) for name, ends in content["boxes"]["operating"].items()}
    reported |= {"s0": (0.0, 0.0), "s1": (1.0, 1.0)}
    observations = box.random(10_000, np.random.default_rng(1))
    reached = A1.joint_targets(policy(observations))
    quantities = RobotUnits.of(A1, NAMES).quantities(observations)
    for joint, name in enumerate(JOINTS):
        offsets = reached[:, joint] - quantities[:, own.names.index(f"q.{name}")]
        for of, values in (("target", reached[:, joint]), ("offset", offsets)):
            for sign in (1, -1):
                most = own.bound(BoundQuery(of, 1, name, sign), reported)
                assert (sign * values).max() <= most


def test_the_slope_of_a_table_is_its_greatest_step(tmp_path):
    policy = tables(np.random.default_rng(3))
    index = NAMES.index("Base Lin Vel X")
    falling = policy.tables.copy()
    falling[0, index] = -np.arange(7.0)
    arrays = {name: getattr(policy, name) for name in policy.array_specs} | {"tables": falling}
    arrays["pair_tables"] = np.zeros_like(policy.pair_tables)
    arrays["pair_cuts"] = np.full_like(policy.pair_cuts, np.inf)
    path = tmp_path / "policy.safetensors"
    AdditivePolicy("trot", NAMES, **arrays).save(path)
    own = Tables(RESTATED, read_arrays(path.read_bytes())[1], 2, imu=True)
    wide = dict.fromkeys(own.names, (-20.0, 20.0))
    found = [own.bound(BoundQuery("slope", 0, "FL_hip", sign, "v.x"), wide) for sign in (1, -1)]
    assert found == pytest.approx([-0.25, 0.25], abs=1e-9)


def test_the_greatest_sum_is_the_greatest_of_all(generator):
    sizes = [3, 4, 2, 3]
    unary = [((i,), generator.normal(size=size)) for i, size in enumerate(sizes)]
    pairs = [((0, 1), (3, 4)), ((2, 1), (2, 4)), ((3, 0), (3, 3)), ((2, 3), (2, 3))]
    tables = [*unary, *((axes, generator.normal(size=shape)) for axes, shape in pairs)]
    best = max(
        sum(values[tuple(labels[axis] for axis in axes)] for axes, values in tables)
        for labels in np.ndindex(*sizes)
    )
    assert greatest_sum(tables, sizes) == pytest.approx(best, abs=1e-12)


def test_a_sum_that_is_too_large_is_tried_label_by_label(generator, monkeypatch):
    monkeypatch.setattr("glassgait.models.certificates.checker.tables.LARGEST", 8)
    test_the_greatest_sum_is_the_greatest_of_all(generator)


def forged(certified, folder, change, header=None):
    """Returns the message with which a policy of changed arrays is refused."""
    _, path, content = certified
    data = path.read_bytes()
    size = int.from_bytes(data[:8], "little")
    reported = json.loads(data[8 : 8 + size])
    reported["__metadata__"]["header"] = json.dumps(
        json.loads(reported["__metadata__"]["header"]) | (header or {})
    )
    change(reported)
    text = json.dumps(reported).encode()
    other = folder / path.name
    other.write_bytes(len(text).to_bytes(8, "little") + text + data[8 + size :])
    content = json.loads(json.dumps(content))
    content["policy"]["sha256"] = digest(other)
    with pytest.raises(RefusedError) as refused:
        checked(content, other, folder)
    return str(refused.value)


def test_a_policy_that_observes_in_another_order_is_refused(certified, tmp_path):
    names = list(NAMES)
    names[0], names[1] = names[1], names[0]
    reported = forged(certified, tmp_path, lambda reported: None, {"observation_names": names})
    assert reported == "the policy observes other things"


def test_a_fraction_of_a_count_is_no_witness(certified, tmp_path):
    _, path, content = certified
    false = json.loads(json.dumps(content))
    own = next(claim for claim in false["claims"] if claim["witnesses"])
    own["witnesses"][0]["t"] = 1.5
    with pytest.raises(RefusedError, match="is not where the claim is made"):
        checked(false, path, tmp_path)


def test_arrays_that_overlap_are_refused(certified, tmp_path):
    def overlap(reported):
        own = next(own for name, own in reported.items() if name != "intercepts" and "shape" in own)
        start = own["data_offsets"][0]
        width = own["data_offsets"][1] - start
        own["data_offsets"] = [start - 8, start - 8 + width] if start else [8, 8 + width]

    assert forged(certified, tmp_path, overlap) == "the policy's arrays overlap"


def test_a_pair_of_one_observation_is_none():
    policy = tables(np.random.default_rng(3))
    arrays = {name: getattr(policy, name).copy() for name in policy.array_specs}
    arrays["pairs"][0] = 7
    with pytest.raises(RefusedError, match="pair"):
        Tables(RESTATED, arrays, 2, imu=True)
    with pytest.raises(InputError, match="pair"):
        Prover(AdditivePolicy("trot", NAMES, **arrays), GAIT)


def test_trees_without_questions_and_thresholds_between_numbers_are_refused():
    policy = trees(np.random.default_rng(3))
    arrays = {name: getattr(policy, name).copy() for name in policy.array_specs}
    bare = arrays | {"features": arrays["features"][..., :0], "leaves": arrays["leaves"][..., :2]}
    with pytest.raises(RefusedError, match="not complete"):
        Trees(RESTATED, bare, 2, imu=True)
    del arrays["thresholds"]
    between = np.full_like(policy.thresholds, 1.0 + 2.0**-40)
    with pytest.raises(RefusedError, match="single precision"):
        Trees(RESTATED, arrays | {"thresholds_lower_neighbours": between}, 2, imu=True)


def test_any_step_of_a_table_breaks_the_claim_that_it_never_rises(certified):
    policy, _, _ = certified
    values = {"joints": ("FL_hip",), "observations": ("dq.own",), "never": "rises"}
    strict, loose = (
        Prover(policy, GAIT).decide(Claim("damped", "never", most=most, **values))
        for most in (None, 100.0)
    )
    assert strict is not None and loose is not None
    assert strict.outcome == loose.outcome != "proved"
