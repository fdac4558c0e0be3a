"""What an overlay does to an imported model, section by section, and how it reports it."""

from dataclasses import replace
from fractions import Fraction

import pytest
from overlay_case import applied, apply, imported, overlay

from halpipe.importers.common.base import Coverage
from halpipe.importers.overlay import OverlayUse, codes
from halpipe.models import (
    AccessKind,
    Anchor,
    Edge,
    HealthAction,
    HealthEvent,
    Match,
    Mode,
    Origin,
    Resource,
    ResourceKind,
    Run,
    Source,
    Split,
    Transfer,
)
from support import access, after, mode, model, ms, task, version

BOARD = "platform: {units: [{name: big0, type: a72}, {name: big1, type: a72}, {name: pl0, type: fpga}], "
BOARD += "resources: [{name: ddr, bandwidth: 19.2GB/s}]}\n"


def of(diagnostics, code):
    return [d for d in diagnostics if d.code == code.id]


def windows(owner):
    return [(p.task, str(p.min), str(p.max), str(p.anchor)) for p in owner.precedences]


# ------------------------------------------------------------------------------------------------ platform


def test_platform_replaces_the_guessed_one_and_tasks_move_to_it(tmp_path):
    coverage = Coverage()
    coverage.defaulted("platform", "units", "core0")  # as importers do that have none
    result, diagnostics = OverlayUse(overlay(tmp_path, BOARD)).apply(imported(), coverage)
    assert [unit.name for unit in result.units] == ["big0", "big1", "pl0"]
    assert {v.units for t in result.tasks for v in t.versions} == {("big0", "big1", "pl0")}
    assert not of(diagnostics, codes.REPLACED)  # none of the source
    assert {d.what for d in coverage.defaulted_values} == {"units"}
    assert len(coverage.defaulted_values) == len(result.tasks)


def test_units_of_the_source_that_the_platform_replaces_are_reported(tmp_path):
    _, diagnostics = OverlayUse(overlay(tmp_path, BOARD)).apply(imported(), Coverage())
    assert [d.message for d in of(diagnostics, codes.REPLACED)] == ["the overlay's replace those of the source: core0"]


def test_units_that_the_platform_keeps_stay_and_lost_ones_are_reported(tmp_path):
    source = model(task("t", 10, version("default", 1, "core0 core1")), units="core0 core1")
    source = replace(source, units=tuple(replace(unit, origin=Origin("board.arxml")) for unit in source.units))
    result, diagnostics, _ = apply(overlay(tmp_path, "platform: {units: [{name: core1}]}"), source)
    assert result.task("t").versions[0].units == ("core1",)
    assert [d.path for d in of(diagnostics, codes.REMOVED)] == ['task "t" version "default"']


def test_a_guessed_unit_holds_no_task_where_the_platform_has_one_of_its_name(tmp_path):
    text = "platform: {units: [{name: core0}, {name: core1}, {name: pl0}]}\n"
    assert {v.units for t in applied(tmp_path, text).tasks for v in t.versions} == {("core0", "core1", "pl0")}
    result = applied(tmp_path, text + 'tasks: {"*": {units: ["core*"]}}')
    assert {v.units for t in result.tasks for v in t.versions} == {("core0", "core1")}


def test_the_same_platform_again_is_no_replacement(tmp_path):
    _, diagnostics, _ = apply(overlay(tmp_path, "platform: {units: [{name: core0}]}"))
    assert diagnostics == ()


def test_elements_of_the_overlay_know_their_place(tmp_path):
    result = applied(tmp_path, BOARD + "tasks: {/planning: {versions: {cpu: {wcet: 1ms}}}}")
    assert result.units[0].origin == Origin(str(tmp_path / "overlay0.yaml"), 2, 'platform unit "big0"')
    version_origin = result.task("/planning").version("cpu").origin
    assert version_origin == Origin(str(tmp_path / "overlay0.yaml"), 3, 'task "/planning" version "cpu"')


def test_unit_globs_expand_over_the_platform_in_order_without_repetition(tmp_path):
    result = applied(tmp_path, BOARD + 'tasks: {/planning: {units: [pl0, "*0", "big*"]}}')
    assert result.task("/planning").versions[0].units == ("pl0", "big0", "big1")


