"""Reading and writing whole files: limits, and output that is either whole or not there, whatever fails or kills it."""

import errno
import io
import os
import signal
import stat
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from halpipe.core import files
from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import (
    SourceLines,
    find_inputs,
    protecting_inputs,
    read_bytes,
    sha256,
    write_output,
    write_outputs,
)


def refusal(call, *arguments):
    with pytest.raises(HalpipeError) as refused:
        call(*arguments)
    (found,) = refused.value.diagnostics
    assert found.help
    return found


def names(folder):
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def target(tmp_path):
    path = tmp_path / "schedule.xml"
    path.write_bytes(b"old")
    return path


# ------------------------------------------------------------------------------------------------ reading


def test_what_cannot_be_read_is_told_with_its_reason(tmp_path):
    missing, folder, dangling = tmp_path / "missing", tmp_path, tmp_path / "link"
    dangling.symlink_to(missing)
    for path, reason in [(missing, "No such file"), (folder, "directory"), (dangling, "No such file")]:
        found = refusal(read_bytes, path)
        assert (found.code, found.at.file) == (files.CANNOT_READ.id, str(path))
        assert reason in found.message
    assert refusal(read_bytes, "a\0b").code == files.CANNOT_READ.id


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_without_permission_cannot_be_read(target):
    target.chmod(0)
    assert "Permission denied" in refusal(read_bytes, target).message


def test_input_has_a_size_limit(target, monkeypatch):
    monkeypatch.setattr(files.reading, "MAX_INPUT_BYTES", 3)
    assert read_bytes(target) == b"old"
    monkeypatch.setattr(files.reading, "MAX_INPUT_BYTES", 2)
    found = refusal(read_bytes, target)
    assert (found.code, found.at.file) == (files.TOO_LARGE.id, str(target))


def test_endless_input_is_cut_off(monkeypatch):
    monkeypatch.setattr(files.reading, "MAX_INPUT_BYTES", 1000)
    assert refusal(read_bytes, "/dev/zero").code == files.TOO_LARGE.id


def test_a_dash_is_standard_input(monkeypatch):
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(b"model")))
    assert read_bytes("-") == b"model"


def test_closed_standard_streams_are_told(monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    monkeypatch.setattr(sys, "stdout", None)
    assert refusal(read_bytes, "-").code == files.CANNOT_READ.id
    assert refusal(write_output, "-", "x").code == files.CANNOT_WRITE.id


def test_the_digest_is_that_of_the_standard():
    assert sha256(b"abc") == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"  # FIPS 180-4


def test_source_lines_are_had_for_messages(tmp_path):
    path = tmp_path / "m.xml"
    path.write_bytes(b"<a>\n  <b/>\xff  \n" + b"x" * 500)
    with protecting_inputs():
        assert SourceLines()(Location(str(path), 2)) == ""  # a file that a model names, but nobody has read
        read_bytes(path)
        assert SourceLines()(Location(str(path), 2)) == "<b/>�"
    line = SourceLines()  # failures are told at the end
    assert line(Location(str(path), 2)) == "<b/>�"
    assert line(Location(str(path), 3)) == "x" * 160
    assert line(Location(str(path), 4)) == line(Location(str(path))) == line(Location("", 1)) == ""
    assert line(Location(str(tmp_path / "missing"), 1)) == ""


def test_folders_give_their_files_in_name_order(tmp_path):
    for name in ("b.arxml", "a.ARXML", "sub/c.arxml", "d.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = list(find_inputs(["-", "given.txt", str(tmp_path)], (".arxml",)))
    assert found == ["-", "given.txt"] + [str(tmp_path / name) for name in ("a.ARXML", "b.arxml", "sub/c.arxml")]


# ------------------------------------------------------------------------------------------------ writing


def test_a_new_file_is_written_with_its_folders(tmp_path):
    write_output(tmp_path / "a" / "b" / "new.xml", "ü")
    assert (tmp_path / "a" / "b" / "new.xml").read_bytes() == "ü".encode()
    assert names(tmp_path / "a" / "b") == ["new.xml"]


def test_a_new_file_has_the_permissions_of_the_umask(tmp_path):
    before = os.umask(0o026)
    try:
        write_output(tmp_path / "new.xml", b"x")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "new.xml").stat().st_mode) == 0o640


@pytest.mark.parametrize("mode", [0o600, 0o644, 0o755])
def test_an_existing_file_keeps_its_permissions(target, mode):
    target.chmod(mode)
    write_output(target, b"new")
    assert (target.read_bytes(), stat.S_IMODE(target.stat().st_mode)) == (b"new", mode)


