"""Compiled students against their libraries, and the study against the naive loop."""

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from interpret.glassbox import ExplainableBoostingRegressor
from sklearn.ensemble import GradientBoostingRegressor

from models.a1 import robot
from models.policies.additive import AdditivePolicy
from models.policies.boosting import BoostedTreesPolicy
from models.policies.neural import NeuralPolicy
from models.task.gait import load_gait
from studies.benchmark.inference import single_row_microseconds
from studies.distillation.collection import Dataset, collect
from studies.distillation.config import DistillationConfig, StudentKind
from studies.distillation.students import fit_library_models, untrained_student

NAIVE_SAMPLES = (800, 2400)
"""Sample sizes at which a default model is fitted, to extrapolate from."""

NAIVE_MODELS: dict[str, Callable[[], Any]] = {
    "gbm": lambda: GradientBoostingRegressor(random_state=0),
    "ebm": lambda: ExplainableBoostingRegressor(random_state=0),
}


def expert_samples(expert: NeuralPolicy, n_steps: int) -> Dataset:
    """Collects four episodes of the expert alone."""
    config = DistillationConfig(gait=expert.gait)
    return collect(
        load_gait(expert.gait),
        expert,
        untrained_student(expert.gait, expert.observation_names),
        period=1,
        episodes=np.arange(1, 5),
        speeds=np.array(config.speeds),
        n_steps=n_steps,
        station=config.station,
        generator=np.random.default_rng(0),
    )


def compiled_against_library(
    samples: Dataset, names: tuple[str, ...], config: DistillationConfig
) -> pd.DataFrame:
    """Times a step of all 12 joints, one observation: compiled, and `predict` joint by joint.

    Boosted trees are as many and as deep as the study's; additive models have as many terms, but
    few rounds, which a prediction does not notice.
    """
    config = replace(config, ebm=replace(config.ebm, outer_bags=1, max_rounds=50))
    rows = []
    compilers = {
        "gbm": BoostedTreesPolicy,
        "histogram_gbm": BoostedTreesPolicy,
        "ebm": AdditivePolicy,
    }
    kinds: tuple[StudentKind, ...] = ("gbm", "histogram_gbm", "ebm")
    for kind in kinds:
        models = fit_library_models(kind, config, samples.observations, samples.actions)
        compiled = compilers[kind].compile(config.gait, names, models)
        row = samples.observations[:1]

        def library(observation: np.ndarray, models: Any = models) -> None:
            for model in models:
                model.predict(observation)

        ours = single_row_microseconds(compiled, row[0])
        theirs = single_row_microseconds(library, row)
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


def naive_minutes(samples: Dataset, kind: str, config: DistillationConfig) -> float:
    """Extrapolates the naive loop: 12 default models fitted anew after each episode (minutes).

    One joint is fitted at two sample sizes; a fit's time is taken as linear in the samples.
    """
    times = []
    generator = np.random.default_rng(0)
    for size in NAIVE_SAMPLES:
        chosen = generator.choice(len(samples.actions), size, replace=False)
        start = time.perf_counter()
        NAIVE_MODELS[kind]().fit(samples.observations[chosen], samples.actions[chosen, 1])
        times.append(time.perf_counter() - start)
    slope, offset = np.polyfit(NAIVE_SAMPLES, times, 1)
    sizes = 0.8 * config.episode_steps * np.arange(1, config.episodes + 1)
    return float(robot.N_JOINTS * np.sum(np.maximum(offset, 0.0) + slope * sizes) / 60)


def study_against_naive_loop(
    samples: Dataset, config: DistillationConfig, folder: Path
) -> pd.DataFrame:
    """Compares the minutes that a finished study took for a student with the naive loop's."""
    rows = []
    for kind in NAIVE_MODELS:
        path = folder / kind / "record.json"
        if path.exists():
            ours = json.loads(path.read_text())["minutes"]
            naive = naive_minutes(samples, kind, config)
            rows.append(
                {
                    "student": kind,
                    "study (min)": round(ours, 1),
                    "naive loop, extrapolated (min)": round(naive),
                    "ratio": round(naive / ours, 1),
                }
            )
    return pd.DataFrame(rows)
