"""Folders are written as a whole: the old one stays until the new one is complete, and foreign ones stay for good."""

import hashlib
import json
import os

import pytest

from halpipe.core.bundles import seal
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import CANNOT_WRITE, FOREIGN_FOLDER, write_directory

OLD = seal("k", {"a": b"old", "sub/b": b"old"}, {})
NEW = seal("k", {"a": b"new", "sub/deep/c": b"new"}, {})


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


@pytest.mark.skipif(os.name == "nt", reason="the mode of a file is one of POSIX")
def test_programs_of_a_folder_can_be_started(tmp_path):
    write_directory(str(tmp_path / "out"), seal("k", {"run.sh": b"#!/bin/sh\n", "text": b"#\n"}, {}))
    assert [os.access(tmp_path / "out" / name, os.X_OK) for name in ("run.sh", "text")] == [True, False]
    assert os.stat(tmp_path / "out" / "text").st_mode & 0o111 == 0


def test_a_folder_of_somebody_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(tmp_path), NEW)
    assert [d.code for d in refused.value.diagnostics] == [FOREIGN_FOLDER.id]
    assert contents(tmp_path) == {"thesis.tex": b"years of work"}


MANIFESTS = {
    "none": None,
    "no content": b"",
    "no JSON": b"years of work",
    "an empty object": b"{}",
    "a list": b'["halpipe-bundle"]',
    "another program's": json.dumps({"name": "site", "files": {"thesis.tex": "0"}}).encode(),
    "a version that is no number": json.dumps({"halpipe-bundle": "1", "files": {"thesis.tex": "0"}}).encode(),
    "no files": json.dumps({"halpipe-bundle": 1}).encode(),
    "files that are a list": json.dumps({"halpipe-bundle": 1, "files": ["thesis.tex"]}).encode(),
    "without end": b"[" * 100_000,
}


@pytest.mark.parametrize("kind", MANIFESTS)
def test_a_manifest_is_known_by_its_content(tmp_path, kind):
    target = tmp_path / "web"
    target.mkdir()
    (target / "thesis.tex").write_text("years of work")
    if MANIFESTS[kind] is not None:
        (target / "manifest.json").write_bytes(MANIFESTS[kind])
    before = contents(target)
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(target), NEW)
    (found,) = refused.value.diagnostics
    assert (found.code, found.at.file) == (FOREIGN_FOLDER.id, str(target))
    assert '"thesis.tex"' in found.message
    assert contents(target) == before
    assert os.listdir(tmp_path) == ["web"]


@pytest.mark.skipif(os.name == "nt", reason="links need a right there that users do not have")
def test_a_manifest_that_is_a_link_claims_nothing(tmp_path):
    write_directory(str(tmp_path / "own"), OLD)
    target = tmp_path / "web"
    target.mkdir()
    (target / "a").write_text("years of work")
    (target / "manifest.json").symlink_to(tmp_path / "own" / "manifest.json")
    with pytest.raises(HalpipeError, match="did not write") as refused:
        write_directory(str(target), NEW)
    assert '"a", "manifest.json"' in refused.value.diagnostics[0].message
    assert (target / "a").read_text() == "years of work"


ADDITIONS = {
    "a file": "notes.txt",
    "a file below": "sub/notes.txt",
    "a folder of its own": "mine/notes.txt",
    "a hidden file": ".git",
    "a name like a listed one": "A",
}


@pytest.mark.parametrize("kind", ADDITIONS)
def test_what_was_added_to_a_bundle_stops_the_export_and_is_named(tmp_path, kind):
    target = tmp_path / "out"
    write_directory(str(target), OLD)
    added = target / ADDITIONS[kind]
    added.parent.mkdir(exist_ok=True)
    added.write_text("mine")
    before = contents(target)
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(target), NEW)
    (found,) = refused.value.diagnostics
    assert found.code == FOREIGN_FOLDER.id
    assert (
        f'"{ADDITIONS[kind].split("notes")[0] if kind == "a folder of its own" else ADDITIONS[kind]}"' in found.message
    )
    assert contents(target) == before
    assert os.listdir(tmp_path) == ["out"]


def test_many_additions_are_counted(tmp_path):
    target = tmp_path / "out"
    write_directory(str(target), OLD)
    for number in range(30):
        (target / f"note-{number:02}").touch()
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(target), NEW)
    assert '"note-00"' in refused.value.diagnostics[0].message
    assert "and 25 more" in refused.value.diagnostics[0].message


