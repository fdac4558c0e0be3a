"""Toolchains: what is told where there is none, and what is understood of their errors."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.programs import NOT_STARTED
from halpipe.exporters.riscv import toolchain
from halpipe.exporters.riscv.codes import TOOLCHAIN_MISSING
from halpipe.exporters.riscv.toolchain import Compile, Link, Workshop, compiler_errors, find_toolchain, run_all


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


@pytest.mark.parametrize("has_zig", [True, False])
@pytest.mark.parametrize("has_gcc", [True, False])
@pytest.mark.parametrize("name", ["auto", "zig", "gcc"])
def test_zig_is_taken_where_it_is_installed_and_gcc_otherwise(monkeypatch, name, has_zig, has_gcc):
    zig = SimpleNamespace(submodule_search_locations=["/zig"]) if has_zig else None
    monkeypatch.setattr(toolchain, "find_spec", lambda what: zig if what == "ziglang" else what)
    monkeypatch.setattr(toolchain.shutil, "which", lambda what: what if has_gcc else None)
    monkeypatch.setattr(toolchain, "_zig", lambda folder: f"zig in {folder}")
    monkeypatch.setattr(toolchain, "_gcc", lambda: "gcc")
    due = {"zig": "zig in /zig" if has_zig else None, "gcc": "gcc" if has_gcc else None}
    due["auto"] = due["zig"] or due["gcc"]
    if due[name]:
        assert find_toolchain(name) == due[name]
        return
    with pytest.raises(HalpipeError) as refused:
        find_toolchain(name)
    absent = "riscv64-unknown-elf-gcc" if name == "gcc" else "the zig toolchain"
    assert [d.message for d in refused.value.diagnostics] == [f"{absent} is not installed"]


def test_a_package_of_zig_without_its_program_is_no_toolchain(monkeypatch):
    monkeypatch.setattr(toolchain, "find_spec", lambda what: SimpleNamespace(submodule_search_locations=None))
    with pytest.raises(HalpipeError, match="zig toolchain is not installed"):
        find_toolchain("zig")


def test_a_compiler_that_states_no_version_is_refused(monkeypatch):
    monkeypatch.setattr(toolchain, "program", lambda command: SimpleNamespace(returncode=4, stdout="1.2\n"))
    with pytest.raises(HalpipeError, match="zig stopped with status 4"):
        toolchain._zig(Path("/zig"))
    monkeypatch.setattr(toolchain, "program", lambda command: SimpleNamespace(returncode=0, stdout="1.2\n"))
    assert [made.title for made in (toolchain._zig(Path("/zig")), toolchain._gcc())] == ["zig 1.2", "gcc 1.2"]


def test_reservations_are_found_among_instructions_of_two_and_four_bytes():
    """RISC-V, "A" extension: major opcode AMO, functions 2 (lr) and 3 (sc); a word without the low bits 11 is short."""
    lr, sc, swap = 0x1005252F, 0x18B5252F, 0x08B5252F
    short = b"\x01\x00"
    code = b"".join(each if isinstance(each, bytes) else each.to_bytes(4, "little") for each in (short, lr, swap, sc))
    assert [*toolchain._reserving(code, 0x100)] == [0x102, 0x10A]
    assert [*toolchain._reserving(code + short, 0x100)] == [0x102, 0x10A]
    assert [*toolchain._reserving(b"", 0)] == []
    within = (0x002F0013).to_bytes(4, "little") + (0x00001013).to_bytes(4, "little")  # their halves look like one
    assert [*toolchain._reserving(within, 0)] == []
    assert [*toolchain._reserving(short + within, 0)] == []


class Tools:
    """A toolchain whose compiler and linker are programs of the shell."""

    def compile(self, source, target, defines):
        return ["sh", "-c", f"cat {source} > {target} && echo {' '.join(defines)} >> {target}"]

    def link(self, script, target, objects):
        return ["sh", "-c", f"cat {script} {' '.join(objects)} > {target}"]


def test_a_workshop_keeps_the_steps_that_lead_to_the_bundle(tmp_path):
    shop = Workshop(tmp_path, Tools())
    shop.write("src/a.c", "A\n")
    shop.write("link/a.ld", b"L\n")
    shop.write("src/lib/inner/b.h", "B\n")
    shop.write("src/lib/inner/c.h", "C\n")
    assert [shop.read(f"src/lib/inner/{name}.h") for name in "bc"] == [b"B\n", b"C\n"]
    compiled, measured = Compile("src/a.c", "build/obj/a.o", ("X", "Y")), Link("link/a.ld", "m/a", ("build/obj/a.o",))
    linked = Link("link/a.ld", "out/a", ("build/obj/a.o",))
    assert shop.compile([compiled]) == shop.link([measured], is_final=False) == shop.link([linked]) == []
    assert (shop.compiles, shop.links) == ([compiled], [linked])
    assert shop.read("out/a") == shop.read("m/a") == b"L\nA\nX Y\n"
    assert [failure.position for failure in shop.link([linked, Link("absent", "out/b", ())])] == [1]
