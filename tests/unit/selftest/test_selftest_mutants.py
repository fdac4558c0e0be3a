"""Mutants of the self-test: each fault changes something, and times multiplied by a fraction leave a schedule valid."""

from fractions import Fraction
from random import Random

import pytest
from lxml import etree

from halpipe.exporters.native import format_model, format_schedule
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.checked import verify_schedule
from halpipe.selftest import mutants
from halpipe.selftest.run import run, systems
from profiles import volume


@pytest.fixture(scope="module")
def known():
    return {name: (format_model(model), format_schedule(schedule)) for name, model, schedule in systems(1)}


@pytest.mark.parametrize("fault", mutants.OPERATORS)
def test_each_fault_changes_a_model_or_a_schedule(known, fault):
    changed = set()
    for name, texts in known.items():
        for seed in range(12):
            trees = [etree.fromstring(text) for text in texts]
            mutants.with_tables(trees[1])
            before = [etree.tostring(tree) for tree in trees]
            mutants.OPERATORS[fault](Random(seed), *trees)
            changed |= {name} if [etree.tostring(tree) for tree in trees] != before else set()
    assert changed


def test_what_is_shipped_has_switches_parts_and_jobs_on_demand(known):
    _, schedule = known["modes"]
    assert b"<transition " in schedule
    assert b'task="map"' in schedule
    assert b"<part " in known["split"][1]
    assert len(known) > 2


@pytest.mark.parametrize("factor", [Fraction(1, 3), Fraction(7, 11), Fraction(22)])
def test_fractions_of_all_times_leave_it_valid(known, factor):
    for name, texts in known.items():
        model, schedule = (etree.fromstring(text) for text in texts)
        for kind in ("cost", "unit-load", "resource-load"):
            for element in list(schedule.iter(mutants.SCHEDULE + kind)):
                element.getparent().remove(element)
        schedule.attrib.pop("model-sha256", None)
        mutants.scaled(model, factor)
        mutants.scaled(schedule, factor)
        read = parse_model(etree.tostring(model), name), parse_schedule(etree.tostring(schedule), name)
        assert [found for found in verify_schedule(*read) if found.is_error] == []


def test_a_cycle_of_the_mode_to_come_is_a_valid_table(known):
    model, schedule = (etree.fromstring(text) for text in known["modes"])
    schedule.attrib.pop("model-sha256", None)
    mutants.with_tables(schedule)
    assert len(schedule.findall(f"{mutants.SCHEDULE}transition/{mutants.SCHEDULE}job")) > 20
    read = parse_model(etree.tostring(model), "m"), parse_schedule(etree.tostring(schedule), "s")
    assert [found for found in verify_schedule(*read) if found.is_error] == []


@pytest.mark.slow  # test_cli_selftest.py has the quicker one
def test_the_checkers_agree_on_many():
    count = volume(500)
    outcome = run(count, 11)
    assert outcome.differing == []
    assert min(outcome.valid, outcome.broken) > count // 4
