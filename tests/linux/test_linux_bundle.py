"""Linux bundles: what the tables say, and what the dispatcher really does with them on this machine."""

import shutil
import subprocess
from dataclasses import replace
from functools import partial

import pytest

from halpipe.core.bundles import open_bundle
from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.durations import milliseconds
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.linux import DEPLOYMENT
from halpipe.deploy.linux import codes as deploy_codes
from halpipe.deploy.linux.judging import read_recording
from halpipe.exporters.common.codes import PRIORITY_CYCLE
from halpipe.exporters.linux import FORMAT, LinuxOptions, codes
from halpipe.exporters.linux.bundle import _buffers, _check_start
from halpipe.exporters.linux.tables import _frame, thread_levels
from halpipe.exporters.regulator.platform import read_platform
from halpipe.models import (
    HealthAction,
    HealthEvent,
    HealthRule,
    Mode,
    ModeSchedule,
    Part,
    Run,
    Source,
    Split,
    Status,
    Transfer,
    Transition,
    TransitionTable,
    Unit,
)
from halpipe.pipeline.verify import verify
from support import access, job, mode, model, ms, schedule, task, version

needs_compiler = pytest.mark.skipif(
    not shutil.which("make") or not shutil.which("cc"), reason="building a bundle takes make and a C compiler"
)
PROGRAM = """
#include <stdint.h>
#include <time.h>
int32_t seen, made;
static int32_t kept;
void first(void) { kept = seen; }
void second(void) { made = kept + STEP; }
void both(void) { first(); second(); }
"""


def sourced(owner, entry, defines=("STEP=1",)):
    source = Source(files=("program.c",), entry=entry, defines=defines)
    return replace(owner, versions=tuple(replace(v, source=source) for v in owner.versions))


def system(split=None, long_entry="both"):
    """A job of 6 ms, with two gaps in which a task of 1 ms runs, both on u1; every 20 ms."""
    short = sourced(task("short", 5, version("v", "1ms", "u1")), "both", ("STEP=2",))
    long = sourced(task("long", 20, version("v", "6ms", "u1")), long_entry)
    split = split or Split(anywhere=True, max_gaps=4)
    long = replace(long, versions=tuple(replace(v, split=split) for v in long.versions))
    return model(short, long, units="u1")


def planned(owner):
    jobs = [job(owner, "short", k, 5 * k + 2, "u1") for k in range(4)]
    points = [(0, 2, 0, 2), (3, 7, 2, 6)]
    whole = job(owner, "long", 0, 0, "u1")
    parts = tuple(Part(start=ms(a), end=ms(b), executed_from=ms(c), executed_to=ms(d)) for a, b, c, d in points)
    return schedule(owner, 20, *jobs, replace(whole, parts=parts, end=ms(7)))


def write(folder, owner, tables, **options):
    (folder / "program.c").write_text(PROGRAM)
    sourced = any(each.source for task in owner.tasks for each in task.versions)
    stated = {"cpus": {"u1": 0}} | ({"sources": str(folder)} if sourced else {}) | options
    files = FORMAT.write(owner, tables, LinuxOptions(**stated))
    write_directory(str(folder / "bundle"), files)
    return folder / "bundle", {name: content.decode() for name, content in files.items()}


def check(bundle, owner, tables, **options):
    return DEPLOYMENT.check(
        Target(bundle=open_bundle(str(bundle)), model=owner, schedule=tables), CheckOptions(**options)
    )


def refused(folder, owner, tables, **options):
    with pytest.raises(HalpipeError) as caught:
        write(folder, owner, tables, **options)
    return [d.code for d in caught.value.diagnostics if d.is_error]


def test_a_job_that_may_be_interrupted_runs_through_under_the_lower_priority(tmp_path):
    owner = system()
    tables = planned(owner)
    assert [d.message for d in verify(owner, tables) if d.is_error] == []
    assert thread_levels(owner, tables, 50) == {"short": 1, "long": 0}
    _, files = write(tmp_path, owner, tables)
    assert '.task = "short", .unit = "u1", .units = "u1", .cpu = 0, .priority = 1' in files["tables.c"]
    assert '.task = "long", .unit = "u1", .units = "u1", .cpu = 0, .priority = 0' in files["tables.c"]


