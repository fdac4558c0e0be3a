"""The graph of modes, the slowest ways through chains, and the account of the import, as the page draws them."""

import json
import re
from dataclasses import replace
from itertools import combinations, pairwise
from types import SimpleNamespace

import pytest
from exporter_samples import many, roboracer, two_modes
from hypothesis import given
from hypothesis import strategies as st

from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.common.codes import NO_IMPORT_REPORT
from halpipe.exporters.report import FORMAT, ReportOptions
from halpipe.exporters.report.chains import latency_of, path_chart, worst_age, worst_latency, worst_reaction
from halpipe.exporters.report.modegraph import MOST_MODES, NODE_HEIGHT, NODE_WIDTH, WIDTH, build_mode_graph
from halpipe.exporters.report.page import build_account
from halpipe.exporters.report.scene import figures
from halpipe.importers.common.base import Coverage, Imported, format_account
from halpipe.models import (
    Anchor,
    Chain,
    ChainLatency,
    Job,
    Mode,
    ModeSchedule,
    Origin,
    Schedule,
    Status,
    TransitionTable,
)
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure import latency
from halpipe.pipeline.measure.placement import Placement
from profiles import examples
from stated_options import stated
from support import job, model, ms, task, version

# ------------------------------------------------------------------------------------------------ modes


def system_of(count, switches=()):
    blink = task("a", "10ms", version())
    names = [f"m{n}" for n in range(count)]
    owner = model(blink, modes=[Mode(name=name, runs=()) for name in names], transitions=[(*s, None) for s in switches])
    tables = tuple(ModeSchedule(name=name, hyperperiod=ms(10), status=Status.VALID, jobs=()) for name in names)
    between = tuple(
        TransitionTable(source=a, target=b, length=ms(1), worst_latency=ms(11), status=Status.VALID)
        for a, b in switches
    )
    return owner, Schedule(model="m", model_sha256="", modes=tables, transitions=between)


@pytest.mark.parametrize("count", range(2, MOST_MODES + 1))
def test_no_two_modes_are_drawn_on_each_other(count):
    graph = build_mode_graph(*system_of(count))
    assert len(graph["nodes"]) == count
    for one, other in combinations(graph["nodes"], 2):
        assert abs(one["x"] - other["x"]) >= NODE_WIDTH or abs(one["y"] - other["y"]) >= NODE_HEIGHT, (one, other)
    for node in graph["nodes"]:
        assert NODE_WIDTH // 2 <= node["x"] <= WIDTH - NODE_WIDTH // 2
        assert NODE_HEIGHT // 2 <= node["y"] <= graph["height"] - NODE_HEIGHT // 2


def test_graphs_of_modes_are_those_of_the_golden_file():
    lines = []
    for count in range(2, MOST_MODES + 1):
        switches = [(f"m{a}", f"m{b}") for a in range(count) for b in range(count) if a != b]
        graph = build_mode_graph(*system_of(count, switches))
        lines += [f"{count} modes, height {graph['height']}"]
        lines += [f"{node['title']} at {node['x']} {node['y']}" for node in graph["nodes"]]
        arrows = graph["arrows"] if count in (2, 3, 5, 8) else []
        lines += [f"{a['title'].split(':')[0]}: {a['path']}, label at {a['x']} {a['y']}" for a in arrows]
    assert_golden("report-modes.txt", "\n".join(lines) + "\n")


@pytest.mark.parametrize("count", range(2, MOST_MODES + 1))
def test_arrows_lead_from_box_to_box_and_never_on_each_other(count):
    switches = [(f"m{a}", f"m{b}") for a in range(count) for b in range(count) if a != b]
    graph = build_mode_graph(*system_of(count, switches))
    at = {node["title"]: (node["x"], node["y"]) for node in graph["nodes"]}
    width, height = NODE_WIDTH // 2 + 3, NODE_HEIGHT // 2 + 3
    ends = [[int(n) for n in re.findall(r"-?[0-9]+", arrow["path"])] for arrow in graph["arrows"]]
    for (source, target), (ax, ay, _, _, bx, by) in zip(switches, ends, strict=True):
        for x, y, (middle_x, middle_y) in ((ax, ay, at[source]), (bx, by, at[target])):
            across, down = abs(x - middle_x), abs(y - middle_y)
            assert across <= width + 1
            assert down <= height + 1
            assert across == width or down == height
    assert len({(arrow["x"], arrow["y"]) for arrow in graph["arrows"]}) == len(switches)


