"""Files that halpipe keeps, makes beside others, or reads in parts; temporary folders."""

import errno
import io
import os
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import reading, scratch, writing
from halpipe.core.files.folders import make_folder, write_new_folder
from halpipe.core.files.reading import (
    CANNOT_READ,
    TOO_MUCH,
    beginning_of,
    input_size,
    is_ended,
    is_folder_without,
    open_input,
    read_own,
    read_plain,
    refuse_more_than,
)
from halpipe.core.files.recordings import mapped, plain_files
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.files.writing import CANNOT_WRITE, FOREIGN_FILE, refuse_foreign, remove_output, write_beside
from halpipe.core.files.xml import BROKEN_XML, LargeXmlParser, advice_for, parse_xml

posix = pytest.mark.skipif(os.name != "posix", reason="there are no pipes and links")


def refusal(action, *given):
    with pytest.raises(HalpipeError) as refused:
        action(*given)
    (found,) = refused.value.diagnostics
    return found


# ------------------------------------------------------------------------------------------------ scratch


@posix
def test_a_scratch_folder_goes_with_all_that_was_put_into_it(tmp_path):
    kept = tmp_path / "kept"
    kept.mkdir()
    (kept / "file").write_text("x")
    with scratch_folder() as folder:
        inner = Path(folder, "a", "b")
        inner.mkdir(parents=True)
        (inner / "file").write_text("x")
        Path(folder, "link").symlink_to(kept)
        (inner / "dangling").symlink_to(tmp_path / "none")
    assert not os.path.lexists(folder)
    assert (kept / "file").read_text() == "x"


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS])
def test_want_of_room_for_temporary_files_is_told(monkeypatch, number):
    def fill():
        with scratch_folder() as folder:
            fill.folder = folder
            raise OSError(number, os.strerror(number))

    found = refusal(fill)
    assert (found.code, found.message) == (CANNOT_WRITE.id, f"temporary files cannot be written: {os.strerror(number)}")
    assert not os.path.exists(fill.folder)
    monkeypatch.setattr("tempfile.mkdtemp", lambda prefix: (_ for _ in ()).throw(OSError(number, "no")))
    assert refusal(fill).message == "temporary files cannot be written: no"


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE])
def test_too_many_open_files_are_no_want_of_room(monkeypatch, number):
    monkeypatch.setattr("tempfile.mkdtemp", lambda prefix: (_ for _ in ()).throw(OSError(number, "no")))
    with pytest.raises(OSError, match="no"), scratch_folder():
        pass


def test_other_faults_pass_a_scratch_folder_and_it_is_removed():
    with pytest.raises(PermissionError), scratch_folder() as folder:
        raise PermissionError(errno.EACCES, "no")
    assert not os.path.exists(folder)
    assert scratch._NO_ROOM


# ------------------------------------------------------------------------------------------------ beside others


def test_a_file_beside_an_output_replaces_none_of_another_making(tmp_path):
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    write_beside({one: b"# ours\n1\n", two: b"# ours\n2\n"}, one)
    write_beside({one: b"# ours\n3\n", two: b"# ours\n4\n"}, one)
    assert (Path(one).read_bytes(), Path(two).read_bytes()) == (b"# ours\n3\n", b"# ours\n4\n")
    for path in (one, two):
        Path(path).write_bytes(b"# mine\n")
    found = refusal(lambda: write_beside({one: b"# ours\n5\n", two: b"# ours\n6\n"}, one))
    assert (found.code, found.at) == (FOREIGN_FILE.id, Location(two))
    assert (Path(one).read_bytes(), Path(two).read_bytes()) == (b"# mine\n", b"# mine\n")
    write_beside({one: b"# ours\n5\n", two: b"# ours\n6\n"}, one, two)
    assert Path(two).read_bytes() == b"# ours\n6\n"


def test_a_folder_is_no_file_of_ours(tmp_path):
    refuse_foreign(str(tmp_path / "none"), lambda data: False)
    assert refusal(refuse_foreign, str(tmp_path), lambda data: True).code == FOREIGN_FILE.id


