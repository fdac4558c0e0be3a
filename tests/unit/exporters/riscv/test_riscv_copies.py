"""Copies of logical execution times: whose turn is when, and what keeps them from being those of their instants."""

from dataclasses import replace
from itertools import pairwise

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.core.durations import Duration
from halpipe.exporters.riscv.codes import COPIES_UNFIT, OFF_GRID
from halpipe.exporters.riscv.copies import Copies, Turn, copies_of, lines_of, patience_of, turns_of
from halpipe.exporters.riscv.cores import MainMemory
from halpipe.exporters.riscv.operations import Operation, Program, Release, Table
from halpipe.exporters.riscv.phases import COPIES, Clock
from halpipe.exporters.riscv.profile import Region, read_profile
from halpipe.exporters.riscv.target import _copies
from halpipe.models import AccessKind, Schedule, Status, TransitionTable
from riscv_models import deployed, moving
from support import job, model, ms, schedule, task

US = Duration.parse("1us")
CLOCK = Clock(US, US * 2, {COPIES: 400_000_000})
PROFILE = read_profile("vcu118")
READ, WRITE = AccessKind.READ, AccessKind.WRITE
MEMORY = MainMemory(0, 0, 0, {"in": Region(0x1000, 400), "out": Region(0x2000, 800)}, 0, 0, 0, 0)


def held(name, let, *versions, period="10ms", offset="0ms"):
    return replace(task(name, period, *versions, offset=offset), let=ms(let))


def version_of(*phases, name="v"):
    found = [moving("memory", f"{n}ms", f"{n + 1}ms", kind, *moved) for n, (kind, *moved) in enumerate(phases)]
    return deployed(name, wcet="4ms", phases=(moving("memory", "0ms", "0ms", "load"), *found))


OWNER = held("w", "5ms", version_of(("read", ("in", "a", 400)), ("write", ("out", "b", 800))))
READER = held("r", "10ms", version_of(("read", ("out", "a", 400), ("in", "b", 4))))
FREE = task("free", "10ms", version_of(("read", ("out", "a", 4000))))
SYSTEM = model(READER, OWNER, FREE, resources="memory")


def turns(system=SYSTEM, patience=10):
    return turns_of(system, [(t.name, v) for t in system.tasks for v in t.versions], CLOCK, patience)


def test_all_that_write_have_their_turns_before_all_that_read():
    """400 bytes take a microsecond, each transfer two more; the runtime may be ten late with a turn."""
    found = turns()
    assert [(t.task, t.kind, t.at, t.after, t.length) for t in found] == [
        ("w", WRITE, 5000, 0, 14),
        ("r", READ, 0, 14, 16),  # two transfers
        ("w", READ, 0, 30, 13),
    ]
    assert all(before.after + before.length == turn.after for before, turn in pairwise(found))
    copies = Copies(found)
    assert (copies.window, copies.tasks) == (43, {"w", "r"})
    assert [turn.kind for turn in copies.of("w")] == [WRITE, READ]
    assert copies.of("free") == []
    assert copies.shadows == {
        ("w", WRITE, "out"): 800,
        ("r", READ, "out"): 400,
        ("r", READ, "in"): 4,
        ("w", READ, "in"): 400,
    }


def test_a_bundle_describes_the_buffers_of_each_turn():
    copies = Copies(turns())
    shadows = {shadow: Region(0x5000 + 0x1000 * number, 8) for number, shadow in enumerate(copies.shadows)}
    found = _copies(copies, 1, replace(MEMORY, shadows=shadows))["turns"]
    assert [(turn["task"], turn["kind"], {b["name"]: b["address"] for b in turn["buffers"]}) for turn in found] == [
        ("w", "write", {"out": "0x5000"}),
        ("r", "read", {"out": "0x6000", "in": "0x7000"}),
        ("w", "read", {"in": "0x8000"}),
    ]


def test_a_turn_is_long_enough_for_the_version_that_moves_most():
    short = version_of(("read", ("in", "a", 8)), ("read", ("in", "b", 401)))
    long = version_of(("read", ("in", "a", 800), ("out", "b", 800)), name="long")
    [turn] = turns(model(held("t", "5ms", short, long), resources="memory"), patience=0)
    assert turn.sizes == {"v": {"in": 401}, "long": {"in": 800, "out": 800}}
    assert turn.length == 8
    assert Copies((turn,)).shadows == {("t", READ, "in"): 800, ("t", READ, "out"): 800}


def test_a_turn_is_of_all_versions_where_one_alone_moves_something():
    idle = version_of(("write", ("out", "b", 8)), name="idle")
    system = model(held("t", "5ms", version_of(("read", ("in", "a", 8))), idle), resources="memory")
    assert [(turn.kind, turn.sizes) for turn in turns(system)] == [
        (WRITE, {"v": {}, "idle": {"out": 8}}),
        (READ, {"v": {"in": 8}, "idle": {}}),
    ]


