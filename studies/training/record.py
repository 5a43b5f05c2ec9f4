"""What a run leaves behind: the policy that learned, its record and its learning curve."""

import platform
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import yaml

from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml, write_atomically
from glassgait.models.policies.policy import Policy
from glassgait.models.settings import Settings
from glassgait.models.task import CONTROL_PERIOD
from glassgait.studies.common.run_folder import to_plain
from glassgait.studies.training.config import TrainingConfig
from glassgait.studies.training.progress import Progress

RECENT_UPDATES = 20


def write_learned(
    policy: Policy,
    name: str,
    config: TrainingConfig,
    progress: Progress,
    folder: Path,
    *,
    study: Settings | None = None,
) -> None:
    """Writes a policy, its record `<name>.yaml` and its curve `<name>.csv`, each atomically.

    Args:
        policy: What learned.
        name: Name of the files.
        config: Settings of the learning.
        progress: How far it came.
        folder: Where the files go.
        study: Settings of a study that does more than train; the record has them by their title.
    """
    curve = progress.curve_table()
    recent = curve.tail(RECENT_UPDATES).mean()
    steps = progress.update * config.steps_per_update
    record = {
        "gait": policy.gait,
        "seed": config.seed,
        "updates": progress.update,
        "control_steps": steps,
        "simulated_hours": round(steps * CONTROL_PERIOD / 3600, 2),
        "wall_minutes": round(progress.seconds / 60, 1),
        "control_steps_per_second": round(steps / progress.seconds),
        "final": {
            key: round(float(recent[key]), 4)
            for key in ("plain_reward", "reward", "rhythm", "failure_rate", "difficulty")
        },
        "software": {
            package: version(package) for package in ("drake", "torch", "rsl-rl-lib", "numpy")
        }
        | {"python": platform.python_version()},
        **({} if study is None else {study.title: to_plain(study)}),
        "config": to_plain(config),
    }
    policy.save(folder / f"{name}{policy.suffix}")
    write_atomically(folder / f"{name}.yaml", yaml.safe_dump(record, sort_keys=False))
    write_atomically(folder / f"{name}.csv", curve.to_csv(index=False, float_format="%.6g"))


def read_config(path: Path) -> TrainingConfig:
    """Reads from an expert's record how it was trained.

    An expert that it began as and that is not there, seen from here, is looked for from the
    record's folder, so that records that ship can be followed from anywhere.

    Raises:
        InputError: if the file is not such a record.
    """
    record = read_yaml(path)
    if not isinstance(record, dict) or "config" not in record:
        raise InputError(f"{path}: is not an expert's record; it has no key 'config'")
    config = TrainingConfig.from_plain(record["config"], str(path))
    start = config.warm_start
    if start is None or Path(start).exists():
        return config
    beside = path.parent / start
    # The run's own result, which may have the same name, is not what it began as.
    own = beside.with_suffix(path.suffix) == path
    return replace(config, warm_start=str(beside)) if beside.exists() and not own else config


def trainings(path: Path) -> list[Path]:
    """Lists the records of an expert's trainings, the first one first.

    Args:
        path: The expert's own record, which is the last.

    Raises:
        InputError: if one of them is not such a record.
    """
    start = read_config(path).warm_start
    return [*([] if start is None else trainings(Path(start).with_suffix(".yaml"))), path]
