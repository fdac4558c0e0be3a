"""From jobs to operations: what is done when, for images whose addresses are chosen by hand."""

import json
from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.durations import Duration
from halpipe.exporters.riscv import FORMAT, RiscvOptions
from halpipe.exporters.riscv.codes import OFF_GRID, PHASE_ORDER, REGULATORS_LEFT_ALONE, RULE_LEFT_OUT
from halpipe.exporters.riscv.copies import Copies, turns_of
from halpipe.exporters.riscv.cores import MainMemory, Slots, cores_of
from halpipe.exporters.riscv.drivers import NONE, Driver, Drivers
from halpipe.exporters.riscv.images import Image, Part
from halpipe.exporters.riscv.operations import (
    COPY,
    DONE,
    INPUT,
    OUTPUT,
    RUN,
    STOP,
    Backlog,
    Operation,
    Operations,
    Table,
    check_grid,
    check_version,
    find_backlog,
    resets,
)
from halpipe.exporters.riscv.phases import COPIES, Clock, shares
from halpipe.exporters.riscv.profile import Region, Watchdog, read_profile
from halpipe.exporters.riscv.render import Health
from halpipe.exporters.riscv.target import _board, _json
from halpipe.exporters.riscv.toolchain import Elf, Segment, Symbol
from halpipe.models import AccessKind, HealthAction, HealthRule, ModeSchedule, Status, TransitionTable
from halpipe.models import Part as JobPart
from riscv_models import PHASES, deployed, moving, single
from support import job, mode, model, ms, schedule, task, version

US = Duration.parse("1us")
CLOCK = Clock(US, US * 2, {"memory": 400_000_000})
MEMORY = MainMemory(0, 0, 0, {"input": Region(0x1000, 64), "output": Region(0x2000, 64)}, 0, 0, 0, 0)


def image_of(version, core, at=0x100):
    symbols = {"scale": 0x10, "numbers": 0x20, "scaled": 0x30, "hp_bss_begin": 0x40, "hp_bss_end": 0x58}
    places = {name: Symbol(core.ispm.base + offset, 64) for name, offset in symbols.items()}
    segments = (Segment(0, at, core.ispm.base, 400), Segment(400, at + 400, core.dspm.base, 800))
    return Image(Part("scale", version, (core,), ()), core, "images/0.elf", Elf(segments, places))


def operations_of(system, tables, version, drivers=NONE):
    cores = cores_of(system, set(), read_profile("vcu118"), Findings())
    images = {("scale", version.name, unit): image_of(version, core) for unit, core in cores.items()}
    made = Operations(CLOCK, {"memory": 0}, MEMORY, images, Slots(len(cores)), drivers)
    return made, made.tables(tables)


def lines(program):
    return [(o.at, o.kind, o.unit, o.source, o.target, o.size) for o in program.operations]


def test_the_life_of_a_job():
    system, tables = single()
    made, [table] = operations_of(system, tables, system.tasks[0].versions[0])
    core = 0x01820000
    assert lines(made.programs[0]) == [
        (0, COPY, 0, 0x100, core, 400),
        (3, COPY, 0, 0x100 + 400, 0x01040000, 800),  # 2 us set-up and 1 us for 400 bytes later
        (100, DONE, 0, 0, 0, 0),
        (100, COPY, 0, 0x1000, core + 0x20, 64),
        (200, DONE, 0, 0, 0, 0),
        (200, RUN, 0, core + 0x10, core + 0x40, 0x18),
        (900, STOP, 0, 0, 0, 0),
        (900, COPY, 0, core + 0x30, 0x2000, 64),
        (1000, DONE, 0, 0, 0, 0),
    ]
    assert (table.name, table.length) == ("all", 5000)
    assert [(r.tick, r.program) for r in table.releases] == [(0, 0)]
    copies = [o for o in made.programs[0].operations if o.kind == COPY]
    assert [(o.limit, o.needs) for o in copies] == [(100, 7), (97, 4), (100, 3), (100, 3)]
    assert made.programs[0].operations[5].limit == 700


