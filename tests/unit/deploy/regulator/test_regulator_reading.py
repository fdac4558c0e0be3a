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
    with pytest.raises(HalpipeError) as refused:
        reading.read_tables(reading_bundle(target))
    (diagnostic,) = refused.value.diagnostics
    assert diagnostic.code == UNUSABLE_TABLES.id
    assert diagnostic.at.file == "cfg/tables.json"
    return diagnostic.message


def reading_bundle(files):
    from halpipe.core.bundles import Bundle

    return Bundle("cfg", "regulator", {}, files)


def test_what_was_written_is_read(files):
    tables = reading.read_tables(reading_bundle(files))
    assert [table.name for table in tables.tables] == ["full", "lean", "full->lean"]
    assert [unit.manager for unit in tables.units] == [2, 0, 1]
    assert tables.promise_bytes == tables.platform.promise_bytes == 512
    assert sum(tables.tables[0].budgets("u1", "read")) == (6 * 4 + 3 * 2) * 64
    assert len(tables.tables[2].budgets("u3", "write")) == 20


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (None, "not in the bundle"),
        (b"", "Expecting value"),
        (b"[" * 100_000, ""),
        (b"{}", 'lacks "halpipe-regulator"'),
        (b'{"halpipe-regulator": 2}', "must be 1"),
        (b"[]", "is no object"),
        (b"\xff\xfe\x00", ""),
        (b'{"halpipe-regulator": ' + b"9" * 5000 + b"}", ""),
    ],
)
def test_what_is_no_table_object(content, part):
    assert part in refusal(content)


@pytest.mark.parametrize(
    ("path", "value", "part"),
    [
        (("platform", "window_cycles"), 0, '"window_cycles" is 0, no whole number from 1'),
        (("platform", "clock_hz"), 1.5, "\"clock_hz\" is '1.5', no whole number"),
        (("platform", "guaranteed"), "fast", "no number such as 12"),
        (("platform", "guaranteed"), float("inf"), "no number such as 12"),
        (("platform", "guaranteed"), None, "no number such as 12"),
        (("platform", "unspecified"), "both", "neither read nor write"),
        (("units",), [], "units must be there"),
        (("units", 0, "index"), 1, "in the order of their index"),
        (("units", 0, "default", "read"), -1, '"read" is -1, no whole number from 0'),
        (("tables",), [], "tables must be there"),
        (("tables", 0, "kind"), "other", "the kind 'other'"),
        (("tables", 0, "rounding"), "nearest", "the rounding 'nearest'"),
        (("tables", 0, "windows"), 2**23, "more than 4194304 are not checked"),
        (("tables", 0, "entries"), {}, "entries for every unit"),
        (("tables", 0, "entries", "u1"), [], "must begin with window 0"),
        (("tables", 0, "entries", "u1", 0, "window"), 1, "must begin with window 0"),
        (("tables", 0, "entries", "u1", 1, "window"), 40, "stay below 40"),
        (("tables", 0, "entries", "u1", 1, "read_bytes"), 63, "are not its bytes"),
        (("tables", 0, "entries", "u1", 1, "write_bytes"), True, '"write_bytes" is True, no whole number'),
        (("switches", 0), "full", "is no object"),
        (("backend",), 7, '"backend" is 7, no text'),
    ],
)
def test_each_part_that_is_not_in_form_is_named(files, path, value, part):
    data = json.loads(files["tables.json"])
    place = data
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    assert part in refusal(json.dumps(data).encode())
