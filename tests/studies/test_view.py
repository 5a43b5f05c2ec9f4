"""`glassgait view`: live, as a replay, and bad settings."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from queue import Empty, Queue

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
    """Starts `glassgait view --live`; gives the process, its lines and the server's address."""
    started = []

    def start(*arguments):
        command = [sys.executable, "-m", "glassgait.studies.cli", "view", "--live", *arguments]
        process = subprocess.Popen(
            [*command, "--output", str(tmp_path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        started.append(process)
        lines = Queue()
        threading.Thread(target=read_all, args=(process.stdout, lines)).start()
        address = until_said(lines, r"http://localhost:\d+").group()
        return process, lines, address

    yield start
    for process in started:
        process.kill()
        process.wait()


def read_all(stream, lines):
    for line in stream:
        lines.put(line)


def until_said(lines, pattern, seconds=90.0):
    """Waits for a line that the pattern is in."""
    said, end = "", time.monotonic() + seconds
    while time.monotonic() < end:
        try:
            said += lines.get(timeout=1.0)
        except Empty:
            continue
        if found := re.search(pattern, said):
            return found
    raise AssertionError(f"{pattern!r} was not said: {said}")


def eventually(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not (met := condition()) and time.monotonic() < end:
        time.sleep(0.2)
    assert met


def trunk_place(browser):
    """Reads where the page shows the trunk in the world: x, y and heading."""
    matrix = browser.execute_script(
        "const trunk = viewer.scene_tree.find(arguments[0]).object;return trunk.matrix.elements;",
        TRUNK,
    )
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
    process, lines, address = live()
    browser.set_window_size(480, 400)
    browser.get(address)
    browser.find_element("xpath", "//*[text()='Open Controls']").click()
    eventually(lambda: trunk_place(browser)[0] > 0.2)
    set_slider(browser, "yaw rate (rad/s)", 1)
    before = trunk_place(browser)[2]
    eventually(lambda: 0.8 < (trunk_place(browser)[2] - before) % (2 * np.pi) < np.pi)
    press(browser, "stop and save")
    seconds = float(until_said(lines, r"stopped after ([\d.]+) s").group(1))
    assert process.wait(timeout=60) == 0
    assert seconds > 2.0
    assert {path.suffix for path in tmp_path.iterdir()} == {".html", ".png", ".pdf", ".yaml"}
    replay = (tmp_path / "expert_alone.html").read_text()
    assert "yaw rate" not in replay


def flinging():
    """Makes a policy that throws the robot over."""
    names = load_expert("trot").observation_names
    return LinearPolicy("trot", names, np.zeros((12, len(names))), np.full(12, 10.0))


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
    controller = alone(flinging(), load_expert("trot"))
    rollout = play_live(trot, controller, scenario, open_meshcat(), tmp_path / "replay.html")
    assert signal.getsignal(signal.SIGINT) is usual
    assert len(rollout.time) == len(rollout["state"]) == 31
    assert rollout.time[-1] > 0.7
    np.testing.assert_allclose(np.diff(rollout.time), 0.02)
    assert rollout["failures"].any()
    assert (tmp_path / "replay.html").exists()


@pytest.mark.slow
def test_live_robot_gets_up_after_a_fall_and_an_interrupt_saves(live, tmp_path):
    path = tmp_path / "fling.safetensors"
    flinging().save(path)
    process, lines, _ = live("--policy", str(path))
    for _ in range(2):
        until_said(lines, "back on its feet")
    process.send_signal(signal.SIGINT)
    until_said(lines, "replay, gait diagram and settings written")
    assert process.wait(timeout=60) == 0
    assert (tmp_path / "fling_alone.html").stat().st_size > 500_000


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (["--n-steps", "0"], "n_steps"),
        (["--n-steps", "180001"], "n_steps"),
        (["--seed", "-1"], "seed"),
        (["--seed", "99999999999999999999"], "seed"),
        (["--policy", "symbolic", "--ratio", ""], "alternation ratio"),
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
    main(["view", *asked, "--output", str(tmp_path)])
    kept = yaml.safe_load((tmp_path / "expert_alone.yaml").read_text())
    values = (kept["gait"], kept["policy"], kept["n_steps"], kept["seed"])
    assert values == ("trot", "expert", 10, 7)
    assert kept["command"]["speed"] == 0.3


def test_a_ratio_has_one_name_however_it_is_written(tmp_path):
    command = ["view", "--policy", "symbolic", "--n-steps", "10", "--output", str(tmp_path)]
    main([*command, "--ratio", "1/4"])
    before = {path.name for path in tmp_path.iterdir()}
    main([*command, "--ratio", "0.25"])
    assert {path.name for path in tmp_path.iterdir()} == before
    assert "symbolic_1-4.html" in before


def test_the_folder_of_a_run_is_refused(tmp_path, refused):
    (tmp_path / "config.yaml").write_text("study: train\nsettings: {}\n")
    assert "holds a run" in refused(["view", "--output", str(tmp_path)])
    assert [path.name for path in tmp_path.iterdir()] == ["config.yaml"]
