"""Folders of recordings: found below others, within limits, and told where they cannot be read."""

import os

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import CANNOT_READ, TOO_MUCH, folders_with, recordings


@pytest.fixture
def tree(tmp_path):
    for name in ("b/metadata", "a/deep/metadata", "a/other"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x")
    return tmp_path


def test_folders_that_hold_a_file_are_found_in_order(tree):
    assert folders_with(str(tree), "metadata") == [str(tree / "a" / "deep"), str(tree / "b")]
    assert folders_with(str(tree / "b" / "metadata"), "metadata") == []
    assert folders_with(str(tree / "nowhere"), "metadata") == []


@pytest.mark.parametrize(("most", "is_refused"), [(4, False), (3, True)])
def test_too_many_folders_are_refused(tree, monkeypatch, most, is_refused):
    monkeypatch.setattr(recordings, "MOST_FOLDERS", most)
    if not is_refused:
        assert len(folders_with(str(tree), "metadata")) == 2
        return
    with pytest.raises(HalpipeError) as failure:
        folders_with(str(tree), "metadata")
    assert [d.code for d in failure.value.diagnostics] == [TOO_MUCH.id]


def test_a_folder_that_cannot_be_read_is_told(tree, monkeypatch):
    scandir = os.scandir

    def refusing(path):
        if os.fspath(path).endswith("deep"):
            raise PermissionError(13, "Permission denied", os.fspath(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", refusing)
    with pytest.raises(HalpipeError) as failure:
        folders_with(str(tree), "metadata")
    (found,) = failure.value.diagnostics
    assert (found.code, found.at.file) == (CANNOT_READ.id, str(tree / "a" / "deep"))
