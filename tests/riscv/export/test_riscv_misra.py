"""The runtime in C: MISRA C:2012 as cppcheck sees it, but for documented deviations; no warning of the compiler."""

import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from halpipe.core.files import write_directory
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow.formats import export
from riscv_models import on_disk, single

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "misra.md"
GCC = "riscv64-unknown-elf-gcc"
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wsign-conversion", "-Werror")
TARGET = ("-march=rv64imac_zicsr_zifencei", "-mabi=lp64", "-mcmodel=medany", "-std=gnu11", "-O2", "-ffreestanding")

pytest.importorskip("ziglang", reason="pip install ziglang")


DRIVERS = """halpipe-drivers: 1
sources: board.c
inputs: [{buffer: input, function: get, time: 1us}]
"""


PLATFORM = """halpipe-regulator: 1
clock: 100MHz
bus: 64bit
burst: 64B
window: 1000
guaranteed: 400MB/s
capacity: 440MB/s
table: {base: 0x60000000}
units: {left: {manager: 0}, right: {manager: 1}, u1: {manager: 2}}
"""


@pytest.fixture(scope="module", params=["vcu118", "virt", "drivers", "calibrate", "regulators"])
def runtime(request, tmp_path_factory):
    """A bundle's folder, with a DMA engine or without, or more; it has the generated headers and tables, too."""
    folder = tmp_path_factory.mktemp(request.param)
    system, schedule = single()
    has_drivers = request.param == "drivers"
    profile = request.param if request.param == "virt" else "vcu118"
    options = RiscvOptions(profile=profile, calibrate=request.param == "calibrate")
    model, tables = on_disk(folder, system, schedule, board_c="void get(void *data, unsigned long size) {}")
    if has_drivers:
        folder.joinpath("drivers.yaml").write_text(DRIVERS)
        options = replace(options, drivers=str(folder / "drivers.yaml"))
    if request.param == "regulators":
        folder.joinpath("platform.yaml").write_text(PLATFORM)
        options = replace(options, regulator=str(folder / "platform.yaml"))
    write_directory(str(folder / "b"), export("riscv", model, tables, options))
    assert ("HP_DRIVERS" in (folder / "b" / "runtime" / "platform.h").read_text()) == has_drivers
    return folder / "b"


def deviations():
    """The rules of the documented list."""
    rows = re.findall(r"^\| ([0-9]+\.[0-9]+) \|", PAGE.read_text(), re.MULTILINE)
    assert rows
    return set(rows)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("cppcheck") is None, reason="apt-get install cppcheck")
def test_misra_but_for_the_documented_deviations(runtime):
    command = ["cppcheck", "--addon=misra", "--enable=style", "--std=c11", "--platform=unix64", "-q", "-Iruntime"]
    files = sorted(f"runtime/{path.name}" for path in (runtime / "runtime").glob("*.c"))
    done = subprocess.run([*command, *files], cwd=runtime, capture_output=True, text=True, check=True)
    found = re.findall(r"^(\S+?:[0-9]+).*\[misra-c2012-([0-9]+\.[0-9]+)\]", done.stderr, re.MULTILINE)
    assert found, "the addon says nothing at all: it was not run"
    assert [(place, rule) for place, rule in found if rule not in deviations()] == []


@pytest.mark.slow
@pytest.mark.skipif(shutil.which(GCC) is None, reason="apt-get install gcc-riscv64-unknown-elf")
def test_no_warning_of_the_compiler(runtime, tmp_path):
    for path in sorted((runtime / "runtime").glob("*.c")):
        command = [GCC, *STRICT, *TARGET, "-Iruntime", "-c", f"runtime/{path.name}", "-o", str(tmp_path / "o")]
        done = subprocess.run(command, cwd=runtime, capture_output=True, text=True, check=False)
        assert (done.returncode, done.stderr) == (0, "")
