import json
import re
from dataclasses import replace
from fractions import Fraction
from html.parser import HTMLParser

import pytest
from exporter_samples import hostile, many, roboracer, thirds, two_modes
from hypothesis import example, given
from hypothesis import strategies as st
from lxml import etree

from golden_file import assert_golden
from halpipe.core.durations import Duration
from halpipe.exporters.common.base import TitledOptions
from halpipe.exporters.common.palette import FILLS, INK
from halpipe.exporters.common.timeline import Window
from halpipe.exporters.report import FORMAT
from halpipe.exporters.report.axis import MAX_TICKS, approximate, percent, ticks
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


def scene_of(page):
    """What the viewer draws."""
    return json.loads(re.search(r'id="scene">(.*?)</script>', page)[1])


def rows(table, drawn):
    """The jobs of a table by what they are called."""
    return {(drawn["tasks"][row[0]]["name"], row[1]): row for row in table["jobs"]}


def named(page):
    """Every picture that says something."""
    return [svg for svg in pictures(page) if svg.get("role") == "img"]


def main_part(page):
    """What the page says, and what its viewer draws."""
    return page[page.index("<main>") : page.index("</main>")] + json.dumps(scene_of(page), indent=1) + "\n"


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
    assert pictures(page) or sample is thirds


@pytest.mark.parametrize("sample", [roboracer, two_modes, thirds])
def test_the_page_loads_nothing_from_anywhere(sample):
    page = write(*sample()).replace("http://www.w3.org/2000/svg", "")  # a namespace, of saved pictures
    assert not re.search(r"https?:|//[a-z]|url\((?!#)|@import|\bsrc=|<link|<iframe|fetch\(|XMLHttp", page)
    assert re.findall(r'href="(?!#)[^"]*"', page) == []


def test_hostile_names_make_no_markup():
    system, planned = hostile()
    page = write(system, planned)
    plain = write(*roboracer())
    assert set(outline(page).tags) <= set(outline(plain).tags) | {"b"}
    assert page.count("<script") == page.count("</script>") == 2
    evil = system.tasks[0].name
    assert evil not in page
    assert (evil, 0) in rows(scene_of(page)["modes"][0], scene_of(page))


def test_every_chart_is_named_for_those_who_cannot_see_it():
    shown = named(write(*two_modes()))
    assert {plot.get("class") for plot in shown} == {"plot way", "modes"}
    for plot in shown:
        title, description = plot.get("aria-labelledby").split()
        assert plot.find("title").get("id") == title
        assert plot.find("desc").get("id") == description
        assert plot.find("title").text
        assert plot.find("desc").text


def test_jobs_are_drawn_where_they_are_and_stated_exactly():
    drawn = scene_of(write(*thirds()))
    (table,) = drawn["modes"]
    stereo = rows(table, drawn)["stereo", 0]
    assert [drawn["units"][lane] for lane in stereo[3]] == ["gpu0", "gpu1"]
    assert stereo[6:8] == ["10ms", "170/7ms"]
    assert stereo[4:6] == pytest.approx([10, 170 / 7])
    drawn = scene_of(write(*roboracer()))
    (table,) = drawn["modes"]
    assert rows(table, drawn)["opponent_detection", 0][4:6] == [24, 37]  # the viewer goes on at the beginning
    assert (table["begin"], table["end"], table["cycle"]) == (0, 25, True)


def test_accesses_of_jobs_are_drawn_when_they_are_in_force():
    drawn = scene_of(write(*roboracer()))
    row = rows(drawn["modes"][0], drawn)["particle_filter", 0]
    assert row[9] == [[0, 0, 1], [0, 1, 1.5], [0, 23.5, 24]]
    assert [each["name"] for each in drawn["resources"]] == ["main-memory"]


def test_demand_beyond_capacity_is_drawn():
    system = model(
        task("a", 10, version("v", "4ms", "u1", access("r", 0, 4, "0.7"))),
        task("b", 10, version("v", "4ms", "u2", access("r", 0, 4, "0.7"))),
        units="u1 u2",
        resources="r",
    )
    planned = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 2, "u2"), status=Status.NOT_FOUND)
    page = write(system, planned)
    assert scene_of(page)["modes"][0]["meters"] == [{"name": "r", "steps": [[0, 0.7], [2, 1.4], [4, 0.7], [6, 0]]}]
    assert "Not complete: 1 of 1 tables" in page


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
    assert max(level for meter in scene_of(page)["modes"][0]["meters"] for _, level in meter["steps"]) <= 1
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
    drawn = scene_of(write(*roboracer()))
    assert "path_planner #0 ended 0ms before" in drawn["modes"][0]["waits"]


