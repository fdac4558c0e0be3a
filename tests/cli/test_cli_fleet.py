"""Many models in one command: the bytes of each alone, what is finished is kept, nothing is left half done."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

from command_line import run_here
from halpipe.core.files import write_output
from halpipe.exporters.native import format_model
from support import model, task, version


def variant(wcet):
    tasks = [task(f"t{n}", 20, version("v", f"{wcet + n}00us", "u1 u2")) for n in range(6)]
    return model(*tasks, units="u1 u2")


@pytest.fixture
def folder(tmp_path):
    for number in range(4):
        write_output(str(tmp_path / f"m{number}.xml"), format_model(variant(20 + number)))
    return tmp_path


NAMES = [f"m{number}.xml" for number in range(4)]


def rows(finished):
    return [line.split()[:2] for line in finished.stdout.splitlines()[1:]]


def content(path):
    return {name: (path / name).read_bytes() for name in NAMES}


def test_each_has_the_bytes_of_a_search_for_it_alone(folder):
    finished = run_here(folder, "schedule", *NAMES, "-o", "out")
    assert finished.returncode == 0, finished.stderr
    assert rows(finished) == [[name, "valid"] for name in NAMES]
    for name in NAMES:
        assert run_here(folder, "schedule", name, "-o", f"alone-{name}").returncode == 0
        assert (folder / "out" / name).read_bytes() == (folder / f"alone-{name}").read_bytes()


@pytest.mark.slow
def test_the_number_of_processes_changes_nothing(folder):
    for processes in (1, 2):
        finished = run_here(folder, "schedule", *NAMES, "-o", f"out{processes}", "--workers", processes)
        assert finished.returncode == 0, finished.stderr
    assert content(folder / "out1") == content(folder / "out2")


def test_what_is_finished_is_kept_until_its_input_options_or_file_change(folder):
    def outcomes(*options):
        return [outcome for _, outcome in rows(run_here(folder, "schedule", *NAMES, "-o", "out", *options))]

    assert outcomes() == ["valid"] * 4
    assert outcomes() == ["kept"] * 4
    write_output(str(folder / "m2.xml"), format_model(variant(30)))
    assert outcomes() == ["kept", "kept", "valid", "kept"]
    (folder / "out" / "m1.xml").write_bytes(b"<torn")
    assert outcomes() == ["kept", "valid", "kept", "kept"]
    assert outcomes("--seed", "2") == ["valid"] * 4
    ledger = folder / "out" / "fleet.json"
    assert set(json.loads(ledger.read_text())["halpipe-fleet"]) == set(NAMES)
    ledger.write_text('{"halpipe-fleet": 7}')
    assert outcomes("--seed", "2") == ["valid"] * 4


def test_one_that_fails_does_not_stop_the_others(folder):
    pair = (task("a", "6ms", version("v", "1.5ms", "u1")), task("b", "15ms", version("v", "2ms", "u1")))
    meeting = model(*pair, units="u1")
    write_output(str(folder / "m1.xml"), format_model(meeting))
    (folder / "m2.xml").write_text("<nonsense/>")
    finished = run_here(folder, "schedule", *NAMES, "-o", "out")
    assert [outcome for _, outcome in rows(finished)] == ["valid", "infeasible", "invalid", "valid"]
    assert finished.returncode == 1
    assert "m1.xml" in finished.stderr
    assert "m2.xml" in finished.stderr
    assert sorted(os.listdir(folder / "out")) == ["fleet.json", "m0.xml", "m3.xml"]


def test_shared_schedules_are_those_near_the_first(folder):
    finished = run_here(folder, "schedule", *NAMES, "-o", "out", "--share")
    assert finished.returncode == 0, finished.stderr
    for name in NAMES[1:]:
        run_here(folder, "schedule", name, "-o", "alone.xml", "--near", "out/m0.xml")
        assert (folder / "out" / name).read_bytes() == (folder / "alone.xml").read_bytes()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("m0.xml", "copy/m0.xml", "-o", "out"), "one name"),
        (("-", "m0.xml", "-o", "out"), "standard input"),
        (("m0.xml", "m1.xml", "-o", "out", "--resume"), "resumed without it"),
        (("m0.xml", "m1.xml", "-o", "out", "--share", "--near", "near.xml"), "--near or --share"),
    ],
)
def test_what_cannot_be_is_said_before_anything_is_done(folder, arguments, word):
    (folder / "copy").mkdir()
    write_output(str(folder / "copy" / "m0.xml"), format_model(variant(1)))
    run_here(folder, "schedule", "m0.xml", "-o", "near.xml")
    finished = run_here(folder, "schedule", *arguments)
    assert finished.returncode == 2
    assert word in finished.stderr
    assert not list((folder / "out").glob("*.xml")) if (folder / "out").exists() else True


def test_models_are_never_written_over(folder):
    finished = run_here(folder, "schedule", *NAMES, "-o", "./")
    assert finished.returncode == 2
    assert content(folder) == {name: format_model(variant(20 + number)) for number, name in enumerate(NAMES)}


@pytest.mark.slow
def test_the_key_of_a_variant_is_the_same_in_every_process(folder):
    """Hashes of texts differ between processes, and so does the order of what stands in sets."""
    (folder / "platform.yaml").write_text(PLATFORM)
    program = (
        "from halpipe.flow.fleet import Variant, plain_options; from halpipe.flow.formats import burst_grid; "
        "from halpipe.pipeline.solve.checkpoint import fingerprint; from halpipe.importers.native import read_model; "
        "from halpipe.pipeline.solve.schedule import SearchOptions; "
        "options = SearchOptions(grid=burst_grid('platform.yaml')); "
        "print(Variant('m', b'', plain_options(options)).key, fingerprint(read_model('m0.xml'), options, '1'))"
    )
    keys = set()
    for seed in ("1", "2", "3", "4"):
        words, settings = [sys.executable, "-c", program], {**os.environ, "PYTHONHASHSEED": seed}
        keys.add(subprocess.run(words, cwd=folder, env=settings, capture_output=True, check=True, timeout=300).stdout)
    assert len(keys) == 1


PLATFORM = """halpipe-regulator: 1
clock: 1MHz
bus: 64bit
burst: 64B
window: 1000
guaranteed: 4MB/s
units:
  u1: {manager: 0}
  u2: {manager: 1}
  u3: {manager: 2}
