"""What is drawn can be read: long names, many parts, narrow windows, in the workbench and in reports."""

import pytest

from halpipe.api import export, schedule
from halpipe.core.durations import Duration
from halpipe.exporters.native import format_model
from halpipe.exporters.report import FORMAT, ReportOptions
from halpipe.importers.native import parse_model
from halpipe.models import Split
from halpipe.pipeline.generate import SetParameters, generate_with_witness
from halpipe.starters import first_model
from profiles import volume
from support import chain, mode, model, task, version

pytest.importorskip("starlette", reason="the extra [serve]")
pytest.importorskip("selenium", reason="drives the browser")

from dataclasses import replace
from itertools import pairwise, product

from selenium.webdriver.support.ui import WebDriverWait

pytestmark = pytest.mark.slow  # a browser starts

LONG = "some/package/with/many/words/that/nobody/has/shortened/" + "x" * 120
UNITS = "unit_number_one_of_the_left_zone_controller unit_number_two_of_the_left_zone_controller"
PEN = """
const said = [], lines = [], pen = new Proxy({}, {
  get: (_, name) => name === "fillText" ? (text, x) => said.push([text, x])
    : name === "measureText" ? text => ({width: 7 * text.length})
    : name === "moveTo" || name === "lineTo" ? x => lines.push(x) : () => 0,
  set: () => true,
});
"""


def long_names():
    tasks = [task(f"{LONG}{n}", "10ms", version("w" * 90, f"{n + 1}ms", UNITS)) for n in range(3)]
    chains = [chain("c" * 110, " ".join(each.name for each in tasks), "90ms")]
    return model(*tasks, units=UNITS, chains=chains, modes=[mode("m" * 100, tasks)])


def split_job():
    """A job of 22 ms that another one interrupts every 5 ms."""
    parts = replace(version("v", "22ms"), split=Split(anywhere=True, max_gaps=8))
    return model(task("long", "40ms", parts, offset=0), task("short", "5ms", version("v", "1500us")))


@pytest.fixture
def shown(browser, serve):
    def show(system):
        browser.get(serve(format_model(system)))
        WebDriverWait(browser, 300).until(lambda b: b.execute_script("return Boolean(state && state.valid)"))
        browser.execute_script("viewer.paint()")
        return browser

    return show


def overhang(browser):
    return browser.execute_script("return document.documentElement.scrollWidth - window.innerWidth")


def test_long_names_make_no_page_wider_than_its_window(shown, tmp_path):
    page = shown(long_names())
    assert overhang(page) <= 0
    assert page.execute_script("return viewer.left") > 200  # or the units could not be told apart
    found = export("report", long_names(), schedule(long_names()))
    (tmp_path / "long.html").write_bytes(found[""])
    page.get((tmp_path / "long.html").as_uri())
    assert overhang(page) <= 0


def test_a_name_is_cut_where_its_bar_ends(shown):
    page = shown(split_job())
    name = "viewer.paintName(pen, 'black', '{}', 10, {}, 5); return said.map(([text]) => text)"
    assert page.execute_script(PEN + name.format("brake", 45)) == ["brake"]
    assert page.execute_script(PEN + name.format("detection", 60)) == ["detec…"]
    assert page.execute_script(PEN + name.format("steering", 30)) == []


def test_lines_of_gaps_lie_between_the_parts(shown):
    page = shown(split_job())
    ends = "job.parts.slice(1).flatMap((part, n) => [viewer.x(job.parts[n][1]), viewer.x(part[0])])"
    find = "const job = viewer.jobs.find(job => job.name === 'long'); viewer.paintGaps(pen, {}, job, 5);"
    lines, expected = page.execute_script(PEN + find + f"return [lines, {ends}]")
    assert lines == expected
    assert len(lines) == 2 * 7


def test_chains_are_drawn_from_writing_to_reading_over_the_edge_too(shown):
    """a writes at 8 ms of 10, where b, at 5 ms, reads only in the next cycle."""
    first = replace(task("a", "10ms", version("v", "1ms"), offset=0), let=Duration.parse("8ms"))
    second = task("b", "10ms", version("v", "1ms"), offset=5)
    page = shown(model(first, second, chains=[chain("c", "a b")]))
    find = (
        "viewer.chain = [0, 1]; viewer.paintChain(pen, {}); viewer.chain = null; return lines.map(x => viewer.time(x))"
    )
    assert page.execute_script(PEN + find) == pytest.approx([8, 15, -2, 5])


@pytest.mark.parametrize("width", [480, 1400])
def test_instants_on_the_axis_stand_apart(shown, width):
    page = shown(split_job())
    page.set_window_size(width, 900)
    try:
        told = page.execute_script(PEN + "viewer.layout(); viewer.paintAxis(pen, {}); return said")
    finally:
        page.set_window_size(1400, 900)
    assert len(told) >= 3
    ends = [(x - 3.5 * len(text), x + 3.5 * len(text)) for text, x in told]
    assert all(before[1] < after[0] for before, after in pairwise(ends))


OUTSIDE = """
const found = [], walker = document.createTreeWalker(document.querySelector("main"), NodeFilter.SHOW_TEXT);
for (let text; text = walker.nextNode();) {
  const at = text.parentElement, box = at.closest(".gauge, .card, .legend, section");
  if (!text.textContent.trim() || !at.checkVisibility() || !box || at.closest(".wide, .scroll, svg")) continue;
  const range = document.createRange(), outer = box.getBoundingClientRect();
  range.selectNodeContents(text);
  const isOutside = part => part.right > outer.right + .5 || part.left < outer.left - .5;
  if ([...range.getClientRects()].some(isOutside)) found.push(text.textContent);
}
return found;
"""
FRAMES = "const done = arguments[0]; requestAnimationFrame(() => setTimeout(() => requestAnimationFrame(done), 50))"
PICTURE = "return document.querySelector('canvas.viewer').toDataURL()"


