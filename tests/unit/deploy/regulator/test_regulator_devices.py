"""What back-ends load, executed on models of their devices: it passes as exported, and no fault put into it does."""

import json
import os
import re
import subprocess
from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes, memguard
from halpipe.deploy.regulator.arithmetic import Arithmetic
from halpipe.deploy.regulator.axi_realm import _difference, _sums
from halpipe.deploy.regulator.loading import Case
from halpipe.deploy.regulator.memguard import Module
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.resctrl import FileSystem
from halpipe.devices.registers import RegisterFile, port_registers
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.exporters.regulator import codes as export_codes
from halpipe.exporters.regulator.report import findings_of
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


@pytest.mark.parametrize("name", ["table", *SETTINGS])
def test_a_phase_with_a_bound_of_0_is_promised_nothing(tmp_path, name):
    """Exporter and check agree on what is kept for its unit."""
    backend = name.removesuffix("-phase").removesuffix("-mpam")
    path = tmp_path / "platform.yaml"
    path.write_text(PLATFORM + SETTINGS.get(name, ""))
    phases = (access("mem", 0, 5, "0", "read"), access("mem", 0, 5, "0", "write"))
    a = task("a", 10, version("v", 5, "u1", *phases))
    b = task("b", 10, version("v", 5, "u2", access("mem", 0, 5, "0.3", "read")))
    m = model(a, b, units="u1 u2 u3", resources="mem", modes=[mode("m", [a, b])])
    s = schedule(m, 10, job(m, "a", 0, 0, "u1"), job(m, "b", 0, 0, "u2"), mode_name="m")
    files = RegulatorExporter().write(m, s, RegulatorOptions(platform=str(path), backend=backend))
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="arithmetic"))
    assert [str(d) for d in checked.diagnostics if d.is_error] == []


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
    shared = [(codes.SHARED_ISOLATION.id, 'unit "u2"')] if backend == "axi-realm" else []
    assert [(d.code, d.path) for d in checked.diagnostics] == shared
    assert checked.lines[1].startswith(f"device: {backend} grants what is promised")


def test_axi_realm_depends_on_how_its_managers_send(tmp_path):
    """Unit u2 reads and writes; short bursts may be refused unless the platform states that they are modifiable."""
    for told, said in (
        ("any", "; if all short bursts are modifiable)"),
        ("modifiable", "only to units that do not read"),
    ):
        text = PLATFORM + f"axi-realm: {{pending: 1, bursts: {told}}}\n"
        path = tmp_path / "p.yaml"
        path.write_text(text)
        files = RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend="axi-realm"))
        warned = {d.code for d in findings_of(files["report.json"])}
        assert (export_codes.SHORT_BURSTS.id in warned) == (told == "any")
        assert export_codes.BINDS_BOTH.id in warned
        assert said in DEPLOYMENT.check(bundles.target(files), CheckOptions()).lines[1]


def faults(text):
    """Each line left out or doubled, and each number one more or one less."""
    lines = text.split("\n")
    for n, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith(("#", "//")):
            continue
        yield f"left out: {line}", lines[:n] + lines[n + 1 :]
        yield f"doubled: {line}", lines[: n + 1] + lines[n:]
        for match in re.finditer(r"\b(0x[0-9a-f]+|[0-9]+)\b", line.partition("/*")[0]):
            value = int(match[1], 0)
            for other in {value + 1, max(0, value - 1)} - {value}:
                shown = f"{other:#x}" if match[1].startswith("0x") else str(other)
                mutant = line[: match.start()] + shown + line[match.end() :]
                yield f"{match[1]} is {shown}: {line}", [*lines[:n], mutant, *lines[n + 1 :]]


@pytest.mark.slow
@pytest.mark.parametrize("name", SETTINGS)
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


