"""BTF: every line keeps the rules that viewers go by, and a comparison with the schedule finds nothing."""

import re
from dataclasses import replace
from itertools import pairwise

import pytest
from exporter_samples import many, roboracer, thirds, two_modes

from golden_file import assert_golden
from halpipe.core.diagnostics import Severity
from halpipe.core.durations import ZERO
from halpipe.exporters.btf import FORMAT, BtfOptions
from halpipe.exporters.btf.events import run_of
from halpipe.exporters.trace import FORMAT as TRACE
from halpipe.importers.traces.read import parse_traces
from halpipe.models import ModeSchedule, Part, Schedule, Status, TransitionTable
from halpipe.pipeline.compare import CompareOptions, compare
from stated_options import stated
from support import job, model, ms, schedule, task, version

ROUNDING = ms("1ns")
TASK_EVENTS = {"activate", "start", "preempt", "resume", "terminate"}


def write(system, planned, **options):
    return FORMAT.write(system, planned, BtfOptions(**options))[""].decode()


def rows(text):
    return [line.split(",") for line in text.splitlines() if line and not line.startswith("#")]


def violations(text):
    """What Trace Compass would drop, throw on or not show: written from its rules, not from the exporter."""
    found = []
    header = [line for line in text.splitlines() if line.startswith("#")]
    needed = [
        r"#version 2\.\d+\.\d+",
        r"#creator .+",
        r"#creationDate \d{4}-\d\d-\d\dT[\d:]+Z",
        r"#timeScale (ns|us|ms|s)",
    ]
    found += [pattern for pattern in needed if not any(re.fullmatch(pattern, line) for line in header)]
    last, active, entered = None, {}, {}
    for row in rows(text):
        if len(row) not in (7, 8):
            found.append(("columns", row))
            continue
        time, source, source_instance, kind, target, instance, event = row[:7]
        whole = all(re.fullmatch(r"\d+", number) for number in (time, source_instance, instance))
        if not whole or any(c.isspace() for c in source + target):
            found.append(("numbers", row))
            continue
        if last is not None and int(time) < last:
            found.append(("order", row))
        last = int(time)
        if kind == "STI":
            found += [] if event == "trigger" else [("stimulus", row)]
        elif kind == "R":  # a task calls it while it runs on a core
            found += [] if (source, source_instance) in active else [("called by no running task", row)]
            expected = {"start": None, "suspend": "in", "resume": "out", "terminate": "in"}
            key = (source, source_instance, target)
            found += [] if event in expected and entered.pop(key, None) == expected[event] else [("runnable", row)]
            entered |= {key: "out" if event == "suspend" else "in"} if event != "terminate" else {}
        elif kind != "T" or event not in TASK_EVENTS:
            found.append(("type or event", row))
        elif event == "activate":
            found += [] if source.startswith("STI_") else [("activated by", row)]
        else:
            if not source.startswith("Core") or not target.startswith("TASK"):
                found.append(("not shown", row))
            key = (target, instance)
            if event in ("preempt", "terminate"):
                inner = [state for (task, number, _), state in entered.items() if (task, number) == key]
                found += [] if "in" not in inner else [("leaves within a runnable", row)]
            if event in ("start", "resume"):
                if key in active or source in active.values():
                    found.append(("core is busy", row))
                active[key] = source
            elif active.pop(key, None) != source:
                found.append(("ends elsewhere", row))
    return found


@pytest.mark.parametrize("sample", [roboracer, two_modes, thirds, lambda: many(units=4, jobs_per_unit=10)])
@pytest.mark.parametrize("cycles", [1, 3])
def test_every_line_keeps_the_rules_of_viewers(sample, cycles):
    assert violations(write(*sample(), cycles=cycles)) == []


def test_the_rules_are_no_formality():
    text = write(*roboracer())
    for broken in (
        text.replace("#timeScale ns", "#timeScale fs"),
        text.replace("Core_", "Kern_"),
        text.replace(",terminate", ",finish", 1),
        text.replace(",start\n", ",start\n", 1).replace(",0,T,", ",x,T,", 1),
        text
        + text.splitlines()[-1].replace("terminate", "start")
        + "\n"
        + text.splitlines()[-1]
        + "\n0,a,0,T,b,0,start\n",
    ):
        assert violations(broken)


