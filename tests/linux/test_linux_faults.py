"""Faults of a running bundle: hang, crash, clock steps, rights that are missing, and disks that are full."""

import os
import re
import signal
import subprocess
import time
import zlib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from test_linux_bundle import needs_compiler, sourced, two_modes, write

from halpipe.deploy.linux.judging import FAULTS, read_recording
from halpipe.models import HealthEvent, HealthRule
from halpipe.pipeline.health import with_reactions
from support import ms

PROGRAM = """
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
int32_t seen, made;
static volatile int n;
#ifndef AT
#define AT 0
#endif
void leave(void) { if (++n == AT) exit(0); }
void longer(void) { if (++n == AT) usleep(12000); }
void hang(void) { if (++n == AT) for (;;) { } }
void crash(void) { if (++n == AT) *(volatile int *)8 = 1; }
static int deeper(int depth) {
  volatile char here[4096];
  memset((char *)here, depth, 4096);
  return deeper(depth + 1) + here[7];
}
void overflow(void) { if (++n == AT) made = deeper(0); }
void large(void) { volatile char here[512 * 1024]; memset((char *)here, 1, sizeof here); made = here[n++]; }
"""
STEP = """
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <stdint.h>
#include <stdlib.h>
#include <time.h>
typedef int (*getter)(clockid_t, struct timespec *);
static int64_t plain(clockid_t clock) {
  static getter real;
  if (!real) real = (getter)dlsym(RTLD_NEXT, "clock_gettime");
  struct timespec t;
  real(clock, &t);
  return t.tv_sec * 1000000000LL + t.tv_nsec;
}
static int64_t first;
__attribute__((constructor)) static void begin(void) { first = plain(CLOCK_MONOTONIC); }
static int64_t step(void) {
  return plain(CLOCK_MONOTONIC) - first > atoll(getenv("STEP_AFTER")) ? atoll(getenv("STEP_BY")) : 0;
}
int clock_gettime(clockid_t clock, struct timespec *t) {
  const int64_t now = plain(clock) + (clock == CLOCK_REALTIME ? step() : 0);
  *t = (struct timespec){now / 1000000000, now % 1000000000};
  return 0;
}
int clock_nanosleep(clockid_t clock, int flags, const struct timespec *wanted, struct timespec *left) {
  static int (*real)(clockid_t, int, const struct timespec *, struct timespec *);
  if (!real) *(void **)&real = dlsym(RTLD_NEXT, "clock_nanosleep");
  if (clock != CLOCK_REALTIME || !(flags & TIMER_ABSTIME)) return real(clock, flags, wanted, left);
  const struct timespec moment = {0, 500000};
  for (struct timespec t;;) {
    clock_gettime(clock, &t);
    if (t.tv_sec > wanted->tv_sec || (t.tv_sec == wanted->tv_sec && t.tv_nsec >= wanted->tv_nsec)) return 0;
    real(CLOCK_MONOTONIC, 0, &moment, NULL);
  }
}
"""
"""A clock of the day that is set while the program runs; everything else is the system's."""
NO_LOCK = """
#define _GNU_SOURCE
#include <errno.h>
#include <pthread.h>
#include <dlfcn.h>
static int locked, refused;
int mlockall(int flags) { (void)flags; locked = 1; return 0; }
int munlockall(void) { locked = 0; return 0; }
int pthread_create(pthread_t *t, const pthread_attr_t *a, void *(*body)(void *), void *argument) {
  static int (*real)(pthread_t *, const pthread_attr_t *, void *(*)(void *), void *);
  if (!real) *(void **)&real = dlsym(RTLD_NEXT, "pthread_create");
  if (locked && ++refused > 1) return EAGAIN;
  return real(t, a, body, argument);
}
"""
"""Threads have no room beside the locked memory, as with RLIMIT_MEMLOCK and stacks of 8 MiB."""
pytestmark = [needs_compiler, pytest.mark.slow]  # each builds and plays a bundle


