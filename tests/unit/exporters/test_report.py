import re
from dataclasses import replace
from fractions import Fraction
from html.parser import HTMLParser
from itertools import pairwise

import pytest
from exporter_samples import hostile, many, roboracer, thirds, two_modes
from golden_file import assert_golden
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from halpipe.core.durations import Duration
from halpipe.exporters.common.base import TitledOptions
from halpipe.exporters.common.palette import FILLS, INK
from halpipe.exporters.common.timeline import Window
from halpipe.exporters.report import FORMAT
from halpipe.exporters.report.chart import MAX_TICKS, approximate, percent, ticks
from halpipe.models import Schedule, Status
from support import access, job, model, ms, schedule, task, version

SAMPLES = [roboracer, two_modes, thirds, hostile]


def write(system, planned, **options):
    files = FORMAT.write(system, planned, TitledOptions(**options))
    assert list(files) == [""]
    return files[""].decode()


def pictures(page):
    """Every SVG of the page, parsed as XML."""
    found, depth, start = [], 0, 0
    for match in re.finditer(r"<svg\b|</svg>", page):
        if match.group() == "<svg":
            start = match.start() if depth == 0 else start
            depth += 1
        else:
            depth -= 1
            if depth == 0:
                found.append(etree.fromstring(page[start : match.end()]))
    assert depth == 0
    return found


def plots(page):
    """The Gantt charts."""
    return [svg for svg in pictures(page) if svg.get("class") == "plot z0"]


def named(page):
    """Every picture that says something."""
    return [svg for svg in pictures(page) if svg.get("role") == "img"]


def bars(plot):
    return [(rect.find("title").text, rect.get("x"), rect.get("width")) for rect in plot.iter("rect") if len(rect)]


def main_part(page):
    return page[page.index("<main>") : page.index("</main>")]


class Outline(HTMLParser):
    """Notes elements that are closed in the wrong order, and all text and attributes."""

    VOID = frozenset({"meta", "br", "link", "img", "hr", "input"})

    def __init__(self):
        super().__init__()
        self.open, self.wrong, self.tags = [], [], []

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append(tag)

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            self.wrong.append(tag)


def outline(page):
    reader = Outline()
    reader.feed(page)
    return reader


def test_the_report_of_the_paper_is_the_golden_one():
    assert_golden("roboracer.main.html", main_part(write(*roboracer())))


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_same_schedule_gives_the_same_bytes(sample):
    assert write(*sample()) == write(*sample())


@pytest.mark.parametrize("sample", SAMPLES)
def test_the_page_is_well_formed_and_so_are_its_pictures(sample):
    page = write(*sample())
    reader = outline(page)
    assert reader.wrong == []
    assert reader.open == []
    assert len(pictures(page)) >= 2


@pytest.mark.parametrize("sample", [roboracer, two_modes, thirds])
def test_the_page_loads_nothing_from_anywhere(sample):
    page = write(*sample())
    assert not re.search(r"https?:|//[a-z]|url\((?!#)|@import|\bsrc=|<link|<iframe|fetch\(|XMLHttp", page)
    assert re.findall(r'href="(?!#)[^"]*"', page) == []


def test_hostile_names_make_no_markup():
    system, planned = hostile()
    page = write(system, planned)
    plain = write(*roboracer())
    assert set(outline(page).tags) <= set(outline(plain).tags) | {"b"}
    assert page.count("<script>") == page.count("</script>") == 1
    evil = system.tasks[0].name
    assert evil not in page
    assert any(title.startswith(evil + " #0\n") for plot in plots(page) for title, _, _ in bars(plot))


def test_every_chart_is_named_for_those_who_cannot_see_it():
    shown = named(write(*two_modes()))
    assert {plot.get("class") for plot in shown} == {"plot z0", "plot way", "modes"}
    for plot in shown:
        title, description = plot.get("aria-labelledby").split()
        assert plot.find("title").get("id") == title
        assert plot.find("desc").get("id") == description
        assert plot.find("title").text
        assert plot.find("desc").text


