"""The page that explains a rollout: its numbers, what it refuses, and what a browser shows."""

import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest
import yaml

from glassgait.diagrams.rollout import Rollout
from glassgait.models.policies.expression_text import parse_expression, variable_names
from glassgait.models.policies.library import load_expert, load_student
from glassgait.models.policies.linear import LinearPolicy
from glassgait.models.policies.open_loop import OpenLoopPolicy
from glassgait.models.policies.symbolic import StatewiseSymbolicPolicy
from glassgait.models.policies.tape import Tape
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.explanation.page import explain_rollout, render_page
from glassgait.studies.explanation.products import products


@pytest.fixture(scope="module")
def students(tmp_path_factory):
    """A folder with a linear student, which leans a little, and one that is no sum of terms."""
    folder = tmp_path_factory.mktemp("students")
    names = load_expert("trot").observation_names
    weights = 0.02 * np.random.default_rng(3).normal(size=(12, len(names)))
    LinearPolicy("trot", names, weights, np.full(12, 0.1)).save(folder / "linear.safetensors")
    OpenLoopPolicy("trot", names, np.zeros((2, 5, 12))).save(folder / "open_loop.safetensors")
    walk = load_expert("walk").observation_names
    LinearPolicy("trot", walk, np.zeros((12, len(walk))), np.zeros(12)).save(
        folder / "ebm.safetensors"
    )
    return folder


@pytest.fixture(scope="module")
def page(students, tmp_path_factory):
    output = tmp_path_factory.mktemp("page")
    where = ["--distillation", str(students), "--output", str(output)]
    main(["explain", "--policy", "linear", "--seconds", "0.8", "--step", "12", *where])
    return output / "index.html"


def embedded(page, name):
    found = re.search(rf'id="{name}" type="application/json">(.*?)</script>', page.read_text())
    assert found is not None
    return json.loads(found.group(1))


def test_shown_terms_and_the_rest_are_the_action(page):
    data = embedded(page, "data")
    assert data["step"] == 12
    assert len(data["explained"]) == 12
    assert len(data["state"]) == len(data["contact"]) == len(data["values"]) == 41
    for joint in data["explained"]:
        assert joint["error"] < 1e-9
        total = np.sum(joint["value"], axis=1) + joint["rest"]
        np.testing.assert_allclose(total, joint["action"], atol=2e-4)
        assert (np.diff(np.abs(joint["value"]), axis=1) <= 0).all()


def test_page_needs_nothing_from_elsewhere(page):
    text = page.read_text()
    head = text[: text.index('id="replay-page"')]
    assert "http://" not in head.replace("http://www.w3.org/2000/svg", "")
    assert "https://" not in head
    assert "<script src" not in text
    assert "MeshCat.Viewer" in embedded(page, "replay-page")


def test_figures_of_the_step_lie_beside_the_page(page):
    for extension in ("png", "pdf"):
        assert (page.parent / f"linear_FL_hip_step_12.{extension}").exists()


@pytest.mark.parametrize("kind", ["statewise_linear", "symbolic", "statewise_symbolic"])
def test_products_are_the_terms(kind, generator):
    policy = load_student("trot", kind)
    names = policy.observation_names
    observations = 0.5 * generator.normal(size=(20, len(names)))
    states = generator.integers(2, size=20)
    observations[:, machine_state_entries(names)] = np.eye(2)[states]
    for joint in (0, 5):
        values = policy.explain(observations, joint).values
        own = products(policy, joint)
        assert len(own) == values.shape[1]
        for product, value in zip(own, values.T, strict=True):
            factors = Tape(product.quantities, len(names))(observations)
            weights = np.broadcast_to(product.weights, 2)[states]
            mine = (states == product.state) | (product.state is None)
            expected = np.where(mine, weights * factors.prod(axis=-1), 0.0)
            np.testing.assert_allclose(value, expected, rtol=1e-9)


