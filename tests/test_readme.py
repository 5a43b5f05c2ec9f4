"""What the README and the other pages show must run as shown, on a fresh clone too."""

import doctest
import re
import shlex
from pathlib import Path
from pkgutil import resolve_name

import interpret
import pytest

from glassgait.models.policies.library import load_expert
from glassgait.models.task.gait import parse_gait
from glassgait.studies.cli import COMMANDS, main
from glassgait.studies.students.library import default_student, find_student

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()
PAGES = {
    page: (ROOT / page).read_text()
    for page in ("README.md", "models/students/README.md", "models/experts/README.md")
}
NEEDS_A_DISTILLATION = ("pareto", "importance")
"""Commands that read the samples of one."""


def spans(text):
    """Code spans, and the lines of shell blocks, each with the paragraph or table row around it."""
    shell = re.sub(
        r"```bash\n(.*?)```", lambda block: f"`{block[1].strip()}`", text, flags=re.DOTALL
    )
    prose = re.sub(r"```.*?```", "", shell, flags=re.DOTALL)
    for paragraph in re.split(r"\n\s*\n|\n(?=\||- )", prose):
        for span in re.findall(r"`([^`]+)`", paragraph):
            yield " ".join(span.split()), paragraph


def commands():
    """Every `glassgait …` of the pages, once a page, as its arguments and what stands around it."""
    found = {}
    for page, text in PAGES.items():
        for span, paragraph in spans(text):
            for command in re.findall(r"(?:^|bin/)glassgait\b([^&]*)", span):
                arguments = tuple(shlex.split(command.replace("<gait>", "trot")))
                found.setdefault((page, arguments), []).append(paragraph)
    return [
        pytest.param(arguments, around, id=f"{page}: {' '.join(arguments)}")
        for (page, arguments), around in found.items()
        if arguments and not arguments[0].startswith("--")
    ]


def options():
    """Every span of options alone."""
    found = {span for text in PAGES.values() for span, _ in spans(text) if span.startswith("--")}
    return sorted(found - {"--help"})


@pytest.fixture
def parsed(monkeypatch, tmp_path):
    """Parses arguments in an empty folder, and returns the command that would have run."""
    monkeypatch.chdir(tmp_path)
    ran = []

    def note(command):
        ran.append(command)

    for command, _ in COMMANDS.values():
        monkeypatch.setattr(resolve_name(command), "run", note)

    def parse(*arguments):
        main(list(arguments))
        return ran.pop()

    return parse


@pytest.mark.parametrize(("arguments", "around"), commands())
def test_every_command_is_understood_and_finds_its_policy_on_a_fresh_clone(
    parsed, arguments, around
):
    command = parsed(*arguments)
    policy = getattr(command, "policy", None)
    if arguments[0] in NEEDS_A_DISTILLATION or policy == "students":
        assert any("distil" in paragraph for paragraph in around)
    elif arguments[0] == "explain" or policy not in (None, "expert"):
        for gait in [command.gait] if isinstance(command.gait, str) else command.gait:
            find_student(policy or default_student(gait), load_expert(gait))
    for argument in arguments:
        if argument.startswith("models/"):
            assert (ROOT / argument).exists()


@pytest.mark.parametrize("option", options())
def test_every_option_is_one_of_some_command(parsed, option):
    def takes(name, *arguments):
        try:
            return parsed(name, *arguments)
        except SystemExit:
            return None

    words = option.split()
    values = ["x"] if len(words) == 1 else []
    assert any(takes(name, *words) or takes(name, *words, *values) for name in COMMANDS)


def block(language):
    found = re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)
    assert found
    return found


def test_the_example_runs(capsys):
    (example,) = block("python")
    exec(compile(example, "README.md", "exec"), {})
    assert "(501, 2) False" in capsys.readouterr().out


def test_the_students_pages_example_runs():
    (example,) = re.findall(r"```python\n(.*?)```", PAGES["models/students/README.md"], re.DOTALL)
    names = {}
    exec(compile(example, "models/students/README.md", "exec"), names)
    assert names["policy"].gait == "walk"


def test_the_sessions_run_one_after_the_other_and_print_what_is_shown(monkeypatch):
    monkeypatch.setattr(interpret, "show", lambda explanation: None)
    sessions = "\n".join(block("pycon"))
    runner = doctest.DocTestRunner()
    test = doctest.DocTestParser().get_doctest(sessions, {}, "README.md", "README.md", 0)
    told = []
    runner.run(test, out=told.append)
    assert not runner.failures, "".join(told)


def test_the_gait_of_ones_own_is_accepted():
    (text,) = block("yaml")
    gait = parse_gait(text, name="hop")
    assert gait.transitions[0].when.swing_feet == (True,) * 4


def test_every_picture_and_page_is_there():
    root = Path(__file__).parents[1]
    for found in re.findall(r'src="([^"]+)"|\]\(((?!http)[^)]+)\)', TEXT):
        path, _, heading = "".join(found).partition("#")
        assert (root / path).exists()
        if heading:
            titles = re.findall(r"^#+ (.*)$", (root / path).read_text(), flags=re.MULTILINE)
            assert heading in {title.lower().replace(" ", "-") for title in titles}
