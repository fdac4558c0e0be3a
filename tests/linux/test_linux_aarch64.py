"""Bundles and packages are built for aarch64 with the C library of JetPack 5 (Ubuntu 20.04), which nothing ran here."""

import shutil
import subprocess
import sys

import pytest
from test_linux_bundle import two_modes, write
from test_ros_package import HUMBLE, STUBS, package

pytest.importorskip("ziglang", reason="the cross compiler: pip install ziglang")
TARGET = "-target aarch64-linux-gnu.2.31"
AARCH64 = 183  # e_machine of ELF
pytestmark = [
    pytest.mark.slow,  # the cross compiler takes many seconds; the native build has quicker tests
    pytest.mark.skipif(not shutil.which("make"), reason="bundles are built with make"),
]


def machine(path):
    data = path.read_bytes()
    return data[:4] == b"\x7fELF" and int.from_bytes(data[18:20], "little")


def test_a_bundle_is_built_without_a_warning(tmp_path):
    owner, tables = two_modes()
    bundle, _ = write(tmp_path, owner, tables, busy=10)
    command = ["make", f"CC={sys.executable} -m ziglang cc {TARGET}", "CFLAGS=-O2 -Werror"]
    built = subprocess.run(command, cwd=bundle, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert {machine(path) for path in (bundle / "build").iterdir()} == {AARCH64}


def test_the_container_of_a_package_is_built_without_a_warning(tmp_path):
    for name, content in package().items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(content)
    compiler = [sys.executable, "-m", "ziglang"]
    command = [
        *compiler,
        "c++",
        *TARGET.split(),
        "-std=c++17",
        "-Wall",
        "-Wextra",
        "-Werror",
        f"-DSTUB_RCLCPP={HUMBLE}",
    ]
    command += ["-DPRIORITY=80", f"-I{STUBS}", "-Isrc", "-Iruntime", "-c", "src/container.cpp", "-o", "container.o"]
    built = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    assert machine(tmp_path / "container.o") == AARCH64
