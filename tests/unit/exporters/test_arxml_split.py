"""Jobs with gaps as OsTasks that wait for events or are preempted, and bound tasks as one OsTask (MODEL 8.4)."""

from dataclasses import replace

import pytest
from exporter_samples import split

from arxml_reading import containers, parameters, references, special, tables, write
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.arxml.codes import ACTIVATED_TWICE, TOO_MANY_EVENTS
from halpipe.exporters.common.codes import PRIORITY_CYCLE
from halpipe.exporters.common.priorities import levels_of, relation_of
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.models import Binding, Interrupt, ModeSchedule, Schedule, Split, Status, TransitionTable
from halpipe.pipeline.parts import job_of
from support import access, job, mode, model, ms, task, version

ANYWHERE = Split(anywhere=True, max_gaps=9)


def cut(*points):
    return Split(points=tuple(map(ms, points)))


def parted(system, name, unit, *spans, index=0):
    """A job of parts (start, executed from, executed to), in milliseconds."""
    spans = [tuple(map(ms, span)) for span in spans]
    return job_of(name, index, system.task(name).versions[0], (unit,), spans, ())


def planned(system, *modes, transitions=()):
    found = tuple(
        ModeSchedule(name=name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs)
        for name, hyperperiod, *jobs in modes
    )
    return Schedule(model="m", model_sha256="", modes=found, transitions=tuple(transitions))


def switch(source, target, length, *jobs):
    return TransitionTable(
        source=source, target=target, length=ms(length), worst_latency=ms(0), status=Status.VALID, jobs=jobs
    )


def events_of(root, task_name):
    """(ticks, event) of one OsTask, table by table."""
    return {
        name: [(at, event) for at, found in table.events.items() for owner, event in found if owner == task_name]
        for name, table in tables(root).items()
    }


def holds_of(root, task_name):
    data = special(containers(root, "OsTask")[task_name], "work")
    return [dict(inner) for key, inner in data if key == "halpipe:hold"]


# ------------------------------------------------------------------------------------------------ split points


def test_the_example_holds_its_tasks_at_the_points_in_use():
    root = write(*split())
    tasks = containers(root, "OsTask")
    assert sorted(tasks) == ["camera", "detect", "fast", "knock", "logger", "slow"]
    # ticks of 0.1 ms; 9 ms is also where the access begins, for which going on may take 0.1 ms
    assert [hold["at"] for hold in holds_of(root, "slow")] == ["4ms", "9ms", "9ms"]
    assert {frozenset(hold) for hold in holds_of(root, "slow")} == {frozenset(("at", "ECUC-CONTAINER-VALUE"))}
    assert events_of(root, "slow")["Mode_run_core1"] == [
        (125, "Hold_slow_1"),
        (225, "Hold_slow_2"),
        (226, "Hold_slow_3"),
    ]
    assert [hold["at"] for hold in holds_of(root, "detect")] == ["10ms"]  # not at 5 ms, nor at 15 ms
    assert events_of(root, "detect")["Mode_run_gpu"] == [(40, "Hold_detect_1")]  # 44 ms of 40
    assert [path.rpartition("/")[2] for key, path in references(tasks["slow"]) if key == "OsTaskEventRef"] == [
        "Hold_slow_1",
        "Hold_slow_2",
        "Hold_slow_3",
    ]
    assert set(containers(root, "OsEvent")) == {"Hold_slow_1", "Hold_slow_2", "Hold_slow_3", "Hold_detect_1"}
    schedules = {name: parameters(found)["OsTaskSchedule"] for name, found in tasks.items()}
    assert schedules == {name: "FULL" if name == "logger" else "NON" for name in tasks}
    priorities = {name: int(parameters(found)["OsTaskPriority"]) for name, found in tasks.items()}
    assert priorities["knock"] > priorities["logger"]
    assert special(tasks["logger"], "work")[-1] == ("halpipe:below", [("ECUC-CONTAINER-VALUE", "/split/Ecu/Os/knock")])


def test_every_event_of_a_bound_model_is_mapped_to_one_os_task():
    versions = version("a", 2, "u1"), version("b", 3, "u1")
    bound = replace(task("t", 10, *versions), binding=Binding.SYSTEM)
    system = model(bound, modes=[mode("x", [bound]), mode("y", [bound])])
    plan = planned(system, ("x", 10, job(system, "t", 0, 0, "u1", "a")), ("y", 10, job(system, "t", 0, 0, "u1", "b")))
    root = write(system, plan)
    assert list(containers(root, "OsTask")) == ["t"]
    (mapping,) = containers(root, "RteEventToTaskMapping").values()
    assert dict(references(mapping))["RteMappedToTaskRef"] == "/m/Ecu/Os/t"
    ran = {c: special(c, "activation") for c in root.iter() if special(c, "activation")}
    assert [path.rpartition("/")[2] for ((_, path),) in ran.values()] == ["t_a", "t_b"]
    assert not holds_of(root, "t")


