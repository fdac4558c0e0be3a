"""The bundle: what is in it, that it is what its descriptions say, and that it is the same wherever it is made."""

import io
import json
import shutil
import subprocess
import sys

import pytest
from elftools.elf.elffile import ELFFile

from halpipe.core.files import sha256, write_directory
from riscv_models import single


def loaded(data):
    """(physical address, bytes) of what an ELF file loads."""
    return [(s["p_paddr"], s.data()) for s in ELFFile(io.BytesIO(data)).iter_segments("PT_LOAD") if s["p_filesz"]]


def symbols(data):
    return {s.name: s["st_value"] for s in ELFFile(io.BytesIO(data)).get_section_by_name(".symtab").iter_symbols()}


@pytest.fixture(scope="module")
def target(simple):
    return json.loads(simple["target.json"])


def test_it_stands_alone(simple):
    expected = {
        "manifest.json",
        "model.xml",
        "schedule.xml",
        "target.json",
        "bundle.elf",
        "bundle.bin",
    }
    expected |= {"README.md", "Makefile", "src/scale.c", "link/bundle.ld", "images/0.elf", "runtime/runtime.c"}
    assert expected <= simple.keys()
    assert "runtime/calibrate.c" not in simple  # unless --calibrate is given
    manifest = json.loads(simple["manifest.json"])
    assert manifest["kind"] == "riscv"
    assert manifest["files"] == {name: sha256(data) for name, data in simple.items() if name != "manifest.json"}


def test_the_program_begins_where_harts_enter(simple, target):
    file = ELFFile(io.BytesIO(simple["bundle.elf"]))
    assert file.header["e_entry"] == int(target["entry"], 16) == int(target["main"]["base"], 16)


def test_images_lie_where_their_loads_come_from(simple, target):
    """The bytes at `source` in main memory are those that the image's own ELF file has for `target`."""
    [image] = target["images"]
    memory = simple["bundle.bin"]
    base = int(target["main"]["base"], 16)
    own = {s["p_vaddr"]: s.data() for s in ELFFile(io.BytesIO(simple[image["file"]])).iter_segments("PT_LOAD")}
    assert image["load"]
    for part in image["load"]:
        at = int(part["source"], 16) - base
        assert memory[at : at + part["size"]] == own[int(part["target"], 16)]


def test_code_and_data_are_in_the_scratchpads_of_their_core(simple, target):
    [image], [unit] = target["images"], target["units"]
    found = symbols(simple[image["file"]])
    code, data = (int(unit[name]["base"], 16) for name in ("ispm", "dspm"))
    assert code + 4096 <= found["scale"] < code + unit["ispm"]["size"]
    assert data + 8192 <= found["numbers"] < data + unit["dspm"]["size"] - 1024
    assert [int(entry, 16) for entry in image["entries"]] == [found["scale"]]


def test_transfer_variables_are_neither_loaded_nor_cleared(simple, target):
    [image] = target["images"]
    found = symbols(simple[image["file"]])
    cleared = range(int(image["bss"]["base"], 16), int(image["bss"]["base"], 16) + image["bss"]["size"])
    for name in ("numbers", "scaled"):
        at = found[name]
        assert at not in cleared
        assert all(not int(p["target"], 16) <= at < int(p["target"], 16) + p["size"] for p in image["load"])


def test_the_flat_binary_is_what_the_program_loads(simple, target):
    base, memory = int(target["main"]["base"], 16), simple["bundle.bin"]
    covered = bytearray(len(memory))
    for at, data in loaded(simple["bundle.elf"]):
        covered[at - base : at - base + len(data)] = data
    assert covered == memory


def test_the_control_block_is_in_no_segment(simple, target):
    control = int(target["control"], 16)
    assert all(not at <= control < at + len(data) for at, data in loaded(simple["bundle.elf"]))


def test_the_target_is_a_text_of_short_lines_with_all_that_a_debugger_needs(simple, target):
    assert simple["target.json"].decode().splitlines()[:3] == ["{", ' "halpipe-target": 2,', ' "profile": "vcu118",']
    assert target["trace"] == {"base": hex(0x84000000 - 0x4000 - 65536 * 48), "capacity": 65536, "record": 48}
    assert target["faults"] == {"base": hex(0x84000000 - 0x4000), "capacity": 256, "record": 64}
    assert (target["decision"], target["margin"], target["service"]) == (2, 2, "6.5us")
    assert target["tables"][0].items() >= {"name": "all", "mode": 0, "length": 5000}.items()


def test_nothing_tells_where_it_was_made(simple, tmp_path):
    for name, data in simple.items():
        assert b"/tmp" not in data, name
        assert str(tmp_path.parents[1]).encode() not in data, name
        assert b"site-packages" not in data, name


def test_it_is_the_same_wherever_it_is_made(simple, build, monkeypatch, tmp_path):
    elsewhere = tmp_path / "a" / "deeper" / "folder"
    elsewhere.mkdir(parents=True)
    monkeypatch.chdir(elsewhere)
    monkeypatch.setenv("TMPDIR", str(elsewhere))
    monkeypatch.setattr("tempfile.tempdir", None)
    assert build(*single()) == simple


def rebuilt(folder, bundle, *arguments):
    write_directory(str(folder), bundle)
    done = subprocess.run(["make", "-s", "check", *arguments], cwd=folder, capture_output=True, text=True, check=False)
    return done.stdout.strip(), done.stderr


needs_make = pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")


@needs_make
def test_the_makefile_rebuilds_it_byte_for_byte(simple, tmp_path):
    where = subprocess.run(
        [sys.executable, "-c", "import os, ziglang; print(os.path.dirname(ziglang.__file__))"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert rebuilt(tmp_path / "bundle", simple, f"ZIG={where.stdout.strip()}")[0] == "identical"


@needs_make
@pytest.mark.slow
@pytest.mark.skipif(shutil.which("riscv64-unknown-elf-gcc") is None, reason="riscv64-unknown-elf-gcc is not installed")
def test_gcc_makes_the_same_system(build, tmp_path, simple):
    bundle = build(*single(), toolchain="gcc")
    assert rebuilt(tmp_path / "bundle", bundle)[0] == "identical"
    ours, theirs = (json.loads(b["target.json"]) for b in (simple, bundle))
    assert ours.keys() == theirs.keys()
    assert ours["buffers"] == theirs["buffers"]
    assert theirs["toolchain"].startswith("gcc")
