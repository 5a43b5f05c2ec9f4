"""The studio in a browser: what a person types and clicks reaches the robot and the file."""

import os
import re
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from glassgait.models.policies.library import STUDENT_DIRECTORY, load_policy
from glassgait.models.task.gait import load_gait
from glassgait.studies.common.policies import find_policies

webdriver = pytest.importorskip("selenium.webdriver", reason="needs Selenium (the dev extra)")
ActionChains, Keys = webdriver.ActionChains, webdriver.Keys

pytestmark = pytest.mark.slow

PATIENCE = 180.0
"""Seconds that a step may take on a machine with other work."""

SECOND = 50
"""Control steps of a second."""

PAGE = STUDENT_DIRECTORY / "trot" / "sparse_formula.formulas"

SHIPPED = re.findall(r"^FL_thigh = (\S+)", PAGE.read_text(), re.MULTILINE)[0]
"""Digits of the constant that is edited, as the page that ships has them."""

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
    the_scene_is_drawn(browser)
    until(lambda: moment(browser) > SECOND)
    return browser


SCENE = """
const [address, done] = arguments;
const wanted = [
  'visualizer/robot/a1/FL_calf', 'visualizer/ghost', 'gait/contact/FL', 'shadow/FL', 'command/tip'
];
const socket = new WebSocket(address.replace('http', 'ws')), held = new Set();
let moved = 0;
socket.binaryType = 'arraybuffer';
socket.onmessage = ({data}) => {
  const head = new Uint8Array(data, 0, Math.min(data.byteLength, 300));
  const text = new TextDecoder('latin1').decode(head);
  for (const own of wanted) if (text.includes(own)) held.add(own);
  moved += text.includes('set_transform') && text.includes('visualizer/robot/a1/FL_calf');
  if (held.size === wanted.length && moved > 25) { socket.close(); done(true); }
};
"""


def the_scene_is_drawn(browser):
    """Meshcat is in the frame, and has robot, ghost, contacts, shadows and command, which move.

    Its own messages are looked at, and the frame is removed: where no graphics card draws,
    Meshcat's picture would take what the page needs.
    """
    frame = until(lambda: browser.find_elements("css selector", "iframe"))[0]
    assert frame.is_displayed()
    address = frame.get_attribute("src")
    browser.execute_script("arguments[0].remove()", frame)
    assert browser.execute_async_script(SCENE, address)


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


def walk_on(page, n_steps):
    end = moment(page) + n_steps
    until(lambda: moment(page) >= end)


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


def test_the_studio_answers_in_a_browser(page, served, find_barriers):
    """One robot, one session: each part goes on from where the one before left it."""
    robot_and_ghost_walk_alike(page)
    a_typed_coefficient_changes_the_gait_within_a_second(page)
    the_certificate_is_void(page)
    undo_restores_the_digits(page)
    a_dragged_coefficient_changes_the_gait_and_is_undone_at_once(page)
    a_gamepad_commands_and_stops_when_it_is_gone(page)
    a_push_is_answered(page)
    malformed_messages_change_nothing(page)
    verify_marks_a_lost_claim(page)
    every_control_is_reached_by_tab(page)
    axe_finds_no_barrier(page, find_barriers)
    nothing_is_wider_than_the_page(page)
    a_saved_file_is_the_same_policy(page, served[1])
    evaluate_counts_falls_of_both(page)
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
    walk_on(page, SECOND)
    recent = steps(page, SECOND)
    # By simulated time: a second after the change the robot is no longer its ghost.
    assert abs(recent[:, 6].mean() - recent[:, 7].mean()) > 0.02


def the_certificate_is_void(page):
    until(lambda: "certificate void" in text(page, "#certificate"))
    until(lambda: "+FL_thigh = 0.75 + " in text(page, "#diff"))


def undo_restores_the_digits(page):
    click(page, "#undo")
    until(lambda: value_of(page, CONSTANT) == SHIPPED)
    until(lambda: "certificate holds" in text(page, "#certificate"))
    assert text(page, "#diff") == ""