def test_only_the_first_execution_of_a_job_clears_its_data():
    middle = moving("memory", "0.5ms", "0.6ms", "read", ("input", "numbers", 64))
    version = deployed(phases=(*PHASES[:2], middle, PHASES[2]), entry="scale numbers")
    made, _ = operations_of(*single(version), version)
    assert [(o.at, o.size) for o in made.programs[0].operations if o.kind == RUN] == [(200, 0x18), (600, 0)]


def test_a_gang_loads_and_reads_on_each_unit_and_each_member_writes_its_part():
    version = deployed(units="u1 u2", gang=2)
    system, tables = single(version, units="u1 u2")
    made, _ = operations_of(system, tables, version)
    operations = made.programs[0].operations
    assert made.programs[0].units == (0, 1)
    loads = [(o.at, o.unit) for o in operations if o.what == "image"]
    assert loads == [(0, 0), (3, 0), (7, 1), (10, 1)]
    assert [(o.at, o.unit) for o in operations if o.what == "input"] == [(100, 0), (103, 1)]
    assert [(o.unit, o.rank, o.ranks) for o in operations if o.kind == RUN] == [(0, 0, 2), (1, 1, 2)]
    assert [o.unit for o in operations if o.kind == STOP] == [0, 1]
    written = [o for o in operations if o.what == "output"]
    assert [(o.unit, o.size) for o in written] == [(0, 32), (1, 32)]
    assert written[1].target - written[0].target == 32


@pytest.mark.parametrize(
    ("size", "members", "parts"),
    [
        (64, 2, [(0, 0, 32), (1, 32, 32)]),
        (72, 3, [(0, 0, 24), (1, 24, 24), (2, 48, 24)]),
        (8, 2, [(0, 0, 8)]),  # a scalar is the first member's
        (9, 1, [(0, 0, 9)]),
    ],
)
def test_what_a_gang_writes_is_divided(size, members, parts):
    assert shares(moving("memory", "0ms", "1ms", "write"), size, members) == parts
    assert shares(moving("memory", "0ms", "1ms", "read"), size, members) == [(m, 0, size) for m in range(members)]


def test_checks_come_before_executions_and_these_before_transfers():
    system, tables = single()
    made, _ = operations_of(system, tables, system.tasks[0].versions[0])
    at_100 = [o.kind for o in made.programs[0].operations if o.at == 100]
    at_200 = [o.kind for o in made.programs[0].operations if o.at == 200]
    assert (at_100, at_200) == ([DONE, COPY], [DONE, RUN])


def test_jobs_share_a_program_and_tables_keep_their_order():
    system, _ = single(period="2ms")
    jobs = tuple(job(system, "scale", i, start, "u1") for i, start in ((0, 1), (1, 3)))
    made, [table] = operations_of(system, schedule(system, "4ms", *reversed(jobs)), system.tasks[0].versions[0])
    assert len(made.programs) == 1
    assert [(r.tick, r.job.index) for r in table.releases] == [(1000, 0), (3000, 1)]


def test_transitions_follow_the_modes():
    system, tables = single()
    both = ModeSchedule(name="other", hyperperiod=ms(5), status=Status.VALID, jobs=tables.modes[0].jobs)
    switch = TransitionTable(source="all", target="other", length=ms(1), worst_latency=ms(6), status=Status.VALID)
    tables = type(tables)(model="m", model_sha256="", modes=(tables.modes[0], both), transitions=(switch,))
    _, found = operations_of(system, tables, system.tasks[0].versions[0])
    assert [(t.name, t.origin, t.target, t.is_mode, t.length) for t in found] == [
        ("all", 0, 0, True, 5000),
        ("other", 1, 1, True, 5000),
        ("all->other", 0, 1, False, 1000),
    ]