def test_removing_an_output_that_is_not_there_is_no_fault(tmp_path):
    path = tmp_path / "x"
    path.write_text("x")
    for _ in range(2):
        remove_output(str(path))
        assert not path.exists()


# ------------------------------------------------------------------------------------------------ folders


def test_a_folder_is_made_with_those_above_it_and_may_be_there(tmp_path):
    path = tmp_path / "a" / "b"
    for _ in range(2):
        make_folder(str(path))
        assert path.is_dir()
    (tmp_path / "file").write_text("x")
    assert refusal(make_folder, str(tmp_path / "file")).code == CANNOT_WRITE.id
    assert refusal(make_folder, str(tmp_path / "a\0b")).code == CANNOT_WRITE.id


def test_a_new_folder_was_not_there_or_was_empty(tmp_path):
    for name in ("new", "empty"):
        (tmp_path / "empty").mkdir(exist_ok=True)
        write_new_folder(str(tmp_path / name), {"a/b.txt": b"x"})
        assert (tmp_path / name / "a" / "b.txt").read_bytes() == b"x"
    found = refusal(write_new_folder, str(tmp_path / "new"), {"c.txt": b"y"})
    assert "is not empty; nothing was written" in found.message
    assert not (tmp_path / "new" / "c.txt").exists()


@posix
def test_a_link_to_nothing_is_no_free_place_for_a_folder(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "none")
    assert "nothing was written" in refusal(write_new_folder, str(tmp_path / "link"), {"c.txt": b"y"}).message


@posix
def test_plain_files_of_a_folder_are_neither_empty_nor_hidden_nor_links(tmp_path):
    for name, text in (("b", "x"), ("a", "x"), (".hidden", "x"), ("empty", "")):
        (tmp_path / name).write_text(text)
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "a")
    assert plain_files(str(tmp_path)) == [str(tmp_path / "a"), str(tmp_path / "b")]
    with mapped(str(tmp_path / "a")) as data:
        assert bytes(data) == b"x"


def test_a_folder_without_a_name(tmp_path):
    (tmp_path / "a").write_text("x")
    assert [is_folder_without(str(path), "a") for path in (tmp_path, tmp_path / "a", tmp_path / "none")] == [False] * 3
    assert is_folder_without(str(tmp_path), "b")


# ------------------------------------------------------------------------------------------------ reading


@posix
def test_a_pipe_never_ends_and_is_no_plain_file(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "file").write_text("x")
    ended = {name: is_ended(str(tmp_path / name)) for name in ("pipe", "file", "none", ".")}
    assert ended == {"pipe": False, "file": True, "none": True, ".": True}
    assert read_plain(str(tmp_path / "file")) == b"x"
    found = refusal(read_plain, str(tmp_path / "pipe"))
    assert (found.code, found.message) == (CANNOT_READ.id, "is no plain file")


@pytest.mark.parametrize(("count", "is_refused"), [(3, False), (4, True)])
def test_more_than_a_limit_is_refused(count, is_refused):
    if not is_refused:
        refuse_more_than(3, count, "tasks", Location("x"))
        return
    found = refusal(refuse_more_than, 3, count, "tasks", Location("x"))
    assert (found.code, found.message) == (TOO_MUCH.id, "has 4 tasks; at most 3 are read")


def test_sizes_of_inputs_are_had_where_they_can_be(tmp_path):
    (tmp_path / "a").write_bytes(b"12345")
    sizes = [input_size(path) for path in (tmp_path / "a", str(tmp_path / "none"), "-", "a\0b")]
    assert sizes == [5, 0, 0, 0]


def test_an_input_may_be_read_in_parts(tmp_path):
    (tmp_path / "a").write_bytes(b"12345")
    with open_input(tmp_path / "a") as stream:
        assert (stream.read(2), stream.read()) == (b"12", b"345")
    assert refusal(open_input, tmp_path / "none").code == CANNOT_READ.id