def a_dragged_coefficient_changes_the_gait_and_is_undone_at_once(page):
    slider = page.find_element("css selector", "#terms .row[data-term='0'] input[type=range]")
    drag = ActionChains(page).click_and_hold(slider)
    for _ in range(6):
        drag.move_by_offset(2, 0).pause(0.1)
    drag.release().perform()
    until(lambda: text(page, "#changed") == "1 number changed")
    value = until(lambda: (own := value_of(page, CONSTANT)) != SHIPPED and own)
    assert 0.6 < float(value) < 1.2
    walk_on(page, SECOND)
    recent = steps(page, SECOND)
    assert abs(recent[:, 6].mean() - recent[:, 7].mean()) > 0.02
    until(lambda: value in text(page, "#text"))
    click(page, "#undo")
    until(lambda: value_of(page, CONSTANT) == SHIPPED)
    until(lambda: SHIPPED in text(page, "#text"))
    assert page.execute_script("return document.querySelector('#undo').disabled")


def a_gamepad_commands_and_stops_when_it_is_gone(page):
    """By the browser's interface, with a gamepad that is not there."""
    page.execute_script(
        "window.pad = {connected: true, mapping: 'standard', axes: [0, 0, 0, 0], buttons: []};"
        "navigator.getGamepads = () => [window.pad, null]"
    )
    greatest = load_gait("trot").max_speed
    hold = "window.pad.axes = arguments[0]"
    until(lambda: text(page, "#gamepad") == "gamepad connected")
    assert value_of(page, "#speed") == "0.5"
    for gone in ("window.pad = null", "Object.defineProperty(document, 'hidden', {value: true})"):
        page.execute_script(hold, [0.0, -1.0, 0.0, 0.0])
        until(lambda: float(value_of(page, "#speed")) == greatest)
        assert text(page, "#gamepad") == "gamepad commands"
        walk_on(page, SECOND)
        # On a busy machine the page may be late, and the robot stop meanwhile.
        until(lambda: float(value_of(page, "#speed")) == greatest)
        page.execute_script("window.kept = window.pad; " + gone)
        until(lambda: float(value_of(page, "#speed")) == 0.0)
        assert text(page, "#gamepad") == ""
        page.execute_script("window.pad = {...window.kept, axes: [0, 0, 0, 0]}")
    page.execute_script("delete document.hidden; delete navigator.getGamepads")
    page.execute_script(
        "const own = document.querySelector('#speed'); own.value = 0.5;"
        "own.dispatchEvent(new Event('change'))"
    )
    until(lambda: text(page, "#speed + output") == "0.50 m/s")