def test_an_os_task_of_several_versions_says_in_which_it_is_held():
    versions = [replace(version(name, 4, "u1"), split=cut(2)) for name in "ab"]
    bound = replace(task("t", 20, *versions, slack=1), binding=Binding.SYSTEM)
    system = model(bound)
    root = write(system, planned(system, ("all", 20, parted(system, "t", "u1", (0, 0, 2), (5, 2, 4)))))
    assert [{key: value.rpartition("/")[2] for key, value in hold.items()} for hold in holds_of(root, "t")] == [
        {"at": "2ms", "ECUC-CONTAINER-VALUE": "Hold_t_1"}
    ]
    other = job_of("t", 1, versions[1], ("u1",), [tuple(map(ms, span)) for span in ((20, 0, 2), (25, 2, 4))], ())
    plan = planned(system, ("all", 40, parted(system, "t", "u1", (0, 0, 2), (5, 2, 4)), other))
    found = [hold["SWC-IMPLEMENTATION"].rpartition("/")[2] for hold in holds_of(write(system, plan), "t")]
    assert found == ["t_a", "t_b"]
    free = replace(system, tasks=(replace(bound, binding=Binding.JOB),))
    assert list(containers(write(free, plan), "OsTask")) == ["t_a", "t_b"]


def test_a_job_without_a_gap_at_a_point_in_use_is_not_held_there():
    a = task("a", 20, replace(version("v", 4), split=cut(2)), slack=1)
    b = task("b", 40, version("v", 3))
    system = model(a, b)
    jobs = (
        parted(system, "a", "u1", (0, 0, 2), (5, 2, 4)),
        replace(job(system, "a", 1, 20, "u1")),
        job(system, "b", 0, 2, "u1"),
    )
    root = write(system, planned(system, ("all", 40, *jobs)))
    assert events_of(root, "a")["Mode_all_u1"] == [(5, "Hold_a_1"), (20, "Hold_a_1")]
    assert tables(root)["Mode_all_u1"].points == [(0, ["a"]), (2, ["b"]), (5, []), (20, ["a"])]


def test_access_phases_begin_at_their_instants():
    """Where jobs are split or interrupted, one that is done early with its first work must not begin its access."""
    a = task("a", 20, version("v", 6, "u1", access("mem", 3, 5)))
    system = model(a, units="u1 u2", resources="mem")
    plan = planned(system, ("all", 20, job(system, "a", 0, 2, "u1")))
    assert not containers(write(system, plan), "OsEvent")  # a model of before
    served = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(10), wcet=ms(1)),))
    longer = planned(system, ("all", 20, replace(plan.modes[0].jobs[0], end=ms(9))))
    root = write(replace(system, units=(served, system.units[1])), longer)
    assert [hold["at"] for hold in holds_of(root, "a")] == ["3ms"]
    assert events_of(root, "a")["Mode_all_u1"] == [(5, "Hold_a_1")]


@pytest.mark.parametrize("split", [cut(3), ANYWHERE])
def test_an_access_after_a_gap_waits_once_more_for_the_time_that_going_on_may_take(split):
    """It may go on in less, and another job has the resource until then; woken for its access, it would be late."""
    body = replace(version("v", 6, "u1", access("mem", 3, 5)), split=replace(split, resume=ms("0.5ms")))
    system = model(task("a", 20, body), resources="mem")
    late = parted(system, "a", "u1", (2, 0, 3), (9, 3, 6))
    *parts, last = late.parts
    late = replace(late, parts=(*parts, replace(last, end=last.end + ms("0.5ms"))), end=late.end + ms("0.5ms"))
    root = write(system, planned(system, ("all", 20, late)))
    assert [hold["at"] for hold in holds_of(root, "a")] == ["3ms", "3ms"]
    assert events_of(root, "a")["Mode_all_u1"] == [(18, "Hold_a_1"), (19, "Hold_a_2")]
    at_once = replace(system.tasks[0], versions=(replace(body, split=split),))
    system = replace(system, tasks=(at_once,))
    root = write(system, planned(system, ("all", 20, parted(system, "a", "u1", (2, 0, 3), (9, 3, 6)))))
    assert events_of(root, "a")["Mode_all_u1"] == [(9, "Hold_a_1")]