@pytest.mark.parametrize(("parts", "gaps"), [([0, 0], 0), ([1], 0), ([2], 1), ([3, 0, 2], 3)])
def test_gaps_lie_between_the_parts_of_jobs(parts, gaps):
    jobs = [SimpleNamespace(parts=(None,) * count) for count in parts]
    assert figures(SimpleNamespace(period=None), jobs, ms(10)) == {"jobs": len(parts), "gaps": gaps}


@pytest.mark.parametrize("count", [0, 1, MOST_MODES + 1])
def test_a_graph_that_says_nothing_or_too_much_is_not_drawn(count):
    assert build_mode_graph(*system_of(count)) is None


def test_every_allowed_switch_is_an_arrow_of_its_kind():
    owner, planned = system_of(3, [("m0", "m1"), ("m1", "m0"), ("m1", "m2")])
    first, second, third = planned.transitions
    tables = (replace(first, length=ZERO), replace(second, status=Status.NOT_FOUND))
    graph = build_mode_graph(owner, replace(planned, transitions=tables))
    assert [(arrow["label"], arrow["kind"]) for arrow in graph["arrows"]] == [
        ("0", "ok"),
        ("1ms", "bad"),
        ("no table", "missing"),
    ]
    assert len({arrow["path"] for arrow in graph["arrows"]}) == 3
    assert [kind for kind, _ in graph["legend"]] == ["ok", "missing", "bad"]
    assert third.length == ms(1)


def test_a_switch_to_a_mode_that_is_not_shown_has_no_arrow():
    owner, planned = system_of(3, [("m0", "m1"), ("m1", "m2")])
    graph = build_mode_graph(owner, replace(planned, modes=planned.modes[:2], transitions=planned.transitions[:1]))
    assert [arrow["title"].split(":")[0] for arrow in graph["arrows"]] == ["m0 to m1"]


# ------------------------------------------------------------------------------------------------ chains


@st.composite
def circles(draw):
    """Any jobs of three tasks on a circle; the ways through them must be as long as the latencies say."""
    hyperperiod = draw(st.integers(4, 30))
    jobs = []
    for name in "abc":
        starts = draw(st.lists(st.integers(0, hyperperiod - 1), min_size=1, max_size=4, unique=True))
        length = draw(st.integers(1, hyperperiod))
        for index, start in enumerate(sorted(starts)):
            times = {"start": Duration(start), "end": Duration(start + length)}
            jobs.append(Job(task=name, index=index, version="v", units=("u",), **times))
    return ModeSchedule(name="all", hyperperiod=Duration(hyperperiod), status=Status.VALID, jobs=tuple(jobs))


def placed(job):
    start, end = job.start.ns, job.end.ns
    return SimpleNamespace(start=start, end=end, length=end - start, read=start, write=end, begin=start)


@given(circles(), st.sampled_from(["abc", "ab", "ca", "a", "cba"]))
def test_the_ways_are_as_long_as_the_latencies(table, names):
    chain = Chain(name="c", tasks=tuple(names))
    system = model(*(task(name, 10, version("v", 1)) for name in "abc"))
    reaction, age = worst_reaction(system, chain, table), worst_age(system, chain, table)
    members = [[placed(j) for j in table.jobs if j.task == name] for name in names]
    hyperperiod = table.hyperperiod.ns
    assert (reaction[-1].end - reaction[0].start).ns == latency.worst_reaction(members, hyperperiod)
    assert (age[-1].end - age[0].start).ns == latency.worst_age(members, hyperperiod)
    assert [hop.task for hop in reaction[1:]] == [hop.task for hop in age] == list(names)
    for way in (reaction[1:], age):
        assert all(after.start >= before.end for before, after in pairwise(way))


def test_a_chain_through_a_task_without_jobs_has_no_way():
    table = ModeSchedule(name="all", hyperperiod=ms(10), status=Status.VALID, jobs=())
    chain = Chain(name="c", tasks=("a",))
    system = model(task("a", 10, version("v", 1)))
    assert worst_reaction(system, chain, table) == worst_age(system, chain, table) == []


