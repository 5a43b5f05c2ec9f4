"""`glassgait verify prove` and `glassgait verify check`, from policy to certificate."""

import json
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest

from glassgait.diagrams.scenario import load_scenario
from glassgait.models.certificates.box import (
    BOX_DIRECTORY,
    ObservationBox,
    operating_box,
    physical_box,
)
from glassgait.models.formulas.file import write_formulas
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import gait_lines, load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.rollouts import RolloutConfig
from glassgait.studies.verification.command import measure_box

A1 = load_robot()
MACHINE = "".join(f"  {line}\n" for line in gait_lines(load_gait("trot")))


FILE = f"""format: 2
gait: trot
states: 2
senses: imu
mirror: [1, 0]
machine:
{MACHINE}
definitions
lifted.FL = tanh(100*h.FL - 2)
lifted.FR = tanh(100*h.FR - 2)

state 0
FL_hip = 0.1 + 0.1*lifted.FL*v.y
FL_thigh = 0.8 + 0.1*cmd.v
FL_calf = -1.5
FR_hip = -0.1
FR_thigh = 0.8 + 0.3*tanh(0.5*t - 2)
FR_calf = -1.5
RL_hip = 0.1
RL_thigh = 1.0 - 0.02*dq.RL_thigh
RL_calf = -1.5
RR_hip = -0.1
RR_thigh = 1.0
RR_calf = -1.5 + 0.5*q.RR_calf
"""

CLAIMS = """claims:
  - name: The front left thigh stays below 0.95 rad in q0
    kind: limits
    joints: [FL_thigh]
    states: [q0]
    least: 0
    most: 0.95
  - name: The front left thigh stays below 0.85 rad in q0
    kind: limits
    joints: [FL_thigh]
    states: [q0]
    least: 0
    most: 0.85
  - name: The commanded yaw rate alone moves no calf by more than 0.05 rad
    kind: effect
    joints: [FL_calf, FR_calf]
    observations: [cmd.yaw]
    most: 0.05
"""


@pytest.fixture
def policy(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.formulas").write_text(FILE)
    (tmp_path / "mine.yaml").write_text(CLAIMS)
    return tmp_path / "mine.formulas"


def test_proves_refutes_and_checks_a_policy_of_ones_own(policy, capsys):
    main(
        ["verify", "prove", "--policy", "mine.formulas", "--claims", "mine.yaml", "--output", "out"]
    )
    folder = policy.parent / "out"
    content = json.loads((folder / "certificate.json").read_text())
    by_name = {claim["name"]: claim for claim in content["claims"]}
    # The commanded speed is from -1 to 1 m/s.
    assert by_name["The front left thigh stays below 0.95 rad in q0"]["outcome"] == "proved"
    refuted = by_name["The front left thigh stays below 0.85 rad in q0"]
    assert refuted["outcome"] == "refuted"
    assert refuted["witnesses"][0]["cmd.v"] == 1.0
    assert by_name["Left and right are treated alike"]["outcome"] == "proved"
    claims = pd.read_csv(folder / "claims.csv", index_col="claim")
    assert claims.loc[refuted["name"], "worst"] == pytest.approx(0.9)
    unseen = claims.loc["The commanded yaw rate alone moves no calf by more than 0.05 rad"]
    assert (unseen["outcome"], unseen["worst"], unseen["claimed"]) == ("proved", 0.0, 0.05)
    metrics = json.loads((folder / "metrics.json").read_text())
    outcomes = [claim["outcome"] for claim in content["claims"]]
    assert metrics["proved"] == outcomes.count("proved")
    capsys.readouterr()
    for named in ("out/certificate.json", "out"):
        main(["verify", "check", named, "--policy", "mine.formulas"])
        assert "least 0.0, most 0.85)" in capsys.readouterr().out.replace("\n", " ")
    policy.write_text(FILE.replace("0.1*cmd.v", "0.2*cmd.v"))
    with pytest.raises(SystemExit):
        main(["verify", "check", "out", "--policy", "mine.formulas"])


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--policy", "expert.formulas"], "no such file"),
        (["--policy", "mine.formulas", "--claims", "none.yaml"], "no such file"),
        (["--policy", "mine.formulas", "--box", "mine.yaml"], "unknown key 'claims'"),
        (["--policy", "mine.formulas", "--box", "mine.yaml", "--measure"], "leave out one"),
        (["--policy", "mine.formulas", "--claims", "taken.yaml"], "taken.yaml: claim 'Left and r"),
        (["--policy", "mine.formulas", "--claims", "q7.yaml"], "q7.yaml: claim 'a': the trot has"),
    ],
)
def test_refuses_in_one_sentence_and_leaves_nothing(policy, capsys, arguments, reported):
    for stem, claim in {
        "taken": "{name: Left and right are treated alike, kind: mirror}",
        "q7": "{name: a, kind: mirror, states: [q7]}",
    }.items():
        (policy.parent / f"{stem}.yaml").write_text(f"claims: [{claim}]")
    with pytest.raises(SystemExit) as ended:
        main(["verify", "prove", *arguments, "--output", "out"])
    assert ended.value.code == 2
    assert reported in capsys.readouterr().err
    assert not (policy.parent / "out" / "certificate.json").exists()


