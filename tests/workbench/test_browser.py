"""The workbench as a person uses it, in headless Chromium: open, edit, drag, conflict, undo, keyboard, export."""

import subprocess
import sys

import pytest

from halpipe.starters import first_model

pytest.importorskip("starlette", reason="the extra [serve]")
pytest.importorskip("selenium", reason="drives the browser")

from lxml import etree
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.actions.pointer_actions import PointerActions
from selenium.webdriver.common.actions.pointer_input import PointerInput
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support import expected_conditions as expected
from selenium.webdriver.support.ui import Select, WebDriverWait

PLATFORM = """halpipe-regulator: 1
resource: memory
clock: 100MHz
bus: 128bit
burst: 64B
window: 1000
guaranteed: 400MB/s
capacity: 1GB/s
units:
  core1: {manager: 0}
  core2: {manager: 1}
"""
PATIENCE = 300

pytestmark = pytest.mark.slow  # a browser starts


@pytest.fixture
def page(browser, serve):
    return opened(browser, serve(first_model()["model.xml"]))


def opened(browser, address):
    browser.get(address)
    verdict(browser, "valid")
    return browser


def verdict(browser, word):
    """Wait for a word of the verdict on what was solved last; return the sentence."""
    said = browser.find_element(By.ID, "verdict")
    WebDriverWait(browser, PATIENCE).until(lambda _: word in said.text and is_idle(browser))
    return said.text


def field(browser, label):
    return browser.find_element(By.CSS_SELECTOR, f'input[aria-label="{label}"]')


def change(browser, label, text):
    found = field(browser, label)
    found.clear()
    found.send_keys(text, Keys.TAB)


def is_idle(browser):
    """Whether every order of the page is answered: an edit is drawn first, and solved then."""
    return browser.execute_script("return !busy")


def state(browser):
    WebDriverWait(browser, PATIENCE).until(is_idle)
    return browser.execute_async_script("fetch('/api/state').then(a => a.json()).then(arguments[0])")


def start_of(browser, task, index, mode=0):
    shown = state(browser)
    number = [each["name"] for each in shown["tasks"]].index(task)
    return next(job[4] for job in shown["modes"][mode]["jobs"] if job[:2] == [number, index])


def test_an_edit_is_solved_and_can_be_undone(page):
    change(page, "camera full wcet", "7ms")
    assert "jobs stay" in verdict(page, "jobs stay")
    assert state(page)["tasks"][0]["versions"][0]["wcet"] == "7ms"
    page.find_element(By.ID, "undo").click()
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["tasks"][0]["versions"][0]["wcet"] == "6ms")
    WebDriverWait(page, PATIENCE).until(lambda b: field(b, "camera full wcet").get_attribute("value") == "6ms")


def test_an_edit_made_while_another_is_answered_is_not_lost(page):
    edit = "order('edit', {kind: 'task', name: 'brake', field: 'deadline', value: '%s'}, true);"
    page.execute_script(edit % "4ms" + edit % "3ms")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("3ms"))
    page.find_element(By.ID, "undo").click()
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("4ms"))


def test_the_answer_to_one_field_leaves_the_keyboard_in_the_next(page):
    """Who types on while an edit is answered loses neither the place nor what is typed; Escape takes it back."""
    first = field(page, "camera full wcet")
    first.clear()
    first.send_keys("7ms", Keys.TAB, Keys.TAB, "15")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("7ms"))
    verdict(page, "jobs stay")
    active = page.switch_to.active_element
    assert active.get_attribute("aria-label") == "camera deadline"
    assert active.get_attribute("value") == "15"
    active.send_keys("ms", Keys.ENTER)
    WebDriverWait(page, PATIENCE).until(lambda b: b.execute_script("return arguments[0].actual", active) == "15ms")
    assert page.switch_to.active_element.get_attribute("aria-label") == "camera deadline"
    active.send_keys("9", Keys.ESCAPE)
    assert active.get_attribute("value") == "15ms"