@pytest.mark.parametrize(("priority", "fits"), [(97, True), (98, False)])
def test_two_levels_and_the_conductor_fit_below_the_highest_priority_of_linux(tmp_path, priority, fits):
    """The rule of `main.c` and `dispatch.c`: the priority of the run plus the levels is at most 99."""
    owner = system()
    if fits:
        write(tmp_path, owner, planned(owner), priority=priority)
    else:
        assert refused(tmp_path, owner, planned(owner), priority=priority) == [codes.NO_ORDER.id]


@pytest.mark.parametrize(("priority", "fits"), [(98, True), (99, False)])
def test_a_package_for_ros_has_the_same_rule(priority, fits):
    owner = system(Split(), "")
    levels = partial(thread_levels, owner, schedule(owner, 20), priority)
    if fits:
        assert levels() == {"short": 0, "long": 0}
    else:
        with pytest.raises(HalpipeError, match="priorities up to 100; the highest is 99"):
            levels()


def test_a_job_with_a_list_of_split_points_is_held_at_them(tmp_path):
    owner = system(Split(points=(ms(2),)), "first second")
    tables = planned(owner)
    assert [d.message for d in verify(owner, tables) if d.is_error] == []
    _, files = write(tmp_path, owner, tables)
    assert "{{0, 0, 1}, {3000000, 1, 2}, }" in files["tables.c"].replace("[] = { {", "{{")
    assert thread_levels(owner, tables, 50) == {"short": 0, "long": 0}


def with_phase(owner, begin, end):
    phase = access("memory", begin, end, "1/2")
    tasks = [replace(t, versions=tuple(replace(v, accesses=(phase,)) for v in t.versions)) for t in owner.tasks[1:]]
    return model(owner.tasks[0], *tasks, units="u1", resources="memory")


def test_an_access_phase_does_not_begin_before_its_instant(tmp_path):
    """A job in one piece, of two functions: the second reads the memory, and waits where the first is early."""
    owner = with_phase(system(Split(points=(ms(2),)), "first second"), 2, 3)
    whole = [job(owner, "short", k, 5 * k + 3, "u1") for k in range(1, 4)]
    tables = schedule(owner, 20, job(owner, "long", 0, 1, "u1"), *whole)
    _, files = write(tmp_path, owner, tables)
    assert "{{1000000, 0, 1}, {3000000, 1, 2}, }" in files["tables.c"].replace("[] = { {", "{{")
    owner = with_phase(system(Split(points=(ms(2),)), "first second"), 0, 1)  # begins with the job
    _, files = write(tmp_path, owner, schedule(owner, 20, job(owner, "long", 0, 1, "u1"), *whole))
    assert "{{1000000, 0, 2}, }" in files["tables.c"].replace("[] = { {", "{{")


def test_a_job_goes_on_after_a_gap_before_its_phase_begins(tmp_path):
    """Going on takes half a millisecond from the end of the gap on; the phase begins after it."""
    split = Split(points=(ms(2),), resume=ms("0.5ms"))
    owner = with_phase(system(split, "first second"), 2, 3)
    versions = tuple(replace(v, wcet=ms(5)) for v in owner.tasks[1].versions)
    owner = replace(owner, tasks=(owner.tasks[0], replace(owner.tasks[1], versions=versions)))
    [*short, long] = planned(owner).modes[0].jobs
    first, second = long.parts
    end = ms("6.5ms")
    parts = (first, replace(second, end=end, executed_to=ms(5)))
    tables = schedule(owner, 20, *short, replace(long, end=end, parts=parts))
    assert [d.message for d in verify(owner, tables) if d.is_error] == []
    _, files = write(tmp_path, owner, tables)
    assert "{{0, 0, 1}, {3000000, 1, 1}, {3500000, 1, 2}, }" in files["tables.c"].replace("[] = { {", "{{")


