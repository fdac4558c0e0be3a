"""Programs that cannot be started: the first ones of each verb fail in turn, for the reasons that a system has."""

import errno
import os
import shutil
import subprocess
from pathlib import Path

import pytest

from command_line import run_here
from halpipe.core import programs

ROOT = Path(__file__).parents[2]
FAILURES = [(1, errno.EAGAIN), (1, errno.ENOENT), (2, errno.EACCES), (3, errno.ENOMEM)]
"""Which start of a verb fails, and why."""

VERBS = {
    "export graph": ("export graph out/model.xml out/schedule.xml -o out/new.svg -q", ["dot"], "out/new.svg"),
    "export riscv": (
        "export riscv out/model.xml out/schedule.xml --sources . -o out/new -q",
        ["zig"],
        "out/new",
    ),
    "deploy prepare": ("deploy prepare out/model.xml --sources . -o out/new.xml -q", ["zig"], "out/new.xml"),
    "deploy check of Linux": ("deploy check out/linux", ["cc", "make"], ""),
    "deploy check by QEMU": ("deploy check out/bundle --engine qemu", ["zig", "qemu-system-riscv64"], ""),
    "deploy check by Verilator": ("deploy check out/regulator --engine verilator", ["verilator"], ""),
}


def is_there(program):
    if program == "zig":
        return bool(pytest.importorskip("ziglang", reason="pip install ziglang pyelftools unicorn"))
    return shutil.which(program) is not None


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("programs")
    shutil.copytree(ROOT / "examples" / "roboracer", folder / "w", ignore=shutil.ignore_patterns("out"))
    shutil.copytree(ROOT / "examples" / "platforms", folder / "platforms")
    assert run_here(folder / "w", "run", "pipeline.yaml", "-q").returncode == 0
    pair = ["out/model.xml", "out/schedule.xml", "--sources", ".", "-q"]
    assert run_here(folder / "w", "export", "linux", *pair, "-o", "out/linux").returncode == 0
    if is_there("zig"):
        run_here(folder / "w", "export", "riscv", *pair, "--profile", "fu540", "-o", "out/bundle")
    return folder / "w"


class Starts:
    """Counts the starts of programs; the `fatal`-th does not succeed."""

    def __init__(self, fatal, code):
        self.fatal, self.code, self.count = fatal, code, 0

    def patch(self, monkeypatch):
        starts = self

        class Popen(subprocess.Popen):
            def __init__(self, *arguments, **options):
                starts.count += 1
                if starts.count == starts.fatal:
                    raise OSError(starts.code, os.strerror(starts.code))
                super().__init__(*arguments, **options)

        monkeypatch.setattr(subprocess, "Popen", Popen)


@pytest.mark.slow  # test_a_program_that_cannot_be_started_is_named is the quick one
@pytest.mark.parametrize("verb", VERBS)
def test_whichever_start_fails_it_is_told_and_nothing_is_written(place, monkeypatch, verb):
    command, needed, output = VERBS[verb]
    for program in needed:
        if not is_there(program):
            pytest.skip(f"{program} is not installed")
    for number, code in FAILURES:
        with monkeypatch.context() as patched:
            starts = Starts(number, code)
            starts.patch(patched)
            run = run_here(place, *command.split())
        if starts.count < number:
            assert number > 1, "it starts a program"
            return
        assert run.returncode == 1, (number, code, run.stderr)
        assert "error[HAL" in run.stderr, (number, code)
        assert "correct the source" not in run.stderr, "nothing is wrong with them"
        assert not output or not (place / output).exists()


@pytest.mark.parametrize("code", [errno.ENOENT, errno.EAGAIN, errno.EACCES])
def test_a_program_that_cannot_be_started_is_named(monkeypatch, code):
    Starts(1, code).patch(monkeypatch)
    with pytest.raises(Exception, match="tool cannot be started") as failure:
        programs.run(["/somewhere/tool", "--version"])
    (found,) = failure.value.diagnostics
    assert (found.code, os.strerror(code) in found.message) == (programs.NOT_STARTED.id, True)


def test_what_a_program_says_is_text_whatever_it_is():
    done = programs.run(["sh", "-c", r"printf '\377\n'; exit 3"])
    assert (done.returncode, done.stdout) == (3, "�\n")
    with pytest.raises(programs.TimeoutExpired):
        programs.run(["sleep", "5"], seconds=0.05)