def test_names_of_a_gait_are_text_and_nothing_else(trot, tmp_path):
    states = ("<b>bold</b>", "</script><script>throw 1</script>")
    gait = replace(trot, states=states, description="<i>slanted</i>")
    names = load_expert("trot").observation_names
    policy = LinearPolicy("trot", names, np.zeros((12, len(names))), np.zeros(12))
    values = {"observations": len(names), "actions": 12, "rm_state": 2, "rm_iterations": 1}
    rollout = Rollout(
        np.zeros(2), {name: np.zeros((2, n)) for name, n in {**values, "foot_contact": 4}.items()}
    )
    page = render_page(
        gait=gait,
        policy_name="<u>mine</u>",
        observation_names=names,
        rollout=rollout,
        explained=explain_rollout(policy, rollout),
        replay="",
        joint=0,
        step=0,
        figures=[],
    )
    for tag in ("<b>bold", "<i>slanted", "<u>mine", "<script>throw"):
        assert tag not in page
    path = tmp_path / "index.html"
    path.write_text(page)
    assert tuple(embedded(path, "data")["states"]) == states


def test_each_student_has_a_folder_of_its_own(students, tmp_path, monkeypatch, refused):
    monkeypatch.chdir(tmp_path)
    short = ["explain", "--seconds", "0.2", "--step", "5"]
    main([*short, "--policy", "linear", "--distillation", str(students)])
    page = tmp_path / "runs" / "explanation" / "trot" / "linear" / "index.html"
    before = page.read_bytes()
    main([*short, "--policy", "statewise_linear"])
    assert page.with_name("index.html").read_bytes() == before
    folder = ["--output", str(page.parent)]
    assert "page of another student" in refused([*short, "--policy", "statewise_linear", *folder])
    assert page.read_bytes() == before
    main([*short, "--policy", "linear", "--distillation", str(students), "--joint", "FR_calf"])
    assert page.read_bytes() != before


def test_a_page_of_something_else_is_kept(tmp_path, refused):
    page = tmp_path / "index.html"
    page.write_text("mine")
    assert "did not write" in refused(["explain", "--output", str(tmp_path)])
    assert page.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [page]


def test_a_short_rollout_is_shown_at_its_last_step(students, tmp_path):
    where = ["--distillation", str(students), "--output", str(tmp_path)]
    main(["explain", "--policy", "linear", "--seconds", "0.2", *where])
    assert embedded(tmp_path / "index.html", "data")["step"] == 10
    assert yaml.safe_load((tmp_path / "config.yaml").read_text())["step"] == 10
    assert (tmp_path / "linear_FL_hip_step_10.png").exists()


def test_additive_models_are_told_of_on_their_pages_alone(page, tmp_path):
    assert "additive model" not in page.read_text()
    main(["explain", "--policy", "ebm", "--seconds", "0.2", "--output", str(tmp_path)])
    assert "additive model is a function" in (tmp_path / "index.html").read_text()


@pytest.fixture(scope="module")
def few():
    """A student with 3 terms in one state of the machine and 16 in the other, a step in each."""
    names = load_expert("trot").observation_names
    variables = variable_names(len(names))
    long = " + ".join(f"0.00{i + 1} * x{i}" for i in range(15))
    texts = ("0.1 + 0.01 * x3 + 0.02 * x5", f"-0.1 + {long}")
    expressions = [[parse_expression(text, variables)] * 12 for text in texts]
    policy = StatewiseSymbolicPolicy("trot", names, expressions)
    observations = 0.5 * np.random.default_rng(5).normal(size=(2, len(names)))
    observations[:, machine_state_entries(names)] = np.eye(2)
    values = {"observations": observations, "actions": policy(observations)}
    values |= {"rm_state": np.eye(2), "rm_iterations": np.zeros((2, 1))}
    return policy, Rollout(np.array([0.0, 0.02]), {**values, "foot_contact": np.zeros((2, 4))})


@pytest.fixture(scope="module")
def few_page(few, tmp_path_factory):
    policy, rollout = few
    path = tmp_path_factory.mktemp("few") / "index.html"
    text = render_page(
        gait=load_gait("trot"),
        policy_name="few",
        observation_names=policy.observation_names,
        rollout=rollout,
        explained=explain_rollout(policy, rollout),
        replay="",
        joint=0,
        step=0,
        figures=[],
    )
    path.write_text(text)
    return path


def test_terms_of_other_states_are_none_of_the_actions(few_page):
    data = embedded(few_page, "data")
    assert data["state"] == [0, 1]
    for joint in data["explained"]:
        own = zip(data["state"], joint["index"], joint["value"], joint["others"], strict=True)
        for state, index, value, others in own:
            assert {joint["terms"][k]["state"] for k in index} == {state}
            assert (len(index), others) == ((3, 0), (14, 2))[state]
            assert len(value) == len(index)
        total = np.array([sum(value) for value in joint["value"]]) + joint["rest"]
        np.testing.assert_allclose(total, joint["action"], atol=2e-4)


def test_browser_shows_the_terms_of_the_state_alone(few_page, browser):
    shown = {}
    for state in (0, 1):
        browser.get("about:blank")
        browser.get(f"file://{few_page}#joint=FL_hip&step={state}")
        rows = browser.find_elements("css selector", "#local tbody td.term")
        shown[state] = browser.find_element("id", "which").text, [row.text for row in rows]
    which, terms = shown[0]
    assert which == "All 3 terms"
    assert (len(terms), terms.count("intercept"), terms[-1]) == (4, 1, "sum = action")
    which, terms = shown[1]
    assert which == "The 14 largest terms"
    assert (len(terms), terms.count("intercept")) == (16, 1)
    assert terms[-2:] == ["2 other terms", "sum = action"]


def test_the_figure_of_the_step_has_the_terms_of_the_state_alone(few):
    policy, rollout = few
    own = explain_rollout(policy, rollout)[0]
    for step, count in ((0, 3), (1, 16)):
        parts = own.active_of(policy.explain(rollout["observations"][step], 0), step)
        assert len(parts.terms) == len(parts.values) == count
        assert parts.values.sum() == pytest.approx(rollout["actions"][step, 0])


@pytest.fixture(scope="module")
def formulas(tmp_path_factory):
    """The page of formulas that ship, whose terms have long names."""
    output = tmp_path_factory.mktemp("formulas")
    short = ["--seconds", "0.8", "--step", "12", "--output", str(output)]
    main(["explain", "--policy", "statewise_symbolic", *short])
    return output / "index.html"


@pytest.fixture
def opened(browser, formulas):
    browser.get("about:blank")
    browser.get(f"file://{formulas}#joint=FR_thigh&step=30")
    return browser


def title(browser):
    return browser.find_element("id", "local-title").text


def eventually(found, wanted, seconds=30.0):
    end = time.monotonic() + seconds
    while found() != wanted and time.monotonic() < end:
        time.sleep(0.1)
    assert found() == wanted


def test_browser_shows_the_moment_that_a_link_names(opened, formulas):
    action = embedded(formulas, "data")["explained"][4]["action"][30]
    sign = "−" if action < 0 else "+"
    assert title(opened) == f"FR thigh at step 30: action {sign}{abs(action):.3f}"
    assert "0.60 s" in opened.find_element("id", "moment").text
    for link, shown in (("joint=2&step=7", "FL calf at step 7"), ("step=9", "FL calf at step 9")):
        opened.execute_script("location.hash = arguments[0]", link)
        eventually(lambda: title(opened).split(":")[0], shown)
    opened.execute_script("location.hash = 'joint=FL_knee&step=9999'")
    eventually(lambda: title(opened).split(":")[0], "FL calf at step 9")


