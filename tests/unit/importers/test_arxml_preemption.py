"""OsTaskSchedule and runnables to split points, cores to bindings, OsIsr to interrupts (MODEL 8.1)."""

import pytest
from arxml_case import (
    component,
    configuration,
    container,
    every,
    execution_time,
    found,
    implementation,
    mapped,
    os_task,
    package,
    rte,
    write,
)

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import TOO_MUCH
from halpipe.importers.arxml import FORMAT, codes
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.importers.overlay import OverlayUse, read_overlays
from halpipe.models import WHOLE, Binding, Split

UPPER = ("ANALYZED-EXECUTION-TIME", "WORST-CASE-EXECUTION-TIME")


def ms(text):
    return Duration.parse(text)


def project(folder, schedule, *more, times=(1, 7)):
    """An OsTask that runs /T/Pump's runnables One and Two every 100 ms; `times` are theirs in milliseconds."""
    pump = component("Pump", every("0.1", "A", "Pump/One"), every("0.1", "B", "Pump/Two"), runnables="One Two")
    params = {"OsTaskSchedule": schedule} if schedule else {}
    main = os_task("Main", **params)
    os = configuration("Os", main, *more)
    mappings = configuration("Rte", rte(mapped("Pump/B/A", "Main", "1"), mapped("Pump/B/B", "Main", "2")))
    stated = [
        execution_time("ANALYZED", f"{name}Time", f"Pump/{name}", "WORST-CASE-EXECUTION-TIME", 1000 * time)
        for name, time in zip(("One", "Two"), times, strict=False)
        if time is not None
    ]
    return write(folder, package("T", pump, implementation(*stated)), package("E", os, mappings))


def imported(folder, schedule, *more, overlay="", times=(1, 7), **options):
    used = None
    if overlay:
        file = folder / "overlay.yaml"
        file.write_text("halpipe-overlay: 1\n" + overlay)
        used = OverlayUse(read_overlays([str(file)]))
    return FORMAT.read(
        [str(project(folder, schedule, *more, times=times))], ArxmlImportOptions(overlay=used, **options)
    )


def split_of(folder, schedule, name="Main", granularity="ostask", **options):
    found = imported(folder, schedule, granularity=granularity, **options)
    return found.model.task(name).versions[0].split


def cut(*points):
    return Split(points=tuple(map(ms, points)))


@pytest.mark.parametrize(("schedule", "split"), [("FULL", cut("1ms", "6ms")), ("NON", WHOLE), ("", WHOLE)])
def test_preemptive_os_tasks_may_be_interrupted_between_and_within_runnables(tmp_path, schedule, split):
    assert split_of(tmp_path, schedule) == split
    said = found(imported(tmp_path, schedule, granularity="ostask"), codes.CUT_RUNNABLES)
    assert bool(said) == (schedule == "FULL")


def test_the_longest_piece_is_chosen(tmp_path):
    assert split_of(tmp_path, "FULL", pieces=ms("3ms")) == cut("1ms", "4ms", "7ms")
    assert split_of(tmp_path, "FULL", pieces=ms("0ms")) == cut("1ms")


def test_single_runnables_are_cut_by_length_only(tmp_path):
    assert split_of(tmp_path, "FULL", "Pump/One", "runnable") == WHOLE
    assert split_of(tmp_path, "FULL", "Pump/Two", "runnable") == cut("5ms")


def test_the_overlay_may_state_what_runnables_take(tmp_path):
    overlay = 'tasks:\n  "Pump/Two": {wcet: 3ms}\n'
    task = imported(tmp_path, "FULL", overlay=overlay, times=(1, None), granularity="ostask").model.task("Main")
    assert (task.versions[0].wcet, task.versions[0].split) == (ms("4ms"), cut("1ms"))
    without = imported(tmp_path, "FULL", times=(1, None), granularity="ostask").model.task("Main").versions[0]
    assert (without.wcet, without.split) == (None, WHOLE)


def test_a_time_that_the_overlay_states_for_the_whole_leaves_no_point_behind_its_end(tmp_path):
    overlay = 'tasks:\n  "M*": {wcet: 6ms}\n'
    assert split_of(tmp_path, "FULL", overlay=overlay) == cut("5ms")


