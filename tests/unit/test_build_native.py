"""The libraries in C are built by whatever compiler there is, without a warning, and only where that is needed."""

import ctypes
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

from halpipe.core import libraries
from halpipe.core.libraries import fingerprint

ROOT = Path(__file__).parents[2]
SUFFIXES = {"linux": ".so", "macos": ".dylib", "windows": ".dll"}
MAGIC = {"linux": b"\x7fELF", "macos": b"\xcf\xfa\xed\xfe", "windows": b"MZ"}


def module(name):
    spec = spec_from_file_location(name, ROOT / f"{name}.py")
    made = module_from_spec(spec)
    sys.modules[name] = made
    spec.loader.exec_module(made)
    return made


@pytest.fixture
def builder():
    """The module that builds, fresh, so that it looks for a compiler anew."""
    return module("build_native")


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """A folder that is all of the search path for programs."""
    folder = tmp_path / "programs"
    folder.mkdir()
    monkeypatch.setenv("PATH", str(folder))
    monkeypatch.delenv("CC", raising=False)
    return folder


def program(place, text):
    place.write_text(f"#!/bin/sh\n{text}\n")
    place.chmod(0o755)


def check(builder, made):
    """Every library is of this system and of these sources."""
    assert sorted(made) == sorted(str(Path(place).with_suffix(libraries.SUFFIX)) for place in builder.LIBRARIES)
    for place, path in made.items():
        loaded = ctypes.CDLL(str(path))
        found = ctypes.string_at(ctypes.addressof(ctypes.c_char.in_dll(loaded, "halpipe_fingerprint")))
        assert found.decode() == fingerprint((builder.SOURCE / place).parent)


@pytest.mark.slow
def test_the_machines_compiler_has_nothing_to_say(builder, tmp_path, monkeypatch, capsys):
    if builder.own_compiler() is None:
        pytest.skip("this machine has no C compiler")
    monkeypatch.setattr(builder, "FLAGS", (*builder.FLAGS, "-Werror"))
    check(builder, builder.build(tmp_path))
    assert capsys.readouterr().err == ""


@pytest.mark.slow  # the one above has the same subject
def test_without_a_compiler_that_works_zig_builds_without_a_warning(builder, tmp_path, programs, monkeypatch):
    pytest.importorskip("ziglang", reason="halpipe[riscv] is not installed")
    program(programs / "cc", "exit 1")
    monkeypatch.setattr(builder, "FLAGS", (*builder.FLAGS, "-Werror"))
    check(builder, builder.build(tmp_path))


@pytest.mark.slow
@pytest.mark.parametrize("target", ["linux-aarch64", "macos-x86_64", "macos-arm64", "windows-x86_64"])
def test_other_systems_are_built_for_without_a_warning(builder, tmp_path, monkeypatch, target):
    pytest.importorskip("ziglang", reason="halpipe[riscv] is not installed")
    monkeypatch.setattr(builder, "FLAGS", (*builder.FLAGS, "-Werror"))
    family = target.partition("-")[0]
    for path in builder.build(tmp_path, target).values():
        assert path.suffix == SUFFIXES[family]
        assert path.read_bytes().startswith(MAGIC[family])


def test_a_compiler_that_is_there_but_broken_is_none(builder, programs):
    program(programs / "cc", "exit 1")
    program(programs / "gcc", "echo 'internal compiler error' >&2; exit 4")
    (programs / "clang").write_bytes(b"\x7fELF for another machine")
    (programs / "clang").chmod(0o755)
    assert builder.own_compiler() is None


def test_without_any_compiler_the_way_out_is_named(builder, programs, monkeypatch, capsys):
    monkeypatch.setattr(builder, "find_spec", lambda name: None)
    monkeypatch.setattr(sys, "argv", ["build_native.py", str(programs)])
    assert builder.main() == 1
    assert "pip install 'ziglang" in capsys.readouterr().err


def test_what_a_compiler_refuses_is_told(builder, tmp_path, monkeypatch):
    if builder.own_compiler() is None:
        pytest.skip("this machine has no C compiler")
    monkeypatch.setattr(builder, "FLAGS", (*builder.FLAGS, "-include", "nowhere.h"))
    with pytest.raises(builder.BuildError, match=r"nowhere\.h"):
        builder.build(tmp_path)


def test_what_is_up_to_date_is_not_built_again(builder, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["build_native.py", "--stale"])
    monkeypatch.setattr(builder, "in_place", lambda: pytest.fail("it is"))
    assert builder.main() == 0
    built = []
    monkeypatch.setattr(builder, "is_stale", lambda: True)
    monkeypatch.setattr(builder, "in_place", lambda: built)
    assert builder.main() == 0


@pytest.mark.parametrize(
    ("system", "machine", "expected"),
    [
        ("linux-x86_64", "x86_64", "linux_x86_64"),
        ("macosx-11.0-universal2", "arm64", "macosx_11_0_arm64"),
        ("macosx-10.9-universal2", "x86_64", "macosx_10_9_x86_64"),
        ("win-amd64", "AMD64", "win_amd64"),
    ],
)
def test_a_wheel_for_this_machine_claims_this_machine_only(builder, monkeypatch, system, machine, expected):
    monkeypatch.setattr(builder.sysconfig, "get_platform", lambda: system)
    monkeypatch.setattr(builder.platform, "machine", lambda: machine)
    assert builder.tag("") == expected


def test_the_command_builds_for_another_system_into_a_folder_only():
    done = subprocess.run(
        [sys.executable, str(ROOT / "build_native.py"), "--target", "macos-arm64"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "needs a FOLDER" in done.stderr
