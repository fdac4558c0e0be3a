"""What goes out as ARXML comes in again as it was, for every release, with and without a schedule."""

import random
from copy import deepcopy

import pytest
from grounded_models import grounded
from hypothesis import HealthCheck, assume, given
from hypothesis import strategies as st
from lxml import etree
from verify_systems import switching_system, valid_system

import strategies
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import ZERO
from halpipe.exporters.arxml import FORMAT as OUT
from halpipe.exporters.arxml import PARTS, RELEASES, ArxmlOptions
from halpipe.exporters.native import format_model
from halpipe.importers.arxml import FORMAT as IN
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.native import parse_model
from profiles import examples

FAST = examples(40, *HealthCheck)


def again(tmp_path_factory, model, schedule=None, **options):
    """Write and read a model."""
    data = OUT.write(model, schedule, ArxmlOptions(**options))[""]
    path = tmp_path_factory.mktemp("arxml") / "m.arxml"
    path.write_bytes(data)
    return data, IN.read([str(path)], ArxmlImportOptions())


@FAST
@given(strategies.task_models.map(grounded), st.sampled_from(list(RELEASES)))
def test_a_model_comes_back_as_it_was(tmp_path_factory, model, release):
    data, imported = again(tmp_path_factory, model, release=release)
    assert imported.model == model
    assert imported.diagnostics == ()
    assert again(tmp_path_factory, imported.model, release=release)[0] == data


@pytest.mark.parametrize("make", [valid_system, switching_system])
@FAST
@given(seed=st.integers(0, 10**6), release=st.sampled_from(list(RELEASES)))
def test_a_model_comes_back_from_an_export_with_its_schedule(tmp_path_factory, make, seed, release):
    model, schedule = make(random.Random(seed))
    _, imported = again(tmp_path_factory, model, schedule, release=release)
    assert imported.model == model
    assert imported.diagnostics == ()


@FAST
@given(seed=st.integers(0, 10**6))
def test_the_parts_together_are_the_whole(tmp_path_factory, seed):
    model, schedule = switching_system(random.Random(seed))
    folder = tmp_path_factory.mktemp("parts")
    for part in PARTS[1:]:
        (folder / f"{part}.arxml").write_bytes(OUT.write(model, schedule, ArxmlOptions(part=part))[""])
    assert IN.read([str(folder)], ArxmlImportOptions()).model == model


def texts_of(root):
    """Every place of a document where a text stands: the text of an element, or an attribute of one."""
    found = [(element, "") for element in root.iter("{*}*") if not len(element)]
    return found + [(element, name) for element in root.iter("{*}*") for name in element.attrib]


def get(element, name):
    return element.get(name) if name else element.text or ""


def put(element, name, text):
    if name:
        element.set(name, text)
    else:
        element.text = text


@FAST
@given(seed=st.integers(0, 10**6), data=st.data())
def test_a_damaged_file_is_refused_or_read_but_never_fails(tmp_path_factory, seed, data):
    """Texts are exchanged, emptied or filled with anything, and elements removed or doubled."""
    model, schedule = switching_system(random.Random(seed))
    root = etree.fromstring(OUT.write(model, schedule, ArxmlOptions(part="system"))[""])
    for _ in range(data.draw(st.integers(1, 4))):
        places = texts_of(root)
        (element, name), (other, source) = data.draw(st.sampled_from(places)), data.draw(st.sampled_from(places))
        change = data.draw(st.sampled_from(["exchange", "fill", "remove", "double"]))
        if change == "exchange":
            put(element, name, get(other, source))
        elif change == "fill":
            put(element, name, data.draw(strategies.xml_texts))
        elif element.getparent() is not None:
            parent = element.getparent()
            parent.remove(element) if change == "remove" else parent.append(deepcopy(element))
    path = tmp_path_factory.mktemp("damaged") / "m.arxml"
    path.write_bytes(etree.tostring(root))
    try:
        imported = IN.read([str(path)], ArxmlImportOptions())
    except HalpipeError as refused:
        assert refused.diagnostics, "a refusal needs a reason"  # noqa: PT017 - both ways out are allowed
    else:
        assert parse_model(format_model(imported.model), "m.xml") == imported.model


def stripped(data):
    """An export without special data: what a tool sees that does not know halpipe."""
    root = etree.fromstring(data)
    for element in list(root.iter("{*}ADMIN-DATA")):
        element.getparent().remove(element)
    return etree.tostring(root)


def latency_left(model, chain):
    """The latency that a limit of the reaction time leaves, whatever the slack of the first task does."""
    first = model.task(chain.tasks[0])
    left = None if chain.max_reaction is None else chain.max_reaction - first.period * (1 + first.slack)
    return left if left and left > ZERO else None


@pytest.mark.parametrize("make", [valid_system, switching_system])
@FAST
@given(seed=st.integers(0, 10**6))
def test_standard_elements_speak_for_themselves(tmp_path_factory, make, seed):
    """Without special data periods, offsets, deadlines, execution times, windows, chains and modes are still there."""
    model, _ = make(random.Random(seed))
    path = tmp_path_factory.mktemp("stripped") / "m.arxml"
    path.write_bytes(stripped(OUT.write(model, None, ArxmlOptions())[""]))
    periodic = {task.name: task for task in model.tasks if task.period is not None}
    assume(len(periodic) == len(model.tasks))
    assume(all(len(chain.tasks) > 1 for chain in model.chains))  # else it looks like a deadline
    found = IN.read([str(path)], ArxmlImportOptions()).model
    name = {task.name: f"{task.name}/{task.name}" for task in model.tasks}
    for task in model.tasks:
        seen = found.task(name[task.name])
        assert (seen.period, seen.deadline) == (task.period, task.deadline)
        assert (seen.offset or ZERO) == (task.offset or ZERO)
        if len(task.versions) == 1:
            (alone,), (version,) = task.versions, seen.versions
            assert version.wcet == alone.wcet
            windows = {(name[p.task], p.min, p.max, p.anchor) for p in alone.precedences}
            assert {(p.task, p.min, p.max, p.anchor) for p in version.precedences} == windows
    chains = {c.name: ([name[t] for t in c.tasks], latency_left(model, c), c.max_age) for c in model.chains}
    assert {c.name: (list(c.tasks), c.max_latency, c.max_age) for c in found.chains} == chains
    assert {c.max_reaction for c in found.chains} <= {None}
    disabled = any(len(mode.runs) < len(model.tasks) for mode in model.modes)
    if disabled:
        runs = {mode.name: {name[run.task] for run in mode.runs} for mode in model.modes}
        assert {mode.name: {run.task for run in mode.runs} for mode in found.modes} == runs
