"""Bundles: what is sealed opens as it was, and nothing that was changed since opens at all."""

import hashlib
import json
import os

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.bundles import CHANGED_FILE, NOT_A_BUNDLE, open_bundle, seal
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory

FILES = {"model.xml": b"<m/>", "schedule.xml": b"<s/>", "rtl/unit.v": b"module", "empty.bin": b""}


@pytest.fixture
def folder(tmp_path):
    path = tmp_path / "cfg"
    write_directory(str(path), seal("regulator", FILES, {"platform": "zcu102"}))
    return path


def refusal(path):
    with pytest.raises(HalpipeError) as refused:
        open_bundle(str(path))
    return refused.value.diagnostics


def test_a_bundle_opens_as_it_was_sealed(folder):
    bundle = open_bundle(f"{folder}/")
    assert (bundle.kind, dict(bundle.facts), dict(bundle.files)) == ("regulator", {"platform": "zcu102"}, FILES)
    assert bundle.at("rtl/unit.v", 3).file == f"{folder}/rtl/unit.v"


@given(st.dictionaries(st.from_regex(r"[a-z0-9_]{1,8}(/[a-z0-9_]{1,8})?", fullmatch=True), st.binary(max_size=9)))
def test_the_seal_does_not_depend_on_the_order_of_the_files(files):
    assert list(seal("k", files, {}).items()) == list(seal("k", dict(reversed(files.items())), {}).items())


@pytest.mark.parametrize("name", ["../x", "/x", "a//b", ".hidden", "manifest.json", ""])
def test_no_file_of_a_bundle_lies_elsewhere_or_is_its_manifest(name):
    with pytest.raises(AssertionError, match="names of a bundle are relative"):
        seal("k", {"a": b"", name: b""}, {})


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
@pytest.mark.parametrize("name", ["manifest.json", "schedule.xml", "rtl/unit.v"])
def test_a_pipe_in_a_bundle_is_refused_and_not_waited_for(folder, name):
    (folder / name).unlink()
    os.mkfifo(folder / name)
    assert [(d.code, d.message) for d in refusal(folder)] == [("HAL0001", "is no plain file")]


def test_every_changed_or_missing_file_is_named(folder):
    (folder / "schedule.xml").write_bytes(b"<t/>")
    (folder / "rtl" / "unit.v").unlink()
    found = refusal(folder)
    assert sorted((d.code, d.at.file.removeprefix(f"{folder}/")) for d in found) == [
        ("HAL0001", "rtl/unit.v"),
        (CHANGED_FILE.id, "schedule.xml"),
    ]
    is_now, was = (hashlib.sha256(text).hexdigest()[:16] for text in (b"<t/>", b"<s/>"))
    assert f"SHA-256 is {is_now}..., the manifest states {was}..." in [d.message for d in found]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"halpipe-bundle": 2}, '"halpipe-bundle": 1'),
        ({"halpipe-bundle": True}, '"halpipe-bundle": 1'),
        ({"halpipe-bundle": "1"}, '"halpipe-bundle": 1'),
        ({"kind": 1}, 'lacks "kind"'),
        ({"kind": None}, 'lacks "kind"'),
        ({"files": []}, 'lacks "kind" or "files"'),
        ({"files": {"../etc": "0"}}, "no file inside"),
        ({"files": {"/etc/passwd": "0"}}, "no file inside"),
        ({"files": {"a/../../b": "0"}}, "no file inside"),
        ({"files": {"a": 1}}, "no file inside"),
        ({"files": {"a": "0"}}, "lists no model.xml"),
    ],
)
def test_a_manifest_that_is_none(folder, change, message):
    manifest = json.loads((folder / "manifest.json").read_bytes())
    (folder / "manifest.json").write_text(json.dumps(manifest | change))
    found = refusal(folder)
    assert {d.code for d in found} == {NOT_A_BUNDLE.id}
    assert message in found[0].message


@pytest.mark.parametrize("text", ["", "{", "[]", "[" * 100_000, '"x"', "\xff"])
def test_a_manifest_that_is_no_json(folder, text):
    (folder / "manifest.json").write_bytes(text.encode("latin-1"))
    assert [d.code for d in refusal(folder)] == [NOT_A_BUNDLE.id]


def test_a_manifest_that_repeats_a_key(folder):
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"kind"', '"kind": "linux", "kind"', 1))
    assert [d.message for d in refusal(folder)] == ['the manifest is no JSON: the key "kind" is repeated']


def test_a_folder_whose_manifest_repeats_a_key_is_not_replaced(folder):
    manifest = folder / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"files"', '"files": {}, "files"', 1))
    with pytest.raises(HalpipeError, match="did not write"):
        write_directory(str(folder), seal("regulator", FILES, {}))


def test_a_folder_without_a_manifest(tmp_path):
    [found] = refusal(tmp_path)
    assert (found.code, found.message) == ("HAL1001", "the folder has no such file")
    assert "halpipe export" in found.help
