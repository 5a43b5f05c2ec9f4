"""Odd invocations of every command: each is refused in a sentence, or its settings are sound."""

import math
import random
from dataclasses import fields, is_dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import pytest
from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen

from glassgait.models.settings import Settings
from glassgait.studies.cli import COMMANDS, command_class, main
from glassgait.studies.common.exit_codes import BAD_INPUT

NUMBERS = ["0", "-1", "1", "2", "-0.0", "0.5", "1.5", "nan", "inf", "-inf", "1e400", "1e-400"]
NUMBERS += [str(2**31), str(2**32), str(2**63), "9" * 30, "9" * 5000, "1_0", "0x10", "1e3", "٣"]
TEXTS = ["", " ", "text", "trot", "gallop", "all", "expert", "students", "None", "True", "-", "--"]
TEXTS += ["FL_hip", "linear", "training", "mermaid", "operon", "[bold]", "{}", "\u202e", "a" * 5000]
PATHS = ["missing", "missing/deep", "folder", "file", "file/below", "/proc/none"]
VALUES = [*NUMBERS, *TEXTS, *PATHS]
UNKNOWN = ["--bogus", "--n-robot", "-x", "---", "--gait.name", "--ppo", "bogus"]


def flags_of(kind: type, prefix: str = "") -> list[str]:
    """Lists the flags of settings, as tyro names them."""
    found = []
    for name, hint in get_type_hints(kind, include_extras=True).items():
        if name not in {field.name for field in fields(kind)}:
            continue
        bare, metadata = (hint.__origin__, hint.__metadata__) if _annotated(hint) else (hint, ())
        if is_dataclass(bare):
            unnamed = any(getattr(entry, "name", None) == "" for entry in metadata)
            found += flags_of(bare, prefix if unnamed else f"{prefix}{name.replace('_', '-')}.")
        else:
            found.append(f"--{prefix}{name.replace('_', '-')}")
    return found


def odd_invocation(generator: random.Random) -> list[str]:
    """Draws a command with some settings that a person might mistype."""
    command = generator.choice(list(COMMANDS))
    flags = flags_of(command_class(command))
    arguments = command.split()
    for _ in range(generator.choice([1, 1, 1, 2, 3])):
        arguments.append(generator.choice(UNKNOWN if generator.random() < 0.05 else flags))
        arguments += generator.choices(VALUES, k=generator.choice([0, 1, 1, 1, 1, 2, 3]))
    return arguments


