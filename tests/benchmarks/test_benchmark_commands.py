"""The benchmark of whole commands still runs: what it makes must be accepted by every rule that came after it."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "commands.py"


@pytest.fixture(scope="module")
def benchmark():
    spec = importlib.util.spec_from_file_location("benchmark_commands", BENCHMARK)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look themselves up
    path = sys.path[:]
    spec.loader.exec_module(module)
    yield module
    sys.path[:] = path


@pytest.mark.slow
@pytest.mark.parametrize("name", ["schedule of 120 tasks", "export regulator", "4 cores, zig"])
def test_rows_whose_input_is_generated_run(benchmark, tmp_path, name):
    (row,) = (row for row in benchmark.rows() if name in row.name)
    benchmark.run(benchmark.prepared(row, tmp_path), tmp_path)


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("make") or not shutil.which("cc"), reason="bundle and loop are compiled")
@pytest.mark.skipif(os.cpu_count() < 2, reason="the table is of two CPUs")
def test_the_dispatcher_and_a_minimal_loop_are_played_in_turn():
    command = [sys.executable, str(BENCHMARK.with_name("linux_starts.py")), "--rounds", "1", "--seconds", "1"]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    [played] = re.findall(r"round 1: dispatcher (\d+) jobs, .*; loop (\d+) jobs, ", said)
    assert played == ("2046", "2046"), said  # how late each starts is the machine's, and no test's
    assert re.search(r"^p50: dispatcher / loop in a round: median [0-9.]+", said, re.MULTILINE), said
