"""Jobs with gaps on cores: when their pieces begin and end, the slots of the runtime, and places in scratchpads."""

from dataclasses import replace
from fractions import Fraction

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.core.durations import ZERO
from halpipe.exporters.common.codes import NEEDS_HOLD
from halpipe.exporters.riscv import bundle
from halpipe.exporters.riscv.codes import IMAGE_TOO_LARGE, PHASE_ORDER
from halpipe.exporters.riscv.cores import (
    Shape,
    Slots,
    channels_of,
    check_splits,
    cores_of,
    main_memory,
    places_of,
    shape_of,
    slots_of,
    slower,
    too_large,
)
from halpipe.exporters.riscv.images import Part as Linked
from halpipe.exporters.riscv.profile import Region, read_profile
from halpipe.exporters.riscv.toolchain import Elf, Segment, Symbol
from halpipe.models import AccessKind, Part, Split
from riscv_models import PHASES, deployed, single
from support import job, model, ms, schedule, task

VCU118 = read_profile("vcu118")
US = ms("0.001ms")
SHAPE = Shape(((US * 100, ZERO, US * 10), (US * 200, US * 10, US * 30)))


@pytest.mark.parametrize(("executed", "begins"), [(0, 100), (9, 109), (10, 200), (29, 219), (30, 220)])
def test_what_begins_where_a_part_ends_begins_with_the_next(executed, begins):
    assert SHAPE.begin(US * executed) == US * begins


@pytest.mark.parametrize(("executed", "ends"), [(0, 100), (1, 101), (10, 110), (11, 201), (30, 220)])
def test_what_ends_where_a_part_ends_ends_with_it(executed, ends):
    assert SHAPE.end(US * executed) == US * ends


def test_a_job_without_gaps_is_one_part_after_its_wait():
    system, _ = single()
    assert shape_of(job(system, "scale", 0, 3, "u1"), deployed(), US * 7).parts == ((US * 7, ZERO, ms(1)),)


POINTS = Split(points=(ms("0.3ms"), ms("0.6ms")), resume=US * 5)


def gapped(system, *starts, name="scale", index=0):
    """A job that executes its three pieces from these instants on."""
    edges = [ZERO, *POINTS.points, ms(1)]
    parts = tuple(
        Part(start=ms(s), end=ms(s) + b - a, executed_from=a, executed_to=b)
        for s, a, b in zip(starts, edges, edges[1:], strict=False)
    )
    return replace(job(system, name, index, starts[0], "u1"), parts=parts, end=parts[-1].end)


def test_after_a_gap_a_job_executes_when_it_has_resumed():
    system, _ = single(replace(deployed(), split=POINTS))
    found = shape_of(gapped(system, 2, 3, 5), system.tasks[0].versions[0], US * 7)
    starts = [US * 7, US * (1000 + 7 + 5), US * (3000 + 7 + 5)]
    assert [start for start, _, _ in found.parts] == starts
    assert [(low, high) for _, low, high in found.parts] == [
        (ZERO, ms("0.3ms")), (ms("0.3ms"), ms("0.6ms")), (ms("0.6ms"), ms(1)),
    ]  # fmt: skip


def test_jobs_with_gaps_and_with_copies_have_slots_of_their_own():
    split = task("split", 10, replace(deployed(units="u1 u2"), split=POINTS))
    held, plain = (task(name, 10, deployed(units="u1 u2")) for name in ("held", "plain"))
    system = model(split, held, plain, units="u1 u2", resources="memory")
    jobs = [gapped(system, 0, 1, 2, name="split"), job(system, "held", 0, 3, "u2"), job(system, "plain", 0, 4, "u1")]
    cores = cores_of(system, set(), VCU118, Findings())
    found = slots_of(schedule(system, 10, *jobs), cores, {"held"})
    assert found.kept == (("held", 1), ("held", 1), ("split", 0))
    assert found.count == 5
    places = [(name, unit) for name in ("split", "held", "plain") for unit in (0, 1)]
    assert [found.of(*place) for place in places] == [4, 1, 0, 2, 0, 1]
    assert [found.number(*place) for place in places] == [1, 1, 1, 2, 1, 1]


def test_the_runtime_looks_at_every_further_slot_before_an_operation():
    profile = replace(VCU118, management_cpi=Fraction(3, 2), clock=1_000_000, service=US)
    assert slower(profile, Slots(2)).service == US
    assert slower(profile, Slots(2, (("a", 0), ("b", 1)))).service == US * 16  # 15 cycles of the clock


def test_copies_have_a_channel_behind_those_of_the_resources():
    system, _ = single()
    findings = Findings()
    assert channels_of(system, [deployed()], VCU118, findings, copies=True) == {"memory": 0, "": 1}
    lone = replace(VCU118, dma=replace(VCU118.dma, channels=1))
    channels_of(system, [deployed()], lone, findings)
    assert findings.items == []
    channels_of(system, [deployed()], lone, findings, copies=True)
    assert [d.message for d in findings.items] == [
        "2 resources move data (memory, copies of LET), there are 1 DMA channels"
    ]


