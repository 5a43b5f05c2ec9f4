"""The studio in a browser: what a person types and clicks reaches the robot and the file."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from glassgait.models.policies.library import load_policy
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.policies import find_policies

pytestmark = pytest.mark.slow

PATIENCE = 180.0
"""Seconds that a step may take on a machine with other work."""

SECOND = 50
"""Control steps of a second."""

PROGRAM = "from glassgait.studies.cli import main; main()"


@pytest.fixture(scope="module")
def served(tmp_path_factory):
    """The command as a person starts it: the address of its page, its folder and its process."""
    folder = tmp_path_factory.mktemp("studio")
    command = [sys.executable, "-c", PROGRAM, "studio", "--port", "0", "--output", str(folder)]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, env=os.environ
    )
    assert process.stdout is not None
    address = None
    for line in process.stdout:
        if found := re.search(r"open (http://127\.0\.0\.1:\d+)", line):
            address = found[1]
            break
    assert address is not None
    yield address, folder, process
    if process.poll() is None:
        process.kill()
        process.wait()


@pytest.fixture(scope="module")
def page(browser, served):
    """The page, once the robot has walked for a second."""
    browser.set_script_timeout(PATIENCE)
    until(lambda: reached(browser, served[0]))
    until(lambda: moment(browser) > 0)
    until(lambda: browser.execute_script("return document.querySelector('iframe') !== null"))
    # Where no graphics card draws, Meshcat's picture would take what the page needs.
    browser.execute_script("document.querySelector('iframe').remove()")
    until(lambda: moment(browser) > SECOND)
    return browser


def reached(browser, address):
    # The line is printed before the server answers.
    try:
        browser.get(address)
    except Exception:
        return False
    return True


def until(condition, patience=PATIENCE):
    end = time.monotonic() + patience
    while time.monotonic() < end:
        found = condition()
        if found:
            return found
        time.sleep(0.05)
    raise AssertionError("has not come about in time")


def moment(page):
    return int(page.execute_script("return document.body.dataset.moment || 0"))


def steps(page, n_steps):
    """The last control steps of the page: state, contacts, target, robot's and ghost's joint."""
    return np.array(page.execute_script(f"return studio.steps.slice(-{n_steps})"))


def click(page, selector):
    page.execute_script("document.querySelector(arguments[0]).click()", selector)


def type_number(page, selector, value):
    page.execute_script(
        "const own = document.querySelector(arguments[0]); own.value = arguments[1];"
        "own.dispatchEvent(new Event('change'))",
        selector,
        value,
    )


def text(page, selector):
    return page.execute_script("return document.querySelector(arguments[0]).textContent", selector)


def value_of(page, selector):
    return page.execute_script("return document.querySelector(arguments[0]).value", selector)


CONSTANT = "#terms .row[data-term='0'] input[type=number]"


def test_the_studio_answers_in_a_browser(page, served):
    """One robot, one session: each part goes on from where the one before left it."""
    robot_and_ghost_walk_alike(page)
    a_typed_coefficient_changes_the_gait_within_a_second(page)
    the_certificate_is_void(page)
    undo_restores_the_digits(page)
    a_push_is_answered(page)
    malformed_messages_change_nothing(page)
    verify_marks_a_lost_claim(page)
    a_saved_file_is_the_same_policy(page, served[1])
    errors = [own for own in page.get_log("browser") if own["level"] == "SEVERE"]
    assert not errors
    ctrl_c_ends_it_in_a_sentence(served[2])


def robot_and_ghost_walk_alike(page):
    recent = steps(page, SECOND)
    np.testing.assert_array_equal(recent[:, 6], recent[:, 7])
    assert set(recent[:, 0]) == {0, 1}


def a_typed_coefficient_changes_the_gait_within_a_second(page):
    click(page, "#parts button[data-value=thigh]")
    until(lambda: text(page, "#joint-title") == "FL thigh")
    type_number(page, CONSTANT, "0.75")
    until(lambda: text(page, "#changed") == "1 number changed")
    begun = moment(page)
    until(lambda: moment(page) >= begun + SECOND)
    recent = steps(page, SECOND)
    # By simulated time: a second after the change the robot is no longer its ghost.
    assert abs(recent[:, 6].mean() - recent[:, 7].mean()) > 0.02


def the_certificate_is_void(page):
    until(lambda: "certificate void" in text(page, "#certificate"))
    until(lambda: "+FL_thigh = 0.75 + " in text(page, "#diff"))


def undo_restores_the_digits(page):
    click(page, "#undo")
    until(lambda: value_of(page, CONSTANT) == "0.551")
    until(lambda: "certificate holds" in text(page, "#certificate"))
    assert text(page, "#diff") == ""


def a_push_is_answered(page):
    click(page, "#restart")
    begun = moment(page)
    until(lambda: moment(page) >= begun + 2 * SECOND)
    before = steps(page, SECOND)[:, 6].std()
    click(page, ".pad button[data-angle='90']")
    begun = moment(page)
    until(lambda: moment(page) >= begun + SECOND // 2)
    pushed = steps(page, SECOND // 2)[:, 6]
    assert abs(pushed - steps(page, 4 * SECOND)[:SECOND, 6].mean()).max() > before


def malformed_messages_change_nothing(page):
    page.execute_script(
        "for (const own of [null, 7, 'x', {}, {kind: 'exec'}, {kind: 'push', angle: 'x'},"
        "{kind: 'act', what: 'save', path: '/tmp/x'}, {kind: 'joint', joint: 'x'}])"
        " emitEvent('studio', own)"
    )
    begun = moment(page)
    until(lambda: moment(page) >= begun + SECOND)
    assert text(page, "#changed") == ""


def verify_marks_a_lost_claim(page):
    click(page, "#parts button[data-value=hip]")
    until(lambda: text(page, "#joint-title") == "FL hip")
    row = page.execute_script(
        "return [...document.querySelectorAll('#terms .row')].find("
        "own => own.querySelector('var').textContent === 'q.FL_calf').dataset.term"
    )
    type_number(page, f"#terms .row[data-term='{row}'] input[type=number]", "30")
    until(lambda: text(page, "#changed") == "1 number changed")
    click(page, "nav [data-tab=verify]")
    click(page, "#verify")
    until(lambda: "✗ lost" in text(page, "#claims"), 480.0)
    click(page, "#tab-verify .halt")
    click(page, "#undo")


def a_saved_file_is_the_same_policy(page, folder):
    click(page, "nav [data-tab=formula]")
    type_number(page, CONSTANT, "0.3")
    until(lambda: text(page, "#changed") == "1 number changed")
    click(page, "#save")
    saved = until(lambda: next(iter(folder.glob("*_edited.formulas")), None))
    shipped = find_policies(load_gait("trot"), quiet=True).policy("sparse_formula")
    assert "\nFL_hip = 0.3 - 0.0693*cmd.yaw" in saved.read_text()
    assert saved.read_text() == shipped.to_text().replace("FL_hip = 0.32 -", "FL_hip = 0.3 -")
    assert load_policy(saved).to_text() == saved.read_text()


def ctrl_c_ends_it_in_a_sentence(process):
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "Traceback" not in output
