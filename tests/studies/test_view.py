"""`glassgait view`: live, as a replay, and bad settings."""

import os
import re
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import yaml

import glassgait.studies.view.live
from glassgait.diagrams.commands import SliderCommand
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import open_meshcat
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.linear import LinearPolicy
from glassgait.studies.cli import main
from glassgait.studies.view.live import play_live

TRUNK = ["drake", "visualizer", "a1", "trunk"]


@pytest.fixture
def live(tmp_path):
    """Starts `glassgait view --live`; gives the process and the server's address."""
    command = [sys.executable, "-m", "glassgait.studies.cli", "view", "--live"]
    with subprocess.Popen(
        [*command, "--output", str(tmp_path)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as process:
        yield process, until_said(process, r"http://localhost:\d+").group()
        process.kill()


def until_said(process, pattern):
    """Waits for a line that the pattern is in."""
    found = (re.search(pattern, line) for line in process.stdout)
    return next(match for match in found if match)


def eventually(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < end:
        time.sleep(0.2)
    assert met


def trunk_place(browser):
    """Reads where the page shows the trunk in the world: x, y and heading."""
    script = "return viewer.scene_tree.find(arguments[0]).object.matrix.elements;"
    matrix = browser.execute_script(script, TRUNK)
    return np.array([matrix[12], matrix[13], np.arctan2(matrix[1], matrix[0])])


def set_slider(browser, name, value):
    """Types a value into a control of the page."""
    label = f"//*[@class='property-name' and text()='{name}']"
    field = browser.find_element("xpath", f"{label}/following-sibling::*//input[@type='text']")
    browser.execute_script("arguments[0].select()", field)
    field.send_keys(f"{value}\n")


def press(browser, name):
    """Presses a button of the page."""
    browser.find_element("xpath", f"//*[@class='property-name' and text()='{name}']").click()


@pytest.mark.slow
def test_live_robot_moves_and_follows_the_sliders_until_it_is_stopped(live, browser, tmp_path):
    process, address = live
    browser.set_window_size(480, 400)
    browser.get(address)
    browser.find_element("xpath", "//*[text()='Open Controls']").click()
    eventually(lambda: trunk_place(browser)[0] > 0.2)
    set_slider(browser, "yaw rate (rad/s)", 1)
    before = trunk_place(browser)[2]
    eventually(lambda: 0.8 < (trunk_place(browser)[2] - before) % (2 * np.pi) < np.pi)
    press(browser, "stop and save")
    seconds = float(until_said(process, r"stopped after ([\d.]+) s").group(1))
    assert process.wait(timeout=60) == 0
    assert seconds > 2.0
    assert {path.suffix for path in tmp_path.iterdir()} == {".html", ".png", ".pdf", ".yaml"}
    replay = (tmp_path / "expert.html").read_text()
    assert "yaw rate" not in replay


def test_live_keeps_the_last_steps_of_all_runs(trot, tmp_path, monkeypatch):
    monkeypatch.setattr(glassgait.studies.view.live, "KEPT_STEPS", 30)
    monkeypatch.setattr(glassgait.studies.view.live, "FALLEN_SECONDS", 0.0)
    usual = signal.getsignal(signal.SIGINT)

    def interrupt():
        while signal.getsignal(signal.SIGINT) is usual:
            time.sleep(0.05)
        time.sleep(3.0)
        os.kill(os.getpid(), signal.SIGINT)

    threading.Thread(target=interrupt, daemon=True).start()
    scenario = Scenario(command=SliderCommand(), sensor_noise=0.0)
    # A policy that throws the robot over.
    names = load_expert("trot").observation_names
    flinging = LinearPolicy("trot", names, np.zeros((12, len(names))), np.full(12, 10.0))
    controller = alone(flinging, load_expert("trot"))
    rollout = play_live(
        trot, controller, scenario, open_meshcat(), tmp_path / "replay.html", seed=0
    )
    assert signal.getsignal(signal.SIGINT) is usual
    assert len(rollout.time) == len(rollout["state"]) == 31
    assert rollout.time[-1] > 0.7
    np.testing.assert_allclose(np.diff(rollout.time), 0.02)
    assert rollout["failures"].any()
    assert (tmp_path / "replay.html").exists()


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["--n-steps", "0"], "n_steps"),
        (["--n-steps", "180001"], "n_steps"),
        (["--seed", "-1"], "seed"),
        (["--seed", "99999999999999999999"], "seed"),
        (["--live", "--n-steps", "150"], "--n-steps"),
        (["--gait", "gallop"], "gait 'gallop'"),
        (["--robot", "."], "is a folder"),
        (["--command.speed", "nan"], "speed"),
        (["--command.yaw-rate", "-9"], "yaw_rate"),
        (["--command.dwell", "0"], "dwell"),
    ],
)
def test_bad_settings_are_refused_before_anything_is_written(refused, tmp_path, arguments, key):
    assert key in refused(["view", *arguments, "--output", str(tmp_path / "shown")])
    assert not (tmp_path / "shown").exists()


def test_a_replay_has_its_settings_beside_it(tmp_path):
    asked = ["--n-steps", "10", "--seed", "7", "--command.speed", "0.3"]
    main(["view", *asked, "--output", str(tmp_path / "hop.html")])
    assert (tmp_path / "hop.html").is_file()
    kept = yaml.safe_load((tmp_path / "hop.yaml").read_text())
    values = (kept["gait"], kept["policy"], kept["n_steps"], kept["seed"])
    assert values == ("trot", "expert", 10, 7)
    assert kept["command"]["speed"] == 0.3


def test_the_folder_of_a_run_and_a_file_are_refused(tmp_path, refused):
    (tmp_path / "config.yaml").write_text("study: train\nsettings: {}\n")
    assert "holds a run" in refused(["view", "--output", str(tmp_path)])
    assert "is a file" in refused(["studio", "--output", str(tmp_path / "config.yaml")])
    assert [path.name for path in tmp_path.iterdir()] == ["config.yaml"]