def switching(split, entry):
    """Two modes, the second the first turned by 8 ms, and the table between, in which the long job has a gap."""
    owner = system(split, entry)
    one = planned(owner).modes[0]
    ends = milliseconds(8)
    early = tuple(j for j in one.jobs if j.start < ends)
    turned = tuple(moved(j, (j.start - ends) % one.hyperperiod) for j in one.jobs)
    runs = owner.modes[0].runs
    owner = replace(
        owner,
        modes=(Mode(name="one", runs=runs), Mode(name="two", runs=runs)),
        transitions=(Transition(source="one", target="two", max_length=ends),),
    )
    table = TransitionTable(
        source="one",
        target="two",
        length=ends,
        worst_latency=one.hyperperiod + ends,
        status=Status.VALID,
        jobs=early,
    )
    modes = (replace(one, name="one"), replace(one, name="two", jobs=turned))
    return owner, replace(planned(owner), modes=modes, transitions=(table,))


def moved(one, start):
    by = start - one.start
    parts = tuple(replace(p, start=p.start + by, end=p.end + by) for p in one.parts)
    return replace(one, start=start, end=one.end + by, parts=parts)


@pytest.mark.parametrize(("split", "entry"), [(Split(points=(ms(2),)), "first second"), (None, "both")])
def test_a_job_with_a_gap_in_a_table_between_modes_is_played_as_in_a_mode(tmp_path, split, entry):
    owner, tables = switching(split, entry)
    assert any(j.parts for j in tables.transitions[0].jobs)
    assert [d.message for d in verify(owner, tables) if d.is_error] == []
    _, files = write(tmp_path, owner, tables)
    parts = "{0, 0, 1}, {3000000, 1, 2}, " if split else "{0, 0, 1}, "
    assert f"parts_0[] = {{ {parts}}};" in files["tables.c"]
    job = f"{{.start = 0, .end = 7000000, .parts = parts_0, .n_parts = {2 if split else 1}, .program = 1, .job = 0}}"
    table = files["tables.c"].split("jobs_0_2[] = {")[1].split("};")[0]  # of the long task, between the modes
    assert table.strip() == f"{job},"
    crossing = [moved(j, ms(4)) if j.task == "short" and j.index == 0 else j for j in tables.transitions[0].jobs]
    table = replace(tables.transitions[0], jobs=tuple(crossing))
    assert [d for d in verify(owner, replace(tables, transitions=(table,))) if d.is_error]


def test_a_phase_that_begins_within_a_function_is_refused(tmp_path):
    owner = with_phase(system(Split(points=(ms(2),)), "first second"), 3, 4)
    assert refused(tmp_path, owner, planned(owner)) == [codes.EARLY_PHASE.id]
    anywhere = with_phase(system(), 3, 4)
    assert refused(tmp_path, anywhere, planned(anywhere)) == [codes.EARLY_PHASE.id]


def test_who_starts_in_a_gap_across_a_switch_stands_above(tmp_path):
    """The gap of the mode before is used by the mode after alone."""
    long = task("long", 20, replace(version("v", 6, "u1"), split=Split(anywhere=True, max_gaps=1)), slack=1)
    short = task("short", 20, version("v", 1, "u1"), slack=1)
    owner = model(long, short, units="u1", modes=[mode("one", (long,)), mode("two", (short,))])
    points = [(16, 20, 0, 4), (24, 26, 4, 6)]
    parts = tuple(Part(start=ms(a), end=ms(b), executed_from=ms(c), executed_to=ms(d)) for a, b, c, d in points)
    late = replace(job(owner, "long", 0, 16, "u1"), parts=parts, end=ms(26))
    tables = {"one": late, "two": job(owner, "short", 0, 1, "u1")}
    one, two = (replace(schedule(owner, 20, each).modes[0], name=name) for name, each in tables.items())
    switch = TransitionTable(source="one", target="two", length=ms(0), worst_latency=ms(20), status=Status.VALID)
    tables = replace(schedule(owner, 20), modes=(one, two), transitions=(switch,))
    assert thread_levels(owner, tables, 50) == {"long": 0, "short": 1}


def test_a_program_without_a_function_for_each_piece_is_refused(tmp_path):
    owner = system(Split(points=(ms(2),)))
    assert refused(tmp_path, owner, planned(owner)) == [codes.NO_PIECES.id]


