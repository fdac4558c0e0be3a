from dataclasses import replace
from fractions import Fraction

import pytest
from exporter_samples import roboracer, two_modes

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.selection import refuse_early_phases, refuse_gaps, refuse_let, select
from halpipe.exporters.graph import FORMAT as GRAPH
from halpipe.exporters.report import FORMAT as REPORT
from halpipe.exporters.trace import FORMAT as TRACE
from halpipe.models import ChainLatency, Interrupt, Part, ResourceLoad, Split, Status, TransitionTable, UnitLoad
from support import access, job, model, ms, schedule, task, version


def refused(system, planned, mode=""):
    with pytest.raises(HalpipeError) as caught:
        select(system, planned, mode, "report")
    return [(d.code, d.path, d.message, bool(d.help)) for d in caught.value.diagnostics]


def with_job(planned, **changes):
    table = planned.modes[0]
    jobs = (replace(table.jobs[0], **changes), *table.jobs[1:])
    return replace(planned, modes=(replace(table, jobs=jobs),))


def with_mode(planned, **changes):
    return replace(planned, modes=(replace(planned.modes[0], **changes),))


@pytest.mark.parametrize("exporter", [REPORT, TRACE])
def test_a_format_that_shows_jobs_needs_a_schedule(exporter):
    system, _ = roboracer()
    with pytest.raises(HalpipeError) as caught:
        exporter.write(system, None, exporter.options())
    assert [d.code for d in caught.value.diagnostics] == ["HAL0801"]


@pytest.mark.parametrize("exporter", [REPORT, TRACE, GRAPH])
def test_an_unknown_mode_is_refused_with_the_near_ones(exporter):
    system, planned = two_modes()
    with pytest.raises(HalpipeError) as caught:
        exporter.write(system, planned, exporter.options(mode="racing"))
    (found,) = caught.value.diagnostics
    assert (found.code, found.help) == ("HAL0802", 'did you mean "race"?')


def test_one_mode_is_cut_out_without_its_transitions():
    system, planned = two_modes()
    chosen = select(system, planned, "safe-stop", "report")
    assert [mode.name for mode in chosen.modes] == ["safe-stop"]
    assert chosen.transitions == ()


@pytest.mark.parametrize(
    ("changes", "kind"),
    [
        ({"task": "ghost"}, 'no task "ghost"'),
        ({"version": "ghost"}, 'no version "ghost"'),
        ({"units": ("ghost",)}, 'no unit "ghost"'),
        ({"units": ()}, "no unit"),
    ],
)
def test_names_in_jobs_that_the_model_lacks_are_refused(changes, kind):
    system, planned = roboracer()
    ((code, path, message, help),) = refused(system, with_job(planned, **changes))
    assert code == "HAL0803"
    assert kind in message
    assert path.startswith('mode "all", job 0 of task')
    assert help


def test_names_in_metrics_that_the_model_lacks_are_all_refused():
    system, planned = roboracer()
    planned = with_mode(
        planned,
        unit_loads=(UnitLoad(unit="x1", busy=ms(1), share=Fraction(1)),),
        resource_loads=(ResourceLoad(resource="x2", peak=Fraction(1), mean=Fraction(1)),),
        chains=(ChainLatency(name="x3", reaction=None, age=None),),
    )
    messages = [message for _, _, message, _ in refused(system, planned)]
    assert messages == [f'the model has no {k} "x{n}"' for n, k in enumerate(("unit", "resource", "chain"), 1)]


def test_modes_that_the_model_or_the_schedule_lacks_are_refused():
    system, planned = roboracer()
    assert "ghost" in refused(system, with_mode(planned, name="ghost"))[0][2]
    table = TransitionTable(
        source="all", target="ghost", length=ms(1), worst_latency=ms(1), status=Status.VALID, jobs=()
    )
    ((code, _, message, _),) = refused(system, replace(planned, transitions=(table,)))
    assert (code, message) == ("HAL0803", 'the schedule has no mode "ghost"')


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"start": ms(30), "end": ms(31)}, "start 30ms is outside"),
        ({"start": ms(5), "end": ms(4)}, "end 4ms is before start 5ms"),
        ({"start": ms(0), "end": ms(26)}, "lasts 26ms, longer than the hyperperiod 25ms"),
    ],
)
def test_times_that_cannot_be_drawn_are_refused(changes, words):
    system, planned = roboracer()
    ((code, _, message, _),) = refused(system, with_job(planned, **changes))
    assert code == "HAL0804"
    assert words in message


def test_a_hyperperiod_of_zero_is_refused():
    system, planned = roboracer()
    assert [code for code, *_ in refused(system, with_mode(planned, hyperperiod=ms(0)))] == ["HAL0804"]