def a_push_is_answered(page):
    click(page, "#restart")
    walk_on(page, 2 * SECOND)
    before = steps(page, SECOND)[:, 6].std()
    click(page, ".pad button[data-angle='90']")
    walk_on(page, SECOND // 2)
    pushed = steps(page, SECOND // 2)[:, 6]
    assert abs(pushed - steps(page, 4 * SECOND)[:SECOND, 6].mean()).max() > before


def malformed_messages_change_nothing(page):
    page.execute_script(
        "for (const own of [null, 7, 'x', {}, {kind: 'exec'}, {kind: 'push', angle: 'x'},"
        "{kind: 'act', what: 'save', path: '/tmp/x'}, {kind: 'joint', joint: 'x'}])"
        " emitEvent('studio', own)"
    )
    walk_on(page, SECOND)
    assert text(page, "#changed") == ""


def verify_marks_a_lost_claim(page):
    click(page, "#parts button[data-value=hip]")
    until(lambda: text(page, "#joint-title") == "FL hip")
    row = page.execute_script(
        "return [...document.querySelectorAll('#terms .row')].find("
        "own => own.dataset.factors === 'q.FL_calf').dataset.term"
    )
    type_number(page, f"#terms .row[data-term='{row}'] input[type=number]", "30")
    until(lambda: text(page, "#changed") == "1 number changed")
    click(page, "nav [data-tab=verify]")
    click(page, "#verify")
    until(lambda: "✗ lost" in text(page, "#claims"), 480.0)
    click(page, "#tab-verify .halt")
    click(page, "#undo")
    until(lambda: text(page, "#changed") == "")


def evaluate_counts_falls_of_both(page):
    # The robot stands still meanwhile, and leaves the machine to the work.
    click(page, "#pause")
    click(page, "nav [data-tab=evaluate]")
    page.execute_script(
        "for (const own of document.querySelectorAll('#scenarios input'))"
        " own.checked = own.value === 'training'"
    )
    click(page, "#evaluate")
    until(lambda: text(page, "#falls").count(" of 26") == 2, 480.0)
    cells = page.execute_script(
        "return [...document.querySelectorAll('#falls td')].map((own) => own.textContent)"
    )
    assert len(cells) == 3
    assert all(re.fullmatch(r"\d+ of 26", own) for own in cells[1:])


TABS = ("formula", "definitions", "verify", "evaluate", "diff")

CONTROLS = """
const own = [...document.querySelectorAll('#studio :is(button, input, select, [tabindex])')];
window.seen = new Set();
window.dim = [];
document.addEventListener('focusin', (event) => {
  window.seen.add(event.target);
  const {outlineStyle} = getComputedStyle(event.target);
  if (outlineStyle === 'none') window.dim.push(event.target.outerHTML);
});
window.controls = own.filter((each) => each.checkVisibility() && !each.disabled);
document.activeElement.blur();
return window.controls.length;
"""


def every_control_is_reached_by_tab(page):
    click(page, "#pause")
    for tab in TABS:
        click(page, f"nav [data-tab={tab}]")
        n_controls = page.execute_script(CONTROLS)
        assert n_controls > 15
        for _ in range(n_controls // 20 + 2):
            ActionChains(page).send_keys(20 * Keys.TAB).perform()
        missed = page.execute_script(
            "return window.controls.filter((own) => !window.seen.has(own))"
            ".map((own) => own.outerHTML)"
        )
        assert not missed
        assert not page.execute_script("return window.dim")
    click(page, "#pause")


def axe_finds_no_barrier(page, find_barriers):
    click(page, "#terms .row[data-term='1'] input[type=checkbox]")
    until(lambda: text(page, "#changed") == "1 number changed")
    for tab in TABS:
        click(page, f"nav [data-tab={tab}]")
        assert not find_barriers(page, "#studio")
    click(page, "#undo")
    until(lambda: text(page, "#changed") == "")


def nothing_is_wider_than_the_page(page):
    for width in (390, 1000, 1400):
        page.execute_cdp_cmd(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False},
        )
        for tab in TABS:
            click(page, f"nav [data-tab={tab}]")
            inner, whole = page.execute_script(
                "return [innerWidth, document.documentElement.scrollWidth]"
            )
            assert inner == width >= whole
    page.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def a_saved_file_is_the_same_policy(page, folder):
    click(page, "nav [data-tab=formula]")
    type_number(page, CONSTANT, "0.3")
    until(lambda: text(page, "#changed") == "1 number changed")
    click(page, "#save")
    saved = until(lambda: next(iter(folder.glob("*_edited.formulas")), None))
    shipped = find_policies(load_gait("trot"), quiet=True).policy("sparse_formula")
    assert "\nFL_hip = 0.3 - 0.0624*cmd.yaw" in saved.read_text()
    assert saved.read_text() == shipped.to_text().replace("FL_hip = 0.324 -", "FL_hip = 0.3 -")
    assert load_policy(saved).to_text() == saved.read_text()


def ctrl_c_ends_it_in_a_sentence(process):
    process.send_signal(signal.SIGINT)
    output, _ = process.communicate(timeout=PATIENCE)
    assert process.returncode == 130
    assert "Traceback" not in output