def test_a_wrapping_job_is_drawn_on_both_sides_with_a_marker():
    (plot,) = plots(write(*roboracer()))
    found = [(x, width) for title, x, width in bars(plot) if title.startswith("opponent_detection")]
    assert found == [("0%", "48%"), ("96%", "4%")]
    assert len([path for path in plot.iter("path") if path.get("class") == "wrap"]) == 4


def test_a_bar_says_exactly_when_and_where():
    (plot,) = plots(write(*thirds()))
    titles = [title for title, _, _ in bars(plot)]
    assert "stereo #0\n10ms – 170/7ms (100/7ms)\nversion v on gpu0, gpu1" in titles
    assert len(titles) == 3  # a gang of two has two bars


def test_bars_of_a_unit_abut_where_the_jobs_do():
    system, planned = many(3, 12)
    (plot,) = plots(write(system, planned))
    for lane in [svg for svg in plot.findall("svg") if svg.find("rect/title") is not None]:
        edges = sorted(
            (Fraction(rect.get("x")[:-1]), Fraction(rect.get("width")[:-1])) for rect in lane.iter("rect") if len(rect)
        )
        gaps = [b - a - width for (a, width), (b, _) in pairwise(edges)]
        assert min(gaps) == 0
        assert max(gaps) > 0


def test_demand_beyond_capacity_is_shown_apart():
    system = model(
        task("a", 10, version("v", "4ms", "u1", access("r", 0, 4, "0.7"))),
        task("b", 10, version("v", "4ms", "u2", access("r", 0, 4, "0.7"))),
        units="u1 u2",
        resources="r",
    )
    planned = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 2, "u2"), status=Status.NOT_FOUND)
    page = write(system, planned)
    (plot,) = plots(page)
    drawn = {path.get("class"): path.get("d") for path in plot.iter("path")}
    capacity = Fraction(plot.find("svg/line").get("y1"))
    # Heights grow upwards from the foot at 60: the area stops at the capacity line, the excess starts there.
    assert min(_heights(drawn["m0"])) == capacity == max(_heights(drawn["excess"]))
    assert min(_heights(drawn["excess"])) == 6
    assert "peak 140%" in page
    assert "Not complete: 1 of 1 tables" in page


def _heights(path):
    return [Fraction(height) for height in re.findall(r"V([0-9.]+)", path)]


def test_loads_beyond_the_whole_are_marked():
    system, planned = roboracer()
    table = planned.modes[0]
    unit, resource = table.unit_loads[0], table.resource_loads[0]
    for changes in (
        {"unit_loads": (replace(unit, share=Fraction(9, 8)),)},
        {"resource_loads": (replace(resource, peak=Fraction(9, 8)),)},
    ):
        assert 'class="track over"' in write(system, replace(planned, modes=(replace(table, **changes),)))


def test_a_valid_schedule_has_no_excess_and_says_so():
    page = write(*roboracer())
    assert not [path for path in plots(page)[0].iter("path") if path.get("class") == "excess"]
    assert "Every table of this schedule is valid" in page


def test_metrics_are_shown_where_the_schedule_has_them_and_else_left_out():
    system, planned = roboracer()
    page = write(system, planned)
    for text in ("Load of the units", "Load of the resources", "88ms", "73.3% of the limit 120ms", "≈ -1.0833"):
        assert text in page
    bare = write(system, replace(planned, modes=(replace(planned.modes[0], cost=None, unit_loads=(), chains=()),)))
    for text in ("Load of the units", "Chain latencies", "and its terms"):
        assert text not in bare


def test_a_chain_that_never_gets_through_or_has_no_limit_is_said():
    system, planned = roboracer()
    table = planned.modes[0]
    page = write(system, replace(planned, modes=(replace(table, chains=(replace(table.chains[0], age=None),)),)))
    assert "no data arrives" in page
    system = replace(system, chains=(replace(system.chains[0], max_age=None),))
    assert "no limit" in write(system, planned)


def test_a_latency_beyond_its_limit_is_marked():
    system, planned = roboracer()
    system = replace(system, chains=(replace(system.chains[0], max_reaction=ms(80)),))
    assert 'class="track over"' in write(system, planned)
    assert 'class="track over"' not in write(*roboracer())


def test_jobs_name_the_job_they_waited_for():
    assert "<td>path_planner #0 ended 0ms before</td>" in write(*roboracer())