def test_the_address_names_what_is_shown(opened):
    opened.find_element("tag name", "body").send_keys("\ue014")  # the right arrow
    eventually(lambda: opened.current_url.split("#")[1], "joint=FR_thigh&step=31")


def test_keys_work_after_the_replay_was_dragged(opened):
    opened.switch_to.frame("replay")
    eventually(lambda: opened.execute_script("return typeof viewer"), "object")
    opened.find_element("tag name", "canvas").click()
    focused = opened.switch_to.active_element
    focused.send_keys("\ue014")
    opened.switch_to.default_content()
    assert opened.execute_script("return document.activeElement.tagName") == "IFRAME"
    eventually(lambda: title(opened).split(":")[0], "FR thigh at step 31")


@pytest.mark.parametrize("width", [1280, 500])
def test_no_label_is_cut(opened, width):
    opened.set_window_size(width, 900)
    cut = opened.execute_script(
        "return [...document.querySelectorAll('td, th')]"
        ".filter(cell => cell.scrollWidth > cell.clientWidth).map(cell => cell.textContent)"
    )
    assert cut == []
    assert opened.execute_script(
        "const all = document.documentElement; return all.scrollWidth <= all.clientWidth"
    )
    terms = [cell.text for cell in opened.find_elements("css selector", "td.term")]
    assert any(len(term) > 20 for term in terms)
    assert not any("…" in term for term in terms)


def test_a_reader_can_check_every_product_by_hand(opened):
    opened.execute_script("document.getElementById('observations').open = true")
    eventually(lambda: len(opened.find_elements("css selector", "#values tr")) > 49, True)
    table = opened.find_elements("css selector", "#values tbody tr")
    cells = [[cell.text for cell in row.find_elements("tag name", "td")] for row in table]
    values = {name: value for name, value, _ in cells}
    units = {name: unit for name, _, unit in cells}
    assert units["Foot Height RL"] == "m"
    assert units["DoF Vel FR Calf"] == "0.05 · rad/s"
    checked = 0
    for row in opened.find_elements("css selector", "#local tbody tr"):
        term, product, adds = [cell.text for cell in row.find_elements("tag name", "td")][:3]
        if not product:
            continue
        _, *factors = product.split(" × ")
        names = [] if term == "intercept" else term.split(" · ")
        assert factors == [values[name] for name in names]
        numbers = [float(factor.replace("−", "-")) for factor in product.split(" × ")]
        assert np.prod(numbers) == pytest.approx(float(adds.replace("−", "-")), rel=2e-3, abs=1e-3)
        checked += 1
    assert checked == 14


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--gait", "gallop"], "gallop"),
        (["--joint", "FL_knee"], "unknown joint 'FL_knee'; the joints are FL_hip"),
        (["--step", "900", "--seconds", "0.2"], "name one from 0 to 10"),
        (["--step", "-1"], "step is -1; it must be"),
        (["--seconds", "0"], "seconds is 0.0; it must be"),
        (["--seconds", "nan"], "seconds is nan; it must be"),
        (["--seconds", "1e308"], "it must be 3600 or less"),
        (["--seconds", "1e18"], "it must be 3600 or less"),
        (["--seed", "-1"], "seed is -1; it must be"),
        (["--seed", "99999999999999999999"], "it must be less than 2147483648"),
        (["--policy", "expert"], "the expert's actions are no sums of terms; name a student"),
        (["--policy", "forest"], "unknown policy 'forest'"),
        (["--policy", "open_loop"], "kind 'open_loop' do not split into contributions"),
        (["--policy", "ebm"], "distil it again for this layout"),
        (["--policy", "gbm"], "no student 'gbm' of the trot"),
    ],
)
def test_bad_input_is_told(students, tmp_path, refused, arguments, message):
    policy = [] if "--policy" in arguments else ["--policy", "linear"]
    where = ["--distillation", str(students), "--output", str(tmp_path / "page")]
    assert message in refused(["explain", *policy, *arguments, *where])
    assert not (tmp_path / "page").exists()