@pytest.mark.parametrize(("start", "is_on_grid"), [("0.001ms", True), ("0.0015ms", False), ("1/3ms", False)])
def test_releases_are_ticks_of_the_timer(start, is_on_grid):
    system, _ = single()
    findings = Findings()
    check_grid(schedule(system, "5ms", job(system, "scale", 0, start, "u1")), CLOCK, findings)
    assert ([d.code for d in findings.items] == []) is is_on_grid
    if not is_on_grid:
        assert findings.items[0].code == OFF_GRID.id
        assert "--tick 1us" in findings.items[0].help


@pytest.mark.parametrize("later", ["0.0015ms", "0.003ms"])
def test_every_part_of_a_job_starts_at_a_tick_of_the_timer(later):
    system, _ = single()
    findings = Findings()
    cut = [JobPart(start=ms(at), end=ms(at), executed_from=US, executed_to=US) for at in (0, later)]
    check_grid(schedule(system, "5ms", replace(job(system, "scale", 0, 0, "u1"), parts=tuple(cut))), CLOCK, findings)
    expected = ["the start of a part 1.5us is no multiple of the timer's tick 1us"] if later == "0.0015ms" else []
    assert [d.message for d in findings.items] == expected


def test_hyperperiods_and_tables_are_whole_ticks():
    _, tables = single()
    switch = TransitionTable(source="all", target="all", length=US / 2, worst_latency=ms(6), status=Status.VALID)
    mode = ModeSchedule(name="all", hyperperiod=US * 5 / 2, status=Status.VALID, jobs=())
    findings = Findings()
    check_grid(type(tables)(model="m", model_sha256="", modes=(mode,), transitions=(switch,)), CLOCK, findings)
    assert ["hyperperiod" in d.message or "length" in d.message for d in findings.items] == [True, True]


def test_no_order_of_execution():
    phases = (PHASES[0], PHASES[2], moving("memory", "0.95ms", "1ms", "read", ("input", "numbers", 64)))
    findings = Findings()
    check_version(Part("scale", deployed(phases=phases), (), ()), CLOCK, findings)
    assert [d.code for d in findings.items] == [PHASE_ORDER.id]


def test_inputs_come_before_the_transfers_of_their_phase_and_outputs_when_all_is_written():
    drivers = Drivers(
        (
            Driver("output", "put", US, AccessKind.WRITE, "", Location("d")),
            Driver("input", "get", US * 5, AccessKind.READ, "scale", Location("d")),
            Driver("input", "other", US, AccessKind.READ, "another", Location("d")),
        )
    )
    system, tables = single()
    version = system.tasks[0].versions[0]
    made, found = operations_of(system, tables, version, drivers)
    kinds = [(o.at, o.kind, o.what) for o in made.programs[0].operations if o.kind in (COPY, DONE, INPUT, OUTPUT)]
    assert kinds[kinds.index((100, INPUT, "get, input")) + 1] == (100, COPY, "input")
    assert kinds[-2:] == [(1000, DONE, "write"), (1000, OUTPUT, "put, output")]
    assert sum(kind in (INPUT, OUTPUT) for _, kind, _ in kinds) == 2
    # Its time delays the transfer, and is reckoned with.
    late = find_backlog(found, made.programs, read_profile("vcu118"))
    place = next(i for i, o in enumerate(made.programs[0].operations) if o.what == "input")
    none, plain = operations_of(system, tables, version)
    before = next(i for i, o in enumerate(none.programs[0].operations) if o.what == "input")
    without = find_backlog(plain, none.programs, read_profile("vcu118"))
    service = read_profile("vcu118").service
    assert late.operations[0, place] == without.operations[0, before] + service + US * 5


