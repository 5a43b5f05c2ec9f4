"""Figures of training and of gaits."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.text import Text

from glassgait.models.policies.library import EXPERT_DIRECTORY
from glassgait.models.policies.policy import Contributions
from glassgait.studies.common.figures import save_figure
from glassgait.studies.evaluation.figures import fall_map, return_figure
from glassgait.studies.importance.figures import contribution_figure, importance_map
from glassgait.studies.training.figures import learning_curves

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


@pytest.fixture
def curve():
    return pd.read_csv(Path(EXPERT_DIRECTORY) / "trot.csv")
