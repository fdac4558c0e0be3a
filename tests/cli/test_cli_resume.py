"""A search that is killed or stopped goes on, and its result is that of a run in one go."""

import os
import signal
import subprocess
import sys
from array import array
from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.cli.searching import workers_of
from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.checkpoint import NO_CHECKPOINT, Checkpoint, fingerprint
from halpipe.pipeline.solve.schedule import SWITCHES, SearchOptions
from halpipe.pipeline.solve.workers import Workers
from support import access, after, chain, mode, model, task, version

UNITS = "u1 u2 u3"
AIMS = (Objective.CHAINS, Objective.JITTER, Objective.MARGIN)


def tight_model():
    """Three units without a gap in mode one, filled by tasks of six lengths: takes the search some hundred moves."""
    tasks = []
    for number, wcet in enumerate([3, 4, 5, 6, 7, 7, 8] * 3):
        parts = [access("mem", 0, 1)] if number % 3 == 0 else []
        if number % 6 == 5:
            parts.append(after(f"t{number - 1}", 0, 30, "end"))
        tasks.append(task(f"t{number}", 40, version("v", wcet, UNITS, *parts)))
    return model(*tasks, units=UNITS, resources="mem", modes=[mode("one", tasks), mode("two", tasks[:9])])


OFTEN = [(2, 1000), (9, 1000), (2, 100)]
"""Slices until a stop, and the work of a slice; a hundred are stopped some hundred times."""


class Stop:
    """Lets the search of a mode run for some slices and then stops it; switches are searched in one go."""

    def __init__(self, slices):
        self.left = slices

    def __call__(self, *progress):
        if progress[0] != SWITCHES:
            self.left -= 1
        return self.left > 0 or progress[0] == SWITCHES


@pytest.mark.parametrize("workers", [1, 3])
@pytest.mark.parametrize(
    ("slices", "work"), [(1, 1000), *(pytest.param(*each, marks=pytest.mark.slow) for each in OFTEN)]
)
def test_a_stopped_search_goes_on_to_the_same_bytes(tmp_path, monkeypatch, slices, workers, work):
    from halpipe.pipeline.solve.kernel import slices as kernel_slices

    monkeypatch.setattr(kernel_slices, "SLICE_WORK", work)
    system = parse_model(format_model(tight_model()), "m.xml")
    margin = None if slices == 9 else ()  # takes hundreds of slices more
    options = SearchOptions(seed=10, budget=400, optimise=margin)
    straight = schedule_model(system, options, lambda *progress: True)
    parts, resumed = in_parts(tmp_path, system, options, slices, workers)
    assert parts > 1
    assert resumed.schedule == straight.schedule


@pytest.mark.slow
@pytest.mark.parametrize(("aim", "often"), [(("cost", "chains"), 2), (("margin",), 8), (tuple(AIMS), 2)])
def test_a_stopped_improvement_goes_on_to_the_same_bytes(tmp_path, monkeypatch, aim, often):
    """Each part of the run has time for one more slice than it needs to come to where the one before was stopped."""
    from halpipe.pipeline.solve import optimise
    from halpipe.pipeline.solve.kernel import slices, widen

    monkeypatch.setattr(slices, "SLICE_WORK", 400)
    monkeypatch.setattr(optimise, "POLISH_BUDGET", 30)
    monkeypatch.setattr(widen, "LATER_ROUNDS", (60,))  # more take thousands of slices
    system = parse_model(format_model(loose_model()), "m.xml")
    options = SearchOptions(seed=1, optimise=tuple(map(Objective, aim)))
    straight = schedule_model(system, options, lambda *progress: True)
    assert straight.schedule != schedule_model(system, SearchOptions(seed=1), lambda *progress: True).schedule
    parts, resumed = in_parts(tmp_path, system, options, often)
    assert parts > 2
    assert not resumed.unimproved
    assert resumed.schedule == straight.schedule


def test_a_search_that_is_stopped_while_it_builds_tables_begins_them_anew(tmp_path):
    """The limit of the chain has no schedule, so that all tables are built before the first move."""
    rows = [("a", 10, 2), ("b", 10, 3), ("c", 20, 4), ("d", 20, 3)]
    tasks = [task(name, period, version("v", wcet, "u1")) for name, period, wcet in rows]
    system = parse_model(format_model(model(*tasks, chains=[chain("c", "a c b", reaction=20)])), "m.xml")
    options = SearchOptions(budget=200, optimise=())
    straight = schedule_model(system, options, lambda *progress: True)
    identity, path = fingerprint(system, options, "1"), str(tmp_path / "s.resume")
    ticks = iter(range(0, 10**9, 10))
    checkpoint = Checkpoint(path, identity, lambda: next(ticks))
    assert schedule_model(system, replace(options, keeper=checkpoint), Stop(3)).stopped
    checkpoint.write()
    again = Checkpoint(path, identity, lambda: next(ticks))
    again.load()
    assert not again.arrays
    resumed = schedule_model(system, replace(options, keeper=again), lambda *progress: True)
    assert resumed.schedule == straight.schedule


