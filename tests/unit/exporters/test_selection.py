from dataclasses import replace
from fractions import Fraction

import pytest
from exporter_samples import roboracer, two_modes

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.selection import select
from halpipe.exporters.graph import FORMAT as GRAPH
from halpipe.exporters.report import FORMAT as REPORT
from halpipe.exporters.trace import FORMAT as TRACE
from halpipe.models import ChainLatency, ResourceLoad, Status, TransitionTable, UnitLoad
from support import ms


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