def test_an_access_of_the_source_to_a_resource_that_the_platform_lacks_is_an_error(tmp_path):
    source = model(task("t", 10, version("default", 2, "u1", access("sram", 0, 1))), resources="sram")
    _, diagnostics, _ = apply(overlay(tmp_path, "platform: {resources: [{name: ddr}]}"), source)
    assert [d.code for d in diagnostics if d.is_error] == [codes.UNKNOWN_NAME.id]


# ---------------------------------------------------------------------------------------- tasks and versions


def test_values_of_a_task_are_set_and_replaced_ones_reported_with_both_values(tmp_path):
    text = "tasks: {/planning: {period: 50ms, slack: 0.25, offset: 3ms, deadline: 40ms}}"
    result, diagnostics, _ = apply(overlay(tmp_path, text))
    planning = result.task("/planning")
    assert (planning.period, planning.slack, planning.offset, planning.deadline) == (
        ms(50), Fraction(1, 4), ms(3), ms(40),
    )  # fmt: skip
    assert [(d.path, d.message) for d in diagnostics] == [
        ('task "/planning"', "period: 50ms replaces 100ms of the source")
    ]


def test_the_same_value_again_is_not_reported(tmp_path):
    _, diagnostics, _ = apply(overlay(tmp_path, "tasks: {/control: {period: 50ms, wcet: 2ms, slack: 0}}"))
    assert diagnostics == ()


def test_stated_versions_replace_the_importers_placeholder_and_inherit_its_data_flow(tmp_path):
    text = BOARD + "tasks: {/planning: {versions: {cpu: {wcet: 24ms, units: [big0]}, fpga: {wcet: 6ms, units: [pl0]}}}}"
    result = applied(tmp_path, text)
    planning = result.task("/planning")
    assert [(v.name, v.wcet, v.units) for v in planning.versions] == [
        ("cpu", ms(24), ("big0",)),
        ("fpga", ms(6), ("pl0",)),
    ]
    assert [windows(v) for v in planning.versions] == [[("/sensing/lidar", "0ms", "100ms", "end")]] * 2
    assert result.modes[0].runs[1] == Run(task="/planning", versions=("cpu", "fpga"))


def test_stated_versions_join_an_imported_version_that_has_a_wcet(tmp_path):
    result = applied(tmp_path, "tasks: {/control: {versions: {fast: {wcet: 1ms}}}}")
    assert [(v.name, v.wcet) for v in result.task("/control").versions] == [
        ("default", ms(2)),
        ("fast", ms(1)),
    ]
    assert result.modes[0].runs[2].versions == ("default", "fast")


def test_a_stated_version_of_the_same_name_is_merged(tmp_path):
    text = "tasks: {/control: {versions: {default: {wcet: 3ms, gang: 1}}}}"
    result, diagnostics, _ = apply(overlay(tmp_path, text))
    assert [(v.name, v.wcet) for v in result.task("/control").versions] == [("default", ms(3))]
    assert [d.message for d in diagnostics] == ["WCET: 3ms replaces 2ms of the source"]


def test_a_mode_that_lists_some_versions_keeps_to_them(tmp_path):
    both = task("t", 10, version("a", 1), version("b", 2))
    some = Mode(name="m", runs=(Run(task="t", versions=("b",)),))
    result = applied(
        tmp_path, "tasks: {t: {versions: {c: {wcet: 3ms}}}}", to=model(both, modes=(some, mode("n", (both,))))
    )
    assert [m.runs[0].versions for m in result.modes] == [("b",), ("a", "b", "c")]


def test_values_of_the_task_entry_hold_for_its_versions_that_do_not_state_them(tmp_path):
    text = BOARD + "tasks: {/planning: {units: [big1], wcet: 9ms, versions: {a: {}, b: {wcet: 4ms, units: [pl0]}}}}"
    planning = applied(tmp_path, text).task("/planning")
    assert [(v.wcet, v.units) for v in planning.versions] == [(ms(9), ("big1",)), (ms(4), ("pl0",))]


