"""How long the management core takes for an operation: measured, and held against what the profile reserves."""

from fractions import Fraction

import pytest

from halpipe.core.durations import Duration
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.judge import check, figures
from halpipe.deploy.riscv.run.cosimulation import load_program
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.deploy.riscv.target import read_site
from halpipe.exporters.riscv.codes import LINK_FAILED
from halpipe.exporters.riscv.profile import FOLDER

MULTIPLYING = """#include <stdint.h>
uint64_t smooth[8], command;
void act(void) {
    uint64_t value = smooth[0] | 1u;
    for (int i = 0; i < 100; i++) __asm__ volatile("mul %0, %0, %0\\n divu %0, %0, %0" : "+r"(value));
    command = value;
}
"""


def with_profile(export, tmp_path_factory, *changes, **options):
    text = FOLDER.joinpath("vcu118.yaml").read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = tmp_path_factory.mktemp("profile") / "own.yaml"
    path.write_text(text)
    return export(profile=str(path), **options)


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


@pytest.mark.slow
def test_a_profile_that_reserves_too_little_is_told(export, tmp_path_factory):
    target = with_profile(export, tmp_path_factory, ("service: 6500ns", "service: 400ns"))
    checked = check.check_by_simulation(target, CheckOptions(inject="none"))
    found = [d for d in checked.diagnostics if d.code == codes.SLOW_DISPATCH.id]
    assert "400ns are reserved" in found[0].message
    assert any("enough up to 0." in line for line in checked.lines)


@pytest.mark.slow
def test_cycles_of_an_instruction_are_the_profiles(export, tmp_path_factory, worst):
    target = with_profile(export, tmp_path_factory, ("service:", "cpi: 1.5\nservice:"))
    found = check.simulate(target, tours(target.schedule, 2)[0])
    assert found.run.site.cpi == Fraction(3, 2)
    assert worst.worst * Fraction(7, 5) < found.dispatch.worst < worst.worst * Fraction(8, 5)
    assert [d for d in found.findings if d.is_error] == []


def cycles_of(run, execution):
    return Fraction((execution.left - execution.entered) * run.site.clock, run.rate)


EACH = "bandwidth: {ispm: 100MB/s, dspm: 200MB/s, main: 50MB/s}, bus: 400MB/s"


@pytest.mark.slow
def test_each_direction_has_its_bandwidth(export, tmp_path_factory):
    target = with_profile(export, tmp_path_factory, ("bandwidth: 400MB/s, bus: 800MB/s", EACH))
    found = check.simulate(target, tours(target.schedule, 2)[0])
    assert [d for d in found.findings if d.is_error] == []
    run = found.run
    memories = {
        "ispm": [u.ispm for u in run.site.units],
        "dspm": [u.dspm for u in run.site.units],
        "main": [run.site.main],
    }
    lasted = {
        (memory, transfer.size, run.length(transfer.end - transfer.begin) - run.site.dma.latency)
        for transfer in run.recorder.transfers
        for memory, areas in memories.items()
        if any(area.base <= transfer.target < area.end for area in areas)
    }
    nanoseconds = {"ispm": 10, "dspm": 5, "main": 20}  # a byte
    assert {memory for memory, _, _ in lasted} == set(nanoseconds)
    assert all(time.fraction == nanoseconds[memory] * size for memory, size, time in lasted)


@pytest.mark.slow
def test_roles_have_their_own_cycles(export, tmp_path_factory, worst):
    change = ("service: 6500ns", "cpi: {jobs: 1, management: 2, multiply: 11}\nservice: 13us")
    sources = {"act.c": MULTIPLYING}
    target = with_profile(export, tmp_path_factory, change, sources=sources)
    plain = with_profile(export, tmp_path_factory, sources=sources)
    tour = tours(target.schedule, 2)[0]
    outcomes = check.simulate(target, tour), check.simulate(plain, tour)
    assert [d for d in outcomes[0].findings if d.is_error] == []
    assert worst.worst * Fraction(9, 5) < outcomes[0].dispatch.worst < worst.worst * Fraction(11, 5)
    for task, more in {
        "act": 2 * 100 * 10 - 100,
        "filter": 0,
        "sense": 0,
    }.items():  # ten each; the last with the loop's addition
        cycles = [{cycles_of(o.run, e) for e in o.run.executions if e.image.site.task == task} for o in outcomes]
        assert {one - more for one in cycles[0]} == cycles[1]


@pytest.mark.slow
def test_a_slow_memory_makes_the_management_core_slower_alone(export, tmp_path_factory, worst):
    """About a third of its instructions load or store; cores that execute from their scratchpads wait for nothing."""
    target = with_profile(export, tmp_path_factory, ("service:", "latency: 20ns\nservice:"))
    found = check.simulate(target, tours(target.schedule, 2)[0])
    assert worst.worst * Fraction(7, 5) < found.dispatch.worst < worst.worst * Fraction(12, 5)
    sound = check.simulate(with_profile(export, tmp_path_factory), tours(target.schedule, 2)[0])
    lasted = [[e.left - e.entered for e in outcome.run.executions] for outcome in (found, sound)]
    assert lasted[0] == lasted[1]


SCRATCHPAD = ("ispm:", "scratchpad: {base: 0x01000000, size: 32KiB}\nispm:")


@pytest.mark.slow
def test_a_scratchpad_of_hart_0_has_the_runtime_and_its_tables(export, tmp_path_factory, worst):
    slow = ("service:", "latency: 200ns\nservice:")
    target = with_profile(export, tmp_path_factory, slow, SCRATCHPAD)
    program = load_program(target.bundle, read_site(target.bundle))
    for name in ("runtime", "hp_tables", "hp_programs", "hp_rules", "__stack_top"):
        assert 0x01000000 <= program.symbols[name][0] <= 0x01008000
    assert program.symbols["hp_monitors"][0] > 0x80000000  # the other harts read it
    tour = tours(target.schedule, 2)[0]
    near, far = (check.simulate(t, tour) for t in (target, with_profile(export, tmp_path_factory, slow)))
    assert [d for d in near.findings if d.is_error] == []
    assert worst.worst < near.dispatch.worst < far.dispatch.worst * Fraction(3, 4)


def test_a_scratchpad_that_is_too_small_is_refused(export, tmp_path_factory, refused):
    small = ("ispm:", "scratchpad: {base: 0x01000000, size: 8KiB}\nispm:")
    (found,) = refused(with_profile, export, tmp_path_factory, small)
    assert found.code == LINK_FAILED.id
    assert "too large for the scratchpad of hart 0" in found.message


@pytest.mark.slow
def test_a_bundle_with_a_scratchpad_of_hart_0_is_sound(export, tmp_path_factory):
    checked = DEPLOYMENT.check(with_profile(export, tmp_path_factory, SCRATCHPAD), CheckOptions())
    assert [d for d in checked.diagnostics if d.is_error] == []
