"""What tests of the studies share: an expert, pages that explain a rollout, and a browser."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from joblib import parallel_config

from glassgait.diagrams.domain_randomization import DomainRandomization
from glassgait.models.policies.library import load_expert
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.neural import Network, NeuralPolicy
from glassgait.models.task.gait import load_gait
from glassgait.studies.distillation.boosting import EbmSettings, GbmSettings, HistogramGbmSettings
from glassgait.studies.distillation.config import DistillationConfig, StudentsSettings
from glassgait.studies.distillation.short_formulas import FormulasSettings
from glassgait.studies.distillation.study import distill, write_r2_table
from glassgait.studies.distillation.symbolic import SymbolicPerStateSettings, SymbolicSettings
from glassgait.studies.training.config import PpoConfig, TrainingConfig
from glassgait.studies.training.run import TrainingRun

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
DRIVER = shutil.which("chromedriver")

FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader")
FLAGS += ("--no-first-run", "--disable-background-networking", "--window-size=1280,900")


@pytest.fixture(autouse=True)
def jobs_here() -> Iterator[None]:
    """Runs jobs in this process: a worker takes seconds to import what it works with."""
    with parallel_config("sequential"):
        yield


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator:
    """Opens Chromium; skips where it, its driver or Selenium is not installed."""
    webdriver = pytest.importorskip("selenium.webdriver", reason="needs Selenium (the dev extra)")
    if CHROMIUM is None or DRIVER is None:
        pytest.skip("needs chromium and chromedriver")
    options = webdriver.ChromeOptions()
    options.binary_location = CHROMIUM
    for flag in (*FLAGS, f"--user-data-dir={tmp_path_factory.mktemp('chromium')}"):
        options.add_argument(flag)
    # Both paths are named, so that Selenium looks for nothing to download.
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def expert() -> NeuralPolicy:
    """The trot's expert that ships."""
    return load_expert("trot")


@pytest.fixture(scope="module")
def other_expert(expert) -> NeuralPolicy:
    """An expert of the trot that never moves, and observes what the one that ships does."""
    names = expert.observation_names
    still = Network((np.zeros((12, len(names))),), (np.ones(12),))
    return NeuralPolicy("trot", names, still, expert.estimator, expert.mirrored_states)


@pytest.fixture(scope="session")
def few_students(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a linear student, which leans a little, and one that observes as the walk's."""
    folder = tmp_path_factory.mktemp("students")
    names, walk = (load_expert(gait).observation_names for gait in ("trot", "walk"))
    weights = 0.02 * np.random.default_rng(3).normal(size=(12, len(names)))
    LinearPolicy("trot", names, weights, np.full(12, 0.1)).save(folder / "linear.safetensors")
    still = LinearPolicy("trot", walk, np.zeros((12, len(walk))), np.zeros(12))
    still.save(folder / "ebm.safetensors")
    return folder


@pytest.fixture(scope="session")
def tiny_training() -> TrainingConfig:
    """Settings of a training of seconds, in Drake and in MuJoCo."""
    return TrainingConfig(
        updates=4,
        n_robots=8,
        worlds=DomainRandomization(n_groups=2, fine_steps=(0.005,)),
        friction_updates=2,
        checkpoint_updates=2,
        ppo=PpoConfig(steps_per_update=8, actor_layers=(16,), critic_layers=(16,), epochs=2),
    )


@pytest.fixture(scope="session")
def trained(tiny_training: TrainingConfig, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of a tiny training that ended; not to be changed."""
    folder = tmp_path_factory.mktemp("trained")
    TrainingRun(tiny_training, load_gait("trot"), folder).run()
    return folder


@pytest.fixture(scope="session")
def tiny_distillation() -> DistillationConfig:
    """Settings of a distillation of seconds, into every student."""
    search: dict[str, Any] = {
        "population": 20,
        "generations": 2,
        "max_samples": 100,
        "alone_episodes": 4,
    }
    return DistillationConfig(
        episodes=5,
        alone_rounds=1,
        episode_steps=24,
        alone_episodes=4,
        alone_steps=20,
        speeds=(0.0, 0.25, 0.5, 0.75),
        worlds=DomainRandomization(n_groups=2, mujoco_share=0.5),
        settings=StudentsSettings(
            gbm=GbmSettings(n_trees=5),
            histogram_gbm=HistogramGbmSettings(n_trees=5),
            ebm=EbmSettings(outer_bags=2, interactions=1, round_interactions=0, max_rounds=4),
            symbolic=SymbolicSettings(shapes=((30, 30), (30, 60)), start_weights=(3,), **search),
            symbolic_per_state=SymbolicPerStateSettings(
                shapes=((30, 30),), start_weights=(3,), **search
            ),
            formulas=FormulasSettings(terms=36, alone_episodes=4),
        ),
    )


@pytest.fixture(scope="session")
def distilled(
    tiny_distillation: DistillationConfig, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """A folder of a tiny distillation that ended; not to be changed."""
    folder = tmp_path_factory.mktemp("distilled")
    r2 = distill(tiny_distillation, load_gait("trot"), load_expert("trot"), folder)
    write_r2_table(r2, "trot", folder)
    return folder
