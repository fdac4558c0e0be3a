"""What back-ends load, executed on models of their devices: it passes as exported, and no fault put into it does."""

import os
import re
import subprocess
from dataclasses import replace

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes
from halpipe.deploy.regulator.devices.axi_realm import RegisterFile
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from support import access, job, mode, model, schedule, task, version

PLATFORM = """halpipe-regulator: 1
name: sample
resource: mem
clock: 1MHz
bus: 128bit
burst: 64B
window: 1000
guaranteed: 6.4MB/s
capacity: 16MB/s
units:
  u1: {manager: 0, port: afifm2, core: 0, group: one}
  u2: {manager: 2, port: afifm3, core: 1, group: two}
  u3: {manager: 1, port: afifm4, core: 2, group: three}
"""
SETTINGS = {
    "axi-realm": "axi-realm: {pending: 1, base: 0x1000}",
    "qos400": "qos400: {clock: 2MHz}",
    "qos400-phase": "qos400: {clock: 2MHz, granularity: phase}",
    "memguard": "memguard: {cores: 4}",
    "memguard-phase": "memguard: {cores: 4, granularity: phase}",
    "resctrl": "resctrl: {others: 1 2}",
    "resctrl-mpam": "resctrl: {kind: mpam, width: 6}",
}


def system():
    """Two modes and their switches; u3 never uses the memory."""
    a = task("a", 10, version("v", 5, "u1", access("mem", 0, 5, "0.25", "read")))
    b = task("b", 5, version("v", 3, "u2", access("mem", 0, 3, "0.3", "read"), access("mem", 2, 3, "0.1", "write")))
    modes = (mode("fast", [a]), mode("slow", [b]))
    pairs = [("fast", "slow", None), ("slow", "fast", None)]
    m = model(a, b, units="u1 u2 u3", resources="mem", modes=modes, transitions=pairs)
    first = schedule(m, 10, job(m, "a", 0, 7, "u1"), mode_name="fast").modes[0]
    second = schedule(m, 5, job(m, "b", 0, 4, "u2"), mode_name="slow").modes[0]
    switches = (
        bundles.switch("fast", "slow", 1, 10, (job(m, "b", 0, 0, "u2"),)),
        bundles.switch("slow", "fast", 0, 5, ()),
    )
    return m, replace(schedule(m, 10), modes=(first, second), transitions=switches)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("devices")
    return {name: export(folder, name) for name in SETTINGS}


def export(folder, name):
    """The back-end of a form, and what it writes."""
    path = folder / f"{name}.yaml"
    path.write_text(PLATFORM + SETTINGS.get(name, "") + "\n")
    backend = name.removesuffix("-phase").removesuffix("-mpam")
    return backend, RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend=backend))


def ids(files):
    return {d.code for d in DEPLOYMENT.check(bundles.target(files), CheckOptions()).diagnostics if d.is_error}


@pytest.mark.parametrize("name", SETTINGS)
def test_what_is_exported_grants_what_is_promised(exported, name):
    backend, files = exported[name]
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
    assert checked.diagnostics == ()
    assert checked.lines[1].startswith(f"device: {backend} grants what is promised")


def faults(text):
    """Each line left out or doubled, and each number one more or one less."""
    lines = text.split("\n")
    for n, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith(("#", "/*", " *")):
            continue
        yield f"left out: {line}", lines[:n] + lines[n + 1 :]
        yield f"doubled: {line}", lines[: n + 1] + lines[n:]
        for match in re.finditer(r"\b(0x[0-9a-f]+|[0-9]+)\b", line.partition("/*")[0]):
            value = int(match[1], 0)
            for other in {value + 1, max(0, value - 1)} - {value}:
                shown = f"{other:#x}" if match[1].startswith("0x") else str(other)
                mutant = line[: match.start()] + shown + line[match.end() :]
                yield f"{match[1]} is {shown}: {line}", [*lines[:n], mutant, *lines[n + 1 :]]


@pytest.mark.parametrize("name", [n if n == "resctrl" else pytest.param(n, marks=pytest.mark.slow) for n in SETTINGS])
def test_nearly_every_fault_of_what_is_loaded_is_found(exported, name):
    """What survives has no effect: the way to a limit that is left out where nothing is in force above it."""
    backend, files = exported[name]
    caught, missed = 0, []
    for file in sorted(f for f in files if f.startswith(f"{backend}/")):
        for number, (what, lines) in enumerate(faults(files[file].decode())):
            if number % 3:
                continue
            if ids({**files, file: "\n".join(lines).encode()}):
                caught += 1
            else:
                missed.append(what)
    assert caught > 60
    assert len(missed) * 20 <= caught, missed


