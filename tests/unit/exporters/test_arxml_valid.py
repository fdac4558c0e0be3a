"""Exported ARXML is valid for an independent implementation of the schemas: autosar-data, strict, in every release."""

from dataclasses import replace

import exporter_samples
import pytest
from lxml import etree

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.arxml import FORMAT, RELEASES, ArxmlOptions, export
from support import after, chain, job, mode, model, schedule, task, version

autosar_data = pytest.importorskip("autosar_data", reason="autosar-data is not installed (pip install halpipe[arxml])")


def check(path, data):
    """Load a file strictly; return the references that lead nowhere, those to definitions of parameters apart."""
    path.write_bytes(data)
    loaded = autosar_data.AutosarModel()
    _, warnings = loaded.load_file(str(path), True)
    assert warnings == []
    broken = (element for element in loaded.check_references() if element.element_name != "DEFINITION-REF")
    return [element.character_data for element in broken]


@pytest.mark.parametrize("release", RELEASES)
@pytest.mark.parametrize("sample", ["roboracer", "two_modes", "thirds", "split"])
def test_exports_are_valid_and_every_reference_leads_somewhere(tmp_path, sample, release):
    model, plan = getattr(exporter_samples, sample)()
    assert check(tmp_path / "a.arxml", FORMAT.write(model, plan, ArxmlOptions(release=release))[""]) == []
    assert check(tmp_path / "b.arxml", FORMAT.write(model, None, ArxmlOptions(release=release))[""]) == []


def test_units_that_are_nested_in_one_element_are_valid(tmp_path):
    tasks = [task(name, 10, version("v", 1, units)) for name, units in {"one": "a b", "two": "b c"}.items()]
    data = FORMAT.write(model(*tasks, units="a b c"), None, ArxmlOptions())[""]
    assert data.count(b"<NESTED-ELEMENTS>") == 2
    assert check(tmp_path / "a.arxml", data) == []


def test_the_validator_sees_faults(tmp_path):
    model, plan = exporter_samples.roboracer()
    data = FORMAT.write(model, plan, ArxmlOptions())[""]
    assert check(tmp_path / "a.arxml", data.replace(b"</SHORT-NAME>", b"x</SHORT-NAME>", 1)) != []
    with pytest.raises(autosar_data.AutosarDataError):
        check(tmp_path / "b.arxml", data.replace(b"PERIODIC-EVENT-TRIGGERING", b"PERIODIC-EVENT"))


@pytest.mark.parametrize("release", RELEASES)
def test_names_of_the_model_do_not_clash_with_those_that_every_export_has(tmp_path, release):
    names = (
        "Every Mode Behavior OsOS OSDEFAULTAPPMODE Mode_Mode_Memory Idle_Memory Counter_Memory Start_Mode Order at_0"
    )
    names = [*names.split(), "mode", "ORDER", "Order_started", "Application_Memory", "Guarantees_Mode", "Requirements"]
    tasks = [task(name, 100, version(name, 1, "Memory", after("Order", 0, 90))) for name in names if name != "Order"]
    tasks.append(task("Order", 100, version("Every", 1, "Memory")))
    system = model(
        *tasks,
        units="Memory ProcessingUnit",
        resources="memory",
        name="System",
        chains=[chain(name, f"Order {name}", 200) for name in names if name != "Order"],
        modes=[mode("Mode", tasks), mode("ModeSwitch", tasks[:1]), mode("mode", tasks[:2]), mode("Mode_to_mode", ())],
        transitions=[("Mode", "mode", None), ("Mode", "mode", 5)],
    )
    jobs = [job(system, t.name, 0, 5 * n, "Memory") for n, t in enumerate(tasks)]
    plan = schedule(system, 100, *jobs, mode_name="Mode")
    idle = replace(plan.modes[0], name="Mode_to_mode", jobs=())
    plan = replace(plan, modes=(*plan.modes, idle))
    data = FORMAT.write(system, plan, ArxmlOptions(release=release))[""]
    assert check(tmp_path / "a.arxml", data) == []
    assert twice(data) == []


def twice(data):
    """Short names that two elements of one parent have, whatever their case: AUTOSAR allows none."""
    found = []
    for element in etree.fromstring(data).iter("{*}*"):
        inside = [name.lower() for name in names_inside(element)]
        found += [name for name in inside if inside.count(name) > 1]
    return found


def names_inside(element):
    """The short names of the elements inside one that has a name itself."""
    for child in element:
        name = child.findtext("{*}SHORT-NAME")
        if name is not None:
            yield name
        else:
            yield from names_inside(child)


@pytest.mark.parametrize("sample", ["roboracer", "two_modes", "thirds"])
def test_short_names_are_unique_without_regard_to_case(sample):
    assert twice(FORMAT.write(*getattr(exporter_samples, sample)(), ArxmlOptions())[""]) == []


def test_what_is_too_large_is_refused_and_a_mode_of_it_is_not(monkeypatch):
    """Two modes of one job each, and the two tasks."""
    monkeypatch.setattr(export, "MOST_WRITTEN", 3)
    tasks = task("a", 10, version("v", 1)), task("b", 10, version("v", 1))
    system = model(*tasks, modes=[mode("one", tasks[:1]), mode("two", tasks[1:])])
    jobs = {"one": job(system, "a", 0, 0, "u1"), "two": job(system, "b", 0, 0, "u1")}
    plans = [schedule(system, 10, each, mode_name=name) for name, each in jobs.items()]
    both = replace(plans[0], modes=(*plans[0].modes, *plans[1].modes))
    with pytest.raises(HalpipeError, match=r"HAL0891(?s:.)*2 tasks and 2 jobs; together at most 3 (?s:.)*--mode"):
        FORMAT.write(system, both, ArxmlOptions())
    assert FORMAT.write(system, both, ArxmlOptions(mode="one"))
    assert FORMAT.write(system, None, ArxmlOptions(part="system"))
    monkeypatch.setattr(export, "MOST_WRITTEN", 1)
    with pytest.raises(HalpipeError, match=r"2 tasks and 0 jobs(?s:.)*divide the model"):
        FORMAT.write(system, None, ArxmlOptions())
