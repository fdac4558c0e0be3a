"""The exact check of regulator tables: what is right passes, and every fault is named by its own code."""

import json
from dataclasses import replace

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.deploy.base import Checked, CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes, with_tables
from halpipe.deploy.regulator.arithmetic import Arithmetic
from halpipe.deploy.regulator.reading import Entry, read_tables
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.pipeline.verify import verify


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system())


def findings(files):
    target = bundles.target(files)
    return list(Arithmetic(target, read_tables(target.bundle)).findings())


def found(files):
    return sorted({finding.code for finding in findings(files)})


def ids(*expected):
    return sorted(code.id for code in expected)


def test_the_sample_is_a_valid_schedule():
    assert [d for d in verify(*bundles.system()) if d.is_error] == []


@pytest.mark.parametrize("rounding", ["whole", "controlled"])
@pytest.mark.parametrize("shift", ["0ns", "100ns", "1/3us"])
def test_what_the_exporter_writes_passes(tmp_path, shift, rounding):
    files = bundles.export(tmp_path, *bundles.system(shift), rounding=rounding)
    assert findings(files) == []


def test_it_counts_what_it_held_against_what(files):
    target = bundles.target(files)
    arithmetic = Arithmetic(target, read_tables(target.bundle))
    list(arithmetic.findings())
    assert arithmetic.windows == 40 + 40 + 20
    assert arithmetic.budgets == arithmetic.windows * 3 * 2


# ------------------------------------------------------------------------------------------------ budgets

CAUGHT_BY = {"another successor": codes.WRONG_SUCCESSOR}


@pytest.mark.parametrize("fault", bundles.FAULTS)
@pytest.mark.parametrize("rounding", ["whole", "controlled"])
def test_each_fault_of_the_tables_is_caught(tmp_path, fault, rounding):
    files = bundles.export(tmp_path, *bundles.system(), rounding=rounding)
    faulty = bundles.changed(files, bundles.FAULTS[fault])
    default = codes.WRONG_BUDGET if rounding == "whole" else codes.NOT_KEPT_UP
    assert CAUGHT_BY.get(fault, default).id in found(faulty)


@pytest.mark.parametrize("unit", ["u1", "u2", "u3"])
@pytest.mark.parametrize("table", [0, 1, 2])
@pytest.mark.parametrize("rounding", ["whole", "controlled"])
def test_one_burst_in_any_one_window_is_caught(tmp_path, unit, table, rounding):
    files = bundles.export(tmp_path, *bundles.system(), rounding=rounding)

    def edit(window, direction, change):
        def apply(data):
            values = bundles.budgets(data, table, unit)
            values[window][direction] += change
            bundles.set_budgets(data, table, unit, values)

        return apply

    for window in (0, 7, 19):
        for direction in (0, 1):
            assert found(bundles.changed(files, edit(window, direction, 1))) != []


def test_the_message_has_the_numbers(files):
    (finding,) = findings(bundles.changed(files, bundles.FAULTS["one burst more"]))
    assert finding.path == 'table "full", unit "u1", read'
    assert finding.message == "5 bursts in window 20, promised are 4"


@pytest.mark.parametrize(("count", "tail"), [(1, ""), (2, ", and 1 more"), (3, ", and 2 more")])
def test_further_windows_are_counted(files, count, tail):
    def change(data):
        values = bundles.budgets(data, 0, "u1")
        for window in range(20, 20 + count):
            values[window][0] += 1
        bundles.set_budgets(data, 0, "u1", values)

    (finding,) = findings(bundles.changed(files, change))
    assert finding.message == f"5 bursts in window 20, promised are 4{tail}"


def test_a_budget_granted_later_is_behind(tmp_path):
    """Controlled rounding may move a burst by less than one; a whole window later is too late."""
    files = bundles.export(tmp_path, *bundles.system(), rounding="controlled")
    finding = findings(bundles.changed(files, bundles.FAULTS["a window late"]))[0]
    assert finding.code == codes.NOT_KEPT_UP.id
    assert finding.message.startswith("0 bursts until the end of window 1, promised are 2")


# ------------------------------------------------------------------------------------------------ sums


def overshoot(unit, direction, amount):
    def change(data):
        next(u for u in data["units"] if u["unit"] == unit)["overshoot"][direction] = amount

    return change


def test_a_window_may_be_full_and_not_a_byte_more(files):
    peak = 384  # of 512 B
    assert found(bundles.changed(files, overshoot("u1", "read", 512 - peak))) == []
    assert found(bundles.changed(files, overshoot("u1", "read", 512 - peak + 1))) == ids(codes.OVER_CAPACITY)