def test_every_value_of_a_version_arrives(tmp_path):
    text = (
        BOARD
        + """
tasks:
  /planning:
    versions:
      full:
        wcet: 24ms
        units: [big0, big1]
        gang: 2
        access:
          - {resource: ddr, start: 0ms, end: 1ms, bound: 0.35, kind: read,
             transfers: [{buffer: scan, symbol: pf_scan, size: 4320B}]}
        source: {files: [a.c, b.c], entry: run, defines: [N=5]}
"""
    )
    full = applied(tmp_path, text).task("/planning").version("full")
    phase = full.accesses[0]
    assert full.gang == 2
    assert full.source == Source(files=("a.c", "b.c"), entry="run", defines=("N=5",))
    assert (phase.resource, phase.start, phase.end, phase.bound) == ("ddr", ms(0), ms(1), Fraction(7, 20))
    assert phase.kind is AccessKind.READ
    assert phase.transfers == (Transfer(buffer="scan", symbol="pf_scan", size=4320),)


def test_the_star_entry_fills_what_is_missing_and_nothing_else(tmp_path):
    result, diagnostics, coverage = apply(overlay(tmp_path, 'tasks: {"*": {wcet: 1ms}, /planning: {wcet: 7ms}}'))
    assert [t.versions[0].wcet for t in result.tasks] == [ms(1), ms(7), ms(2), ms(1)]
    assert diagnostics == ()
    assert [(d.element, d.what, d.value, d.at.line) for d in coverage.defaulted_values] == [
        ('task "/sensing/lidar" version "default"', "WCET", "1ms", 2),
        ('task "/debug/view" version "default"', "WCET", "1ms", 2),
    ]


def test_versions_of_the_star_entry_are_for_tasks_without_any_wcet(tmp_path):
    result = applied(tmp_path, 'tasks: {"*": {versions: {cpu: {wcet: 1ms}}}}')
    assert [[v.name for v in t.versions] for t in result.tasks] == [["cpu"], ["cpu"], ["default"], ["cpu"]]


def test_the_exact_name_wins_over_globs_and_later_globs_over_earlier_ones(tmp_path):
    text = 'tasks: {/planning: {wcet: 1ms}, "/p*": {wcet: 2ms, slack: 0.5}, "/s*": {wcet: 3ms}, "/s*/l*": {wcet: 4ms}}'
    result = applied(tmp_path, text)
    assert result.task("/planning").versions[0].wcet == ms(1)
    assert result.task("/planning").slack == Fraction(1, 2)
    assert result.task("/sensing/lidar").versions[0].wcet == ms(4)


def test_versions_come_from_the_most_specific_key_and_later_files_refine_them(tmp_path):
    base = 'tasks: {"/p*": {versions: {other: {wcet: 9ms}}}, /planning: {versions: {a: {wcet: 1ms}, b: {wcet: 2ms}}}}'
    later = "tasks: {/planning: {versions: {b: {wcet: 5ms}}}}"
    planning = applied(tmp_path, base, later).task("/planning")
    assert [(v.name, v.wcet) for v in planning.versions] == [("a", ms(1)), ("b", ms(5))]


def test_glob_matching_is_case_sensitive(tmp_path):
    _, diagnostics, _ = apply(overlay(tmp_path, 'tasks: {"/PLAN*": {wcet: 1ms}}'))
    assert [d.code for d in diagnostics] == [codes.MATCHES_NOTHING.id]


# ---------------------------------------------------------------------------------------------------- drops


def test_dropped_tasks_go_with_what_the_source_says_of_them(tmp_path):
    result, diagnostics, _ = apply(overlay(tmp_path, 'drop: ["/debug/*"]'))
    assert [t.name for t in result.tasks] == ["/sensing/lidar", "/planning", "/control"]
    assert [r.task for r in result.modes[0].runs] == ["/sensing/lidar", "/planning", "/control"]
    assert [c.name for c in result.chains] == ["drive"]
    assert [p.task for p in result.task("/control").versions[0].precedences] == ["/planning"]
    assert [d.path for d in of(diagnostics, codes.REMOVED)] == [
        'chain "look"',
        'task "/control" version "default"',
    ]


def test_drop_can_be_stated_with_the_task_and_taken_back_for_one(tmp_path):
    use = OverlayUse(overlay(tmp_path, 'tasks: {"/debug/*": {drop: true}, /debug/view: {drop: false}}'))
    assert [use.drops(name) for name in ("/debug/view", "/debug/plot", "/planning")] == [False, True, False]


def test_the_drop_list_is_asked_for_any_element_and_marks_its_entries_as_used(tmp_path):
    use = OverlayUse(overlay(tmp_path, "drop: [/rviz*, /tf]\ntasks: {/rviz2: {wcet: 1ms}}"))
    assert [use.drops(name) for name in ("/rviz2", "/tf", "/scan")] == [True, True, False]
    _, diagnostics = use.apply(imported(), Coverage())
    assert diagnostics == ()