def test_a_link_stays_and_what_it_names_changes(target, tmp_path):
    (tmp_path / "other").mkdir()
    link = tmp_path / "other" / "link.xml"
    link.symlink_to(target)
    write_output(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert names(link.parent) == ["link.xml"]


def test_a_link_to_nothing_makes_what_it_names(tmp_path):
    link = tmp_path / "link.xml"
    link.symlink_to("real.xml")
    write_output(link, b"new")
    assert link.is_symlink()
    assert (tmp_path / "real.xml").read_bytes() == b"new"


@pytest.mark.parametrize("name", ["x" * 255, "ü" * 127, "日" * 85])
def test_the_longest_names_can_be_written(tmp_path, name):
    write_output(tmp_path / name, b"new")
    assert names(tmp_path) == [name]


def test_files_whose_names_begin_alike_do_not_mix(tmp_path):
    contents = {str(tmp_path / ("x" * 240 + end)): end.encode() for end in "abc"}
    write_outputs(contents)
    assert {str(path): path.read_bytes() for path in tmp_path.iterdir()} == contents


def test_a_planted_temporary_file_is_not_written_through(tmp_path, monkeypatch):
    victim = tmp_path / "victim"
    victim.write_bytes(b"precious")
    monkeypatch.setattr(files.writing.os, "urandom", bytes)
    trap = tmp_path / "out" / f".new.xml.{os.getpid()}-00000000.halpipe-tmp"
    trap.parent.mkdir()
    trap.symlink_to(victim)
    assert refusal(write_output, trap.parent / "new.xml", b"new").code == files.CANNOT_WRITE.id
    assert victim.read_bytes() == b"precious"


def test_text_that_no_encoding_has_is_escaped(tmp_path):
    write_output(tmp_path / "f", "caf\udce9")
    assert (tmp_path / "f").read_bytes() == rb"caf\udce9"


def test_a_pipe_is_written_through(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_bytes()))
    reader.start()
    write_output(pipe, b"through")
    reader.join(timeout=300)
    assert received == [b"through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert names(tmp_path) == ["pipe"]


WRITE = "import sys; from halpipe.core.files import write_output; print('before', flush=True); "
WRITE += "write_output(sys.argv[1], b'content'); print('after')"


@pytest.mark.parametrize("name", ["-", "/dev/stdout"])
def test_standard_output_is_written_through(name):
    run = subprocess.run([sys.executable, "-c", WRITE, name], check=True, capture_output=True)
    assert run.stdout == b"before\ncontentafter\n"


def test_standard_output_that_is_a_file_stays_the_same_file(tmp_path):
    with open(tmp_path / "log", "ab") as log:
        subprocess.run([sys.executable, "-c", WRITE, "/dev/stdout"], check=True, stdout=log)
    assert (tmp_path / "log").read_bytes().endswith(b"after\n")
    assert names(tmp_path) == ["log"]


def test_a_full_device_is_told(monkeypatch):
    assert "No space left" in refusal(write_output, "/dev/full", b"x").message
    with open("/dev/full", "w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        found = refusal(write_output, "-", b"x" * 10**6)
    assert (found.code, found.at.file) == (files.CANNOT_WRITE.id, "-")


def test_a_reader_that_has_gone_is_no_error_of_the_output(monkeypatch):
    class Gone:
        def write(self, content):
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stdout", SimpleNamespace(buffer=Gone()))
    with pytest.raises(BrokenPipeError):
        write_output("-", b"x")


def test_a_folder_cannot_be_written(tmp_path):
    found = refusal(write_output, tmp_path, b"x")
    assert (found.code, found.at.file) == (files.CANNOT_WRITE.id, str(tmp_path))


def test_a_file_is_no_folder(target):
    assert refusal(write_output, target / "below", b"x").code == files.CANNOT_WRITE.id
    assert target.read_bytes() == b"old"


# ------------------------------------------------------------------------------------------------ faults


def fail(monkeypatch, name, code, on_call=1):
    """Make the nth call of a function of the os module fail."""
    real, calls = getattr(os, name), []

    def broken(*arguments, **keywords):
        calls.append(name)
        if len(calls) == on_call:
            raise OSError(code, os.strerror(code))
        return real(*arguments, **keywords)

    monkeypatch.setattr(os, name, broken)
    return calls


class FullDisk(io.RawIOBase):
    """A file on a disk that fills up after some bytes."""

    def __init__(self, descriptor, room):
        self.descriptor, self.room = descriptor, room

    def writable(self):
        return True

    def write(self, content):
        if len(content) > self.room:
            os.write(self.descriptor, bytes(content[: self.room]))
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return os.write(self.descriptor, content)

    def close(self):
        if not self.closed:
            os.close(self.descriptor)
        super().close()


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EACCES, errno.EIO, errno.EROFS])
@pytest.mark.parametrize("site", ["makedirs", "listdir", "open", "fdopen", "chmod", "fsync", "replace"])
def test_a_fault_anywhere_leaves_the_old_file_and_nothing_else(target, monkeypatch, site, code):
    calls = fail(monkeypatch, site, code)
    found = refusal(write_output, target, b"new")
    monkeypatch.undo()
    assert calls, "the fault was not met"
    assert (found.code, found.at.file, found.message) == (files.CANNOT_WRITE.id, str(target), os.strerror(code))
    assert target.read_bytes() == b"old"
    assert names(target.parent) == ["schedule.xml"]


