"""Gymnasium's two faces of the task: one robot in the systems diagram, and many in batch.

Importing this module registers `glassgait/Locomotion-v0`::

    import gymnasium
    import glassgait.diagrams.gym

    gymnasium.register_envs(glassgait.diagrams.gym)  # does nothing, but linters see a use
    env = gymnasium.make("glassgait/Locomotion-v0", gait="trot")
    envs = gymnasium.make_vec("glassgait/Locomotion-v0", num_envs=16, gait="trot")

`gymnasium.make("glassgait.diagrams.gym:glassgait/Locomotion-v0")` imports it by itself.
"""

import gymnasium

from glassgait.diagrams.gym.single import LocomotionEnv
from glassgait.diagrams.gym.spaces import ActionSpace, action_space, observation_space
from glassgait.diagrams.gym.vector import LocomotionVectorEnv
from glassgait.models.task import EPISODE_STEPS

__all__ = [
    "ENVIRONMENT_ID",
    "ActionSpace",
    "LocomotionEnv",
    "LocomotionVectorEnv",
    "action_space",
    "observation_space",
]

ENVIRONMENT_ID = "glassgait/Locomotion-v0"

gymnasium.register(
    ENVIRONMENT_ID,
    entry_point=f"{__name__}:LocomotionEnv",
    vector_entry_point=f"{__name__}:LocomotionVectorEnv",
    max_episode_steps=EPISODE_STEPS,
)