def test_a_source_that_is_named_stays_where_only_a_glob_drops_it(tmp_path):
    text = "drop: [/plan/*, /map]\nsources: {/plan/path: {period: 9ms}, /map: {period: 1s}, /plan/s*: {period: 1s}}"
    use = OverlayUse(overlay(tmp_path, text))
    assert [use.drops(name) for name in ("/plan/path", "/plan/speed", "/map")] == [False, True, True]


def test_entries_that_match_nothing_do_not_hide_each_other(tmp_path):
    text = "drop: [/rvis]\ntasks: {/plan: {drop: true}, /ctrl: {wcet: 1ms}}\nsources: {/scan: {period: 1ms}}"
    _, diagnostics, _ = apply(overlay(tmp_path, text))
    assert [(d.path, d.message.split('"')[1]) for d in diagnostics] == [
        ("drop", "/rvis"),
        ("tasks", "/ctrl"),
        ("tasks", "/plan"),
        ("sources", "/scan"),
    ]


# --------------------------------------------------------------------------------------------------- sources


def test_source_periods_by_name_and_glob(tmp_path):
    use = OverlayUse(overlay(tmp_path, 'sources: {"/cam*": {period: 50ms}, /camera_left: {period: 20ms}}'))
    periods = [use.source_period(name) for name in ("/camera_left", "/camera_right", "/scan")]
    assert periods == [ms(20), ms(50), None]


# ------------------------------------------------------------------------------------------------ precedence


def test_listed_constraints_reach_every_version_and_replace_the_imported_ones_of_the_pair(tmp_path):
    text = """
tasks: {/planning: {versions: {a: {wcet: 1ms}, b: {wcet: 2ms}}}}
precedence:
  - {from: /sensing/lidar, to: /planning, after: end, max: 2ms}
  - {from: /sensing/lidar, to: /planning, min: 1ms, max: 9ms}
  - {from: /sensing/lidar, to: /control, max: 5ms}
"""
    result, diagnostics, _ = apply(overlay(tmp_path, text))
    expected = [("/sensing/lidar", "0ms", "2ms", "end"), ("/sensing/lidar", "1ms", "9ms", "start")]
    assert [windows(v) for v in result.task("/planning").versions] == [expected, expected]
    assert windows(result.task("/control").versions[0])[-1] == ("/sensing/lidar", "0ms", "5ms", "start")
    assert [d.path for d in of(diagnostics, codes.OVERRIDDEN)] == [
        'task "/planning" version "a"',
        'task "/planning" version "b"',
    ]


def test_a_later_file_replaces_the_constraints_of_a_pair(tmp_path):
    first = "precedence: [{from: /planning, to: /control, max: 2ms}, {from: /planning, to: /control, max: 3ms}]"
    result = applied(tmp_path, first, "precedence: [{from: /planning, to: /control, max: 4ms}]")
    planning = [w for w in windows(result.task("/control").versions[0]) if w[0] == "/planning"]
    assert planning == [("/planning", "0ms", "4ms", "start")]


def test_a_version_that_states_its_constraints_has_exactly_those(tmp_path):
    text = """
tasks: {/planning: {versions: {a: {wcet: 1ms, precedence: []}, b: {wcet: 2ms}}}}
precedence: [{from: /control, to: /planning, max: 2ms}]
"""
    planning = applied(tmp_path, text).task("/planning")
    assert windows(planning.version("a")) == []
    assert [p.task for p in planning.version("b").precedences] == ["/sensing/lidar", "/control"]


# ------------------------------------------------------------------------------- modes, transitions, chains


def test_modes_select_tasks_and_versions(tmp_path):
    text = """
tasks: {/planning: {versions: {a: {wcet: 1ms}, b: {wcet: 2ms}}}}
modes:
  all: {tasks: "*"}
  some: {tasks: [/control, "/plan*"], versions: {"/plan*": [b]}}
transitions: [{from: all, to: some, max-length: 100ms}]
"""
    result, diagnostics, _ = apply(overlay(tmp_path, text))
    picked = {m.name: [(r.task, r.versions) for r in m.runs] for m in result.modes}
    assert picked["some"] == [("/planning", ("b",)), ("/control", ("default",))]
    assert [task_name for task_name, _ in picked["all"]] == [t.name for t in result.tasks]
    assert [(t.source, t.target, t.max_length) for t in result.transitions] == [("all", "some", ms(100))]
    assert len(of(diagnostics, codes.REPLACED)) == 1


