"""Machine code is kept for the next run, is taken from there only if it can be trusted, and needs no numba."""

import os
import subprocess
import sys

import pytest

from halpipe.exporters.native import format_model
from halpipe.pipeline.solve.kernel import machine_code
from halpipe.pipeline.solve.kernel.machine_code import VERSIONS, kept_or_made
from support import model, task, version

MADE = ("a_symbol", b"\x7fELF\n\x00 code")

SCHEDULE = """
import sys
from halpipe.cli import invoke
code = invoke(["schedule", sys.argv[1], "-q", "-o", sys.argv[2]])
print(code, "numba" in sys.modules)
"""


def function():
    """Stand for an entry point."""


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """Return the folder of the cache and a function that tells how often it had to be made."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    made = []

    def ask(layout="(x: integer)"):
        def make():
            made.append(1)
            return MADE

        assert kept_or_made(function, layout, make) == MADE
        return len(made)

    return tmp_path / "cache" / "halpipe" / "kernel", ask


def test_it_is_made_once(cache):
    folder, ask = cache
    assert [ask(), ask()] == [1, 1]
    (kept,) = folder.iterdir()
    assert kept.name.startswith("function-")
    assert kept.stat().st_mode & 0o777 == 0o600


@pytest.mark.parametrize("cut", [0, 1, 40, 64, 65, 70, -1])
def test_a_file_that_was_cut_off_is_made_again(cache, cut):
    folder, ask = cache
    ask()
    (kept,) = folder.iterdir()
    kept.write_bytes(kept.read_bytes()[:cut])
    assert [ask(), ask()] == [2, 2]


def test_a_file_with_another_byte_is_made_again(cache):
    folder, ask = cache
    ask()
    (kept,) = folder.iterdir()
    kept.write_bytes(kept.read_bytes()[:-1] + b"!")
    assert ask() == 2


def test_what_others_can_write_is_not_used(cache):
    folder, ask = cache
    ask()
    (kept,) = folder.iterdir()
    kept.chmod(0o622)
    assert ask() == 2


def test_without_a_cache_it_is_made_each_time(cache):
    folder, ask = cache
    folder.parent.parent.write_text("in the way")
    assert [ask(), ask()] == [1, 2]


def test_arguments_of_another_layout_need_another_version(cache):
    _, ask = cache
    assert [ask("(x: integer)"), ask("(y: integer)"), ask("(x: integer)")] == [1, 2, 2]


def test_other_sources_and_processors_have_other_names(cache, monkeypatch):
    folder, ask = cache
    ask()
    machine_code._version.cache_clear()
    monkeypatch.setattr(machine_code.llvm, "get_host_cpu_name", lambda: "another")
    assert ask() == 2
    machine_code._version.cache_clear()
    assert len(list(folder.iterdir())) == 2


def test_old_versions_are_forgotten(cache):
    folder, ask = cache
    folder.mkdir(parents=True, mode=0o700)
    for number in range(2 * VERSIONS):
        old = folder / f"function-{number}.o"
        old.write_bytes(b"")
        os.utime(old, (number, number))
    (folder / "other-1.o").write_bytes(b"")
    ask()
    kept = {path.name for path in folder.iterdir()}
    assert len(kept) == VERSIONS + 1
    assert {"other-1.o", f"function-{2 * VERSIONS - 1}.o"} < kept


def test_a_schedule_needs_no_numba_once_the_kernel_is_compiled(tmp_path):
    model_file = tmp_path / "model.xml"
    model_file.write_bytes(format_model(model(task("a", "5ms", version("v", "1ms", "u1")))))
    run = [sys.executable, "-c", SCHEDULE, str(model_file), str(tmp_path / "schedule.xml")]
    said = [subprocess.run(run, capture_output=True, text=True, check=True).stdout.split() for _ in range(2)]
    assert said[1] == ["0", "False"]
