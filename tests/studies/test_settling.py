"""The cost of what changes from one stride to the next, and environments side by side."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.policies.controller import alone
from glassgait.models.policies.library import load_expert
from glassgait.models.robots import quadruped
from glassgait.models.task.command import Command
from glassgait.models.task.gait import load_gait
from glassgait.models.task.odometry import Odometry
from glassgait.studies.common.loop_state import NAMES, UNITS
from glassgait.studies.training import settling as settling_module
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.environment import TrainingEnvironment, observed_by_actor
from glassgait.studies.training.joint_environment import JointEnvironment
from glassgait.studies.training.settling import COMPARED, Settling, settling_cost

TROT = load_gait("trot")
WORLDS = DomainRandomization(n_groups=2)
YES, NO = np.array([True]), np.array([False])


def environment(n_robots, seed=0, settling=None):
    config = TrainingConfig(n_robots=n_robots, worlds=WORLDS)
    generator = np.random.default_rng(seed)
    return TrainingEnvironment(
        config, TROT, Odometry(), generator, observes_imu=True, settling=settling
    )


@pytest.fixture(scope="module")
def entering():
    """A robot that enters the machine's first state."""
    state = environment(2).simulator.state.of_robots(np.array([0]))
    return replace(
        state, machine=state.machine._replace(state=np.array([TROT.states.index(TROT.initial)]))
    )


def moved(state, joint_angle):
    plant = state.plant.copy()
    plant[:, quadruped.JOINT_POSITION.start] += joint_angle
    return replace(state, plant=plant)


def test_a_robot_pays_for_what_changed_since_it_last_entered(entering):
    settling = Settling(TROT, 1, weight=3.0)
    assert settling.cost(entering, YES, NO) == 0.0
    assert settling.cost(moved(entering, 0.3), NO, NO) == 0.0
    unit = UNITS[NAMES.index("FR_hip")]
    assert settling.cost(moved(entering, 0.1), YES, NO) == pytest.approx(
        3.0 * 0.1 / unit / len(COMPARED)
    )
    assert settling.cost(moved(entering, 0.1), YES, NO) == 0.0


def test_place_heading_and_height_cost_nothing(entering):
    settling = Settling(TROT, 1, weight=1.0)
    settling.cost(entering, YES, NO)
    plant = entering.plant.copy()
    plant[:, quadruped.POSITION] += [1.0, 2.0, 0.5]
    assert settling.cost(replace(entering, plant=plant), YES, NO) == 0.0


def test_another_command_or_another_episode_is_not_compared(entering):
    settling = Settling(TROT, 1, weight=1.0)
    settling.cost(entering, YES, NO)
    command = Command(entering.command.velocity + 0.1, entering.command.dwell)
    assert settling.cost(replace(entering, command=command), NO, NO) == 0.0
    assert not settling.observed().any()
    assert settling.cost(replace(moved(entering, 0.1), command=command), YES, NO) == 0.0
    settling.cost(entering, YES, NO)
    assert settling.cost(moved(entering, 0.1), YES, YES) == 0.0
    assert not settling.observed().any()
    assert settling.cost(moved(entering, 0.2), YES, NO) == 0.0


def test_the_critic_observes_the_last_stride_and_whether_it_is_paid_for(entering):
    paying, free = Settling(TROT, 1, weight=1.0), Settling(TROT, 1, weight=0.0)
    for settling in (paying, free):
        settling.cost(entering, YES, NO)
    own, other = paying.observed(), free.observed()
    assert own.shape == (1, 1 + len(COMPARED))
    assert (own[:, 0], other[:, 0]) == (1.0, 0.0)
    np.testing.assert_array_equal(own[:, 1:], other[:, 1:])
    assert own[:, 1:].any()


def test_what_is_paid_is_taken_off_the_reward():
    expert = load_expert("trot")

    def act(observations):
        actions = expert(observed_by_actor(observations).numpy().astype(float))
        return torch.from_numpy(actions).float()

    costly, free = environment(4, settling=Settling(TROT, 4, 50.0)), environment(4)
    paid = 0.0
    for (_, own), (_, other) in zip(costly.play(act, 60), free.play(act, 60), strict=True):
        cost = torch.from_numpy(own.settling_cost * TrainingConfig().ppo.reward_scale).float()
        torch.testing.assert_close(own.rewards, other.rewards - cost)
        assert other.settling_cost is None
        paid += own.settling_cost.sum()
    assert paid > 0.0
    sizes = [step.observations["privileged"].shape[1] for step in (own, other)]
    assert sizes[0] == sizes[1] + 1 + len(COMPARED)


def test_noise_makes_a_gait_pay():
    expert = load_expert("trot")
    size = {"n_robots": 2, "n_steps": 200, "seed": 3}
    calm = settling_cost(TROT, alone(expert), 1.0, **size)
    assert settling_cost(TROT, alone(expert), 2.0, **size) == pytest.approx(2.0 * calm)
    assert calm > 0.0


def test_a_checkpoint_remembers_the_last_stride(entering):
    settling, resumed = Settling(TROT, 1, weight=1.0), Settling(TROT, 1, weight=1.0)
    settling.cost(entering, YES, NO)
    resumed.restore(settling.to_arrays())
    later = moved(entering, 0.1)
    assert resumed.cost(later, YES, NO) == settling.cost(later, YES, NO) > 0.0
    with pytest.raises(ValueError, match="robots"):
        Settling(TROT, 2, weight=1.0).restore(settling.to_arrays())


def test_candidates_are_compared_without_noise(monkeypatch):
    scenarios = []
    monkeypatch.setattr(
        settling_module,
        "episode",
        lambda gait, controller, scenario, **_: scenarios.append(scenario),
    )
    settling_cost(TROT, alone(load_expert("trot")), 1.0, n_robots=2, n_steps=10, seed=0)
    assert scenarios[0].randomization().observation_noise == 0.0


def test_environments_side_by_side_step_as_each_alone():
    joint = JointEnvironment([environment(2, seed=1), environment(4, seed=2)])
    parts = [environment(2, seed=1), environment(4, seed=2)]
    generator = torch.Generator().manual_seed(0)
    for _ in range(5):
        actions = torch.randn((6, 12), generator=generator)
        step = joint.step(actions)
        first, second = parts[0].step(actions[:2]), parts[1].step(actions[2:])
        for name in ("rewards", "dones", "time_outs"):
            both = torch.cat([getattr(first, name), getattr(second, name)])
            assert torch.equal(getattr(step, name), both)
        for group, own in step.observations.items():
            both = torch.cat([first.observations[group], second.observations[group]])
            assert torch.equal(own, both)
        np.testing.assert_array_equal(
            step.task.reward, np.concatenate([first.task.reward, second.task.reward])
        )


def test_environments_side_by_side_share_their_demands():
    joint = JointEnvironment([environment(2), environment(4)])
    joint.difficulty, joint.hardship = 0.4, 0.7
    assert [part.difficulty for part in joint.parts] == [0.4, 0.4]
    assert [part.hardship for part in joint.parts] == [0.7, 0.7]
    assert (joint.difficulty, joint.hardship) == (0.4, 0.7)