def built(folder, monkeypatch, entry="hang", at=0, rules=()):
    """Two modes, in which a job of b misbehaves; a is a task of another kind."""
    monkeypatch.setattr("test_linux_bundle.PROGRAM", PROGRAM)
    owner, tables = two_modes()
    ats = {"a": 0, "b": at}
    tasks = tuple(sourced(t, entry, (f"AT={ats[t.name]}",)) for t in owner.tasks)
    owner = replace(owner, tasks=tasks, health=rules)
    bundle, _ = write(folder, owner, with_reactions(owner, tables) if rules else tables)
    main = bundle / "runtime" / "main.c"
    main.write_text(main.read_text().replace("dispatch_wait(5)", "dispatch_wait(1)"))  # for jobs that never return
    make(bundle)
    return bundle


def make(bundle):
    subprocess.run(["make", "CFLAGS=-O0"], cwd=bundle, check=True, capture_output=True)


@pytest.fixture(scope="module")
def calm(tmp_path_factory):
    """A bundle in which no job misbehaves."""
    with pytest.MonkeyPatch.context() as patch:
        return built(tmp_path_factory.mktemp("calm"), patch)


def soon():
    """Return the option of a first instant that is near, in place of the next whole second but one."""
    return "--origin", str(time.monotonic_ns() + 300_000_000)


def run(bundle, *options, shim="", **environment):
    """Run the dispatcher; with a shim that stands before the C library."""
    if shim:
        library = bundle / f"shim{zlib.crc32(repr((shim, environment)).encode())}.so"
        made = ["cc", "-shared", "-fPIC", "-x", "c", "-", "-o", str(library), "-ldl"]
        subprocess.run(made, input=shim, text=True, check=True, capture_output=True)
        environment["LD_PRELOAD"] = str(library)
    command = [str(bundle / "build" / "dispatcher"), "--record", str(bundle / "run.csv"), *options]
    command += () if "--clock" in options else soon()
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=120, env={**os.environ, **environment}
    )


def recorded(bundle):
    return read_recording((bundle / "run.csv").read_bytes())


def is_left_within_a_table(seen, cause):
    """Whether the mode of a job was left a table after its slot, or after its start where that was later.

    A conductor that was away plays the tables that are due at once, so their number says nothing.
    """
    last = max(r.planned for r in seen if r.table == cause.table)
    return last < max(cause.start, cause.planned + ms(10)) + ms(10)


def test_a_job_that_never_returns_is_found_within_a_table(tmp_path, monkeypatch):
    rule = HealthRule(task="b", event=HealthEvent.OVERRUN, mode="one")
    bundle = built(tmp_path, monkeypatch, "hang", 5, (rule,))
    ran = run(bundle, "--degrade", "all", "--seconds", "0.5")
    seen = recorded(bundle)
    assert ran.returncode == FAULTS
    assert "task b still runs" in ran.stderr
    assert re.search("[1-9][0-9]* ended late", ran.stdout)
    [hung] = [r for r in seen if r.end is None]
    assert (hung.task, hung.cycle) == ("b", 4)
    assert is_left_within_a_table(seen, hung)
    assert "one" in {r.table for r in seen}
    assert max(r.cycle for r in seen if r.task == "a") > 40  # it runs on, on the same CPU