def test_a_measured_box_holds_what_robots_sense_and_no_more_than_sensors_tell():
    gait = load_gait("trot")
    expert, page = load_expert(gait), load_student("trot", "formulas")
    config = RolloutConfig(n_robots=2, n_steps=15, n_seeds=1)
    controllers = {"expert": alone(expert), "formulas": alone(page, expert)}
    box, measured = measure_box(gait, controllers, {"nominal": load_scenario("nominal")}, config)
    low, high = box.lower, box.upper
    names = list(expert.observation_names)
    # All robots stand still at first, in the default stance.
    hip = names.index("DoF Pos FL Hip")
    assert low[hip] < 0.1 < high[hip]
    whole = physical_box(gait, operating_box(gait, A1))
    for name in ("Command X", "RM Iters", "Command RM Iters", "RM State 0"):
        place = names.index(name)
        assert (low[place], high[place]) == (whole.lower[place], whole.upper[place])
    # Fifteen steps reach less far than the shipped box, which holds a hundred in every world.
    shipped = operating_box(gait, A1)
    velocities = [i for i, name in enumerate(names) if name.startswith("Base")]
    assert (low <= high).all()
    assert (high - low)[velocities].sum() < (shipped.upper - shipped.lower)[velocities].sum()
    assert "2 robots a scenario" in measured


IMU_FILE = """format: 2
gait: trot
states: 2
senses: imu
mirror: [1, 0]
machine:
{machine}odometry: {{gain: 0.3}}

every state
{formulas}
"""


def imu_policy(folder, of_gravity=0.1):
    """Writes formulas of gravity and of the angular velocity, and a box of what they observe."""
    left = [joint for joint in quadruped.JOINTS if joint[1] == "L"]
    stance = {joint: A1.default_stance[quadruped.joint_index(joint)] for joint in left}
    formulas = [f"{own} = {angle} + {of_gravity}*g.y - 0.01*w.x" for own, angle in stance.items()]
    text = IMU_FILE.format(machine=MACHINE, formulas="\n".join(formulas))
    (folder / "imu.formulas").write_text(text)
    gait = load_gait("trot")
    box = operating_box(gait, A1)
    ranges = box.ranges
    ranges |= {f"g.{axis}": (-0.5, 0.5) for axis in "xy"} | {"g.z": (-1.05, -0.8)}
    ranges |= {f"w.{axis}": (-4.0, 4.0) for axis in "xyz"}
    ObservationBox.of_ranges(A1, box.names, ranges).save(folder / "imu.yaml", gait, "by a test")
    return text


def test_noise_of_the_imu_breaks_a_claim_that_noise_of_joints_does_not(policy):
    imu_policy(policy.parent, of_gravity=8)
    main(["verify", "prove", "--policy", "imu.formulas", "--box", "imu.yaml", "--output", "out"])
    content = json.loads((policy.parent / "out" / "certificate.json").read_text())
    outcomes = {claim["name"]: claim["outcome"] for claim in content["claims"]}
    assert outcomes["Noise of joint sensors alone is never an abrupt action"] == "proved"
    assert outcomes[ABRUPT_BY_IMU] == "refuted"
    main(["verify", "check", "out", "--policy", "imu.formulas"])


ABRUPT_BY_IMU = "Noise of joint sensors and of the IMU together is never an abrupt action"


def test_a_machine_that_favours_a_side_is_proved_of_without_its_mirror(policy, capsys):
    text = write_formulas(replace(read_formulas(imu_policy(policy.parent)), mirror=None))
    (policy.parent / "imu.formulas").write_text(text.replace("to: q1,", "to: q1, dwell: 0.9,"))
    options = ["--policy", "imu.formulas", "--gait", "imu.formulas", "--box", "imu.yaml"]
    main(["verify", "prove", *options, "--output", "out"])
    content = json.loads((policy.parent / "out" / "certificate.json").read_text())
    assert content["mirror"] is None
    assert not [own for own in content["claims"] if own["kind"] == "mirror"]
    main(["verify", "check", "out", "--policy", "imu.formulas"])
    assert "refuted" in capsys.readouterr().out


def test_the_box_that_ships_is_of_the_machine_that_ships(tmp_path, monkeypatch, refused, capsys):
    monkeypatch.chdir(tmp_path)
    Path("slow.formulas").write_text(FILE.replace("dwell: [6, 11]", "dwell: [5, 12]"))
    run = ["verify", "prove", "--gait", "slow.formulas", "--policy", "slow.formulas"]
    assert "differs in 'dwell'; add --measure" in refused([*run, "--output", "out"])
    box = str(BOX_DIRECTORY / "trot.yaml")
    main([*run, "--box", box, "--output", "out"])
    main(["verify", "check", "out", "--policy", "slow.formulas"])
    assert "its operating box is taken on trust" in capsys.readouterr().out
