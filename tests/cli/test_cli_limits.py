"""Verbs with too little memory, room for files or open files end in order: a part of what `make endurance` does."""

import resource
import subprocess

import pytest

import limits

SHORT = ("validate", "schedule", "import arxml", "export report", "selftest", "deploy check regulator")


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    folder = tmp_path_factory.mktemp("limits")
    limits.prepared(folder)
    return folder


@pytest.mark.slow  # test_want_of_memory_is_no_bug and test_a_full_disk_of_temporary_files_is_told are quicker
@pytest.mark.parametrize("verb", SHORT)
def test_a_verb_with_little_memory_ends_in_order(place, verb):
    few = [size << 20 for size in (26, 40, 70, 120, 200, 280)]
    count, wrong = limits.tried(place, limits.VERBS[verb], resource.RLIMIT_AS, few)
    assert count > 1
    assert wrong == []


@pytest.mark.slow  # test_cli_faults.py has the quicker one: every write fails once
@pytest.mark.parametrize("verb", ["deploy check linux", "run", "generate", "export report"])
def test_a_verb_without_room_for_files_ends_in_order(place, verb):
    count, wrong = limits.tried(place, limits.VERBS[verb], resource.RLIMIT_FSIZE, [0, 1, 100, 2000, 20_000])
    assert count > 1
    assert wrong == []


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["selftest", "export report"])
def test_a_full_disk_is_told(place, verb):
    _, wrong = limits.tried(place, limits.VERBS[verb], resource.RLIMIT_FSIZE, [100])
    assert wrong == []


def test_every_verb_is_tried():
    from halpipe.cli.app import VERBS

    assert set(VERBS) - {words.split()[0] for words in limits.VERBS.values()} == {"serve"}  # never ends


def ended(code, said):
    return subprocess.CompletedProcess([], code, "", said)


OLD, NEW = {"in.xml": b"i", "out/a": b"old"}, {"in.xml": b"i", "out/a": b"new", "out/b/x": b"1", "out/b/y": b"2"}


@pytest.mark.parametrize(
    ("done", "after", "wrong"),
    [
        (ended(1, "error[HAL0007]"), OLD, []),
        (ended(0, ""), NEW, []),
        (ended(1, "error[HAL0007]"), {**OLD, "out/b/x": b"1", "out/b/y": b"2"}, []),
        (ended(1, ""), OLD, ["says nothing"]),
        (ended(70, "internal error"), OLD, ["ends with 70", "says 'internal error'"]),
        (ended(-11, ""), OLD, ["ends with -11"]),
        (ended(1, "error\nTraceback"), OLD, ["says 'Traceback'"]),
        (ended(1, "error"), {"in.xml": b"i", "out/a": b"ne"}, ["leaves out/a half done"]),
        (ended(1, "error"), {"in.xml": b"i"}, ["leaves out/a half done"]),
        (ended(1, "error"), {**OLD, "out/b/x": b"1"}, ["leaves out/b half done"]),
        (ended(1, "error"), {**OLD, "tmp/x": b""}, ["leaves tmp over"]),
        (ended(0, ""), OLD, ["does not do its work"]),
    ],
)
def test_what_is_wrong_is_seen(done, after, wrong):
    assert limits.trespasses(done, OLD, NEW, after) == wrong