@pytest.mark.parametrize("name", SETTINGS)
def test_some_faults_of_what_is_loaded_are_found(exported, name):
    """A sample of those above, which is quick."""
    backend, files = exported[name]
    every = [
        (file, lines)
        for file in sorted(f for f in files if f.startswith(f"{backend}/"))
        for _, lines in faults(files[file].decode())
    ]
    sample = every[:: len(every) // 30]
    found = [bool(ids({**files, file: "\n".join(lines).encode()})) for file, lines in sample]
    assert found.count(True) * 20 >= 19 * len(found)


@pytest.mark.parametrize("name", ["axi-realm", "qos400", "memguard", "resctrl"])
def test_every_step_of_what_is_loaded_is_counted(exported, name):
    """Reads and writes of registers, and lines that set a limit."""
    backend, files = exported[name]
    pattern = r"^(?:READ|WRITE)\(|^put [\w.]+ '|^mkdir -p \w+$"
    loaded = [files[f].decode() for f in files if f.startswith(f"{backend}/") and f.endswith((".txt", ".sh"))]
    steps = sum(len(re.findall(pattern, text, re.MULTILINE)) for text in loaded)
    line = DEPLOYMENT.check(bundles.target(files), CheckOptions()).lines[1]
    assert f"{steps} " in line, line


def changed(files, name, old, new, count=1):
    text = files[name].decode()
    assert old in text
    return {**files, name: text.replace(old, new, count).encode()}


@pytest.mark.parametrize(
    ("name", "file", "old", "new", "code"),
    [
        ("axi-realm", "setup.txt", "WRITE(-1, 0x7fc, 0x00000007)\n", "", codes.DEVICE_REFUSES),
        ("axi-realm", "setup.txt", "READ(0x32c", "READ(0x00c", codes.DEVICE_REFUSES),
        (
            "axi-realm",
            "setup.txt",
            "WRITE(-1, 0x01c",
            "READ(0x224, 0xffffffff, 0x00000000, 0x00000010)\nWRITE(-1, 0x01c",
            codes.DEVICE_REFUSES,
        ),
        ("axi-realm", "setup.txt", "0x00000080, 0x00000080", "0x00000040, 0x00000040", codes.GRANTS_DIFFER),
        ("axi-realm", "setup.txt", "0xfffffffe", "0xffffffff", codes.GRANTS_DIFFER),
        ("axi-realm", "0-fast.txt", "0x00000640", "0x00000680", codes.GRANTS_DIFFER),
        ("axi-realm", "0-fast.txt", "0x00000640", "0x00010000", codes.DEVICE_OVER_CAPACITY),
        ("axi-realm", "0-fast.txt", "WRITE(-1", "READ(0x1, 0x1, 0x1, 0x1)\nWRITE(-1", codes.DEVICE_REFUSES),
        ("axi-realm", "0-fast.txt", "WRITE(-1, ", "WRITE(5, 0x124, 0x40)\nWRITE(-1, ", codes.DEVICE_REFUSES),
        ("axi-realm", "0-fast.txt", "WRITE(-1, ", "WRITE ", codes.NOT_UNDERSTOOD),
        ("qos400", "setup.txt", "WRITE(-1, 0xfd74711c, 0x00000001)\n", "", codes.DEVICE_REFUSES),
        ("qos400", "setup.txt", "0x00000003)\nREAD", "0x00000001)\nREAD", codes.GRANTS_DIFFER),
        ("qos400", "setup.txt", "READ(0xfd74711c, 0xffffffff", "READ(0xfd74711c, 0x0000ffff", codes.GRANTS_DIFFER),
        ("qos400", "0-fast.txt", "0xfd747120, 0x00100000", "0xfd747120, 0x00000000", codes.DEVICE_REFUSES),
        ("qos400", "0-fast.txt", "0xfd747120, 0x00100000", "0xfd747120, 0x00100001", codes.DEVICE_REFUSES),
        ("qos400", "0-fast.txt", "0xfd747120, 0x00100000", "0xfd747120, 0x38400000", codes.DEVICE_OVER_CAPACITY),
        ("qos400", "0-fast.txt", "0xfd747120", "0xfd74711c", codes.DEVICE_REFUSES),
        ("qos400", "0-fast.txt", "0xfd747120", "0xfd000120", codes.DEVICE_REFUSES),
        ("qos400", "0-fast.txt", "READ(0xfd747120, 0xffffffff, 0x00100000, 0x00100000)\n", "", codes.GRANTS_DIFFER),
        ("memguard", "setup.sh", "g_period_us=1000", "g_period_us=500", codes.NOT_UNDERSTOOD),
        ("memguard", "setup.sh", "g_period_us=1000", "g_period_us=4096", codes.NOT_UNDERSTOOD),
        ("memguard", "0-fast.sh", "put read_limit '25 1 1 1'", "put read_limit '25 1 1'", codes.DEVICE_REFUSES),
        ("memguard", "0-fast.sh", "put read_limit '25 1 1 1'", "put read_limit '25 0 1 1'", codes.DEVICE_REFUSES),
        ("memguard", "0-fast.sh", "put read_limit '25 1 1 1'", "put read_limit '24 1 1 1'", codes.GRANTS_DIFFER),
        ("resctrl", "0-fast.sh", "put one 'MB:0=10;1=10", "put one 'MB:0=5;1=10", codes.DEVICE_REFUSES),
        ("resctrl", "0-fast.sh", "put one 'MB:0=10;1=10", "put one 'MB:0=10;1=20", codes.DEVICE_REFUSES),
        ("resctrl", "0-fast.sh", "put one 'MB:0=10;1=10", "put one 'MB:0=90;1=10", codes.DEVICE_OVER_CAPACITY),
        ("resctrl", "0-fast.sh", "mkdir -p one\n", "", codes.DEVICE_REFUSES),
        ("axi-realm", "load.sh", "exit 1", "exit 0", codes.NOT_UNDERSTOOD),
        ("qos400", "load.sh", "0x0 + b", "0x4 + b", codes.NOT_UNDERSTOOD),
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
    lacking = bundles.target({f: data for f, data in files.items() if f != script})
    found = [d for d in DEPLOYMENT.check(lacking, CheckOptions()).diagnostics if d.code == codes.NOT_UNDERSTOOD.id]
    assert [d.at.line for d in found] == [0]
    beyond = script.replace("/0-", f"/{len(json.loads(files['tables.json'])['tables'])}-")
    assert codes.NOT_UNDERSTOOD.id in ids({**files, beyond: files[script]})
    assert codes.NOT_UNDERSTOOD.id in ids({**files, f"{backend}/more.sh": b"# nobody asked for this\n"})


def messages(files):
    return [d.message for d in DEPLOYMENT.check(bundles.target(files), CheckOptions()).diagnostics]


@pytest.mark.parametrize(
    ("name", "file", "old", "new", "said"),
    [
        (
            "qos400",
            "0-fast.txt",
            "0x03400000",
            "0x03300000",
            "u1 read: 1593750 B/s are granted, promised are 1600000 B/s, for which 1625000 B/s are the least",
        ),
        (
            "memguard",
            "0-fast.sh",
            "put read_limit '25",
            "put read_limit '24",
            "u1 read: 24 lines a period, the promise takes 25",
        ),
        (
            "resctrl",
            "0-fast.sh",
            "put one 'MB:0=10;1=10;2=10' 'MB:0=10;",
            "put one 'MB:0=20;1=10;2=10' 'MB:0=20;",
            "u1: 3200000 B/s are granted, promised are 1600000 B/s, for which 1600000 B/s are the least",
        ),
        (
            "axi-realm",
            "setup.txt",
            "WRITE(-1, 0x014, 0x03030303)\n",
            "",
            "the len_limit register 0 is not written after the set-up, it must be 0x3030303",
        ),
        (
            "axi-realm",
            "setup.txt",
            "WRITE(-1, 0x024, 0x00000000)\n",
            "",
            "the start_low of manager 0, region 0 is not written after the set-up, it must be 0x0",
        ),
        (
            "axi-realm",
            "setup.txt",
            "0x00001400",
            "0x00001401",
            "the read_budget of manager 0, region 0 is 0x1401 after the set-up, it must be 0x1400",
        ),
    ],
)
def test_what_the_device_does_instead_is_stated_in_its_own_terms(exported, name, file, old, new, said):
    files = exported[name][1]
    assert said in messages(changed(files, f"{name}/{file}", old, new, -1 if name == "qos400" else 1))


@pytest.mark.parametrize(
    ("name", "file", "after"),
    [
        ("axi-realm", "0-fast.txt", "c6a11b03fc68\n"),
        ("axi-realm", "load.sh", "set -e\n"),
        ("axi-realm", "load.sh", "done\n"),
        ("memguard", "0-fast.sh", "put write_limit '25 1 1 1'\n"),
        ("memguard-phase", "0-fast.sh", "  ;;\n"),
        ("resctrl", "0-fast.sh", "mkdir -p three\n"),
    ],
)
def test_of_a_line_that_is_not_understood_60_characters_are_quoted(exported, name, file, after):
    backend, files = exported[name]
    found = messages(changed(files, f"{backend}/{file}", after, after + "y" * 70 + "\n"))
    quoted = [text for text in found if f'"{"y" * 60}"' in text]
    assert len(quoted) == 1, found


@pytest.mark.parametrize(
    ("old", "new"), [("  ;;\n*)", "*)"), ("esac\n", "esac \ntrue\n"), ("usage: $0 0..2", "usage: $0 0..3")]
)
def test_a_script_of_settings_ends_with_the_last_of_them_and_its_usage(exported, old, new):
    files = exported["memguard-phase"][1]
    assert "does not end as documented" in messages(changed(files, "memguard/0-fast.sh", old, new))


def test_of_a_line_that_is_missing_60_characters_are_quoted(exported):
    files = exported["memguard"][1]
    line = files["memguard/setup.sh"].decode().split("set -e\n")[1].partition("\n")[0]
    assert len(line) > 70
    said = messages(changed(files, "memguard/setup.sh", "set -e\n", "set -e\ny\n"))
    assert f'is "y", expected "{line[:60]}"' in said


def test_of_a_domain_that_there_is_not_40_characters_are_quoted(exported):
    files = exported["resctrl"][1]
    found = messages(changed(files, "resctrl/0-fast.sh", "put one 'MB:0=10", f"put one 'MB:{'7' * 50}=10"))
    assert f'"{"7" * 40}": there is no such domain or value' in found


def test_of_many_instants_the_first_five_are_named(exported):
    files = exported["qos400-phase"][1]
    more = "".join(f"WRITE({8_000_000 + n}, 0xfd74712c, 0x0{3 + n % 2}300000)\n" for n in range(4))
    script = files["qos400/0-fast.txt"].decode() + more
    (said,) = messages({**files, "qos400/0-fast.txt": script.encode()})
    five = "[0, 2000000, 7000000, 8000000, 8000001]"
    assert said == f"rates are set at {five} ns, promised are changes at [0, 2000000, 7000000]"


def test_a_register_that_is_read_otherwise_is_found_in_its_line_and_one_that_is_not_in_the_file(exported):
    files = exported["axi-realm"][1]
    script = files["axi-realm/setup.txt"].decode()
    read = "READ(0x334, 0xffffffff, 0x00000080, 0x00000080)\n"
    number = script.split(read)[0].count("\n") + 1
    for new, line, said in (
        (
            read.replace("080)", "081)"),
            number,
            "data_width 0 is compared with 0x80 to 0x81, it must be from 0x80 to 0x80",
        ),
        ("", 0, "data_width 0 is not read, it must be from 0x80 to 0x80"),
    ):
        other = bundles.target(changed(files, "axi-realm/setup.txt", read, new))
        found = [d for d in DEPLOYMENT.check(other, CheckOptions()).diagnostics if d.is_error]
        assert [(d.message, d.at.line) for d in found] == [(said, line)]


@pytest.mark.parametrize(("cycles", "bits"), [(1024, 10), (1025, 11)])
def test_an_axi_realm_must_count_to_the_last_cycle_of_a_window(tmp_path, cycles, bits):
    path = tmp_path / "platform.yaml"
    text = PLATFORM.replace("clock: 1MHz", f"clock: {cycles}kHz").replace("window: 1000", f"window: {cycles}")
    path.write_text(text + "axi-realm: {pending: 1}\n")
    files = RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend="axi-realm"))
    assert ids(files) == set()
    narrow = changed(files, "axi-realm/setup.txt", f"0x{bits:08x}, 0xffffffff)", f"0x{bits - 1:08x}, 0xffffffff)")
    assert any(f"period_width 0 is compared with {bits - 1:#x} " in text for text in messages(narrow))


@pytest.mark.parametrize(("limit", "windows"), [(1, [1, 1, 2, 1]), (2, [])])
def test_writes_of_axi_realm_in_one_window_are_counted(exported, limit, windows):
    """Those before a table are not: the managers wait for it."""
    files = changed(exported["axi-realm"][1], "platform.yaml", "pending: 1", f"pending: 1, writes-per-window: {limit}")
    found = [text for text in messages(files) if "writes in window" in text]
    assert found == [f"2 writes in window {window}" for window in windows]
    first = changed(
        files, "axi-realm/0-fast.txt", "WRITE(1, ", "WRITE(0, 0x124, 0x80)\nWRITE(0, 0x134, 0x80)\nWRITE(1, "
    )
    assert ("2 writes in window 0" in messages(first)) == (limit == 1)


@pytest.mark.parametrize(("capacity", "is_noted"), [(13_056_000, False), (13_055_999, True)])
def test_memguard_by_phase_adds_both_settings_until_every_core_has_the_next(tmp_path, capacity, is_noted):
    """Two cores read 100 lines a period each, a period apart; 4 other limits are 1. A line has 64 B, a period 1 ms."""
    path = tmp_path / "p.yaml"
    path.write_text(PLATFORM + "memguard: {cores: 3, write-backs: 0, write-refills: 0, granularity: phase}\n")
    a = task("a", 40, version("v", 10, "u1", access("mem", 0, 10, 1, "read")))
    b = task("b", 40, version("v", 10, "u2", access("mem", 0, 10, 1, "read")))
    m = model(a, b, units="u1 u2 u3", resources="mem")
    s = schedule(m, 40, job(m, "a", 0, 0, "u1"), job(m, "b", 0, 11, "u2"))
    target = bundles.target(RegulatorExporter().write(m, s, RegulatorOptions(platform=str(path), backend="memguard")))
    tables = read_tables(target.bundle)
    tables = replace(tables, platform=replace(tables.platform, capacity=Fraction(capacity)))
    arithmetic = Arithmetic(target, tables)
    list(arithmetic.findings())
    case = Case(target.bundle, tables, arithmetic.planned)
    memguard.execute(case)
    said = [d.message for d in case.findings if " while one setting follows the other" in d.message]
    text = f"13056000 B/s are granted together while one setting follows the other, there is room for {capacity} B/s"
    assert said == [text] * is_noted


def test_a_period_of_axi_realm_is_written_after_its_budget(exported):
    """It loads the budget: one that is written later counts from the next period on."""
    files = exported["axi-realm"][1]
    lines = files["axi-realm/setup.txt"].decode().splitlines()
    guard, *writes = [number for number, line in enumerate(lines) if line.startswith("WRITE(")]
    backwards = dict(zip(writes, reversed(writes), strict=True))
    turned = "\n".join(lines[backwards.get(number, number)] for number in range(len(lines))) + "\n"
    assert lines[guard].startswith("WRITE(-1, 0x7fc")
    assert any(
        "is written before its budget" in text for text in messages({**files, "axi-realm/setup.txt": turned.encode()})
    )


def test_a_value_of_resctrl_that_is_written_twice_changes_nothing(exported):
    files = exported["resctrl"][1]
    line = re.search(r"^put one .*\n", files["resctrl/0-fast.sh"].decode(), re.MULTILINE)[0]
    assert "changes nothing" not in messages(files)
    assert "changes nothing" in messages(changed(files, "resctrl/0-fast.sh", line, line + line))


def test_a_default_of_a_unit_without_phases_has_its_overshoot_kept(tmp_path):
    path = tmp_path / "platform.yaml"
    path.write_text(PLATFORM.replace("group: three", "group: three, default-read: 64B") + "overshoot: 64B\n")
    files = RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend="table"))
    assert json.loads(files["tables.json"])["units"][2]["overshoot"] == {"read": 64, "write": 0}
    assert ids(files) == set()


