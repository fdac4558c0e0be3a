"""Systems in the manner of those that are published: what they are made of, and that they can be scheduled."""

from fractions import Fraction

import pytest

from halpipe.core.durations import milliseconds
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.validate import validate
from search_benchmark.real import RATES, Engine, EngineControl, Waters2019


def load(model, unit):
    """The share of a unit that tasks and interrupts need, without what gaps cost."""
    work = sum(v.wcet / t.period for t in model.tasks for v in t.versions if v.units == (unit.name,))
    return work + sum(i.wcet / i.distance for i in unit.interrupts)


def test_the_shares_of_the_periods_are_those_published():
    """The rest of the hundred percent follows the crankshaft."""
    assert sum(rate.share for rate in RATES.values()) == 85


@pytest.mark.parametrize("cell", [EngineControl(cores=2, load=Fraction(7, 10)), Engine(load=Fraction(4, 5))])
def test_every_core_is_loaded_as_stated(cell):
    model = cell.draw(3)
    for unit in model.units:
        assert cell.load - Fraction(1, 50) < load(model, unit) <= cell.load + Fraction(1, 50)


@pytest.mark.parametrize(
    "cell", [EngineControl(cores=1, load=Fraction(1, 2)), Engine(load=Fraction(4, 5)), Waters2019()]
)
def test_models_are_sound(cell):
    model = cell.draw(1)
    assert not [d for d in validate(model) if d.is_error]
    assert all(piece <= milliseconds(120) for t in model.tasks for v in t.versions for piece in v.split.points[:1])


def test_a_seed_is_a_system():
    cell = Engine(load=Fraction(4, 5))
    assert cell.draw(1) == cell.draw(1) != cell.draw(2)


@pytest.mark.slow  # test_edf.py has small systems of this kind
@pytest.mark.parametrize(
    "cell", [EngineControl(cores=1, load=Fraction(95, 100)), Engine(load=Fraction(4, 5)), Waters2019()]
)
def test_they_have_schedules(cell):
    assert schedule_model(cell.draw(5), SearchOptions(), lambda *_: True).is_complete
