"""Typeset controllers: pages and LaTeX of formula files, those that ship first of all."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest

from glassgait.models.errors import InputError
from glassgait.models.formulas.contacts import CONTACTS
from glassgait.models.formulas.limits import LIMITS
from glassgait.models.formulas.odometry import ODOMETRY
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.studies.common.typeset import to_latex
from glassgait.studies.explanation.interventions.sentences import (
    SUFFIX,
    Sentence,
    Sentences,
    find_sentences,
)
from glassgait.studies.explanation.typeset import beside, typeset

PAGES = sorted(STUDENT_DIRECTORY.rglob("sparse_formula.formulas"))
README = STUDENT_DIRECTORY.parent / "README.md"


def page_id(path: Path) -> str:
    """Names a page by its robot, where that is not the default one, and gait."""
    return "-".join(path.parent.relative_to(STUDENT_DIRECTORY).parts)


def typeset_page(path: Path) -> dict[str, str]:
    policy = load_policy(path)
    said = find_sentences(policy.digest(), [beside(path)])
    return typeset(policy, path.stem, said)


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_every_page_that_ships_has_its_typeset_form(path):
    remedy = "run 'glassgait explain typeset --output' beside it"
    for name, text in typeset_page(path).items():
        assert path.with_name(name).read_text() == text, f"{name} is of another file; {remedy}"


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_sentences_that_ship_are_of_the_policy_that_ships(path):
    policy = load_policy(path)
    said = find_sentences(policy.digest(), [beside(path)])
    assert said is not None
    assert {own.joint for own in said.sentences} <= set(quadruped.JOINTS)


@pytest.mark.parametrize("path", PAGES, ids=page_id)
def test_every_page_that_ships_has_a_row_that_links_its_typeset_form(path):
    table = README.read_text().split("\n### Typeset\n")[1].split("\n### ")[0]
    (row,) = [line for line in table.splitlines() if f"({linked(path, '.html')})" in line]
    for end in (".html", ".tex", SUFFIX):
        assert f"({linked(path, end)})" in row
        assert path.with_name(f"{path.stem}{end}").is_file()


def linked(path: Path, end: str) -> str:
    return path.with_name(f"{path.stem}{end}").relative_to(README.parent).as_posix()


def test_pages_ship():
    assert [*map(page_id, PAGES)] == ["bound", "go2-pace", "go2-trot", "pace", "trot", "walk"]


def test_a_page_holds_all_joints_and_says_which_are_mirror_images():
    page = typeset_page(STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas")
    html = page["sparse_formula.html"]
    assert html.count("<article") == 24
    assert html.count('<article id="FL_hip-1" class="image">') == 1
    assert html.count('class="image"') == 12
    for section in ("contacts", "odometry", "machine", "definitions", "targets", "limits"):
        assert f'<section id="{section}">' in html
    assert "front left hip inward: by 0.046" in html
    assert "to the right turns the front right hip inward: by 0.046" in html
    latex = page["sparse_formula.tex"]
    assert latex.count(r"\begin{align*}") == latex.count(r"\end{align*}") > 24
    assert latex.count("{") == latex.count("}")


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [*PAGES, STUDENT_DIRECTORY / "half_bound" / "statewise_symbolic.formulas"],
    ids=lambda path: f"{path.parent.name}-{path.stem}",
)
def test_latex_makes_pages_that_no_line_leaves(path, tmp_path):
    pdflatex = shutil.which("pdflatex")
    if pdflatex is None:
        pytest.skip("needs pdflatex (Debian: texlive-latex-base)")
    (tmp_path / "own.tex").write_text(to_latex(load_policy(path).to_file(), load_robot()))
    command = [pdflatex, "-interaction=nonstopmode", "-halt-on-error", "own.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-1500:]
    assert (tmp_path / "own.pdf").exists()
    assert "Overfull" not in (tmp_path / "own.log").read_text(errors="replace")


def test_mathml_is_well_formed():
    html = typeset_page(PAGES[0])["sparse_formula.html"]
    maths = html.split("<math>")[1:]
    for own in maths:
        inner = own.split("</math>")[0].replace("&nbsp;", " ")
        ElementTree.fromstring(f"<math>{inner}</math>")
    assert len(maths) > 500


def test_a_changed_formula_changes_both_forms():
    path = STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas"
    policy = load_policy(path)
    file = policy.to_file()
    place = next(iter(file.formulas))
    other = {**file.formulas, place: file.formulas[place].operands[0]}
    assert to_latex(replace(file, formulas=other), load_robot()) != to_latex(file, load_robot())


def test_sentences_of_another_policy_are_not_taken(tmp_path):
    own = Sentence("FL_hip", 0, "More turns the front left hip inward", 0.1, 0.1, 0.01, True)
    said = Sentences("abc", 26, 500, 0, (own,))
    said.write(tmp_path / "s.json")
    assert find_sentences("abc", [tmp_path / "s.json"]) == said
    assert find_sentences("abd", [tmp_path / "none", tmp_path / "s.json"]) is None
    (tmp_path / "s.json").write_text("[1]")
    with pytest.raises(InputError, match="holds no sentences"):
        find_sentences("abc", [tmp_path / "s.json"])


def test_a_sentence_that_failed_is_not_said():
    claim = "More yaw rate to the left turns the front left hip inward, late in state 0"
    own = Sentence("FL_hip", 0, claim, -0.1, -0.05, 0.01, True)
    assert own.words() == (
        "More yaw rate to the left turns the front left hip inward, late in the state: by 0.050 ± "
        "0.010 rad in simulation; the term alone predicts 0.100."
    )
    assert "to the right turns the front right hip inward" in own.words(mirrored=True)
    assert "inward" not in replace(own, holds=False).words()


@pytest.mark.parametrize("program", [CONTACTS, ODOMETRY, LIMITS], ids=lambda own: own.title)
def test_a_legend_explains_what_the_program_reads_by_the_symbols_it_is_set_in(program):
    quantities = dict(program.quantities())
    read = set(re.findall(r"\w+", " ".join(statement for statement, _ in program.statements)))
    assert set(quantities) <= read
    assert "".join(name + words for name, words in program.quantities()) == " ".join(program.legend)


def test_a_legend_shows_velocities_as_the_formulas_do():
    page = typeset_page(STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas")
    assert r"$\dot p$: how fast its joints move it" in page["sparse_formula.tex"]
    assert (
        "p\N{COMBINING DOT ABOVE}</mi></math>: how fast its joints move it"
        in page["sparse_formula.html"]
    )