def in_parts(tmp_path, system, options, slices, workers=1):
    """Stop the search after so many slices, again and again; return how often, and the last result."""
    path = str(tmp_path / "s.resume")
    identity = fingerprint(system, options, "1")
    ticks = iter(range(0, 10**9, 10))  # a clock that is always late: every slice is saved
    for part in range(1, 1000):
        checkpoint = Checkpoint(path, identity, lambda: next(ticks))
        if os.path.exists(path):
            checkpoint.load()
        kept = replace(options, keeper=checkpoint, workers=Workers(workers))
        found = schedule_model(system, kept, Stop(slices + 1))
        if not found.stopped and not found.unimproved:
            return part, found
        checkpoint.write()
    raise AssertionError("makes no progress")


def loose_model():
    """Four units of which two are enough, slack, and two chains: much to improve."""
    units = "u1 u2 u3 u4"
    tasks = [task(f"t{n}", 40, version("v", (5, 6, 8)[n % 3], units), slack=Fraction(1, 8)) for n in range(9)]
    return model(*tasks, units=units, chains=[chain("c", "t0 t3 t5"), chain("d", "t5 t1 t7")])


def test_an_improvement_cut_short_leaves_a_valid_schedule_and_goes_on(halpipe, folder):
    (folder / "loose.xml").write_bytes(format_model(loose_model()))
    command = ("schedule", "loose.xml", "--optimise", "cost,chains", "-o")
    assert halpipe(*command, "straight.xml").returncode == 0
    cut = halpipe(*command, "s.xml", "--time-limit", "0.000001")
    assert cut.returncode == 0, cut.stderr
    assert "cut short" in cut.stderr
    assert halpipe("verify", "loose.xml", "s.xml").returncode == 0
    assert (folder / "s.xml").read_bytes() != (folder / "straight.xml").read_bytes()
    assert (folder / "s.resume").exists()
    assert halpipe(*command, "s.xml", "--resume").returncode == 0
    assert (folder / "s.xml").read_bytes() == (folder / "straight.xml").read_bytes()
    assert not (folder / "s.resume").exists()


def test_any_number_of_workers_gives_the_same_bytes(halpipe, folder):
    (folder / "tight.xml").write_bytes(format_model(tight_model()))
    for name, chosen in (("one", ["--workers", 1]), ("two", ["--workers", 2]), ("all", [])):
        done = halpipe("schedule", "tight.xml", *chosen, "-o", f"{name}.xml")
        assert done.returncode in (0, 1), done.stderr
    first, *others = ((folder / f"{name}.xml").read_bytes() for name in ("one", "two", "all"))
    assert others == [first, first]


def test_all_processors_work_unless_the_result_would_depend_on_them():
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert workers_of(None).count == processors
    assert workers_of(3).count == 3


def test_what_does_not_belong_is_refused(tmp_path, halpipe, folder):
    (folder / "s.resume").write_bytes(b"PK\x03\x04 nonsense")
    damaged = halpipe("schedule", "model.xml", "-o", "s.xml", "--resume")
    assert damaged.returncode == 1
    assert NO_CHECKPOINT.id in damaged.stderr
    assert halpipe("schedule", "model.xml", "-o", "other.xml", "--resume").returncode == 1  # there is none
    (folder / "s.resume").unlink()  # what is no checkpoint is not replaced by one either
    assert halpipe("schedule", "hopeless.xml", "--budget", "10", "-o", "s.xml").returncode == 3
    foreign = halpipe("schedule", "model.xml", "-o", "s.xml", "--resume")
    assert foreign.returncode == 1
    assert "belongs to another model" in foreign.stderr
    assert not (folder / "s.xml").exists()


@pytest.mark.slow  # the first checkpoint comes after five seconds of searching; stopped ones above are quicker
def test_a_killed_search_leaves_a_checkpoint_that_resumes(folder, wait_until):
    (folder / "tight.xml").write_bytes(format_model(impossible_model()))
    command = [sys.executable, "-m", "halpipe", "schedule", "tight.xml", "--budget", "100000000", "-o", "s.xml"]
    search = subprocess.Popen(command, cwd=folder, stderr=subprocess.DEVNULL)
    wait_until(lambda: search.poll() is not None or (folder / "s.resume").exists())
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


def test_a_checkpoint_larger_than_an_input_is_claimed_and_read(tmp_path, monkeypatch):
    """What a search has written may be larger than any input; neither the next run nor --resume stops because of it."""
    path, arrays = str(tmp_path / "s.resume"), {"a/start": array("q", range(1000))}
    keeper = Checkpoint(path, "same", lambda: 0)
    keeper.stage("a").note({"start": arrays["a/start"]})
    keeper.write()
    monkeypatch.setattr("halpipe.core.files.reading.MAX_INPUT_BYTES", 1000)
    assert os.path.getsize(path) > 1000
    later = Checkpoint(path, "same", lambda: 0)
    later.claim()
    later.load()
    assert later.stage("a").noted() == {"start": arrays["a/start"]}
