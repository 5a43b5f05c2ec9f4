"""Networks of other projects: conversion of their files, and the check."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import yaml

from glassgait.diagrams.station import StationConfig
from glassgait.models.policies.described import described, load_described
from glassgait.models.robots.quadruped import JOINTS, LEG_JOINTS
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.evaluation import policy_check
from glassgait.studies.evaluation.policy_check import (
    STATE_STEPS,
    recognized,
    state_steps,
    variants,
    walked,
)

NAMES = [f"{leg}_{kind}_joint" for leg in ("FR", "FL", "RR", "RL") for kind in LEG_JOINTS]
BASE = f"go2: {{dt: 0.005, decimation: 4, joint_names: [{', '.join(NAMES)}]}}"
RL_SAR = f"""
go2/lab:
  model_name: policy.pt
  observations: [commands, ang_vel, gravity_vec, dof_pos, dof_vel, actions]
  observations_history: [0, 1, 2]
  observations_history_priority: time
  clip_obs: 100.0
  clip_actions_upper: {[50.0] * 12}
  rl_kp: {[40, 40, 40] * 4}
  rl_kd: {[1, 1, 1] * 4}
  action_scale: {[0.125, 0.25, 0.25] * 4}
  ang_vel_scale: 0.25
  dof_pos_scale: 1.0
  dof_vel_scale: 0.05
  commands_scale: [2.0, 2.0, 0.25]
  default_dof_pos: {[0.1, 0.8, -1.5, -0.1, 0.8, -1.5] * 2}
  joint_mapping: [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
"""

ONES = [1.0] * 12
UNITREE = f"""
joint_ids_map: [3, 0, 9, 6, 4, 1, 10, 7, 5, 2, 11, 8]
step_dt: 0.02
stiffness: {[20.0, 20.0, 40.0] * 4}
damping: {[1.0] * 11 + [2.0]}
default_joint_pos: [0.1, -0.1, 0.1, -0.1, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]
commands:
  base_velocity: {{ranges: {{lin_vel_x: [-0.5, 1], lin_vel_y: [0, 0], ang_vel_z: [-1, 1]}}}}
actions:
  JointPositionAction:
    clip: {[[-100.0, 100.0]] * 12}
    scale: {[0.25] * 12}
    offset: [0.1, -0.1, 0.1, -0.1, 0.8, 0.8, 1.0, 1.0, -1.5, -1.5, -1.5, -1.5]
observations:
  base_ang_vel: {{params: {{}}, clip: [-100, 100], scale: [0.2, 0.2, 0.2], history_length: 3}}
  projected_gravity: {{params: {{}}, clip: null, scale: null, history_length: 3}}
  velocity_commands: {{params: {{command_name: v}}, clip: null, scale: null, history_length: 3}}
  joint_pos_rel: {{params: {{}}, clip: null, scale: {ONES}, history_length: 3}}
  joint_vel_rel: {{params: {{}}, clip: [-9, 9], scale: {ONES}, history_length: 3}}
  last_action: {{params: {{}}, clip: null, scale: {ONES}, history_length: 3}}
"""


def write(folder, name, text):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


@pytest.fixture
def converted(describe, tmp_path):
    def convert(name, text, *options):
        describe(size=135)
        output = str(tmp_path / "converted.yaml")
        given = ["--weights", str(tmp_path / "tiny.onnx"), "--description", output, *options]
        main(["policy", "convert", write(tmp_path, name, text), *given])
        return load_described(output).description

    return convert


def test_a_config_of_rl_sar_becomes_a_description(converted, tmp_path):
    write(tmp_path, "go2/base.yaml", BASE)
    description = converted("go2/lab/config.yaml", RL_SAR)
    assert (description.robot, description.period) == ("go2", 0.02)
    assert description.joints[:4] == ("FL_hip", "FL_thigh", "FL_calf", "FR_hip")
    assert description.observation[0].scale == (2.0, 2.0, 0.25)
    assert (description.history.order, description.history.by) == ("newest_first", "frame")
    assert description.by_joint("default")[:4].tolist() == [0.1, 0.8, -1.5, -0.1]


@pytest.mark.parametrize(("gym", "by"), [("", "term"), ("  use_gym_history: true\n", "frame")])
def test_a_deploy_yaml_of_unitree_becomes_a_description(converted, refused, tmp_path, gym, by):
    text = UNITREE + gym
    description = converted("params/deploy.yaml", text, "--robot", "go2")
    assert description.joints[:4] == ("FL_hip", "FR_hip", "RL_hip", "RR_hip")
    assert description.by_joint("default").tolist()[:5] == [0.1, 0.8, -1.5, -0.1, 0.8]
    # Gains are in the order of the motors, of which the last one is RL_calf's.
    assert description.by_joint("gains.stiffness").tolist() == [20.0, 20.0, 40.0] * 4
    assert np.flatnonzero(description.by_joint("gains.damping") == 2.0) == JOINTS.index("RL_calf")
    assert (description.history.length, description.history.by) == (3, by)
    assert description.observation[4].clip == (-9.0, 9.0)
    assert description.commands.forward == (-0.5, 1.0)
    # What was there before is replaced only if asked, and by nothing that is refused.
    options = ["--robot", "go2", "--description", str(tmp_path / "converted.yaml")]
    convert = ["policy", "convert", str(tmp_path / "params/deploy.yaml"), *options]
    assert "add --overwrite" in refused(convert)
    weights = ["--weights", str(tmp_path / "none.onnx")]
    assert "no such file" in refused([*convert, "--overwrite", *weights])
    assert load_described(tmp_path / "converted.yaml").description == description


def test_a_description_finds_its_weights_from_a_new_folder_and_replaces_no_other_file(
    describe, refused, tmp_path
):
    describe(size=135)
    config, weights = write(tmp_path, "deploy.yaml", UNITREE), str(tmp_path / "tiny.onnx")
    convert = ["policy", "convert", config, "--robot", "go2", "--weights", weights, "--description"]
    (tmp_path / "link").symlink_to(tmp_path / "a" / "b")
    main([*convert, str(tmp_path / "a" / "b" / "mine.yaml")])
    main([*convert, str(tmp_path / "link" / "other.yaml")])
    for path in (tmp_path / "a" / "b").iterdir():
        assert load_described(path).description.weights == "../../tiny.onnx"
    for path in (config, weights):
        assert "is no description" in refused([*convert, path, "--overwrite"])


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (UNITREE, [], "does not name the robot; give --robot"),
        (UNITREE, ["--robot", "go2"], "does not name the weights; give --weights"),
        (UNITREE.replace("    scale", "    filter: 5\n    scale"), ["--robot", "go2"], "'filter'"),
        (UNITREE.replace("-100.0, 100.0", "-1.0, 1.0"), ["--robot", "go2"], "clip of actions is"),
        (UNITREE.replace("offset: [0.1", "offset: [0.2"), ["--robot", "go2"], "offset differs"),
        (UNITREE.replace("length: 3}", "length: 1}", 1), ["--robot", "go2", "--weights", "{tiny}"],
         "history_length is .*; give one"),
        (UNITREE.replace("last_action", "height_map"), ["--robot", "go2", "--weights", "{tiny}"],
         "unknown observation 'height_map'"),
        (RL_SAR, ["--period", "0.02", "--joints", *JOINTS], "policy.pt: cannot be read, no such"),
        (RL_SAR.replace("rl_kd: [1, ", "rl_kd: ["), ["--period", "0.02", "--joints", *JOINTS],
         "rl_kd has 11 numbers for 12 joints"),
        (RL_SAR, ["--weights", "{tiny}"], "does not name the period; give --period"),
        (RL_SAR.replace("go2/", ""), [], "does not name the robot; give --robot"),
        (RL_SAR.replace("[50.0, 50.0", "[50.0, 20.0"), ["--weights", "{tiny}", "--period", "0.02"],
         "clip_actions_upper is .*; give one number"),
        (RL_SAR.replace("gravity_vec", "phase"), [], "unknown observation 'phase'"),
        ("[1, 2]", [], "no config of a quadruped"),
        (RL_SAR.replace("rl_kp", "kp"),
         ["--weights", "{tiny}", "--period", "0.02", "--joints", *JOINTS], "lacks the key 'rl_kp'"),
    ],
)  # fmt: skip
def test_what_a_config_leaves_out_is_asked_for(describe, tmp_path, refused, text, options, message):
    describe()
    config = write(tmp_path, "config.yaml", text)
    options = [*options, "--description", str(tmp_path / "converted.yaml")]
    options = [option.format(tiny=tmp_path / "tiny.onnx") for option in options]
    assert re.search(message, refused(["policy", "convert", config, *options]))


def steps(*feet):
    """Returns contacts (T, 1, 4) that repeat stances, each written as in FL FR RL RR order."""
    return np.array([[[foot == "1" for foot in stance]] for stance in feet * 20])


@pytest.mark.parametrize(
    ("contact", "gait"),
    [
        (steps("1001", "1001", "1111", "0110", "0110"), "trot"),
        (steps("1010", "1010", "0101", "0101"), "pace"),
        (steps("1100", "1100", "0011", "0011"), "bound"),
        (steps("0111", "1110", "1011", "1101"), "walk"),
        (steps("1001", "0101", "1100", "0011", "1010", "0110"), "none"),
    ],
)
def test_gaits_are_recognized_by_their_contacts(contact, gait):
    assert recognized(contact) == gait
    n_states = {"trot": 2, "pace": 2, "bound": 2, "walk": 4}.get(gait, np.nan)
    stride = len(contact) / 20
    np.testing.assert_allclose(state_steps(gait, contact), stride / n_states, atol=0.06)


def test_a_watched_gait_is_written_and_taken_by_distill(describe, monkeypatch, refused, capsys):
    path, seen = describe(), {"gait": "trot", STATE_STEPS: 8.4}
    monkeypatch.setattr(policy_check, "walked", lambda *_: pd.DataFrame([seen]))
    main(["gait", "--watch", str(path)])
    gait = load_gait(path.with_name("mine_trot.yaml"))
    assert (gait.dwell, gait.transitions[0].when.text) == ((4, 4), "FL & RR & (~FR | ~RL)")
    assert gait.clearance == 0.001
    assert f"--gait {path.parent}/mine_trot.yaml --expert {path}" in capsys.readouterr().out
    assert "mine_trot.yaml: exists" in refused(["gait", "--watch", str(path)])
    seen["gait"] = "none"
    main(["gait", "--watch", str(path)])
    shown = capsys.readouterr().out
    assert f"--gait free --expert {path}" in shown and "no gait is recognized" in shown


def test_a_network_is_measured_watched_and_not_explained_term_by_term(
    describe, refused, tmp_path, capsys
):
    path = describe(("{forward", "{left: [-0.2, 0.2], forward"))
    names = ["--gait", "free", "--policy", str(path)]
    measured = ["--n-samples", "20", "--repeats", "1", "--output", str(tmp_path / "importance")]
    main(["importance", *names, *measured])
    table = pd.read_csv(tmp_path / "importance" / "importances.csv")
    assert {"command yaw", "clock sine", "last_action calf"} <= {*table["group"]}
    assert "1st (paper)" not in pd.read_csv(tmp_path / "importance" / "top_observations.csv")
    assert "see 'glassgait importance'" in refused(["explain page", *names])
    assert "name a student" in refused(["explain", "counterfactual", *names])
    left = ["--output", str(tmp_path / "view"), "--command.left"]
    assert "give -0.2 to 0.2" in refused(["view", *names, *left, "0.3"])
    assert "works only with networks of other" in refused(["view", *left, "0.2"])
    main(["view", *names, "--n-steps", "5", *left, "0.2"])
    shown = capsys.readouterr().out
    assert "m forward" in shown and "rhythm" not in shown


EXTERNAL = Path(__file__).parents[2].joinpath("../shared/external").resolve()
SPEEDS = {"robot_lab": 0.50, "himloco": 0.44, "cts": 0.40, "moe": 0.46}


@pytest.mark.slow
@pytest.mark.skipif(not EXTERNAL.exists(), reason="needs ../shared/external")
@pytest.mark.parametrize("name", SPEEDS)
def test_networks_of_other_projects_walk_as_fast_as_they_were_measured(name, tmp_path):
    # The folder's descriptions are shorter, and use aliases.
    short = yaml.safe_load((EXTERNAL / "descriptions.yaml").read_text())[name]
    legs, kinds = ("FL", "FR", "RL", "RR"), short["default"].items()
    default = {f"{leg}_{kind}": x for kind, row in kinds for leg, x in zip(legs, row, strict=True)}
    plain = short | {
        "robot": "go2",
        "weights": str(EXTERNAL / short["weights"]),
        "observation": [{"term": term, "scale": scale} for term, scale in short["observation"]],
        "default": default,
        "gains": dict(zip(("stiffness", "damping"), short["gains"], strict=True)),
    }
    policy = described(plain, tmp_path / "mine.yaml")
    station = StationConfig(engine="mujoco", time_step=0.002)
    row = walked(policy, station, 8).iloc[0]
    assert (row["falls"], row["gait"]) == (0, "trot")
    assert float(row["speed (m/s)"].split()[-1]) == pytest.approx(SPEEDS[name], abs=0.05)


def test_every_frequent_mistake_is_tried_once(describe):
    description = load_described(describe()).description
    titles = [title for title, _ in variants(description)]
    assert len({repr(variant) for _, variant in variants(description)}) == len(titles) == 7
    assert {"gravity of the other sign", "a yaw command scaled by 1"} <= {*titles}


def test_a_robot_that_stands_is_not_said_to_walk(describe):
    weights = np.zeros((141, 12))
    policy = load_described(describe(weights=weights))
    table = walked(policy, StationConfig(engine="mujoco", time_step=0.005), 1, 200)
    assert table["falls"].tolist()[:5] == [0] * 5
    assert {*table["gait"]} == {"none"}
