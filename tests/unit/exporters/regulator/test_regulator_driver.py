"""The driver of the unit for Linux, compiled and run on a file in place of its registers; and its core description."""

import mmap
import re
import shutil
import struct
import subprocess
import time
from fractions import Fraction
from pathlib import Path

import pytest
import yaml

import halpipe
import regulator_bundles as bundles
from halpipe.deploy.regulator import stimuli
from halpipe.deploy.regulator.counters import compare_counters
from halpipe.deploy.regulator.forms import entry_words, header_words
from halpipe.deploy.regulator.reading import read_tables

TABLE = Path(halpipe.__file__).parent / "exporters" / "regulator" / "table"
UNIT = 1 << 20
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system("100ns"))


@pytest.fixture(scope="module")
def driver(bundle, tmp_path_factory):
    folder = tmp_path_factory.mktemp("driver")
    for name in ("bw_regulator.c", "bw_tables.h", "bw_uio.h", "bw_unit.h"):
        (folder / name).write_bytes(next(data for path, data in bundle.items() if path.endswith(f"/{name}")))
    command = ["cc", "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-o", "driver", "bw_regulator.c"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "driver"


class Device:
    """A file of the size of the registers, with what can be read of a device that fits."""

    def __init__(self, path, tables):
        self.path, units = path, len(tables.units)
        path.write_bytes(b"")
        with path.open("r+b") as file:
            file.truncate((units + 1) * UNIT)
            self.memory = mmap.mmap(file.fileno(), 0)
        self.put(0, 0x48425746)
        self.put(4, 4 << 24 | 1 << 20 | 1 << 16 | 3 << 8 | units)
        for n in range(units):
            self.put((n + 1) * UNIT, 0x48425754)
            self.put((n + 1) * UNIT + 4, 4 << 24 | 16 << 16 | 1024)

    def put(self, at, value):
        self.memory[at : at + 4] = struct.pack("<I", value)

    def get(self, at):
        return struct.unpack("<I", self.memory[at : at + 4])[0]


@pytest.fixture
def tables(bundle):
    return read_tables(bundles.target(bundle).bundle)


@pytest.fixture
def device(tmp_path, tables):
    return Device(tmp_path / "uio", tables)


def run(driver, device, *words):
    return subprocess.run([driver, device.path, *words], capture_output=True, text=True, check=False, timeout=60)


def test_what_is_loaded_is_what_the_memory_images_have(driver, device, tables):
    assert run(driver, device, "load").returncode == 0
    p = tables.platform
    assert [device.get(at) for at in (0x18, 0x20, 0x24, 0x28)] == [p.window_cycles, 0, 1, p.burst_bytes]
    for unit in tables.units:
        base = (unit.index + 1) * UNIT
        assert [device.get(base + at) for at in (0x14, 0x18)] == [unit.default["read"], unit.default["write"]]
        for number, word in enumerate(header_words(tables, unit)):
            have = [device.get(base + 0x800 + 8 * number + at) for at in (4, 0)]
            assert "".join(f"{value:08x}" for value in have) == word
        for number, word in enumerate([*entry_words(tables, unit), "ffffffff" + "0" * 16]):
            have = [device.get(base + 0x1000 + 16 * number + at) for at in (8, 4, 0)]
            assert "".join(f"{value:08x}" for value in have) == word


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (0, 0, "no regulator"),
        (4, 1 << 24 | 3 << 8 | 3, "another version"),
        (4, 4 << 24 | 3 << 8 | 2, "fewer units"),
        (4, 4 << 24 | 4 << 8 | 3, "another width"),
        (UNIT + 4, 4 << 24 | 16 << 16 | 2, "too few table entries"),
        (2 * UNIT + 4, 4 << 24 | 2 << 16 | 1024, "too few tables"),
        (3 * UNIT, 1, "does not answer"),
        (0x38, 7, "shorter than the longest burst"),
        (8, 1, "stop first"),
    ],
)
def test_a_device_that_does_not_fit_is_refused_before_anything_is_written(driver, device, at, value, said):
    device.put(at, value)
    before = device.memory[:]
    done = run(driver, device, "load")
    assert (done.returncode, said in done.stderr) == (1, True)
    assert device.memory[:] == before


def test_orders_reach_their_registers(driver, device):
    for words in (("request", "2"), ("start", str(5 << 32 | 7))):
        assert run(driver, device, *words).returncode == 0
    assert [device.get(at) for at in (0x1C, 0x2C, 0x30, 0x08)] == [2, 7, 5, 2]
    assert run(driver, device, "go").returncode == 0
    assert device.get(0x08) == 1
    assert run(driver, device, "stop").returncode == 0
    assert device.get(0x08) == 0
    device.put(UNIT + 0x0C, 1 << 8 | 1 << 10)
    assert "u1: table 0, window 0, a read was too long" in run(driver, device, "status").stdout
    for wrong in (("request", "9"), ("request", "x"), ("start",), ("fly",), ()):
        assert run(driver, device, *wrong).returncode == 1