def test_the_table_of_tasks_has_what_the_model_states():
    tasks = (
        task("plain", 10, version("v", "2ms", "u1")),
        task("full", 20, version("v", "2ms", "u1 u2", gang=2), slack="1/10", offset=2, deadline=8),
        replace(task("polling", 10, version("v", "1ms", "u1")), distance=ms(30)),
        replace(task("strict", 10, version("v", "1ms", "u1"), deadline=25), distance=ms(30)),
        task("wide", 20, version("v", "1ms", "u1 u2 u3 u4 u5 u6"), version("w", "1ms", "u1 u2 u3 u4 u5 u6 u7")),
        task("demand", None, version("v", None, "u1")),
    )
    system = model(*tasks, units="u1 u2 u3 u4 u5 u6 u7")
    full = [job(system, "full", 0, 2, "u1 u2")]
    table = write(system, schedule(system, 20, job(system, "plain", 0, 0, "u1"), *full)).split('<table class="tasks">')[
        1
    ]
    rows = [
        [re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<td.*?>(.*?)</td>", row)]
        for row in re.findall(r"<tr>(<td.*?)</tr>", table.split("</table>")[0])
    ]
    polls = "10ms, polls arrivals 30ms apart"
    few, many = "u1, u2, u3, u4, u5, u6", "u1, u2, u3 … (7 units)"
    assert rows == [
        ["plain", "10ms", "0%", "–", "period", "v", "2ms", "u1", "", "", "all (1)"],
        ["full", "20ms", "10%", "2ms", "8ms", "v", "2ms", "2 of u1, u2", "", "", "all (1)"],
        [
            "polling",
            "10ms, polls arrivals 30ms apart",
            "0%",
            "–",
            "30ms from the arrival",
            "v",
            "1ms",
            "u1",
            "",
            "",
            "",
        ],
        ["strict", polls, "0%", "–", "25ms from the arrival", "v", "1ms", "u1", "", "", ""],
        ["wide", "20ms", "0%", "–", "period", "v", "1ms", few, "", "", ""],
        ["w", "1ms", many, "", "", ""],
        ["demand", "on demand", "0%", "–", "–", "v", "not stated", "u1", "", "", ""],
    ]


def test_transitions_are_listed_and_drawn():
    page = write(*two_modes())
    drawn = scene_of(page)
    tables = [table["name"] for table in drawn["modes"] + drawn["switches"]]
    assert re.findall(r'<canvas [^>]*data-mode="([^"]*)"', page.replace("&gt;", ">")) == tables
    assert len(tables) == 4
    assert '<td class="n">0ms</td><td class="n">100ms</td><td class="n">25ms</td>' in page
    first = drawn["switches"][0]
    assert (first["begin"], first["regions"][0]["text"]) == (-25, "last cycle of race")
    assert "transition table" in {region["text"] for table in drawn["switches"] for region in table["regions"]}


def test_a_transition_without_anything_to_draw_says_so(monkeypatch):
    monkeypatch.setattr("halpipe.exporters.common.timeline.CONTEXT_JOBS", 0)
    assert "begins at once" in write(*two_modes())


def test_one_mode_can_be_chosen_and_the_title_set():
    page = write(*two_modes(), mode="safe-stop", title="Nightly & more")
    assert "<h1>Nightly &amp; more</h1>" in page
    assert "not shown here: race." in page
    drawn = scene_of(page)
    assert "opponent_detection" not in {drawn["tasks"][row[0]]["name"] for row in drawn["modes"][0]["jobs"]}


def test_an_empty_schedule_still_makes_a_page():
    page = write(model(units=""), Schedule(model="m", model_sha256=""))
    assert outline(page).wrong == []
    assert "This schedule holds no mode" in page
    assert "not shown here: all." in page
    empty = schedule(model(), 10)
    assert outline(write(model(), empty)).wrong == []


def test_a_wide_schedule_stays_small():
    system, planned = many(120, 20)
    assert len(planned.modes[0].jobs) == 2400
    assert len(write(system, planned).encode()) < 1_000_000


@example(length=Fraction(10_000_000), start=300_000)  # the first round mark is at 7 %
@given(st.fractions(min_value=Fraction(1, 10**6), max_value=10**13), st.integers(-(10**12), 10**12))
def test_ticks_are_few_in_order_and_never_too_near_the_ends(length, start):
    window = Window(Duration(start), Duration(start) + Duration(length))
    found = ticks(window)
    assert len(found) <= MAX_TICKS + 3
    assert [tick.x for tick in found] == sorted(tick.x for tick in found)
    assert all(7 < tick.x < 93 for tick in found[1:-1])


@pytest.mark.parametrize(
    ("length", "labels"),
    [
        ("25ms", "0ms 5ms 10ms 15ms 20ms 25ms"),
        ("1/30s", "0ms 5ms 10ms 15ms 20ms 25ms 30ms 100/3ms"),
        ("1ms", "0us 100us 200us 300us 400us 500us 600us 700us 800us 900us 1000us"),
        ("2ms", "0ms 0.2ms 0.4ms 0.6ms 0.8ms 1ms 1.2ms 1.4ms 1.6ms 1.8ms 2ms"),
        ("7s", "0s 1s 2s 3s 4s 5s 6s 7s"),
    ],
)
def test_ticks_are_round(length, labels):
    assert " ".join(tick.text for tick in ticks(Window(ms(0), ms(length)))) == labels


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
