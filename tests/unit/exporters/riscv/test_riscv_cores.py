"""Units become cores, resources become channels, and buffers find their place in main memory."""

from dataclasses import replace

import pytest

from halpipe.core.diagnostics import Findings
from halpipe.exporters.riscv.codes import MAIN_MEMORY_FULL, OUTSIDE_BUFFER, TOO_MANY_RESOURCES, TOO_MANY_UNITS
from halpipe.exporters.riscv.cores import buffer_sizes, channels_of, cores_of, main_memory
from halpipe.exporters.riscv.profile import Region, read_profile
from riscv_models import PHASES, deployed, moving, single

VCU118 = read_profile("vcu118")


@pytest.fixture
def findings():
    return Findings()


def test_units_are_cores_in_the_models_order(findings):
    system, _ = single(units="b a")
    found = cores_of(system, {"a"}, VCU118, findings)
    assert [(core.unit, core.hart) for core in found.values()] == [("b", 1), ("a", 2)]
    assert found["a"].dspm == Region(0x01080000, 256 * 1024)
    assert found["b"].mailbox == 0x01080000 - 256


def test_where_cores_are_short_only_the_units_in_use_have_one(findings):
    system, _ = single(units="a b c d e f")
    assert list(cores_of(system, {"f", "b"}, VCU118, findings)) == ["b", "f"]
    assert findings.items == []


def test_more_units_than_cores(findings):
    system, _ = single(units="a b c d e")
    cores_of(system, set("abcde"), VCU118, findings)
    [found] = findings.items
    assert found.code == TOO_MANY_UNITS.id
    assert "5 units" in found.message
    assert "4 cores" in found.message


def test_resources_that_move_data_have_channels(findings):
    used = deployed(phases=(*PHASES, moving("other", "0.3ms", "0.4ms", None)))
    system, _ = single(used, resources="idle other memory")
    assert channels_of(system, [used], VCU118, findings) == {"memory": 0}


def test_more_resources_than_channels(findings):
    names = [f"r{i}" for i in range(5)]
    phases = [moving(r, f"{i}us", f"{i + 1}us", "read", ("b", "numbers", 4)) for i, r in enumerate(names)]
    system, _ = single(resources=" ".join(names))
    channels_of(system, [deployed(phases=phases)], VCU118, findings)
    assert [found.code for found in findings.items] == [TOO_MANY_RESOURCES.id]


def test_a_buffer_has_what_is_written_into_it(findings):
    writer = deployed(phases=[moving("memory", "0ms", "1ms", "write", ("shared", "scaled", 32))])
    reader = deployed(
        phases=[moving("memory", "0ms", "1ms", "read", ("shared", "numbers", 32), ("input", "numbers", 8))]
    )
    assert buffer_sizes([("w", writer), ("r", reader)], findings) == {"input": 8, "shared": 32}
    assert findings.items == []


def test_reading_more_than_is_written(findings):
    writer = deployed(phases=[moving("memory", "0ms", "1ms", "write", ("shared", "scaled", 32))])
    reader = deployed(phases=[moving("memory", "0ms", "1ms", "read", ("shared", "numbers", 33))])
    buffer_sizes([("w", writer), ("r", reader)], findings)
    [found] = findings.items
    assert (found.code, found.path) == (OUTSIDE_BUFFER.id, "r")
    assert "33B" in found.message
    assert "32B" in found.message


def test_main_memory_is_shared_out_without_overlap(findings):
    memory = main_memory(VCU118, {"a": 1, "b": 64, "c": 65}, findings)
    a, b, c = memory.buffers.values()
    assert [region.size for region in (a, b, c)] == [1, 64, 65]
    assert not a.meets(b)
    assert not b.meets(c)
    assert all(region.base % 64 == 0 for region in (a, b, c))
    assert memory.images < memory.buffers_base <= a.base
    assert c.end <= memory.buffers_end <= memory.trace < memory.faults < VCU118.main.end


def test_buffers_that_do_not_fit(findings):
    main_memory(VCU118, {"huge": VCU118.main.size}, findings)
    assert [found.code for found in findings.items] == [MAIN_MEMORY_FULL.id]


def test_the_limit_itself_fits(findings):
    small = replace(VCU118, main=Region(0x80000000, 8 * 2**20))
    free = main_memory(small, {}, findings).buffers_base - main_memory(small, {}, findings).images
    main_memory(small, {"all": free}, findings)
    assert findings.items == []
    main_memory(small, {"all": free + 1}, findings)
    assert [found.code for found in findings.items] == [MAIN_MEMORY_FULL.id]


@pytest.mark.parametrize("sizes", [(32, 64), (64, 32)])
@pytest.mark.parametrize("kind", ["read", "write"])
def test_a_buffer_holds_the_largest_of_its_transfers(findings, sizes, kind):
    users = [deployed(phases=[moving("memory", "0ms", "1ms", kind, ("shared", "numbers", size))]) for size in sizes]
    assert buffer_sizes([("a", users[0]), ("b", users[1])], findings) == {"shared": 64}
    assert findings.items == []
