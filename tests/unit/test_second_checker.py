"""The second checker of docs/safety and verify give the same verdict, through files, on whole and split systems.

The large run: `pytest -m slow tests/unit/test_second_checker.py` (2500 mutants).
"""

import ast
import importlib.util
import random
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import halpipe
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.native import format_model, format_schedule

ROOT = Path(__file__).parents[2]
PROGRAM = ROOT / "docs" / "safety" / "second_checker.py"
FIXTURE = ROOT / "tests" / "fixtures" / "split"
SPACE = "{urn:halpipe:schedule:1}"
TICK = 1_000_000
KNOWN = ([], [])


def module_from(path):
    spec = importlib.util.spec_from_file_location(path.stem + "_alone", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


checker = module_from(PROGRAM)


def test_it_is_short_and_needs_nothing_but_python():
    text = PROGRAM.read_text()
    assert len(text.splitlines()) <= 700
    nodes = list(ast.walk(ast.parse(text)))
    loaded = {name.name.split(".")[0] for node in nodes if isinstance(node, ast.Import) for name in node.names}
    loaded |= {node.module.split(".")[0] for node in nodes if isinstance(node, ast.ImportFrom)}
    assert "bisect" in loaded
    assert loaded <= sys.stdlib_module_names


@pytest.fixture(scope="module")
def systems():
    sys.path.insert(0, str(ROOT / "tests" / "properties"))
    try:
        import split_systems
        import verify_systems
    finally:
        sys.path.pop(0)
    return verify_systems.valid_system, split_systems.valid_system


def moved(text, ticks):
    return f"{max(0, checker.duration(text) + ticks * TICK)}ns"


def shift_job(rng, job, _):
    ticks = rng.choice((-2, -1, 1, 2))
    for element in (job, *job):
        for name in ("start", "end"):
            element.set(name, moved(element.get(name), ticks))


def drop_job(_, job, mode):
    mode.remove(job)


def rename_version(_, job, __):
    job.set("version", "none-such")


def swap_units(rng, job, mode):
    other = rng.choice(mode.findall(SPACE + "job"))
    mine, theirs = job.get("units"), other.get("units")
    job.set("units", theirs)
    other.set("units", mine)


def swap_starts(rng, job, mode):
    other = rng.choice(mode.findall(SPACE + "job"))
    mine, theirs = job.get("index"), other.get("index")
    if job.get("task") == other.get("task"):
        job.set("index", theirs)
        other.set("index", mine)


def bend_value(rng, job, _):
    element = rng.choice((job, *job))
    name = rng.choice(("start", "end") if element is job else ("start", "end", "from", "to"))
    element.set(name, moved(element.get(name), rng.choice((-1, 1))))


MUTATIONS = (shift_job, drop_job, rename_version, swap_units, swap_starts, bend_value)


def switching():
    sys.path.insert(0, str(ROOT / "tests" / "properties"))
    try:
        import split_mutants
        import split_systems
        import verify_mutants
        import verify_systems
    finally:
        sys.path.pop(0)
    yield verify_systems.switching_system, verify_mutants.OPERATORS
    yield verify_systems.wild_switch, verify_mutants.OPERATORS
    yield split_systems.switching_system, split_mutants.OPERATORS


def switch_verdicts(make, operators, seeds, folder):
    """Yield both verdicts of systems, as they are and with one fault each; what no file can say is left out."""
    for seed in seeds:
        rng = random.Random(seed)
        system = make(rng)
        operated = [operator(rng, *system) for operator in operators.values()]
        for number, pair in enumerate([system, *filter(None, operated)]):
            try:
                (folder / "m.xml").write_bytes(format_model(pair[0]))
                root = ET.fromstring(format_schedule(pair[1]))
            except HalpipeError:
                continue
            root.attrib.pop("model-sha256", None)
            (folder / "s.xml").write_bytes(ET.tostring(root))
            try:
                mine, theirs = verdicts(folder)
            except checker.UnreadableError as failure:
                mine, theirs = [str(failure)], [1]
            yield seed, number, bool(mine), bool(theirs)


@pytest.mark.parametrize("kind", [0, 1, 2], ids=["whole", "wild", "split"])
def test_agrees_on_switches(kind, tmp_path):
    make, operators = list(switching())[kind]
    found = list(switch_verdicts(make, operators, range(1), tmp_path))
    assert [entry for entry in found if entry[2] != entry[3]] == []
    assert {entry[2] for entry in found} == ({True} if kind == 1 else {True, False})


@pytest.mark.slow
@pytest.mark.parametrize("kind", [0, 1, 2], ids=["whole", "wild", "split"])
def test_agrees_on_many_switches(kind, tmp_path):
    make, operators = list(switching())[kind]
    found = switch_verdicts(make, operators, range(100, 115), tmp_path)
    assert [entry for entry in found if entry[2] != entry[3]] == []


def verdicts(folder):
    model, schedule = folder / "m.xml", folder / "s.xml"
    findings = checker.judge(model, schedule)
    told = halpipe.verify(halpipe.load(model), halpipe.load_schedule(schedule))
    errors = [entry for entry in told if str(getattr(entry.severity, "value", entry.severity)) == "error"]
    return findings, errors


def disagreements(make, seeds, each, folder):
    """Return what the two judge differently, and how many mutants each verdict had."""
    differ, count = [], {True: 0, False: 0}
    for seed in seeds:
        rng = random.Random(seed)
        model, schedule = make(rng)
        (folder / "m.xml").write_bytes(format_model(model))
        for number in range(each + 1):
            root = ET.fromstring(format_schedule(schedule))
            root.attrib.pop("model-sha256", None)
            mode = root.find(SPACE + "mode")
            jobs = mode.findall(SPACE + "job")
            if number and jobs:
                rng.choice(MUTATIONS)(rng, rng.choice(jobs), mode)
            (folder / "s.xml").write_bytes(ET.tostring(root))
            mine, theirs = verdicts(folder)
            count[not mine] += 1
            if bool(mine) != bool(theirs):
                differ.append((seed, number, mine, [str(entry) for entry in theirs]))
    return differ, count


@pytest.mark.parametrize("kind", [0, 1], ids=["whole", "split"])
def test_agrees_on_valid_systems_and_mutants(systems, kind, tmp_path):
    differ, count = disagreements(systems[kind], range(15), 6, tmp_path)
    assert differ == []
    assert min(count.values()) >= 15


@pytest.mark.slow
@pytest.mark.parametrize("kind", [0, 1], ids=["whole", "split"])
def test_agrees_on_many_mutants(systems, kind, tmp_path):
    differ, _ = disagreements(systems[kind], range(1000, 1125), 10, tmp_path)
    assert [(seed, number) for seed, number, *_ in differ] == KNOWN[kind]


def run(model, schedule):
    return subprocess.run(
        [sys.executable, "-I", str(PROGRAM), str(model), str(schedule)], capture_output=True, text=True, check=False
    )


def test_the_fixture_is_valid_and_a_bent_part_is_not(tmp_path):
    done = run(FIXTURE / "model.xml", FIXTURE / "schedule.xml")
    assert (done.returncode, done.stdout) == (0, "valid\n")
    text = (FIXTURE / "schedule.xml").read_text(encoding="utf-8")
    bent = tmp_path / "s.xml"
    bent.write_text(text.replace('end="7ms" from', 'end="7.5ms" from'), encoding="utf-8")
    done = run(FIXTURE / "model.xml", bent)
    assert done.returncode == 1
    assert "parts: mode run, task slow, job 0: part 1 has the wrong length" in done.stdout


def test_a_job_with_the_number_of_a_demand_that_does_not_arise_is_not_valid(systems, tmp_path):
    differ, _ = disagreements(systems[0], [1220], 3, tmp_path)
    assert differ == []


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (b"<!DOCTYPE a><a/>", "document type"),
        (b"<!ENTITY b 'c'><a/>", "document type"),
        ("<a/>".encode("utf-16-le"), "not UTF-8"),
        (b'<?xml version="1.0" encoding="latin-1"?><a/>', "not UTF-8"),
        (b"\xef\xbb\xbf<?xml version='1.0' encoding='utf-7'?><a/>", "not UTF-8"),
        (b'<schedule xmlns="urn:halpipe:schedule:1"/>', "not a task-model"),
    ],
)
def test_other_files_are_refused(tmp_path, data, reason):
    """Another encoding could hide a declaration; a model and a schedule are not exchanged."""
    hostile = tmp_path / "m.xml"
    hostile.write_bytes(data)
    with pytest.raises(checker.UnreadableError, match=reason):
        checker.judge(str(hostile), str(FIXTURE / "schedule.xml"))


def test_a_file_beyond_the_limit_of_size_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(checker, "LARGEST_FILE", (FIXTURE / "model.xml").stat().st_size - 1)
    with pytest.raises(checker.UnreadableError, match="too large"):
        checker.judge(str(FIXTURE / "model.xml"), str(FIXTURE / "schedule.xml"))
    monkeypatch.setattr(checker, "LARGEST_FILE", checker.LARGEST_FILE + 1)
    checker.root_of(str(FIXTURE / "model.xml"), "task-model")


def test_a_refusal_is_a_line_and_an_exit_code(tmp_path):
    hostile = tmp_path / "m.xml"
    hostile.write_text("<!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>")
    done = run(hostile, FIXTURE / "schedule.xml")
    assert (done.returncode, done.stdout) == (2, "")
    assert "document type" in done.stderr
