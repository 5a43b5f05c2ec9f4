"""Every robot that ships: it moves alike in both executions."""

import numpy as np
import pytest

from glassgait.diagrams.scenario import Scenario
from glassgait.diagrams.task import TaskConfig
from glassgait.models.errors import InputError
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import ObservationLayout


def test_a_policy_moves_its_own_robot_and_no_other():
    gait, go2 = load_gait("trot"), load_robot("go2")
    names = ObservationLayout(gait.n_states).names
    weights = np.zeros((quadruped.N_JOINTS, len(names)))
    policy = LinearPolicy("trot", names, weights, np.zeros(quadruped.N_JOINTS), robot=go2)
    assert TaskConfig.of_scenario(gait, Scenario(), policy).robot is go2
    with pytest.raises(InputError, match=r"'a1'.* made for 'go2'"):
        TaskConfig.of_scenario(gait, Scenario(robot="a1"), policy)
    with pytest.raises(InputError, match="'b2'"):
        Scenario(robot="b2")
