"""The stride map: robots that go on as they were asked, orbits, words, and the command."""

import json

import numpy as np
import pandas as pd
import pytest

from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_student
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.studies.cli import main
from glassgait.studies.common.loop_state import NAMES, UNITS
from glassgait.studies.evaluation import stride_analysis as analysis
from glassgait.studies.evaluation import strides as strides_module
from glassgait.studies.evaluation.stability import (
    mode_text,
    prediction_table,
    stability_table,
)
from glassgait.studies.evaluation.stability_figures import believed, radius_error, stability_figure
from glassgait.studies.evaluation.stride_analysis import find_orbits
from glassgait.studies.evaluation.strides import FIRST_STEPS, StrideMap

TROT = load_gait("trot")
COMMAND = Command(np.array([[0.5, 0.0]]), np.array([8.0]))


@pytest.fixture(scope="module")
def strides(expert):
    return StrideMap(TROT, alone(expert), COMMAND)


@pytest.fixture(scope="module")
def entered(strides):
    """The expert's trot, just after it entered the machine's first state."""
    return strides.first_points()


def test_a_trotting_robot_enters_again_after_two_dwells(strides, entered):
    assert len(UNITS) == len(NAMES) == 45
    # Odometry remembers 15 numbers more.
    assert entered.shape == (1, 60) and len(strides.units) == len(strides.names) == 60
    done = strides.stride(entered, np.array([0]))
    assert done.n_steps.tolist() == [16]
    # It walks: a stride changes little, where one that fell would change all.
    assert np.abs(done.images - entered).max() < 2.0


def test_a_stride_is_the_same_again_and_in_any_company(strides, entered):
    problems = np.zeros(3, dtype=np.int64)
    apart = strides.stride(entered, problems[:1]).images
    together = strides.stride(
        np.concatenate([entered + 0.1, np.full_like(entered, np.nan), entered]), problems
    )
    # Matrices are multiplied in another order, no more.
    assert together.images[2] == pytest.approx(apart[0], abs=1e-9)
    assert (strides.stride(entered, problems[:1]).images == apart).all()
    assert np.isnan(together.images[1]).all() and together.n_steps[1] == 0
    assert (together.images[0] != apart[0]).any()


def test_odometry_is_part_of_the_map_where_it_is_in_the_loop(odometry_expert, monkeypatch):
    remembering = StrideMap(TROT, alone(odometry_expert), COMMAND)
    first = remembering.first_points()
    assert first.shape == (1, 60) and len(remembering.names) == len(remembering.units) == 60
    image = remembering(first, np.zeros(1, dtype=np.int64))
    # The robot that was never set anew comes to the same point, but for its quaternion's length.
    monkeypatch.setattr(strides_module, "FIRST_STEPS", FIRST_STEPS + 16)
    np.testing.assert_allclose(remembering.first_points(), image, atol=1e-3)
    first[0, remembering.names.index("odometry forward speed")] += 1.0
    assert np.abs(remembering(first, np.zeros(1, dtype=np.int64)) - image).max() > 0.05


def test_the_previous_action_is_remembered(strides, entered):
    other = entered.copy()
    other[0, -quadruped.N_JOINTS] += 0.5
    both = strides(np.concatenate([entered, other]), np.zeros(2, dtype=np.int64))
    assert (both[0] != both[1]).any()


def test_a_robot_that_stands_has_no_stride(other_expert):
    still = StrideMap(TROT, alone(other_expert), COMMAND)
    assert np.isnan(still.first_points()).all()
    (record,) = analysis.analyse(still, n_strides=2, step_sizes=(1e-3, 1e-2), seed=0)
    assert record["period"] == -1 and not record["fixed"]
    table = stability_table({"expert": [record]})
    assert table["without noise the gait"].tolist() == ["falls, or leaves the gait"]
    assert prediction_table({"expert": [record]}).empty
    assert stability_figure({"expert": [record]}, "Trot") is not None


def test_policies_of_steps_are_distinguished_from_those_with_derivatives(expert, strides):
    def stepwise(kind):
        walker = alone(load_student("trot", kind), expert)
        return StrideMap(TROT, walker, COMMAND).is_stepwise

    assert stepwise("gbm") and stepwise("ebm")
    assert not stepwise("sparse_formula") and not strides.is_stepwise


def logistic(points, problems):
    """One map with four fates: fixed, of period 2, chaotic, and without an image."""
    rates = np.array([2.5, 3.2, 3.9, np.nan])[problems, None]
    return rates * points * (1.0 - points)


def test_orbits_are_distinguished_by_where_they_settle():
    orbits = find_orbits(logistic, np.full((4, 1), 0.3), n_strides=300, differentiable=True)
    assert orbits.periods.tolist() == [1, 2, 0, -1]
    # The fixed point 1 - 1/r is found whether it attracts or not.
    assert orbits.fixed[:3, 0] == pytest.approx(1.0 - 1.0 / np.array([2.5, 3.2, 3.9]), abs=1e-5)
    assert np.isnan(orbits.fixed[3]).all()
    assert orbits.sway[0] < 1e-6 < orbits.sway[1] < orbits.sway[2]