@pytest.mark.parametrize("sample", [roboracer, two_modes, thirds, lambda: many(units=4, jobs_per_unit=10)])
@pytest.mark.parametrize("exporter", [FORMAT, TRACE])
def test_what_is_exported_compares_clean(sample, exporter):
    system, planned = sample()
    text = exporter.write(system, planned, exporter.options())[""]
    recording = parse_traces(text, "trace")
    assert recording.traces
    for line in recording.traces:
        answer = compare(
            planned, line, CompareOptions(tolerance=ZERO if sample in (roboracer, two_modes) else ROUNDING)
        )
        assert [d for d in answer.diagnostics if d.severity is Severity.ERROR] == []
        assert all(row.seen for row in answer.rows)


def test_the_trace_is_golden():
    assert_golden("roboracer.btf", write(*roboracer()))


def test_instants_between_nanoseconds_are_rounded_down_and_counted():
    text = write(*thirds())
    (count,) = re.findall(r"# (\d+) instants rounded down", text)
    assert int(count) > 0
    assert "# 0 instants rounded down" in write(*roboracer())


def planned_of(modes, switches):
    tables = tuple(ModeSchedule(name=m, hyperperiod=ms(10), status=Status.VALID, jobs=()) for m in modes)
    between = tuple(
        TransitionTable(source=a, target=b, length=ms(1), worst_latency=ms(1), status=Status.VALID) for a, b in switches
    )
    return Schedule(model="m", model_sha256="", modes=tables, transitions=between)


@pytest.mark.parametrize(
    ("switches", "unreached"),
    [
        ("ab ba", []),
        ("ab bc ca ac", []),
        ("ab bc cb ba", []),
        ("ab ac", ["a->c"]),  # b and c are dead ends: one run cannot visit both
        ("bc", ["b", "c", "b->c"]),
        ("", ["b", "c"]),
    ],
)
def test_a_run_takes_every_switch_that_it_can(switches, unreached):
    planned = planned_of("abc" if "c" in switches or not switches else "ab", [tuple(s) for s in switches.split()])
    pieces, missed = run_of(planned, 2)
    assert [m for m in missed if m not in ("c",) or m in unreached] == unreached
    names = [piece.name for piece in pieces]
    for before, after in pairwise(names):
        assert after == before or after.startswith(f"{before}->") or before.endswith(f"->{after}")
    for before, after in pairwise(pieces):
        assert after.start - before.start == (ms(1) if "->" in before.name else ms(10))


def settings(text):
    return stated(FORMAT, text, title="t", mode="m")


def test_a_pipeline_file_states_the_cycles():
    assert settings("{cycles: 7}") == (BtfOptions(title="t", mode="m", cycles=7), [])


@pytest.mark.parametrize("cycles", ["0", "-1", "x", "1001", "99999999999"])
def test_cycles_that_are_none(cycles):
    assert [d.code for d in settings(f"{{cycles: {cycles}}}")[1]] == ["HAL0023"]


def test_entities_carry_the_letters_of_their_types():
    """BTF 2.1.5, table 1: rows of entityTypeTable are a type letter and a name; the head of the types is typeTable."""
    header = [line for line in write(*roboracer()).splitlines() if line.startswith("#")]
    assert "#typeTable" in header
    assert "#entityType" not in header
    rows_of_types = header[header.index("#entityTypeTable") + 1 :]
    letter = {"Core_": "C", "TASK_": "T", "RUN_": "R", "STI_": "STI"}
    assert rows_of_types
    for row in rows_of_types:
        kind, name = row.removeprefix("#-").split(" ")
        assert kind == next(letter[prefix] for prefix in letter if name.startswith(prefix))


