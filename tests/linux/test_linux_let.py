"""Logical execution times on Linux: data are copied at the release and at release + LET, wherever the job lies."""

import struct
import subprocess
from dataclasses import replace

import pytest
from test_linux_bundle import needs_compiler, refused, sourced, two_modes, write

from halpipe.deploy.linux.judging import FAULTS
from halpipe.exporters.linux import codes
from halpipe.models import Resource
from halpipe.pipeline.verify import verify
from riscv_models import moving
from support import job, model, ms, schedule, task, version

PROGRAM = """
#include <stdint.h>
int64_t got, out, count, wrong;
void give(void) { out = ++count; }
void expect(void) { if (got != ++count - BEHIND) wrong = got + 1000 * count; }
"""
PERIOD = 40


def lets(name, unit, *phases, let=PERIOD, behind=1, offset=0):
    """A task that counts its jobs, or compares what it reads with the count of the job `behind` before."""
    found = sourced(
        task(name, PERIOD, version("v", "2ms", unit, *phases), offset=offset),
        "give" if behind is None else "expect",
        (f"BEHIND={behind or 0}",),
    )
    return replace(found, let=None if let is None else ms(let))


def reads(buffer):
    return moving("memory", "0ms", "0.1ms", "read", (buffer, "got", 8), bound="1/4")


def writes(buffer, symbol="out"):
    return moving("memory", "1.9ms", "2ms", "write", (buffer, symbol, 8), bound="1/4")


def exchange():
    """Readers of a source that writes at the end of its period, and of one that writes in its middle.

    With implicit communication each reader but `after` would get what its source wrote in the same period.
    """
    tasks = {
        "source": lets("source", "u1", writes("value"), behind=None),
        "half": lets("half", "u1", writes("part"), let=PERIOD // 2, behind=None),
        "sink": lets("sink", "u2", reads("value"), writes("of_sink", "wrong")),
        "at_release": lets("at_release", "u2", reads("value"), writes("of_release", "wrong"), let=None),
        "before": lets("before", "u2", reads("part"), writes("of_before", "wrong"), let=None, offset=10),
        "after": lets("after", "u2", reads("part"), writes("of_after", "wrong"), let=None, behind=0, offset=34),
    }
    owner = replace(model(*tasks.values(), units="u1 u2"), resources=(Resource(name="memory"),))
    starts = {"source": 0, "half": 3, "sink": 18, "at_release": 0, "before": 10, "after": 34}
    owner = with_slack(owner, half="0.1", sink="0.5")
    jobs = [job(owner, name, 0, start, owner.task(name).versions[0].units[0]) for name, start in starts.items()]
    return owner, schedule(owner, PERIOD, *jobs)


def with_slack(owner, **slacks):
    return replace(owner, tasks=tuple(replace(t, slack=slacks.get(t.name, t.slack)) for t in owner.tasks))


def copies(files, table=0):
    [line] = [
        one for one in files["tables.c"].splitlines() if one.startswith(f"static const dispatch_copy copies_{table}")
    ]
    numbers = line.split("= {")[1].replace("{", " ").replace("}", " ").replace(",", " ").replace(";", " ").split()
    return [tuple(map(int, numbers[i : i + 4])) for i in range(0, len(numbers), 4)]


def test_copies_are_made_at_the_release_and_at_release_plus_let(tmp_path):
    """Both sources are released at 0, wherever they start; at one instant what is written comes first."""
    owner, tables = exchange()
    assert [d.message for d in verify(owner, tables) if d.is_error] == []
    _, files = write(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1})
    names = [line.split('"')[1] for line in files["tables.c"].splitlines() if line.startswith('  {"')]
    assert len(names) == 6 + 4
    shown = [(at, names[a].split("~")[-1], names[b].split("~")[-1]) for at, a, b, size in copies(files) if size == 8]
    whole, middle = PERIOD * 1_000_000, PERIOD * 500_000
    assert shown == [(0, "value", "got"), (middle, "out", "part"), (whole, "out", "value"), (whole, "wrong", "of_sink")]