def without_programs(split):
    owner = system(split)
    versions = [replace(t, versions=tuple(replace(v, source=None) for v in t.versions)) for t in owner.tasks]
    return model(*versions, units="u1")


def test_made_up_programs_have_a_function_for_each_piece(tmp_path):
    """They take their share of every piece, so that each is over before the next one is due."""
    owner = without_programs(Split(points=(ms(2), ms(5))))
    _, files = write(tmp_path, owner, planned(owner), busy=50)
    assert all(f'"piece_{number}"' in files["tables.c"] for number in range(3))
    assert "BUSY_NS=1000000,1500000,500000" in files["Makefile"]
    assert "BUSY_NS=1000000,1500000,500000" in files["CMakeLists.txt"]
    assert "int64_t times[3]" in files["src/dummy.c"]
    assert "{{0, 0, 1}, {3000000, 1, 3}, }" in files["tables.c"].replace("[] = { {", "{{")
    assert "BUSY_NS=500000 " in files["Makefile"]  # of the short task, in one piece
    whole = without_programs(None)
    files = FORMAT.write(whole, planned(whole), LinuxOptions(cpus={"u1": 0}, busy=50))
    assert b"int64_t times[1]" in files["src/dummy.c"]


@needs_compiler
@pytest.mark.slow  # what is written is the subject of the test before
def test_made_up_programs_in_pieces_are_played_on_this_machine(tmp_path):
    owner = without_programs(Split(points=(ms(2), ms(5))))
    tables = planned(owner)
    bundle, _ = write(tmp_path, owner, tables, busy=10, cpus={"u1": 1000})  # no machine has that one
    checked = check(bundle, owner, tables, cycles=4)
    assert [d.code for d in checked.diagnostics] == [deploy_codes.NOT_REAL_TIME.id]
    assert {ran.task for ran in read_recording(checked.files["trace"])} == {"long", "short"}


def test_versions_without_programs_are_refused_unless_made_up(tmp_path):
    owner, tables = two_modes()
    with pytest.raises(HalpipeError) as caught:
        write(tmp_path, owner, tables)
    assert all("--busy" in d.help for d in caught.value.diagnostics)
    assert len(caught.value.diagnostics) == 2


def test_a_folder_of_sources_is_refused_where_no_version_has_any(tmp_path):
    owner = without_programs(None)
    with pytest.raises(HalpipeError, match='"sources" has no effect here'):
        write(tmp_path, owner, planned(owner), busy=10, sources=str(tmp_path))
    assert write(tmp_path, owner, planned(owner), busy=10)


def test_shared_objects_are_taken_as_they_are(tmp_path):
    owner = model(task("t", 10, version("v", "1ms", "u1")), units="u1")
    source = Source(files=("ready.so",), entry="step")
    owner = replace(
        owner,
        tasks=tuple(replace(t, versions=tuple(replace(v, source=source) for v in t.versions)) for t in owner.tasks),
    )
    (tmp_path / "ready.so").write_bytes(b"a program")
    tables = schedule(owner, 10, job(owner, "t", 0, 0, "u1", "v"))
    files = FORMAT.write(owner, tables, LinuxOptions(sources=str(tmp_path), cpus={"u1": 0}))
    assert files["src/ready.so"] == b"a program"
    assert "cp src/ready.so $@" in files["Makefile"].decode()


@pytest.mark.parametrize(
    ("index", "cpu", "what"),
    [(65_534, 0, ""), (65_535, 0, "65536 jobs of a table"), (0, 1023, ""), (0, 1024, "1025 CPUs")],
)
def test_numbers_that_the_tables_cannot_hold_are_refused(tmp_path, index, cpu, what):
    """A compiler would cut them to sixteen bits, and the dispatcher play another job."""
    owner, tables = two_modes()
    [first, *others] = tables.modes
    tables = replace(tables, modes=(replace(first, jobs=(replace(first.jobs[0], index=index), first.jobs[1])), *others))
    if not what:
        assert write(tmp_path, owner, tables, busy=1, cpus={"u1": cpu})
        return
    with pytest.raises(HalpipeError) as caught:
        write(tmp_path, owner, tables, busy=1, cpus={"u1": cpu})
    [refused] = caught.value.diagnostics
    assert (refused.code, what in refused.message) == (codes.TOO_LARGE.id, True)


