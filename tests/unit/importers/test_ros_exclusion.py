"""Mutually exclusive callback groups as resources: where WCETs are known, and the schedule keeps callbacks apart."""

from dataclasses import replace

import pytest
from ros_case import Overlay, found, reasons, rows

from halpipe.core.diagnostics import Severity
from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.options import RESOURCES, RosImportOptions
from halpipe.models import Job, ModeSchedule, Schedule, Status, Unit
from halpipe.pipeline.verify import verify
from support import ms

GRAPH = """\
named_paths: []
executors:
- {executor_type: single_threaded_executor, executor_name: all, callback_group_names: [/n/both, /n/free]}
nodes:
- node_name: /n
  callback_groups:
  - {callback_group_type: mutually_exclusive, callback_group_name: /n/both, callback_names: [/n/a, /n/b]}
  - {callback_group_type: reentrant, callback_group_name: /n/free, callback_names: [/n/c, /n/d]}
  callbacks:
  - {callback_name: /n/a, callback_type: timer_callback, period_ns: 10000000, symbol: A}
  - {callback_name: /n/b, callback_type: timer_callback, period_ns: 10000000, symbol: B}
  - {callback_name: /n/c, callback_type: timer_callback, period_ns: 10000000, symbol: C}
  - {callback_name: /n/d, callback_type: timer_callback, period_ns: 10000000, symbol: D}
"""
TABLE = "callback,duration_ms\n" + "/n/a,2\n/n/b,3\n" * 10


@pytest.fixture
def grouped(tmp_path):
    def read(table=TABLE, groups=RESOURCES):
        (tmp_path / "a.yaml").write_text(GRAPH)
        (tmp_path / "t.csv").write_text(table)
        options = RosImportOptions(calibrate=(str(tmp_path / "t.csv"),), groups=groups)
        return FORMAT.read([str(tmp_path / "a.yaml")], options)

    return read


def test_a_group_becomes_a_resource_that_its_tasks_need_to_their_end(grouped):
    imported = grouped()
    (resource,) = imported.model.resources
    assert (resource.name, resource.origin.line) == ("/n/both", 7)
    held = {
        task.name: [(a.resource, str(a.start), str(a.end), a.bound) for a in task.versions[0].accesses]
        for task in imported.model.tasks
    }
    assert held == {
        "/n/a": [("/n/both", "0ms", "2ms", 1)],
        "/n/b": [("/n/both", "0ms", "3ms", 1)],
        "/n/c": [],
        "/n/d": [],
    }
    assert rows(imported)["callback_group"] == [2, 1, 1]
    (note,) = found(imported.diagnostics, codes.EXCLUSION)
    assert note.message.startswith("not represented: 1 single-threaded executor,")
    assert note.severity is Severity.NOTE


@pytest.mark.parametrize(("start", "fits"), [(2, True), (1, False), (8, False), (7, True)])
def test_only_schedules_that_keep_them_apart_are_valid(grouped, start, fits):
    """On two units: a runs from 0 to 2 ms, b for 3 ms from `start` in a hyperperiod of 10 ms."""
    model = grouped().model
    tasks = tuple(replace(t, versions=(replace(t.versions[0], units=("u1", "u2")),)) for t in model.tasks[:2])
    mode = replace(model.modes[0], runs=model.modes[0].runs[:2])
    model = replace(model, units=(Unit(name="u1"), Unit(name="u2")), tasks=tasks, modes=(mode,))
    jobs = tuple(
        Job(task=name, index=0, start=ms(begin), end=ms(begin + length), version="default", units=(unit,))
        for name, begin, length, unit in (("/n/a", 0, 2, "u1"), ("/n/b", start, 3, "u2"))
    )
    table = ModeSchedule(name=mode.name, hyperperiod=ms(10), status=Status.VALID, jobs=jobs)
    found_errors = [d for d in verify(model, Schedule(model=model.name, model_sha256="", modes=(table,))) if d.is_error]
    assert (found_errors == []) is fits


