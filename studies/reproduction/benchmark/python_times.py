"""Time of one action in Python and by ONNX Runtime; compiled students against their libraries."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor

from glassgait.diagrams.scenario import Scenario
from glassgait.models.arrays import Array
from glassgait.models.export.binding import Sensors
from glassgait.models.files import read_record
from glassgait.models.policies.controller import alone
from glassgait.models.policies.neural import NeuralPolicy
from glassgait.models.policies.policy import Policy
from glassgait.models.robots import quadruped
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import N_ESTIMATED
from glassgait.models.task.odometry import Odometry
from glassgait.studies.common.console import say
from glassgait.studies.common.policies import EXPERT, Policies
from glassgait.studies.distillation.collection import collect
from glassgait.studies.distillation.config import DistillationConfig
from glassgait.studies.distillation.students.boosting import EBM, GBM
from glassgait.studies.distillation.students.dataset import HELD_OUT_EVERY, Dataset
from glassgait.studies.distillation.students.registry import STUDENTS
from glassgait.studies.distillation.students.settings import StudentsSettings
from glassgait.studies.distillation.students.student import TrainingSet
from glassgait.studies.export.agreement import (
    recorded_observations,
    recorded_sequences,
)
from glassgait.studies.export.files import Deployment
from glassgait.studies.reproduction.benchmark.controllers import call_times, fastest

if TYPE_CHECKING:
    from glassgait.models.export.graphs.runtime import LoadedGraph

COUNT = 3000
"""Calls that are timed, in each repetition."""

CALLS = 300
"""Calls that are timed once."""

Timed = tuple[Callable[[Any], Any], Array | list[Any]]
"""A call, and the rows that it is timed on."""

N_ROBOTS, N_STEPS = 4, 250
"""Robots that the expert moves, and control steps: what they observe is acted on."""


def observed(found: Policies) -> Array:
    """Records observations (m, n) of robots that the expert moves."""
    return recorded_observations(found.gait, alone(found.expert), N_ROBOTS, N_STEPS, 0)


def action_times(policies: Mapping[str, Policy]) -> pd.DataFrame:
    """Times an action of policies in Python, by their titles, on one observation."""
    n_observations = len(next(iter(policies.values())).observation_names)
    row = np.random.default_rng(0).normal(size=(1, n_observations))
    times = [call_times(policy, row, CALLS).median for policy in policies.values()]
    return pd.DataFrame({"policy": policies.keys(), "12 joints (µs)": np.round(times, 1)})


def peer_times(found: Policies, count: int = COUNT) -> pd.DataFrame:
    """Times the policies of a gait, one observation at a time.

    Returns:
        A row a policy: median and 99.9th percentile (µs) of the policy in Python; of estimator and
        policy in Python; if it is installed, by ONNX Runtime, of both, or of the policy where
        odometry estimates; the machine's load.
    """
    observations, expert = observed(found), found.expert
    rows = []
    for kind, policy in {EXPERT: expert, **found.students}.items():
        calls: dict[str, Timed] = {
            "policy, Python": (policy, observations),
            "both, Python": _both(found, policy, observations),
        }
        if graph := _graph(Deployment(found.gait, alone(policy, expert), "timed", kind)):
            own, estimate = np.split(observations, [-N_ESTIMATED], axis=1)
            if graph.reads_estimate:
                rows_of_graph = list(zip(own, estimate, strict=True))
                calls["policy, ONNX"] = (lambda row, graph=graph: graph(*row), rows_of_graph)
            else:
                calls["both, ONNX"] = (graph, own)
        row: dict[str, object] = {"policy": kind}
        times, load = fastest(lambda: [call_times(*one, count) for one in calls.values()])  # noqa: B023
        for title, one in zip(calls, times, strict=True):
            row |= {f"{title} (µs)": one.median, f"{title}, 99.9 % (µs)": one.late}
        rows.append(row | {"load": load})
    return pd.DataFrame(rows)


def _both(found: Policies, policy: Policy, observations: Array) -> Timed:
    """Returns estimator and policy, and what they are called on."""
    own, estimator = observations[:, :-N_ESTIMATED], found.expert.estimator
    if not isinstance(estimator, Odometry):
        return lambda row: policy(np.concatenate([row, estimator(row)])), own
    robot = policy.robot
    begun = estimator.begin(robot, robot.default_stance)

    def estimate_and_act(row: tuple[Array, Sensors]) -> Array:
        seen, sensors = row
        assert sensors.imu is not None
        state = estimator.advance(
            robot,
            begun,
            joint_position=sensors.joint_position,
            joint_velocity=sensors.joint_velocity,
            imu=sensors.imu,
            touching=sensors.touching,
        )
        body = estimator.body_state(robot, state, sensors.joint_position)
        return policy(np.concatenate([seen, body]))

    sequences = recorded_sequences(found.gait, alone(found.expert), len(own), 0)
    sensors = [moment.sensors for sequence in sequences for moment in sequence]
    return estimate_and_act, list(zip(own, sensors, strict=False))


def _graph(deployment: Deployment) -> "LoadedGraph | None":
    try:
        # Imported here: ONNX and its runtime are an extra.
        from glassgait.models.export.graphs.runtime import LoadedGraph  # noqa: PLC0415
        from glassgait.studies.export.onnx_file import OnnxFile  # noqa: PLC0415
    except ImportError:
        say("ONNX Runtime is not timed: run pip install 'glassgait[onnx]'")
        return None
    return LoadedGraph(OnnxFile(deployment, "double").model)


NAIVE_BAGS = 14
"""Outer bags of an additive model by interpret's default, fitted one after the other on 2 cores."""