def test_a_schedule_is_written_into_the_bank_that_is_not_played(driver, device, tables):
    """Headers, entries, bases and successors are those of the upper half; nothing of the lower one changes."""
    assert run(driver, device, "load").returncode == 0
    device.put(4, 4 << 24 | 1 << 20 | 2 << 16 | 3 << 8 | len(tables.units))
    for unit in tables.units:
        device.put((unit.index + 1) * UNIT + 0x0C, 1 << 8 | 1)
    lower = {u.index: device.memory[(u.index + 1) * UNIT + 0x800 : (u.index + 1) * UNIT + 0x840] for u in tables.units}
    assert run(driver, device, "replace", "1").returncode == 0
    assert (device.get(0x1C), device.get(0x34)) == (8 + 1, 0)
    for unit in tables.units:
        base = (unit.index + 1) * UNIT
        assert device.memory[base + 0x800 : base + 0x840] == lower[unit.index]
        for number, word in enumerate(header_words(tables, unit)[: len(tables.tables)]):
            high, low = (device.get(base + 0x840 + 8 * number + at) for at in (4, 0))
            assert f"{high - (8 << 24 | 512):08x}{low:08x}" == word
        for number, word in enumerate([*entry_words(tables, unit), "ffffffff" + "0" * 16]):
            have = [device.get(base + 0x1000 + 16 * (512 + number) + at) for at in (8, 4, 0)]
            assert "".join(f"{value:08x}" for value in have) == word
        device.put(base + 0x0C, 1 << 8 | 9)
    assert run(driver, device, "request", "2").returncode == 0
    assert device.get(0x1C) == 8 + 2
    assert "u1: table 1, window 0" in run(driver, device, "status").stdout


@pytest.mark.parametrize(
    ("at", "value", "said"),
    [
        (4, 4 << 24 | 1 << 20 | 1 << 16 | 3 << 8 | 3, "one bank"),
        (0x18, 9, "other windows"),
        (2 * UNIT + 0x0C, 1 << 8 | 1 << 9, "is requested"),
        (2 * UNIT + 0x0C, 0, "none is played"),
        (3 * UNIT + 0x0C, 1 << 8 | 8, "try again"),
        (4, 4 << 24 | 2 << 20 | 2 << 16 | 3 << 8 | 3, "the other port"),
    ],
)
def test_nothing_is_replaced_where_it_would_be_played_half_written(driver, device, tables, at, value, said):
    assert run(driver, device, "load").returncode == 0
    device.put(4, 4 << 24 | 1 << 20 | 2 << 16 | 3 << 8 | len(tables.units))
    for unit in tables.units:
        device.put((unit.index + 1) * UNIT + 0x0C, 1 << 8)
    device.put(at, value)
    before = [device.memory[(n + 1) * UNIT : (n + 2) * UNIT] for n in range(len(tables.units))]
    done = run(driver, device, "replace", "1")
    assert (done.returncode, said in done.stderr, device.get(0x1C)) == (1, True, 0)
    assert before == [device.memory[(n + 1) * UNIT : (n + 2) * UNIT] for n in range(len(tables.units))]


def test_counters_are_what_compare_reads(bundle, driver, device, tables):
    """Bytes of two looks at a unit, of which the first has too many for the windows from one look to the other."""
    for n in range(len(tables.units)):
        device.put((n + 1) * UNIT + 0x0C, 1 << 8)
        device.put((n + 1) * UNIT + 0x28, 2**32 - 64)  # counters wrap
    looking = subprocess.Popen([driver, device.path, "counters", "0.4"], stdout=subprocess.PIPE, text=True)
    time.sleep(0.2)
    for n in range(len(tables.units)):
        device.put((n + 1) * UNIT + 0x10, 5)
    device.put(UNIT + 0x28, 100 * 64)
    device.put(2 * UNIT + 0x28, 0)
    text, _ = looking.communicate(timeout=60)
    header, first, *_ = text.splitlines()
    assert header == "unit,direction,bytes,start_s,end_s"
    unit, direction, moved, start, end = first.split(",")
    assert (unit, direction, moved, Fraction(start)) == ("u1", "read", str(101 * 64), 0)
    assert Fraction(end) * 10**9 == 6 * tables.platform.window_ns
    counted = compare_counters(bundles.target(bundle), text, "counters.csv", "full")
    assert ("HAL1065", 2) in {(found.code, found.at.line) for found in counted.diagnostics}
    assert not any(found.code == "HAL1065" and found.at.line != 2 for found in counted.diagnostics)
    assert counted.usage["full", "u2", "read"].used == 64


def described(bundle):
    """The registers of unit and windows as SystemRDL has them: name, offset and access."""
    maps = []
    for text in bundle["table/regulator.rdl"].decode().split("\naddrmap ")[1:]:
        registers, begin = {}, 0
        for found in re.finditer(r"\} (\w+)(?:\[\w+\])? @(0x[0-9a-f]+)( \+=)?", text):
            access = {word for word in re.findall(r"\bsw = (\w+);", text[begin : found.start()]) if word != "r"}
            kind = "rw" if "rw" in access else "wo" if "w" in access else "ro"
            registers[found[1]] = (int(found[2], 16), kind)
            begin = found.end()
        maps.append(registers)
    return maps


