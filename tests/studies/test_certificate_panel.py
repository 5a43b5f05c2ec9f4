"""The certificate on the page that explains a policy: whose it is, and what its witnesses show."""

import json
import shutil

import numpy as np
import pytest

from glassgait.diagrams.rollout import Rollout
from glassgait.models.certificates.certificate import read_certificate, shipped_certificates
from glassgait.models.certificates.observation_box import operating_box
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import entries_of, machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.distillation.students.library import find_certificate
from glassgait.studies.explanation.certificate import certificate_panel, outside_in_words

A1 = load_robot()


GAIT = load_gait("trot")
PAGE = STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas"
SYMBOLIC = STUDENT_DIRECTORY / "trot" / "symbolic.formulas"
PATH = next(path for path in shipped_certificates() if path.name == "trot_sparse_formula.json")
CERTIFICATE = read_certificate(PATH)
SPEED = next(i for i, own in enumerate(CERTIFICATE.verdicts) if own.claim.stuck == ("v.x",))
"""The claim that a wrong forward speed moves no target far, which is refuted."""


@pytest.fixture(scope="module")
def observed():
    """Observations of the operating box, some beyond its ends."""
    box = operating_box(GAIT, A1)
    observations = box.random(40, np.random.default_rng(1))
    observations[[7, 8], -1] = box.upper[-1] + 0.5 * (box.upper - box.lower)[-1]
    return observations


@pytest.fixture(scope="module")
def panel(observed):
    return certificate_panel(CERTIFICATE, load_policy(PAGE), PAGE, observed)


@pytest.fixture(scope="module")
def explained(tmp_path_factory):
    """The page of the trot's page of formulas."""
    output = tmp_path_factory.mktemp("page")
    short = ["--n-steps", "40", "--step", "40", "--joint", "RL_hip", "--output", str(output)]
    main(["explain", "page", "--policy", "sparse_formula", *short])
    return output / "index.html"


def test_every_claim_is_shown_with_its_verdict(panel):
    assert [row.name for row in panel.rows] == [v.claim.name for v in CERTIFICATE.verdicts]
    words = {"proved": "✓ proved", "refuted": "✗ refuted", "undecided": "○ open"}
    for row, verdict in zip(panel.rows, CERTIFICATE.verdicts, strict=True):
        assert row.verdict == words[verdict.outcome]
        assert row.refuted_by == len(verdict.witnesses)
        assert (row.refuted_by > 0) == (row.outcome == "refuted")
    assert panel.checked_by == "glassgait verify check"


def test_the_policy_answers_a_witness_as_the_certificate_says(panel):
    own, verdict = panel.data["witnesses"][SPEED], CERTIFICATE.verdicts[SPEED]
    joint = own["joint"]
    assert quadruped.JOINTS[joint] == verdict.where.split(",")[0]
    first, other = (targets[joint] for targets in own["targets"])
    assert abs(first - other) == pytest.approx(abs(verdict.worst), abs=1e-5)
    symbols = [entry.symbol for entry in entries_of(load_policy(PAGE).observation_names)]
    shown = dict(zip((symbols[k] for k in own["inputs"]), own["values"][0], strict=True))
    witness = verdict.witnesses[0]
    assert shown == pytest.approx({symbol: witness[symbol] for symbol in shown}, abs=1e-5)
    assert "v.x" in shown
    assert len(shown) < len(symbols) / 2


def test_only_refuted_claims_have_witnesses(panel):
    for row, own in zip(panel.rows, panel.data["witnesses"], strict=True):
        assert (own is not None) == (row.outcome == "refuted")
        if own is not None:
            nearest = own["distances"][own["nearest"]]
            assert nearest == min(d for d in own["distances"] if d is not None)


def test_a_page_holds_numbers_that_every_browser_reads(panel):
    text = json.dumps(panel.data, allow_nan=False)
    assert json.loads(text)["witnesses"][SPEED]["nearest"] is not None


def test_steps_outside_of_the_box_are_counted(panel, observed):
    outside = panel.data["outside"]
    last = observed.shape[1] - 1
    assert [step for step, own in enumerate(outside) if own] == [7, 8]
    assert outside[7] == [[last, 0.5]]
    assert "At 2 of 40 steps (5.0 %) it is outside of the operating box" in panel.outside
    assert "where h.RR is beyond its range by 0.50 of the range's width" in panel.outside
    none = outside_in_words("physical", np.zeros((3, 2)), ("a", "b"))
    assert none == "It is never outside of the physical box."


