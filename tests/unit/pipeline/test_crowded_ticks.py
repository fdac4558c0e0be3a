"""With a tick, one job can start at each tick of a unit: too many jobs are proven by counting, not searched for."""

from dataclasses import replace

import pytest

from halpipe.api import validate
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.models import Interrupt
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.codes import TOO_MANY_STARTS
from halpipe.pipeline.solve.limits import check_starts
from halpipe.pipeline.solve.schedule import SearchOptions
from support import mode, model, ms, task, version


def crowd(count, *, units="u", wcet="50us", period=10):
    tasks = [task(f"t{i}", period, version("v", wcet, units)) for i in range(count)]
    return model(*tasks, units=units)


def told(system, tick="1ms"):
    return list(check_starts(system, ms(tick)))


@pytest.mark.parametrize(
    ("count", "options", "fits"),
    [
        (10, {}, True),
        (11, {}, False),
        (20, {"units": "u v"}, True),
        (21, {"units": "u v"}, False),
        (5, {"wcet": "1001us"}, True),
        (6, {"wcet": "1001us"}, False),
        (10, {"wcet": "1ms"}, True),
    ],
)
def test_each_job_takes_whole_ticks(count, options, fits):
    assert [d.code for d in told(crowd(count, **options))] == ([] if fits else [TOO_MANY_STARTS.id])


def test_the_proof_counts_and_names_a_tick_that_would_do():
    (proof,) = told(crowd(13))
    assert 'the 13 jobs of the tasks that can run only on "u" take 13ms of the 10ms' in proof.message
    assert "use a tick of 500us" in proof.help
    assert "--granularity ostask" in proof.help
    assert told(crowd(13), "500us") == []


def test_each_crowd_has_a_finer_tick_of_its_own():
    """Ten tasks that nearly take 1 ms leave room for an eleventh from 10 us on only; those of others are no matter."""
    short = [task(f"short{i}", 10, version("v", "50us", "u")) for i in range(13)]
    long = [task(f"long{i}", 10, version("v", "990us", "v")) for i in range(10)]
    last, again = task("last", 10, version("v", "50us", "v")), [replace(t, name=f"more-{t.name}") for t in long]
    again = [replace(t, versions=(replace(t.versions[0], units=("u",)),)) for t in again]
    modes = [mode("one", [*short, *long, last]), mode("two", [*again, short[0]])]
    system = model(*short, *long, last, *again, units="u v", modes=modes)
    helps = {(d.path, d.message.split('"')[1]): d.help.split(" or ")[0] for d in told(system)}
    assert helps == {
        ('mode "one"', "u"): "use a tick of 500us",
        ('mode "one"', "v"): "use a tick of 10us",
        ('mode "two"', "u"): "use a tick of 10us",
    }


def test_interrupts_may_come_in_the_rest_of_a_tick():
    system = crowd(10)
    busy = replace(system.units[0], interrupts=(Interrupt(name="i", distance=ms("1ms"), wcet=ms("100us")),))
    assert told(replace(system, units=(busy,))) == []


def test_the_search_is_not_begun():
    with pytest.raises(HalpipeError) as refused:
        schedule_model(crowd(13), SearchOptions(tick=ms("1ms")), lambda *_: pytest.fail("a search began"))
    assert refused.value.exit is Exit.INFEASIBLE
    assert {d.code for d in refused.value.diagnostics} == {TOO_MANY_STARTS.id}
    assert schedule_model(crowd(13), SearchOptions(tick=ms("500us")), lambda *_: True).is_complete
    assert schedule_model(crowd(10), SearchOptions(tick=ms("1ms")), lambda *_: True).is_complete


def test_validate_has_the_proof_beside_a_tick():
    assert validate(crowd(13)) == []
    assert [d.code for d in validate(crowd(13), "1ms")] == [TOO_MANY_STARTS.id]
    assert validate(crowd(13), ms("500us")) == []