@pytest.mark.parametrize(("width", "least", "step"), [(1, 50, 50), (3, 13, 13), (6, 2, 2), (8, 0, 1)])
def test_percentages_of_mpam_are_those_of_the_width_of_its_field(width, least, step):
    settings = {"kind": "mpam", "width": width, "min": "", "step": "", "max": "", "levels": "", "domain": "0"}
    platform = SimpleNamespace(settings={"resctrl": settings | {"others": ""}}, capacity=1, peak=None)
    found = FileSystem(SimpleNamespace(platform=platform))
    assert (found.least, found.step) == (least, step)


@pytest.mark.parametrize(("kind", "least", "step", "most"), [("intel", 10, 10, 100), ("amd", 0, 1, 2048)])
def test_values_of_kernels_that_state_nothing_are_those_of_their_kind(kind, least, step, most):
    settings = dict.fromkeys(("min", "step", "max", "levels", "others"), "") | {
        "kind": kind,
        "width": "8",
        "domain": "0",
    }
    platform = SimpleNamespace(settings={"resctrl": settings}, capacity=1, peak=None)
    found = FileSystem(SimpleNamespace(platform=platform))
    assert (found.least, found.step, found.most) == (least, step, most)
    assert found.rate(8) == (10**9 if kind == "amd" else Fraction(8, 100))  # AMD counts eighths of a GB/s
    assert found.write(".", f"0={most}") == ""
    assert found.write(".", f"0={most + 1}") == f"{most + 1} is out of range, {least} to {most}"