def test_a_later_file_replaces_a_mode_of_the_same_name(tmp_path):
    result = applied(tmp_path, 'modes: {m: {tasks: "*"}, n: {tasks: "*"}}', "modes: {m: {tasks: /control}}")
    assert [(m.name, len(m.runs)) for m in result.modes] == [("m", 1), ("n", 4)]


def test_imported_transitions_go_with_their_modes(tmp_path):
    tasks = (task("t", 10, version("v", 1)),)
    source = model(*tasks, modes=(mode("a", tasks), mode("b", tasks)), transitions=[("a", "b", None)])
    result, diagnostics, _ = apply(overlay(tmp_path, "modes: {a: {tasks: t}}"), source)
    assert result.transitions == ()
    assert [d.path for d in of(diagnostics, codes.REMOVED)] == ['transition "a" to "b"']


def test_imported_transitions_are_replaced_by_stated_ones(tmp_path):
    tasks = (task("t", 10, version("v", 1)),)
    source = model(*tasks, modes=(mode("a", tasks), mode("b", tasks)), transitions=[("a", "b", None)])
    result, diagnostics, _ = apply(overlay(tmp_path, "transitions: [{from: b, to: a}]"), source)
    assert [(t.source, t.target) for t in result.transitions] == [("b", "a")]
    assert [d.message for d in of(diagnostics, codes.REPLACED)] == ["the overlay's replace those of the source: a to b"]


def test_chains_join_the_imported_ones_or_replace_those_of_the_same_name(tmp_path):
    text = """
chains:
  - {name: drive, tasks: [/sensing/lidar, /planning, /control], max-reaction: 300ms, max-age: 250ms}
  - {name: short, tasks: [/planning, /control]}
"""
    result, diagnostics, _ = apply(overlay(tmp_path, text))
    assert [c.name for c in result.chains] == ["drive", "look", "short"]
    drive = result.chains[0]
    assert (drive.max_reaction, drive.max_age) == (ms(300), ms(250))
    assert [d.message for d in diagnostics] == ["max-reaction: 300ms replaces 400ms of the source"]


def test_diagnostics_come_in_the_order_of_the_file(tmp_path):
    text = "tasks:\n  /control: {wcet: 3ms}\n  /planning: {period: 50ms}\nchains: [{name: c, tasks: [/x]}]"
    _, diagnostics, _ = apply(overlay(tmp_path, text))
    lines = [d.at.line for d in diagnostics]
    assert lines == sorted(lines) == [3, 4, 5]


RULES = "health: [{task: t, on: overrun, count: 2, cycles: 4, action: switch, mode: b}, {task: t, action: stop}]"


def test_health_rules_replace_the_imported_ones(tmp_path):
    tasks = (task("t", 10, version("v", 1)),)
    source = model(*tasks, modes=(mode("a", tasks), mode("b", tasks)))
    result, _, _ = apply(overlay(tmp_path, RULES), source)
    first, second = result.health
    assert (first.task, first.event, first.count, first.cycles) == ("t", HealthEvent.OVERRUN, 2, 4)
    assert (first.action, first.mode) == (HealthAction.SWITCH, "b")
    assert (second.event, second.action, second.mode) == (HealthEvent.ANY, HealthAction.STOP, "")
    again, diagnostics, _ = apply(overlay(tmp_path, "health: [{task: t, action: restart}]"), result)
    assert [rule.action for rule in again.health] == [HealthAction.RESTART]
    assert [d.message for d in of(diagnostics, codes.REPLACED)] == ["the overlay's replace those of the source: t, t"]


def test_health_rules_go_with_their_modes_and_dropped_tasks(tmp_path):
    tasks = (task("t", 10, version("v", 1)), task("s", 10, version("v", 1)))
    source = model(*tasks, modes=(mode("a", tasks), mode("b", tasks)))
    ruled, _, _ = apply(overlay(tmp_path, RULES), source)
    without_mode, diagnostics, _ = apply(overlay(tmp_path, "modes: {a: {tasks: t}}"), ruled)
    assert [rule.action for rule in without_mode.health] == [HealthAction.STOP]
    assert 'health rule of task "t"' in [d.path for d in of(diagnostics, codes.REMOVED)]
    without_task, _, _ = apply(overlay(tmp_path, "drop: [t]"), ruled)
    assert without_task.health == ()


