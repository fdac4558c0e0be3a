"""A library in C is used only if it was built from the sources that lie beside it."""

import shutil
from pathlib import Path

import pytest

from halpipe.core import libraries
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.libraries import NOT_BUILT, SUFFIX, fingerprint, library
from halpipe.pipeline.solve.kernel.kernel import SOURCES


@pytest.fixture
def copied(tmp_path):
    """The sources of the kernel and its library, in another folder."""
    return Path(shutil.copytree(SOURCES, tmp_path / "native"))


def refused(folder, name="kernel"):
    with pytest.raises(HalpipeError) as failure:
        library(folder, name)
    (found,) = failure.value.diagnostics
    assert found.code == NOT_BUILT.id
    return found


def test_a_library_of_the_same_sources_is_loaded(copied):
    assert library(copied, "kernel").halpipe_anneal


@pytest.mark.parametrize("change", ["edited", "added", "renamed"])
def test_a_library_of_other_sources_is_refused_with_the_command_that_builds_it(copied, change):
    if change == "edited":
        with (copied / "lanes.h").open("a") as header:
            header.write("/* one more */\n")
    elif change == "added":
        (copied / "more.h").write_text("")
    else:
        (copied / "lanes.h").rename(copied / "tracks.h")
    found = refused(copied)
    assert "other sources" in found.message
    assert "build_native.py" in found.help


def test_a_library_that_is_not_there_is_refused(copied):
    (copied / f"kernel{SUFFIX}").unlink()
    assert "cannot be loaded" in refused(copied).message


def test_something_else_is_refused(copied):
    (copied / f"kernel{SUFFIX}").write_bytes(b"no library at all")
    assert "cannot be loaded" in refused(copied).message


def test_what_is_installed_has_to_be_installed_again(copied, monkeypatch, tmp_path):
    monkeypatch.setattr(libraries, "BUILDER", tmp_path / "build_native.py")
    (copied / "more.h").write_text("")
    assert refused(copied).help == "install halpipe again"


def test_ends_of_lines_are_all_the_same(copied):
    before = fingerprint(copied)
    for source in [*copied.glob("*.c"), *copied.glob("*.h")]:
        source.write_bytes(source.read_bytes().replace(b"\n", b"\r\n"))
    assert fingerprint(copied) == before


def test_a_command_says_so_without_a_traceback(halpipe_without_kernel):
    done = halpipe_without_kernel
    assert done.returncode == 1
    assert NOT_BUILT.id in done.stderr
    assert "build_native.py" in done.stderr


@pytest.fixture
def halpipe_without_kernel(tmp_path, monkeypatch):
    from command_line import run_here
    from halpipe.exporters.native import format_model
    from halpipe.pipeline.solve.kernel import kernel as border
    from support import model, task, version

    (tmp_path / "model.xml").write_bytes(format_model(model(task("t", 10, version("v", 1)))))
    monkeypatch.setattr(border, "SOURCES", tmp_path)
    return run_here(tmp_path, "schedule", "model.xml", "-o", "s.xml")
