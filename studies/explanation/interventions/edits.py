"""Interventions: formula files in which one term sees another input, or none."""

from dataclasses import replace

from glassgait.models.formulas.expression import Expression, canonical, constant, plus
from glassgait.models.formulas.file import FormulaFile, read_formulas
from glassgait.models.formulas.mirror import FormulaMirror
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.studies.explanation.interventions.terms import Term


def with_input_raised(file: FormulaFile, term: Term, by: float) -> FormulaFile:
    """Returns a file in which a term sees its input greater by a number; all else sees it as is.

    Args:
        file: The file.
        term: One of its terms.
        by: How much greater, in the input's unit.
    """
    return _with_added(file, term, term.with_gates(_short(term.weight * by)))


def without_input(file: FormulaFile, term: Term, mean: float) -> FormulaFile:
    """Returns a file in which a term is a number.

    Args:
        file: The file.
        term: One of its terms.
        mean: What stands in the term's place (rad).
    """
    taken = plus(term.with_input(-term.weight), constant(_short(mean)))
    return _with_added(file, term, taken)


def written(file: FormulaFile, note: str) -> str:
    """Writes a file with a line on top for people."""
    return f"# {note}\n{FormulaPolicy.from_file(file).to_text()}"


def read_back(text: str) -> FormulaPolicy:
    """Builds the policy that a text of `written` is, so that what is kept is what walks."""
    return FormulaPolicy.from_file(read_formulas(text))


def _with_added(file: FormulaFile, term: Term, added: Expression) -> FormulaFile:
    # The formula itself stays as it is, and ends in what was done to it.
    edited = canonical(plus(file.formulas[term.place], added))
    formulas = {**file.formulas, term.place: edited}
    if term.mirrored:
        assert file.mirror is not None
        mirror = FormulaMirror.of(file.vocabulary, file.mirror)
        formulas[mirror.place(term.place)] = mirror.formula(edited, term.joint)
    return replace(file, formulas=formulas)


def _short(value: float) -> float:
    """Rounds a number to what a file holds in few digits."""
    return float(f"{value:.4g}")