@pytest.fixture
def places(tmp_path, monkeypatch):
    """Makes the files and folders that invocations name."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_bytes(b"\xff\x00: [")
    return tmp_path


@pytest.fixture
def accepted(monkeypatch):
    """Has commands do nothing but print their settings."""
    commands: list[Any] = []

    def run(command: Any) -> None:
        commands.append(command)

    for name in COMMANDS:
        monkeypatch.setattr(command_class(name), "run", run)
    return commands


def check(arguments: list[str], capsys, accepted: list[Any] | None = None) -> None:
    """Checks that a command is refused in a sentence, or accepts sound settings alone."""
    try:
        main(arguments)
    except SystemExit as ended:
        assert ended.code == BAD_INPUT
        lines = capsys.readouterr().err.strip().splitlines()
        message = "\n".join(line for line in lines if not line.startswith("· "))
        # tyro reports in a frame of its own what it cannot parse.
        framed = message.startswith("╭") or "\n ---" in message
        assert framed or (message.startswith("glassgait: ") and "\n" not in message)
        assert "Traceback" not in message
    else:
        capsys.readouterr()
        if accepted is not None:
            check_settings(accepted.pop())


def check_settings(settings: Any) -> None:
    """Checks every number of settings against its annotation, without the library that did."""
    hints = get_type_hints(type(settings), include_extras=True)
    for field in fields(settings):
        value = getattr(settings, field.name)
        if is_dataclass(value):
            check_settings(value)
        elif isinstance(settings, Settings):
            assert fits(value, hints[field.name]), f"{field.name} is {value!r}"


def fits(value: Any, hint: Any) -> bool:
    """Tells whether a value is of a type and within its bounds."""
    if _annotated(hint):
        bounds = hint.__metadata__
        return fits(value, hint.__origin__) and all(_within(value, bound) for bound in bounds)
    if get_origin(hint) in (Union, UnionType):
        return any(fits(value, option) for option in get_args(hint))
    if get_origin(hint) is Literal:
        return value in get_args(hint)
    if get_origin(hint) is tuple:
        if not isinstance(value, tuple):
            return False
        own = get_args(hint)
        own = own[:1] * len(value) if own[-1] is Ellipsis else own
        return len(value) == len(own) and all(map(fits, value, own))
    if hint is float:
        return type(value) is float and math.isfinite(value)
    return isinstance(value, NoneType if hint is None else hint)


def _annotated(hint: Any) -> bool:
    return get_origin(hint) is Annotated


def _within(value: Any, bound: Any) -> bool:
    match bound:
        case Ge(least):
            return value >= least
        case Gt(less):
            return value > less
        case Le(most):
            return value <= most
        case Lt(more):
            return value < more
        case MinLen(length):
            return len(value) >= length
        case MaxLen(length):
            return len(value) <= length
        case _:
            return True


@pytest.mark.parametrize("seed", range(4))
def test_odd_invocations_are_refused_or_sound(seed, places, accepted, capsys):
    generator = random.Random(seed)
    for _ in range(30):
        check(odd_invocation(generator), capsys, accepted)
    assert {path.name for path in places.iterdir()} == {"file", "folder"}


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(100, 130))
def test_many_odd_invocations_are_refused_or_sound(seed, places, accepted, capsys):
    generator = random.Random(seed)
    for _ in range(30):
        check(odd_invocation(generator), capsys, accepted)


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_as_it_is_has_sound_settings(command, accepted, capsys):
    main(command.split())
    check_settings(accepted.pop())
    assert flags_of(command_class(command))


@pytest.mark.parametrize("value", [*TEXTS, *PATHS])
def test_a_gait_that_is_none_is_refused(value, places, capsys):
    if value not in {"trot", "--"}:
        check(["gait", value], capsys)
        with pytest.raises(SystemExit):
            main(["gait", value])
    capsys.readouterr()


@pytest.mark.parametrize("place", [*PATHS, "", "-", "a" * 300])
def test_a_drawing_goes_where_it_is_asked_or_is_refused(place, places, capsys):
    check(["gait", "trot", "--output", place], capsys)


FILES = ["missing", "missing/deep", "folder", "file", "file/below"]
TAKES_EXPERT = ["distill", "distill --sweep terms", "reproduce curricula"]
SOURCES = [["train", "--like"], ["importance", "--source"]]
SOURCES += [["evaluate", name, "--source"] for name in ("worlds", "pushes", "symmetry")]
SOURCES += [["explain", "interventions", "--source"], ["view", "--source"]]
SOURCES += [["explain", "page", "--source"]]


@pytest.mark.parametrize("path", FILES)
@pytest.mark.parametrize("command", TAKES_EXPERT)
def test_an_expert_that_is_none_is_refused_before_any_work(command, path, places, capsys):
    check([*command.split(), "--source", path], capsys)
    with pytest.raises(SystemExit):
        main([*command.split(), "--source", path])
    assert {path.name for path in places.iterdir()} == {"file", "folder"}


@pytest.mark.parametrize("path", FILES)
@pytest.mark.parametrize("flag", SOURCES)
def test_a_source_that_is_none_is_refused_before_any_work(flag, path, places, capsys):
    check([*flag, path], capsys)
    with pytest.raises(SystemExit):
        main([*flag, path])
    assert {path.name for path in places.iterdir()} == {"file", "folder"}
