"""Valid models that verbs once answered with an internal error: each gets an answer."""

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.durations import Duration
from halpipe.core.quantities import is_writable
from halpipe.exporters.native import format_model, format_schedule
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.models import Binding, Interrupt, Split, Unit, Version
from halpipe.pipeline.checked import schedule_model, verify_schedule
from halpipe.pipeline.explain.explanation import explain
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate
from support import access, after, mode, model, task, version


def thirds(number):
    """Return so many thirds of a microsecond."""
    return Duration.parse(f"{number}/3us")


def read(system):
    """Return a model as its file is read."""
    return parse_model(format_model(system), "model.xml")


def scheduled(system, budget=2000):
    return schedule_model(read(system), SearchOptions(budget=budget), lambda *_: True).schedule


def test_a_bound_task_has_versions_of_several_gang_sizes_in_a_table():
    """Of these, only one fits the units that the new mode has chosen; the other one was placed nevertheless."""
    gang = Version(
        name="both", wcet=thirds(5), units=("u0", "u1", "u2"), gang=3, split=Split(anywhere=True, max_gaps=3)
    )
    bound = replace(task("b", None, version("alone", thirds(6), "u0 u1"), gang), binding=Binding.MODE)
    window = after("b", thirds(1), thirds(15))
    pace = task("p", thirds(20), version("v", thirds(4), "u0 u1", window), slack=Fraction(1, 2), offset=thirds(59))
    old = task("o", thirds(40), version("v", thirds(12), "u0 u1 u2", gang=3))
    system = model(pace, old, bound, modes=[mode("m", (old,)), mode("n", (pace, bound))])
    noisy = Unit(name="u2", interrupts=(Interrupt(name="i", wcet=thirds(2), distance=thirds(22)),))
    system = replace(system, units=(Unit(name="u0"), Unit(name="u1"), noisy))
    found = scheduled(system)
    assert [d for d in verify_schedule(read(system), found) if d.is_error] == []


@pytest.mark.slow
def test_hundreds_of_tasks_demand_each_other_in_a_row():
    row = [task("t0", 100, version("v", "1us", "u1", after("t1", 0, 100)))]
    row += [task(f"t{n}", None, version("v", "1us", "u1", after(f"t{n + 1}", 0, 100))) for n in range(1, 1100)]
    system = model(*row, task("t1100", None, version("v", "1us", "u1")))
    assert len(scheduled(system).modes[0].jobs) == 1101
    assert explain(read(system)).diagnostics


def test_demands_that_multiply_are_refused_by_their_limit():
    def doubling(tasks):
        twice = [(after(f"t{n + 1}", 0, 100), after(f"t{n + 1}", 0, 99)) for n in range(tasks)]
        row = [task(f"t{n}", None if n else 100, version("v", "1us", "u1", *twice[n])) for n in range(tasks)]
        return model(*row, task(f"t{tasks}", None, version("v", "1us", "u1")))

    assert [d for d in validate(doubling(13)) if d.is_error] == []
    (refused,) = [d for d in validate(doubling(14)) if d.is_error]
    assert "16384 jobs" in refused.message


def unlike(tasks):
    """Return a system in which every task takes another share of one resource, with twelve digits each."""
    shares = [Fraction(1, 10**12 + 39 + 2 * n) for n in range(tasks)]
    rows = [task(f"t{n}", 100, version("v", "1ms", f"u{n % 4}", access("r", 0, 1, b))) for n, b in enumerate(shares)]
    return model(*rows, units="u0 u1 u2 u3", resources="r")


def test_figures_that_decide_nothing_stop_no_output():
    """The mean load of a hundred unlike bounds has a denominator of more than a thousand digits."""
    system = unlike(100)
    content = format_schedule(scheduled(system))
    (load,) = parse_schedule(content, "schedule.xml").modes[0].resource_loads
    assert load.mean is None
    assert [d for d in verify_schedule(read(system), parse_schedule(content, "schedule.xml")) if d.is_error] == []


def test_bounds_that_cannot_be_added_up_are_refused_before_the_search():
    assert [d for d in validate(unlike(100)) if d.is_error] == []
    assert [d.code for d in validate(unlike(120)) if d.is_error] == ["HAL0284"]


@pytest.mark.parametrize(
    ("value", "is_short"),
    [
        (Fraction(1, 3), True),
        (Fraction(10**998), True),
        (Fraction(10**999), False),
        (Fraction(1, 2**900), True),
        (Fraction(1, 2**1000), True),
        (Fraction(1, 2**3400), False),
        (Fraction(1, 3**100_000), False),
    ],
)
def test_numbers_are_writable_up_to_the_length_that_is_read(value, is_short):
    assert is_writable(value) is is_short


@pytest.mark.slow
def test_demanders_may_be_phased_further_apart_than_a_hyperperiod():
    """Jobs on demand were released out of order then, and one started before it was released."""

    def part(text):
        return Duration.parse(f"{text}us")

    fine = version("v0", part("603/175"), "u0 u1 u2 u3", after("t", 0, part("102/7")))
    coarse = version("v1", part("402/35"), "u0 u1 u2", after("t", 0, part("71/7")))
    system = model(
        task("a", part("120/7"), fine, coarse, slack=Fraction(1, 10)),
        task("t", None, version("v", part("603/70"), "u0 u2")),
        task("b", part("120/7"), version("v", part("3417/350"), "u3", after("t", 0, part("170/7")))),
        task("never", None, replace(version("v", part(9), "u0 u1 u3", gang=2), split=Split(points=(part(1), part(2))))),
        units="u0 u1 u2 u3",
    )
    scheduled(system, budget=None)  # it raises where verify disagrees
