"""The page that explains a rollout: its numbers, its files, and what it refuses."""

import json
import re

import numpy as np
import pytest

from glassgait.diagrams.rollout import Rollout
from glassgait.models.formulas.evaluate import Tape
from glassgait.models.formulas.grammar import parse_expression, variable_names
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.library import STUDENT_DIRECTORY, load_expert, load_student
from glassgait.models.policies.symbolic import FormulaPolicy, SymbolicPerStatePolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.gait import load_gait
from glassgait.models.task.observation import machine_state_entries
from glassgait.studies.cli import main
from glassgait.studies.explanation.page import explain_rollout, render_page
from glassgait.studies.explanation.policy_data import file_lines, variables_of


def embedded(page, name):
    """Reads what a page holds under a name."""
    found = re.search(rf'id="{name}" type="application/json">(.*?)</script>', page.read_text())
    assert found is not None
    return json.loads(found.group(1))


@pytest.fixture(scope="module")
def few():
    """A student with 3 terms in one state of the machine and 32 in the other, a step in each."""
    names = load_expert("trot").observation_names
    variables = variable_names(len(names))
    long = " + ".join(f"{i + 1}e-4 * x{i}" for i in range(31))
    texts = ("0.1 + 0.01 * x3 + 0.02 * x5", f"-0.1 + {long}")
    expressions = [[parse_expression(text, variables)] * 12 for text in texts]
    policy = SymbolicPerStatePolicy("trot", names, expressions)
    observations = 0.5 * np.random.default_rng(5).normal(size=(2, len(names)))
    observations[:, machine_state_entries(names)] = np.eye(2)
    values = {"observation": observations, "action": policy(observations)}
    values |= {"rm_state": np.eye(2), "rm_iterations": np.zeros((2, 1))}
    return policy, Rollout(np.array([0.0, 0.02]), {**values, "foot_contact": np.zeros((2, 4))})


@pytest.fixture(scope="module")
def few_page(few, tmp_path_factory):
    """The page that explains the two steps of the student with few terms."""
    policy, rollout = few
    page = render_page(
        gait=load_gait("trot"),
        policy_name="few",
        policy=policy,
        rollout=rollout,
        explained=explain_rollout(policy, rollout),
        replay="",
        joint=0,
        step=0,
        figures=[],
    )
    path = tmp_path_factory.mktemp("few") / "index.html"
    path.write_text(page)
    return path


@pytest.fixture(scope="module")
def page(few_students, tmp_path_factory):
    output = tmp_path_factory.mktemp("page")
    where = ["--source", str(few_students), "--output", str(output)]
    main(["explain", "page", "--policy", "linear", "--n-steps", "40", "--step", "12", *where])
    return output / "index.html"


def test_shown_terms_and_the_rest_are_the_target(page):
    data = embedded(page, "data")
    assert data["step"] == 12
    assert {"cmd.v", "dq.FL_hip", "h.RR"} <= {*data["quantities"]}
    assert len(data["explained"]) == 12
    assert len(data["state"]) == len(data["contact"]) == len(data["values"]) == 41
    for joint in data["explained"]:
        assert joint["error"] < 1e-9
        total = np.sum(joint["value"], axis=1) + joint["rest"]
        np.testing.assert_allclose(total, joint["target"], atol=2e-4)
        assert (np.diff(joint["index"], axis=1) > 0).all()


def test_page_needs_nothing_from_elsewhere(page):
    text = page.read_text()
    head = text[: text.index('id="replay-page"')]
    assert "http://" not in head.replace("http://www.w3.org/2000/svg", "")
    assert "https://" not in head
    assert "<script src" not in text
    assert "MeshCat.Viewer" in embedded(page, "replay-page")


@pytest.mark.parametrize("kind", ["linear_per_state", "symbolic", "formulas"])
def test_factors_are_those_of_the_terms(kind, generator):
    policy = load_student("trot", kind)
    names = policy.observation_names
    observations = 0.5 * generator.normal(size=(20, len(names)))
    states = generator.integers(2, size=20)
    observations[:, machine_state_entries(names)] = np.eye(2)[states]
    variables = variables_of(policy, observations)[2]
    for joint in (0, 5):
        values = policy.explain(observations, joint).values
        own = policy.factored_terms(joint)
        assert len(own) == values.shape[1]
        for product, value in zip(own, values.T, strict=True):
            factors = Tape(product.quantities, variables.shape[1])(variables)
            weights = np.broadcast_to(product.weights, 2)[states]
            mine = (states == product.state) | (product.state is None)
            expected = np.where(mine, weights * factors.prod(axis=-1), 0.0)
            np.testing.assert_allclose(value, expected, rtol=1e-9)


def test_a_short_rollout_is_shown_at_its_last_step(few_students, tmp_path):
    where = ["--source", str(few_students), "--output", str(tmp_path)]
    main(["explain", "page", "--policy", "linear", "--n-steps", "10", *where])
    assert embedded(tmp_path / "index.html", "data")["step"] == 10
    assert (tmp_path / "linear_FL_hip_step_10.png").exists()


