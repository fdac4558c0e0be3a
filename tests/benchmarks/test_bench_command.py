"""``python benchmarks/bench.py`` as its users run it."""

import json
import os
import subprocess
import sys

import pytest

import bench

TINY = ("tiny", "--seeds", "2", "--budget", "200", "--limit", "0")


def results(folder):
    return json.loads((folder / "results.json").read_text())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_suite_gives_table_plot_page_and_results(folder, capsys):
    assert bench.main([*TINY, "-o", "out"]) == 0
    assert sorted(os.listdir(folder / "out")) == ["index.html", "plot.svg", "results.json", "table.md"]
    found = results(folder / "out")
    assert [(row["name"], row["instances"], row["solved"]) for row in found["rows"]] == [
        ("12 tasks", 2, 2),
        ("48 tasks, nothing idle", 2, 0),
    ]
    assert found["seeds"] == "101..102"
    assert found["command"] == "benchmarks/bench.py tiny --seeds 2 --budget 200 --limit 0 -o out"
    assert "12 tasks: 2 of 2 solved" in capsys.readouterr().err


def test_rows_can_be_chosen(folder):
    assert bench.main([*TINY, "--row", "12 tasks", "-o", "out"]) == 0
    assert [row["name"] for row in results(folder / "out")["rows"]] == ["12 tasks"]


@pytest.mark.parametrize(("arguments", "named"), [(("tinny",), "tiny"), (("tiny", "--row", "x"), "12 tasks")])
def test_an_unknown_suite_or_row_is_wrong_usage(folder, capsys, arguments, named):
    with pytest.raises(SystemExit) as caught:
        bench.main([*arguments, "-o", "out"])
    assert caught.value.code == 2
    assert named in capsys.readouterr().err


@pytest.mark.parametrize("name", ["results.json", "index.html", "table.md"])
def test_a_benchmark_replaces_only_results(folder, name):
    (folder / "web").mkdir()
    (folder / "web" / name).write_text(json.dumps({"mine": 1}))
    done = subprocess.run(
        [sys.executable, bench.__file__, *TINY, "-o", "web"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert "HAL" in done.stderr
    assert "Traceback" not in done.stderr
    assert os.listdir(folder / "web") == [name]


@pytest.mark.slow
def test_processes_give_the_same_schedules(folder):
    for number in ("1", "2"):
        command = [sys.executable, bench.__file__, *TINY, "--jobs", number, "-o", number]
        assert subprocess.run(command, check=False).returncode == 0
    assert results(folder / "1")["results_sha256"] == results(folder / "2")["results_sha256"]
