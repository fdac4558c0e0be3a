"""What must hold of every job on a RISC-V target: phases grow to what they move and never twice, executions keep their
length and lie in the job, and the management core is as late as a clerk with a stop watch writes down."""

import heapq
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise

from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.core.durations import ZERO, Duration
from halpipe.exporters.riscv.operations import COPY, DONE, RUN, Operation, Program, Release, Table, find_backlog
from halpipe.exporters.riscv.phases import clock_of, disorder, executions, phases_of
from halpipe.exporters.riscv.prepare import grow
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import DECISION
from halpipe.models import AccessKind
from profiles import examples
from riscv_models import deployed, moving, single
from support import job

PROFILE = read_profile("vcu118")
SYSTEM, _ = single()
CLOCK = clock_of(SYSTEM, PROFILE)
JOB = job(SYSTEM, "scale", 0, 0, "u1")

times = st.builds(lambda n, d: Duration(Fraction(n * 1000, d)), st.integers(0, 200), st.sampled_from([1, 1, 1, 3, 10]))


images = st.lists(st.tuples(st.integers(1, 200_000), st.sampled_from(["ispm", "dspm"])), min_size=1, max_size=2)


@st.composite
def versions(draw):
    """Phases one after the other, from the job's start, with gaps or without; the first may load."""
    instants = [ZERO]
    for length in draw(st.lists(times, min_size=1, max_size=8)):
        instants.append(instants[-1] + length)
    phases = []
    for number, (start, end) in enumerate(list(pairwise(instants))[::2]):
        if start == end:
            continue
        kind = "load" if start == ZERO and draw(st.booleans()) else draw(st.sampled_from(["read", "write"]))
        size = draw(st.integers(1, 100_000))
        transfers = () if kind == "load" else ((f"b{number}", "numbers", size),)
        phases.append(replace(moving("memory", "0ms", "1ms", kind, *transfers), start=start, end=end))
    wcet = instants[-1] + draw(times) + Duration(1000)
    return replace(deployed(phases=tuple(phases), gang=draw(st.integers(1, 3))), wcet=wcet)


def made_to_fit(version, sizes):
    return grow(version, sizes, "memory", CLOCK, PROFILE.patience, lambda access: ZERO, 0)


def idle(version):
    """The lengths of time outside of phases that move something, without those of none."""
    marks = [ZERO, *(t for a in phases_of(version) for t in (a.start, a.end)), version.wcet]
    return [end - start for start, end in list(pairwise(marks))[::2] if end > start]


@examples(60)
@given(versions(), images)
def test_phases_grow_to_what_they_move_and_never_twice(version, sizes):
    once = made_to_fit(version, sizes)
    assert made_to_fit(once, sizes) == once
    assert once.accesses[0].kind is AccessKind.LOAD
    for access in once.accesses:
        members = 1 if access.kind is AccessKind.WRITE else version.gang
        memory = "main" if access.kind is AccessKind.WRITE else "dspm"
        moved = sizes if access.kind is AccessKind.LOAD else [(t.size, memory) for t in access.transfers]
        needed = members * sum(CLOCK.transfer("memory", *each) for each in moved)
        assert CLOCK.down(access.end) - CLOCK.up(access.start) >= needed + PROFILE.patience
        assert access.end <= once.wcet


@examples(60)
@given(versions(), images)
def test_executions_keep_their_length(version, sizes):
    once = made_to_fit(version, sizes)
    assert idle(once) == idle(version)
    assert once.wcet >= version.wcet


@examples(60)
@given(versions(), st.integers(1, 4))
def test_executions_lie_in_the_job_and_beside_its_phases(version, functions):
    found = executions(version, functions)
    assume(not disorder(version, functions, CLOCK))
    assert len(found) == functions
    for begin, end in found:
        assert CLOCK.up(begin) < CLOCK.down(end)
        assert ZERO <= begin < end <= version.wcet
        if functions > 1:
            assert all(end <= a.start or begin >= a.end for a in phases_of(version))
        reads = [a for a in phases_of(version) if a.kind is not AccessKind.WRITE]
        writes = [a for a in phases_of(version) if a.kind is AccessKind.WRITE]
        if functions == 1:
            assert all(a.end <= begin for a in reads)
            assert all(end <= a.start for a in writes)


operations = st.lists(st.tuples(st.integers(0, 30), st.sampled_from([COPY, DONE, RUN])), min_size=1, max_size=6)


def written_down(tables, programs, line, service):
    """The lateness of each operation on a line of tables, by a clerk who looks at the clock at every tick."""
    due = []
    start = 0
    for index in line:
        for release in tables[index].releases:
            heapq.heappush(due, (start + release.tick, 1, len(due), None))
            for position, o in enumerate(programs[release.program].operations):
                heapq.heappush(due, (start + release.tick + o.at, o.key[1], len(due), (release.program, position)))
        start += tables[index].length
        heapq.heappush(due, (start, 1, len(due), None))
        if tables[index].is_mode:  # the look at the mailbox
            heapq.heappush(due, (start - DECISION, 3, len(due), None))
    late = {}
    now = 0
    while due:
        tick, _, _, which = heapq.heappop(due)
        now = max(now, tick)
        if which is not None:
            late[which] = max(late.get(which, 0), now - tick)
        now += service
    return late


@examples(60)
@given(
    st.lists(operations, min_size=1, max_size=3),
    st.lists(st.integers(0, 39), min_size=3, max_size=3),
    st.integers(1, 9),
)
def test_lateness_is_what_a_queue_has(shapes, ticks, service):
    programs = [
        Program("scale", "v", (i,), tuple(sorted(made, key=lambda o: o.key)), 0, 1)
        for i, ops in enumerate(shapes)
        for made in [[Operation(at=at, kind=kind, unit=i) for at, kind in ops]]
    ]
    releases = tuple(
        sorted((Release(ticks[i], i, JOB) for i in range(len(programs))), key=lambda r: (r.tick, r.program))
    )
    tables = [Table("m", 0, 0, 40, releases)]
    found = find_backlog(tables, programs, replace(PROFILE, service=CLOCK.tick * service))
    expected = written_down(tables, programs, [0, 0], service)
    assert {which: late / CLOCK.tick for which, late in found.operations.items()} == expected
