"""``halpipe bench`` as its users run it: results, a kill in the middle, processes and a cluster."""

import json
import os
import signal
import subprocess
import sys

import pytest

TINY = ("bench", "tiny", "--seeds", 2, "--budget", 200, "--limit", 0)


def results(folder):
    return json.loads((folder / "results.json").read_text())


def test_a_suite_gives_table_plot_page_and_results(halpipe, folder):
    done = halpipe(*TINY, "-o", "out")
    assert done.returncode == 0, done.stderr
    assert sorted(os.listdir(folder / "out")) == ["index.html", "plot.svg", "results.json", "table.md"]
    found = results(folder / "out")
    assert [(row["name"], row["instances"], row["solved"]) for row in found["rows"]] == [
        ("12 tasks", 2, 2),
        ("48 tasks, nothing idle", 2, 0),
    ]
    assert found["seeds"] == "101..102"
    assert found["command"] == "halpipe bench tiny --seeds 2 --budget 200 --limit 0 -o out"
    assert "12 tasks: 2 of 2 solved" in done.stderr


def test_rows_can_be_chosen(halpipe, folder):
    assert halpipe(*TINY, "--row", "12 tasks", "-o", "out").returncode == 0
    assert [row["name"] for row in results(folder / "out")["rows"]] == ["12 tasks"]


@pytest.mark.parametrize(("arguments", "named"), [(("tinny",), "tiny"), (("tiny", "--row", "x"), "12 tasks")])
def test_an_unknown_suite_or_row_is_wrong_usage(halpipe, arguments, named):
    done = halpipe("bench", *arguments, "-o", "out")
    assert done.returncode == 2
    assert named in done.stderr


@pytest.mark.slow
def test_a_killed_bench_goes_on_and_comes_to_the_same_results(halpipe_process, folder, wait_until):
    command = ("bench", "tiny", "--seeds", 2, "--budget", 500, "--limit", 0, "-o")
    assert halpipe_process(*command, "whole").returncode == 0
    journal = folder / "cut" / "journal.jsonl"
    running = subprocess.Popen([sys.executable, "-m", "halpipe", *map(str, command), "cut"], cwd=folder)
    wait_until(lambda: journal.exists() and journal.read_bytes().count(b"\n") >= 2)
    running.send_signal(signal.SIGKILL)
    running.wait()
    with journal.open("ab") as stream:
        stream.write(b'{"record": {"key": "half a li')
    refused = halpipe_process(*command, "cut")
    assert refused.returncode == 1
    assert "HAL0934" in refused.stderr
    resumed = halpipe_process(*command, "cut", "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert "of 4 sets are finished already" in resumed.stderr
    assert not journal.exists()
    assert results(folder / "cut")["results_sha256"] == results(folder / "whole")["results_sha256"]


@pytest.mark.slow
def test_processes_give_the_same_schedules(halpipe_process, folder):
    assert halpipe_process(*TINY, "-o", "one").returncode == 0
    done = halpipe_process(*TINY, "--jobs", 2, "-o", "two")
    assert done.returncode == 0, done.stderr
    assert results(folder / "one")["results_sha256"] == results(folder / "two")["results_sha256"]


@pytest.mark.slow
def test_a_cluster_gives_the_same_schedules(halpipe_process, folder):
    distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")
    assert halpipe_process(*TINY, "-o", "here").returncode == 0
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, protocol="tcp"
    ) as cluster:
        done = halpipe_process(*TINY, "--cluster", cluster.scheduler_address, "-o", "there")
    assert done.returncode == 0, done.stderr
    assert results(folder / "here")["results_sha256"] == results(folder / "there")["results_sha256"]
    assert results(folder / "there")["machine"]["executor"] == "dask.distributed"