N_JOBS = 2
"""Joints that are fitted at once."""


@dataclass(frozen=True)
class NaiveModel:
    """A model by its library's defaults, and how it is timed.

    Attributes:
        make: Returns the model, or a part of it.
        parts: How many such parts the model has.
        samples: Sizes at which a part is fitted, to extrapolate from.
    """

    make: Callable[[], Any]
    parts: int
    samples: tuple[int, int]


NAIVE_MODELS = {
    GBM.name: NaiveModel(lambda: GradientBoostingRegressor(random_state=0), 1, (800, 3200)),
    EBM.name: NaiveModel(
        lambda: ExplainableBoostingRegressor(outer_bags=1, n_jobs=1, random_state=0),
        NAIVE_BAGS,
        (400, 800),
    ),
}
"""The ensembles whose defaults can be fitted at all: an additive one is timed by one of its bags,
at few samples, and takes minutes even so."""


def expert_samples(expert: NeuralPolicy, n_steps: int) -> Dataset:
    """Collects four episodes of the expert alone."""
    return collect(
        load_gait(expert.gait),
        alone(expert),
        episodes=range(1, 5),
        n_steps=n_steps,
        worlds=Scenario(),
        generator=np.random.default_rng(0),
    )


def compiled_against_library(
    samples: Dataset, expert: NeuralPolicy, settings: StudentsSettings
) -> pd.DataFrame:
    """Times a step of all 12 joints, one observation: compiled, and `predict` joint by joint.

    Boosted trees are as many and as deep as the study's; additive models have as many terms, but
    few rounds, which a prediction does not notice.
    """
    names = expert.observation_names
    own = TrainingSet(expert.gait, names, samples.observations, samples.actions, samples.starts)
    settings = replace(
        settings, **{EBM.name: replace(settings.of(EBM.name), outer_bags=1, max_rounds=50)}
    )
    rows = []
    for kind, student in STUDENTS.items():
        if student.fit_models is None or student.compile is None:
            continue
        models = student.fit_models(own, settings.of(kind), seed=0, n_jobs=N_JOBS)
        compiled = student.compile(expert.gait, names, models)
        row = samples.observations[:1]

        def library(observation: np.ndarray, models: Any = models) -> None:
            for model in models:
                model.predict(observation)

        ours = call_times(compiled, row, CALLS).median
        theirs = call_times(library, row[None], CALLS).median
        expected = np.stack([model.predict(samples.observations) for model in models], axis=1)
        rows.append(
            {
                "student": kind,
                "compiled (µs)": round(ours, 1),
                "predict × 12 (µs)": round(theirs),
                "ratio": round(theirs / ours),
                "greatest difference": float(
                    np.abs(compiled(samples.observations) - expected).max()
                ),
            }
        )
    return pd.DataFrame(rows)


def naive_minutes(
    samples: Dataset, model: NaiveModel, config: DistillationConfig
) -> tuple[float, float]:
    """Extrapolates the naive loop: 12 default models fitted anew after each episode.

    Returns:
        Minutes if a fit's time is linear in the samples, and if none takes longer than the smallest
        fit that was timed.
    """
    times = []
    generator = np.random.default_rng(0)
    for size in model.samples:
        chosen = generator.choice(len(samples.actions), size, replace=False)
        start = time.perf_counter()
        model.make().fit(samples.observations[chosen], samples.actions[chosen, 1])
        times.append(model.parts * (time.perf_counter() - start))
    slope, offset = np.polyfit(model.samples, times, 1)
    episodes = np.arange(1, config.episodes + 1)
    sizes = (1.0 - 1.0 / HELD_OUT_EVERY) * config.episode_steps * episodes
    linear = np.sum(offset + slope * sizes)
    least = len(episodes) * min(times)
    return float(quadruped.N_JOINTS * linear / 60), float(quadruped.N_JOINTS * least / 60)


def study_against_naive_loop(
    samples: Dataset, config: DistillationConfig, folder: Path
) -> pd.DataFrame:
    """Compares the minutes that a finished study took with the naive loop's.

    The last row is of the whole study, whose other students the naive loop has not.
    """
    minutes = {
        path.parent.name: read_record(path)["minutes"]
        for path in sorted(folder.glob("*/record.json"))
    }
    rows = []
    for kind, model in NAIVE_MODELS.items():
        if kind in minutes:
            linear, least = naive_minutes(samples, model, config)
            rows.append({"student": kind, "study": minutes[kind], "naive": linear, "least": least})
    if not rows:
        return pd.DataFrame()
    table = pd.DataFrame(rows)
    everything = {"student": f"all {len(minutes)}", **table[["naive", "least"]].sum()}
    table.loc[len(table)] = {**everything, "study": sum(minutes.values())}
    table["ratio"] = (table["naive"] / table["study"]).round(1)
    names = {
        "study": "study (min)",
        "naive": "naive loop, extrapolated (min)",
        "least": "naive loop, at least (min)",
    }
    return table.round({"study": 1, "naive": 0, "least": 0}).rename(columns=names)
