"""The cache holds what can be made again, and only what nobody else can have put there is taken from it."""

import os

import pytest

from halpipe.core.caches import cache_folder, is_ours, keep, why_no_cache


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return cache_folder("things")


def test_the_folder_is_private_and_named_after_what_it_holds(folder, tmp_path):
    assert folder == tmp_path / "cache" / "halpipe" / "things"
    assert folder.stat().st_mode & 0o777 == 0o700


def test_without_the_variable_it_is_in_the_home_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_folder("things") == tmp_path / ".cache" / "halpipe" / "things"


def test_a_relative_variable_has_no_meaning(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", "here")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder("things") == tmp_path / "home" / ".cache" / "halpipe" / "things"
    assert not (tmp_path / "here").exists()


def test_without_a_home_there_is_none_and_it_is_said(monkeypatch):
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "nowhere")
    assert cache_folder("things") is None
    assert "XDG_CACHE_HOME" in why_no_cache("things")


def test_a_home_that_cannot_be_written_to_is_said(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    assert cache_folder("things") is None
    assert "cannot be made" in why_no_cache("things")


def test_a_folder_above_that_others_can_write_to_is_said(folder):
    assert why_no_cache("things") == ""
    folder.parent.chmod(0o777)
    assert cache_folder("things") is None
    assert "chmod" in why_no_cache("things")


@pytest.mark.parametrize("mode", [0o770, 0o707, 0o722])
def test_a_folder_that_others_can_write_to_is_none(folder, mode):
    folder.chmod(mode)
    assert cache_folder("things") is None


@pytest.mark.parametrize(("executable", "mode"), [(False, 0o600), (True, 0o700)])
def test_what_is_kept_is_there_for_its_user_only(folder, executable, mode):
    assert keep(folder / "thing", b"content", executable=executable)
    assert (folder / "thing").read_bytes() == b"content"
    assert (folder / "thing").stat().st_mode & 0o777 == mode
    assert is_ours(folder / "thing")
    assert [path.name for path in folder.iterdir()] == ["thing"]


def test_a_link_is_not_ours_wherever_it_leads(folder, tmp_path):
    keep(folder / "thing", b"content")
    (folder / "link").symlink_to(folder / "thing")
    assert not is_ours(folder / "link")


def test_a_file_of_another_user_is_not_ours(folder, monkeypatch):
    keep(folder / "thing", b"content")
    monkeypatch.setattr(os, "getuid", lambda: os.stat(folder).st_uid + 1)
    assert not is_ours(folder / "thing")


def test_nothing_there_is_not_ours(folder):
    assert not is_ours(folder / "thing")


def test_what_cannot_be_kept_is_told_and_leaves_nothing_behind(folder):
    assert not keep(folder / "missing" / "thing", b"content")
    (folder / "taken").mkdir()
    (folder / "taken" / "inside").write_bytes(b"")
    assert not keep(folder / "taken", b"content")
    assert sorted(path.name for path in folder.iterdir()) == ["taken"]


def test_where_the_system_has_no_user_ids_a_folder_is_private(folder, monkeypatch):
    keep(folder / "thing", b"content")
    (folder / "thing").chmod(0o666)
    assert not is_ours(folder / "thing")
    monkeypatch.delattr(os, "getuid")
    assert is_ours(folder / "thing")