def test_terms_of_other_states_are_none_of_the_actions(few_page):
    data = embedded(few_page, "data")
    assert data["state"] == [0, 1]
    for joint in data["explained"]:
        own = zip(data["state"], joint["index"], joint["value"], joint["others"], strict=True)
        for state, index, value, others in own:
            assert {joint["terms"][k]["state"] for k in index} == {state}
            assert (len(index), others) == ((3, 0), (14, 18))[state]
            assert len(value) == len(index)
        total = np.array([sum(value) for value in joint["value"]]) + joint["rest"]
        np.testing.assert_allclose(total, joint["target"], atol=2e-4)


def test_the_figure_of_the_step_has_the_terms_of_the_state_alone(few):
    policy, rollout = few
    own = explain_rollout(policy, rollout)[0]
    for step, count in ((0, 3), (1, 32)):
        parts = own.active_of(policy.explain(rollout["observation"][step], 0), step)
        assert len(parts.terms) == len(parts.values) == count
        assert parts.values.sum() == pytest.approx(own.targets[step])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--joint", "FL_knee"], "unknown joint 'FL_knee'; the joints are FL_hip"),
        (["--step", "900", "--n-steps", "10"], "name one from 0 to 10"),
        (["--policy", "expert"], "its actions are no sums of terms; name one of"),
    ],
)
def test_bad_input_is_refused(few_students, tmp_path, refused, arguments, message):
    policy = [] if "--policy" in arguments else ["--policy", "linear"]
    where = ["--source", str(few_students), "--output", str(tmp_path / "formulas")]
    assert message in refused(["explain", "page", *policy, *arguments, *where])
    assert not (tmp_path / "formulas").exists()


MIRRORED = "format: 2\ngait: trot\nstates: 2\nmirror: [1, 0]\n\nstate 0\n" + "".join(
    f"{joint} = 0.{place + 1}*q.{joint}\n" for place, joint in enumerate(quadruped.JOINTS)
)


@pytest.mark.parametrize(
    ("gait", "kind", "robot"),
    [
        # These have no mirror.
        ("trot", "symbolic", "a1"),
        pytest.param("bound", "symbolic_per_state", "go2", marks=pytest.mark.slow),
    ],
)
def test_every_joint_has_its_lines_in_every_state(gait, kind, robot):
    policy = load_student(gait, kind, load_robot(robot))
    assert isinstance(policy, FormulaPolicy)
    file = file_lines(policy, 2)
    assert file["lines"] == policy.to_text().splitlines()
    for state in range(2):
        for joint, (first, end) in zip(quadruped.JOINTS, file["acting"][state], strict=True):
            own = file["lines"][first:end]
            assert own[0].startswith(f"{joint} = ")
            assert all(line.startswith("    ") for line in own[1:])
            assert not file["lines"][end : end + 1] or not file["lines"][end].startswith(" ")
    assert not any(map(any, file["mirrored"]))
    assert (file["acting"][0] == file["acting"][1]) == (kind == "symbolic")


def test_a_mirror_images_lines_are_those_of_the_other_side():
    file = file_lines(FormulaPolicy.from_file(read_formulas(MIRRORED)), 2)
    stored, mirrored = file["mirrored"]
    assert stored == [None] * 12
    assert all(
        lines[0].startswith(f"{j} = ") for j, lines in zip(quadruped.JOINTS, mirrored, strict=True)
    )
    left, right = quadruped.JOINTS.index("FL_calf"), quadruped.JOINTS.index("FR_calf")
    assert file["acting"][1][right] == file["acting"][0][left]
    first, _ = file["acting"][1][right]
    assert file["lines"][first].startswith("FL_calf = ")


def test_the_shipped_file_is_printed_with_its_programs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["explain", "formulas", "--gait", "trot"])
    printed = capsys.readouterr().out
    text = (STUDENT_DIRECTORY / "trot" / "formulas.formulas").read_text()
    assert printed.startswith(text)
    for line in ("reach = torque/40", "near = stood and norm(predicted + sole) < 1"):
        assert line in printed
    assert read_formulas(printed) == read_formulas(text)


def test_the_lines_of_one_joint_or_latex_are_printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    main(["explain", "formulas", "--gait", "trot", "--joint", "RL_calf"])
    lines = capsys.readouterr().out.splitlines()
    assert [line for line in lines if line.startswith("state")] == ["state 0"]
    joints = [line.split(" ")[0] for line in lines if " = " in line and line[0] != " "]
    assert joints == ["RL_calf"]
    main(["explain", "formulas", "--gait", "trot", "--latex"])
    latex = (STUDENT_DIRECTORY / "trot" / "formulas.tex").read_text()
    assert capsys.readouterr().out == latex


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "gbm"], "--policy gbm"),
        (["--joint", "FL_knee"], "unknown joint 'FL_knee'"),
        (["--joint", "FL_hip", "--latex"], "leave --latex or this out"),
        (["--policy", "mine.formulas"], "mine.formulas: line 1, column 1"),
    ],
)
def test_formulas_that_cannot_be_printed_are_refused(
    arguments, message, tmp_path, monkeypatch, refused
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.formulas").write_text("mine")
    assert message in refused(["explain", "formulas", "--gait", "trot", *arguments])