def test_a_file_of_ours_is_read_up_to_a_limit_or_whole(tmp_path, monkeypatch):
    (tmp_path / "a").write_bytes(b"12345")
    assert (read_own(tmp_path / "a", 5), read_own(tmp_path / "a", None)) == (b"12345", b"12345")
    assert refusal(read_own, tmp_path / "a", 4).message == "has more than 0 MiB"
    monkeypatch.setattr(reading, "MAX_INPUT_BYTES", 3)
    assert b"12345".startswith(beginning_of(tmp_path / "a"))


def test_a_name_that_is_not_there_has_those_beside_it_in_its_help(tmp_path):
    (tmp_path / "model.xml").write_text("x")
    found = refusal(reading.read_bytes, str(tmp_path / "modell.xml"))
    assert found.help == f'did you mean "{tmp_path / "model.xml"}"?'
    found = refusal(reading.read_bytes, str(tmp_path / "model.xml" / "x.xml"))
    assert found.help.startswith("name a folder, or a bundle, in the place of")


# ------------------------------------------------------------------------------------------------ XML in parts


def test_elements_of_a_large_file_are_dropped_when_they_are_complete():
    seen = []
    data = b"<?xml version='1.0'?>\n<a><b n='1'><c/></b><b n='2'/><c/></a>"
    parser = LargeXmlParser(("b", "a"))
    for _ in range(2):
        root = parser.parse(
            io.BytesIO(data), "m.xml", lambda element: element.get("n") == "1" or element.tag == "a", seen.append
        )
        assert [(child.tag, child.get("n")) for child in root] == [("b", "2"), ("c", None)]
    assert seen == [len(data)] * 2


@pytest.mark.parametrize(
    ("data", "line"), [(b"<a>\n<b>\n</a>", 3), (b"", 0), (b"<!DOCTYPE a>\n<a/>", 1), (b"\n<!DOCTYPE a>\n<a/>", 2)]
)
def test_a_large_file_that_is_wrong_is_refused_at_its_line_and_the_next_is_read(data, line):
    parser = LargeXmlParser(("b",))
    with pytest.raises(HalpipeError) as refused:
        parser.parse(io.BytesIO(data), "m.xml", lambda element: False)
    assert refused.value.diagnostics[0].at == Location("m.xml", line)
    assert parser.parse(io.BytesIO(b"<a/>"), "m.xml", lambda element: False).tag == "a"


@pytest.mark.parametrize(
    ("data", "advice"),
    [
        (b"<a x=1/>", "put the value of every attribute in quotes"),
        (b"<a>&b</a>", 'write "&amp;" for "&"'),
        (b"<a><b></a>", "close each element with the name that opens it"),
        (b"<a>", "the end of the file is missing"),
        (b"", "this is no XML; the file is empty"),
        (b"a,period\n", "this is no XML; name a sheet of tasks with the columns task, period and wcet"),
        (b"digraph {}", "this is no XML; import the graph first"),
    ],
)
def test_advice_follows_from_what_the_parser_says_or_from_what_the_file_is(data, advice):
    with pytest.raises(HalpipeError) as refused:
        parse_xml(data, "m.xml")
    found = refused.value.diagnostics
    assert {d.code for d in found} == {BROKEN_XML.id}
    assert all(d.help.startswith(advice) for d in found)


def test_a_file_of_the_format_that_is_imported_is_not_to_be_imported_once_more():
    data = b"<?xml version='1.0'?><AUTOSAR/>"
    assert advice_for(data) == "import it: `halpipe import arxml FILE -o model.xml`"
    assert advice_for(data, "arxml", "other") == "other"
    assert advice_for(b"# comment\n// comment\n" + data) == advice_for(data)
    assert advice_for(b"\x00\x01") == "`halpipe import` makes a model of other sources"


def test_processes_that_are_there_are_alive():
    assert writing._is_alive(os.getpid())
    assert writing._is_alive(2**200)  # whatever cannot be asked
