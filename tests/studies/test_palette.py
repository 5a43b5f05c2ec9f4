"""Colours: text and marks stand out from their ground, and a policy has one colour everywhere."""

import re

import pytest

from glassgait.models.task.palette import COLORS, FAULT_COLORS, GROUND, INK, contrast, ink_on
from glassgait.studies.common.pages import SHARED_TEMPLATES
from glassgait.studies.distillation.students.registry import (
    OTHER_COLOR,
    OTHER_MARKER,
    STUDENTS,
    policy_color,
    policy_marker,
)
from glassgait.studies.explanation.interventions.command import FAILS, HOLDS

TEXT, MARK = 4.5, 3.0
PALETTE = dict(
    re.findall(r"--(\w+): (#[0-9a-f]{6})", (SHARED_TEMPLATES / "palette.css").read_text())
)

# Brettel, Viénot and Mollon by the matrices of Machado et al. (2009), of full severity.
BLIND = {
    "protan": ((0.152286, 1.052583, -0.204868), (0.114503, 0.786281, 0.099216),
               (-0.003882, -0.048116, 1.051998)),
    "deutan": ((0.367322, 0.860646, -0.227968), (0.280085, 0.672501, 0.047413),
               (-0.011820, 0.042940, 0.968881)),
}  # fmt: skip


def test_contrast_is_that_of_wcag():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.01)
    assert contrast("#123456", "#123456") == 1.0


@pytest.mark.parametrize("ground", ["ground", "shade", "mark"])
@pytest.mark.parametrize("text", ["ink", "soft", "link"])
def test_text_can_be_read(text, ground):
    assert contrast(PALETTE[text], PALETTE[ground]) >= TEXT


@pytest.mark.parametrize("mark", ["up", "down", "total", "edge", "now"])
def test_marks_stand_out(mark):
    assert contrast(PALETTE[mark], PALETTE["ground"]) >= MARK


@pytest.mark.parametrize("color", [*COLORS, *FAULT_COLORS])
def test_names_of_states_can_be_read_on_their_colours(color):
    assert contrast(ink_on(color), color) >= TEXT


def test_pages_and_pictures_share_ink_and_ground():
    assert (PALETTE["ink"], PALETTE["ground"]) == (INK, GROUND)


@pytest.mark.parametrize(
    "color", [OTHER_COLOR, HOLDS, FAILS, *(s.color for s in STUDENTS.values())]
)
def test_marks_of_figures_stand_out(color):
    assert contrast(color, GROUND) >= MARK


def test_policies_are_distinguished_without_colours_too():
    looks = [(own.color, own.marker) for own in STUDENTS.values()]
    markers = [marker for _, marker in looks] + [OTHER_MARKER]
    assert len(set(markers)) == len(markers)
    assert (policy_color("gbm"), policy_marker("gbm")) == (STUDENTS["gbm"].color, "o")
    assert (policy_color("expert"), policy_marker("mine")) == (OTHER_COLOR, OTHER_MARKER)


@pytest.mark.parametrize("sight", BLIND)
def test_more_and_less_differ_for_colour_blind_readers(sight):
    def seen(color):
        linear = [(int(color[i : i + 2], 16) / 255) ** 2.2 for i in (1, 3, 5)]
        return [sum(w * c for w, c in zip(row, linear, strict=True)) for row in BLIND[sight]]

    up, down = seen(PALETTE["up"]), seen(PALETTE["down"])
    assert sum((a - b) ** 2 for a, b in zip(up, down, strict=True)) ** 0.5 > 0.3
