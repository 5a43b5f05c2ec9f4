"""The examples do what they say."""

import pytest
import tyro

from glassgait.studies.examples.train_in_gym import train


@pytest.mark.slow
def test_a_linear_policy_learns_in_gymnasiums_loop(capsys):
    before, after, expert = tyro.cli(train, args=["--seconds", "10", "--num-envs", "16"])
    assert before < 0.05
    assert 3 * before < after < expert
    assert (
        f"{before:.3f} before, {after:.3f} after, {expert:.3f} expert's" in capsys.readouterr().out
    )