def changed(files, name, old, new, count=1):
    text = files[name].decode()
    assert old in text
    return {**files, name: text.replace(old, new, count).encode()}


@pytest.mark.parametrize(
    ("name", "file", "old", "new", "code"),
    [
        ("axi-realm", "setup.txt", "0x7fc 0x00000007\n", "", codes.DEVICE_REFUSES),
        ("axi-realm", "0-fast.txt", "0x00000640", "0x00000680", codes.GRANTS_DIFFER),
        ("axi-realm", "0-fast.txt", "0x00000640", "0x00010000", codes.DEVICE_OVER_CAPACITY),
        ("axi-realm", "axi_realm.h", "realm_entry_0,", "realm_entry_1,", codes.GRANTS_DIFFER),
        ("qos400", "0-fast.sh", "jailhouse qos", "jailhouse", codes.NOT_UNDERSTOOD),
        ("qos400", "0-fast.sh", "aw_r=1", "aw_r=0", codes.DEVICE_REFUSES),
        ("qos400", "0-fast.sh", "aw_r=1", "aw_r=900", codes.DEVICE_OVER_CAPACITY),
        ("memguard", "setup.sh", "g_period_us=1000", "g_period_us=500", codes.NOT_UNDERSTOOD),
        ("memguard", "0-fast.sh", "put read_limit '25 1 1 1'", "put read_limit '25 1 1'", codes.DEVICE_REFUSES),
        ("memguard", "0-fast.sh", "put read_limit '25 1 1 1'", "put read_limit '25 0 1 1'", codes.DEVICE_REFUSES),
        ("memguard", "0-fast.sh", "put read_limit '25 1 1 1'", "put read_limit '24 1 1 1'", codes.GRANTS_DIFFER),
        ("resctrl", "0-fast.sh", "put one 'MB:0=10;1=10", "put one 'MB:0=5;1=10", codes.DEVICE_REFUSES),
        ("resctrl", "0-fast.sh", "put one 'MB:0=10;1=10", "put one 'MB:0=10;1=20", codes.DEVICE_REFUSES),
        ("resctrl", "0-fast.sh", "put one 'MB:0=10;1=10", "put one 'MB:0=90;1=10", codes.DEVICE_OVER_CAPACITY),
        ("resctrl", "0-fast.sh", "mkdir -p one\n", "", codes.DEVICE_REFUSES),
        ("axi-realm", "load.sh", "0x7fc", "0x7f8", codes.NOT_UNDERSTOOD),
        ("axi-realm", "axi_realm.h", "#define REALM_GUARD 0x7fcu", "#define REALM_GUARD 0x124u", codes.GRANTS_DIFFER),
        ("axi-realm", "axi_realm.h", "return n + 1u;", "return 0u;", codes.NOT_UNDERSTOOD),
        ("qos400", "qos400.h", "? 0u : 1u", "? 0u : 0u", codes.NOT_UNDERSTOOD),
        ("memguard", "0-fast.sh", "exit 1", "exit 0", codes.NOT_UNDERSTOOD),
        ("resctrl", "0-fast.sh", 'last_cmd_status)" = ok', 'last_cmd_status)" != ok', codes.NOT_UNDERSTOOD),
    ],
)
def test_the_device_says_what_is_wrong(exported, name, file, old, new, code):
    backend, files = exported[name]
    assert code.id in ids(changed(files, f"{backend}/{file}", old, new))


@pytest.mark.parametrize("name", ["axi-realm", "qos400", "memguard", "resctrl"])
def test_scripts_of_another_schedule_or_of_none_are_found(exported, name):
    backend, files = exported[name]
    script = next(f for f in sorted(files) if f.startswith(f"{backend}/0-"))
    digest = re.search(rb"schedule ([0-9a-f]{64})", files[script])[1]
    other = {**files, script: files[script].replace(digest, b"0" * 64)}
    assert codes.OTHER_SCHEDULE.id in ids(other)
    assert codes.NOT_UNDERSTOOD.id in ids({f: data for f, data in files.items() if f != script})
    assert codes.NOT_UNDERSTOOD.id in ids({**files, f"{backend}/more.sh": b"# nobody asked for this\n"})