def test_without_logical_execution_times_there_are_no_turns():
    assert turns(model(FREE, resources="memory")) == ()
    none = Copies()
    assert (none.window, none.tasks, none.shadows) == (0, frozenset(), {})
    assert list(none.conflicts([], [], MEMORY, SYSTEM, CLOCK)) == []


@pytest.mark.parametrize(
    ("units", "service", "ticks"), [("a", "6500ns", 13), ("a b c", "6500ns", 39), ("a", "3.1us", 7)]
)
def test_two_operations_of_every_unit_may_come_first(units, service, ticks):
    profile = replace(PROFILE, service=Duration.parse(service))
    assert patience_of(model(units=units), profile) == ticks


def test_what_follows_each_other():
    tables = [Table(name, a, b, 1, ()) for name, a, b in (("m", 0, 0), ("n", 1, 1), ("m->n", 0, 1))]
    assert lines_of(tables) == [[0, 0], [1, 1], [0, 2, 1]]


OUT, IN = Turn("w", WRITE, 5000, 0, 14, {"v": {"out": 800}}), Turn("w", READ, 0, 14, 13, {"v": {"in": 400}})
JOB = job(SYSTEM, "w", 0, 0, "u1")


def phase(at, kind, buffer, limit=10, is_copy=False):
    """A transfer between a scratchpad and a buffer in main memory."""
    source, target = (MEMORY.buffers[buffer].base, 0x9000) if kind is READ else (0x9000, MEMORY.buffers[buffer].base)
    access = moving("memory", "0ms", "1ms", kind)
    return Operation(
        at=at, kind="copy", unit=0, source=source, target=target, limit=limit, access=access, is_copy=is_copy
    )


def conflicts(*others, own=(), own_turns=(OUT, IN), releases=(100,), length=10000, system=SYSTEM):
    """Play one mode whose jobs of w are released at these ticks, beside one of free that is released at tick 100."""
    programs = [Program("w", "v", (0,), tuple(own), 0, 1), Program("free", "v", (1,), others, 0, 1)]
    at = [*(Release(tick, 0, JOB) for tick in releases), Release(100, 1, JOB)]
    tables = [Table("m", 0, 0, length, tuple(at))]
    found = list(Copies(own_turns).conflicts(tables, programs, MEMORY, system, CLOCK))
    assert all(d.code == COPIES_UNFIT.id for d in found)
    return [(d.path, d.message, d.help) for d in found]


def test_inputs_are_read_when_their_copies_are_complete():
    assert conflicts(own=[phase(27, READ, "in"), phase(0, READ, "in", is_copy=True)]) == []
    text = "reads 26 ticks after its release, when its copies are complete after 27"
    remedy = "run `halpipe deploy prepare` and schedule the prepared model"
    assert conflicts(own=[phase(40, READ, "in"), phase(26, READ, "in")]) == [('task "w"', text, remedy)]
    assert conflicts(own=[phase(26, READ, "in")], own_turns=(OUT,)) == []  # it reads nothing that is copied
    assert conflicts(own=[phase(0, READ, "in")], own_turns=(OUT,)) == []
    assert conflicts() == []  # a version that reads nothing, beside one that does


@pytest.mark.parametrize(("let", "is_apart"), [(27, True), (26, False)])
def test_all_copies_of_an_instant_are_complete_before_the_next(let, is_apart):
    text = "copies at an instant 26 ticks after another, all copies need 27"
    remedy = 'state offset="0ms" for w, and schedule again: their instants are then 5ms apart'
    found = conflicts(own=[phase(27, READ, "in")], own_turns=(replace(OUT, at=let), IN))
    assert found == ([] if is_apart else [('task "w"', text, remedy)])


def test_instants_of_one_task_meet_those_of_another():
    """Of w, released at 60, at 60 and 120; of free at 100."""
    input = [phase(27, READ, "in")]
    found = conflicts(*input, own=input, own_turns=(replace(OUT, at=60), IN, replace(IN, task="free")), releases=(60,))
    assert [text for _, text, _ in found] == ["copies at an instant 20 ticks after another, all copies need 27"]


def test_instants_meet_across_the_end_of_a_cycle():
    late = conflicts(own=[phase(27, READ, "in")], own_turns=(replace(OUT, at=9980), IN))
    assert [text for _, text, _ in late] == ["copies at an instant 20 ticks after another, all copies need 27"]


@pytest.mark.parametrize(
    ("period", "let", "window", "remedy"),
    [
        ("10ms", "4.03ms", 40, "make their LETs multiples of 40us, {again}"),
        ("10ms", "4.03ms", 27, "make their LETs multiples of 40us, {again}"),  # of whole 10 us, and part of 10 ms
        ("100us", "45us", 40, "make their LETs multiples of 50us, {again}"),
        ("100us", "45us", 15, "make their LETs multiples of 20us, {again}"),  # a fifth, since a sixth is no 10 us
        ("40us", "25us", 40, "make their LETs multiples of 40us, {again}"),
        ("30us", "25us", 40, "make their periods multiples of a time of at least 40us, {again}"),
        ("80us", "40us", 40, "{again}: their instants are then 40us apart"),
    ],
)
def test_the_remedy_is_a_grid_that_holds_all_copies(period, let, window, remedy):
    again = 'state offset="0ms" for w, and schedule again'
    system = model(held("w", let, *OWNER.versions, period=period), FREE, resources="memory")
    close = (Turn("w", WRITE, 1, 0, window, {"v": {"out": 800}}),)
    [(_, text, help)] = conflicts(own_turns=(*close, replace(IN, after=0, length=0)), system=system)
    assert text == f"copies at an instant 1 ticks after another, all copies need {window}"
    assert help == remedy.format(again=again)


