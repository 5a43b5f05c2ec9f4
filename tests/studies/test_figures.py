"""Figures of training and of gaits."""

import ctypes.util
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

import glassgait.studies.view.stills
from glassgait.diagrams.commands import FixedCommand
from glassgait.diagrams.locomotion import MakeLocomotion
from glassgait.diagrams.rollout import make_simulator, record
from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.visualization import Camera
from glassgait.models.errors import InputError
from glassgait.models.policies.library import EXPERT_DIRECTORY, load_expert
from glassgait.models.policies.policy import Contributions
from glassgait.models.robots import kinematics, quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.figures import save_figure
from glassgait.studies.evaluation.figures import fall_map, return_figure
from glassgait.studies.importance.figures import contribution_figure, importance_map
from glassgait.studies.training.figures import learning_curves
from glassgait.studies.view.stills import gait_strip, last_cycle

A1 = load_robot()


HAS_EGL = ctypes.util.find_library("EGL") is not None


@pytest.fixture(scope="module")
def rollout():
    scenario = Scenario(command=FixedCommand(dwell=8), sensor_noise=0.0)
    diagram = MakeLocomotion(load_gait("trot"), scenario, policy=load_expert("trot"))
    return record(make_simulator(diagram), 100)


class GreyCamera:
    def __init__(self, robot, width, height):
        self._picture = np.full((height, width, 3), 128, dtype=np.uint8)

    def take(self, state):
        return self._picture


def test_last_cycle_lasts_as_long_as_the_machine_stays_in_its_states(rollout):
    start, stop = last_cycle(rollout, load_gait("trot"))
    states = rollout["rm_state"].argmax(axis=1)
    assert states[start - 1] == 1
    assert (states[start], states[stop - 1], states[stop]) == (0, 1, 0)
    assert 16 <= stop - start <= 20


HOSTILE = r"a$\frac$b"


def titled_figures(curve):
    """Draws every figure that takes a title from tables with hostile names."""
    measures = {"return": 9.0, "plain_return": 9.0, "rhythm": 1.0, "going_speed_error": 0.1}
    measures |= {"yaw_rate_error": 0.1, "fell": False}
    who = [("expert", 1.0), ("linear", 0.5), ("linear", 0.0)]
    scores = pd.DataFrame(who, columns=pd.Index(["policy", "ratio"])).assign(**measures)
    world = {"policy": "expert", "scenario": "nominal", "world": HOSTILE, "robots": 2}
    falls = pd.DataFrame([{**world, "falls": 1, "fall_rate": 0.5}])
    parts = Contributions((HOSTILE, "b"), np.array([1.0, 2.0]))
    return {
        "return": return_figure(scores, HOSTILE),
        "contributions": contribution_figure(parts, HOSTILE),
        "map": importance_map(np.ones((12, 2)), (HOSTILE, "b"), HOSTILE),
        "falls": fall_map({HOSTILE: falls}),
        "learning": learning_curves({HOSTILE: curve}),
    }


def test_dollars_in_names_are_no_mathematics(curve, tmp_path):
    figures = titled_figures(curve)
    for name, figure in figures.items():
        assert any(HOSTILE in text.get_text() for text in figure.findobj(Text))
        save_figure(figure, tmp_path / name, ("png",))
    assert len(list(tmp_path.iterdir())) == len(figures)


def test_a_rollout_without_a_cycle_is_refused(rollout):
    standing = {**rollout, "rm_state": np.tile([1.0, 0.0], (101, 1))}
    with pytest.raises(InputError, match="no whole cycle"):
        last_cycle(type(rollout)(rollout.time, standing), load_gait("trot"))


def test_strip_shows_its_stills_above_the_contacts(rollout, monkeypatch, tmp_path):
    monkeypatch.setattr(glassgait.studies.view.stills, "Camera", GreyCamera)
    figure = gait_strip(A1, rollout, load_gait("trot"), n_stills=6)
    *stills, contacts = figure.axes
    assert len(stills) == 6
    assert all(len(still.get_images()) == 1 for still in stills)
    assert [label.get_text() for label in contacts.get_yticklabels()] == list(quadruped.LEGS)
    save_figure(figure, tmp_path / "strip")
    assert {path.suffix for path in tmp_path.iterdir()} == {".png", ".pdf"}


@pytest.mark.skipif(not HAS_EGL, reason="rendering needs EGL (Debian: libegl1, libgl1-mesa-dri)")
def test_camera_sees_the_robot_and_follows_it():
    camera = Camera(A1, 96, 64)
    standing = kinematics.standing_state(A1)
    further = standing.copy()
    # Two tiles on, the ground looks the same again.
    further[quadruped.POSITION][0] += 1.0
    here, there = camera.take(standing), camera.take(further)
    assert here.shape == (64, 96, 3)
    assert (here.max(axis=2) < 60).mean() > 0.02
    assert np.abs(here.astype(int) - there).mean() < 2.0


@pytest.fixture
def curve():
    return pd.read_csv(Path(EXPERT_DIRECTORY) / "trot.csv")
