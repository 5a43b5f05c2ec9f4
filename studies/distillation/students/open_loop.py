"""The open loop: the mean action of each moment of the machine, whatever the sensors say."""

import numpy as np

from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.task.observation import ITERATIONS_SCALE, indices_of, machine_state_entries
from glassgait.studies.distillation.students.student import Student, StudentSettings, TrainingSet

ITERATIONS = 16
"""Moments of a machine's state that are distinguished; commands ask for 6 to 11."""


def _fit_open_loop(
    samples: TrainingSet, settings: StudentSettings, *, seed: int, n_jobs: int
) -> OpenLoopPolicy:
    names, observations, actions = (
        samples.observation_names,
        samples.observations,
        samples.actions,
    )
    one_hot = observations[:, machine_state_entries(names)]
    state, n_states = np.argmax(one_hot, axis=1), one_hot.shape[1]
    (iterations,) = indices_of("iterations", names)
    counted = np.rint(observations[:, iterations] / ITERATIONS_SCALE).astype(int)
    iteration = np.minimum(counted, ITERATIONS - 1)
    table = np.tile(actions.mean(axis=0), (n_states, ITERATIONS, 1))
    for s in range(n_states):
        for i in range(ITERATIONS):
            mine = (state == s) & (iteration == i)
            # A moment that was never visited goes on with the one before it.
            table[s, i] = actions[mine].mean(axis=0) if mine.any() else table[s, max(0, i - 1)]
    return OpenLoopPolicy(samples.gait, names, table=table, robot=samples.robot)


OPEN_LOOP = Student("open_loop", "Open loop", _fit_open_loop, color="#CCCCCC", marker="x")