def test_a_disk_that_fills_up_leaves_the_old_file_and_nothing_else(target, monkeypatch):
    monkeypatch.setattr(os, "fdopen", lambda descriptor, mode: FullDisk(descriptor, room=2))
    assert "No space left" in refusal(write_output, target, b"a longer text").message
    assert target.read_bytes() == b"old"
    assert names(target.parent) == ["schedule.xml"]


def test_a_folder_that_cannot_be_synced_does_not_undo_the_write(target, monkeypatch):
    calls = fail(monkeypatch, "fsync", errno.EINVAL, on_call=2)
    write_output(target, b"new")
    assert len(calls) == 2
    assert target.read_bytes() == b"new"


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, SystemExit, MemoryError])
def test_an_interruption_leaves_no_temporary_file(target, monkeypatch, interruption):
    def interrupted(descriptor):
        raise interruption

    monkeypatch.setattr(os, "fsync", interrupted)
    with pytest.raises(interruption):
        write_output(target, b"new")
    assert target.read_bytes() == b"old"
    assert names(target.parent) == ["schedule.xml"]


@pytest.mark.parametrize("site", ["open", "fsync"])
def test_several_files_stay_as_they_are_when_the_last_cannot_be_prepared(tmp_path, monkeypatch, site):
    paths = [tmp_path / name for name in ("a", "b", "c")]
    for path in paths:
        path.write_bytes(b"old")
    fail(monkeypatch, site, errno.ENOSPC, on_call=3)
    found = refusal(write_outputs, {str(path): b"new" for path in paths})
    assert found.at.file == str(paths[-1])
    assert [path.read_bytes() for path in paths] == [b"old"] * 3
    assert names(tmp_path) == ["a", "b", "c"]


def test_a_fault_while_renaming_leaves_whole_files_and_no_temporary(tmp_path, monkeypatch):
    paths = [tmp_path / name for name in ("a", "b", "c")]
    for path in paths:
        path.write_bytes(b"old")
    fail(monkeypatch, "replace", errno.EIO, on_call=2)
    found = refusal(write_outputs, {str(path): b"new" for path in paths})
    assert found.at.file == str(paths[1])
    assert [path.read_bytes() for path in paths] == [b"new", b"old", b"old"]
    assert names(tmp_path) == ["a", "b", "c"]


OVERWRITE = """
import sys
from halpipe.core.files import write_output
print("ready", flush=True)
while True:
    for letter in b"ab":
        write_output(sys.argv[1], bytes([letter]) * 200_000)
"""


@pytest.mark.slow
def test_a_killed_writer_leaves_a_whole_file_and_its_rest_is_swept(tmp_path):
    """Kill -9 at twenty instants spread over the writer's loop."""
    target = tmp_path / "schedule.xml"
    target.write_bytes(b"a" * 200_000)
    for round in range(20):
        child = subprocess.Popen([sys.executable, "-c", OVERWRITE, str(target)], stdout=subprocess.PIPE)
        assert child.stdout.readline() == b"ready\n"
        time.sleep(0.0007 * round)
        child.send_signal(signal.SIGKILL)
        child.wait()
        child.stdout.close()
        content = target.read_bytes()
        assert len(content) == 200_000
        assert len(set(content)) == 1
    (tmp_path / f".schedule.xml.{child.pid}-0a1b2c3d.halpipe-tmp").write_bytes(b"half")
    write_output(target, b"new")
    assert names(tmp_path) == ["schedule.xml"]


def test_a_rest_that_cannot_be_removed_does_not_stop_the_write(tmp_path, monkeypatch):
    rest = tmp_path / ".out.999999999-abcd.halpipe-tmp"
    rest.mkdir()
    monkeypatch.setattr(os, "rmdir", lambda *_, **__: (_ for _ in ()).throw(PermissionError("no")))
    write_output(tmp_path / "out", b"new")
    assert names(tmp_path) == [rest.name, "out"]


def test_only_rests_of_the_dead_are_swept(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    rest = f".out.{dead.pid}-00000000.halpipe-tmp"
    kept = [
        f".out.{os.getpid()}-00000000.halpipe-tmp",  # of a living process
        f".other.{dead.pid}-00000000.halpipe-tmp",  # of another target
        f".far.{dead.pid}-00000000.halpipe-tmp",  # of another one with a name of this length
        f".out.{dead.pid}-00000000.halpipe-bak",
        ".out.notes.halpipe-tmp",
        f".out.{'9' * 30}-0.halpipe-tmp",
        "out.xml",
    ]
    for name in [rest, *kept]:
        (tmp_path / name).touch()
    write_output(tmp_path / "out", b"new")
    assert set(names(tmp_path)) == {*kept, "out"}