def test_an_edit_in_an_outdated_window_shows_the_new_state_and_can_be_made_again(page):
    """Another window changes the model; this one still shows the old value and an old revision."""
    body = "JSON.stringify({revision: state.revision, kind: 'task', name: 'brake', field: 'deadline', value: '4ms'})"
    other = f"fetch('/api/edit', {{method: 'POST', body: {body}}}).then(arguments[0])"
    page.execute_async_script(other)
    field(page, "brake deadline").send_keys(Keys.CONTROL, "a", Keys.NULL, "3ms", Keys.TAB)  # one change, not two
    verdict(page, "another window")
    WebDriverWait(page, PATIENCE).until(lambda b: field(b, "brake deadline").get_attribute("value") == "4ms")
    change(page, "brake deadline", "3ms")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("deadline = 3ms"))


def test_notes_are_folded_below_what_is_wrong(page):
    change(page, "camera full wcet", "39ms")
    verdict(page, "no schedule")
    errors = page.find_elements(By.CSS_SELECTOR, "#findings > li.error")
    assert errors
    assert page.find_elements(By.CSS_SELECTOR, "#findings > li")[0].get_attribute("class") == "error"
    assert not any(note.is_displayed() for note in page.find_elements(By.CSS_SELECTOR, "#findings details li"))


def test_a_wrong_value_is_answered_beside_its_field(page):
    change(page, "camera full wcet", "fast")
    verdict(page, "not a duration")
    assert "wrong" in field(page, "camera full wcet").get_attribute("class")
    assert "HAL0951" in page.find_element(By.ID, "findings").text


def test_a_conflict_is_said_and_explained(page):
    change(page, "camera full wcet", "21ms")
    verdict(page, "no schedule")
    assert "camera" in page.find_element(By.ID, "findings").text


def test_a_dragged_job_is_pinned(page):
    before = start_of(page, "logging", 0)
    canvas = page.find_element(By.ID, "chart")
    point = page.execute_script(
        "const v = viewer; const j = v.jobs.find(j => j.name === 'logging');"
        "return [v.x((j.start + j.end) / 2), v.top + (j.lanes[0] + .5) * v.lane, v.width, v.height]"
    )
    x, y, width, height = point
    drag = ActionChains(page).move_to_element_with_offset(canvas, x - width / 2, y - height / 2).click_and_hold()
    drag.move_by_offset(160, 0).release().perform()
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["pins"] == [["drive", "logging", 0]])
    verdict(page, "valid")
    assert start_of(page, "logging", 0) > before + 2


def test_a_job_that_is_dragged_to_another_unit_keeps_its_start(page):
    """And by keyboard, back again."""
    before, shown = start_of(page, "brake", 1), state(page)
    canvas = page.find_element(By.ID, "chart")
    x, y, lane, to, width, height = page.execute_script(
        "const v = viewer; const j = v.jobs.find(j => j.name === 'brake' && j.index === 1);"
        "const at = lane => v.top + (lane + .5) * v.lane;"
        "return [v.x((j.start + j.end) / 2), at(j.lanes[0]), j.lanes[0], at(1 - j.lanes[0]), v.width, v.height]"
    )
    drag = ActionChains(page).move_to_element_with_offset(canvas, x - width / 2, y - height / 2).click_and_hold()
    drag.move_by_offset(1, to - y).release().perform()
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["revision"] > shown["revision"])
    assert {pin[1] for pin in state(page)["pins"]} == {"brake"}
    assert start_of(page, "brake", 1) == before
    lanes = "return viewer.jobs.find(j => j.name === 'brake' && j.index === 1).lanes[0]"
    assert page.execute_script(lanes) == 1 - lane
    back = Keys.ARROW_UP if lane == 0 else Keys.ARROW_DOWN
    page.execute_script(
        "viewer.select(viewer.jobs.find(j => j.name === 'brake' && j.index === 1)); viewer.canvas.focus()"
    )
    ActionChains(page).key_down(Keys.ALT).send_keys(back).key_up(Keys.ALT).perform()
    WebDriverWait(page, PATIENCE).until(lambda b: b.execute_script(lanes) == lane)


def test_a_chain_is_edited_in_its_table(page):
    change(page, "see-and-brake tasks", "camera brake")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("tasks = camera brake"))
    change(page, "see-and-brake tasks", "camera brakes")
    WebDriverWait(page, PATIENCE).until(lambda b: "wrong" in field(b, "see-and-brake tasks").get_attribute("class"))


