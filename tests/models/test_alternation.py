"""Who acts when."""

import numpy as np
import pytest

from glassgait.models.task.alternation import expert_acts, ratio_title


@pytest.mark.parametrize(
    ("period", "acts"),
    [(1, [1, 1, 1, 1, 1, 1]), (2, [1, 0, 1, 0, 1, 0]), (4, [1, 0, 0, 0, 1, 0]), (0, [0] * 6)],
)
def test_expert_acts_every_nth_step(period, acts):
    np.testing.assert_array_equal(expert_acts(np.arange(6), period), np.array(acts, dtype=bool))


def test_ratios_are_named_as_in_the_paper():
    assert [ratio_title(period) for period in (1, 2, 8, 0)] == ["1", "1/2", "1/8", "0"]
