"""What a command has read, it does not write to, by whatever name; outside of a command, the caller decides."""

import os

import pytest

from halpipe.core.bundles import seal
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.files import (
    OUTPUT_IS_INPUT,
    protecting_inputs,
    read_bytes,
    read_own,
    refuse_inputs,
    refuse_name,
    write_directory,
    write_output,
)


@pytest.fixture
def source(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "model.xml"
    path.write_bytes(b"precious")
    (tmp_path / "below").mkdir()
    (tmp_path / "link.xml").symlink_to(path)
    (tmp_path / "folder").symlink_to(tmp_path)
    os.link(path, tmp_path / "hard.xml")
    return path


SPELLINGS = ["model.xml", "./model.xml", "below/../model.xml", "link.xml", "folder/model.xml", "hard.xml"]


@pytest.mark.parametrize("written", [*SPELLINGS, "absolute"])
@pytest.mark.parametrize("read", SPELLINGS)
def test_an_input_is_not_written_to_by_any_name(source, read, written):
    target = str(source) if written == "absolute" else written
    with protecting_inputs():
        read_bytes(read)
        with pytest.raises(HalpipeError) as refused:
            write_output(target, b"new")
    (found,) = refused.value.diagnostics
    assert (found.code, found.at.file, refused.value.exit) == (OUTPUT_IS_INPUT.id, target, Exit.USAGE)
    assert f'"{read}"' in found.message
    assert source.read_bytes() == b"precious"


def test_a_bundle_that_was_read_from_is_not_replaced(source, tmp_path):
    bundle = tmp_path / "bundle"
    write_directory(str(bundle), seal("k", {"sub/a": b"precious"}, {}))
    with protecting_inputs():
        read_bytes(bundle / "sub" / "a")
        with pytest.raises(HalpipeError) as refused:
            write_directory("bundle", seal("k", {"sub/a": b"new"}, {}))
    assert [d.code for d in refused.value.diagnostics] == [OUTPUT_IS_INPUT.id]
    assert (bundle / "sub" / "a").read_bytes() == b"precious"


def test_two_outputs_are_not_one_file(source):
    with protecting_inputs():
        refuse_inputs("new.xml", "other.xml", "-")
        with pytest.raises(HalpipeError) as refused:
            refuse_inputs("new.xml", "other.xml", "below/../new.xml", "-", "-")
    assert [d.at.file for d in refused.value.diagnostics] == ["below/../new.xml", "-"]
    assert refused.value.exit is Exit.USAGE


def test_other_files_and_devices_are_written_to(source):
    with protecting_inputs():
        read_bytes(source)
        read_bytes("/dev/null")
        write_output("/dev/null", b"new")
        write_output("new.xml", b"new")
        write_output("new.xml", b"newer")
    assert read_bytes("new.xml") == b"newer"


def test_what_halpipe_keeps_for_itself_is_written_again(source):
    with protecting_inputs():
        read_own("model.xml")
        write_output("model.xml", b"new")
    assert source.read_bytes() == b"new"


def test_outside_of_a_command_a_file_is_edited_in_place(source):
    with protecting_inputs():
        read_bytes(source)
    read_bytes(source)
    write_output(source, b"new")
    assert source.read_bytes() == b"new"


@pytest.mark.parametrize(
    ("outer", "inner"), [("b", "b/s.xml"), ("s.xml", "below/../s.xml/x/y"), ("link.xml", "model.xml/x")]
)
def test_no_output_lies_in_another(source, outer, inner):
    """A folder is replaced as a whole, and a file has nothing in it: one of both would fail after the search."""
    for targets in ((outer, inner), (inner, outer)):
        with pytest.raises(HalpipeError, match="lies in the output") as refused:
            refuse_inputs(*targets)
        assert [found.at.file for found in refused.value.diagnostics] == [inner]
    refuse_inputs("", inner, f"{outer}x")


@pytest.mark.parametrize(
    ("target", "endings", "help"),
    [
        ("a/s.json", (".xml", ".amxmi"), "name it s.xml"),
        ("s.XML", (".json",), "name it s.json"),
        ("s.xml", (".html", ".xml"), ""),
        ("s.XML", (".xml",), ""),
        ("s.out", (".xml",), ""),
        ("s", (".xml",), ""),
        ("s.json", (), ""),
    ],
)
def test_a_name_with_the_ending_of_another_format_is_refused(target, endings, help):
    if not help:
        refuse_name(target, *endings)
        return
    with pytest.raises(HalpipeError) as refused:
        refuse_name(target, *endings)
    (found,) = refused.value.diagnostics
    assert (found.at.file, found.help, refused.value.exit) == (target, help, Exit.USAGE)
    assert found.message.endswith(f'one of those that end in "{endings[0]}"')


def test_a_name_with_a_null_character_is_refused(source):
    with pytest.raises(HalpipeError) as refused:
        write_output("a\0b", b"")
    assert [found.code for found in refused.value.diagnostics] == ["HAL0003"]
