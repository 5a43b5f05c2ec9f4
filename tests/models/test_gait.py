"""Gait files: those that ship, and those that a person gets wrong."""

import pytest

from models.errors import InputError
from models.task.gait import gait_names, load_gait, parse_gait

GOOD = """
description: Two diagonals.
max_speed: 1.0
max_yaw_rate: 1.0
dwell: [6, 11]
clearance: 0.03
states: [q0, q1]
initial: q0
transitions:
  - {from: q0, to: q1, when: FL & RR & ~FR & ~RL}
  - {from: q1, to: q0, when: FR & RL & ~FL & ~RR}
"""


def test_all_six_gaits_ship():
    assert gait_names() == ("bound", "half_bound", "pace", "three_one", "trot", "walk")


@pytest.mark.parametrize(
    ("name", "n_states"),
    [("trot", 2), ("pace", 2), ("bound", 2), ("walk", 4), ("three_one", 4), ("half_bound", 5)],
)
def test_shipped_gaits_have_their_states(name, n_states):
    gait = load_gait(name)
    assert (gait.name, gait.n_states) == (name, n_states)


def test_a_gait_of_ones_own_is_loaded_by_its_path(tmp_path):
    path = tmp_path / "hop.yaml"
    path.write_text(GOOD)
    assert load_gait(path).name == "hop"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("FL & RR &", "FX & RR &"), "unknown foot 'FX'"),
        (("states: [q0, q1]", "states: [q0, q1, q2]"), "state 'q2' cannot be reached"),
        (("when: FR & RL & ~FL & ~RR}", "when: FR}\n  - {from: q1, to: q1, when: FR & FL}"),
         "can fire together"),
        (("clearance: 0.03\n", ""), "missing key 'clearance'"),
        (("clearance: 0.03", "clearance: high"), "'clearance' must be a number"),
        (("clearance: 0.03", "clearance: -1"), "greater than 0"),
        (("dwell: [6, 11]", "dwell: [11, 6]"), "key 'dwell'"),
        (("initial: q0", "initial: q7"), "unknown state 'q7'"),
        (("to: q1,", "to: q9,"), "unknown state 'q9'"),
        (("to: q1,", "until: q1,"), "unknown key 'until'"),
        (("description:", "colour: red\ndescription:"), "unknown key 'colour'"),
        (("transitions:", "transitions: ["), "not valid YAML"),
        (("states: [q0, q1]", "states: [q0, 1]"), "named by text"),
        (("when: FL", "grace: -1, when: FL"), "key 'grace'"),
        (("when: FL", "dwell: 2, when: FL"), "key 'dwell'"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_in_one_sentence_that_names_the_file(tmp_path, change, message):
    path = tmp_path / "mine.yaml"
    path.write_text(GOOD.replace(*change))
    with pytest.raises(InputError, match=message) as raised:
        load_gait(path)
    assert str(path) in str(raised.value)
    assert "\n" not in str(raised.value)


def test_unknown_gait_lists_the_known_ones():
    with pytest.raises(InputError, match="bound, half_bound, pace, three_one, trot, walk"):
        load_gait("gallop")


def test_missing_file_is_refused(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        load_gait(tmp_path / "none.yaml")


def test_yaml_cannot_make_objects():
    with pytest.raises(InputError, match="not valid YAML"):
        parse_gait("!!python/object/apply:os.system ['true']", name="evil")
