"""What the pages show must run as shown, on a fresh clone too."""

import doctest
import re
import shlex
import shutil
from contextlib import redirect_stdout
from functools import cache
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from pkgutil import resolve_name

import interpret
import pytest
import yaml

from glassgait.models.certificates.claims import load_claims
from glassgait.models.policies.library import load_policy
from glassgait.models.robots.library import read_robot
from glassgait.models.task.gait import load_gait, parse_gait
from glassgait.studies.cli import COMMANDS, command_class, main
from glassgait.studies.common.policies import OneGait, find_policies
from glassgait.studies.distillation.students import registry
from glassgait.studies.distillation.students.library import default_student

ROOT = Path(__file__).parents[1]
FOLDERS = ("models", "systems", "diagrams", "studies", "tests")
GENERATED = ("templates/*.md",)
PAGES = {
    str(page.relative_to(ROOT)): page.read_text()
    for page in sorted(
        [*ROOT.glob("*.md"), *(p for f in FOLDERS for p in (ROOT / f).rglob("*.md"))]
    )
    if not any(page.match(pattern) for pattern in GENERATED)
}
LONGEST_README = 120
"""Lines: a front page is read in one go."""

LONGEST_LINE = 150

NEEDS_A_DISTILLATION = ("distill", "--sweep")
"""Beginning of the command that reads the samples of one."""


GROUPS = {(name.split()[0],) for name in COMMANDS if name.count(" ")} - {
    (name,) for name in COMMANDS
}
"""First words that take a second one, and are not a command by themselves."""


def blocks(page, language):
    """Code blocks of a language, in the page's order."""
    return re.findall(rf"^```{language}\n(.*?)^```", PAGES[page], flags=re.DOTALL | re.MULTILINE)


def pages_with(language):
    found = [page for page in PAGES if blocks(page, language)]
    assert found
    return found