@pytest.mark.parametrize(
    ("times", "more", "wcet", "points"),
    [
        ((1, 7), "", "8ms", ("1ms", "6ms")),  # all is known: nothing is left to fill in
        ((1, None), "", "6ms", ("5ms",)),
        ((1, None), '  "Pump/Two": {wcet: 3ms}\n', "4ms", ("1ms",)),
        ((None, None), '  "Pump/*": {wcet: 2ms}\n', "4ms", ("2ms",)),
        ((None, None), '  "Pump/*": {wcet: 2ms}\n  "Pump/Two": {wcet: 1ms}\n', "3ms", ("2ms",)),
    ],
)
def test_the_default_entry_cuts_only_what_it_fills_in(tmp_path, times, more, wcet, points):
    overlay = 'tasks:\n  "*": {wcet: 6ms}\n' + more
    done = imported(tmp_path, "FULL", overlay=overlay, times=times, granularity="ostask")
    model, said = OverlayUse(read_overlays([str(tmp_path / "overlay.yaml")])).apply(done.model, done.coverage)
    assert [d for d in said if d.is_error and "Pump/" not in d.message] == []
    task = model.task("Main")
    assert (task.versions[0].wcet, task.versions[0].split) == (ms(wcet), cut(*points))


def application(name, core, **refs):
    targets = [(key, f"/E/Os/{target}") for key, target in refs.items()]
    return container("Os/OsApplication", name, params={"OsApplicationCoreAssignment": core}, refs=targets)


def test_a_task_of_an_application_with_a_core_is_bound(tmp_path):
    bound = imported(tmp_path, "NON", application("App", "1", OsAppTaskRef="Main"), granularity="ostask")
    assert bound.model.task("Main").binding is Binding.SYSTEM
    assert imported(tmp_path, "NON", granularity="ostask").model.task("Main").binding is Binding.JOB


def isr(name, protection=None):
    kind = "Os/OsIsr"
    inside = [container(f"{kind}/OsIsrTimingProtection", "P", params=protection)] if protection else []
    return container(kind, name, *inside)


PROTECTION = {"OsIsrExecutionBudget": "0.00002", "OsIsrTimeFrame": "0.002"}


def test_interrupt_routines_with_a_timing_protection_are_interrupts(tmp_path):
    app = application("App", "1", OsAppTaskRef="Main", OsAppIsrRef="Can")
    model = imported(tmp_path, "NON", app, application("Other", "0"), isr("Can", PROTECTION)).model
    assert {unit.name: [(i.name, i.distance, i.wcet) for i in unit.interrupts] for unit in model.units} == {
        "core0": [],
        "core1": [("Can", ms("2ms"), ms("20us"))],
    }


def test_interrupt_routines_without_a_time_are_a_warning_until_the_overlay_states_them(tmp_path):
    routines = (isr("Can"), isr("Tick", {"OsIsrExecutionBudget": "0.00002"}))
    said = found(imported(tmp_path, "NON", *routines), codes.UNKNOWN_INTERRUPT)
    assert [(d.severity, d.message) for d in said] == [
        ("warning", "2 interrupt routines have no time, distance or core: Can, Tick")
    ]
    overlay = "platform:\n  interrupts:\n"
    overlay += '    - {name: Can, distance: 1ms, wcet: 10us, units: "*"}\n'
    said = found(imported(tmp_path, "NON", *routines, overlay=overlay), codes.UNKNOWN_INTERRUPT)
    assert [d.message for d in said] == ["1 interrupt routines have no time, distance or core: Tick"]
    counted = imported(tmp_path, "NON", *routines, overlay=overlay).coverage.rows()
    assert ("OsIsr", 2, 1, 1) in counted


def test_as_many_pieces_as_nobody_can_use_are_refused_with_what_to_do(tmp_path):
    with pytest.raises(HalpipeError) as refused:
        imported(tmp_path, "FULL", granularity="ostask", pieces=ms("1ns"))
    (told,) = refused.value.diagnostics
    assert (told.code, told.path) == (TOO_MUCH.id, 'task "Main"')
    assert "1000000 pieces of 1ns" in told.message
    assert told.at.line
