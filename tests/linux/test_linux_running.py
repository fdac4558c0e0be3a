"""The dispatcher really runs: no data race between its threads, and what it does about overruns."""

import shutil
import signal
import subprocess
import time
from dataclasses import replace

import pytest
from test_linux_bundle import PROGRAM, check, needs_compiler, sourced, two_modes, write
from test_linux_faults import is_left_within_a_table, soon

from halpipe.deploy.linux import codes
from halpipe.deploy.linux.judging import FAULTS, judge, read_recording
from halpipe.models import HealthEvent, HealthRule, Resource, Unit
from halpipe.pipeline.health import with_reactions
from riscv_models import moving
from support import job, model, ms, schedule, task, version

SLOW = """
#include <stdint.h>
#include <time.h>
int32_t seen, made;
void spin(void) {
  struct timespec t, now;
  clock_gettime(CLOCK_MONOTONIC, &t);
  do clock_gettime(CLOCK_MONOTONIC, &now);
  while ((now.tv_sec - t.tv_sec) * 1000000000LL + now.tv_nsec - t.tv_nsec < SPIN);
}
"""


def built(folder, owner, tables, **options):
    bundle, _ = write(folder, owner, tables, **options)
    subprocess.run(["make"], cwd=bundle, check=True, capture_output=True)
    return bundle


def played(bundle, *options, program="dispatcher", statuses=(0, FAULTS)):
    """Run a bundle; where a busy machine makes jobs late, the exit status says so."""
    command = [
        str(bundle / "build" / program),
        "--degrade",
        "all",
        "--record",
        str(bundle / "run.csv"),
        *options,
        *soon(),
    ]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=300)
    assert ran.returncode in statuses, ran.stderr[-2000:]
    return ran, read_recording((bundle / "run.csv").read_bytes())


# -------------------------------------------------------------------------------------------------- overruns


def overrunning(folder, monkeypatch, *rules, **options):
    """The job of b is over 12 ms after it began, in a table of 10 ms; so its next slot is over before it starts."""
    monkeypatch.setattr("test_linux_bundle.PROGRAM", SLOW)
    owner, tables = two_modes()
    spins = {"a": 1000, "b": 12_000_000}
    tasks = tuple(sourced(t, "spin", (f"SPIN={spins[t.name]}LL",)) for t in owner.tasks)
    owner = replace(owner, tasks=tasks, health=rules)
    return built(folder, owner, with_reactions(owner, tables), **options)


@needs_compiler
@pytest.mark.slow
def test_a_health_rule_answers_an_overrun_by_a_switch(tmp_path, monkeypatch):
    bundle = overrunning(tmp_path, monkeypatch, HealthRule(task="b", event=HealthEvent.OVERRUN, mode="one"))
    ran, seen = played(bundle, "--cycles", "12", statuses=[FAULTS])
    assert {r.table for r in seen} >= {"both", "one"}
    assert is_left_within_a_table(seen, next(r for r in seen if r.task == "b"))
    assert "1 mode switches" in ran.stdout
    _, seen = played(bundle, "--cycles", "12", "--overrun", "log")
    assert {r.table for r in seen} == {"both"}


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("policy", ["log", "skip", "switch=one"])
def test_overruns_are_logged_skipped_or_answered_by_a_switch(tmp_path, monkeypatch, policy):
    bundle = overrunning(tmp_path, monkeypatch)
    ran, seen = played(bundle, "--cycles", "12", "--overrun", policy, statuses=[FAULTS])
    b = [r for r in seen if r.task == "b"]
    counts = dict(reversed(piece.strip().split(" ", 1)) for piece in ran.stdout.splitlines()[1].split(","))
    assert all(r.end - r.start >= ms(12) for r in b)
    assert int(counts["ended late"]) >= 1
    if policy == "log":
        assert [r.cycle for r in b] == list(range(len(b)))  # every one runs, if late
        assert b[-1].start - b[-1].planned > b[0].start - b[0].planned
        assert int(counts["skipped"]) == 0
    elif policy == "skip":
        assert int(counts["skipped"]) >= 1
        assert all(r.start < r.planned + ms(1) for r in b)  # none starts after its slot
    else:
        assert {r.table for r in seen} >= {"both", "one"}
        assert is_left_within_a_table(seen, next(r for r in b if r.end > r.planned + ms(10)))
        assert "1 mode switches" in ran.stdout


@needs_compiler
@pytest.mark.slow
def test_the_wait_for_a_switch_is_measured(tmp_path):
    owner, tables = two_modes()
    bundle = built(tmp_path, owner, tables, busy=10)
    ran, seen = played(bundle, "--seconds", "0.5", "--switch", "0.101=one", "--switch", "0.252=both")
    assert {r.table for r in seen} == {"both", "one", "one->both"}
    line = ran.stdout.splitlines()[2]
    assert line.startswith("2 mode switches; from request to next table at most ")
    assert line.endswith("than a table and a dispatch")