def test_too_many_points_are_refused():
    a = task("a", 200, replace(version("v", 66), split=cut(*range(1, 66))))
    system = model(a)
    spans = [(2 * n, n, n + 1) for n in range(66)]
    with pytest.raises(HalpipeError) as refused:
        write(system, planned(system, ("all", 200, parted(system, "a", "u1", *spans))))
    [found] = refused.value.diagnostics
    assert (found.code, found.message) == (TOO_MANY_EVENTS.id, "would wait for 65 events; a mask has 64")  # HAL0889
    fewer = [(2 * n, n, n + 1) for n in range(64)] + [(128, 64, 66)]
    write(system, planned(system, ("all", 200, parted(system, "a", "u1", *fewer))))


def test_an_os_task_that_waits_for_events_is_not_activated_while_it_runs():
    system = model(task("a", 20, replace(version("v", 4), split=cut(2)), slack=1))
    write(system, planned(system, ("all", 20, parted(system, "a", "u1", (2, 0, 2), (19, 2, 4)))))
    with pytest.raises(HalpipeError) as refused:
        write(system, planned(system, ("all", 20, parted(system, "a", "u1", (2, 0, 2), (20, 2, 4)))))
    [found] = refused.value.diagnostics
    assert (found.code, found.path) == (ACTIVATED_TWICE.id, 'OsTask "a"')


# ---------------------------------------------------------------------------------------------------- switches


def two_modes_with_a_job_in_progress():
    """A job of "before" goes on 3 and 13 ms after the switch, which takes 5 ms; "after" plays 10 ms."""
    long = task("long", 20, replace(version("v", 5), split=cut(2, 4)), slack=1)
    short = task("short", 10, version("v", 1))
    system = model(
        long, short, modes=[mode("before", [long]), mode("after", [short])], transitions=[("before", "after", 5)]
    )
    started = parted(system, "long", "u1", (15, 0, 2), (23, 2, 4), (33, 4, 5))
    plan = planned(
        system,
        ("before", 20, started),
        ("after", 10, job(system, "short", 0, 1, "u1")),
        transitions=[switch("before", "after", 5)],
    )
    return system, plan


def test_jobs_in_progress_are_held_across_the_switch():
    root = write(*two_modes_with_a_job_in_progress())
    found = tables(root)
    assert events_of(root, "long") == {
        "Mode_before_u1": [(3, "Hold_long_1"), (13, "Hold_long_2")],
        "Mode_after_u1": [],
        "Switch_before_to_after_u1": [(3, "Hold_long_1"), (13, "Hold_long_2")],
    }
    # its last part ends 14 ms after the switch, so that the first cycle of "after" is part of the table
    assert found["Switch_before_to_after_u1"].duration == 15
    assert found["Switch_before_to_after_u1"].points == [(3, []), (6, ["short"]), (13, [])]


def test_a_switch_without_length_gets_a_table_for_jobs_in_progress():
    system, plan = two_modes_with_a_job_in_progress()
    root = write(system, replace(plan, transitions=(switch("before", "after", 0),)))
    assert tables(root)["Switch_before_to_after_u1"].duration == 20


# -------------------------------------------------------------------------------------------------- priorities


def nested():
    """k is interrupted by i, and i by j; n is never interrupted."""
    tasks = [task(name, 40, replace(version("v", 6), split=ANYWHERE)) for name in "ijk"] + [
        task("n", 40, version("v", 2))
    ]
    system = model(*tasks)
    jobs = (
        parted(system, "k", "u1", (0, 0, 3), (23, 3, 6)),
        parted(system, "i", "u1", (3, 0, 2), (12, 2, 6)),
        parted(system, "j", "u1", (5, 0, 6)),
        job(system, "n", 0, 30, "u1"),
    )
    return system, planned(system, ("all", 40, *jobs))


def test_who_starts_in_a_gap_is_above():
    system, plan = nested()
    relation = relation_of(system, plan)
    assert relation == {"u1": {"k": {"i", "j"}, "i": {"j"}}}
    assert levels_of(relation) == {"u1": {"k": 0, "i": 1, "j": 2}}
    tasks = containers(write(system, plan), "OsTask")
    assert {n: parameters(c)["OsTaskPriority"] for n, c in tasks.items()} == {"i": "2", "j": "3", "k": "1", "n": "1"}
    assert {n for n, c in tasks.items() if parameters(c)["OsTaskSchedule"] == "FULL"} == {"i", "k"}


def test_gaps_behind_the_end_of_the_hyperperiod_count():
    tasks = [task("k", 20, replace(version("v", 6), split=ANYWHERE), slack=1), task("i", 20, version("v", 2))]
    system = model(*tasks)
    wrapped = parted(system, "k", "u1", (15, 0, 3), (25, 3, 6))
    plan = planned(system, ("all", 20, wrapped, job(system, "i", 0, 1, "u1")))
    assert relation_of(system, plan) == {"u1": {"k": {"i"}}}


