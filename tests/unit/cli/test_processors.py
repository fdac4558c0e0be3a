"""Processors are counted within the quota of a container, as both versions of control groups state it."""

import os

import pytest

from halpipe.cli import searching
from halpipe.cli.searching import processor_count, workers_of


@pytest.fixture
def system(tmp_path, monkeypatch):
    """Make a system with 8 processors and the given files of control groups."""
    monkeypatch.setattr(searching, "GROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(searching, "MEMBERSHIP", tmp_path / "membership")
    monkeypatch.setattr(os, "sched_getaffinity", lambda process: set(range(0 if process else 8)), raising=False)

    def make(membership, **files):
        (tmp_path / "membership").write_text(membership)
        for name, content in files.items():
            path = tmp_path / "cgroup" / name.replace("__", "/")
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(content)

    return lambda membership, files: make(membership, **files)


@pytest.mark.parametrize(
    ("membership", "files", "count"),
    [
        ("", {}, 8),
        ("0::/\n", {}, 8),
        ("0::/\n", {"cpu.max": "max 100000\n"}, 8),
        ("0::/\n", {"cpu.max": "200000 100000\n"}, 2),
        ("0::/\n", {"cpu.max": "150000 100000\n"}, 2),
        ("0::/\n", {"cpu.max": "1000 100000\n"}, 1),
        ("0::/\n", {"cpu.max": "1600000 100000\n"}, 8),
        ("0::/\n", {"cpu.max": "nonsense"}, 8),
        ("0::/\n", {"cpu.max": "100000 0\n"}, 8),
        ("0::/a/b\n", {"a__b__cpu.max": "max 100000\n", "a__cpu.max": "300000 100000\n"}, 3),
        ("0::/docker/host/path\n", {"cpu.max": "400000 100000\n"}, 4),
        ("0::/../../x\n", {"cpu.max": "400000 100000\n"}, 8),
        ("5:memory:/x\n", {"cpu.max": "100000 100000\n"}, 8),
    ],
)  # fmt: skip
def test_the_quota_bounds_what_is_counted(system, membership, files, count):
    system(membership, files)
    assert processor_count() == count


def test_one_worker_per_processor_that_is_counted(system):
    system("0::/\n", {"cpu.max": "300000 100000\n"})
    assert workers_of(None).count == 3
    assert workers_of(7).count == 7


@pytest.mark.parametrize(("known", "count"), [(4, 4), (None, 1)])
def test_where_no_affinity_is_known_all_processors_count(system, monkeypatch, known, count):
    system("", {})
    monkeypatch.delattr(os, "sched_getaffinity", raising=False)
    monkeypatch.setattr(os, "cpu_count", lambda: known)
    assert processor_count() == count
