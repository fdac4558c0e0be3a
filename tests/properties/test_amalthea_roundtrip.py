"""What goes out as AMALTHEA comes in again as it was, for every release, with and without a schedule."""

import random
from copy import deepcopy

import pytest
from grounded_models import grounded
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from lxml import etree
from verify_systems import switching_system, valid_system

import strategies
from halpipe.core.diagnostics import HalpipeError, Severity
from halpipe.exporters.amalthea import FORMAT as OUT
from halpipe.exporters.amalthea import RELEASES, AmaltheaOptions
from halpipe.exporters.native import format_model
from halpipe.importers.amalthea import FORMAT as IN
from halpipe.importers.amalthea import AmaltheaImportOptions, codes
from halpipe.importers.native import parse_model
from profiles import examples
from support import bare

FAST = examples(40, *HealthCheck)


def again(tmp_path_factory, model, schedule=None, release=RELEASES[-1]):
    """Write and read a model."""
    data = OUT.write(model, schedule, AmaltheaOptions(release=release))[""]
    path = tmp_path_factory.mktemp("amalthea") / "m.amxmi"
    path.write_bytes(data)
    return data, IN.read([str(path)], AmaltheaImportOptions())


def edits(imported):
    return [d for d in imported.diagnostics if d.code == codes.EDITED.id or d.severity is Severity.ERROR]


@pytest.mark.slow
@FAST
@given(strategies.task_models.map(grounded).filter(lambda model: model.tasks), st.sampled_from(RELEASES))
def test_a_model_comes_back_as_it_was(tmp_path_factory, model, release):
    data, imported = again(tmp_path_factory, model, release=release)
    assert bare(imported.model) == bare(model)
    assert edits(imported) == []
    assert again(tmp_path_factory, imported.model, release=release)[0] == data


@pytest.mark.parametrize("make", [valid_system, switching_system])
@FAST
@given(seed=st.integers(0, 10**6))
def test_a_model_comes_back_from_an_export_with_its_schedule(tmp_path_factory, make, seed):
    model, schedule = make(random.Random(seed))
    _, imported = again(tmp_path_factory, model, schedule)
    assert bare(imported.model) == bare(model)
    assert edits(imported) == []


def texts_of(root):
    """Every place of a document where a text stands: an attribute of an element."""
    return [(element, name) for element in root.iter("{*}*") for name in element.attrib]


@FAST
@given(seed=st.integers(0, 10**6), data=st.data())
def test_a_damaged_file_is_refused_or_read_but_never_fails(tmp_path_factory, seed, data):
    """Attributes are exchanged, emptied or filled with anything, and elements removed or doubled."""
    model, schedule = switching_system(random.Random(seed))
    root = etree.fromstring(OUT.write(model, schedule, AmaltheaOptions())[""])
    for _ in range(data.draw(st.integers(1, 4))):
        places = texts_of(root)
        (element, name), (other, source) = data.draw(st.sampled_from(places)), data.draw(st.sampled_from(places))
        change = data.draw(st.sampled_from(["exchange", "fill", "remove", "double", "drop"]))
        if change == "exchange":
            element.set(name, other.get(source))
        elif change == "fill":
            element.set(name, data.draw(strategies.xml_texts))
        elif change == "drop":
            del element.attrib[name]
        elif element.getparent() is not None:
            parent = element.getparent()
            parent.remove(element) if change == "remove" else parent.append(deepcopy(element))
    path = tmp_path_factory.mktemp("damaged") / "m.amxmi"
    path.write_bytes(etree.tostring(root))
    try:
        imported = IN.read([str(path)], AmaltheaImportOptions())
    except HalpipeError as refused:
        assert refused.diagnostics, "a refusal needs a reason"  # noqa: PT017 - both ways out are allowed
    else:
        assert parse_model(format_model(imported.model), "m.xml") == imported.model