@pytest.mark.parametrize(
    ("budgets", "charged"),
    [
        ({0: 128, 3: 0, 5: 64}, [(0, 128), (3, 64), (4, 0), (5, 64)]),
        ({0: 128, 3: 0, 4: 64}, [(0, 128), (3, 64), (4, 64)]),
        ({0: 0, 2: 64, 37: 0}, [(0, 0), (2, 64), (37, 64), (38, 0)]),
        ({0: 0, 2: 64, 39: 0}, [(0, 0), (2, 64), (39, 64)]),
        ({0: 0, 2: 64}, [(0, 64), (1, 0), (2, 64)]),
        ({0: 0}, [(0, 0)]),
    ],
)
def test_a_burst_that_waits_is_charged_to_the_first_window_without_a_budget(files, budgets, charged):
    """Of a table of 40 windows that repeats."""
    target = bundles.target(files)
    tables = read_tables(target.bundle)
    unit = tables.units[0]
    entries = tuple(Entry(window, budget, 0) for window, budget in budgets.items())
    table = replace(tables.tables[0], entries={unit.name: entries})
    arithmetic = Arithmetic(target, replace(tables, tables=(table,), switches=()))
    assert list(arithmetic._charged(table, unit, "read")) == charged


def test_overshoot_is_what_the_platform_and_the_back_end_give(files):
    other = bundles.changed(files, overshoot("u3", "write", 64))
    checked = DEPLOYMENT.check(bundles.target(other), CheckOptions(engine="arithmetic"))
    assert codes.WRONG_FACTS.id in {d.code for d in checked.diagnostics}


@pytest.mark.parametrize("fact", ["clock_hz", "bus_bytes", "window_cycles", "capacity", "table_depth"])
def test_the_facts_are_those_of_the_platform_file(files, fact):
    def change(data):
        data["platform"][fact] *= 2

    checked = DEPLOYMENT.check(bundles.target(bundles.changed(files, change)), CheckOptions(engine="arithmetic"))
    told = [d.message for d in checked.diagnostics if d.code == codes.WRONG_FACTS.id]
    assert any(message.startswith(fact) and "platform.yaml gives" in message for message in told)


def default(unit, direction, amount):
    def change(data):
        next(u for u in data["units"] if u["unit"] == unit)["default"][direction] = amount

    return change


@pytest.mark.parametrize(
    ("unit", "amount", "is_safe"), [("u1", 64, True), ("u1", 0, False), ("u1", 96, False), ("u1", 1024, False)]
)
def test_defaults_are_whole_bursts_that_let_everyone_on_and_fit(files, unit, amount, is_safe):
    changed = bundles.changed(files, default(unit, "read", amount))
    assert found(changed) == ([] if is_safe else ids(codes.UNSAFE_DEFAULT))


def test_a_row_without_budgets_needs_no_default(files):
    assert found(bundles.changed(files, default("u3", "write", 0))) == []


# ------------------------------------------------------------------------------------------------ facts and tables


def put(*path):
    *way, value = path

    def change(data):
        for step in way[:-1]:
            data = data[step]
        data[way[-1]] = value

    return change


def remove_unit(data):
    data["units"].pop()
    for table in data["tables"]:
        del table["entries"]["u3"]


def repeat(key):
    def change(data):
        data[key].append({**data[key][-1], **({"index": len(data[key])} if key == "tables" else {})})

    return change


def drop(key, number):
    def change(data):
        del data[key][number]
        if key == "tables":
            for index, table in enumerate(data[key]):
                table["index"] = index

    return change


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (put("schedule_sha256", "0" * 64), codes.OTHER_SCHEDULE),
        (put("model_sha256", "0" * 64), codes.OTHER_SCHEDULE),
        (put("window_ns", "641"), codes.WRONG_FACTS),
        (put("promise_bytes", "511"), codes.WRONG_FACTS),
        (put("capacity_bytes", 511), codes.WRONG_FACTS),
        (put("platform", "capacity", 900_000_000), codes.WRONG_FACTS),
        (put("platform", "resource", "disk"), codes.WRONG_FACTS),
        (put("platform", "window_cycles", 0), codes.WRONG_FACTS),
        (put("platform", "clock_hz", 1.5), codes.WRONG_FACTS),
        (put("platform", "guaranteed", "fast"), codes.WRONG_FACTS),
        (put("platform", "unspecified", "both"), codes.WRONG_FACTS),
        (put("units", 0, "manager", 0), codes.WRONG_FACTS),
        (remove_unit, codes.UNREGULATED_UNIT),
        (drop("tables", 1), codes.WRONG_TABLE),
        (drop("tables", 2), codes.WRONG_TABLE),
        (repeat("tables"), codes.WRONG_TABLE),
        (put("tables", 0, "windows", 41), codes.WRONG_TABLE),
        (put("tables", 2, "cycles", 1), codes.WRONG_TABLE),
        (put("tables", 2, "length_ns", "12801"), codes.WRONG_TABLE),
        (put("tables", 1, "successor", 0), codes.WRONG_SUCCESSOR),
        (put("tables", 2, "successor", 2), codes.WRONG_SUCCESSOR),
        (put("switches", 0, "request", 1), codes.WRONG_SWITCH),
        (put("switches", 1, "request", 2), codes.WRONG_SWITCH),
        (put("switches", 0, "to", "full"), codes.WRONG_SWITCH),
        (drop("switches", 0), codes.WRONG_SWITCH),
        (repeat("switches"), codes.WRONG_SWITCH),
    ],
)
def test_each_wrong_figure_has_its_code(files, change, code):
    assert code.id in found(bundles.changed(files, change))