def test_without_a_simulator_the_tables_are_checked_and_it_says_so(exported, monkeypatch, tmp_path):
    monkeypatch.setattr("halpipe.deploy.regulator.simulate.choose_engine", lambda name: (None, "no simulator"))
    path = tmp_path / "platform.yaml"
    path.write_text(PLATFORM)
    files = RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend="table"))
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
    assert checked.diagnostics == ()
    assert "no simulator" in checked.lines


@pytest.mark.parametrize(("managers", "regions", "guard"), [(8, 2, 0x7FC), (16, 2, 0xFFC), (8, 8, 0x1FFC)])
def test_the_register_file_is_that_of_the_documentation(managers, regions, guard):
    file = RegisterFile("axi_realm", managers, regions)
    assert file.claim.offset == guard
    if (managers, regions) == (8, 2):
        known = {"rt_enable": 0x0C, "rt_bypassed": 0x10, "len_limit": 0x14, "imtu_enable": 0x1C, "start_low": 0x24}
        known |= {
            "end_high": 0xE4,
            "write_budget": 0x124,
            "read_budget": 0x164,
            "isolate": 0x324,
            "num_managers": 0x32C,
        }
        assert {name: file.offset(name) for name in known} == known
        assert file.offset("read_period", 15) == 0x220
        assert file.offset("len_limit", 7) == 0x18
        readable = {word.name for word in file.words.values() if word.access != "wo"}
        assert {"guard", "rt_bypassed", "num_managers", "num_addr_regions", "read_budget_left"} <= readable
        written = {word.name for word in file.words.values() if word.access != "ro"}
        assert readable & written == {"guard"}


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
# Registers are files, from 0x1000 on; those listed in $BOARD/wo read as 0, all others keep what they have.
at=$(printf %x "$(($1 - 0x1000))")
if [ $# = 3 ]; then echo "$at $3" >> "$BOARD/log"; grep -qx "$at" "$BOARD/wo" || exit 0
elif grep -qx "$at" "$BOARD/wo"; then echo 0x0; else cat "$BOARD/$at"; fi
"""


def board(folder, exported, name, **changes):
    """An AXI-REALM of 8 managers and 2 regions, with its access kinds, after its set-up; returns what was loaded."""
    file = RegisterFile("axi_realm", 8, 2)
    folder.mkdir()
    (folder / "wo").write_text("".join(f"{o:x}\n" for o, word in file.words.items() if word.access == "wo"))
    values = {"num_managers": 8, "num_addr_regions": 2, "data_width": 128, "period_width": 32, "budget_width": 32}
    for word in file.words.values():
        value = {"rt_bypassed": 0xF8, "read_period_left": 999, "write_period_left": 5}.get(word.name, 0)
        value = changes.get(word.name, values.get(word.name, value))
        (folder / f"{word.offset:x}").write_text(f"{value:#x}\n")
    _, files = exported["axi-realm"]
    setup = re.findall(r"WRITE\(-1, (0x\w+), (0x\w+)\)", files["axi-realm/setup.txt"].decode())
    budgets = {int(offset, 16): value for offset, value in setup}
    for direction in ("read", "write") if "stopped" not in changes else ():
        for field in range(16):
            left, at = file.offset(f"{direction}_budget_left", field), file.offset(f"{direction}_budget", field)
            (folder / f"{left:x}").write_text(budgets.get(at, "0x0") + "\n")
    for script in ("load.sh", name):
        (folder / script).write_bytes(files[f"axi-realm/{script}"])
    (folder / "devmem").write_text(DEVMEM)
    (folder / "devmem").chmod(0o755)
    environment = {"PATH": f"{folder}:{os.environ['PATH']}", "BOARD": str(folder)}
    command = ["sh", "load.sh", name]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    log = (folder / "log").read_text().split() if (folder / "log").exists() else []
    written = [(int(a, 16), int(b, 16)) for a, b in zip(log[::2], log[1::2], strict=True)]
    return done.returncode, done.stderr, written, setup


posix = pytest.mark.skipif(os.name != "posix", reason="there is no sh")


@posix
def test_axi_realm_is_loaded_although_its_registers_are_write_only(exported, tmp_path):
    code, said, written, setup = board(tmp_path / "a", exported, "setup.txt")
    assert (code, said) == (0, "")
    assert written == [(int(a, 16), int(b, 16)) for a, b in setup]
    code, said, written, _ = board(tmp_path / "b", exported, "0-fast.txt")
    assert (code, said) == (0, "")
    assert len(written) == 4  # two units, both directions; the others are for the handler


@posix
@pytest.mark.parametrize(
    ("changes", "said", "count"),
    [
        ({"num_managers": 6}, "setup.txt: register 0x32c is 6, not from 8 to 8", 1),
        ({"num_addr_regions": 1}, "is 1, not from 2 to 2", 1),
        ({"data_width": 64}, "is 64, not from 128 to 128", 1),
        ({"period_width": 8}, "is 8, not from 10 to", 1),
        ({"rt_bypassed": 0xFF}, "register 0x010 is 7, not from 0 to 0", 0),
        ({"read_period_left": 1000}, "is 1000, not from 0 to 999", 0),
        ({"stopped": True}, "is 0, not from 1 to", 0),
    ],
)
def test_another_axi_realm_is_refused_with_figures(exported, tmp_path, changes, said, count):
    """One that is built otherwise before anything but the claim is written."""
    code, told, written, _ = board(tmp_path / "a", exported, "setup.txt", **changes)
    assert code == 1
    assert said in told
    assert not count or written == [(0x7FC, 7)]


MODULE = {
    "nproc": "echo 4",
    "insmod": 'echo "$@" >> loaded',
    "grep": """number=0
for events in $(cat "$3"); do
  if [ "$number" != "$DEAF" ]; then echo "CPU$number: $events (1MB/s)"; else echo "CPU$number: 7 (1MB/s)"; fi
  number=$((number + 1))
done | /bin/grep -q "$2\"""",
}
"""MemGuard as a folder: a limit is a line of events, and is shown for each core with its bandwidth."""


