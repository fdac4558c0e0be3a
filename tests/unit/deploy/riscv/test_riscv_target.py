"""The description of a target: read exactly, and refused wherever it cannot be meant."""

import json
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st
from riscv_target import TARGET, bundle, target

from halpipe.core.bundles import Bundle
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.riscv.codes import BROKEN_TARGET
from halpipe.deploy.riscv.target import Area, read_site
from support import ms


def refused(value):
    with pytest.raises(HalpipeError) as failure:
        read_site(bundle(value))
    assert {d.code for d in failure.value.diagnostics} == {BROKEN_TARGET.id}
    assert all(d.at.file == "bundle/target.json" and d.help for d in failure.value.diagnostics)
    return failure.value.diagnostics


def test_everything_is_read():
    site = read_site(bundle(target()))
    assert (site.clock, site.timebase, site.tick) == (100_000_000, 1_000_000, ms("1us"))
    assert site.unit("core2").dspm == Area(0x01080000, 0x40000)
    assert site.unit_of(1).name == "core1"
    assert site.channels == {"memory": 0}
    assert site.buffers == {"scan": Area(0x80040000, 64)}
    assert site.dma.latency == ms("2us")
    assert site.tables[0].lateness == ms("3us")
    (image,) = site.images
    assert image.entries == (0x1821000,)
    assert image.load == ((0x80050000, 0x1821000, 64),)
    with pytest.raises(KeyError):
        site.unit("core3")
    with pytest.raises(KeyError):
        site.unit_of(3)


def test_the_latency_of_the_hardware_rules_where_it_is_stated():
    spoilt = target()
    spoilt["dma"]["latency"] = "500ns"
    assert read_site(bundle(spoilt)).dma.latency == ms("0.5us")


def test_a_bundle_without_the_description():
    with pytest.raises(HalpipeError) as failure:
        read_site(Bundle("bundle", "riscv", {}, {}))
    assert failure.value.diagnostics[0].code == BROKEN_TARGET.id


@pytest.mark.parametrize("data", [b"", b"{", b"[]", b"\xff", b"[" * 100_000])
def test_what_is_no_json_object(data):
    refused(data)


def change(path, value):
    spoilt = target()
    place = spoilt
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return spoilt


@pytest.mark.parametrize(
    ("path", "value", "said"),
    [
        (("clock",), 0, "write a number from 1 to"),
        (("clock",), "fast", "must be a whole number"),
        (("timebase",), True, "must be a whole number"),
        (("control",), "0xzz", "no address"),
        (("control",), "0x90000000", "not in main memory"),
        (("control",), 7, "no address"),
        (("units", 0, "mailbox"), "0x0", "not in what its dspm reserves"),
        (("units", 0, "mailbox"), "0x107fff8", "not in what its dspm reserves"),
        (("units", 0, "mailbox"), "0xffffffffffff", "not in what its dspm reserves"),
        (("units", 0, "reserved"), "0x2", "not in what its dspm reserves"),
        (("dma", "kind"), "magic", "neither pdma nor copy"),
        (("dma", "setup"), "soon", "is not a duration"),
        (("dma", "bandwidth"), 0, "write a number from 1 to"),
        (("dma", "bandwidth"), {"ispm": 1, "dspm": 1}, 'lacks the key "main"'),
        (("dma", "bandwidth"), {"ispm": 1, "dspm": 1, "main": 0}, "write a number from 1 to"),
        (("cpi",), {"jobs": "2", "management": "3"}, 'lacks the key "load-byte"'),
        (("units",), [], "there is none"),
        (("units",), {}, "must be a list"),
        (("units", 0, "hart"), 2, "their harts are"),
        (("units", 1, "name"), "core1", "two have one name"),
        (("units", 1, "dspm", "base"), "0x1840000", "overlaps"),
        (("units", 1, "dspm", "base"), "0x1080008", "do not begin at a page"),
        (("uart", "base"), "0x80001000", "overlaps uart"),
        (("clint", "base"), "0x2000004", "do not begin at a page"),
        (("dma", "base"), "0x1040000", "overlaps"),
        (("finisher",), "0x2000000", "overlaps"),
        (("main", "size"), 1 << 40, "to 2147483648"),
        (("trace", "record"), 40, "from 48 to 48"),
        (("trace", "capacity"), 1 << 20, "not in main memory"),
        (("faults", "record"), 40, "from 64 to 64"),
        (("buffers", 0, "size"), 1 << 21, "not in main memory"),
        (("images", 0, "unit"), "core9", 'no unit "core9"'),
        (("images", 0, "symbols"), {"scan": 3}, "must be a mapping"),
        (("halpipe-target",), 1, "from 2 to 2"),
        (("cpi",), "0.5", "no number from 1 to 1000"),
        (("tables", 0, "mode"), 1, "from 0 to 0"),
        (("units", 0, "monitor"), "0x1821000", "is not 0x1820000, the begin of its ispm"),
        (("decision",), 3, "from 2 to 2"),
        (("margin",), 3, "from 2 to 2"),
    ],
)
def test_what_cannot_be_meant_is_refused(path, value, said):
    assert any(said in d.message for d in refused(change(path, value)))


def test_the_ends_of_a_transition_are_those_of_its_name():
    spoilt = target()
    spoilt["tables"].append({"name": "all->all", "from": 0, "to": 0, "length": 0, "lateness": "3us"})
    assert [table.name for table in read_site(bundle(spoilt)).tables] == ["all", "all->all"]
    spoilt["tables"][1]["to"] = 1
    assert [d.message for d in refused(spoilt)] == ['"from" and "to" are those of all->all->all']


def test_one_figure_is_for_all_memories_and_instructions():
    site = read_site(bundle(target()))
    assert site.dma.bandwidth == dict.fromkeys(("ispm", "dspm", "main"), 400_000_000)
    assert (site.cpi, site.management_cpi, {*site.classes.values()}) == (1, 1, {1})


@pytest.mark.parametrize("key", list(TARGET))
def test_what_is_missing_is_named(key):
    spoilt = target()
    del spoilt[key]
    assert any(f'"{key}"' in d.message or d.path == key for d in refused(spoilt))


def test_all_is_reported_at_once():
    spoilt = target()
    spoilt["clock"] = spoilt["timebase"] = "x"
    assert len(refused(spoilt)) == 2


values = st.one_of(st.none(), st.booleans(), st.integers(), st.text(max_size=5), st.lists(st.integers(), max_size=2))


def places(value, path=()):
    if isinstance(value, dict):
        for key in value:
            yield (*path, key)
            yield from places(value[key], (*path, key))
    elif isinstance(value, list):
        for i, item in enumerate(value):
            yield (*path, i)
            yield from places(item, (*path, i))


@given(st.sampled_from(sorted(places(TARGET), key=str)), values)
def test_whatever_stands_anywhere_is_read_or_refused(path, value):
    with suppress(HalpipeError):
        read_site(bundle(json.dumps(change(path, value)).encode()))