def test_one_table_without_switches_may_be_for_its_mode_alone(files):
    def alone(data):
        del data["tables"][1:]
        data["switches"].clear()

    def alone_with_switches(data):
        del data["tables"][1:]

    assert found(bundles.changed(files, alone)) == []
    assert codes.WRONG_TABLE.id in found(bundles.changed(files, alone_with_switches))


def test_more_tables_than_a_unit_can_name(files, monkeypatch):
    monkeypatch.setattr("halpipe.deploy.regulator.arithmetic.MAX_TABLES", 3)
    assert found(files) == []
    monkeypatch.setattr("halpipe.deploy.regulator.arithmetic.MAX_TABLES", 2)
    assert found(files) == ids(codes.TOO_DEEP)


# ------------------------------------------------------------------------------------------------ the whole check


def test_a_wrong_bundle_is_not_simulated_unless_asked(files):
    faulty = bundles.changed(files, bundles.FAULTS["one burst more"])
    checked = DEPLOYMENT.check(bundles.target(faulty), CheckOptions())
    told = "nothing executed: the tables are wrong (name an --engine to play them all the same)"
    assert checked.lines[1:] == (told,)
    assert {d.code for d in checked.diagnostics} >= {codes.WRONG_BUDGET.id, codes.FORMS_DIFFER.id}


def test_arithmetic_alone_says_so(files):
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="arithmetic"))
    assert checked.diagnostics == ()
    assert checked.lines == ("arithmetic: exact; 3 tables of 3 units, 600 budgets, 100 sums against 512 B a window",)


def test_tables_for_other_back_ends_are_executed_on_a_model_of_the_device(files):
    """This bundle has nothing in it that the device could load."""
    other = bundles.changed(files, put("backend", "memguard"))
    checked = DEPLOYMENT.check(bundles.target(other), CheckOptions())
    assert {d.code for d in checked.diagnostics} == {codes.NOT_UNDERSTOOD.id, codes.DEVICE_REFUSES.id}
    assert checked.lines[1].startswith("device: memguard")


def test_wrong_tables_of_a_device_are_executed_by_no_engine(files):
    def change(data):
        data["backend"] = "axi-realm"
        bundles.FAULTS["one burst more"](data)

    checked = DEPLOYMENT.check(bundles.target(bundles.changed(files, change)), CheckOptions())
    assert checked.lines[1:] == ("nothing executed: the tables are wrong",)


def test_regulators_beside_programs_are_checked_with_them(files):
    own = {f"regulator/{name}": data for name, data in files.items() if name not in ("model.xml", "schedule.xml")}
    programs = Checked(diagnostics=(), lines=("programs",))
    alone = {name: files[name] for name in ("model.xml", "schedule.xml")}
    assert with_tables(bundles.target(alone), programs) is programs
    faulty = bundles.changed(files, bundles.FAULTS["one burst more"])["tables.json"]
    for changes in ({}, {"regulator/tables.json": faulty}):
        checked = with_tables(bundles.target(alone | own | changes), programs)
        said = f"{len(checked.diagnostics)} findings" if changes else "exact"
        assert [line.split(";")[0] for line in checked.lines[:2]] == ["programs", f"regulators: arithmetic: {said}"]
        assert (codes.WRONG_BUDGET.id in {d.code for d in checked.diagnostics}) == bool(changes)


def test_an_engine_that_does_not_exist_is_a_mistake_of_the_caller(files):
    with pytest.raises(HalpipeError) as refused:
        DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="verilater"))
    assert refused.value.exit is Exit.USAGE
    assert refused.value.diagnostics[0].code == codes.NO_ENGINE.id
    assert "verilator" in refused.value.diagnostics[0].help


def test_every_switch_has_a_table_where_several_memories_are_switched_together(tmp_path):
    """The switch that needs none has one of a cycle of the mode after; tables have the same numbers for each memory."""
    m, s = bundles.system("100ns")
    other = replace(m, resources=(*m.resources, replace(m.resources[0], name="bus")))
    requests = []
    for resource, switches in (("mem", "needed"), ("mem", "all"), ("bus", "all")):
        path = tmp_path / "platform.yaml"
        units = "".join(f"  u{n}: {{manager: {n}}}\n" for n in (1, 2, 3))
        text = bundles.PLATFORM.format(window="64", units=units, clock="100MHz", capacity="800MB/s")
        text = text.replace("resource: mem", f"resource: {resource}")
        path.write_text(f"{text}table: {{switches: {switches}}}\n")
        files = RegulatorExporter().write(other, s, RegulatorOptions(platform=str(path)))
        checked = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine="arithmetic"))
        assert checked.diagnostics == ()
        data = json.loads(files["tables.json"])
        requests.append([switch["request"] for switch in data["switches"]])
    assert requests == [[2, 0], [2, 3], [2, 3]]
