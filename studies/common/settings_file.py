"""Settings files (YAML), also for settings without an option on the command line.

`--print-settings` prints such a file with every setting, and `--settings FILE` reads one.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar, Self, TypeVar

import tyro
import yaml

from glassgait.models.errors import InputError
from glassgait.models.files import read_yaml, resolve_paths
from glassgait.models.settings import Settings, checked
from glassgait.studies.common.jobs import expand_gaits
from glassgait.studies.common.run import to_plain, to_record

IN_FILE = tyro.conf.Suppress  # annotation of settings without an option

S = TypeVar("S", bound=Settings)


@checked
class SettingsFile(Settings):
    """Settings of a command whose field `config` can be read from a file.

    Attributes:
        settings: Settings file, an expert's record or a run's config.yaml; other options override
            it. --print-settings prints a file with every setting.
        print_settings: Print all settings as YAML instead of running.
    """

    title: ClassVar[str] = "settings"

    settings: Path | None = None
    print_settings: bool = False

    @classmethod
    def from_file(cls, path: Path) -> Self:
        """Returns a command with the settings of a file."""
        default: Any = cls()
        config = read_settings(default.config, path)
        gait = {"gait": (config.gait,)} if hasattr(config, "gait") else {}
        return replace(default, config=config, **gait)

    def text(self) -> str:
        """Returns the settings as YAML, with the name of the gait."""
        command: Any = self
        values = to_plain(command.config)
        if "gait" in values:
            values["gait"], *others = expand_gaits(command.gait)
            if others:
                raise InputError("--print-settings: a settings file is of one gait; give one")
        return yaml.safe_dump(to_record(values), sort_keys=False)


def read_settings(defaults: S, path: Path) -> S:
    """Reads settings from a file or a record; missing keys have their defaults."""
    values, title = resolve_paths(path, read_yaml(path)), defaults.title
    if isinstance(values, dict):
        # Find the settings in a record of a refinement, of an expert, or of a run.
        study, is_record = values.get("study", "train"), bool({"study", "config"} & values.keys())
        if is_record and title not in values and not title.startswith(str(study)):
            raise InputError(f"{path}: is a record without settings of a {title}; name another one")
        settings = values.get("settings") if "study" in values else values
        values = values.get(title, values.get("config", settings))
    if not isinstance(values, dict):
        raise InputError(f"{path}: is not a mapping of settings; make one with --print-settings")
    return type(defaults).from_plain(merged(to_plain(defaults), values), str(path))


def merged(values: Any, changes: Any) -> Any:
    """Replaces values by the changes with the same keys, in nested mappings too."""
    if not isinstance(values, dict) or not isinstance(changes, dict):
        return changes
    return values | {key: merged(values.get(key), change) for key, change in changes.items()}
