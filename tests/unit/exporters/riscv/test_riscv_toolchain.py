"""Toolchains: what is told where there is none, and what is understood of their errors."""

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import NOT_STARTED
from halpipe.exporters.riscv import toolchain
from halpipe.exporters.riscv.codes import TOOLCHAIN_MISSING
from halpipe.exporters.riscv.toolchain import compiler_errors, find_toolchain, run_all


@pytest.fixture
def nothing(monkeypatch):
    """A machine without compilers and libraries for RISC-V."""
    monkeypatch.setattr(toolchain, "find_spec", lambda name: None)
    monkeypatch.setattr(toolchain.shutil, "which", lambda name: None)


@pytest.mark.parametrize("name", ["auto", "zig", "gcc"])
def test_what_is_absent_is_told_with_how_to_get_it(nothing, name):
    with pytest.raises(HalpipeError) as caught:
        find_toolchain(name)
    [found] = caught.value.diagnostics
    assert found.code == TOOLCHAIN_MISSING.id
    assert "pip install" in found.help


@pytest.mark.parametrize(("name", "how"), [("auto", "pip install"), ("zig", "pip install"), ("gcc", "apt install")])
def test_with_pyelftools_alone(nothing, monkeypatch, name, how):
    monkeypatch.setattr(toolchain, "find_spec", lambda name: name == "elftools" or None)
    with pytest.raises(HalpipeError) as caught:
        find_toolchain(name)
    assert how in caught.value.diagnostics[0].help


def test_errors_of_compilers_have_file_and_line():
    said = (
        "src/a.c:3:5: error: unknown type name 'flaot'\nsrc/a.c:4:1: warning: unused\nsrc/b.h:7:2: fatal error: no x.h"
    )
    assert compiler_errors(said) == [("src/a.c", 3, "unknown type name 'flaot'"), ("src/b.h", 7, "no x.h")]


def test_all_failures_are_collected_in_order(tmp_path):
    commands = [["false"], ["true"], ["sh", "-c", "echo wrong >&2; exit 3"]]
    found = run_all(commands, tmp_path, 2)
    assert [failure.position for failure in found] == [0, 2]
    assert [failure.said for failure in found] == ["status 1", "wrong"]


def test_a_compiler_that_cannot_be_started_is_no_fault_of_a_source(tmp_path):
    with pytest.raises(HalpipeError) as failure:
        run_all([["true"], ["/absent/program"]], tmp_path, 2)
    assert failure.value.diagnostics[0].code == NOT_STARTED.id


def test_the_environment_decides_nothing(tmp_path, monkeypatch):
    monkeypatch.setenv("CPATH", "/somewhere")
    monkeypatch.setenv("C_INCLUDE_PATH", "/elsewhere")
    assert run_all([["sh", "-c", 'test -z "$CPATH$C_INCLUDE_PATH"']], tmp_path, 1) == []
