"""Trains a linear policy in gymnasium's vector environment within a minute.

    python -m glassgait.studies.examples.train_in_gym --seconds 45

The policy imitates the shipped expert by DAgger: the student acts, the expert labels the student's
observations, and a least-squares fit uses all labels. Learning from the reward takes millions of
control steps, hours on two cores; see `glassgait train`.
"""

import time

import gymnasium
import numpy as np
import tyro

import glassgait.diagrams.gym
from glassgait.models import load_expert

gymnasium.register_envs(glassgait.diagrams.gym)


def train(seconds: float = 45.0, num_envs: int = 32) -> tuple[float, float, float]:
    """Trains for a time (s), and returns mean rewards of a step: before, after, the expert's."""
    envs = gymnasium.make_vec("glassgait/Locomotion-v0", num_envs=num_envs, gait="trot")
    expert = load_expert("trot")

    def with_one(observations):
        return np.hstack([observations, np.ones((num_envs, 1))])

    def student(observations):
        return np.clip(with_one(observations) @ weights, -8.0, 8.0)

    def score(policy):
        observations, _ = envs.reset(seed=1)
        rewards = []
        for _ in range(200):
            observations, reward, *_ = envs.step(policy(observations))
            rewards.append(reward)
        return float(np.mean(rewards))

    # The normal equations of a slightly regularised least squares fit.
    inputs = with_one(envs.reset(seed=0)[0])
    products, targets = 0.01 * np.eye(inputs.shape[1]), np.zeros((inputs.shape[1], 12))
    weights = np.zeros_like(targets)
    before, deadline = score(student), time.monotonic() + seconds

    # The student acts for 25 control steps between two fits.
    observations, _ = envs.reset(seed=0)
    while time.monotonic() < deadline:
        for _ in range(25):
            inputs = with_one(observations)
            products += inputs.T @ inputs
            targets += inputs.T @ expert(observations)
            observations, *_ = envs.step(student(observations))
        weights = np.linalg.solve(products, targets)
    after, best = score(student), score(expert)
    envs.close()
    print(f"reward of a control step: {before:.3f} before, {after:.3f} after, {best:.3f} expert's")
    return before, after, best


if __name__ == "__main__":
    tyro.cli(train)