def test_transitions_are_listed_and_drawn():
    page = write(*two_modes())
    assert len(plots(page)) == 4
    assert '<td class="n">0ms</td><td class="n">100ms</td><td class="n">25ms</td>' in page
    assert "last cycle of race" in page
    assert "transition table" in page


def test_a_transition_without_anything_to_draw_says_so(monkeypatch):
    monkeypatch.setattr("halpipe.exporters.common.timeline.CONTEXT_JOBS", 0)
    assert "begins at once" in write(*two_modes())


def test_one_mode_can_be_chosen_and_the_title_set():
    page = write(*two_modes(), mode="safe-stop", title="Nightly & more")
    assert "<h1>Nightly &amp; more</h1>" in page
    assert "not shown here: race." in page
    assert "opponent_detection" not in page.split('<h2 id="tasks">')[0]


def test_an_empty_schedule_still_makes_a_page():
    page = write(model(units=""), Schedule(model="m", model_sha256=""))
    assert outline(page).wrong == []
    assert "This schedule holds no mode" in page
    assert "not shown here: all." in page
    empty = schedule(model(), 10)
    assert outline(write(model(), empty)).wrong == []


def test_a_wide_schedule_stays_small_and_leaves_idle_units_out():
    system, planned = many(120, 20)
    assert len(planned.modes[0].jobs) == 2400
    assert len(write(system, planned).encode()) < 2_000_000
    system, planned = many(30, 2)
    idle = replace(planned.modes[0], jobs=planned.modes[0].jobs[:20])
    page = write(system, replace(planned, modes=(idle,)))
    assert "Units without any job, not drawn: cluster1.core2, " in page


@given(st.fractions(min_value=Fraction(1, 10**6), max_value=10**13), st.integers(-(10**12), 10**12))
def test_ticks_are_few_in_order_and_never_too_near_the_ends(length, start):
    window = Window(Duration(start), Duration(start) + Duration(length))
    found = ticks(window, fine=True)
    assert len([tick for tick in found if tick.level == 0]) <= MAX_TICKS + 3
    assert len(found) <= 30 * MAX_TICKS
    assert [tick.x for tick in found] == sorted(tick.x for tick in found)
    assert all(Fraction(7, 16) < tick.x < 100 - Fraction(7, 16) for tick in found[1:-1])


@pytest.mark.parametrize(
    ("length", "labels"),
    [
        ("25ms", "0ms 5ms 10ms 15ms 20ms 25ms"),
        ("1/30s", "0ms 5ms 10ms 15ms 20ms 25ms 30ms 100/3ms"),
        ("1ms", "0us 100us 200us 300us 400us 500us 600us 700us 800us 900us 1000us"),
        ("7s", "0s 1s 2s 3s 4s 5s 6s 7s"),
    ],
)
def test_ticks_are_round(length, labels):
    assert " ".join(tick.text for tick in ticks(Window(ms(0), ms(length)), fine=False)) == labels


@pytest.mark.parametrize(
    ("length", "steps"), [("25ms", "5ms 1ms 200us"), ("18ms", "2ms 500us 100us"), ("9ms", "1ms 200us 50us")]
)
def test_zooming_only_adds_round_ticks(length, steps):
    found = ticks(Window(ms(0), ms(length)), fine=True)[1:-1]
    for level, step in zip((0, 2, 4), steps.split(), strict=True):
        shown = [tick for tick in found if tick.level <= level]
        gaps = {b.x - a.x for a, b in pairwise(shown)}
        assert {Fraction(round(gap, 2)) for gap in gaps} == {Fraction(round(ms(step) / ms(length) * 100, 2))}


def test_numbers_are_rounded_without_floats_and_marked():
    assert percent(Fraction(1, 3)) == "33.3%"
    assert percent(Fraction(24, 25)) == "96%"
    assert approximate(Fraction(-13, 12)) == "≈ -1.0833"
    assert approximate(Fraction(3, 4)) == "0.75"


def test_text_is_legible_on_every_fill():
    # WCAG 2.2, success criterion 1.4.3: contrast of at least 4.5 to 1.
    assert min(_contrast(fill, INK) for fill in FILLS) >= 4.5


def _contrast(one, other):
    light, dark = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def _luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue
