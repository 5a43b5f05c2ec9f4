"""DDS: where messages go, and what is said where they cannot."""

import sys

import pytest

from glassgait.models.errors import InputError
from glassgait.models.link.dds import DdsSettings, open_robots_end


def test_by_default_nothing_leaves_the_machine_or_meets_a_robot():
    settings = DdsSettings()
    assert settings.interface == "lo"
    assert settings.domain != 0


@pytest.mark.parametrize(
    "interface", ["", "a b", 'lo"/><x a="', "a" * 16, "../lo", "lo\n"], ids=repr
)
def test_interfaces_that_are_none_are_refused(interface):
    with pytest.raises(InputError, match="interface is"):
        DdsSettings(interface=interface)


def test_without_the_extra_a_person_is_told_how_to_install_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[unitree\]'"):
        open_robots_end(DdsSettings())


def test_an_interface_that_this_machine_lacks_is_refused():
    pytest.importorskip("cyclonedds", reason="needs the extra unitree")
    with pytest.raises(InputError, match=r"interface 'none0' cannot be used"):
        open_robots_end(DdsSettings(interface="none0", domain=209))
