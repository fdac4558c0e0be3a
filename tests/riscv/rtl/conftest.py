"""Rocket tiles in RTL, built from the Verilog of `pythondata-cpu-rocket`."""

import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

import pytest

HERE = Path(__file__).parent
FOUND = find_spec("pythondata_cpu_rocket")
CONFIG, TOP = "freechips.rocketchip.system.LitexLinux4Config", "ExampleRocketSystem"


@pytest.fixture(scope="session")
def rocket(tmp_path_factory):
    """Build the simulator of the tiles; that takes some minutes."""
    if FOUND is None:
        pytest.skip("pip install pythondata-cpu-rocket")
    if not (shutil.which("verilator") and shutil.which("g++")):
        pytest.skip("apt-get install verilator g++")
    if not (find_spec("unicorn") and find_spec("ziglang")):
        pytest.skip("pip install halpipe[riscv]")
    folder = tmp_path_factory.mktemp("rocket")
    verilog = Path(FOUND.submodule_search_locations[0]) / "verilog"
    parts = [verilog / "generated-src" / f"{CONFIG}{kind}" for kind in (".v", ".behav_srams.v")]
    parts += [verilog / "vsrc" / f"{name}.v" for name in ("plusarg_reader", "EICG_wrapper", "AsyncResetReg")]
    options = "--cc --exe --build -O3 --x-assign 0 --x-initial 0 -Wno-fatal -Wno-lint -Wno-style --output-split 20000"
    command = ["verilator", *options.split(), "+define+SYNTHESIS", "--top-module", TOP, "-CFLAGS", "-O1"]
    command += ["--Mdir", "obj", "-o", "rocket", *map(str, parts), str(HERE / "rocket_top.cpp")]
    built = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr[-2000:]
    return folder / "obj" / "rocket"