def test_windows_and_modes_are_edited_in_their_tables(page):
    change(page, "detection fine camera max", "3ms")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("max = 3ms"))
    verdict(page, "valid")
    change(page, "logging only memory bound", "1/2")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"].endswith("bound = 1/2"))
    verdict(page, "valid")
    change(page, "limp tasks", "camera detection")
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["what"] == 'mode "limp" tasks = camera detection')
    verdict(page, "valid")
    assert len({job[0] for job in state(page)["modes"][1]["jobs"]}) == 2


def test_the_keyboard_is_enough(page):
    canvas = page.find_element(By.ID, "chart")
    canvas.send_keys(Keys.ARROW_RIGHT)
    facts = page.find_element(By.ID, "facts")
    first = facts.text
    assert "job" in first
    canvas.send_keys(Keys.ARROW_RIGHT)
    assert facts.text != first
    canvas.send_keys("+")
    assert page.execute_script("return viewer.to - viewer.from < viewer.mode.length")
    canvas.send_keys("0")
    ActionChains(page).key_down(Keys.ALT).send_keys(Keys.ARROW_RIGHT).key_up(Keys.ALT).perform()
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["pins"])


def test_columns_are_sorted_by_keyboard(page):
    head = page.find_element(By.CSS_SELECTOR, 'th[data-key="wcet"]')
    head.find_element(By.TAG_NAME, "button").send_keys(Keys.ENTER)
    cells = "[...document.querySelectorAll('#tasks tbody tr td:first-child')]"
    names = f"return {cells}.map(cell => cell.textContent).filter(Boolean)"
    assert page.execute_script(names) == ["brake", "camera", "logging", "detection"]
    assert head.get_attribute("aria-sort") == "ascending"
    head.find_element(By.TAG_NAME, "button").send_keys(Keys.SPACE)
    assert page.execute_script(names) == ["detection", "logging", "camera", "brake"]
    assert head.get_attribute("aria-sort") == "descending"


def test_what_is_said_of_a_job_is_said_anew_when_it_moves(page):
    page.execute_script("viewer.select(viewer.jobs.find(job => job.name === 'logging'))")
    said = page.find_element(By.ID, "facts")
    end = page.execute_script("return viewer.selected.end")
    assert f"to {end:g}ms" in said.text
    page.find_element(By.ID, "chart").send_keys(Keys.ALT, Keys.ARROW_RIGHT)
    WebDriverWait(page, PATIENCE).until(lambda b: state(b)["pins"])
    WebDriverWait(page, PATIENCE).until(lambda _: f"to {end + 0.8:g}ms" in said.text)
    page.find_element(By.ID, "undo").click()
    assert "before" in verdict(page, "before")


def test_two_fingers_zoom_and_pan(page):
    """Apart from 100 to 300 pixels: a third of the time is left; to the right: earlier instants come in sight."""
    chart = page.find_element(By.ID, "chart")
    whole = page.execute_script("return viewer.to - viewer.from")
    pinch(page, chart, (-50, 50), (-150, 150))
    seen = page.execute_script("return [viewer.from, viewer.to]")
    assert seen[1] - seen[0] == pytest.approx(whole / 3, rel=0.02)
    pinch(page, chart, (-50, 50), (0, 100))
    moved = page.execute_script("return [viewer.from, viewer.to]")
    assert moved[0] < seen[0]
    assert moved[1] - moved[0] == pytest.approx(seen[1] - seen[0], rel=0.02)


def pinch(browser, element, begin, end):
    """Put two fingers on an element, this far from its middle, and move them."""
    fingers = ActionBuilder(browser, mouse=PointerInput("touch", "one"))
    for finger, first, last in zip((fingers.pointer_action, None), begin, end, strict=True):
        if finger is None:
            second = fingers.add_pointer_input("touch", "two")
            finger = PointerActions(second)
        finger.move_to(element, first, 0).pointer_down().move_to(element, last, 0).pointer_up()
    fingers.perform()