@posix
@pytest.mark.parametrize("name", ["memguard", "memguard-phase"])
def test_memguard_is_loaded_and_read_back(exported, tmp_path, name):
    _, files = exported[name]
    for stub, text in MODULE.items():
        (tmp_path / stub).write_text(f"#!/bin/sh\n{text}\n")
        (tmp_path / stub).chmod(0o755)
    for script in ("setup.sh", "0-fast.sh"):
        text = files[f"memguard/{script}"].decode().replace("/sys/kernel/debug/memguard", str(tmp_path))
        (tmp_path / script).write_text(text)
    arguments = {"setup.sh": [], "0-fast.sh": ["0"] * (name != "memguard")}
    for deaf, expected in (("", 0), ("2", 1)):
        for script, more in arguments.items():
            environment = {"PATH": f"{tmp_path}:{os.environ['PATH']}", "DEAF": deaf}
            command = ["sh", script, *more]
            done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
            assert (done.returncode, bool(done.stderr)) == (expected, bool(expected)), done.stderr
    assert (tmp_path / "loaded").read_text().split()[:2] == ["memguard.ko", "g_period_us=1000"]
    assert len((tmp_path / "read_limit").read_text().split()) == 4


def test_memguard_by_phase_serves_phases_that_take_turns(tmp_path):
    """Each of two cores reads half of the time; together at once they are above the capacity."""
    path = tmp_path / "p.yaml"
    tight = (
        PLATFORM.replace("capacity: 16MB/s\n", "capacity: 10.5MB/s\n")
        + "memguard: {cores: 3, write-backs: 0, write-refills: 0, granularity: %s}\n"
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


def test_overshoot_is_kept_per_window_where_the_clock_does_not_divide_it(tmp_path):
    """Exporter and check take it from the exact window, not from the shorter one of whole cycles."""
    path = tmp_path / "memguard.yaml"
    text = PLATFORM.replace("clock: 1MHz", "clock: 1000999Hz").replace("window: 1000", "window: 1ms")
    text = text.replace("6.4MB/s", "3.2MB/s")
    path.write_text(text + "overshoot: 1000B\nmemguard: {cores: 4, period: 1s}\n")
    files = RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend="memguard"))
    assert DEPLOYMENT.check(bundles.target(files), CheckOptions()).diagnostics == ()