def overlaid(model, wcets):
    """Put tasks on two units with WCETs, as an overlay does before the import is completed."""
    units = ("u1", "u2")
    tasks = tuple(
        replace(t, versions=tuple(replace(v, units=units, wcet=wcets.get(t.name, v.wcet)) for v in t.versions))
        for t in model.tasks
    )
    return replace(model, units=tuple(Unit(name=u) for u in units), tasks=tasks)


@pytest.fixture
def pending(tmp_path):
    """Return the import of a graph, still to be completed, and what an overlay makes of its model."""

    def read(wcets, groups=RESOURCES, graph=GRAPH):
        (tmp_path / "a.yaml").write_text(graph)
        imported = FORMAT.read([str(tmp_path / "a.yaml")], RosImportOptions(overlay=Overlay(), groups=groups))
        assert imported.model.resources == ()
        return replace(imported, model=overlaid(imported.model, wcets)).completed()

    return read


def warnings(imported):
    return [d for d in found(imported.diagnostics, codes.EXCLUSION) if d.severity is Severity.WARNING]


def test_wcets_of_an_overlay_make_the_resource(pending):
    imported = pending({"/n/a": ms(2), "/n/b": ms(3)})
    assert [resource.name for resource in imported.model.resources] == ["/n/both"]
    assert [str(a.end) for t in imported.model.tasks for v in t.versions for a in v.accesses] == ["2ms", "3ms"]
    assert warnings(imported) == []


def test_a_group_with_a_callback_without_wcet_is_given_up_with_a_warning(pending):
    imported = pending({"/n/a": ms(2)})
    assert imported.model.resources == ()
    (warning,) = warnings(imported)
    assert '"/n/both"' in warning.message
    assert '"/n/b"' in warning.message
    assert "--calibrate" in warning.help
    assert "/n/both" in reasons(imported, "callback_group")


def test_giving_groups_up_on_request_is_a_warning_too(pending):
    imported = pending({"/n/a": ms(2), "/n/b": ms(3)}, groups="ignored")
    assert imported.model.resources == ()
    assert len(warnings(imported)) == 1


def test_tasks_on_one_unit_need_no_resource(grouped):
    imported = grouped(TABLE.replace("/n/b", "/n/c"))
    assert imported.model.resources == ()
    assert warnings(imported) == []
    assert rows(imported)["callback_group"] == [2, 1, 1]


def test_callbacks_in_no_stated_group_are_in_the_exclusive_one_of_their_node(pending):
    graph = "\n".join(line for line in GRAPH.splitlines() if "reentrant" not in line)
    graph = graph.replace(", /n/free]", "]")
    imported = pending({f"/n/{name}": ms(1) for name in "abcd"}, graph=graph)
    assert [resource.name for resource in imported.model.resources] == ["/n/both", "/n/default_callback_group"]
    held = {t.name: [a.resource for a in t.versions[0].accesses] for t in imported.model.tasks}
    assert held["/n/c"] == held["/n/d"] == ["/n/default_callback_group"]


def test_groups_of_an_unknown_type_are_exclusive(pending):
    graph = GRAPH.replace("callback_group_type: reentrant", "callback_group_type: UNDEFINED")
    imported = pending({f"/n/{name}": ms(1) for name in "abcd"}, graph=graph)
    assert [resource.name for resource in imported.model.resources] == ["/n/both", "/n/free"]


def test_a_callback_that_may_meet_itself_holds_its_group_alone(pending, tmp_path):
    (tmp_path / "a.yaml").write_text(GRAPH.replace("callback_names: [/n/a, /n/b]", "callback_names: [/n/a]"))
    imported = FORMAT.read([str(tmp_path / "a.yaml")], RosImportOptions(overlay=Overlay()))
    model = overlaid(imported.model, {f"/n/{name}": ms(1) for name in "abcd"})
    tasks = tuple(replace(t, deadline=ms(20)) if t.name == "/n/a" else t for t in model.tasks)
    done = replace(imported, model=replace(model, tasks=tasks)).completed()
    assert [resource.name for resource in done.model.resources] == ["/n/both"]
