"""What a browser shows of the page that explains a rollout."""

import time

import numpy as np
import pytest

from glassgait.studies.cli import main


@pytest.fixture(scope="module")
def formulas(tmp_path_factory):
    """The page of formulas that ship, whose terms have long names."""
    output = tmp_path_factory.mktemp("formulas")
    short = ["--n-steps", "40", "--step", "12", "--output", str(output)]
    main(["explain", "page", "--policy", "statewise_symbolic", *short])
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


def test_browser_shows_the_terms_of_the_state_alone(few_page, browser):
    shown = {}
    for state in (0, 1):
        browser.get("about:blank")
        browser.get(f"file://{few_page}#joint=FL_hip&step={state}")
        rows = browser.find_elements("css selector", "#local tbody td.term")
        shown[state] = browser.find_element("id", "which").text, [row.text for row in rows]
    which, terms = shown[0]
    assert which == "All 3 terms"
    assert (len(terms), terms.count("intercept"), terms[-1]) == (4, 1, "sum = target")
    which, terms = shown[1]
    assert which == "The 14 largest terms"
    assert (len(terms), terms.count("intercept")) == (16, 1)
    assert terms[-2:] == ["18 other terms", "sum = target"]


def test_browser_shows_the_moment_that_a_link_names(opened, formulas, embedded):
    target = embedded(formulas, "data")["explained"][4]["target"][30]
    sign = "−" if target < 0 else "+"
    assert title(opened) == f"FR thigh at step 30: target {sign}{abs(target):.3f} rad"
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
    assert any(len(term) > 15 for term in terms)
    assert not any("…" in term for term in terms)


def test_the_lines_of_the_file_that_act_are_marked(opened, formulas, embedded):
    file = embedded(formulas, "data")["file"]
    state = embedded(formulas, "data")["state"][30]
    first, end = file["acting"][state][4]
    marked = opened.find_elements("css selector", "#file span.acting")
    assert [line.text for line in marked] == [text.rstrip() for text in file["lines"][first:end]]
    assert marked[0].text.startswith("FR_thigh = ")


def test_a_reader_can_check_every_product_by_hand(opened):
    opened.execute_script("document.getElementById('observations').open = true")
    eventually(lambda: len(opened.find_elements("css selector", "#values tr")) > 49, True)
    table = opened.find_elements("css selector", "#values tbody tr")
    cells = [[cell.text for cell in row.find_elements("tag name", "td")] for row in table]
    values = {name: value for name, value, _ in cells}
    units = {name: unit for name, _, unit in cells}
    assert units["h.RL"] == "m"
    assert units["dq.FR_calf"] == "rad/s"
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