def test_at_one_instant_a_job_is_written_before_the_next_one_reads(tmp_path):
    both = lets("fast", "u1", reads("x"), writes("y"), let=PERIOD // 2)
    owner = model(replace(both, period=ms(PERIOD // 2)), lets("slow", "u2", reads("x")), units="u1 u2")
    owner = replace(owner, resources=(Resource(name="memory"),))
    fast = [job(owner, "fast", k, k * PERIOD // 2, "u1") for k in range(2)]
    tables = schedule(owner, PERIOD, *fast, job(owner, "slow", 0, 0, "u2"))
    _, files = write(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1})
    middle = [(source, target) for at, source, target, _ in copies(files) if at == PERIOD * 500_000]
    assert middle == [(3, 1), (0, 2)]  # buffers x and y, then those of the program in the order of its transfers


def later(start):
    """The system of which one job is released and written later than the others of its instant."""
    owner, tables = exchange()
    tasks = tuple(replace(t, offset=None) if t.name == "sink" else t for t in owner.tasks)
    jobs = tuple(
        replace(j, start=ms(start), end=ms(start + 2)) if j.task == "sink" else j for j in tables.modes[0].jobs
    )
    return replace(owner, tasks=tasks), replace(tables, modes=(replace(tables.modes[0], jobs=jobs),))


def test_without_an_offset_the_release_is_the_phase_of_the_schedule(tmp_path):
    owner, tables = later(18)
    _, files = write(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1})
    assert [(at, size) for at, _, _, size in copies(files)][:2] == [(18_000_000, 8), (20_000_000, 8)]


def without_data(owner):
    return replace(owner, tasks=tuple(sourced(without(t), "give") if t.let else t for t in owner.tasks))


def without(one):
    return replace(one, versions=tuple(replace(v, accesses=()) for v in one.versions))


def shorter(owner):
    """Deadlines and LETs of two periods."""
    tasks = (replace(t, deadline=ms(2 * PERIOD), let=t.let and ms(2 * PERIOD)) for t in owner.tasks)
    return replace(owner, tasks=tuple(tasks))


def wrapped(owner):
    """The release lies at 38 ms, and the start at 18 ms of the next cycle."""
    return replace(owner, tasks=tuple(replace(t, offset=ms(38)) if t.name == "sink" else t for t in owner.tasks))


@pytest.mark.parametrize("change", [without_data, shorter, wrapped])
def test_what_copies_cannot_keep_is_refused(tmp_path, change):
    owner, tables = exchange()
    found = set(refused(tmp_path, change(owner), tables, cpus={"u1": 0, "u2": 1}))
    assert found == {codes.NO_COPIES.id}


@pytest.mark.parametrize(("let", "found"), [(5, 0), (6, 1), (9, 1), (10, 2)])
def test_a_job_writes_before_the_next_one_is_released_in_the_table_after_its_own(tmp_path, let, found):
    """The job of the switch back is released at 1 ms of 5 ms, so the next one 5 ms later; in `both` it is 9 ms."""
    owner, tables = two_modes()
    first, other = (sourced(t, "both") for t in owner.tasks)
    phase = moving("memory", "0ms", "1ms", "write", ("data", "made", 4))
    first = replace(first, let=ms(let), versions=(replace(first.versions[0], accesses=(phase,)),))
    early = replace(tables.modes[1], jobs=tuple(replace(j, start=ms(0), end=ms(1)) for j in tables.modes[1].jobs))
    tables = replace(tables, modes=(tables.modes[0], early))
    owner = replace(owner, tasks=(first, other), resources=(Resource(name="memory"),))
    if found:
        assert refused(tmp_path, owner, tables) == [codes.NO_COPIES.id] * found
    else:
        assert [at for at, *_ in copies(write(tmp_path, owner, tables)[1])] == [(1 + let) * 1_000_000]


@needs_compiler
@pytest.mark.slow  # what the tables say has a quicker test
def test_what_programs_read_is_what_logical_execution_times_say(tmp_path, monkeypatch):
    """Each reader compares the value with the number of its job; a difference of one job makes it wrong for good."""
    monkeypatch.setattr("test_linux_bundle.PROGRAM", PROGRAM)
    owner, tables = exchange()
    bundle, _ = write(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1})
    subprocess.run(["make"], cwd=bundle, check=True, capture_output=True)
    command = ["build/dispatcher", "--degrade", "all", "--memory", "buffers", "--cycles", "10"]
    names = ("of_after", "of_before", "of_release", "of_sink", "part", "value")
    expected = {**dict.fromkeys(names, 0), "part": 10, "value": 10}
    for _ in range(10):  # a job that a busy machine makes later than its LET has another value, and is a fault
        ran = subprocess.run(command, cwd=bundle, capture_output=True, text=True, check=False, timeout=300)
        data = (bundle / "buffers").read_bytes()
        values = [struct.unpack_from("<q", data, 64 * place + 8)[0] for place in range(6)]  # a line of 64 bytes each
        found = dict(zip(names, values, strict=True))
        if found == expected or ran.returncode != FAULTS:
            break
        (bundle / "buffers").unlink()
    assert found == expected
    assert ran.returncode in (0, FAULTS)
    assert "copies at releases and at releases + LET" in ran.stdout