def spans(text):
    """Code spans, and the lines of shell blocks, each with the paragraph or table row around it."""
    shell = re.sub(
        r"```bash\n(.*?)```",
        lambda block: "\n".join(f"`{line}`" for line in block[1].splitlines() if line.strip()),
        text.replace("\\\n", " "),
        flags=re.DOTALL,
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
            for command in re.findall(r"(?:^|bin/|&& )glassgait\b(?!\.|/)([^&#>]*)", span):
                arguments = tuple(shlex.split(command.replace("<gait>", "trot")))
                found.setdefault((page, arguments), []).append(paragraph)
    return [
        pytest.param(arguments, around, id=f"{page}: {' '.join(arguments)}")
        for (page, arguments), around in found.items()
        if arguments and not arguments[0].startswith("--") and arguments not in GROUPS
    ]


def modules():
    """Every `python -m …` of the pages, as a module."""
    reported = (span for text in PAGES.values() for span, _ in spans(text))
    return sorted(
        {name for span in reported for name in re.findall(r"python -m (glassgait\.\S+)", span)}
    )


def options():
    """Every span of options alone."""
    found = {span for text in PAGES.values() for span, _ in spans(text) if span.startswith("--")}
    return sorted(found - {"--help", "--version"})


@pytest.fixture
def parsed(monkeypatch, tmp_path):
    """Parses arguments in a folder with settings of one's own, and returns what would have run."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "studies" / "reproduction" / "curricula.yaml", "mine.yaml")
    ran = []

    def note(command):
        ran.append(command)

    for command in COMMANDS:
        monkeypatch.setattr(command_class(command), "run", note)

    def parse(*arguments):
        main(list(arguments))
        return ran.pop()

    return parse


def gaits_of(command):
    """Names of the gaits that ship and that a command asks for by name."""
    # A controller's gait is left open where it may be a contract's.
    asked = OneGait.gait if (own := getattr(command, "gait", ())) is None else own
    names = (asked,) if isinstance(asked, str) else asked
    return [name for name in names if name != "all" and not name.endswith(".yaml")]


def policies_of(command, *, default):
    """Names and files of the policies of a command, but those that stand for others."""
    asked = getattr(command, "policy", None)
    names = (asked,) if asked is None or isinstance(asked, str) else asked
    names = [name for name in names if name not in ("all", "expert", "students")]
    return [name for name in names if name or default]


@cache
def find_shipped(gait, policy):
    """Loads a policy that ships, by default the one that is explained; many commands name it."""
    found = find_policies(load_gait(gait))
    found.policy(policy or default_student(found))


@pytest.mark.parametrize(("arguments", "around"), commands())
def test_every_command_is_understood_and_finds_its_policy_on_a_fresh_clone(
    parsed, arguments, around
):
    command = parsed(*arguments)
    if arguments[:2] == NEEDS_A_DISTILLATION:
        assert any("distil" in paragraph for paragraph in around)
    for policy in policies_of(command, default=arguments[0] == "explain"):
        if policy and policy.startswith("models/"):
            load_policy(ROOT / policy)
        elif policy and Path(policy).suffix:
            # A file of the reader's own, which the page has made.
            assert any(f"> {policy}" in paragraph for paragraph in around)
        else:
            for gait in gaits_of(command):
                find_shipped(gait, policy)
    for argument in arguments:
        if argument.startswith("models/"):
            assert (ROOT / argument).exists()


@cache
def help_of(name: tuple[str, ...]) -> str:
    """A command's help: trying all of them for each option takes a second."""
    with redirect_stdout(StringIO()) as reported, pytest.raises(SystemExit):
        main([*name, "--help"])
    return reported.getvalue()


@pytest.mark.parametrize("option", options())
def test_every_option_is_one_of_some_command(parsed, option):
    def takes(name, *arguments):
        try:
            return parsed(*name, *arguments)
        except SystemExit:
            return None

    words = option.split()
    everyone = [tuple(command.split()) for command in COMMANDS]
    reported = [name for name in everyone if words[0] in help_of(name)]
    # Of a kind that takes a value, one that it may take, those first that its help asks for.
    values = (
        [["x"], ["gbm"], ["loky"], ["100"], ["0.5"], ["64", "64"], ["0", "0"]]
        if len(words) == 1
        else []
    )
    asked = {
        kind for name in reported for kind in re.findall(rf"{words[0]} ([A-Z]+)", help_of(name))
    }
    numbers = {"INT": ["100"], "FLOAT": ["0.5"]}
    values = [numbers[kind] for kind in sorted(asked & numbers.keys())] + values
    # Of one that makes a command of another, its own command.
    own = next((name for name in everyone if name[1:] == tuple(words)), None)
    assert (own and takes(own)) or any(
        takes(name, *words) or any(takes(name, *words, *value) for value in values)
        for name in reported or everyone
    )


@pytest.mark.parametrize("module", modules())
def test_every_module_that_is_run_is_there(module):
    assert find_spec(module)


@pytest.mark.parametrize("page", pages_with("python"))
def test_programs_run_one_after_the_other(page, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    # A student that a page adds is there for the page alone.
    monkeypatch.setattr(registry, "STUDENTS", dict(registry.STUDENTS))
    names = {"__name__": "page"}
    for block in blocks(page, "python"):
        exec(compile(block, page, "exec"), names)


def test_the_example_trots_and_stays_up(capsys):
    (example,) = blocks("README.md", "python")
    exec(compile(example, "README.md", "exec"), {})
    assert "(501, 2) False" in capsys.readouterr().out


@pytest.mark.parametrize("page", pages_with("pycon"))
def test_sessions_run_one_after_the_other_and_print_what_is_shown(page, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(interpret, "show", lambda explanation: None)
    sessions = "\n".join(blocks(page, "pycon"))
    runner = doctest.DocTestRunner()
    reported = []
    runner.run(
        doctest.DocTestParser().get_doctest(sessions, {}, page, page, 0), out=reported.append
    )
    assert not runner.failures, "".join(reported)


@pytest.mark.parametrize("page", pages_with("yaml"))
def test_files_that_are_shown_are_accepted(page, tmp_path):
    path = tmp_path / "mine.yaml"
    for text in blocks(page, "yaml"):
        path.write_text(text)
        match yaml.safe_load(text):
            case {"transitions": _}:
                parse_gait(text, name="mine")
            case {"claims": _}:
                assert load_claims(path)
            case {"hip_offset": _}:
                assert read_robot(path)
            case _:
                resolve_name("glassgait.diagrams.scenario:load_scenario")(path)


def test_the_gait_of_a_user_hops():
    (text,) = blocks("README.md", "yaml")
    assert parse_gait(text, name="hop").transitions[0].when.swing_feet == (True,) * 4


def anchors(text):
    """Names by which GitHub links to a page's headings."""
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    titles = re.findall(r"^#+ (.*)$", prose, flags=re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


@pytest.mark.parametrize("page", PAGES)
def test_every_picture_and_link_leads_somewhere(page):
    prose = re.sub(r"^```.*?^```", "", PAGES[page], flags=re.DOTALL | re.MULTILINE)
    for found in re.findall(r'src="([^"]+)"|\]\(((?!http)[^)]+)\)', prose):
        path, _, heading = "".join(found).partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), path
        if heading:
            assert heading in anchors(target.read_text()), found


def test_every_page_can_be_reached_from_the_front_page():
    reached, next_ones = set(), {"README.md"}
    while next_ones:
        page = next_ones.pop()
        reached.add(page)
        for link in re.findall(r"\]\(((?!http)[^)#]+)", PAGES[page]):
            target = ((ROOT / page).parent / link).resolve()
            if target.is_relative_to(ROOT.resolve()):
                name = str(target.relative_to(ROOT.resolve()))
                next_ones |= {name} & PAGES.keys() - reached
    assert reached == PAGES.keys()


def test_the_front_page_is_short():
    lines = PAGES["README.md"].splitlines()
    assert len(lines) <= LONGEST_README
    # Not by long lines.
    assert max(len(line) for line in lines if not line.startswith(("|", "<img"))) <= LONGEST_LINE


@pytest.mark.parametrize("page", PAGES)
def test_pages_have_one_word_for_a_thing(page):
    prose = re.sub(
        r"```.*?```|`[^`]*`|\]\([^)]*\)|src=\"[^\"]*\"", "", PAGES[page], flags=re.DOTALL
    )
    prose = " ".join(prose.split())
    assert not re.search(r"\bworlds?\b|\bat home\b", prose, flags=re.IGNORECASE)
    # GBM is said elsewhere; the first time, what it is.
    named = re.findall(r"(\S+) \(?boosted trees", prose, flags=re.IGNORECASE)
    assert named in ([], ["GBM"])


def commands_of(page, form):
    """Names of the commands in the table of a page, in the order in which they stand there."""
    (table,) = re.findall(r"## The commands\n\n(.*?)\n\n(?!\|)", PAGES[page], flags=re.DOTALL)
    return re.findall(form, table, flags=re.MULTILINE)


def _command(shown):
    """Returns the command that a line shows with its settings."""
    return max((name for name in COMMANDS if f"{shown} ".startswith(f"{name} ")), key=len)


def test_the_front_page_names_every_command_once():
    named = commands_of("README.md", r"\[`([a-z -]+)`\]")
    assert sorted(named) == sorted({name.split()[0] for name in COMMANDS})


def test_the_page_of_studies_reports_what_every_command_does():
    table = commands_of("studies/README.md", r"^\| `glassgait ([^`]+)`")
    assert sorted(map(_command, table)) == sorted(COMMANDS)


@pytest.mark.parametrize("page", [page for page in PAGES if page != "README.md"])
def test_pages_give_the_verdict_before_commands_and_tables(page):
    verdict, *first = (PAGES[page].find(mark) for mark in ("**Verdict.**", "\n|---", "\n```"))
    assert verdict > 0
    assert all(place == -1 or verdict < place for place in first)