def test_without_a_rule_a_job_that_never_returns_is_named_and_delays_no_other(tmp_path, monkeypatch):
    """The other task of its CPU and priority waits for its turn, and must not wait for one that never ends."""
    bundle = built(tmp_path, monkeypatch, "hang", 5)
    ran = run(bundle, "--degrade", "all", "--seconds", "0.5")
    assert ran.returncode == FAULTS
    assert "task b still runs" in ran.stderr
    assert "task b does not return" in ran.stderr
    after = [r.start - r.planned for r in recorded(bundle) if r.task == "a" and r.cycle > 7]
    assert sorted(after)[len(after) // 2] < ms(4)


@pytest.mark.parametrize(("entry", "how"), [("crash", "signal 11"), ("overflow", "signal 11"), ("leave", "exit()")])
def test_a_program_that_ends_the_process_is_named_and_the_recording_kept(tmp_path, monkeypatch, entry, how):
    bundle = built(tmp_path, monkeypatch, entry, 30)
    ran = run(bundle, "--degrade", "all", "--seconds", "2")
    assert ran.returncode == (1 if entry == "leave" else -signal.SIGSEGV)
    assert f"task b ended the process by {how}; the recording is kept" in ran.stderr
    b = [r for r in recorded(bundle) if r.task == "b"]
    assert [r.cycle for r in b] == list(range(30))
    assert [r.end is not None for r in b] == [True] * 29 + [False]


def test_faults_from_outside_end_the_recording_or_the_run_and_say_so(tmp_path, monkeypatch):
    """The file of the recording goes, the log is closed, the terminal hangs up, and a pipe has no reader."""
    bundle = built(tmp_path, monkeypatch, "longer", 5)
    os.mkfifo(bundle / "unread")

    def start(name, cycles):
        command = [str(bundle / "build" / "dispatcher"), "--record", str(bundle / name), "--degrade", "all", *soon()]
        return subprocess.Popen([*command, "--cycles", str(cycles)], stderr=subprocess.PIPE, text=True)

    removed, closed = start("removed", 60), start("closed", 60)
    kept = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # a process inherits what nohup ignores
    hung = start("hung", 10_000)
    signal.signal(signal.SIGHUP, kept)
    closed.stderr.close()
    wait_for_rows(bundle / "removed", 1000)
    wait_for_rows(bundle / "hung", 1000)
    (bundle / "removed").unlink()
    hung.send_signal(signal.SIGHUP)
    said = removed.communicate(timeout=60)[1]
    assert "the recording ends: No such file or directory" in said
    assert "b: a job took longer than its slot" in said
    hung.communicate(timeout=60)
    assert (removed.returncode, closed.wait(60), hung.returncode) == (1, FAULTS, FAULTS)
    ends = [r.end for r in read_recording((bundle / "hung").read_bytes())]
    assert len(ends) > 20
    assert None not in ends
    unread = start("unread", 5)
    assert "No such device or address" in unread.communicate(timeout=60)[1]


def wait_for_rows(path, size=2000):
    deadline = time.monotonic() + 60
    while time.monotonic() < deadline and not (path.exists() and path.stat().st_size > size):
        time.sleep(0.01)


def test_a_killed_run_leaves_what_it_recorded(calm):
    bundle = calm
    (bundle / "run.csv").unlink(missing_ok=True)
    command = [str(bundle / "build" / "dispatcher"), "--record", str(bundle / "run.csv"), "--degrade", "all", *soon()]
    running = subprocess.Popen(command)
    wait_for_rows(bundle / "run.csv")
    running.kill()
    running.wait()
    assert len(recorded(bundle)) > 20


def test_data_of_half_a_megabyte_has_room_on_a_stack(tmp_path, monkeypatch):
    bundle = built(tmp_path, monkeypatch, "large")
    ran = run(bundle, "--degrade", "all", "--cycles", "5")
    assert ran.returncode in (0, FAULTS), ran.stderr
    ran = run(bundle, "--degrade", "all", "--cycles", "5", "--stack", "256")
    assert ran.returncode == -signal.SIGSEGV


def test_the_tables_go_on_when_the_clock_is_set(calm):
    def stepped(step):
        options = ("--degrade", "all", "--clock", "realtime", "--seconds", "2")  # it begins 1 to 2 s after the start
        own = calm / f"stepped{step}.csv"
        by = {"STEP_AFTER": str(2_500_000_000), "STEP_BY": str(step)}
        return step, own, run(calm, *options, "--record", str(own), shim=STEP, **by)

    with ThreadPoolExecutor() as pool:
        runs = list(pool.map(stepped, [-60_000_000_000, -50_000, 300_000, 3_600_000_000_000]))
    for step, own, ran in runs:
        seen = read_recording(own.read_bytes())
        assert ran.returncode == FAULTS
        [whole] = re.findall(r"the clock was set 1 times, by (-?[0-9]+\.[0-9]+) ms in all", ran.stdout)
        assert abs(float(whole) - step / 1_000_000) <= 0.02
        assert "the clock was set" in ran.stderr
        assert 190 <= max(r.cycle for r in seen) <= 210
        assert all(-ms(10) < r.planned - ms(10) * r.cycle < ms(10) for r in seen)


def test_the_exit_status_of_a_run_without_a_fault_is_0(calm):
    """Some run must be without a late job, whatever else the machine does."""
    assert 0 in (run(calm, "--degrade", "all", "--cycles", "2").returncode for _ in range(20))


def test_a_first_instant_that_is_past_is_a_coming_one_of_its_phase(calm):
    """As after a restart: no table is late, so that no health rule answers."""
    ran = run(calm, "--degrade", "all", "--clock", "realtime", "--cycles", "5", "--origin", "1003")
    assert "0 tables lost" in ran.stdout
    assert {r.cycle for r in recorded(calm)} == set(range(5))
    assert max(r.start - r.planned for r in recorded(calm)) < ms(1000)


def test_without_a_step_the_clock_is_left_alone(calm):
    bundle = calm
    ran = run(bundle, "--degrade", "all", "--clock", "realtime", "--cycles", "20")
    assert ran.returncode in (0, FAULTS)
    assert "clock" not in ran.stderr + ran.stdout


def test_memory_that_cannot_be_locked_for_stacks_is_given_up_if_allowed(calm):
    bundle = calm
    ran = run(bundle, "--degrade", "all", "--cycles", "5", shim=NO_LOCK)
    assert ran.returncode in (0, FAULTS), ran.stderr
    assert "degraded: RLIMIT_MEMLOCK has no room" in ran.stderr
    ran = run(bundle, "--degrade", "fifo", "--cycles", "5", shim=NO_LOCK)
    assert ran.returncode == 1
    assert "--degrade memory" in ran.stderr


def test_a_full_disk_ends_the_recording_and_not_the_run(calm):
    """A file may have 2 KiB: rows beyond it are counted, and the last one that is written is whole."""
    bundle = calm
    command = [str(bundle / "build" / "dispatcher"), "--record", str(bundle / "run.csv"), "--degrade", "all", *soon()]
    shell = 'ulimit -f 2; exec "$@"'
    ran = subprocess.run(
        ["sh", "-c", shell, "sh", *command, "--cycles", "60"], capture_output=True, text=True, check=False, timeout=60
    )
    assert ran.returncode == 1
    assert "the recording ends: File too large" in ran.stderr
    assert "120 jobs" in ran.stdout
    seen = recorded(bundle)
    assert len(seen) < 30
    assert f"{120 - len(seen)} not recorded" in ran.stdout


def test_a_recording_is_bounded_and_the_newest_part_stays(tmp_path, monkeypatch):
    bundle = built(tmp_path, monkeypatch)
    limits = (bundle / "runtime" / "main.c").read_text()
    short = limits.replace("number(value, 1, 1 << 20, name) << 20", "2048")  # instead of as many megabytes as stated
    assert short != limits
    (bundle / "runtime" / "main.c").write_text(short)
    make(bundle)
    ran = run(bundle, "--degrade", "all", "--cycles", "60", "--record-size", "1")
    assert ran.returncode in (0, FAULTS), ran.stderr
    for name in ("run.csv", "run.csv.1"):
        assert (bundle / name).read_text().startswith("task,job,mode,cycle,")
        assert (bundle / name).read_text().count("task,job") == 1
    now = recorded(bundle)
    former = read_recording((bundle / "run.csv.1").read_bytes())
    assert now[-1].cycle == 59
    assert former[0].cycle < now[0].cycle
    assert not {(r.task, r.cycle) for r in former} & {(r.task, r.cycle) for r in now}
    assert len(now) < 120


def test_cpus_that_are_not_there_are_named_in_the_host_of_another_program(calm):
    """The check is that of the dispatcher itself, which a container of ROS starts."""
    bundle = calm
    host = (
        '#include "dispatch.h"\n#include <stdio.h>\n#include <time.h>\nint main(void) {\n'
        "  int cpus[64]; for (int i = 0; i < 64; i++) cpus[i] = 999;\n"
        "  dispatch_options o = {.clock = CLOCK_MONOTONIC, .capacity = 10, .cpus = cpus};\n"
        '  const int error = dispatch_start(&o); printf("%d %s", error, dispatch_reason); return 0; }\n'
    )
    (bundle / "host.c").write_text(host)
    sources = ["host.c", "tables.c", "runtime/dispatch.c", "runtime/record.c"]
    command = ["cc", "-std=gnu11", "-Iruntime", "-o", "build/host", *sources, "-pthread", "-ldl"]
    subprocess.run(command, cwd=bundle, check=True, capture_output=True)
    ran = subprocess.run([str(bundle / "build/host")], capture_output=True, text=True, check=True)
    assert "unit u1 is CPU 999, which is not there" in ran.stdout