def test_priorities_that_close_a_cycle_are_refused():
    owner = system()
    both = tuple(
        replace(t, versions=tuple(replace(v, split=Split(anywhere=True, max_gaps=1)) for v in t.versions))
        for t in owner.tasks
    )
    owner = replace(owner, tasks=both)

    def split(name, index, a, b, c, d):
        parts = (
            Part(start=ms(a), end=ms(b), executed_from=ms(0), executed_to=ms(1)),
            Part(start=ms(c), end=ms(d), executed_from=ms(1), executed_to=ms(2)),
        )
        return replace(job(owner, name, index, a, "u1"), parts=parts, end=ms(d))

    tables = schedule(
        owner,
        20,
        split("long", 0, 0, 1, 4, 5),
        split("short", 0, 2, 3, 10, 11),
        split("long", 1, 12, 13, 15, 16),
        job(owner, "short", 1, 14, "u1"),
    )
    tables = replace(
        tables, modes=(replace(tables.modes[0], jobs=(*tables.modes[0].jobs, job(owner, "long", 2, 6, "u1"))),)
    )
    with pytest.raises(HalpipeError) as caught:
        thread_levels(owner, tables, 50)
    assert caught.value.diagnostics[0].code == PRIORITY_CYCLE.id


@pytest.mark.parametrize(
    ("kind", "cpus", "fails"), [("gpu", None, True), ("gpu", {"u1": 1}, False), ("", {}, True), ("", None, False)]
)
def test_units_that_are_no_cpus_are_refused(tmp_path, kind, cpus, fails):
    owner = replace(system(), units=(Unit(name="u1", type=kind),))
    (tmp_path / "program.c").write_text(PROGRAM)
    options = LinuxOptions(sources=str(tmp_path), cpus=cpus)
    if fails:
        with pytest.raises(HalpipeError) as caught:
            FORMAT.write(owner, planned(owner), options)
        assert [d.code for d in caught.value.diagnostics] == [codes.NOT_A_CPU.id]
    else:
        assert FORMAT.write(owner, planned(owner), options)


def test_names_that_are_no_c_strings_are_refused(tmp_path):
    owner = system()
    named = replace(owner, tasks=(replace(owner.tasks[0], name='a"b'), *owner.tasks[1:]))
    tables = planned(owner)
    jobs = tuple(replace(j, task='a"b') if j.task == "short" else j for j in tables.modes[0].jobs)
    tables = replace(tables, modes=(replace(tables.modes[0], jobs=jobs),))
    assert codes.BAD_TEXT.id in refused(tmp_path, named, tables)


def test_what_the_dispatcher_leaves_open_is_said():
    owner = model(task("g", 10, version("v", "1ms", "u1 u2", gang=2)), units="u1 u2")
    tables = schedule(owner, 10, job(owner, "g", 0, 0, "u1 u2"))
    said = [d.message for d in FORMAT.remarks(owner, tables, LinuxOptions(busy=50), {})]
    assert [text.split(":")[0] for text in said] == [
        "programs run on one CPU, though they occupy several units",
        "programs that only take 50 % of their WCET stand for",
        "CPUs are numbered in the order of the units of the model",
    ]
    assert {d.code for d in FORMAT.remarks(owner, tables, LinuxOptions(busy=50), {})} == {codes.UNREALISED.id}


def test_health_rules_that_the_dispatcher_does_not_follow_are_said():
    owner, tables = two_modes()
    followed = HealthRule(task="b", event=HealthEvent.OVERRUN, mode="one")
    for rule, is_said in [
        (followed, False),
        (replace(followed, event=HealthEvent.FAULT), True),
        (replace(followed, count=2), True),
        (HealthRule(task="b", action=HealthAction.STOP), True),
    ]:
        said = FORMAT.remarks(replace(owner, health=(rule,)), tables, LinuxOptions(busy=50), {})
        assert any("health rules" in d.message for d in said) == is_said
    for chosen, is_said in (("one", False), ("both", True)):  # what the rule goes to is all there is, or left out
        options = LinuxOptions(busy=50, mode=chosen)
        said = FORMAT.remarks(replace(owner, health=(followed,)), tables, options, {})
        assert any("health rules" in d.message for d in said) == is_said