def test_chains_search_and_modes(page):
    page.find_element(By.CSS_SELECTOR, "#chain option:nth-child(2)").click()
    assert page.execute_script("return viewer.chain") == [0, 1, 2]
    page.find_element(By.ID, "search").send_keys("brake")
    assert len(page.find_elements(By.CSS_SELECTOR, "#tasks tbody tr")) == 1
    page.find_element(By.CSS_SELECTOR, "#mode option:nth-child(2)").click()
    assert page.execute_script("return viewer.mode.name") == "limp"


def test_what_is_shown_leaves_as_a_picture_and_as_a_link(page):
    picture = etree.fromstring(
        page.execute_script("viewer.select(viewer.jobs[0]); viewer.view(5, 20); return viewer.svg()")
    )
    kinds = [each.tag.rpartition("}")[2] for each in picture.iter()]
    assert kinds.count("rect") > 9
    assert {"camera", "logging", "core1"} <= {text.text for text in picture.iter("{*}text")}
    page.execute_script("HTMLAnchorElement.prototype.click = function () { window.saved = this.download; };")
    for kind in ("PNG", "SVG"):
        page.find_element(By.CSS_SELECTOR, f'button[aria-label="save as {kind}"]').click()
        name = f"first drive.{kind.lower()}"
        WebDriverWait(page, PATIENCE).until(lambda _, name=name: page.execute_script("return window.saved") == name)
    page.find_element(By.CSS_SELECTOR, 'button[aria-label^="link"]').click()
    address = page.current_url
    page.get("about:blank")
    opened(page, address)
    WebDriverWait(page, PATIENCE).until(lambda _: page.execute_script("return viewer.selected && viewer.from") == 5)
    assert page.execute_script("return [viewer.to, viewer.selected.index]") == [25, 0]


def test_two_cursors_at_edges_show_their_difference(page):
    find = "const job = viewer.jobs.find(job => job.name === 'logging');"
    edges = page.execute_script(find + "return [job.start, job.end]")
    page.execute_script(find + "viewer.mark(job.start + .1); viewer.mark(job.end - .1); viewer.mark(job.start - .1)")
    assert page.execute_script("return viewer.cursors") == edges[::-1]
    assert f"difference {edges[1] - edges[0]:g} ms" in page.execute_script("return viewer.svg()")
    page.find_element(By.ID, "chart").send_keys(Keys.ESCAPE)
    assert page.execute_script("return viewer.cursors") == []


def test_dragging_in_the_map_of_the_whole_pans(page):
    x, y, width, height = page.execute_script(
        "viewer.view(0, 10); return [viewer.x(0), viewer.base(viewer.meters.length) - 10, viewer.width, viewer.height]"
    )
    chart = page.find_element(By.ID, "chart")
    middle = ((x + width) / 2 - width / 2, y - height / 2)
    ActionChains(page).move_to_element_with_offset(chart, *middle).click().perform()
    assert page.execute_script("return viewer.from") == pytest.approx(15, abs=0.2)


def answer(browser, text):
    """Write into the question that the page asks, and confirm."""
    asked = WebDriverWait(browser, PATIENCE).until(expected.alert_is_present())
    asked.send_keys(text)
    asked.accept()


def test_a_variant_is_compared_and_shown_again(page):
    page.find_element(By.ID, "keep").click()
    answer(page, "first")
    WebDriverWait(page, PATIENCE).until(lambda _: state(page)["variants"] == ["first"])
    change(page, "camera full wcet", "7ms")
    WebDriverWait(page, PATIENCE).until(lambda _: state(page)["what"].endswith("7ms"))
    choose = Select(page.find_element(By.ID, "variants"))
    WebDriverWait(page, PATIENCE).until(lambda _: len(choose.options) == 2)
    choose.select_by_visible_text("first")
    compare = page.find_element(By.ID, "beside")
    compare.click()
    WebDriverWait(page, PATIENCE).until(lambda _: compare.get_attribute("aria-pressed") == "true")
    assert "lower rows" in page.find_element(By.ID, "facts").text
    assert page.execute_script("return viewer.mode.strip.boxes.some(box => box[4] === 'off')")
    page.find_element(By.ID, "take").click()
    WebDriverWait(page, PATIENCE).until(lambda _: "first" in state(page)["what"])
    assert field(page, "camera full wcet").get_attribute("value") == "6ms"