@pytest.mark.parametrize(("bound", "instants"), [("0.2501", [1, 6]), ("0.5", [1, 3, 6])])
def test_bounds_below_a_step_of_the_regulator_change_no_setting(tmp_path, bound, instants):
    """Phases whose bounds differ by less than a step of QoS-400: one setting, and no instant without a write."""
    t = task("t", 10, version("v", 5, "u1", access("mem", 0, 2, "0.25", "read"), access("mem", 2, 5, bound, "read")))
    m = model(t, units="u1", resources="mem", modes=(mode("m", [t]),))
    path = tmp_path / "qos.yaml"
    path.write_text(PLATFORM[: PLATFORM.index("  u2")] + "qos400: {clock: 2MHz, granularity: phase}\n")
    files = RegulatorExporter().write(
        m,
        schedule(m, 10, job(m, "t", 0, 1, "u1"), mode_name="m"),
        RegulatorOptions(platform=str(path), backend="qos400"),
    )
    (script,) = (files[name].decode() for name in files if name.startswith("qos400/0-"))
    assert re.findall(r"WRITE\((\d+), ", script) == [str(n * 10**6) for n in instants]
    assert DEPLOYMENT.check(bundles.target(files), CheckOptions()).diagnostics == ()


def test_a_back_end_that_there_is_not_makes_tables_unusable(exported):
    files = bundles.changed(exported["memguard"][1], lambda data: data.update(backend="x" * 5000))
    with pytest.raises(HalpipeError) as refused:
        DEPLOYMENT.check(bundles.target(files), CheckOptions())
    assert refused.value.diagnostics[0].code == codes.UNUSABLE_TABLES.id