def test_lengths_that_are_no_whole_nanoseconds_keep_their_rest(tmp_path):
    owner = model(task("t", "1/3ms", version("v", "0.1ms", "u1")), units="u1")
    tables = schedule(owner, "1/3ms", job(owner, "t", 0, 0, "u1", "v"))
    _, files = write(tmp_path, owner, tables, busy=1)
    assert ".length = 333333, .rest = 1, " in files["tables.c"]
    assert ".parts = 3," in files["tables.c"]


def two_modes():
    """a in both modes, b in one; a table of 5 ms on the way back."""
    owner = model(task("a", 10, version("v", "1ms", "u1")), task("b", 10, version("v", "1ms", "u1")), units="u1")
    runs = {name: Run(task=name, versions=("v",)) for name in "ab"}
    modes = (Mode(name="both", runs=(runs["a"], runs["b"])), Mode(name="one", runs=(runs["a"],)))
    owner = replace(owner, modes=modes)

    def mode(name, *jobs):
        return ModeSchedule(name=name, hyperperiod=ms(10), status=Status.VALID, jobs=jobs)

    def table(source, target, length, *jobs):
        return TransitionTable(
            source=source,
            target=target,
            length=ms(length),
            worst_latency=ms(10 + length),
            status=Status.VALID,
            jobs=jobs,
        )

    a, b = job(owner, "a", 0, 1, "u1"), job(owner, "b", 0, 4, "u1")
    plain = schedule(owner, 10, a, b)
    tables = (table("both", "one", 0), table("one", "both", 5, job(owner, "a", 0, 1, "u1")))
    return owner, replace(plain, modes=(mode("both", a, b), mode("one", a)), transitions=tables)


@needs_compiler
@pytest.mark.slow  # the tables and the judgement have quicker tests of their own
def test_modes_switches_and_buffers_on_this_machine(tmp_path):
    """Order and completeness hold whatever the machine; how late starts are is not asserted."""
    owner, tables = two_modes()
    bundle, _ = write(tmp_path, owner, tables, busy=10, cpus={"u1": 1000})  # no machine has that one
    checked = check(bundle, owner, tables, cycles=6)
    late = deploy_codes.FAULTS_NOTICED.id  # where the machine is busy
    assert [d.code for d in checked.diagnostics if d.code != late] == [deploy_codes.NOT_REAL_TIME.id]
    names = {ran.table for ran in read_recording(checked.files["trace"])}
    assert names == {"both", "one", "one->both"}
    assert "2 switches" in checked.lines[2]
    assert checked.lines[3] == "0 jobs missing, 0 out of order"


@needs_compiler
@pytest.mark.slow  # the tables and the priorities have quicker tests of their own
@pytest.mark.parametrize("split", [None, Split(points=(ms(2),))])
def test_parts_and_gaps_on_this_machine(tmp_path, split):
    owner = system(split, "first second" if split else "both")
    tables = planned(owner)
    bundle, _ = write(tmp_path, owner, tables)
    checked = check(bundle, owner, tables, cycles=5)
    assert [d.message for d in checked.diagnostics if d.is_error and d.code != deploy_codes.LATE_JOB.id] == []
    seen = [ran for ran in read_recording(checked.files["trace"]) if ran.task == "long"]
    if split:  # the second function does not run before its part begins
        assert all(ran.end - ran.planned >= ms(3) for ran in seen)


@pytest.mark.slow
@needs_compiler
def test_programs_that_do_not_compile_and_compilers_that_are_not_there(tmp_path, monkeypatch):
    owner = system()
    bundle, _ = write(tmp_path, sourced_wrongly(owner), planned(owner))
    with pytest.raises(HalpipeError) as caught:
        check(bundle, owner, planned(owner))
    assert {d.code for d in caught.value.diagnostics} == {deploy_codes.NOT_BUILT.id}
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(HalpipeError) as caught:
        check(bundle, owner, planned(owner))
    assert [d.code for d in caught.value.diagnostics] == [deploy_codes.NO_COMPILER.id]