def test_main_memory_to_the_byte():
    """64 MiB from 0x80000000: faults and trace at the end, buffers before them, and images from 2 MiB on."""
    shadows = {("t", AccessKind.READ, "a"): 100, ("t", AccessKind.WRITE, "b"): 64}
    memory = main_memory(VCU118, {"a": 100, "b": 1}, Findings(), shadows)
    assert memory.faults == 0x84000000 - 256 * 64
    assert memory.trace == memory.faults - 65536 * 48
    assert memory.buffers_base == memory.trace - 4096
    assert (memory.base, memory.images, memory.control) == (0x80000000, 0x80200000, 0x801FF000)
    at = memory.buffers_base
    assert memory.buffers == {"a": Region(at, 100), "b": Region(at + 128, 1)}
    assert list(memory.shadows.values()) == [Region(at + 192, 100), Region(at + 320, 64)]
    assert memory.buffers_end == at + 384
    assert memory.place("t", AccessKind.READ, "a").base == at + 192
    assert memory.place("t", AccessKind.WRITE, "a") == memory.place("u", AccessKind.READ, "a") == Region(at, 100)


def linked(name, code, data, split=False):
    """A part for two cores, and its image of so many bytes."""
    system, _ = single(units="u1 u2")
    cores = tuple(cores_of(system, set(), VCU118, Findings()).values())
    ends = {"hp_code_end": cores[0].ispm.base + 4096 + code, "hp_data_end": cores[0].dspm.base + VCU118.stack + data}
    version = replace(deployed(units="u1 u2"), split=POINTS if split else Split())
    return Linked(name, version, cores, ()), Elf((), {name: Symbol(at, 0) for name, at in ends.items()})


def test_images_of_jobs_with_gaps_lie_behind_each_other_and_all_others_at_one_place_after_them():
    made = dict(linked(*row) for row in (("x", 10, 20), ("a", 100, 200, True), ("y", 30, 40), ("b", 64, 65, True)))
    found, told = places_of(made, {("a", "v"), ("b", "v")}, VCU118)
    first = {part.task: place for (part, core), place in found.items() if core.unit == "u1"}
    assert first == {"a": (0, 0), "b": (128, 256), "x": (192, 384), "y": (192, 384)}
    assert first == {part.task: place for (part, core), place in found.items() if core.unit == "u2"}
    assert told == []


CODE, DATA = 116 * 1024, 244 * 1024
"""Bytes of the scratchpads beside monitor, stack and mailbox."""

OPEN, ROOM = "beside the jobs with gaps that are open on u1", f"there is room for {CODE}"


@pytest.mark.parametrize(
    ("sizes", "place", "said"),
    [
        ((CODE, DATA), (0, 0), []),
        ((CODE + 1, 1), (0, 0), [(f"code has {CODE + 1} bytes; there is room for {CODE}", 1)]),
        ((1, DATA + 9), (0, 0), [(f"data has {DATA + 9} bytes; there is room for {DATA}", 9)]),
        ((CODE - 64, DATA - 128), (64, 128), []),
        (
            (CODE - 60, 8),
            (64, 128),
            [(f"code has {CODE - 60} bytes {OPEN}, which have 64; {ROOM}", 4)],
        ),
    ],
)
def test_images_that_are_too_large_say_by_how_much(sizes, place, said):
    part, _ = linked("x", 0, 0)
    found = list(too_large(part, part.cores[0], sizes, VCU118, place))
    assert [(d.code, d.message) for d in found] == [
        (IMAGE_TOO_LARGE.id, f"{text} beside monitor, stack and mailbox") for text, _ in said
    ]
    for diagnostic, (_, excess) in zip(found, said, strict=True):
        assert diagnostic.help.startswith(f"make it {excess} bytes smaller, ")


def splits(split, entry, *, with_gaps=True):
    system, tables = single(replace(deployed(phases=PHASES, entry=entry), split=split))
    findings = Findings()
    chosen = schedule(system, 5, gapped(system, 0, 1, 2)) if with_gaps else tables
    check_splits(system, chosen, findings)
    return [d.code for d in findings.items]


def test_jobs_with_gaps_are_held_where_functions_return():
    assert splits(POINTS, "a b c") == []
    assert splits(POINTS, "a b") == splits(POINTS, "a b c d") == [PHASE_ORDER.id]
    assert splits(POINTS, "a", with_gaps=False) == []
    assert splits(Split(anywhere=True, max_gaps=2), "a b c") == [NEEDS_HOLD.id]


def test_addresses_are_of_the_scratchpad_that_holds_them():
    system, _ = single()
    [core] = cores_of(system, set(), VCU118, Findings()).values()
    inside, outside = (core.ispm.base, core.ispm.end - 1), (core.ispm.base - 1, core.ispm.end, core.dspm.base)
    assert [core.memory_at(at) for at in inside] == ["ispm"] * 2
    assert [core.memory_at(at) for at in outside] == ["dspm"] * 3
    assert core.job_end == core.dspm.end - 4096


def test_units_have_their_cores_even_where_they_are_idle_if_there_are_enough():
    system, _ = single(units="a b c d")
    assert list(cores_of(system, {"d"}, VCU118, Findings())) == ["a", "b", "c", "d"]


def test_the_flat_program_has_zeros_where_no_segment_lies(monkeypatch):
    segments = (Segment(4, 0x1000, 0, 2), Segment(6, 0x1004, 0, 3))
    monkeypatch.setattr(bundle, "read_elf", lambda _: Elf(segments, {}))
    assert bundle._flat(b"....abcde", 0x0FFF) == b"\0ab\0\0cde"
