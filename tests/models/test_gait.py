"""Gait files: the shipped ones, and invalid ones."""

import re

import pytest

from glassgait.models.errors import InputError
from glassgait.models.task.gait import GAIT_DIRECTORY, load_gait

GOOD = re.sub(" +#.*", "", (GAIT_DIRECTORY / "trot.yaml").read_text())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("states: [q0, q1]", "states: [q0, q1, q2]"), "state 'q2' cannot be reached"),
        (("when: FR & RL & ~FL & ~RR}", "when: FR}\n  - {from: q1, to: q1, when: FR & FL}"),
         "can fire together"),
        (("initial: q0", "initial: q0\nfaults: [q2]"), "faults names unknown state 'q2'"),
        (("to: q1,", "to: q9,"), "transitions.0..to names unknown state 'q9'"),
        (("to: q1,", "until: q1,"), "unknown key 'transitions.0..until'"),
        (("clearance: 0.03\n", ""), "lacks the key 'clearance'"),
        (("clearance: 0.03", "clearance: -1"), "clearance is -1; it must be"),
        (("dwell: [6, 11]", "dwell: [11, 6]"), "dwell is .*the least, then the greatest"),
        (("description:", "name: hop\ndescription:"), "unknown key 'name'"),
        (("Diagonal pairs", "x" * 501), "1 to 500 printable"),
        (("states: [q0, q1]", "states: [q0, 'q1 ']"), "without spaces at the ends"),
        (("states: [q0, q1]", "states: [q0, 'a\u202eb']"), "printable characters"),
        (("states: [q0, q1]", "states: [q0, " + "q" * 41 + "]"), "1 to 40 printable"),
        (("states: [q0, q1]", f"states: [{', '.join(f's{i}' for i in range(33))}]"), "at most 32"),
    ],
)  # fmt: skip
def test_bad_files_are_refused_in_one_sentence_that_names_the_file(tmp_path, change, message):
    path = tmp_path / "mine.yaml"
    path.write_text(GOOD.replace(*change))
    with pytest.raises(InputError, match=message) as raised:
        load_gait(path)
    assert str(path) in str(raised.value)
    assert str(raised.value).isprintable()
    assert len(str(raised.value)) < 500


@pytest.mark.parametrize(
    "name", [*("...yaml", ".x.yaml", " x.yaml", "a\nb.yaml", "config.yaml"), f"{'步' * 40}.yaml"]
)
def test_files_whose_name_can_name_no_gait_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_text(GOOD)
    with pytest.raises(InputError, match="name is"):
        load_gait(path)


@pytest.mark.parametrize("name", ["", ".", "..", "../gaits/trot", "x" * 5000, "a\nb", "\udcff"])
def test_names_that_are_no_gaits_are_refused(name):
    with pytest.raises(InputError, match=r"unknown gait .*half_bound") as raised:
        load_gait(name)
    assert str(raised.value).isprintable()


def test_a_file_is_loaded_by_its_path_and_does_not_pass_for_a_gait_that_ships(tmp_path):
    (tmp_path / "hop.yaml").write_text(GOOD)
    assert load_gait(tmp_path / "hop.yaml").name == "hop"
    text = (GAIT_DIRECTORY / "trot.yaml").read_text()
    path = tmp_path / "trot.yaml"
    path.write_text(text)
    assert load_gait(path) == load_gait("trot")
    path.write_text(text.replace("clearance: 0.03", "clearance: 0.05"))
    with pytest.raises(InputError, match="trot"):
        load_gait(path)
