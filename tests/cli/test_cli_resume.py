"""A search that is killed or stopped goes on, and its result is that of a run in one go."""

import os
import signal
import subprocess
import sys
import time

import pytest

from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.pipeline.checkpoint import NO_CHECKPOINT, Checkpoint, fingerprint
from halpipe.pipeline.schedule import SearchOptions
from halpipe.pipeline.stages import schedule_model
from support import access, after, mode, model, task, version

UNITS = "u1 u2 u3"


def tight_model():
    """Three units 95 % busy with tasks of three lengths: takes the search some hundred moves."""
    tasks = []
    for number in range(18):
        wcet = (5, 6, 8)[number % 3]
        parts = [access("mem", 0, 1)] if number % 3 == 0 else []
        if number % 6 == 5:
            parts.append(after(f"t{number - 1}", 0, 30, "end"))
        tasks.append(task(f"t{number}", 40, version("v", wcet, UNITS, *parts)))
    return model(*tasks, units=UNITS, resources="mem", modes=[mode("one", tasks), mode("two", tasks[:9])])


class Stop:
    """Lets a search run for some slices and then stops it."""

    def __init__(self, slices):
        self.left = slices

    def __call__(self, *progress):
        self.left -= 1
        return self.left > 0


@pytest.mark.parametrize("slices", [1, 2, 5, 9])
def test_a_stopped_search_goes_on_to_the_same_bytes(tmp_path, monkeypatch, slices):
    from halpipe.pipeline.anneal import slices as kernel_slices

    monkeypatch.setattr(kernel_slices, "SLICE_WORK", 400)
    system = parse_model(format_model(tight_model()), "m.xml")
    options = SearchOptions(seed=3, budget=400)
    straight = schedule_model(system, options, lambda *progress: True)
    path = str(tmp_path / "s.resume")
    identity = fingerprint(system, options, "1")
    ticks = iter(range(0, 10**9, 10))  # a clock that is always late: every slice is saved
    while True:
        checkpoint = Checkpoint(path, identity, lambda: next(ticks))
        if os.path.exists(path):
            checkpoint.load()
        kept = SearchOptions(seed=3, budget=400, keeper=checkpoint)
        part = schedule_model(system, kept, Stop(slices + 1))
        if not part.stopped:
            break
    assert part.schedule == straight.schedule


def test_what_does_not_belong_is_refused(tmp_path, halpipe, folder):
    (folder / "s.resume").write_bytes(b"PK\x03\x04 nonsense")
    damaged = halpipe("schedule", "model.xml", "-o", "s.xml", "--resume")
    assert damaged.returncode == 1
    assert NO_CHECKPOINT.id in damaged.stderr
    assert halpipe("schedule", "model.xml", "-o", "other.xml", "--resume").returncode == 1  # there is none
    assert halpipe("schedule", "hopeless.xml", "--budget", "10", "-o", "s.xml").returncode == 3
    foreign = halpipe("schedule", "model.xml", "-o", "s.xml", "--resume")
    assert foreign.returncode == 1
    assert "belongs to another model" in foreign.stderr
    assert not (folder / "s.xml").exists()


def test_a_killed_search_leaves_a_checkpoint_that_resumes(folder):
    (folder / "tight.xml").write_bytes(format_model(impossible_model()))
    command = [sys.executable, "-m", "halpipe", "schedule", "tight.xml", "--budget", "100000000", "-o", "s.xml"]
    search = subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 60
    while not (folder / "s.resume").exists() and time.monotonic() < deadline:
        time.sleep(0.2)
    search.send_signal(signal.SIGKILL)
    search.wait()
    assert (folder / "s.resume").exists()
    assert not (folder / "s.xml").exists()
    again = subprocess.run([*command, "--resume", "--time-limit", "1"], cwd=folder, capture_output=True, check=False)
    assert again.returncode == 3
    assert b"Traceback" not in again.stderr


def impossible_model():
    """Tasks that fill two units but cannot be cut to fit: no quick proof, and no schedule."""
    tasks = [task(f"t{n}", 100, version("v", wcet, "u1 u2")) for n, wcet in enumerate((40, 40, 40, 26, 27, 27))]
    return model(*tasks, units="u1 u2")
