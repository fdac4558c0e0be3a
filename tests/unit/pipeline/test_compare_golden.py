"""Reports of disturbed recordings in full: amounts, instants, counts and order of findings, and the rows of tasks."""

from dataclasses import replace

import pytest
from compare_cases import PIECES, PLAN, RACE, moved, play

from golden_file import assert_golden
from halpipe.core.diagnostics import Location, render_text
from halpipe.core.durations import Duration
from halpipe.models.trace import Execution, Executions, Trace
from halpipe.pipeline.compare import CompareOptions, compare
from support import access, mode, model, ms, task, version

MS = 10**6
ORIGIN = ms(7)
LONG = [("race", RACE)] * 6

TASKS = (
    task("a", 10, version("v", 4, "c1", access("r", 0, 4))),
    task("b", 10, version("v", 2, "c1", access("r", 0, 2))),
    task("c", 20, version("v", 4, "c2 c3", access("s", 0, 4), gang=2)),
)
MODES = [mode("race", TASKS), mode("slow", TASKS[1:2])]
MODEL = model(*TASKS, units="c1 c2 c3", resources="r s", modes=MODES)


def without(seen, *positions):
    return [each for place, each in enumerate(seen) if place not in positions]


def disturbed(seen):
    """Yield what ran by the name of the disturbance; of each cycle of the race, the jobs are a0, a1, b0 and c0."""
    stray = replace(seen[6], start=seen[6].start + ms(12), end=seen[6].end + ms(12))
    again = replace(seen[5], start=seen[5].start + Duration(1))
    strangers = (Execution(task=f"x{n}", start=ORIGIN, end=ORIGIN + ms(n)) for n in range(1, 8))
    yield "nothing", seen
    yield "a1 late by 1 ms in cycle 0 and by 2 ms in cycle 1", moved(moved(seen, 1, start=MS, end=MS), 5, start=2 * MS)
    yield "a1 early by 300 us in cycle 1", moved(seen, 5, start=-300_000, end=-300_000)
    yield "a0 runs on into b0 for 2 ms", moved(seen, 4, end=3 * MS)
    yield "a0 runs as late as a1 in cycle 1, which is missing", without(moved(seen, 4, start=9 * MS, end=9 * MS), 5)
    yield "a0 ends 2 ms late and ran for 1 ms", moved(seen, 4, end=2 * MS, busy=ms(1))
    yield "b0 is missing in cycle 1", without(seen, 6)
    yield "the first three and the last two jobs are missing", seen[3:-2]
    yield "b0 runs twice in cycle 1", [*seen, stray]
    yield "a1 has two executions in cycle 1", [*seen, again]
    yield "a1 has two executions in cycle 1, the better one is read later", [*moved(seen, 5, start=1), seen[5]]
    yield "b0 is on another unit", moved(seen, 2, units=("c3",))
    yield "b0 runs on c3 while c0 does", moved(seen, 2, start=15 * MS, end=15 * MS, units=("c3",))
    yield "c0 is recorded on each of its units", [replace(e, units=(unit,)) for e in seen for unit in e.units]
    parts = [replace(e, units=(unit,)) for e in seen for unit in e.units]
    yield (
        "c0 is recorded on each of its units, and runs on c3 for 1 ms more",
        [replace(e, end=e.end + ms(1)) if e.units == ("c3",) else e for e in parts],
    )
    yield "b0 runs once more before all", [replace(seen[2], start=seen[0].start - ms(2), end=seen[0].start), *seen]
    yield "a0 and b0 are exchanged", moved(moved(seen, 4, start=3 * MS, end=3 * MS), 6, start=-4 * MS, end=-4 * MS)
    yield "c0 is early by 5 ms in cycle 0", moved(seen, 3, start=-5 * MS, end=-5 * MS)
    yield "the last job has no end", [*seen[:-1], replace(seen[-1], end=None)]
    yield "a1 has no message", moved(seen, 5, has_data=False)
    yield "seven other programs run", [*seen, *strangers]
    yield "all but the last are late by 1 ms", [moved([e], 0, start=MS, end=MS)[0] for e in seen[:-1]] + seen[-1:]


def report(seen, **options):
    trace = Trace(name="t.csv", executions=tuple(sorted(seen, key=lambda e: e.start.ns)))
    answer = compare(PLAN, trace, CompareOptions(**options), MODEL)
    lines = [f"origin {answer.origin}, starts {' '.join(map(str, answer.starts))}, played {dict(answer.played)}"]
    for row in answer.rows:
        times = (row.least, row.median, row.worst, row.worst_end, row.longest, row.reserved, row.wcet)
        lines.append(
            f"  {row.task}: {row.seen} seen, {row.missing} missing, {row.extra} extra; {' '.join(map(str, times))}"
        )
    return lines + [render_text(each) for each in answer.diagnostics]


PLANS = {
    "labels": (play(PIECES, ORIGIN), {}),
    "labels-origin": (play(PIECES, ORIGIN), {"origin": ORIGIN, "tolerance": ms(1)}),
    "labels-unnumbered": ([replace(e, job=None) for e in play(PIECES, ORIGIN)], {"origin": ORIGIN}),
    "mode": (play(LONG, ORIGIN, stated=False), {"mode": "race"}),
    "mode-origin": (play(LONG, ORIGIN, stated=False), {"mode": "race", "origin": ORIGIN}),
}


@pytest.mark.parametrize("name", PLANS)
def test_a_report_is_that_of_the_golden_file(name):
    """Of a recording that names tables and cycles, and of one whose mode is stated; without and with an origin."""
    seen, options = PLANS[name]
    lines = []
    for what, run in disturbed(seen):
        lines += [f"--- {what}", *report(run, **options)]
    assert_golden(f"compare-{name}.txt", "\n".join(lines) + "\n", "pipeline")


@pytest.mark.parametrize("name", ["labels-unnumbered", "mode"])
def test_rows_of_a_file_may_have_any_order(name):
    """Where two start at once, the order of the lines decides, not that in which a reader adds them."""
    seen, options = PLANS[name]
    for what, run in disturbed(seen):
        placed = [replace(e, at=Location("t.csv", n)) for n, e in enumerate(sorted(run, key=lambda e: e.start.ns), 1)]
        first, second = (
            compare(PLAN, Trace(name="", executions=Executions.of(rows)), CompareOptions(**options), MODEL)
            for rows in (placed, placed[::-1])
        )
        assert first.rows == second.rows, what
        assert first.diagnostics == second.diagnostics, what
        assert (first.by_line == second.by_line).all(), what
