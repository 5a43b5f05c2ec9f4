"""Pages in a browser: they can be read and used, and the studio answers."""

import http.client
import re
import subprocess
import sys
import time
from importlib import resources
from pathlib import Path

import pytest

from glassgait.models.policies.library import load_policy
from glassgait.studies.cli import main

pytestmark = pytest.mark.slow

TROT = ["--gait", "trot", "--policy", "formulas"]

PAGES = {
    "explain page": ["explain", "page", *TROT, "--n-steps", "40"],
    "view": ["view", *TROT, "--n-steps", "20"],
}


@pytest.fixture(scope="module")
def find_barriers():
    """Lists what axe-core finds serious or critical in a browser's page, or in a part of it."""
    pytest.importorskip("axe_playwright_python", reason="needs axe-core (the dev extra)")
    axe = (resources.files("axe_playwright_python") / "axe.min.js").read_text()

    def find(browser, part="body"):
        browser.set_script_timeout(120)
        run = (
            "const [part, done] = arguments;"
            "axe.run({include: [part]},"
            "{resultTypes: ['violations'], iframes: false})"
            ".then((found) => done(found.violations))"
        )
        violations = browser.execute_async_script(axe + run, part)
        serious = [own for own in violations if own["impact"] in ("serious", "critical")]
        return [f"{own['id']}: {node['html'][:160]}" for own in serious for node in own["nodes"]]

    return find


WIDTHS = (390, 1400)
"""Of a telephone and of a desk's screen (pixels)."""

UNFOLD = "for (const own of document.querySelectorAll('details')) own.open = true;"


@pytest.fixture(scope="module")
def faults_of(browser, find_barriers):
    """Finds what sticks out sideways, errors on the console, and barriers of an unfolded page."""

    def find(page):
        found = []
        for width in WIDTHS:
            screen = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
            browser.get(page.as_uri())
            # Replays load after their page, and then label their controls.
            time.sleep(5.0)
            browser.execute_script(UNFOLD)
            across = browser.execute_script("return document.documentElement.scrollWidth")
            found += [f"{width}: {across} pixels wide"] if across > width else []
            logged = [own for own in browser.get_log("browser") if own["level"] == "SEVERE"]
            found += [f"{width}: {own['message']}" for own in logged]
            found += [f"{width}: {own}" for own in find_barriers(browser, "html")]
        return found

    yield find
    browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


@pytest.mark.parametrize("kind", PAGES)
def test_a_page_that_a_command_writes_can_be_read(kind, faults_of, tmp_path):
    main([*PAGES[kind], "--output", str(tmp_path / "run")])
    for page in (tmp_path / "run").glob("*.html"):
        assert faults_of(page) == []


def test_the_explanation_shows_the_moment_of_its_address(browser, tmp_path):
    main([*PAGES["explain page"], "--output", str(tmp_path / "run")])
    address = (tmp_path / "run" / "index.html").as_uri()
    browser.get(f"{address}#joint=FR_thigh&step=30")
    assert browser.find_element("id", "local-title").text.startswith("FR thigh at step 30")
    browser.find_element("tag name", "body").send_keys("\ue014")  # the right arrow
    until(lambda: browser.current_url.endswith("joint=FR_thigh&step=31"), patience=30.0)


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """The studio's command: its address and its folder."""
    folder = tmp_path_factory.mktemp("studio") / "run"
    program = "from glassgait.studies.cli import main; main()"
    command = [sys.executable, "-c", program, "studio", "--port", "0", "--output", str(folder)]
    errors = folder.with_name("errors")
    with errors.open("w") as printed:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=printed, text=True)
    assert process.stdout is not None
    found = (re.search(r"open (http://127\.0\.0\.1:\d+)", line) for line in process.stdout)
    yield next(address[1] for address in found if address), folder
    process.terminate()
    process.wait(timeout=60)
    assert "Traceback" not in errors.read_text()


def until(condition, patience=180.0):
    end = time.monotonic() + patience
    while time.monotonic() < end:
        try:
            if found := condition():
                return found
        except Exception as error:
            print(error)
        time.sleep(0.2)
    raise AssertionError("did not happen in time")


SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport="
UPGRADE = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13"}
UPGRADE |= {"Sec-WebSocket-Key": "AAAAAAAAAAAAAAAAAAAAAA=="}


def test_the_studio_answers_only_its_own_page(studio):
    place = studio[0].removeprefix("http://")

    def ask(path, body=None, **headers):
        connection = http.client.HTTPConnection(place, timeout=60)
        connection.request("POST" if body else "GET", path, body, headers)
        answer = connection.getresponse()
        return answer.status, b"" if answer.status == 101 else answer.read()

    polling, evil = f"{SOCKET}polling", "evil.example"
    for path, headers in (("/", {}), (polling, {}), (f"{SOCKET}websocket", UPGRADE)):
        for host in (place, place.replace("127.0.0.1", "localhost")):
            own = {**headers, "Host": host, "Origin": f"http://{host}"}
            assert ask(path, **own)[0] in (200, 101)
            assert ask(path, **own | {"Host": evil, "Origin": f"http://{evil}"})[0] == 400
            assert path == "/" or ask(path, **own | {"Origin": f"http://{evil}"})[0] in (400, 403)
    # Junk is dropped; the fixture looks for tracebacks at the end.
    session = re.findall(r'"sid":"([^"]+)"', ask(polling)[1].decode())[0]
    for junk in ("40", '42["event",{}]', '42["handshake",5]', "4zzz", "zzz"):
        assert ask(f"{polling}&sid={session}", junk)[0] == 200


def press(browser, name):
    buttons = browser.find_elements("css selector", "button")
    next(button for button in buttons if button.text.lower() == name).click()


def test_the_studio_edits_a_formula_while_the_robot_walks(studio, browser, find_barriers):
    address, folder = studio
    until(lambda: browser.get(address) or "m/s" in browser.page_source)
    field = until(lambda: browser.find_element("css selector", "textarea[aria-label=formula]"))
    until(lambda: "robot:" in browser.find_element("css selector", "[role=status]").text)
    assert find_barriers(browser, "main") == []
    first, rest = field.get_attribute("value").split(" ", maxsplit=1)
    keys = pytest.importorskip("selenium.webdriver").Keys
    field.send_keys(keys.CONTROL, "a")
    field.send_keys(f"{float(first) + 0.1:.3g} {rest}")
    press(browser, "apply")
    browser.find_element("css selector", ".q-expansion-item .q-item").click()
    until(lambda: "+FL_hip = " in browser.find_element("css selector", ".q-expansion-item").text)
    press(browser, "save")
    (path,) = until(lambda: list(folder.glob("*.formulas")))
    assert load_policy(path).to_text() == Path(path).read_text()
    assert float(re.findall(r"^FL_hip = (\S+)", path.read_text(), re.M)[0]) == pytest.approx(
        float(first) + 0.1, rel=1e-2
    )
    field.send_keys(keys.CONTROL, "a")
    field.send_keys("0.1*")
    press(browser, "apply")
    until(lambda: "formula" in browser.find_element("css selector", ".q-notification").text)