def responses(text):
    """Response times as other tools take them: terminate minus activate of each instance."""
    activated, found = {}, {}
    for time, _, _, kind, target, instance, event in rows(text):
        if kind != "T":
            continue
        if event == "activate":
            activated[target, instance] = int(time)
        elif event == "terminate":
            found[target, instance] = int(time) - activated[target, instance]
    return found


@pytest.mark.parametrize(
    ("offset", "delays", "early"), [("0ms", (3, 4), False), (None, (0, 1), False), ("8ms", (15, 16), True)]
)
def test_jobs_are_activated_at_their_release(offset, delays, early):
    """Jobs start at 3 and 14 ms of 20 ms. With the offset 8 ms they wrap: the first two releases precede the trace."""
    system = model(task("a", "10ms", version("v", "3ms", "u1"), offset=offset, slack="1"))
    starts = (3, 14)
    planned = schedule(system, "20ms", *(job(system, "a", n, f"{start}ms", "u1") for n, start in enumerate(starts)))
    text = write(system, planned, cycles=2)
    due = {
        str(n): (min(delays[n % 2], starts[n % 2] + 20 * (n // 2)) + 3) * 10**6  # the trace begins at 0
        for n in range(4)
    }
    assert {instance: time for (_, instance), time in responses(text).items()} == due
    assert ("# 2 releases before the trace begins" in text) == early


def test_the_runnable_of_a_job_is_the_code_of_its_version():
    times = ((1, 2, 0, 1), (5, 7, 1, 3))
    parts = tuple(Part(start=ms(a), end=ms(b), executed_from=ms(c), executed_to=ms(d)) for a, b, c, d in times)
    system = model(task("a", "10ms", version("v", "3ms", "u1")))
    planned = schedule(system, "10ms", replace(job(system, "a", 0, "1ms", "u1"), end=ms(7), parts=parts))
    text = write(system, planned, cycles=1)
    assert violations(text) == []
    found = [(int(row[0]) // 10**6, row[1], row[4], row[6]) for row in rows(text) if row[3] == "R"]
    assert found == [
        (1, "TASK_a", "RUN_a.v", "start"),
        (2, "TASK_a", "RUN_a.v", "suspend"),
        (5, "TASK_a", "RUN_a.v", "resume"),
        (7, "TASK_a", "RUN_a.v", "terminate"),
    ]


def test_a_trace_of_runnables_alone_has_their_jobs():
    text = write(*roboracer())
    plain = [line for line in text.splitlines() if ",T," not in line]
    tasks, runnables = (parse_traces(t.encode(), "t").traces[0].executions for t in (text, "\n".join(plain)))
    times = [sorted((e.start, e.end, e.busy) for e in found) for found in (tasks, runnables)]
    assert times[0] == times[1]
    assert {e.task.split("_")[0] for e in runnables} == {"RUN"}


@pytest.mark.parametrize(("start", "overlap"), [(2, True), (3, False)])
def test_tasks_whose_jobs_overlap_have_no_runnables(start, overlap):
    """Tools that know a task by its name alone end the runnable of one core on the other."""
    system = model(
        *(task(n, "10ms", version("v", wcet, "u1")) for n, wcet in (("a", "3ms"), ("b", "1ms"))), units="u1 u2"
    )
    jobs = (job(system, "a", 0, "0ms", "u1"), job(system, "a", 1, f"{start}ms", "u2"), job(system, "b", 0, "8ms", "u1"))
    text = write(system, schedule(system, "20ms", *jobs), cycles=1)
    assert violations(text) == []
    assert {row[4] for row in rows(text) if row[3] == "R"} == ({"RUN_b.v"} if overlap else {"RUN_a.v", "RUN_b.v"})
    assert ("# without runnables, since jobs of it overlap: TASK_a" in text) == overlap
    assert ("#-R RUN_a.v" in text) != overlap


@pytest.mark.parametrize(("text", "help"), [("{cycles: yes}", "number"), ("{title: yes}", 'quote it: "true"')])
def test_truth_values_of_yaml_have_the_advice_of_their_option(text, help):
    (found,) = settings(text)[1]
    assert (found.code, help in found.help, "quote" in found.help) == ("HAL0022", True, "title" in text)