def test_at_one_tick_what_ends_comes_first_then_executions_then_transfers():
    """A unit is free before its next job runs, and the runtime has passed on all before it copies for a long time."""
    kinds = [COPY, INPUT, RUN, OUTPUT, STOP, DONE]
    ordered = sorted(kinds, key=lambda kind: Operation(at=7, kind=kind, unit=0).key)
    assert [{*ordered[:3]}, ordered[3], {*ordered[4:]}] == [{OUTPUT, STOP, DONE}, RUN, {COPY, INPUT}]
    assert Operation(at=6, kind=COPY, unit=0).key < Operation(at=7, kind=DONE, unit=0).key
    transfers = {Operation(at=7, kind=kind, unit=0).key for kind in (COPY, INPUT)}
    assert len(transfers) == 1  # in the order of the slots
    assert max(transfers)[1] < 3  # that of the look at the mailbox, the last of two bits


def test_copies_of_logical_execution_times_have_the_drivers_of_their_buffers():
    """Inputs are read when the copies of what is read begin, outputs are called when those of what is written end."""
    system, _ = single()
    system = replace(system, tasks=(replace(system.tasks[0], let=ms(2)),))
    version = system.tasks[0].versions[0]
    clock = Clock(US, US * 2, {"memory": 400_000_000, COPIES: 400_000_000})
    copies = Copies(turns_of(system, [("scale", version)], clock, 0))
    drivers = Drivers(
        (
            Driver("output", "put", US, AccessKind.WRITE, "", Location("d")),
            Driver("input", "get", US * 5, AccessKind.READ, "scale", Location("d")),
        )
    )
    cores = cores_of(system, set(), read_profile("vcu118"), Findings())
    images = {("scale", version.name, unit): image_of(version, core) for unit, core in cores.items()}
    shadows = {shadow: Region(0x5000 + 0x100 * number, 64) for number, shadow in enumerate(copies.shadows)}
    memory = replace(MEMORY, shadows=shadows)
    made = Operations(clock, {"memory": 0, COPIES: 1}, memory, images, Slots(len(cores)), drivers, copies)
    made.tables(schedule(system, "5ms", job(system, "scale", 0, 0, "u1")))
    found = [(o.at, o.kind, o.what) for o in made.programs[0].operations if o.kind in (INPUT, OUTPUT) or o.is_copy]
    write, read = copies.turns
    begin, later = write.at + write.after, read.at + read.after
    assert (write.kind, begin, read.kind, later) == (AccessKind.WRITE, 2000, AccessKind.READ, write.length)
    assert found == [
        (later, INPUT, "get, input"),
        (later, COPY, "input"),
        (begin, COPY, "output"),
        (begin + write.length, OUTPUT, "put, output"),
    ]
    ends = [(o.at, o.what) for o in made.programs[0].operations if o.kind == DONE and o.what.startswith("LET")]
    assert ends == [(later + read.length, "LET read"), (begin + write.length, "LET write")]
    copied = {o.what: (o.source, o.target) for o in made.programs[0].operations if o.is_copy}
    assert copied == {
        "input": (MEMORY.buffers["input"].base, shadows["scale", AccessKind.READ, "input"].base),
        "output": (shadows["scale", AccessKind.WRITE, "output"].base, MEMORY.buffers["output"].base),
    }
    moved = {o.what: o for o in made.programs[0].operations if o.kind == COPY and not o.is_copy}
    assert moved["input"].source == shadows["scale", AccessKind.READ, "input"].base
    assert moved["output"].target == shadows["scale", AccessKind.WRITE, "output"].base


def test_a_watchdog_outlasts_every_table():
    """A mode is written to the watchdog when it begins: the start of the runtime may take a millisecond before it."""
    profile = read_profile("vcu118")
    tables = [Table("m", 0, 0, 5000, ()), Table("m->n", 0, 1, 4000, ())]
    late = Backlog({}, {0: US * 7, 1: US * 9})
    longest = [profile.tick * 5000 + US * 7 + profile.service + ms(1), profile.tick * 4000 + US * 9 + profile.service]
    for timeout, names in ((longest[0], []), (longest[0] - US, ["m"]), (longest[1] - US, ["m", "m->n"])):
        known = replace(profile, watchdog=Watchdog(0x70000000, 1, timeout))
        messages = [d.message for d in resets(tables, late, known)]
        assert messages == [
            f'the time-out is {timeout}, and "{name}" may last {longest[index]}' for index, name in enumerate(names)
        ]
    assert list(resets(tables, late, profile)) == []


