"""The examples: each runs, and what it prints is true."""

import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import tyro
from pydrake.systems.analysis import Simulator

from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator
from glassgait.diagrams.scenario import Scenario
from glassgait.models.policies.library import load_student
from glassgait.studies.examples import build_and_log, stopping
from glassgait.studies.examples.own_leaf_system import PowerMeter
from glassgait.studies.examples.policy_in_own_diagram import make_diagram
from glassgait.studies.examples.train_in_gym import train

EXAMPLES = Path(build_and_log.__file__).parent


@pytest.fixture
def printed(capsys, monkeypatch):
    """Runs an example as a script, and returns what it printed."""

    def run(name):
        monkeypatch.setattr("sys.argv", [name])
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        return capsys.readouterr().out

    return run


def numbers(pattern, text):
    return [[float(number) for number in found] for found in re.findall(pattern, text)]


def test_logged_robots_keep_nearly_to_the_command_and_stay_up(printed):
    out = printed("build_and_log")
    speeds = np.array(numbers(r"robot \d: (\S+) m/s, (\S+) m/s commanded", out))
    assert speeds.shape == (3, 2)
    assert np.all(np.abs(speeds[:, 0] - 0.5) < 0.1)
    # Each has noise of its own.
    assert len(set(speeds[:, 0])) > 1
    assert "falls: 0 of 3" in out


@pytest.mark.slow
def test_the_speeds_are_drawn_where_asked(tmp_path):
    build_and_log.main(figure=tmp_path / "speed.png")
    assert (tmp_path / "speed.png").stat().st_size > 1000


def test_the_robot_of_a_users_diagram_comes_forward_on_its_feet(printed):
    out = printed("policy_in_own_diagram")
    ((ahead, aside, height),) = numbers(r"(\S+) m ahead, (\S+) m aside, (\S+) m high", out)
    assert 1.5 < ahead < 3.0
    assert abs(aside) < 1.0
    # It trots as low as its expert, and falls below 0.20 m.
    assert 0.24 < height < 0.28


def test_ones_own_diagram_moves_as_the_loop_does(trot):
    command = FixedCommand(speed=0.5, dwell=8)
    scenario = Scenario(command=command, sensor_noise=0.0, true_body_state=True)
    loop = MakeLocomotion(trot, scenario, policy=load_student("trot", "statewise_linear"))
    own = make_diagram()
    ours, theirs = Simulator(own), make_simulator(loop)
    for simulator in (ours, theirs):
        simulator.AdvanceTo(1.0)
    np.testing.assert_allclose(
        own.GetOutputPort("state").Eval(ours.get_context()),
        loop.GetOutputPort("state").Eval(theirs.get_context()),
        atol=1e-6,
    )


def test_the_planner_sends_the_robot_round_its_corners(printed):
    out = printed("planner")
    times = [time for _, time in numbers(r"waypoint (\d) after (\S+) s", out)]
    assert len(times) == 3
    assert times == sorted(times)
    ((time, x, y),) = numbers(r"after (\S+) s at (\S+) m, (\S+) m", out)
    assert time == 10.0
    assert np.hypot(x - 2.5, y - 2.5) < 0.5


@pytest.mark.slow
def test_harder_pushes_fell_more_robots(printed):
    rows = numbers(r"(\S+) m/s: (\d+) of 8 fall, (\S+) degrees", printed("push_robots"))
    assert [row[0] for row in rows] == [0.0, 0.5, 1.0, 1.5, 2.0]
    falls = [row[1] for row in rows]
    assert falls == sorted(falls) and falls[0] == 0.0
    # Pushes that all survive make them lean.
    assert falls[1] == 0.0 and rows[1][2] > rows[0][2] > 0.0


def test_transport_costs_what_legged_robots_cost(printed):
    out = printed("own_leaf_system")
    rows = numbers(r"\w+: (\S+) W, (\S+) m, cost of transport (\S+)", out)
    assert len(rows) == 3
    for power, distance, cost in rows:
        assert distance > 1
        assert cost == pytest.approx(5 * power / (9.81 * 12.776 * distance), rel=0.05)
        assert 0.1 < cost < 3


def test_the_meter_counts_driving_joints_and_not_braking_ones(fix_inputs, latch, standing):
    work = {}
    for name, velocity in (("drives", 1.0), ("brakes", -1.0)):
        meter = PowerMeter()
        state = standing.copy()
        state[25] = velocity
        # A unit of action asks for 10 N·m at the first joint, less 1 N·m of damping by rad/s.
        context = fix_inputs(meter, state=state, actions=np.eye(12)[0])
        latch(meter, context)
        (work[name],) = meter.get_output_port().Eval(context)
    assert work == pytest.approx({"drives": 0.02 * 9.0, "brakes": 0.0})


@pytest.mark.slow
def test_a_linear_policy_learns_in_gymnasiums_loop(capsys):
    before, after, expert = tyro.cli(train, args=["--seconds", "10", "--num-envs", "16"])
    assert before < 0.05
    assert 3 * before < after < expert
    assert (
        f"{before:.3f} before, {after:.3f} after, {expert:.3f} expert's" in capsys.readouterr().out
    )


def test_an_experiment_of_ones_own_runs_from_any_folder_and_resumes(tmp_path, monkeypatch):
    script = Path(shutil.copy(stopping.__file__, tmp_path / "mine.py"))
    command = [script.name, "--policy", "expert", "gbm", "--n-robots", "2"]
    command += ["--n-seeds", "2", "--n-workers", "1"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", command)
    runpy.run_path(script.name, run_name="__main__")
    folder = tmp_path / "runs" / "stopping" / "trot_expert_gbm"
    table = pd.read_csv(folder / "stopping.csv")
    assert table[["policy", "robots"]].to_numpy().tolist() == [["expert", 4], ["gbm", 4]]
    assert table["mean"].between(0.02, 2.0).all() and (table["falls"] == 0).all()
    before = (folder / "stopping.csv").read_bytes()
    (folder / "stopping.csv").unlink()
    cases = sorted((folder / "cases").iterdir())
    cases[0].unlink()
    monkeypatch.setattr("sys.argv", [*command, "--resume"])
    runpy.run_path(script.name, run_name="__main__")
    assert (folder / "stopping.csv").read_bytes() == before
    assert sorted((folder / "cases").iterdir()) == cases