@needs_compiler
@pytest.mark.slow
def test_deploy_check_names_an_overrun_where_ends_are_not_judged(tmp_path, monkeypatch):
    bundle = overrunning(tmp_path, monkeypatch, cpus={"u1": 1000})  # no machine has that one
    owner, tables = two_modes()
    checked = check(bundle, owner, tables, cycles=2)
    [noticed] = [d for d in checked.diagnostics if d.code == codes.FAULTS_NOTICED.id]
    assert "b: a job took longer than its slot" in noticed.message


# ------------------------------------------------------------------------------------------------------ races

NOT_LOCKED = """
#include <errno.h>
int mlockall(int flags) { (void)flags; errno = EPERM; return -1; }
"""
"""Keeps the shadow memory of the sanitizer, which is too large, from being locked."""


def exchange(let=None):
    """The two modes, in which a writes a buffer while b, on another unit from the same instant on, reads it."""
    owner, tables = two_modes()
    phases = {
        "a": moving("memory", "0.9ms", "1ms", "write", ("data", "wide", 13), bound="1/2"),
        "b": moving("memory", "0ms", "0.1ms", "read", ("data", "wide", 13), bound="1/2"),
    }
    units = {"a": ("u1",), "b": ("u2",)}
    tasks = tuple(
        sourced(
            replace(
                t,
                let=let,
                versions=tuple(replace(v, accesses=(phases[t.name],), units=units[t.name]) for v in t.versions),
            ),
            "both",
        )
        for t in owner.tasks
    )
    modes = tuple(
        replace(m, jobs=tuple(replace(j, units=units[j.task], start=ms(1), end=ms(2), parts=()) for j in m.jobs))
        for m in tables.modes
    )
    both = (Unit(name="u1"), Unit(name="u2"))
    return replace(owner, tasks=tasks, units=both, resources=(Resource(name="memory"),)), replace(tables, modes=modes)


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize("let", [None, "2ms"])
def test_the_threads_have_no_data_race(tmp_path, monkeypatch, let):
    """With logical execution times a thread of its own copies the buffer for both programs."""
    probe = tmp_path / "probe.c"
    probe.write_text("int main(void) { return 0; }\n")
    tried = ["cc", "-fsanitize=thread", "-o", str(tmp_path / "probe"), str(probe)]
    if not shutil.which("cc") or subprocess.run(tried, capture_output=True, check=False).returncode:
        pytest.skip("the compiler has no thread sanitizer")
    if subprocess.run([str(tmp_path / "probe")], capture_output=True, check=False).returncode:
        pytest.skip("programs under the thread sanitizer do not run on this kernel")
    monkeypatch.setattr("test_linux_bundle.PROGRAM", PROGRAM + "char wide[13];\n")
    owner, tables = exchange(ms(let))
    bundle = built(tmp_path, owner, tables, cpus={"u1": 0, "u2": 1})
    (bundle / "not_locked.c").write_text(NOT_LOCKED)
    sources = [
        *map(str, sorted((bundle / "runtime").glob("*.c"))),
        str(bundle / "tables.c"),
        str(bundle / "not_locked.c"),
    ]
    flags = ["-std=gnu17", "-O1", "-g", "-fsanitize=thread", "-Wno-tsan", "-DPRIORITY=10"]
    command = [
        "cc",
        *flags,
        f"-I{bundle / 'runtime'}",
        "-o",
        str(bundle / "build" / "races"),
        *sources,
        "-pthread",
        "-ldl",
    ]
    subprocess.run(command, check=True, capture_output=True)
    ran, seen = played(bundle, "--seconds", "1", "--switch", "0.2=one", "--switch", "0.5=both", program="races")
    assert "ThreadSanitizer" not in ran.stderr
    assert len(seen) > 50
    assert ("copies at releases" in ran.stdout) is (let is not None)


# ------------------------------------------------------------------------------------------------------ order


@needs_compiler
@pytest.mark.slow
@pytest.mark.endurance  # threads wait for each other so long and no longer: a busy machine may take more
def test_jobs_keep_their_order_when_the_machine_was_away(tmp_path):
    """The process is stopped for 30 ms, fifteen tables, again and again; late jobs begin in the order of the tables."""
    tasks = [task(name, 2, version("v", "0.1ms", "u1")) for name in "abc"]
    owner = model(*tasks, units="u1")
    jobs = [job(owner, name, 0, f"{0.5 * k}ms", "u1", "v") for k, name in enumerate("abc")]
    tables = schedule(owner, 2, *jobs)
    bundle = built(tmp_path, owner, tables, busy=10)
    command = [str(bundle / "build" / "dispatcher"), "--degrade", "all", "--seconds", "2", *soon()]
    running = subprocess.Popen([*command, "--record", str(bundle / "run.csv")], stdout=subprocess.PIPE)
    time.sleep(0.6)
    for _ in range(15):
        running.send_signal(signal.SIGSTOP)
        time.sleep(0.03)
        running.send_signal(signal.SIGCONT)
        time.sleep(0.05)
    said = running.communicate(timeout=300)[0].decode()
    seen = read_recording((bundle / "run.csv").read_bytes())
    assert max(r.start - r.planned for r in seen) > ms(20), said
    judgement = judge(owner, tables, seen, is_timed=False)
    assert judgement.disordered == 0