def test_the_least_part_of_mpam_is_the_same_for_exporter_and_check(tmp_path):
    """With a step that does not divide 100 the largest percentage wraps in the field of MPAM: a small part."""
    path = tmp_path / "mpam.yaml"
    path.write_text(PLATFORM + "resctrl: {kind: mpam, others: 7, width: 10, min: 3, step: 7}\n")
    files = RegulatorExporter().write(*system(), RegulatorOptions(platform=str(path), backend="resctrl"))
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
    assert not any(d.is_error for d in checked.diagnostics)


def test_rates_of_one_port_that_fall_and_rise_are_written_one_by_one(tmp_path):
    """A single unit whose reads fall and whose writes rise, and back."""
    phases = {"one": ("0.25", "0.1"), "two": ("0.1", "0.25")}
    tasks = [
        task(name, 10, version("v", 5, "u1", access("mem", 0, 5, read, "read"), access("mem", 0, 5, write, "write")))
        for name, (read, write) in phases.items()
    ]
    modes = [mode(name, [t]) for name, t in zip(("a", "b"), tasks, strict=True)]
    m = model(*tasks, units="u1", resources="mem", modes=modes, transitions=[("a", "b", None), ("b", "a", None)])
    found = [
        schedule(m, 10, job(m, t.name, 0, 0, "u1"), mode_name=x).modes[0] for x, t in zip("ab", tasks, strict=True)
    ]
    switches = (bundles.switch("a", "b", 0, 10, ()), bundles.switch("b", "a", 0, 10, ()))
    path = tmp_path / "qos.yaml"
    path.write_text(PLATFORM[: PLATFORM.index("  u2")] + "qos400: {clock: 2MHz}\n")
    whole = replace(schedule(m, 10), modes=tuple(found), transitions=switches)
    files = RegulatorExporter().write(m, whole, RegulatorOptions(platform=str(path), backend="qos400"))
    assert DEPLOYMENT.check(bundles.target(files), CheckOptions()).diagnostics == ()


def module(cores=0, period="1ms"):
    """MemGuard of units on the cores 0 and 2, of a machine of so many cores (0: as many as the units need)."""
    units = {"u1": {"core": "0"}, "u2": {"core": "2"}, "dma": {"core": None}}
    settings = {"line": "64B", "write-refills": "1", "write-backs": "1/2", "period": period}
    platform = SimpleNamespace(
        number=lambda *_: cores, units=units, settings={"memguard": settings}, window_ns=Fraction(2_000_000)
    )
    tables = SimpleNamespace(units=[SimpleNamespace(name=name) for name in units])
    return Module(SimpleNamespace(platform=platform, tables=tables))


@pytest.mark.parametrize(("stated", "cores"), [(0, 3), (3, 3), (8, 8)])
def test_memguard_has_the_cores_that_are_stated_or_those_up_to_the_last_unit(stated, cores):
    """Cores that no unit has get limits, too, under their number."""
    device = module(stated)
    assert device.write("read", " ".join(["7"] * cores)) == ""
    owners = {0: "u1 read", 2: "u2 read"}
    assert device.limits == {owners.get(core, f"core {core} read"): 7 for core in range(cores)}


@pytest.mark.parametrize(
    ("period", "said"),
    [
        ("999us", "999 us are no period"),
        ("1000us", None),
        ("2000500ns", "4001/2 us are no period"),
        ("1s", None),
        ("1000001us", "1000001 us are no period"),
    ],
)
def test_a_period_of_memguard_has_whole_microseconds_from_a_millisecond_to_a_second(exported, period, said):
    files = changed(exported["memguard"][1], "platform.yaml", "cores: 4", f"cores: 4, period: {period}")
    assert [text for text in messages(files) if "no period" in text] == [said] * (said is not None)


def test_memguard_of_units_without_a_core_has_none():
    settings = {"line": "64B", "write-refills": "1", "write-backs": "1/2", "period": ""}
    platform = SimpleNamespace(
        number=lambda *_: 0, units={"dma": {}}, settings={"memguard": settings}, window_ns=Fraction(10**6)
    )
    tables = SimpleNamespace(units=[SimpleNamespace(name="dma")])
    assert Module(SimpleNamespace(platform=platform, tables=tables)).cores == 0


