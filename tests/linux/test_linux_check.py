"""Check of a Linux bundle without its programs: how long it plays what, and what it makes of builds and dispatchers."""

import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from test_linux_bundle import two_modes
from test_linux_recordings import faithful

from halpipe.core.bundles import Bundle
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.durations import Duration
from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.linux import DEPLOYMENT, codes, judging
from halpipe.deploy.linux.judging import judge, read_recording
from halpipe.models import TransitionTable
from halpipe.models.trace import Execution
from halpipe.pipeline.compare.codes import CHAIN_EXCEEDED
from support import chain, ms

HEAD = "task,job,mode,cycle,start,end,units,busy,planned,data\n"


def row(e):
    values = (e.task, e.job, e.table, e.cycle, e.start.ns, e.end.ns if e.end else "", " ".join(e.units), "")
    return ",".join(map(str, (*values, e.planned.ns, "1" if e.has_data else "0")))


def recording(seen):
    return (HEAD + "".join(row(e) + "\n" for e in seen)).encode()


FILES = {"src/deep/program.c": b"int a;\n", "src/deep/more.c": b"int b;\n"}


class Machine:
    """Stands in for make and the dispatcher: notes their commands, and answers as it is told."""

    def __init__(self, monkeypatch, *, lacking=()):
        self.commands, self.seconds = [], []
        self.make = subprocess.CompletedProcess([], 0, "", "")
        self.dispatcher = subprocess.CompletedProcess([], 0, "played\n", "")
        self.recorded = recording(faithful()[2])
        monkeypatch.setattr(judging, "run", self.run)
        monkeypatch.setattr(judging.shutil, "which", lambda name: None if name in lacking else f"/bin/{name}")
        monkeypatch.setenv("CC", "gcc -m64")

    def run(self, command, folder, *, seconds):
        self.commands.append(command)
        self.seconds.append(seconds)
        answer = self.make if command[0] == "make" else self.dispatcher
        if answer is None:
            raise judging.TimeoutExpired(command, seconds)
        if command[0] == "make":
            assert {name: Path(folder, name).read_bytes() for name in FILES} == FILES
            Path(folder, "build").mkdir()
        elif self.recorded is not None:
            Path(folder, "run.csv").write_bytes(self.recorded)
        return answer

    def check(self, tables=None, **options):
        owner, own = two_modes()
        bundle = Bundle("bundle", "linux", {}, FILES)
        target = Target(bundle=bundle, model=owner, schedule=tables or own)
        return DEPLOYMENT.check(target, CheckOptions(**options))

    def refused(self, **options):
        with pytest.raises(HalpipeError) as caught:
            self.check(**options)
        return caught.value


@pytest.fixture
def machine(monkeypatch):
    return Machine(monkeypatch)


def said(status=0, errors="", out="played\n"):
    return subprocess.CompletedProcess([], status, out, errors)


# ------------------------------------------------------------------------------------------------ what is played


@pytest.mark.parametrize(
    ("options", "stay"),
    [({}, 0.5), ({"seconds": 6}, 2), ({"cycles": 100}, 1), ({"cycles": 3}, 0.03), ({"cycles": 1}, 0.02)],
)
def test_every_mode_is_played_as_long_and_every_switch_is_asked_for(machine, options, stay):
    """Both, one, and both again, at other phases of the tables of 10 ms; a mode is played for two tables at least."""
    machine.check(**options)
    [make, dispatcher] = machine.commands
    assert make == ["make", "CC=gcc -m64"]
    [_, _, record, *asked] = dispatcher
    assert (Path(dispatcher[0]).name, Path(record).name) == ("dispatcher", "run.csv")
    assert asked == [
        *("--degrade", "all", "--seconds", f"{3 * stay + 0.01:.6f}"),
        *("--switch", f"{stay + 0.01 / 3:.6f}=one", "--switch", f"{2 * (stay + 0.01 / 3):.6f}=both"),
    ]
    assert machine.seconds == [300, pytest.approx(3 * stay + 0.01 + 30)]


def test_cycles_are_those_of_the_longest_mode(machine):
    _, tables = two_modes()
    longer = replace(tables.modes[1], hyperperiod=ms(40))
    machine.check(replace(tables, modes=(tables.modes[0], longer)), cycles=100)
    assert machine.commands[1][5:7] == ["--seconds", "12.040000"]


@pytest.mark.parametrize(("hyperperiod", "seconds"), [(10, 0.5), (200, 0.6)])
def test_one_mode_is_played_for_half_a_second_and_for_three_tables(machine, hyperperiod, seconds):
    _, tables = two_modes()
    mode = replace(tables.modes[0], hyperperiod=ms(hyperperiod))
    machine.check(replace(tables, modes=(mode,), transitions=()))
    assert machine.commands[1][3:] == ["--degrade", "all", "--seconds", f"{seconds:.6f}"]


