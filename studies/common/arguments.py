"""Checks of a command line before anything slow is imported: names, and the place of results."""

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
"""The kinds of students, in the order of tables."""

GROUPS = ("grounds", "harsh")  # of scenarios
FILES = (".yaml", ".yml", ".formulas", ".safetensors")

_ROOT = Path(__file__).parents[2]


def refuse_early(command: str, arguments: Sequence[str]) -> None:
    """Raises an InputError if a command names what does not exist, or writes over a file."""
    given = list(_options(command, arguments))
    for option, value in given:
        if option == "--output":
            _refuse_file(Path(value))
        known = _known(option)
        # A run, or a gait of one's own, may have policies of any name.
        is_free = option == "--policy" and any(
            other == "--source" or (other in ("--gait", "--robot") and _is_path(named))
            for other, named in given
        )
        if known and not (is_free or _is_path(value) or value in ("all", *known)):
            raise unknown_name(option[2:].removesuffix("s"), value, known, _remedy(option))


def _refuse_file(path: Path) -> None:
    # A name that is too long cannot be looked up; writing refuses it.
    with suppress(OSError):
        for part in (path, *path.parents):
            if part.is_file():
                raise InputError(f"--output {path}: {part} is a file; name another place")


def _options(command: str, arguments: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yields every value with its option; `gait` and `robot` take a name without one."""
    option = f"--{command}"
    for argument in arguments:
        if argument.startswith("--"):
            option, _, value = argument.partition("=")
            yield from [(option, value)] if value else []
        else:
            yield option, argument


def _known(option: str) -> tuple[str, ...]:
    """Lists the names that an option takes; none if it takes anything."""
    match option:
        case "--gait":
            paths = (_ROOT / "models" / "task" / "gaits").glob("*.yaml")
            return tuple(sorted(path.stem for path in paths))
        case "--robot":
            paths = (_ROOT / "models" / "robots").glob("*/robot.yaml")
            return tuple(sorted(path.parent.name for path in paths))
        case "--scenario":
            paths = (_ROOT / "diagrams" / "scenarios").rglob("*.yaml")
            return (*sorted(path.stem for path in paths), *GROUPS)
        case "--policy":
            return ("expert", *KINDS)
        case "--students":
            return KINDS
    return ()


def _is_path(value: str) -> bool:
    return value.endswith(FILES) or Path(value).name != value


def _remedy(option: str) -> str:
    return "" if option == "--students" else ", or give the path of a file"
