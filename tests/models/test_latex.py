"""LaTeX of whole controllers."""

import shutil
import subprocess

import pytest

from glassgait.models.formulas.latex import to_latex
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy

PAGES = sorted(STUDENT_DIRECTORY.rglob("formulas.formulas"))
PER_STATE = STUDENT_DIRECTORY / "half_bound" / "symbolic_per_state.formulas"


def latex_of(path):
    return to_latex(load_policy(path).to_file())


@pytest.mark.parametrize("path", PAGES, ids=lambda path: path.parent.name)
def test_shipped_latex_is_of_the_shipped_formulas(path):
    assert path.with_suffix(".tex").read_text() == latex_of(path)


@pytest.mark.slow
@pytest.mark.parametrize("path", [PAGES[0], PER_STATE], ids=lambda path: path.stem)
def test_latex_makes_pages_that_no_line_leaves(path, tmp_path):
    pdflatex = shutil.which("pdflatex")
    if pdflatex is None:
        pytest.skip("needs pdflatex (Debian: texlive-latex-base)")
    (tmp_path / "controller.tex").write_text(latex_of(path))
    command = [pdflatex, "-interaction=nonstopmode", "-halt-on-error", "controller.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-1500:]
    assert "Overfull" not in (tmp_path / "controller.log").read_text(errors="replace")
