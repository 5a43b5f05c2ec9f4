"""Convergence: what the drop test shows, and its figure."""

import pandas as pd
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.station import StationConfig
from glassgait.models.robots.library import load_robot
from glassgait.studies.common.figures import save_figure
from glassgait.studies.reproduction.convergence import (
    CENIC,
    DRAKES_RELAXATION_TIME,
    VARIANTS,
    convergence_figure,
    drop_robot,
)


def drop(**station):
    accuracy = station.pop("accuracy", None)
    return drop_robot(load_robot(), Scenario("dropped", StationConfig(**station), accuracy))


@pytest.fixture(scope="module")
def converged():
    return drop(time_step=0.001, contact_solver="similar")


def test_training_physics_lands_like_the_converged_solvers(converged):
    training = drop()
    cenic = drop(time_step=0.0, accuracy=1e-5)
    for landed in (training, cenic):
        assert landed.stance == pytest.approx(converged.stance, abs=1e-3)
        assert landed.height == pytest.approx(converged.height, abs=1e-3)


def test_loose_lagged_friction_lets_the_feet_slide_apart(converged):
    assert drop(contact_solver="lagged").stance > converged.stance + 0.05


def test_drakes_relaxation_time_leaves_the_robot_in_the_ground(converged):
    assert drop(relaxation_time=DRAKES_RELAXATION_TIME).height < converged.height - 0.004


def test_figure_shows_every_family(tmp_path):
    results = pd.DataFrame(
        [
            {
                "family": variant.family,
                "resolution": variant.resolution,
                "stance": 0.3,
                "height": 0.26,
                "survived": 10.0,
                "going_speed_error": 0.05,
                "yaw_rate_error": 0.1,
            }
            for variant in VARIANTS
        ]
    )
    figure = convergence_figure(results)
    drawn = {line.get_label() for axes in figure.axes for line in axes.get_lines()}
    assert drawn == {variant.family for variant in VARIANTS}
    assert CENIC in drawn
    save_figure(figure, tmp_path / "convergence")
    assert (tmp_path / "convergence.pdf").exists()
