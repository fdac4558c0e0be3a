"""How long the management core takes for an operation: measured, and held against what the profile reserves."""

from fractions import Fraction

import pytest

from halpipe.core.durations import Duration
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge import check, figures
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.exporters.riscv.profile import FOLDER


def with_profile(export, tmp_path_factory, *changes):
    text = FOLDER.joinpath("vcu118.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("profile") / "own.yaml"
    path.write_text(text)
    return export(profile=str(path))


@pytest.fixture(scope="module")
def worst(sound):
    """The worst operation of a run in which nothing fails, at one cycle an instruction."""
    return check.simulate(sound, tours(sound.schedule, 2)[0]).dispatch


def test_an_operation_takes_some_time_and_less_than_is_reserved(worst):
    assert Duration.parse("500ns") < worst.worst < worst.reserved == Duration.parse("6500ns")
    assert list(figures.slow_dispatch([worst])) == []


def test_it_takes_as_much_longer_as_an_instruction_does(sound, worst):
    slow = check.simulate(sound, tours(sound.schedule, 2)[0], cpi=2).dispatch
    assert worst.worst * Fraction(9, 5) < slow.worst < worst.worst * Fraction(11, 5)


def test_a_profile_that_reserves_too_little_is_told(export, tmp_path_factory):
    target = with_profile(export, tmp_path_factory, ("service: 6500ns", "service: 400ns"))
    checked = check.check_by_simulation(target, CheckOptions(inject="none"))
    found = [d for d in checked.diagnostics if d.code == codes.SLOW_DISPATCH.id]
    assert "400ns are reserved" in found[0].message
    assert any("enough up to 0." in line for line in checked.lines)


def test_cycles_of_an_instruction_are_the_profiles(export, tmp_path_factory, worst):
    target = with_profile(export, tmp_path_factory, ("service:", "cpi: 1.5\nservice:"))
    found = check.simulate(target, tours(target.schedule, 2)[0])
    assert found.run.site.cpi == Fraction(3, 2)
    assert worst.worst * Fraction(7, 5) < found.dispatch.worst < worst.worst * Fraction(8, 5)
    assert [d for d in found.findings if d.is_error] == []


def test_a_slow_memory_makes_the_management_core_slower_alone(export, tmp_path_factory, worst):
    """About a third of its instructions load or store; cores that execute from their scratchpads wait for nothing."""
    target = with_profile(export, tmp_path_factory, ("service:", "latency: 20ns\nservice:"))
    found = check.simulate(target, tours(target.schedule, 2)[0])
    assert worst.worst * Fraction(7, 5) < found.dispatch.worst < worst.worst * Fraction(12, 5)
    sound = check.simulate(with_profile(export, tmp_path_factory), tours(target.schedule, 2)[0])
    lasted = [[e.left - e.entered for e in outcome.run.executions] for outcome in (found, sound)]
    assert lasted[0] == lasted[1]
