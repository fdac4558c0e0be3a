"""Every back-end: its files to the byte, their forms against each other, and the traps of the hardware as checks."""

import os
import re
import shutil
import subprocess
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from regulator_samples import DIGEST, files, low_bounds, made, two_units

from halpipe.core.diagnostics import HalpipeError
from halpipe.devices.registers import RegisterFile
from halpipe.exporters.regulator import codes
from halpipe.exporters.regulator.axi_realm.writer import OPEN
from halpipe.exporters.regulator.platform import BACKENDS
from halpipe.exporters.regulator.writing import backend, comment, file_names, identifiers

GOLDEN = Path(__file__).parents[3] / "golden" / "exporters"


def test_the_register_has_the_back_ends_that_platforms_may_name():
    assert tuple(backend(name).name for name in BACKENDS) == BACKENDS
    with pytest.raises(HalpipeError) as refused:
        backend("tabel")
    (found,) = refused.value.diagnostics
    assert (found.code, found.help) == (codes.UNKNOWN_BACKEND.id, 'did you mean "table"?')


@pytest.mark.parametrize("name", BACKENDS)
def test_golden(tmp_path, name):
    """After a wanted change: HALPIPE_UPDATE_GOLDEN=1 pytest tests/unit/exporters/regulator."""
    written = {
        n: c
        for n, c in files(tmp_path, name).items()
        if not n.startswith(("rtl/", "dma/", "linux/")) and not n.endswith((".rdl", ".xml"))
    }
    folder = GOLDEN / "regulator" / name
    if os.environ.get("HALPIPE_UPDATE_GOLDEN"):
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for file, content in written.items():
            (folder / file).write_bytes(content)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == written


@pytest.mark.parametrize("name", BACKENDS)
def test_the_same_schedule_gives_the_same_bytes(tmp_path, name):
    assert files(tmp_path, name) == files(tmp_path, name)


@pytest.mark.parametrize("name", BACKENDS)
def test_every_text_states_the_schedule(tmp_path, name):
    for file, content in files(tmp_path, name).items():
        if file.endswith((".h", ".sh", ".txt")) and not file.startswith("linux/"):
            assert DIGEST.encode() in content, file


# --------------------------------------------------------------------------------------------------- C and shell