def test_a_task_is_added_and_removed(page):
    for kind, said in (("add task", "radar, 20ms, 3ms"), ("remove task", "radar")):
        Select(page.find_element(By.ID, "change")).select_by_visible_text(kind)
        answer(page, said)
        WebDriverWait(page, PATIENCE).until(lambda _, kind=kind: state(page)["what"].startswith(f'{kind} "radar"'))
        verdict(page, "valid")
        assert len(page.find_elements(By.CSS_SELECTOR, 'input[aria-label="radar period"]')) == (kind == "add task")


def test_edits_are_saved_as_an_overlay(page, tmp_path):
    change(page, "camera full wcet", "7ms")
    WebDriverWait(page, PATIENCE).until(lambda _: state(page)["what"].endswith("7ms"))
    page.find_element(By.ID, "save").click()
    answer(page, "edits.yaml")
    verdict(page, "edits.yaml: written")
    assert "wcet: 7ms" in (tmp_path / "edits.yaml").read_text()


def export(page, format, asked=""):
    page.execute_script(
        "window.saved = []; HTMLAnchorElement.prototype.click = function () { saved.push(this.download); };"
    )
    Select(page.find_element(By.ID, "export")).select_by_visible_text(format)
    if asked:
        answer(page, asked)


def test_exports_are_saved_or_refused_with_a_reason(page, tmp_path):
    (tmp_path / "platform.yaml").write_text(PLATFORM)
    for format, asked, file in (("report", "", "export.html"), ("regulator", "platform.yaml", "regulator.zip")):
        export(page, format, asked)
        WebDriverWait(page, PATIENCE).until(lambda _, file=file: page.execute_script("return saved") == [file])
    export(page, "timpani")  # of the mode that is shown
    WebDriverWait(page, PATIENCE).until(lambda _: page.execute_script("return saved") == ["export.yaml"])
    export(page, "riscv")
    verdict(page, "sources")
    assert page.execute_script("return saved") == []


def test_nothing_goes_wrong_in_the_console(page):
    severe = [entry["message"] for entry in page.get_log("browser") if entry["level"] == "SEVERE"]
    assert [message for message in severe if "409" not in message] == []


def generated(*options):
    command = [sys.executable, "-m", "halpipe", "generate", "-o", "-", *options]
    return subprocess.run(command, capture_output=True, check=True).stdout


LARGE = {
    "60 tasks": "--tasks 60 --units 6 --access-windows 20 --utilisation 0.4",
    "500 tasks": "--tasks 500 --units 50 --access-windows 20 --utilisation 0.4",
    "8001 jobs": "--units 4 --unit-types 1 --resources 1 --utilisation 0.5 --period 1s" + 8 * " --period 1ms",
}


@pytest.mark.parametrize("size", LARGE)
def test_large_models_are_drawn_and_zoomed_with_few_nodes(browser, serve, size):
    page = opened(browser, serve(generated(*LARGE[size].split())))
    assert page.execute_script("return document.getElementsByTagName('*').length") < 30_000
    page.execute_script("for (let n = 0; n < 30; n++) { viewer.zoom(n % 2 ? 1.2 : 1 / 1.2, 1); viewer.paint(); }")
    assert page.execute_script("return document.getElementsByTagName('*').length") < 30_000


def test_every_unit_can_be_read_and_rows_out_of_sight_cost_nothing(browser, serve):
    """Laid out all at once, the rows of 500 tasks would take longer than to schedule them."""
    page = opened(browser, serve(generated(*LARGE["500 tasks"].split())))
    page.execute_script("viewer.paint()")
    assert page.execute_script("return viewer.lane") >= 12
    assert page.execute_script("return viewer.base(viewer.meters.length - 1) <= viewer.height")
    seen = "const row = document.querySelector('#tasks tbody').{}; return row.firstElementChild.checkVisibility({})"
    option = "{contentVisibilityAuto: true}"
    assert page.execute_script(seen.format("lastElementChild", option)) is False
    page.execute_script("document.querySelector('#tasks tbody').lastElementChild.scrollIntoView()")
    WebDriverWait(page, PATIENCE).until(lambda _: page.execute_script(seen.format("lastElementChild", option)))