def sourced_wrongly(owner):
    return replace(owner, tasks=tuple(sourced(t, "both", ("STEP=@",)) for t in owner.tasks))


@pytest.mark.slow
@needs_compiler
def test_missing_rights_are_named_with_their_remedy(tmp_path):
    """Two units on one CPU are refused by the export, and by the start, which may state other CPUs."""
    owner = model(
        *(task(name, 10, version("v", "1ms", unit)) for name, unit in (("a", "u1"), ("b", "u2"))), units="u1 u2"
    )
    tables = schedule(owner, 10, job(owner, "a", 0, 0, "u1"), job(owner, "b", 0, 0, "u2"))
    bundle, _ = write(tmp_path, owner, tables, busy=10, cpus={"u1": 0, "u2": 1})
    subprocess.run(["make"], cwd=bundle, check=True, capture_output=True)
    command = [str(bundle / "build/dispatcher"), "--cycles", "2", "--cpus"]
    for more, found in (
        (["1000,0"], ("wants CPU 1000", "--degrade cpus")),
        (["0,0", "--degrade", "fifo", "--degrade", "memory"], ("units u1 and u2 are both CPU 0",)),
    ):
        ran = subprocess.run([*command, *more], capture_output=True, text=True, check=False)
        assert ran.returncode == 1
        assert all(text in ran.stderr for text in found)
    for wrong, text in (
        (["--mode", "x"], "no such mode"),
        (["--switch", "5=all", "--seconds", "0.2"], "not before the end of --seconds"),
    ):
        ran = subprocess.run([command[0], *wrong], capture_output=True, text=True, check=False)
        assert (ran.returncode, text in ran.stderr) == (2, True)


@pytest.mark.parametrize("sizes", [(8, 64, 4), (64, 8, 4), (4, 8, 64)])
def test_a_buffer_has_the_size_of_its_largest_transfer_in_any_order(sizes):
    transfers = [Transfer(buffer="b", symbol=f"s{number}", size=size) for number, size in enumerate(sizes)]
    accesses = [replace(access("m", n, n + 1), transfers=(each,)) for n, each in enumerate(transfers)]
    one = replace(access("m", 0, 1), transfers=(Transfer(buffer="a", symbol="s", size=1),))
    owner = model(
        task("a", 10, version("v", 3, "u1", *accesses)), task("b", 10, version("v", 3, "u1", one)), resources="m"
    )
    assert list(_buffers(owner).items()) == [("a", 1), ("b", 64)]


def test_switches_are_a_square_of_the_modes():
    owner = without_programs(None)
    first = planned(owner).modes[0]
    table = TransitionTable(
        source="all", target="other", length=ms(0), worst_latency=ms(20), jobs=(), status=Status.VALID
    )
    tables = replace(planned(owner), modes=(first, replace(first, name="other")), transitions=(table,))
    assert (tables.modes[0].name, _frame(tables).switches) == ("all", [-1, 2, -1, -1])


def test_the_highest_level_counts_in_the_tables(tmp_path):
    owner = without_programs(Split(anywhere=True, max_gaps=2))
    _, files = write(tmp_path, owner, planned(owner), busy=10)
    levels = thread_levels(owner, planned(owner), 50)
    assert sorted(levels.values()) == [0, 1]
    assert ".levels = 2," in files["tables.c"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("table: {timebase: 100MHz}", ""),
        ("", "the rate of the time base that the unit counts is not stated"),
        ("backend: axi-realm", "axi-realm begins at no stated instant; the dispatcher starts the back-end table alone"),
    ],
)
def test_regulators_start_at_an_instant_of_the_dispatcher_or_are_refused(tmp_path, more, said):
    path = tmp_path / "p.yaml"
    units = "units: {u1: {manager: 0}}"
    numbers = "clock: 1MHz\nbus: 64bit\nburst: 64B\nwindow: 1000\nguaranteed: 6.4MB/s"
    path.write_text(f"halpipe-regulator: 1\n{numbers}\n{units}\n{more}\n")
    findings = Findings()
    _check_start(read_platform(str(path)), findings)
    assert [d.message for d in findings.items] == [said] * bool(said)