"""


def test_out_of_time_is_not_interrupted(folder):
    write_output(str(folder / "m1.xml"), format_model(full()))
    finished = run_here(folder, "schedule", *NAMES[:2], "-o", "out", "--workers", 1, "--time-limit", 0.3)
    assert finished.returncode == 3
    assert rows(finished) == [["m0.xml", "valid"], ["m1.xml", "not"]]


@pytest.mark.slow
def test_processes_keep_to_the_time_limit(folder):
    for name in NAMES[:2]:
        write_output(str(folder / name), format_model(full()))
    words = [
        sys.executable,
        "-m",
        "halpipe",
        "schedule",
        *NAMES[:2],
        "-o",
        "out",
        "--workers",
        "2",
        "--time-limit",
        "1",
    ]
    running = subprocess.Popen(words, cwd=folder, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        assert running.wait(300) == 3
    finally:
        running.terminate()


@pytest.mark.slow
def test_ctrl_c_leaves_finished_files_whole(folder):
    """The third model takes the search for ever; the first two are finished, and a second run goes on after them."""
    write_output(str(folder / "m2.xml"), format_model(full()))
    words = [sys.executable, "-m", "halpipe", "schedule", *NAMES, "-o", "out", "--time-limit", "100"]
    running = subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        for _ in range(300):
            if (folder / "out" / "m1.xml").exists():
                break
            time.sleep(0.1)
        running.send_signal(signal.SIGINT)
        assert running.wait(300) == 130
    finally:
        running.kill()
    assert sorted(name for name in os.listdir(folder / "out") if name.endswith(".xml")) == ["m0.xml", "m1.xml"]
    assert not [name for name in os.listdir(folder / "out") if name.startswith(".")]


def full():
    """A model that the search looks at for ever."""
    tasks = [task(f"t{n}", 100, version("v", f"{w}us", "u1 u2 u3")) for n, w in enumerate(LENGTHS)]
    return model(*tasks, units="u1 u2 u3")


LENGTHS = [10007, 20011, 30011, 40009, 50021, 60013, 70001, 9929, 9998]
"""Their sum is that of three units to the tick, and no choice of them fills one."""
