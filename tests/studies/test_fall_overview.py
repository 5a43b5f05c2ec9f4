"""The maps of several gaits side by side, and the command that draws them."""

import pandas as pd
import pytest

from glassgait.studies.common.sweep import WorkersConfig
from glassgait.studies.evaluation.fall_map import fall_overview
from glassgait.studies.evaluation.scenarios import Scenarios


def table_of(falls, robots=10):
    rows = [
        {
            "scenario": world,
            "world": world,
            "policy": policy,
            "falls": count,
            "robots": robots,
            "fall_rate": count / robots,
        }
        for (world, policy), count in falls.items()
    ]
    return pd.DataFrame(rows)


def test_gaits_stand_side_by_side_and_share_their_rows():
    trot = table_of({("training", "expert"): 0, ("ice", "expert"): 1, ("ice", "gbm"): 2})
    pace = table_of({("training", "expert"): 9, ("ice", "expert"): 3}, robots=20)
    figure = fall_overview({"trot": trot, "three_one": pace})
    first, second = figure.axes
    assert [axes.get_title() for axes in figure.axes] == ["trot", "three-one"]
    # Falls of the training world are a greater share under the second gait's expert.
    assert [text.get_text() for text in second.texts] == ["9", "3"]
    assert [label.get_text() for label in first.get_yticklabels()] == [
        "training (10 robots)",
        "ice (10 robots)",
    ]
    assert [label.get_text() for label in first.get_xticklabels()] == ["Neural expert", "GBM"]
    hatched = [cell for cell in first.patches if cell.get_hatch()]
    assert len(hatched) == 1


def test_command_draws_all_its_gaits(tmp_path):
    Scenarios(
        gait=("trot", "pace"),
        policy=("expert", "gbm"),
        scenario=("training",),
        n_robots=2,
        n_steps=10,
        workers=WorkersConfig(n_workers=1),
        output=tmp_path / "run",
    ).run()
    drawn = {path.stem for path in (tmp_path / "run").glob("*.png")}
    assert drawn == {"scenarios", "scenarios_trot", "scenarios_pace"}
    whole = pd.read_csv(tmp_path / "run" / "scenarios.csv")
    assert whole["gait"].tolist() == ["trot", "trot", "pace", "pace"]


@pytest.mark.parametrize("missing", [True, False])
def test_missing_cells_are_reported(missing):
    falls = {("training", "expert"): 0, ("ice", "expert"): 1, ("ice", "gbm"): 2}
    if not missing:
        falls["training", "gbm"] = 0
    caption = fall_overview({"trot": table_of(falls)}).get_supxlabel()
    assert ("hatched" in caption) == missing
