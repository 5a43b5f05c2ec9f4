"""Checks of names and output paths on the command line before slow imports."""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from glassgait.models.errors import InputError, unknown_name

KINDS = (
    "linear",
    "linear_per_state",
    "gbm",
    "histogram_gbm",
    "ebm",
    "symbolic",
    "symbolic_per_state",
    "formulas",
)
"""Kinds of students, in the order of tables."""

FILES = (".yaml", ".yml", ".formulas", ".safetensors")

SHIPPED = {
    "--gait": "models/task/gaits/*.yaml",
    "--robot": "models/robots/*/robot.yaml",
    "--scenario": "diagrams/scenarios/**/*.yaml",
}
"""Options whose values may be names of shipped files."""

OTHERS = {"--scenario": ("grounds", "harsh"), "--policy": ("expert", *KINDS), "--students": KINDS}
"""Further values of options."""


def check_arguments(command: str, arguments: Sequence[str]) -> None:
    """Raises an InputError if a name does not exist or an output path contains a file."""
    pairs = list(_options(command, arguments))
    # A run, or a user's gait or robot, may have policies of any name.
    any_policy = any(
        option == "--source" or (option in ("--gait", "--robot") and _is_path(value))
        for option, value in pairs
    )
    for option, value in pairs:
        if option == "--output":
            _check_output(Path(value))
        known = () if any_policy and option == "--policy" else _known_values(option)
        if known and not _is_path(value) and value not in ("all", *known):
            remedy = "" if option == "--students" else ", or give the path of a file"
            raise unknown_name(option[2:].removesuffix("s"), value, known, remedy)


def _options(command: str, arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yields pairs of option and value; the names of `gait` and `robot` have no option."""
    option = f"--{command}"
    for argument in arguments:
        if argument.startswith("--"):
            option, _, value = argument.partition("=")
            yield from [(option, value)] if value else []
        else:
            yield option, argument


def _known_values(option: str) -> tuple[str, ...]:
    """Lists the names that an option accepts; empty if it accepts anything."""
    paths = Path(__file__).parents[2].glob(SHIPPED[option]) if option in SHIPPED else ()
    names = (path.parent.name if path.name == "robot.yaml" else path.stem for path in paths)
    return (*sorted(names), *OTHERS.get(option, ()))


def _check_output(path: Path) -> None:
    # `is_file` fails for a name that is too long, which is reported when it is written.
    with suppress(OSError):
        for folder in (path, *path.parents):
            if folder.is_file():
                raise InputError(f"--output {path}: {folder} is a file; give another folder")


def _is_path(value: str) -> bool:
    return value.endswith(FILES) or Path(value).name != value
