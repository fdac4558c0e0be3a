"""Folders are written as a whole: the old one stays until the new one is complete, and foreign ones stay for good."""

import os

import pytest

from halpipe import files
from halpipe.diagnostics import HalpipeError
from halpipe.files import CANNOT_WRITE, FOREIGN_FOLDER, write_directory

OLD = {"manifest.json": b"{}", "a": b"old", "sub/b": b"old"}
NEW = {"manifest.json": b"{}", "a": b"new", "sub/deep/c": b"new"}


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize("before", [None, {}, OLD])
def test_the_folder_has_the_new_files_and_no_others(tmp_path, before):
    target = tmp_path / "deep" / "out"
    if before is not None:
        target.mkdir(parents=True)
    if before:
        write_directory(str(target), before)
    write_directory(f"{target}/", NEW)
    assert contents(target) == NEW
    assert os.listdir(target.parent) == ["out"]


def test_a_folder_of_somebody_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(tmp_path), NEW)
    assert [d.code for d in refused.value.diagnostics] == [FOREIGN_FOLDER.id]
    assert contents(tmp_path) == {"thesis.tex": b"years of work"}


def test_a_file_is_no_folder(tmp_path):
    (tmp_path / "out").write_text("x")
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(tmp_path / "out"), NEW)
    assert [d.code for d in refused.value.diagnostics] == [FOREIGN_FOLDER.id]


@pytest.mark.parametrize("fatal", ["mkdir", "fsync", "second rename"])
def test_whatever_fails_the_old_folder_stays(tmp_path, monkeypatch, fatal):
    target = tmp_path / "out"
    write_directory(str(target), OLD)
    rename = os.rename

    def no_rename(source, destination):
        if destination == str(target) and not source.endswith("former"):
            raise OSError(28, "No space left on device")
        rename(source, destination)

    def fail(*_args, **_more):
        raise OSError(28, "No space left on device")

    if fatal == "second rename":
        monkeypatch.setattr(files.os, "rename", no_rename)
    else:
        monkeypatch.setattr(files.os, fatal, fail)
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(target), NEW)
    monkeypatch.undo()
    assert [d.code for d in refused.value.diagnostics] == [CANNOT_WRITE.id]
    assert contents(target) == OLD
    assert os.listdir(tmp_path) == ["out"]


def test_what_a_killed_run_left_is_mended(tmp_path):
    target = tmp_path / "out"
    write_directory(str(target), OLD)
    target.rename(tmp_path / ".out.former")  # killed between the two renames
    (tmp_path / ".out.999999999-abcd.halpipe-tmp").mkdir()
    write_directory(str(target), NEW)
    assert contents(target) == NEW
    assert os.listdir(tmp_path) == ["out"]
