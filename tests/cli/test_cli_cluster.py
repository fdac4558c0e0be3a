"""`schedule MODEL --cluster`: the bytes of a search here, and what is told when it is stopped or loses the cluster."""

import os
import re
import signal
import subprocess
import sys
import threading

import pytest

from halpipe.exporters.native import format_model
from halpipe.pipeline.solve import run as runner
from halpipe.pipeline.solve.kernel import portfolio
from support import access, model, task, version

distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")

TURNS = ("--budget", 20_000)
"""With a budget, nobody but the searches looks for a schedule."""


@pytest.fixture
def cluster():
    """A cluster inside this process, which others reach as well."""
    settings = {"n_workers": 2, "threads_per_worker": 1, "processes": False, "protocol": "tcp"}
    with distributed.LocalCluster(**settings, dashboard_address=None) as found:
        yield found


@pytest.fixture
def short_turns(monkeypatch):
    monkeypatch.setattr(portfolio, "LEAD", 2)
    monkeypatch.setattr(portfolio, "TURN", 1)


def tight_model():
    """Three units without a gap, filled by tasks of six lengths: takes a search some hundred moves."""
    return model(
        *(
            task(f"t{n}", 40, version("v", wcet, "u1 u2 u3", *([access("mem", 0, 1)] if n % 2 == 0 else [])))
            for n, wcet in enumerate([3, 4, 5, 6, 7, 7, 8] * 3)
        ),
        units="u1 u2 u3",
        resources="mem",
    )


@pytest.fixture
def hard(halpipe):
    """A set on which searches take turns for ever."""
    shape = ("--utilisation", "90%", "--resource-fill", "75%", "--precedence", "50%", "--seed", 3)
    assert halpipe("generate", "-o", "m.xml", "--tasks", 120, *shape).returncode == 0


def works(cluster):
    return any(worker.processing for worker in cluster.scheduler.workers.values())


@pytest.mark.parametrize("members", [1, 4, 8])
def test_a_cluster_changes_nothing(halpipe, folder, cluster, short_turns, members):
    (folder / "tight.xml").write_bytes(format_model(tight_model()))
    command = ("schedule", "tight.xml", *TURNS, "--portfolio", members)
    here = halpipe(*command, "-o", "here.xml", "--workers", 1)
    there = halpipe(*command, "-o", "there.xml", "--cluster", cluster.scheduler_address)
    assert there.returncode == 0, there.stderr
    assert (folder / "there.xml").read_bytes() == (folder / "here.xml").read_bytes()
    moves = [re.search(r"verified; (\d+) moves", each.stderr)[1] for each in (here, there)]
    assert moves[0] == moves[1]
    assert int(moves[0]) > 21 * (2 + members), "several have taken turns"


@pytest.mark.slow  # the quicker one has short turns in place of a set for which those of all days are too few
def test_several_long_turns_in_processes_change_nothing(halpipe, folder):
    halpipe("generate", "-o", "long.xml", "--tasks", 60, "--utilisation", "85%", "--precedence", "30%", "--seed", 3)
    command = ("schedule", "long.xml", *TURNS, "-o")
    for workers in (1, 2, 8):
        assert halpipe(*command, f"{workers}.xml", "--workers", workers).returncode == 0
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as there:
        found = halpipe(*command, "there.xml", "--cluster", there.scheduler_address)
    assert found.returncode == 0, found.stderr
    assert int(re.search(r"verified; (\d+) moves", found.stderr)[1]) > 60 * (portfolio.LEAD + 12 * portfolio.TURN)
    assert len({(folder / f"{name}.xml").read_bytes() for name in ("1", "2", "8", "there")}) == 1