def test_times_at_their_limits_are_drawn():
    """A job may start in the last instant of the hyperperiod, last all of it, and last for no time."""
    system, planned = roboracer()
    for start, end in ((ms("24.999999ms"), ms(26)), (ms(0), ms(25)), (ms(3), ms(3))):
        assert select(system, with_job(planned, start=start, end=end), "", "report")
    assert [message for _, _, message, _ in refused(system, with_job(planned, start=ms(25), end=ms(26)))] == [
        "start 25ms is outside the hyperperiod 25ms"
    ]
    below = with_job(planned, start=ms(1) * -1, end=ms(1))
    assert "start -1ms is outside" in refused(system, below)[0][2]


def parts(*spans):
    return tuple(
        Part(start=ms(start), end=ms(end), executed_from=ms(0), executed_to=ms(end - start)) for start, end in spans
    )


@pytest.mark.parametrize(
    ("spans", "fits"),
    [
        (((2, 3), (5, 8)), True),
        (((2, 3), (3, 8)), True),
        (((2, 4), (3, 8)), False),
        (((5, 8), (2, 3)), False),
        (((2, 3), (5, 7)), False),
        (((3, 4), (5, 8)), False),
    ],
)
def test_the_parts_of_a_job_follow_each_other_from_its_start_to_its_end(spans, fits):
    system, planned = roboracer()
    gapped = with_job(planned, start=ms(2), end=ms(8), parts=parts(*spans))
    if fits:
        assert select(system, gapped, "", "report")
    else:
        assert [message for _, _, message, _ in refused(system, gapped)] == [
            "its parts do not follow each other from its start to its end"
        ]


def test_the_parts_of_a_job_may_be_busy_for_a_hyperperiod():
    system, planned = roboracer()
    assert select(system, with_job(planned, start=ms(0), end=ms(60), parts=parts((0, 20), (55, 60))), "", "report")
    (found,) = refused(system, with_job(planned, start=ms(0), end=ms(60), parts=parts((0, 20), (54, 60))))
    assert found[2] == "lasts 26ms, longer than the hyperperiod 25ms"


def gaps(split):
    owner = task("a", 10, replace(version("v", 4), split=split))
    system = model(owner, task("b", 10, version("v", 1)))
    whole = job(system, "a", 0, 0, "u1")
    cut = replace(whole, index=1, start=ms(10), end=ms(15), parts=parts((10, 12), (13, 15)))
    return system, schedule(system, 20, whole, cut, job(system, "b", 0, 5, "u1"))


@pytest.mark.parametrize(("split", "help"), [(Split(points=(ms(2),)), "at points"), (Split(anywhere=True), "anywhere")])
def test_jobs_with_gaps_are_refused_with_what_helps(split, help):
    with pytest.raises(HalpipeError) as caught:
        refuse_gaps(*gaps(split), "a target holds none", "anywhere", "at points")
    (found,) = caught.value.diagnostics
    assert (found.path, found.message, found.help) == (
        'task "a"', "job 1 has 2 parts; a target holds none", help
    )  # fmt: skip


def test_a_let_is_refused_where_nothing_is_copied():
    held, idle = (replace(task(name, 10, version()), let=ms(5)) for name in "ab")
    system = model(held, idle, task("c", 10, version()))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "c", 0, 1, "u1"))
    with pytest.raises(HalpipeError) as caught:
        refuse_let(system, plan, "an engine")
    (found,) = caught.value.diagnostics
    assert (found.path, found.message) == (
        'task "a"', "has the LET 5ms; an engine copies no data at the release and at release + LET"
    )  # fmt: skip
    refuse_let(system, schedule(system, 10, job(system, "c", 0, 1, "u1")), "an engine")


@pytest.mark.parametrize(
    ("start", "split", "is_served", "is_refused"),
    [(1, True, False, True), (1, False, True, True), (1, False, False, False), (0, True, True, False)],
)
def test_a_phase_within_a_job_is_refused_where_jobs_may_be_early(start, split, is_served, is_refused):
    cut = Split(points=(ms(1),)) if split else Split()
    owner = task("a", 10, replace(version("v", 4, "u1", access("r", start, 3)), split=cut))
    system = model(owner, task("b", 10, version("v", 1)), units="u1 u2", resources="r")
    if is_served:
        unit = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms(5), wcet=ms(1)),))
        system = replace(system, units=(unit, system.units[1]))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"))
    if not is_refused:
        refuse_early_phases(system, plan, "it begins at once", "help")
        return
    with pytest.raises(HalpipeError) as caught:
        refuse_early_phases(system, plan, "it begins at once", "help")
    (found,) = caught.value.diagnostics
    assert found.message == "an access phase begins within its jobs, and jobs may be early; it begins at once"
