"""tables.json is input: whatever is in it, the answer is tables or a diagnostic that says where."""

import json

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.regulator import reading
from halpipe.deploy.regulator.codes import UNUSABLE_TABLES


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system())


def refusal(content):
    target = {"tables.json": content} if content is not None else {}
    target["platform.yaml"] = bundles.PLATFORM.format(window="64", units="  {}", clock="1Hz", capacity="1MB/s").encode()
    with pytest.raises(HalpipeError) as refused:
        reading.read_tables(reading_bundle(target))
    found = refused.value.diagnostics
    assert {(diagnostic.code, diagnostic.at.file) for diagnostic in found} == {(UNUSABLE_TABLES.id, "cfg/tables.json")}
    return "\n".join(diagnostic.message for diagnostic in found)


def reading_bundle(files):
    from halpipe.core.bundles import Bundle

    return Bundle("cfg", "regulator", {}, files)


def test_what_was_written_is_read(files):
    tables = reading.read_tables(reading_bundle(files))
    assert [table.name for table in tables.tables] == ["full", "lean", "full->lean"]
    assert [unit.manager for unit in tables.units] == [2, 0, 1]
    assert tables.platform.promise_bytes == 512
    assert sum(tables.tables[0].budgets("u1", "read")) == (6 * 4 + 3 * 2) * 64
    assert len(tables.tables[2].budgets("u3", "write")) == 20


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (None, "not in the bundle"),
        (b"", "Expecting value"),
        (b"[" * 100_000, ""),
        (b"{}", 'lacks the key "halpipe-regulator"'),
        (b'{"halpipe-regulator": 2}', "from 1 to 1"),
        (b"[]", "is no mapping"),
        (b"\xff\xfe\x00", ""),
        (b'{"halpipe-regulator": ' + b"9" * 5000 + b"}", ""),
    ],
)
def test_what_is_no_table_object(content, part):
    assert part in refusal(content)


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        (("platform",), [], "must be a mapping"),
        (("platform", "clock_hz"), [], "must be a text"),
        (("units",), [], "units must be there"),
        (("units", 0, "index"), 1, "in the order of their index"),
        (("units", 0, "default", "read"), -1, "'-1' is too small; write a number from 0"),
        (("tables",), [], "tables must be there"),
        (("tables", 0, "kind"), "other", "'other' is not known"),
        (("tables", 0, "rounding"), "nearest", "'nearest' is not known"),
        (("tables", 0, "windows"), 2**23, "from 1 to 4194304"),
        (("tables", 0, "entries"), {}, "entries for every unit"),
        (("tables", 0, "entries", "u1"), [], "must begin with window 0"),
        (("tables", 0, "entries", "u1", 0, "window"), 1, "must begin with window 0"),
        (("tables", 0, "entries", "u1", 1, "window"), 40, "stay below 40"),
        (("tables", 0, "entries", "u1", 1, "read_bytes"), 63, "are not its bytes"),
        (("tables", 0, "entries", "u1", 1, "write_bytes"), True, '"write_bytes" is true or false'),
        (("switches", 0), "full", "must be a mapping"),
        (("backend",), 7, "'7' is not known"),
    ],
)
def test_each_part_that_is_not_in_form_is_named(files, path, value, part):
    data = json.loads(files["tables.json"])
    place = data
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    assert part in refusal(json.dumps(data).encode())


def test_all_is_reported_at_once(files):
    data = json.loads(files["tables.json"])
    data["platform"]["clock_hz"] = []
    data["units"][0]["manager"] = "x"
    del data["tables"][0]["entries"]["u1"][0]["window"]
    assert len(refusal(json.dumps(data).encode()).splitlines()) == 3


def test_a_member_that_is_stated_twice_is_refused(files):
    content = files["tables.json"].replace(b'"window_cycles"', b'"window_cycles": 1, "window_cycles"', 1)
    assert 'the key "window_cycles" is repeated' in refusal(content)


@pytest.mark.parametrize(
    ("before", "after", "part"),
    [
        ("clock: ", "clocks: ", 'lacks the key "clock"'),
        ("clock: ", "clock: 0MHz # ", "'0MHz' is not a whole number of Hz above zero"),
        ("units:", "units: []\nothers:", "must be a mapping"),
        ("burst: 64B", "burst: [64B]", "must be a text"),
    ],
)
def test_a_platform_that_cannot_be_used_is_refused(files, before, after, part):
    text = files["platform.yaml"].decode()
    assert before in text
    with pytest.raises(HalpipeError) as refused:
        reading.read_platform(reading_bundle({"platform.yaml": text.replace(before, after, 1).encode()}))
    assert all(found.code == UNUSABLE_TABLES.id for found in refused.value.diagnostics)
    assert part in "\n".join(found.message for found in refused.value.diagnostics)