def test_of_many_modes_64_switches_are_asked_for(machine):
    _, tables = two_modes()
    names = [f"m{n}" for n in range(65)]
    modes = tuple(replace(tables.modes[0], name=name, jobs=()) for name in names)
    ways = [
        TransitionTable(source=a, target=b, length=ms(0), worst_latency=ms(0), status=modes[0].status)
        for a, b in zip(names, [*names[1:], names[0]], strict=True)
    ]
    assert judging._tour(replace(tables, modes=modes, transitions=tuple(ways))) == names[1:65]
    assert judging._tour(replace(tables, modes=modes[:3], transitions=(ways[1], ways[0]))) == ["m1", "m2"]


# ------------------------------------------------------------------------------------------------ what is found


def test_a_sound_run_is_told_in_counts(machine):
    machine.dispatcher = said(out="dispatcher\nlocked memory\n")
    checked = machine.check()
    assert checked.diagnostics == ()
    assert checked.files == {"trace": machine.recorded}
    assert checked.lines == (
        "locked memory",
        "10 jobs in 7 tables, 2 switches: order, completeness and ends judged",
        "0 jobs missing, 0 out of order",
        "start error: p50 0.0us, p99 0.0us, max 0.0us",
    )


def test_one_switch_is_one_and_start_errors_are_in_microseconds():
    owner, tables, seen = faithful()
    to_one = [e for e in seen if e.cycle < 5]
    late = [replace(e, start=e.start + Duration(90 * (n == 3) + 1990)) for n, e in enumerate(to_one)]
    lines = judging._lines(judge(owner, tables, late, is_timed=False), True)
    assert lines == [
        "7 jobs in 5 tables, 1 switch: order and completeness judged",
        "0 jobs missing, 0 out of order",
        "start error: p50 2.0us, p99 2.1us, max 2.1us",
    ]


@pytest.mark.parametrize(("most", "is_beyond"), [("1ms", True), ("30ms", False)])
def test_chains_are_measured_and_only_the_limit_of_the_model_counts(most, is_beyond):
    """A faithful run may be worse than the verified figures by its start errors; here jobs take 1.6 ms, for 1 ms."""
    owner, tables, seen = faithful()
    limited = replace(owner, chains=(replace(chain("c", "a"), max_latency=ms(most)),))
    late = [replace(e, start=e.planned, end=e.planned + ms("1.6ms")) for e in seen if e.cycle < 3]
    for is_timed in (True, False):
        judgement = judge(limited, tables, late, is_timed=is_timed)
        assert (codes.LATE_JOB.id in {d.code for d in judgement.diagnostics}) is is_timed
        assert (CHAIN_EXCEEDED.id in {d.code for d in judgement.diagnostics}) is (is_timed and is_beyond)
        assert judging._lines(judgement, False)[3:] == [
            'chain "c": latency 1.6ms at most, 1ms verified; 3 measured',
            'chain "c": reaction 11.6ms at most, 11ms verified; 2 measured',
            'chain "c": age 1.6ms at most, 1ms verified; 3 measured',
        ]


def test_without_rights_ends_are_not_judged_and_a_warning_says_why(machine):
    _, _, seen = faithful()
    machine.recorded = recording([replace(seen[0], end=ms(3)), *seen[1:]])
    machine.dispatcher = said(errors="dispatcher: degraded: no SCHED_FIFO\ndispatcher: degraded: one CPU\nhello\n")
    [warning] = machine.check().diagnostics
    assert (warning.code, warning.message) == (codes.NOT_REAL_TIME.id, "no SCHED_FIFO; one CPU")
    assert warning.at.file == "bundle/manifest.json"
    machine.dispatcher = said()
    assert [d.code for d in machine.check().diagnostics] == [codes.LATE_JOB.id]
    machine.dispatcher = said(errors="dispatcher: degraded: one CPU\n")
    machine.recorded = recording(seen[1:])
    assert [d.code for d in machine.check().diagnostics] == [codes.NOT_REAL_TIME.id, codes.MISSING_JOB.id]


@pytest.mark.parametrize(
    ("errors", "text"),
    [
        ("dispatcher: degraded: one CPU\ndispatcher: a is late\ndispatcher: b is late\n", "a is late, b is late"),
        ("", "jobs were late or left out"),
    ],
)
def test_a_fault_that_the_dispatcher_noticed_is_a_warning_behind_what_was_found(machine, errors, text):
    machine.recorded = recording(faithful()[2][1:])
    machine.dispatcher = said(3, errors)
    found = machine.check().diagnostics
    assert [d.code for d in found if d.code == codes.MISSING_JOB.id]
    assert (found[-1].code, found[-1].message) == (codes.FAULTS_NOTICED.id, text)


# ------------------------------------------------------------------------------------------------ what does not run


def test_there_is_one_engine(machine):
    refused = machine.refused(engine="qemu")
    assert [(d.code, 'no engine "qemu"' in d.message) for d in refused.diagnostics] == [(codes.NOT_RUN.id, True)]
    assert refused.exit is Exit.USAGE
    for engine in ("auto", "native"):
        assert machine.check(engine=engine).diagnostics == ()


