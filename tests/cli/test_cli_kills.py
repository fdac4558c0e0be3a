"""Kills at random moments leave whole files: a short run of what `make endurance` does two thousand times."""

import pytest

import kills


@pytest.mark.slow  # test_cli_faults.py has the quicker one: every call for a file fails once
def test_killed_runs_leave_whole_files(capsys):
    assert kills.main(25, 3) == 0
    assert " 0 broken, left over after the next runs: []" in capsys.readouterr().out


def test_half_a_file_and_half_a_folder_are_seen():
    old, new = {"a": b"old", "b/x": b"1", "b/y": b"1"}, {"a": b"new", "b/x": b"2", "b/y": b"2"}
    assert kills.is_whole({"a": b"new", "b/x": b"1", "b/y": b"1", ".a.tmp": b"ne"}, [old, new])
    assert not kills.is_whole({"a": b"ne"}, [old, new])
    assert not kills.is_whole({"b/x": b"2", "b/y": b"1"}, [old, new])