@pytest.mark.slow  # workers are processes; one that is gone without a trace is the subject of test_away.py
def test_a_worker_that_is_killed_changes_nothing(folder, halpipe, wait_until):
    halpipe("generate", "-o", "long.xml", "--tasks", 60, "--utilisation", "85%", "--precedence", "30%", "--seed", 3)
    assert halpipe("schedule", "long.xml", *TURNS, "-o", "here.xml").returncode == 0
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        search = begun(folder, cluster, "long.xml", *TURNS, "-o", "there.xml")
        wait_until(lambda: works(cluster) or search.poll() is not None)
        busy = next(worker for worker in cluster.scheduler.workers.values() if worker.processing)
        killed = next(nanny for nanny in cluster.workers.values() if nanny.worker_address == busy.address)
        os.kill(killed.pid, signal.SIGKILL)
        _, said = search.communicate(timeout=300)
    assert search.returncode == 0, said
    assert "Traceback" not in said
    assert (folder / "there.xml").read_bytes() == (folder / "here.xml").read_bytes()


def begun(folder, cluster, *arguments):
    words = [sys.executable, "-m", "halpipe", "schedule", *map(str, arguments), "--cluster", cluster.scheduler_address]
    return subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_saves_the_best_placement(folder, hard, cluster, wait_until, number):
    search = begun(folder, cluster, "m.xml", "--budget", 10**9, "-o", "s.xml")
    try:
        wait_until(lambda: works(cluster) or search.poll() is not None)
        search.send_signal(number)
        _, said = search.communicate(timeout=300)
    finally:
        search.kill()
    assert search.returncode == 130, said
    assert "Traceback" not in said
    assert (folder / "s.best.xml").exists()
    assert (folder / "s.resume").exists()
    assert not (folder / "s.xml").exists()


def test_the_time_limit_holds_on_a_cluster(halpipe, folder, hard, cluster):
    words = ("--budget", 10**9, "--time-limit", "0.5", "-o", "s.xml", "--cluster", cluster.scheduler_address)
    ended = halpipe("schedule", "m.xml", *words)
    assert ended.returncode == 3, ended.stderr
    assert (folder / "s.best.xml").exists()


def test_a_cluster_that_loses_its_workers_is_told_and_the_search_resumes(
    halpipe, folder, hard, cluster, monkeypatch, wait_until
):
    """Once all is lost there is a checkpoint, and the search goes on from it here."""
    monkeypatch.setattr(runner, "LOST_ASKS", 1)
    losing = threading.Thread(target=lambda: (wait_until(lambda: works(cluster)), cluster.scale(0)))
    losing.start()
    try:
        words = ("--budget", 10**9, "-o", "s.xml", "--time-limit", 100)
        lost = halpipe("schedule", "m.xml", *words, "--cluster", cluster.scheduler_address)
    finally:
        losing.join()
    assert lost.returncode == 70, lost.stderr
    assert "HAL0933" in lost.stderr
    assert "Traceback" not in lost.stderr
    again = halpipe("schedule", "m.xml", "--budget", 10, "-o", "s.xml", "--resume")
    assert again.returncode == 3, again.stderr
    assert not (folder / "s.xml").exists()


def test_without_a_cluster_nothing_is_begun(halpipe, folder, monkeypatch):
    monkeypatch.setattr(runner, "CONNECT_SECONDS", 0.2)
    for output in ("s.xml", "folder/"):
        refused = halpipe("schedule", "model.xml", "-o", output, "--cluster", "tcp://127.0.0.1:1")
        assert refused.returncode == 1
        assert "HAL0932" in refused.stderr
    assert not (folder / "s.xml").exists()


def test_one_model_for_a_folder_is_a_fleet(halpipe, folder, cluster):
    done = halpipe("schedule", "model.xml", "-o", "out/", "--cluster", cluster.scheduler_address)
    assert done.returncode == 0, done.stderr
    assert (folder / "out" / "fleet.json").exists()
    assert halpipe("schedule", "model.xml", "-o", "here.xml").returncode == 0
    assert (folder / "out" / "model.xml").read_bytes() == (folder / "here.xml").read_bytes()