def cycle():
    """MODEL 8: at 65 i interrupts k, at 120 k interrupts i; no fixed priorities give this table."""
    tasks = [
        task("i", 300, replace(version("v", 20), split=ANYWHERE)),
        task("k", 300, replace(version("v", 20), split=ANYWHERE)),
    ]
    system = model(*tasks, modes=[mode("one", tasks), mode("two", tasks)])
    first = parted(system, "k", "u1", (60, 0, 5), (85, 5, 20)), job(system, "i", 0, 65, "u1")
    second = parted(system, "i", "u1", (110, 0, 10), (140, 10, 20)), job(system, "k", 0, 120, "u1")
    return system, planned(system, ("one", 300, *first), ("two", 300, *second))


def test_a_cycle_of_priorities_is_refused_and_named():
    with pytest.raises(HalpipeError) as refused:
        write(*cycle())
    (found,) = refused.value.diagnostics
    assert (found.code, found.path) == (PRIORITY_CYCLE.id, 'unit "u1"')  # HAL0809
    assert found.message in (
        'no fixed priorities play the table: "i" above "k" above "i"',
        'no fixed priorities play the table: "k" above "i" above "k"',
    )


def test_tables_count_for_priorities():
    system, plan = cycle()
    alone = replace(plan, modes=(plan.modes[0], replace(plan.modes[1], jobs=())))
    relation_of(system, alone)
    table = switch("one", "two", 200, *plan.modes[1].jobs)
    assert relation_of(system, replace(alone, transitions=(table,))) == {"u1": {"k": {"i"}, "i": {"k"}}}


# ------------------------------------------------------------------------------------------------- and back again


def test_the_model_comes_back_with_what_it_says_of_splitting(tmp_path):
    from halpipe.exporters.arxml import FORMAT as EXPORTER
    from halpipe.exporters.arxml import ArxmlOptions

    system, plan = split()
    path = tmp_path / "ecu.arxml"
    path.write_bytes(EXPORTER.write(system, plan, ArxmlOptions())[""])
    back = FORMAT.read([str(path)], ArxmlImportOptions()).model
    assert [replace(t, origin=None) for t in back.tasks] == [replace(t, origin=None) for t in system.tasks]
    assert [(u.name, u.interrupts) for u in back.units] == [(u.name, u.interrupts) for u in system.units]


def over_a_switch(*spans):
    """A job of "before", and "after" plays 10 ms; the switch takes 5 ms."""
    long = task("long", 20, replace(version("v", 6), split=ANYWHERE), slack=1)
    short, other = task("short", 10, version("v", 1)), task("other", 20, version("v", 1))
    apart = task("apart", 20, version("v", 1, "u2"))  # on another unit, and over at once
    modes = [mode("before", [long, apart]), mode("after", [short])]
    tasks = (long, short, other, apart)
    system = model(*tasks, units="u1 u2", modes=modes, transitions=[("before", "after", 5)])
    started = parted(system, "long", "u1", *spans)
    return relation_of(system, planned(
        system,
        ("before", 20, started, job(system, "apart", 0, 3, "u2")),
        ("after", 10, job(system, "short", 0, 1, "u1")),
        transitions=[switch("before", "after", 5, job(system, "other", 0, 2, "u1"))],
    ))  # fmt: skip


@pytest.mark.parametrize(
    ("spans", "above"),
    [
        (((2, 0, 2), (10, 2, 6)), set()),  # it is over before the switch
        (((15, 0, 2), (23, 2, 6)), {"other"}),  # at 22, in the table
        (((15, 0, 2), (22, 2, 6)), set()),
        (((15, 0, 4), (26, 4, 6)), {"other"}),
        (((15, 0, 4), (27, 4, 6)), {"other", "short"}),  # at 26, in the first cycle of "after"
        (((17, 0, 6), (43, 6, 6)), {"other", "short"}),
        (((19, 0, 4), (37, 4, 6)), {"short"}),  # it was preempted after 22
    ],
)
def test_who_starts_in_a_gap_that_reaches_over_a_switch_is_above(spans, above):
    assert over_a_switch(*spans) == ({"u1": {"long": above}} if above else {})


def test_gaps_at_preemption_points_are_no_matter_of_priorities():
    """The OsTask waits there; another one is interrupted anywhere."""
    tasks = [
        task("k", 20, replace(version("v", 6), split=cut(3))),
        task("i", 20, replace(version("v", 2), split=ANYWHERE)),
    ]
    system = model(*tasks)
    jobs = (parted(system, "k", "u1", (0, 0, 3), (8, 3, 6)), job(system, "i", 0, 4, "u1"))
    assert relation_of(system, planned(system, ("all", 20, *jobs))) == {}
