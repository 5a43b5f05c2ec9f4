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

FILES = (".yaml", ".yml", ".formulas", ".safetensors")

SHIPPED = {
    "--gait": "models/task/gaits/*.yaml",
    "--robot": "models/robots/*/robot.yaml",
    "--scenario": "diagrams/scenarios/**/*.yaml",
}
"""Files of what an option may name."""

OTHERS = {
    "--scenario": ("grounds", "harsh"),
    "--policy": ("expert", *KINDS),
    "--students": KINDS,
}
"""Further names of an option."""


def refuse_early(command: str, arguments: Sequence[str]) -> None:
    """Raises an InputError if a command names what does not exist, or writes over a file."""
    given = list(_options(command, arguments))
    # A run, or a gait of one's own, may have policies of any name.
    own = any(
        option == "--source" or (option in ("--gait", "--robot") and _is_path(value))
        for option, value in given
    )
    for option, value in given:
        if option == "--output":
            _refuse_file(Path(value))
        known = () if own and option == "--policy" else _known(option)
        if known and not _is_path(value) and value not in ("all", *known):
            remedy = "" if option == "--students" else ", or give the path of a file"
            raise unknown_name(option[2:].removesuffix("s"), value, known, remedy)


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
    paths = Path(__file__).parents[2].glob(SHIPPED[option]) if option in SHIPPED else ()
    names = (path.parent.name if path.name == "robot.yaml" else path.stem for path in paths)
    return (*sorted(names), *OTHERS.get(option, ()))


def _refuse_file(path: Path) -> None:
    # A name that is too long cannot be looked up; writing refuses it.
    with suppress(OSError):
        for part in (path, *path.parents):
            if part.is_file():
                raise InputError(f"--output {path}: {part} is a file; name another place")


def _is_path(value: str) -> bool:
    return value.endswith(FILES) or Path(value).name != value