@pytest.mark.parametrize(
    ("lacking", "said"),
    [(("make",), "make"), (("gcc",), "gcc"), (("make", "gcc"), "make, gcc")],
)
def test_make_and_the_compiler_of_the_environment_are_needed(monkeypatch, lacking, said):
    machine = Machine(monkeypatch, lacking=lacking)
    assert [(d.code, d.message) for d in machine.refused().diagnostics] == [
        (codes.NO_COMPILER.id, f"not found: {said}")
    ]
    assert machine.commands == []


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ("cc x.c\n  x.c:1: Error: a\nx.c:2: error: b\n", ["x.c:1: Error: a", "x.c:2: error: b"]),
        ("no rule\nstop\n", ["no rule", "stop"]),
        ("error " + "x" * 400, ["error " + "x" * 294]),
        ("".join(f"error {n}\n" for n in range(7)), [f"error {n}" for n in range(5)]),
        ("", ["make"]),
    ],
)
def test_what_the_compiler_refuses_is_told_in_five_lines(machine, errors, expected):
    machine.make = said(2, errors)
    assert [(d.code, d.message) for d in machine.refused().diagnostics] == [(codes.NOT_BUILT.id, e) for e in expected]


def test_a_build_that_does_not_end_is_none(machine):
    machine.make = None
    [found] = machine.refused().diagnostics
    assert (found.code, found.message) == (codes.NOT_BUILT.id, "make took more than 300 s")


def test_a_dispatcher_that_does_not_end_has_not_run(machine):
    machine.dispatcher = None
    [found] = machine.refused(seconds=6).diagnostics
    assert (found.code, found.message) == (
        codes.NOT_RUN.id,
        "it did not end 30 s after the 6.0 s that it was to run",
    )


@pytest.mark.parametrize(
    ("status", "has_recording", "errors", "text"),
    [
        (1, True, "one\ntwo\n", "exit code 1: two"),
        (1, True, "x" * 301, "exit code 1: " + "x" * 300),
        (2, True, "", "exit code 2: it says nothing"),
        (0, False, "lost\n", "exit code 0: lost"),
        (3, False, "lost\n", "exit code 3: lost"),
    ],
)
def test_a_dispatcher_that_fails_or_keeps_no_recording_has_not_run(machine, status, has_recording, errors, text):
    machine.dispatcher = said(status, errors)
    machine.recorded = machine.recorded if has_recording else None
    assert [(d.code, d.message) for d in machine.refused().diagnostics] == [(codes.NOT_RUN.id, text)]


# ------------------------------------------------------------------------------------------------ recordings


def test_a_recording_is_read_by_its_columns():
    """The program of a gang runs on its first unit; one instant is in the order of the tasks."""
    data = f"{HEAD}b,1,m,2,30,50,u1 u2,7,29,0\na,0,m,2,30,,u3,,30,1\nc,0,m,0,5,6,u1,1,5,1\n".encode()
    c, a, b = read_recording(data)
    assert (c.task, c.cycle, c.start, c.end) == ("c", 0, Duration(5), Duration(6))
    assert (a.end, a.busy, a.has_data, a.units, a.planned) == (None, None, True, ("u3",), Duration(30))
    assert b == Execution(
        task="b",
        job=1,
        table="m",
        cycle=2,
        start=Duration(30),
        end=Duration(50),
        units=("u1",),
        busy=Duration(7),
        has_data=False,
        planned=Duration(29),
    )


@pytest.mark.parametrize(("cycle", "is_read"), [(0, True), (9_999_999, True), (10_000_000, False), (-1, False)])
def test_cycles_of_a_recording_have_a_limit(cycle, is_read):
    data = f"{HEAD}a,0,m,{cycle},0,1,u,1,0,1\n".encode()
    if is_read:
        assert read_recording(data)[0].cycle == cycle
        return
    with pytest.raises(HalpipeError) as caught:
        read_recording(data)
    assert f"there is no cycle {cycle}" in caught.value.diagnostics[0].message


@pytest.mark.parametrize("by", [0, 1, 2, 3])
@pytest.mark.parametrize("fraction", [1, 3])
@pytest.mark.parametrize("where", ["start", "hyperperiod", "length"])
def test_where_instants_lie_between_two_nanoseconds_two_are_no_deviation(by, fraction, where):
    """A dispatcher begins tables and jobs at the nanosecond before; where all instants are whole, none is early."""
    owner, tables, seen = faithful()
    part = Duration(ms(1).fraction / fraction) - Duration(ms(1).fraction // fraction)
    mode, switch = tables.modes[1], tables.transitions[1]
    if where == "start":
        mode = replace(mode, jobs=tuple(replace(j, start=j.start + part, end=j.end + part) for j in mode.jobs))
    elif where == "hyperperiod":
        mode = replace(mode, hyperperiod=mode.hyperperiod + part)
    else:
        switch = replace(switch, length=switch.length + part)
    tables = replace(tables, modes=(tables.modes[0], mode), transitions=(tables.transitions[0], switch))
    early = [replace(e, start=e.planned - Duration(by)) if e.cycle == 1 else e for e in seen]
    found = [d.code for d in judge(owner, tables, early, is_timed=True).diagnostics]
    assert found == ([codes.EARLY_JOB.id] * 2 if by > (0 if fraction == 1 else 2) else [])