@pytest.mark.parametrize(
    ("other", "is_met"),
    [
        (phase(5014, READ, "out"), False),
        (phase(5013, READ, "out"), True),
        (phase(4990, READ, "out"), False),
        (phase(4990, READ, "out", limit=11), True),
        (phase(5005, WRITE, "out", limit=1), True),
        (phase(5005, READ, "in"), False),  # another buffer
        (phase(20, READ, "in"), False),  # both read
        (phase(20, WRITE, "in"), True),
        (phase(13, WRITE, "in", limit=1), False),
        (phase(14, WRITE, "in", limit=1), True),
        (phase(27, WRITE, "in"), False),
        (replace(phase(20, WRITE, "in"), kind="done"), False),
    ],
)
def test_phases_without_a_let_keep_away_from_copies_of_their_buffers(other, is_met):
    found = conflicts(other, own=[phase(27, READ, "in")])
    name = next(n for n, region in MEMORY.buffers.items() if region.base in (other.source, other.target))
    text = f'"{name}" is copied while a phase of "free" moves it'
    expected = [('task "w"', text, 'state a LET for "free", too, or move its phase')]
    assert found == (expected if is_met else [])


@pytest.mark.parametrize(("third", "is_held"), [(5014, True), (5013, False)])
def test_a_task_has_two_jobs_whose_data_wait(third, is_held):
    """The first has written 5014 ticks after its release, with the copies."""
    found = conflicts(own=[phase(27, READ, "in")], own_turns=(OUT, replace(IN, length=1)), releases=(0, 1000, third))
    text = "its third job is released before the first has written, 5ms later"
    remedy = "shorten the LET to the period, or lengthen the transition"
    told = ('task "w"', text, remedy)
    assert (told in found) is not is_held


def copied(system, *jobs, switch=()):
    tables = schedule(system, "10ms", *jobs)
    if switch:
        table = TransitionTable(
            source="all", target="all", length=ms(5), worst_latency=ms(5), status=Status.VALID, jobs=switch
        )
        tables = Schedule(model="m", model_sha256="", modes=tables.modes, transitions=(table,))
    findings = Findings()
    versions = [(t.name, v) for t in system.tasks for v in t.versions]
    return copies_of(system, tables, versions, CLOCK, PROFILE, findings), findings.items


def test_jobs_are_released_at_their_offset_whenever_they_start():
    system = model(held("w", "3ms", *OWNER.versions, period="5ms", offset="0.5ms"), FREE, resources="memory")
    jobs = [job(system, "w", 0, "0.75ms", "u1"), job(system, "w", 1, "5.5ms", "u1"), job(system, "free", 0, 1, "u1")]
    later = job(system, "w", 2, "0.25ms", "u1")
    found, told = copied(system, *jobs, switch=(later,))
    assert [str(found.release(j)) for j in (*jobs, later)] == ["500us", "5.5ms", "1ms", "250us"]
    assert told == []


def test_a_job_before_its_release_is_of_the_cycle_before():
    system = model(held("w", "6ms", *OWNER.versions, offset="2ms"), resources="memory")
    _, [told] = copied(system, job(system, "w", 0, "1ms", "u1"))
    assert (told.code, told.path) == (COPIES_UNFIT.id, 'task "w"')
    assert told.message == "job 0 starts at 1ms of the cycle after its release"
    assert told.help == "state an offset of at most 4ms, or less slack"


def test_copies_are_at_ticks_of_the_timer():
    system = model(held("w", "5.0005ms", *OWNER.versions, offset="0.0005ms"), resources="memory")
    _, told = copied(system, job(system, "w", 0, "1ms", "u1"))
    assert [d.code for d in told] == [OFF_GRID.id] * 2
    assert [d.message for d in told] == [
        f"its data are copied at {at}, no multiple of the timer's tick 1us" for at in ("500ns", "5.0005ms")
    ]
    assert {d.help for d in told} == {"schedule with --tick 1us"}
    _, told = copied(model(OWNER, resources="memory"), switch=(job(system, "w", 0, "0.0005ms", "u1"),))
    assert [d.message.split(",")[0] for d in told] == ["its data are copied at 500ns"]


@pytest.mark.parametrize(("length", "is_held"), [(5014, True), (5013, False)])
def test_the_third_job_may_be_the_first_of_the_next_cycle(length, is_held):
    found = conflicts(own=[phase(27, READ, "in")], releases=(0, 100), length=length)
    assert any("its third job is released" in text for _, text, _ in found) != is_held