def chained():
    """Three chains with limits: the gauges whose texts are longest, three cards beside each other."""
    tasks = [task(f"sensor_{n}", "10ms", version("v", f"{n + 1}ms", UNITS)) for n in range(3)]
    limits = {"max_latency": "33333us", "max_reaction": "123456us", "max_age": "123456us"}
    chains = [replace(chain(f"chain_{n}", "sensor_0 sensor_1 sensor_2"), **limits) for n in range(3)]
    return model(*tasks, units=UNITS, chains=chains, modes=[mode("drive", tasks)])


def modes_in_a_ring():
    """Three modes with switches both ways, and a chain with a logical execution time: labels beside each other."""
    tasks = [task(f"t{n}", "20ms", version("v", "2ms", UNITS), offset=n, slack=0) for n in range(3)]
    tasks[1] = replace(tasks[1], let=Duration.parse("8ms"))
    chains = [replace(chain("let", "t0 t1 t2"), max_latency="50ms")]
    return model(*tasks, units=UNITS, chains=chains, modes=[mode(name, tasks) for name in ("drive", "charge", "limp")])


OVERLAPS = """
const boxes = [...document.querySelectorAll("svg.modes text")].map(text => [text, text.getBoundingClientRect()]);
const meet = (a, b) => a.left < b.right - 1 && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1;
return boxes.flatMap(([one, a], n) => boxes.slice(n + 1).filter(([_, b]) => meet(a, b)).map(
  ([other]) => one.textContent + " / " + other.textContent));
"""
WIDTHS = {"screen": (360, 480, 800, 1000, 1400, 1900), "print": (1032, 1100, 1200, 1400, 1600, 1900)}
LOOKS = [("screen", "light"), ("screen", "dark"), ("print", "light")]


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Reports by the systems they are of, each written once."""
    folder, written = tmp_path_factory.mktemp("reports"), {}

    def page(system):
        if system not in written:
            written[system] = folder / f"{system.__name__}.html"
            written[system].write_bytes(export("report", system(), schedule(system()))[""])
        return written[system].as_uri()

    return page


BLANK = """
const done = arguments[0], frame = act => requestAnimationFrame(() => requestAnimationFrame(act)), blank = [];
const places = [0, document.body.scrollHeight / 2, document.body.scrollHeight];
(function next() {
  if (!places.length) { scrollTo(0, 0); done(blank); return; }
  const place = places.shift();
  scrollTo(0, place);
  frame(() => {
    for (const viewer of viewers.values()) {
      const seen = viewer.canvas.toDataURL();
      viewer.paint();
      if (seen !== viewer.canvas.toDataURL() || viewer.lane < 8) blank.push([viewer.mode && viewer.mode.name, place]);
    }
    next();
  });
})();
"""


def starter():
    return parse_model(first_model()["model.xml"], "model.xml")


WIDE = volume(1) > 1
"""Whether this is `make endurance`: every width and height, and five systems."""
SYSTEMS = (chained, long_names, modes_in_a_ring, *((split_job, starter) if WIDE else ()))


@pytest.mark.parametrize(("media", "scheme"), LOOKS)
@pytest.mark.parametrize("system", SYSTEMS)
def test_no_text_of_a_report_leaves_its_box_and_no_lane_is_blank(browser, pages, system, media, scheme):
    looks = {"media": media, "features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", looks)
    try:
        browser.get(pages(system))
        browser.execute_script("for (const box of document.querySelectorAll('details')) box.open = true")
        for width, height in product(WIDTHS[media], (500, 700, 900, 1400) if WIDE else (900,)):
            metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
            assert browser.execute_script(OUTSIDE) == [], (width, height)
            assert browser.execute_script(OVERLAPS) == [], (width, height)
            assert overhang(browser) <= 0, (width, height)
            narrowest = "return Math.min(...[...document.querySelectorAll('.track')].map(bar => bar.clientWidth))"
            assert browser.execute_script(narrowest) >= 50, (width, height)
            if WIDE and media == "screen":  # printing paints the canvas at another size
                assert browser.execute_async_script(BLANK) == [], (width, height)
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})


def test_lanes_that_come_into_sight_are_painted(browser, tmp_path):
    parameters = SetParameters(tasks=1000, units=100)
    (content,) = FORMAT.write(*generate_with_witness(parameters, 5), ReportOptions()).values()
    (tmp_path / "tall.html").write_bytes(content)
    try:
        for change in ("", "document.querySelector('section.cards').remove()"):
            browser.set_window_size(1400, 700)
            browser.get((tmp_path / "tall.html").as_uri())
            browser.execute_async_script(FRAMES)
            small = browser.execute_script(PICTURE)
            if change:
                browser.execute_script(change)  # as when something above is folded
            else:
                browser.set_window_size(1400, 1500)
            browser.execute_async_script(FRAMES)
            seen = browser.execute_script(PICTURE)
            browser.execute_script("for (const viewer of viewers.values()) viewer.paint()")
            assert seen == browser.execute_script(PICTURE)
            assert seen != small
    finally:
        browser.set_window_size(1400, 900)