def test_health_rules_of_nothing_are_errors(tmp_path):
    text = "health: [{task: t, action: switch, mode: c}, {task: u, action: stop}]"
    tasks = (task("t", 10, version("v", 1)),)
    _, diagnostics, _ = apply(overlay(tmp_path, text), model(*tasks, modes=(mode("a", tasks),)))
    assert len([d for d in diagnostics if d.is_error]) == 2


def test_an_overlay_states_instants_cycles_locks_edges_and_logical_execution_times(tmp_path):
    text = """
platform: {units: [{name: u0}], resources: [{name: spin, kind: lock}]}
tasks: {/planning: {let: 40ms}}
precedence:
  - {from: /planning, to: /control, after: point, point: 1ms, until: end, match: cycle, max: 9ms}
modes: {run: {tasks: "*", edge: closed}}
chains: [{name: drive, tasks: [/planning, /control], max-latency: 90ms, from: release, to: start}]
"""
    result, diagnostics, _ = apply(overlay(tmp_path, text))
    assert [d for d in diagnostics if d.is_error] == []
    (lock,) = result.resources
    (run,) = result.modes
    drive = next(chain for chain in result.chains if chain.name == "drive")
    rows = result.task("/control").versions[0].precedences
    (row,) = (row for row in rows if row.task == "/planning")
    assert (lock.kind, run.edge, result.task("/planning").let) == (ResourceKind.LOCK, Edge.CLOSED, ms(40))
    assert (row.anchor, row.point, row.to, row.match) == (Anchor.POINT, ms(1), Anchor.END, Match.CYCLE)
    assert (drive.max_latency, drive.anchor, drive.to) == (ms(90), Anchor.RELEASE, Anchor.START)


def positioned():
    """A task with a lock, points and a window of another task at positions of its execution of 4 ms."""
    inner = replace(version("v", 4, "u1", access("spin", 1, 2)), split=Split(points=(ms(3),)))
    row = replace(after("/a", 0, 5, "point"), point=ms(1))
    system = model(task("/a", 10, inner), task("/b", 10, version("v", 1, "u1", row)), units="u1", resources="spin")
    return replace(system, resources=(Resource(name="spin", kind=ResourceKind.LOCK),))


@pytest.mark.parametrize(
    ("entry", "stays"),
    [
        ("wcet: 6ms", "access phases and preemption points and triggers"),
        ("{wcet: 6ms, split: [5ms]}", "access phases and triggers"),
        ("{wcet: 4ms}", None),
        ("{period: 20ms}", None),
    ],
)
def test_positions_inside_a_job_of_another_wcet_warn(tmp_path, entry, stays):
    text = entry if entry.startswith("{") else f"{{{entry}}}"
    _, diagnostics, _ = apply(overlay(tmp_path, f"tasks: {{/a: {text}}}\n"), positioned())
    messages = [d.message for d in diagnostics if d.code == codes.MOVED_INSIDE.id]
    assert messages == ([] if stays is None else [f"the WCET is 6ms, not 4ms, but {stays} stay where they were"])


@pytest.mark.parametrize(
    ("version", "warns"),
    [
        ("wcet: 3ms", True),
        ("wcet: 3ms, access: []", False),
        ("wcet: 3ms, access: [{resource: spin, start: 1ms, end: 2ms}]", False),
    ],
)
def test_a_version_of_the_overlay_without_the_locks_of_the_source_warns(tmp_path, version, warns):
    text = f"tasks: {{/a: {{versions: {{fast: {{{version}}}}}}}}}\n"
    _, diagnostics, _ = apply(overlay(tmp_path, text), positioned())
    messages = [d.message for d in diagnostics if d.code == codes.MOVED_INSIDE.id]
    assert messages == ["has no access phases, but the source has some of the task, on spin"] * warns


def test_a_chain_through_a_task_that_there_is_not_joins_no_other(tmp_path):
    result, diagnostics, _ = apply(overlay(tmp_path, "chains: [{name: short, tasks: [/planning, /none]}]"))
    assert [c.name for c in result.chains] == ["drive", "look"]
    assert [d.path for d in diagnostics if d.is_error] == ['chain "short"']