CC = ["cc", "-std=c99", "-Wall", "-Wextra", "-Wno-unused-const-variable", "-pedantic"]


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("sample", [low_bounds, two_units])
def test_the_header_compiles_without_a_warning(tmp_path, sample):
    (tmp_path / "bw_tables.h").write_bytes(files(tmp_path, "table", sample)["bw_tables.h"])
    (tmp_path / "main.c").write_text('#include "bw_tables.h"\n#include "bw_tables.h"\nint main(void) { return 0; }\n')
    done = subprocess.run([*CC, "-fsyntax-only", "main.c"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


INCLUDED = """#include <stdint.h>
#include <stdio.h>
#define READ(offset, mask, least, most)
#define WRITE(at, offset, value) {at, offset, value},
static const struct { int64_t at; uint32_t offset, value; } writes[] = {
#include "%s"
};
int main(void)
{
  for (unsigned n = 0; n < sizeof writes / sizeof *writes; n++) {
    printf("WRITE(%%lld, ", (long long)writes[n].at);
    printf("0x%%03x, 0x%%08x)\\n", (unsigned)writes[n].offset, (unsigned)writes[n].value);
  }
  return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
@pytest.mark.parametrize("name", ["axi-realm", "qos400"])
def test_register_scripts_are_rows_of_an_array_in_c(tmp_path, name):
    for file, content in files(tmp_path, name).items():
        if file.endswith(".txt"):
            (tmp_path / file).write_bytes(content)
            (tmp_path / "main.c").write_text(INCLUDED % file)
            subprocess.run([*CC, "-Werror", "-o", "main", "main.c"], cwd=tmp_path, check=True)
            printed = subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
            assert printed.splitlines() == [line for line in content.decode().splitlines() if line.startswith("WRITE")]


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_compiled_table_says_what_the_table_object_says(tmp_path):
    tables, _ = made(tmp_path, "table")
    (tmp_path / "bw_tables.h").write_bytes(backend("table").write(tables, DIGEST)["bw_tables.h"])
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "bw_tables.h"\nint main(void) { for (uint32_t u = 0; u < BW_UNITS; u++) {'
        " const struct bw_unit *b = &bw_units[u]; for (uint32_t t = 0; t < BW_TABLES; t++) for (uint32_t e ="
        " b->tables[t].base; e < (t + 1 < BW_TABLES ? b->tables[t + 1].base : b->entries); e++)"
        ' printf("%s %u %u %u %u %u\\n", b->name, t, b->tables[t].windows, b->table[e].start_window,'
        " b->table[e].rd_bytes, b->table[e].wr_bytes); } }\n"
    )
    subprocess.run(["cc", "-o", "main", "main.c"], cwd=tmp_path, check=True)
    printed = subprocess.run(["./main"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert printed.splitlines() == [
        f"{unit.name} {table.index} {table.windows} {e.window} {e.read * 64} {e.write * 64}"
        for unit in tables.units
        for table in tables.tables
        for e in table.entries(unit.name)
    ]


@pytest.mark.parametrize("name", BACKENDS)
def test_scripts_are_shell(tmp_path, name):
    scripts = {n: c for n, c in files(tmp_path, name).items() if n.endswith(".sh")}
    assert bool(scripts) == (name != "table")
    for content in scripts.values():
        subprocess.run(["sh", "-n"], input=content, check=True)


def test_names_in_c_are_unique_and_plain():
    found = identifiers(["a->b", "a.to.b", "a-b", "a_b", "1"])
    assert found == ["A_TO_B", "A_TO_B_2", "A_B", "A_B_2", "1"]
    assert identifiers(["a b", "a-b", "a.b"]) == ["A_B", "A_B_2", "A_B_3"]


def test_file_names_are_unique_and_safe():
    assert file_names(["a/b->c", "a:b", "a b"]) == ["0-a_b-to-c", "1-a_b", "2-a_b"]
    assert file_names(["x" * 100]) == ["0-" + "x" * 80]


def test_no_name_ends_a_comment():
    assert comment("a*/b/*c\nd") == "a*_/b/_*c\\nd"


# ---------------------------------------------------------------------------------------------- the generic unit


def test_the_memory_images_hold_the_entries_of_all_tables(tmp_path):
    tables, _ = made(tmp_path, "table")
    written = backend("table").write(tables, DIGEST)
    for unit in tables.units:
        lines = written[f"unit{unit.index}.tab.memh"].decode().splitlines()
        heads = written[f"unit{unit.index}.hdr.memh"].decode().splitlines()
        assert lines[-1] == "ffffffff0000000000000000"
        assert all(re.fullmatch("[0-9a-f]{24}", line) for line in lines)
        assert heads[len(tables.tables) :] == ["0" * 16] * (16 - len(tables.tables))  # for tables there are none of
        for table, head in zip(tables.tables, heads[: len(tables.tables)], strict=True):
            successor, base, windows = int(head[:2], 16), int(head[2:8], 16), int(head[8:], 16)
            assert (successor, windows) == (table.successor, table.windows)
            entries = table.entries(unit.name)
            words = [(int(w[:8], 16), int(w[8:16], 16), int(w[16:], 16)) for w in lines[base : base + len(entries)]]
            assert words == [(e.window, e.read * 64, e.write * 64) for e in entries]


def test_a_memory_that_is_exactly_large_enough_is(tmp_path):
    tables, _ = made(tmp_path, "table")
    needed = max(1 + sum(len(t.entries(u.name)) for t in tables.tables) for u in tables.units)
    assert made(tmp_path, "table", table=f"{{depth: {needed}}}")[1] == []
    found = made(tmp_path, "table", table=f"{{depth: {needed - 1}}}")[1]
    assert {d.code for d in found} == {codes.DOES_NOT_FIT.id}
    assert f"depth: {needed}" in found[-1].help


def test_windows_that_are_too_short_for_the_hardware_are_refused(tmp_path):
    tables, _ = made(tmp_path, "table")
    for cycles, expected in ((4, []), (3, [codes.DOES_NOT_FIT.id])):
        short = replace(tables, platform=replace(tables.platform, cycles=cycles))
        assert [d.code for d in backend("table").check(short)] == expected


def test_more_units_than_one_block_serves(tmp_path):
    tables, _ = made(tmp_path, "table")
    for count, expected in ((63, []), (64, [codes.DOES_NOT_FIT.id])):
        many = replace(tables, units=tuple(replace(tables.units[0], index=n) for n in range(count)))
        assert [d.code for d in backend("table").check(many)] == expected


def test_the_unit_and_its_registers_come_with_the_tables(tmp_path):
    written = files(tmp_path, "table")
    assert any(name.startswith("rtl/") for name in written)
    described = written["regulator.rdl"].decode()
    offsets = dict(re.findall(r"\} (\w+)(?:\[\w+\])? @(0x[0-9a-f]+)", described))
    expected = {"CTRL": 0x8, "STATUS": 0xC, "WINDOW": 0x10, "REQ_TABLE": 0x1C, "HDR": 0x800, "TAB": 0x1000}
    assert {name: int(offsets[name], 16) for name in expected} == expected
    assert described.count("{") == described.count("}")


# ---------------------------------------------------------------------------------------------------- AXI-REALM


def writes(content):
    found = re.findall(r"WRITE\((-?\d+), (0x\w+), (0x\w+)\)", content.decode())
    return [(None if at == "-1" else int(at), int(offset, 16), int(value, 16)) for at, offset, value in found]


def test_empty_regions_end_above_their_start(tmp_path):
    """The address decoder of axi_rt stops a simulation otherwise."""
    setup = {o: value for _, o, value in writes(files(tmp_path, "axi-realm")["setup.txt"])}
    for field in (0, 1, 4, 5):  # of managers 0 and 2
        low, high, end_low, end_high = (setup[bank + 4 * field] for bank in (0x24, 0x64, 0xA4, 0xE4))
        assert (high << 32 | low) < (end_high << 32 | end_low)


def test_set_up_claims_first_and_writes_budgets_before_periods_and_enables_last(tmp_path):
    setup = [offset for _, offset, _ in writes(files(tmp_path, "axi-realm")["setup.txt"])]
    assert setup[0] == 0x7FC
    assert setup[-2:] == [0x0C, 0x1C]
    budgets = [i for i, offset in enumerate(setup) if 0x124 <= offset < 0x1A4]
    periods = [i for i, offset in enumerate(setup) if 0x1A4 <= offset < 0x224]
    assert max(budgets) < min(periods)


def test_no_budget_of_a_used_unit_is_zero_and_only_empty_regions_are_open(tmp_path):
    for name, content in files(tmp_path, "axi-realm").items():
        if name.endswith(".txt"):
            budgets = {offset: value for _, offset, value in writes(content) if 0x124 <= offset < 0x1A4}
            assert all(budgets.values())
            if name == "setup.txt":
                assert budgets[0x124] == 64  # u1 never writes; 0 would stop its reads as well
                assert budgets[0x164 + 4] == OPEN  # an unused region
                assert budgets[0x164] < OPEN


@pytest.mark.parametrize("sample", [low_bounds, two_units])  # the cycles of one end as they begin
def test_replayed_register_writes_give_the_budgets_of_the_table(tmp_path, sample):
    """A write in window k applies from window k + 1 on; an idle row keeps a burst."""
    tables, _ = made(tmp_path, "axi-realm", sample)
    written = backend("axi-realm").write(tables, DIGEST)
    registers = RegisterFile("axi_realm", 8, 2)
    for table, stem in zip(tables.tables, file_names(t.name for t in tables.tables), strict=True):
        steps = writes(written[f"{stem}.txt"])
        for row in tables.rows:
            unit = next(u for u in tables.units if u.name == row.unit)
            offset = registers.offset(f"{row.direction}_budget", 2 * unit.manager)
            value = next(v for k, o, v in steps if k is None and o == offset)
            seen = []
            for window in range(table.windows):
                seen.append(value)
                value = next((v for k, o, v in steps if k == window and o == offset), value)
            assert seen == [max(n, 1) * 64 for n in table.row(row)]
            if table.successor == table.index:
                assert value == seen[0]  # ready for the next cycle


def test_reads_and_writes_of_one_manager_are_reported(tmp_path):
    found = made(tmp_path, "axi-realm", **{"axi-realm": "{pending: 1}"})[1]
    assert [(d.code, d.path) for d in found] == [
        (codes.BINDS_BOTH.id, 'unit "u2"'),
        (codes.SHORT_BURSTS.id, "platform axi-realm"),
    ]
    assert "both its reads and its writes" in found[0].message


def test_windows_of_parts_of_a_cycle_are_for_the_table_alone(tmp_path):
    """A period register holds whole cycles."""
    changes = {"clock": "999999Hz", "window": "1ms", "guaranteed": "6.4MB/s", "capacity": "7.6MB/s"}
    tables, found = made(tmp_path, "axi-realm", **changes)
    (refused,) = [d for d in found if d.is_error]
    assert (refused.code, refused.path) == (codes.DOES_NOT_FIT.id, "platform window")
    assert "999 or 1000 cycles" in refused.message
    assert tables.platform.extra == Fraction(999, 1000)
    assert [d for d in made(tmp_path, "table", **changes)[1] if d.is_error] == []


def test_budgets_below_what_may_be_pending_are_reported(tmp_path):
    for pending, expected in ((10, 0), (11, 1)):  # u2 writes 10 bursts
        found = made(tmp_path, "axi-realm", **{"axi-realm": f"{{pending: {pending}}}"})[1]
        assert len([d for d in found if "pending" in d.message]) == expected


def test_more_writes_than_the_handler_can_do_are_refused(tmp_path):
    for limit, expected in ((4, []), (3, [codes.TOO_MANY_WRITES.id])):
        settings = {"axi-realm": f"{{pending: 1, writes-per-window: {limit}}}"}
        found = made(tmp_path, "axi-realm", **settings)[1]
        assert [d.code for d in found if d.is_error] == expected


def test_managers_beyond_the_register_file_are_refused(tmp_path):
    found = made(tmp_path, "axi-realm", **{"axi-realm": "{managers: 2}"})[1]
    assert [d.message for d in found if d.is_error] == ["manager 2 does not exist; the register file has 2"]
    assert {d.code for d in found if d.is_error} == {codes.DOES_NOT_FIT.id}