@pytest.mark.parametrize(("rates", "bandwidth"), [((5, 5, 5), 5), ((5, 7, 5), {"ispm": 5, "dspm": 7, "main": 5})])
def test_a_bundle_describes_the_bandwidth_into_each_memory(rates, bandwidth):
    profile = read_profile("vcu118")
    into = dict(zip(("ispm", "dspm", "main"), rates, strict=True))
    assert _board(replace(profile, dma=replace(profile.dma, into=into)))["dma"]["bandwidth"] == bandwidth


def test_a_bundle_describes_the_cycles_of_each_class_of_instructions():
    profile = read_profile("vcu118")
    assert _board(replace(profile, cpi=Fraction(2), management_cpi=Fraction(2)))["cpi"]["jobs"] == "2"
    even = {"cpi": Fraction(2), "management_cpi": Fraction(2), "classes": dict.fromkeys(profile.classes, Fraction(2))}
    assert _board(replace(profile, **even))["cpi"] == "2"


def test_the_description_of_a_bundle_is_ascii():
    """Programs of any locale read it."""
    assert json.loads(_json({"name": "\u00fcber"})) == {"name": "\u00fcber"}
    assert _json({"name": "\u00fcber"}).isascii()


def test_rules_of_a_task_follow_each_other_and_a_task_without_one_has_none():
    rules = (("a", "row 1"), ("b", "row 2"), ("b", "row 3"))
    assert [Health(rules, 3).of(task) for task in "abc"] == [("0U", "1U"), ("1U", "2U"), ("0U", "0U")]
    assert Health((), 0).of("a") == ("0U", "0U")


@pytest.mark.parametrize(("header", "is_left"), [(b"#define HP_REGULATORS 1", False), (b"#define HP_UNITS 1", True)])
def test_regulators_without_registers_are_left_alone(header, is_left):
    contents = {"regulator/report.json": b'{"findings": []}', "runtime/platform.h": header}
    found = FORMAT.remarks(model(), None, RiscvOptions(regulator="p.yaml"), contents)
    assert [(d.code, d.at.file) for d in found] == [(REGULATORS_LEFT_ALONE.id, "p.yaml")] * is_left
    del contents["regulator/report.json"]
    assert FORMAT.remarks(model(), None, RiscvOptions(), contents) == []


def test_a_bundle_of_one_mode_has_no_rule_that_leads_to_another(monkeypatch):
    a = task("a", 10, version("v", 1, "u1"))
    stop = HealthRule(task="a", action=HealthAction.STOP)
    rules = (stop, HealthRule(task="a", mode="n"), HealthRule(task="a", mode="m"))
    system = replace(model(a, units="u1", modes=[mode("m", [a]), mode("n", [a])]), health=rules)
    (table,) = schedule(system, 10, job(system, "a", 0, 0, "u1"), mode_name="m").modes
    plan = replace(schedule(system, 10), modes=(table, replace(table, name="n")))
    built = []
    monkeypatch.setattr("halpipe.exporters.riscv.bundle.build", lambda model, *_: built.append(model) or {})
    for chosen, kept in (("m", (stop, rules[2])), ("n", (stop, rules[1])), ("", rules)):
        options = RiscvOptions(mode=chosen)
        FORMAT.write(system, plan, options)
        assert built.pop().health == kept
        told = FORMAT.remarks(system, plan, options, {})
        assert [d.code for d in told] == [RULE_LEFT_OUT.id] * (len(rules) - len(kept))
