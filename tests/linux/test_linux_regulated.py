"""Dispatcher and regulators with one time base: started at one instant, switched together, and refused by name."""

import os
import re
import subprocess
import time
from dataclasses import replace
from pathlib import Path

import pytest
from test_linux_bundle import check, needs_compiler, refused, sourced, two_modes, write

from halpipe.core.files import load_json
from halpipe.deploy.linux.judging import read_recording
from halpipe.exporters.linux.codes import NO_START
from halpipe.models import Resource
from support import access

STUB = Path(__file__).parent / "regulator_stub.h"
PLATFORM = """halpipe-regulator: 1
clock: 100MHz
bus: 64bit
burst: 64B
window: 100us
guaranteed: 100MB/s
capacity: 200MB/s
table: {timebase: 100MHz, drift: 1000}
units:
  u1: {manager: 0}
"""
WINDOW, LENGTH = 100_000, 10_000_000


def regulated():
    """Modes both and one of 10 ms, with a table of 5 ms on the way back, whose tasks read the memory."""
    owner, tables = two_modes()
    phase = access("memory", 0, 1, "1/2")
    phased = [replace(t, versions=tuple(replace(v, accesses=(phase,)) for v in t.versions)) for t in owner.tasks]
    tasks = [sourced(t, "both") for t in phased]
    return replace(owner, tasks=tuple(tasks), resources=(Resource(name="memory"),)), tables


def export(folder):
    (folder / "platform.yaml").write_text(PLATFORM)
    return write(folder, *regulated(), regulator=str(folder / "platform.yaml"))


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    """A built bundle: `mapped` reads a device, and in `dispatcher` the stub stands for the device."""
    made, _ = export(tmp_path_factory.mktemp("regulated"))
    command = ["make", "CFLAGS=-O0 -Werror"]
    subprocess.run(command, cwd=made, check=True, capture_output=True)
    (made / "build" / "dispatcher").rename(made / "build" / "mapped")
    header = made / "regulator" / "table" / "linux" / "bw_uio.h"
    text = re.sub(r"static (?:uint32_t bw_get|void bw_put)\(.*\n", "", header.read_text())
    header.write_text(text.replace("static volatile", f'#include "{STUB}"\nstatic volatile', 1))
    subprocess.run(command, cwd=made, check=True, capture_output=True)
    return made


def play(bundle, *options, device="/dev/zero", program="dispatcher", **environment):
    """Play with a first instant soon, of which the dispatcher keeps the phase; return it with what was said."""
    first = time.monotonic_ns() + 600_000_000
    command = [str(bundle / "build" / program), "--record", str(bundle / "run.csv"), "--origin", str(first)]
    command += ["--degrade", "fifo", "--degrade", "memory", "--degrade", "cpus", "--regulator", str(device), *options]
    log = bundle / "regulators.txt"
    log.write_text("")
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=60,
        env={**os.environ, "REGULATOR_LOG": str(log), **environment},
    )  # fmt: skip
    return first, done, [tuple(map(int, line.split())) for line in log.read_text().splitlines()]


@pytest.mark.slow
@needs_compiler
def test_the_regulators_begin_and_switch_with_the_tables_of_the_dispatcher(bundle):
    """Whenever the switches are made: each table of the unit begins with that of the jobs, within the stated bound."""
    first, done, begun = play(bundle, "--seconds", "0.6", "--switch", "0.05=one", "--switch", "0.2=both")
    assert done.returncode in (0, 3), done.stderr
    assert "regulators" not in done.stderr
    (bound,) = re.findall(r"^the first windows of the regulators begin within ([0-9.]+) us", done.stdout, re.MULTILINE)
    bound = round(float(bound) * 1000)
    assert bound < WINDOW
    origin = begun[0][1]
    offset = (origin - first + LENGTH // 2) % LENGTH - LENGTH // 2
    assert abs(offset) <= bound
    tables = load_json((bundle / "regulator" / "tables.json").read_bytes())["tables"]
    numbers = {table["name"]: table["index"] for table in tables}
    starts = {"a": 1_000_000, "b": 4_000_000}
    seen = {(r.table, r.planned.ns - starts[r.task]) for r in read_recording((bundle / "run.csv").read_bytes())}
    unit = {at - origin: number for number, at in begun}
    assert {name for name, _ in seen} >= {"both", "one", "one->both"}
    assert all(unit[at] == numbers[name] for name, at in seen)


@needs_compiler
@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ({"PPM": "2000"}, "another rate than timebase and drift"),
        ({"STUCK": "1"}, "time base of the regulators does not count"),
    ],
)
def test_clocks_that_are_not_as_stated_end_the_start(bundle, fault, said):
    _, done, begun = play(bundle, "--seconds", "0.1", **fault)
    assert (done.returncode, said in done.stderr, begun) == (1, True, [])
    assert (bundle / "run.csv").read_text().count("\n") == 1  # no job


@needs_compiler
@pytest.mark.parametrize("fault", [{"PPM": "900"}, {"LOST": "1"}])
def test_regulators_that_slip_or_do_not_switch_are_a_fault(bundle, fault):
    """900 us a second are more than a window within 0.3 s; a switch has no other table than that of the target."""
    _, done, _ = play(bundle, "--seconds", "0.3", "--switch", "0.05=one", **fault)
    assert (done.returncode, "the regulators do not play the table of the jobs" in done.stderr) == (3, True)


@needs_compiler
def test_a_device_that_does_not_answer_ends_the_start(bundle, tmp_path):
    device = tmp_path / "uio"
    for size, said in ((None, "No such file"), (0, "do not answer: bus error"), (2 << 20, "there is no regulator")):
        if size is not None:
            device.write_bytes(b"")
            os.truncate(device, size)
        _, done, _ = play(bundle, "--seconds", "0.1", device=device, program="mapped")
        assert (done.returncode, said in done.stderr) == (1, True)
    _, done, _ = play(bundle, "--cycles", "1", "--degrade", "regulator", device=device, program="mapped")
    assert (done.returncode in (0, 3), "degraded: there is no regulator" in done.stderr) == (True, True)


@needs_compiler
@pytest.mark.slow  # builds and plays
def test_a_check_of_the_bundle_checks_the_tables_too(tmp_path):
    owner, tables = regulated()
    written, _ = export(tmp_path)
    checked = check(written, owner, tables, cycles=2)
    assert any(line.startswith("regulators: arithmetic: exact; 3 tables of 1 units") for line in checked.lines)
    assert "name the UIO" not in checked.diagnostics[0].message
    assert "No such file or directory: /dev/uio0" in checked.diagnostics[0].message


@pytest.mark.parametrize(
    ("old", "new"),
    [("timebase: 100MHz, ", ""), ("table: ", "backend: axi-realm\ntable: ")],
)
def test_regulators_that_the_dispatcher_cannot_start_are_refused(tmp_path, old, new):
    (tmp_path / "platform.yaml").write_text(PLATFORM.replace(old, new))
    owner, tables = regulated()
    found = refused(tmp_path, owner, tables, regulator=str(tmp_path / "platform.yaml"), busy=1)
    assert found == [NO_START.id]