def test_a_certificate_is_found_by_the_policys_digest_wherever_the_policy_lies(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / "mine.formulas"
    shutil.copy(PAGE, mine)
    found = find_certificate(mine, GAIT)
    assert found is not None
    assert found.path == PATH
    mine.write_text(PAGE.read_text() + "\n")
    assert find_certificate(mine, GAIT) is None


def test_a_certificate_made_here_comes_before_one_that_ships(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs" / "verify" / "prove" / "trot"
    for name in ("damaged", "sparse_formula"):
        (folder / name).mkdir(parents=True)
    own = folder / "sparse_formula" / "certificate.json"
    shutil.copy(PATH, own)
    (folder / "damaged" / "certificate.json").write_text("{}")
    found = find_certificate(PAGE, GAIT)
    assert found is not None
    assert found.path.resolve() == own
    panel = certificate_panel(found, load_policy(PAGE), PAGE, operating_box(GAIT, A1).lower[None])
    assert panel.checked_by == f"glassgait verify check {found.path} --policy {PAGE}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "symbolic", "--certificate", str(PATH)], "is of another policy than"),
        (["--policy", "sparse_formula", "--certificate", str(PAGE)], "is no certificate; make one"),
        (["--policy", "sparse_formula", "--certificate", "none.json"], "no such file"),
    ],
)
def test_refuses_a_certificate_of_something_else(tmp_path, refused, arguments, message):
    output = tmp_path / "sparse_formula"
    assert message in refused(["explain", "page", *arguments, "--output", str(output)])
    assert not output.exists()


def test_a_page_without_a_certificate_shows_none(few_page, embedded):
    assert embedded(few_page, "data")["certificate"] is None
    assert 'id="certificate"' not in few_page.read_text()


def test_a_witness_moves_the_timeline_to_the_moment_that_is_nearest(explained, browser, embedded):
    own = embedded(explained, "data")["certificate"]["witnesses"][SPEED]
    browser.get(f"file://{explained}")

    def shown(name):
        return browser.find_element("id", name)

    assert "at step 40" in shown("local-title").text
    assert own["nearest"] != 40
    button = browser.find_element("css selector", f"button.witness[data-claim='{SPEED}']")
    button.click()
    title = quadruped.JOINTS[own["joint"]].replace("_", " ")
    assert f"{title} at step {own['nearest']}:" in shown("local-title").text
    assert shown("time").get_attribute("value") == str(own["nearest"])
    assert f"{own['distances'][own['nearest']]:.2f} widths away" in shown("witness").text
    asked = browser.find_element("css selector", "#witness .targets tr.asked")
    assert asked.text.startswith(title)
    assert shown("nearest").get_attribute("visibility") == "visible"

    def differences():
        cells = browser.find_elements("css selector", "#witness .inputs tbody td:last-child")
        return [abs(float(cell.text.replace("−", "-"))) for cell in cells]

    before = differences()
    # What the witness itself moves comes first, then what is furthest from this moment.
    assert "→" in browser.find_element("css selector", "#witness .inputs tbody tr").text
    assert before[1:] == sorted(before[1:], reverse=True)
    assert np.linalg.norm(before) <= own["distances"][own["nearest"]] + 0.02
    browser.find_element("tag name", "body").send_keys("\ue014")  # the right arrow
    assert f"at step {own['nearest'] + 1}:" in shown("local-title").text
    assert f"Step {own['nearest'] + 1} is" in shown("witness").text
    assert differences() != before
    button.click()
    assert not browser.find_elements("id", "witness")


def test_the_timeline_marks_the_steps_outside_of_the_box(
    panel, observed, explained_page, browser, tmp_path
):
    policy = load_policy(PAGE)
    states = observed[:, machine_state_entries(policy.observation_names)]
    values = {"observations": observed, "actions": policy(observed), "rm_state": states}
    values |= {"rm_iterations": np.zeros((len(observed), 1)), "foot_contact": np.zeros((40, 4))}
    rollout = Rollout(0.02 * np.arange(len(observed)), values)
    options = {"policy_name": "sparse_formula", "step": 7, "certificate": panel}
    page = explained_page(tmp_path, GAIT, policy, rollout, **options)
    browser.get(f"file://{page}")
    (mark,) = browser.find_elements("css selector", "#gait rect.outside")
    # The timeline is 610 wide, from step 0 to step 39.
    assert float(mark.get_attribute("x")) == pytest.approx(26 + 610 * 7 / 39)
    assert float(mark.get_attribute("width")) == pytest.approx(610 * 2 / 39)
    now = browser.find_element("id", "outside-now")
    assert now.text == "Step 7 is outside of the operating box: h.RR (by 0.50 widths)."
    browser.find_element("tag name", "body").send_keys("\ue012")  # the left arrow
    assert now.text == "Step 6 is inside of the operating box."


@pytest.mark.parametrize("width", [1280, 800, 500])
def test_no_label_of_the_certificate_is_cut(explained, browser, width):
    browser.get(f"file://{explained}")
    browser.set_window_size(width, 900)
    browser.execute_script(
        f"document.querySelector('button.witness[data-claim=\"{SPEED}\"]').click()"  # of two
    )
    cut = browser.execute_script(
        "return [...document.querySelectorAll('#certificate td, #certificate th')]"
        ".filter(cell => cell.scrollWidth > cell.clientWidth).map(cell => cell.textContent)"
    )
    assert cut == []
    assert browser.execute_script(
        "const all = document.documentElement; return all.scrollWidth <= all.clientWidth"
    )