@pytest.mark.parametrize("of", ["a folder", "a file"])
def test_a_link_in_a_bundle_is_an_addition_and_what_it_names_stays(tmp_path, of):
    target, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    write_directory(str(target), OLD)
    elsewhere.mkdir()
    (elsewhere / "b").write_text("precious")
    (target / "link").symlink_to(elsewhere if of == "a folder" else elsewhere / "b")
    with pytest.raises(HalpipeError):
        write_directory(str(target), NEW)
    assert contents(elsewhere) == {"b": b"precious"}


def test_in_a_folder_of_the_user_nothing_more_is_looked_for(tmp_path):
    target = tmp_path / "out"
    write_directory(str(target), OLD)
    (target / "mine" / "deep").mkdir(parents=True)
    (target / "mine" / "deep" / "x").touch()
    with pytest.raises(HalpipeError, match='there: "mine/"; it is') as refused:
        write_directory(str(target), NEW)
    assert refused.value.diagnostics[0].code == FOREIGN_FOLDER.id


def test_a_listed_folder_that_became_a_link_is_not_followed(tmp_path):
    target, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    write_directory(str(target), OLD)
    (target / "sub" / "b").unlink()
    (target / "sub").rmdir()
    elsewhere.mkdir()
    (elsewhere / "b").write_text("precious")
    (target / "sub").symlink_to(elsewhere)
    with pytest.raises(HalpipeError):
        write_directory(str(target), NEW)
    assert contents(elsewhere) == {"b": b"precious"}


def test_a_note_that_arrives_during_the_export_is_kept(tmp_path, monkeypatch):
    target = tmp_path / "out"
    write_directory(str(target), OLD)
    rename = os.rename

    def late(source, destination):
        if source == str(target):
            (target / "sub" / "note").write_text("mine")
        rename(source, destination)

    monkeypatch.setattr(os, "rename", late)
    write_directory(str(target), NEW)
    monkeypatch.undo()
    assert contents(target) == NEW
    (kept,) = (path for path in tmp_path.rglob("note"))
    assert kept.read_text() == "mine"
    with pytest.raises(HalpipeError) as refused:  # and the next run does not remove it either, but says where it is
        write_directory(str(target), OLD)
    assert str(kept.parent.parent) in refused.value.diagnostics[0].at.file
    assert kept.read_text() == "mine"


def test_a_folder_of_the_user_beside_the_target_is_none_of_ours(tmp_path):
    (tmp_path / ".out.former").mkdir()
    (tmp_path / ".out.former" / "thesis.tex").write_text("years of work")
    write_directory(str(tmp_path / "out"), OLD)
    write_directory(str(tmp_path / "out"), NEW)
    assert contents(tmp_path / ".out.former") == {"thesis.tex": b"years of work"}


def test_targets_whose_names_begin_alike_do_not_mix(tmp_path, monkeypatch):
    one, other = (str(tmp_path / ("x" * 200 + end)) for end in "ab")
    write_directory(one, OLD)
    rename, calls = os.rename, []

    def killed(source, destination):
        rename(source, destination)
        calls.append(destination)
        if source == one:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "rename", killed)
    with pytest.raises(KeyboardInterrupt):
        write_directory(one, NEW)
    monkeypatch.undo()
    write_directory(other, NEW)
    assert not os.path.exists(one)
    write_directory(one, NEW)
    assert contents(tmp_path / ("x" * 200 + "a")) == NEW


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
        monkeypatch.setattr(os, "rename", no_rename)
    else:
        monkeypatch.setattr(os, fatal, fail)
    with pytest.raises(HalpipeError) as refused:
        write_directory(str(target), NEW)
    monkeypatch.undo()
    assert [d.code for d in refused.value.diagnostics] == [CANNOT_WRITE.id]
    assert contents(target) == OLD
    assert os.listdir(tmp_path) == ["out"]


@pytest.mark.parametrize("name", ["out", "n" * 60])
def test_what_a_killed_run_left_is_mended(tmp_path, name):
    target = tmp_path / name
    write_directory(str(target), OLD)
    digest = hashlib.sha256(name.encode()).hexdigest()[:8]
    target.rename(tmp_path / f".{name[:40]}.{digest}.former")  # killed between two renames
    (tmp_path / f".{name[:50]}.999999999-abcd.halpipe-tmp").mkdir()
    write_directory(str(target), NEW)
    assert contents(target) == NEW
    assert os.listdir(tmp_path) == [name]


def test_a_manifest_that_names_files_elsewhere_removes_none_of_them(tmp_path):
    target, victim = tmp_path / "out", tmp_path / "victim"
    victim.write_text("precious")
    target.mkdir()
    stated = {"halpipe-bundle": 1, "files": {"../victim": "0", str(victim): "0", "a": "0"}}
    (target / "manifest.json").write_text(json.dumps(stated))
    (target / "a").touch()
    write_directory(str(target), NEW)
    assert contents(target) == NEW
    assert victim.read_text() == "precious"