@pytest.mark.parametrize(
    ("text", "refused"),
    [
        ("1 2 3", ""),
        ("1 2", "2 limits in 3 characters; there are 3 cores"),
        ("1 2 3 4", "4 limits in 7 characters; there are 3 cores"),
        ("1 2 x", "3 limits in 5 characters; there are 3 cores"),
        ("1 0 3", "core 1 does not take 0"),
        (f"1 2 {2**31 - 1}", ""),
        (f"1 2 {2**31}", f"core 2 does not take {2**31}"),
        ("1 2 " + "3".zfill(251), ""),
        ("1 2 " + "3".zfill(252), "3 limits in 256 characters; there are 3 cores"),
    ],
)
def test_memguard_takes_one_limit_for_every_core_of_255_characters_at_most(text, refused):
    assert module().write("write", text) == refused


def test_limits_of_memguard_are_the_least_that_give_a_rate():
    for period, microseconds in (("1ms", 1000), ("", 2000), ("1500us", 1500)):  # by default, the window
        device = module(period=period)
        assert device.period == microseconds
        for rate in (1, 63_999, 64_000, 64_001, 6_400_000):
            events = device.events(Fraction(rate))
            assert device.rate(events) >= rate > device.rate(events - 1)


@pytest.mark.parametrize(
    ("seen", "said"),
    [
        ([(0, 64), (3, 128)], "is not 64 bytes from window 8 on, as promised"),
        ([(0, 64), (3, 128), (8, 64)], ""),
        ([(0, 64), (4, 128)], "is 128 bytes from window 4 on, promised are 128 from window 3 on"),
        ([(0, 64), (3, 192)], "is 192 bytes from window 3 on, promised are 128 from window 3 on"),
        ([], "is not 64 bytes from window 0 on, as promised"),
        ([(0, 64), (3, 128), (8, 64), (9, 7)], "is 7 bytes from window 9 on, which is not promised"),
    ],
)
def test_budgets_of_axi_realm_are_compared_step_by_step(seen, said):
    """Those of a mode end with the one that it begins with."""
    table = SimpleNamespace(windows=8, successor=1, index=1)
    assert _difference(seen, [(0, 64), (3, 128)], table) == said
    same = [(0, 64), (3, 128), (5, 64)]
    assert _difference(same, same, table) == ""
    assert _difference([(0, 64), (3, 128)], [(0, 64), (3, 128)], SimpleNamespace(windows=8, successor=0, index=1)) == ""


@pytest.mark.parametrize(("capacity", "window"), [(438, None), (437, 2), (278, 2), (277, 0)])
def test_all_budgets_and_a_burst_of_each_are_within_the_capacity(capacity, window):
    noted = []
    case = SimpleNamespace(
        platform=SimpleNamespace(burst_bytes=64, capacity_bytes=capacity),
        note=lambda code, name, text, **_: noted.append((code, text)),
    )
    seen = {"a": [(0, 100), (2, 300), (4, 9000)], "b": [(0, 50), (2, 10)]}  # the last is for the table that follows
    _sums(case, "0-m.txt", SimpleNamespace(name="m", windows=4), seen)
    total = {0: 278, 2: 438}.get(window)
    text = f"{total} B may pass in window {window}, the capacity is {capacity} B"
    assert noted == ([(codes.DEVICE_OVER_CAPACITY, text)] if window is not None else [])


JAILHOUSE = {  # pages of the network of the ZCU102 from 0xfd700000 on, those of the low-power domain from 0xa00000 on
    "smmutbu3": 0x43, "smmutbu4": 0x44, "afifm0": 0x45, "afifm1": 0x46, "afifm2": 0x47, "smmutbu5": 0x48, "dp": 0x49,
    "afifm3": 0x4A, "afifm4": 0x4B, "afifm5": 0x4C, "gpu": 0x4D, "pcie": 0x4E, "gdma": 0x4F, "sata": 0x50,
    "rpu0": 0xA42, "rpu1": 0xA43, "adma": 0xA44, "afifm6": 0xA45,
}  # fmt: skip


def test_registers_of_qos400_are_those_of_jailhouse():
    """Facts of its driver for QoS-400, by Boston University and TU Munich, which ran on the ZCU102."""
    ports, registers = port_registers("qos400")
    assert ports == {port: 0xFD700000 + 0x1000 * page + 0x100 for port, page in JAILHOUSE.items()}
    cntl, aw_b, aw_r, ar_b, ar_r = (0x0C, 0x1C, 0x20, 0x28, 0x2C)
    names = ("control", "write_burstiness", "write_rate", "read_burstiness", "read_rate")
    assert [registers[name].offset for name in names] == [cntl, aw_b, aw_r, ar_b, ar_r]
    assert [registers[name].mask for name in names[1:]] == [0xFFFF, 0xFFF << 20] * 2
    assert registers["control"].mask == 1 << 0 | 1 << 1  # EN_AW_RATE, EN_AR_RATE