@pytest.mark.parametrize(("managers", "regions", "guard"), [(8, 2, 0x7FC), (16, 2, 0xFFC), (8, 8, 0x1FFC)])
def test_the_register_file_is_that_of_the_documentation(managers, regions, guard):
    file = RegisterFile(managers, regions)
    assert file.guard == guard
    if (managers, regions) == (8, 2):
        names = {name: offset for offset, name in file.names.items()}
        assert names["write budget", 0, 0] == 0x124
        assert names["read budget", 0, 0] == 0x164
        assert names["read period", 7, 1] == 0x220


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("memguard", "core: 1", "core: one"),
        ("qos400", "clock: 2MHz", "clock: fast"),
    ],
)
def test_a_platform_that_no_model_can_use_is_refused(exported, name, old, new):
    _, files = exported[name]
    with pytest.raises(HalpipeError) as refused:
        ids(changed(files, "platform.yaml", old, new))
    (found,) = refused.value.diagnostics
    assert (found.code, found.at.file) == (codes.UNUSABLE_TABLES.id, "cfg/platform.yaml")


DEVMEM = """#!/bin/sh
# Registers are files; the one called $STUCK keeps what it has.
at=$(printf %x "$(($1))")
if [ $# = 3 ]; then [ "$at" = "$STUCK" ] || echo "$3" > "$BOARD/$at"; else cat "$BOARD/$at"; fi
"""


@pytest.mark.skipif(os.name != "posix", reason="there is no sh")
@pytest.mark.parametrize(("name", "script"), [("axi-realm", "setup.txt"), ("axi-realm", "0-fast.txt")])
def test_what_is_loaded_is_read_back(exported, tmp_path, name, script):
    """The exported shell script runs, with registers that hold what is written, and with one that does not."""
    backend, files = exported[name]
    for file in ("load.sh", script):
        (tmp_path / file).write_bytes(files[f"{backend}/{file}"])
    (tmp_path / "devmem").write_text(DEVMEM)
    (tmp_path / "devmem").chmod(0o755)
    lines = [line.removeprefix("- ").split() for line in (tmp_path / script).read_text().splitlines()]
    written = [
        (int(a, 16) + 0x1000, int(b, 16)) for a, b in (line for line in lines if len(line) == 2 and line[0] != "#")
    ]
    assert len(written) > 3

    def load(stuck):
        board = tmp_path / f"board-{stuck}"
        board.mkdir()
        if stuck:
            (board / stuck).write_text("0x12345\n")
        environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "BOARD": str(board), "STUCK": stuck}
        command = ["sh", "load.sh", script]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        return done.returncode, done.stderr, board

    code, said, board = load("")
    assert (code, said) == (0, "")
    assert {int(path.name, 16): int(path.read_text(), 16) for path in board.iterdir()} == dict(written)
    at, value = written[-1]
    code, said, _ = load(f"{at:x}")
    assert code == 1
    assert f"register {at - 0x1000:#05x} is 0x12345, not {value:#010x}" in said


def test_memguard_by_phase_serves_phases_that_take_turns(tmp_path):
    """Each of two cores reads half of the time; together at once they are above the capacity."""
    path = tmp_path / "p.yaml"
    tight = (
        PLATFORM.replace("capacity: 16MB/s\n", "capacity: 10.5MB/s\n")
        + "memguard: {cores: 3, write-backs: 0, granularity: %s}\n"
    )
    a = task("a", 40, version("v", 10, "u1", access("mem", 0, 10, 1, "read")))
    b = task("b", 40, version("v", 10, "u2", access("mem", 0, 10, 1, "read")))
    m = model(a, b, units="u1 u2 u3", resources="mem")
    s = schedule(m, 40, job(m, "a", 0, 0, "u1"), job(m, "b", 0, 20, "u2"))
    path.write_text(tight % "mode")
    options = RegulatorOptions(platform=str(path), backend="memguard")
    with pytest.raises(HalpipeError) as refused:
        RegulatorExporter().write(m, s, options)
    assert "granularity: phase" in refused.value.diagnostics[0].help
    path.write_text(tight % "phase")
    files = RegulatorExporter().write(m, s, options)
    assert DEPLOYMENT.check(bundles.target(files), CheckOptions()).diagnostics == ()
    name = next(file for file in sorted(files) if file.startswith("memguard/0-"))
    script = files[name].decode()
    millis = [int(ns) // 10**6 for ns in re.findall(r"# from (\d+) ns on", script)]
    assert millis == [0, 10, 19, 30, 39]  # a period before the phases at 20 and at 40, so that each core has taken it
    late = {**files, name: script.replace("from 19000000 ns", "from 20000000 ns").encode()}
    assert codes.GRANTS_DIFFER.id in ids(late)
