"""Formula files that hold odometry, or observe an IMU."""

import copy

import numpy as np
import pytest

from glassgait.models.errors import InputError
from glassgait.models.estimation.odometry import Odometry
from glassgait.models.formulas.reader import read_formulas
from glassgait.models.policies.controller import AlternatingController, alone
from glassgait.models.policies.library import load_expert, load_policy, load_student
from glassgait.models.policies.symbolic import FormulaPolicy
from glassgait.models.robots import quadruped
from glassgait.models.robots.library import load_robot
from glassgait.models.task.symmetry import REFLECT_JOINTS, reflect_observation

A1 = load_robot()


def page(gait="trot", gain=0.15):
    """The gait's page, with odometry in place of the expert's network."""
    own = copy.copy(load_student(gait, "sparse_formula"))
    own.observes_by, own._estimator = None, Odometry(gain=gain)
    return own


def text_of(gait, *, imu=True, mirror=""):
    """A formula file of a gait whose formulas hold what the IMU measures."""
    stance = zip(quadruped.JOINTS, A1.default_stance, strict=True)
    of_imu = " + 0.1*g.x - 0.02*w.y*g.z" if imu else ""
    formulas = [f"{joint} = {angle} + 0.1*v.x - 0.05*h.FL{of_imu}" for joint, angle in stance]
    header = [f"gait: {gait.name}", f"states: {gait.n_states}"]
    header += ["senses: imu"] if imu else []
    return "\n".join(
        ["format: 1", *header, *([mirror] if mirror else []), "every state", *formulas]
    )


def test_a_file_holds_odometry_whose_gain_can_be_edited(tmp_path):
    own, path = page(), tmp_path / "page.formulas"
    own.save(path)
    text = path.read_text()
    assert "\nodometry\n" in text
    assert load_policy(path).digest() == own.digest()
    assert load_policy(path).to_text() == text
    path.write_text(text.replace("0.15*(measured", "0.4*(measured"))
    edited = load_policy(path)
    assert edited.estimator == Odometry(gain=0.4)
    assert edited.digest() != own.digest()
    # It observes by its own where it acts alone, whatever the expert does.
    expert = load_expert("trot")
    assert alone(edited, expert).estimator == Odometry(gain=0.4)
    with pytest.raises(InputError, match="odometry of its own"):
        AlternatingController(expert, edited, period=4)


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("0.15*(measured", "2*(measured", "line 44, column 17: the gain"),
        ("0.15*(measured", "nan*(measured", "line 44, column 17: the gain"),
        ("0.02*9.81", "0.02*9.8", "line 38, column 46: odometry is one program"),
        ("normal = unit(", "normal = (", "line 46, column 10: odometry is one program"),
        ("stood = touching", "# stood = touching", "line 41, column 1: odometry is one"),
        ("h = dot(normal", "# h = dot(normal", "line 49, column 1: odometry lacks"),
        ("\nmachine", "\nh = 2\n\nmachine", "line 49, column 1: odometry ends"),
        (
            "\nmachine",
            "\nodometry\n\nmachine",
            "line 49, column 1: 'odometry' stands",
        ),
        ("senses: imu", "senses: sonar", "line 4, column 1: senses"),
    ],
)
def test_odometry_that_is_another_program_is_refused(old, new, place):
    text = page().to_text()
    # Spaces and comments make no other program.
    spaced = text.replace("v - 0.02*cross(w, v)", "v   -  0.02 * cross( w,v )")
    assert read_formulas(spaced.replace("# m/s, of the trunk", "# note")).odometry == Odometry()
    assert old in text
    with pytest.raises(InputError) as refused:
        read_formulas(text.replace(old, new, 1))
    assert str(refused.value).startswith(place)


def test_formulas_of_what_an_imu_measures_keep_their_file_and_their_mirror(trot, generator):
    lopsided = FormulaPolicy.from_file(read_formulas(text_of(trot)))
    assert lopsided.layout.imu
    assert FormulaPolicy.from_file(read_formulas(lopsided.to_text())).digest() == lopsided.digest()
    half = text_of(trot, mirror="mirror: 1 0").split("\n")
    whole = [line for line in half if not line.startswith(("FR", "RR"))]
    own = FormulaPolicy.from_file(read_formulas("\n".join(whole)))
    reflect = reflect_observation(own.observation_names, (1, 0))
    observed = generator.normal(size=(20, own.layout.size))
    np.testing.assert_allclose(own(reflect(observed)), REFLECT_JOINTS(own(observed)), atol=1e-12)
    with pytest.raises(InputError, match=r"g\.x"):
        read_formulas(text_of(trot).replace("senses: imu\n", ""))