@examples(60)
@given(st.randoms(use_true_random=False))
def test_ways_of_logical_execution_times_and_events_are_as_long_as_the_figures(rng):
    """Two tasks with a LET and two without, whose jobs lie anywhere; figures may count from and to other events."""
    tasks, jobs = [], []
    for number, name in enumerate("abcd"):
        period, let = rng.choice((5, 10)), rng.randint(2, 5)
        owner = task(name, period, version("v", 2, f"u{number}"), offset=rng.randrange(period), slack=1)
        tasks.append(replace(owner, let=ms(let)) if number < 2 else owner)
        for index in range(20 // period):
            release = owner.offset.ns // 10**6 + index * period
            late = rng.randint(0, (let if number < 2 else period) - 2)
            jobs.append(
                Job(
                    task=name,
                    index=index,
                    version="v",
                    units=(f"u{number}",),
                    start=ms((release + late) % 20),
                    end=ms((release + late) % 20 + 2),
                )
            )
    tasks.append(task("e", 20, version("v", 1, "u0")))  # the hyperperiod
    jobs.append(Job(task="e", index=0, version="v", units=("u0",), start=ms(0), end=ms(1)))
    names = rng.sample("abcd", rng.randint(1, 4))
    anchor = rng.choice((None, None, Anchor.RELEASE, Anchor.START))
    to = rng.choice((None, None, Anchor.START, Anchor.END)) if len(names) > 1 else None
    drawn = Chain(name="c", tasks=tuple(names), anchor=anchor, to=to)
    system = model(*tasks, units="u0 u1 u2 u3", chains=[drawn])
    table = ModeSchedule(name="all", hyperperiod=ms(20), status=Status.VALID, jobs=tuple(jobs))
    placement = Placement.of(expand(system, system.modes[0]), table.jobs, system.units)
    (found,) = latency.chain_latencies(placement, [drawn], complete=True)
    ways = [worst(system, drawn, table) for worst in (worst_latency, worst_reaction, worst_age)]
    assert [way[-1].finish - way[0].begin for way in ways] == [found.latency, found.reaction, found.age]
    for way in ways:
        assert path_chart(system, "id", "title", way, ms(9), missed=way is ways[1])["bars"]


def test_a_way_is_drawn_with_its_waits_and_logical_execution_times():
    """Data of the job of `a` at 2 ms are written at 6 ms; the job of `b` that has them ends at 9 ms."""
    first = replace(task("a", 10, version("v", 2), offset=1, slack=1), let=ms(5))
    drawn = Chain(name="c", tasks=("a", "b"))
    system = model(first, task("b", 10, version("v", 2), slack=1), chains=[drawn])
    jobs = (job(system, "a", 0, 2, "u1"), job(system, "b", 0, 7, "u1"))
    table = ModeSchedule(name="all", hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
    chart = path_chart(system, "id", "title", worst_age(system, drawn, table), ms(10), missed=False)
    one, two = chart["bars"]
    assert one["title"] == "a: waits 0ms, starts at 1ms, runs 2ms, reads at 0ms and writes at 5ms"
    assert two["title"] == "b: waits 1ms, starts at 6ms, runs 2ms"
    places = ("x", "width", "wait_x", "wait_width", "let_x", "let_width")
    assert [one[name] for name in places] == ["10", "20", "0", "0", "0", "50"]
    assert [two[name] for name in places] == ["60", "20", "50", "10", "60", "0"]
    assert (one["y"] < two["y"], two["y"] < chart["height"], chart["limit"]) == (True, True, "100")
    late = path_chart(system, "id", "title", worst_reaction(system, drawn, table), None, missed=True)
    assert [bar["task"] for bar in late["bars"]] == ["a", "b"]
    assert (late["bars"][0]["wait_x"], late["limit"]) == ("0", "")


def test_of_data_that_are_written_together_the_newer_are_read():
    """The job from 6 to 15 ms ends with the one from 1 to 5 ms of the next cycle, which has read later."""
    chained = Chain(name="c", tasks=("a", "b"))
    system = model(*(task(name, 5 if name == "a" else 10, version("v", 2), slack=1) for name in "ab"), chains=[chained])
    short, long = (job(system, "a", index, start, "u1") for index, start in ((0, 1), (1, 6)))
    jobs = replace(short, end=ms(5)), replace(long, end=ms(15)), job(system, "b", 0, 5, "u1")
    table = ModeSchedule(name="all", hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
    [read, _] = worst_age(system, chained, table)
    assert (read.start, read.end) == (ms(1), ms(5))


@pytest.mark.parametrize(("reaction", "latency"), [(None, None), (14, 7)])
def test_a_latency_is_that_of_the_slowest_way_where_data_arrive(reaction, latency):
    chained = Chain(name="c", tasks=("a", "b"))
    system = model(*(task(name, 10, version("v", 2), slack=1) for name in "ab"), chains=[chained])
    jobs = (job(system, "a", 0, 1, "u1"), job(system, "b", 0, 6, "u1"))
    table = ModeSchedule(name="all", hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
    stated_figures = ChainLatency(name="c", reaction=ms(reaction), age=ms(reaction))
    assert latency_of(system, chained, table, stated_figures) == ms(latency)


# ------------------------------------------------------------------------------------------------ account


@pytest.fixture
def account(tmp_path):
    coverage = Coverage()
    coverage.mapped("node", 3)
    coverage.ignored("topic", "/rosout", "plumbing")
    coverage.defaulted("/a", "units", "core0")
    path = tmp_path / "import.json"
    path.write_bytes(format_account(Imported(model=model(), diagnostics=(), coverage=coverage)))
    return path


def test_the_account_counts_what_was_read_and_says_why_not(account):
    owner = model(task("a", "10ms", version()))
    owner = replace(owner, tasks=(replace(owner.tasks[0], origin=Origin("graph.yaml", 3)),))
    built = build_account(owner, str(account))
    assert built["elements"] == [("node", 3, 3, 0), ("topic", 1, 0, 1)]
    assert built["share"] == "3 of 4 elements shaped the model (75%)"
    assert (built["reasons"], built["defaults"]) == ([("plumbing", 1)], [("units", "core0", 1)])
    counts = {row["file"]: dict(zip(built["kinds"], row["counts"], strict=True)) for row in built["sources"]}
    assert counts["graph.yaml"]["tasks"] == counts["graph.yaml"]["versions"] == 1
    assert counts[""]["units"] == 1
    assert built["sources"][-1]["file"] == ""


def test_reasons_that_are_as_frequent_are_in_the_order_of_the_alphabet(tmp_path):
    coverage = Coverage()
    for name, reason in (("a", "plumbing"), ("b", "zero rate"), ("c", "clock"), ("d", "plumbing")):
        coverage.ignored("topic", name, reason)
    path = tmp_path / "import.json"
    path.write_bytes(format_account(Imported(model=model(), diagnostics=(), coverage=coverage)))
    assert build_account(model(), str(path))["reasons"] == [("plumbing", 2), ("clock", 1), ("zero rate", 1)]


def test_a_model_written_by_hand_has_no_account():
    assert build_account(model(task("a", "10ms", version())), "") is None


@pytest.mark.parametrize(
    "change",
    [
        None,
        {"halpipe-import-report": 2},
        {"elements": {}},
        {"elements": [{"kind": "x"}]},
        {"ignored": [3]},
        {"defaults": 1},
        {"dropped": [{"kind": "x", "count": "1"}]},
        {"elements": [{"kind": "x", "read": 1, "mapped": 1, "ignored": 0, "lost": 1}]},
        {"faults": []},
    ],
)
def test_what_is_no_import_report(account, change):
    text = account.read_text()
    twice = text.replace('"model"', '"model": "a", "model"')
    account.write_text(twice if change is None else json.dumps(json.loads(text) | change))
    with pytest.raises(HalpipeError) as refused:
        build_account(model(), str(account))
    assert [d.code for d in refused.value.diagnostics] == [NO_IMPORT_REPORT.id]


def test_a_pipeline_file_names_the_import_report_relative_to_itself():
    options, found = stated(FORMAT, "{import-report: out/i.json}", "/base")
    assert (options.import_report, found) == ("/base/out/i.json", [])


# ------------------------------------------------------------------------------------------------ page


def test_the_page_has_all_parts(account):
    page = FORMAT.write(*two_modes(), ReportOptions(import_report=str(account)))[""].decode()
    for text in (
        'class="modes"',
        "The slowest way through",
        "Where the model comes from",
        "plumbing",
        "<dt>hyperperiod</dt>",
    ):
        assert text in page
    alone = FORMAT.write(*roboracer(), ReportOptions())[""].decode()
    assert 'class="modes"' not in alone


def test_the_graph_of_modes_leads_to_their_sections():
    page = FORMAT.write(*two_modes(), ReportOptions())[""].decode()
    sections = dict(re.findall(r'<h2 id="([^"]*)">Mode ([a-z-]+)', page))
    graph = page[page.index('class="modes"') :].split("</svg>")[0]
    assert {sections[id] for id in re.findall(r'href="#([^"]*)"', graph)} == {"race", "safe-stop"}


@pytest.mark.slow  # ten thousand jobs; test_a_wide_schedule_stays_small has two thousand
def test_a_large_page_stays_within_a_few_megabytes():
    page = FORMAT.write(*many(units=40, jobs_per_unit=250), ReportOptions())[""]
    assert len(page) < 8_000_000