def test_without_derivatives_no_fixed_point_is_looked_for():
    orbits = find_orbits(logistic, np.full((4, 1), 0.3), n_strides=50, differentiable=False)
    assert orbits.periods[0] == 1 and np.isnan(orbits.fixed).all()


def test_a_radius_is_believed_where_step_sizes_agree():
    sure, unsure = {"radius": 0.5, "radii": [0.5, 0.504]}, {"radius": 0.5, "radii": [0.5, 0.7]}
    assert radius_error(unsure) == pytest.approx(0.1)
    assert believed(sure) and not believed(unsure) and not believed({})
    assert not believed({"radius": 0.5, "radii": [0.5, float("nan")]})


def test_modes_are_named_by_what_takes_part_most():
    text = mode_text({"pitch": 0.4, "roll": 0.3, "leg FR": 0.2, "yaw": 0.1})
    assert text == "pitch 40 %, roll 30 %, leg FR 20 %"
    assert mode_text({"pitch": 0.05}) == "–"


@pytest.mark.parametrize(("rate", "text"), [(0.6, 0.6), (1.1, 1.1)])
def test_factors_are_read_off_amplitudes(rate, text):
    assert analysis._factor(2.0 * rate ** np.arange(11)) == pytest.approx(text)


def test_a_decay_is_read_off_until_it_is_gone():
    amplitudes = np.maximum(0.1 ** np.arange(11), 1e-6)
    assert analysis._factor(amplitudes) == pytest.approx(0.1)
    assert np.isnan(analysis._factor(np.array([1.0, 0.0, 0.0, 0.0])))


@pytest.fixture(scope="module")
def records(strides):
    """What is found of the expert, with few strides and differences."""
    few = {"N_PAIRS": 60, "N_GROWTH": 2, "N_GROWTH_LEFT_OUT": 0, "N_DECAY": 3}
    with pytest.MonkeyPatch.context() as patch:
        for name, value in few.items():
            patch.setattr(analysis, name, value)
        return analysis.analyse(strides, n_strides=6, step_sizes=(1e-3, 1e-2), seed=0)


@pytest.mark.slow
def test_small_pushes_of_the_experts_trot_fade_as_its_slowest_mode_says(records):
    (record,) = records
    assert believed(record) and record["radius"] < 1.0 and record["residual"] < 1e-5
    assert (record["rows"], record["other_steps"], record["lost"]) == (240, 0, 0)
    assert record["decays"][0] == pytest.approx(record["radius"], rel=0.1)
    assert sum(record["parts"].values()) == pytest.approx(1.0)


@pytest.fixture
def run(tmp_path, monkeypatch, records):
    """Runs the command with what was found once; the second policy's radius is unknown."""
    unknown = {"radii": [0.4, 0.8]}
    found = {True: records, False: [record | unknown for record in records]}

    def start(*more, output="run", last=2):
        asked = []

        def again(strides, **options):
            asked.append(strides)
            if len(asked) > last:
                raise KeyboardInterrupt
            return found[strides.controller.student is None]

        monkeypatch.setattr("glassgait.studies.evaluation.stability.analyse", again)
        folder = tmp_path / output
        commands = ["--yaw-rates", "0", "--speeds", "0.5", "--dwells", "8"]
        policies = ["--policy", "expert", "sparse_formula", "--output", str(folder)]
        policies += ["--n-workers", "1"]
        main(["evaluate", "stability", *commands, *policies, *more])
        return folder, len(asked)

    return start


@pytest.mark.slow
def test_an_interrupted_run_is_resumed_to_the_same_tables(run):
    folder, _ = run()
    table = pd.read_csv(folder / "stability.csv")
    assert table["policy"].tolist() == ["Neural expert", "Page of formulas"]
    assert pd.read_csv(folder / "summary.csv")["fixed points"].tolist() == ["1 of 1", "0 of 1"]
    assert pd.read_csv(folder / "prediction.csv")["within 10 % up to (m/s)"].notna().all()
    assert (folder / "stability.png").stat().st_size > 10_000
    assert set(json.loads((folder / "metrics.json").read_text())) == {"expert", "sparse_formula"}
    with pytest.raises(SystemExit):
        run(output="again", last=1)
    again, n_asked = run("--resume", output="again")
    assert n_asked == 1
    for name in ("stability.csv", "prediction.csv", "summary.csv", "metrics.json"):
        assert (again / name).read_bytes() == (folder / name).read_bytes()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--speeds", "1.5", "--policy", "expert"], "speed is 1.5"),
        (["--dwells", "30", "--policy", "expert"], "dwell is 30"),
        (["--policy", "nobody"], "--policy 'nobody'"),
        (["--step-sizes", "1e-3"], "step_sizes"),
        (["--step-sizes", "0", "0.1"], "step_sizes"),
        (["--gait", "trot", "pace", "--policy", "mine.formulas"], "several gaits take no files"),
    ],
)
def test_what_cannot_be_is_refused(arguments, text, refused, tmp_path):
    folder = tmp_path / "run"
    assert text in refused(["evaluate", "stability", *arguments, "--output", str(folder)])
    assert not folder.exists()