def test_manual_driver_bench_and_verilog_have_the_registers_of_the_description(bundle):
    unit, windows = described(bundle)
    page = (TABLE.parents[4] / "docs" / "reference" / "regulator-unit.md").read_text()
    parts = page.split("## Registers of the windows")
    for registers, part in ((unit, parts[0]), (windows, parts[1])):
        rows = re.findall(r"^\| (0x[0-9a-f]+) \| ([A-Z_]+) \| (\w+) \|", part, re.MULTILINE)
        inner = ("LO", "HI", "WR", "RD", "START")  # of a header, and of an entry
        single = {name: fact for name, fact in registers.items() if fact[0] < 0x800 and name not in inner}
        assert {name: (int(at, 16), kind) for at, name, kind in rows} == single
    source = "".join((TABLE / "linux" / f"bw_{name}").read_text() for name in ("unit.h", "uio.h", "regulator.c"))
    for name, at in re.findall(r"(?:#define BW_|\b)([A-Z_]+) (?:= )?(0x[0-9a-f]{2})U?\b", source):
        assert int(at, 16) in {registers[name][0] for registers in (unit, windows) if name in registers}
    bench = {
        "GO": "CTRL",
        "REQUEST": "REQ_TABLE",
        "DEF_READ": "DEF_RD",
        "DEF_WRITE": "DEF_WR",
        "HEADERS": "HDR",
        "ENTRIES": "TAB",
    }
    for name, value in vars(stimuli).items():
        for prefix, registers in (("FRAME_", windows), ("UNIT_", unit)):
            if name.startswith(prefix):
                plain = name.removeprefix(prefix)
                assert registers[bench.get(plain, plain)][0] == value
    for registers, name, digits in ((unit, "_unit", 11), (windows, "", 20)):
        text = (TABLE / "rtl" / f"halpipe_regulator{name}.v").read_text()
        read = {int(at, 16) for at in re.findall(rf"{digits}'h([0-9a-f]+): *(?:reg_rdata|word)", text)}
        assert read == {at for at, kind in registers.values() if kind != "wo" and at < 0x800}


def test_the_core_descriptions_have_the_keys_of_their_form():
    """A comma in a text without quotes is a key of its own, and the file is ignored as a whole."""
    known = {"datatype", "paramtype", "default", "description"}
    for path in TABLE.glob("*/*.core"):
        core = yaml.safe_load(path.read_text().partition("\n")[2])
        assert core["parameters"]
        assert all(set(parameter) == known for parameter in core["parameters"].values())


@pytest.mark.skipif(shutil.which("fusesoc") is None, reason="pip install fusesoc")
@pytest.mark.skipif(shutil.which("verilator") is None, reason="verilator is not installed")
@pytest.mark.parametrize(("folder", "core"), [("rtl", "halpipe:memory:regulator"), ("dma", "halpipe:memory:dma")])
def test_fusesoc_reads_the_core_descriptions_and_lints_the_design(tmp_path, folder, core):
    shutil.copytree(TABLE / folder, tmp_path / "cores")
    command = ["fusesoc", "--cores-root", "cores", "run", "--target", "lint", core]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert (done.returncode, "WARNING" in done.stdout + done.stderr) == (0, False), done.stderr


def test_the_core_description_lists_all_sources():
    core = yaml.safe_load((TABLE / "rtl" / "halpipe_regulator.core").read_text().partition("\n")[2])
    listed = [name for files in core["filesets"].values() for name in files["files"]]
    there = [path.name for path in (TABLE / "rtl").iterdir() if path.suffix in (".v", ".sdc")]
    assert sorted(listed) == sorted(there)
    assert set(core["parameters"]) == set(core["targets"]["default"]["parameters"])
    top = (TABLE / "rtl" / "halpipe_regulator_axi4.v").read_text()
    assert all(f"parameter integer {name} " in top for name in core["parameters"])


@pytest.mark.skipif(shutil.which("fdtoverlay") is None, reason="device-tree-compiler is not installed")
def test_the_device_tree_overlay_is_compiled_and_applied(tmp_path):
    """The node has room for the block of windows and 63 units."""
    (tmp_path / "base.dts").write_text("/dts-v1/; / { #address-cells = <2>; #size-cells = <2>; };")
    source = TABLE / "linux" / "regulator.dtso"
    for text, blob in ((tmp_path / "base.dts", "base.dtb"), (source, "overlay.dtbo")):
        done = subprocess.run(
            ["dtc", "-@", "-I", "dts", "-O", "dtb", "-o", tmp_path / blob, text],
            capture_output=True,
            text=True,
            check=True,
        )
        assert done.stderr == ""
    command = ["fdtoverlay", "-i", "base.dtb", "-o", "whole.dtb", "overlay.dtbo"]
    subprocess.run(command, cwd=tmp_path, check=True)
    command = ["fdtget", "-t", "x", "whole.dtb", "/regulator@a0000000", "reg"]
    words = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout.split()
    assert words == ["0", "a0000000", "0", f"{64 * UNIT:x}"]
