"""Models that halpipe exported as ARXML, read back after somebody edited the file: standard elements count."""

import pytest
from arxml_case import Overlay
from lxml import etree

from arxml_reading import NS, all_of, by_path, q, write
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.own.codes import BESIDE_MODEL, EDITED, SECOND_MODEL
from halpipe.importers.common.base import ImportOptions
from support import access, after, chain, mode, model, ms, task, version

PUMP = task(
    "/pump",
    "1/30s",
    version("fast", "1/3ms", "u1 u2", access("bus", 0, "0.1ms", "1/3", "read")),
    version("slow", "2ms", "u2"),
)
VALVE = task(
    "valve", "20ms", version("v", "1ms", "u2", after("/pump", 1, 8, "end")), deadline="15.0005ms", offset="5ms"
)
VENT = task("vent", None, version("v", "1ms", "u1"))
SYSTEM = model(
    PUMP,
    VALVE,
    VENT,
    units="u1 u2",
    resources="bus",
    chains=[chain("c", "/pump valve", reaction="40ms", age="100/3ms")],
    modes=[mode("run", (PUMP, VALVE, VENT)), mode("idle", (PUMP,))],
    transitions=[("run", "idle", "1/3ms")],
)
PERIOD = q(".//PERIOD")


def factor(element, path):
    return element.find(q(f"{path}/CSE-CODE-FACTOR"))


def data(element, key):
    """The special data with a key, anywhere inside an element."""
    return next(sd for sd in element.iter(NS + "SD") if sd.get("GID") == key)


@pytest.fixture
def edit(tmp_path):
    """Export, change the file with a function, and import it: the model, and what was reported."""

    def run(change, strict=False, overlay=None, release="R22-11"):
        root = write(SYSTEM, release=release)
        change(root)
        path = tmp_path / "m.arxml"
        path.write_bytes(etree.tostring(root))
        imported = FORMAT.read([str(path)], ImportOptions(strict=strict, overlay=overlay))
        return imported.model, [(d.code, d.path, d.message) for d in imported.diagnostics]

    return run


def nothing(root):
    assert root is not None


@pytest.mark.parametrize("release", ["4.0.3", "R22-11"])
def test_what_nobody_edited_comes_back_without_a_word(edit, release):
    assert edit(nothing, release=release) == (SYSTEM, [])


def test_the_account_tells_what_carries_the_model(tmp_path):
    path = tmp_path / "m.arxml"
    path.write_bytes(etree.tostring(write(SYSTEM)))
    imported = FORMAT.read([str(path)], ImportOptions(name="other"))
    assert imported.model.name == "other"
    rows = {kind: (read, mapped) for kind, read, mapped, _ in imported.coverage.rows()}
    assert rows["RUNNABLE-ENTITY"] == (3, 3)
    assert rows["SWC-IMPLEMENTATION"] == (4, 4)
    assert rows["HW-ELEMENT"] == (3, 3)
    assert rows["HW-CATEGORY"] == (2, 0)
    assert {e.reason for e in imported.coverage.ignored_elements} == {"follows from other elements"}


# ----------------------------------------------------------------------------------- elements against exact values


def test_an_edited_period_counts(edit):
    def change(root):
        by_path(root, "/m/Components/pump/Behavior/Every").find(NS + "PERIOD").text = "0.04"

    found, reports = edit(change)
    assert found.task("/pump").period == ms(40)
    path = 'RUNNABLE-ENTITY "/m/Components/pump/Behavior/pump"'
    message = 'PERIOD of /m/Components/pump/Behavior/Every is 0.04, which is not "period", 100/3ms, in seconds'
    assert reports == [(EDITED.id, path, message)]


def test_a_period_that_was_exact_is_read_as_it_stands(edit):
    def change(root):
        by_path(root, "/m/Components/valve/Behavior/Every").find(NS + "PERIOD").text = "0.04"

    found, reports = edit(change)
    assert found.task("valve").period == ms(40)
    assert reports == []


def test_an_event_that_was_removed_makes_a_task_on_demand(edit):
    def change(root):
        events = by_path(root, "/m/Components/pump/Behavior").find(NS + "EVENTS")
        events.remove(events[0])

    found, reports = edit(change)
    assert found.task("/pump").period is None
    assert [message for _, _, message in reports] == ["has a period, but no event starts it"]


@pytest.mark.parametrize("value", ["soon", "-1"])
def test_a_period_that_is_no_time_is_reported(edit, value):
    def change(root):
        by_path(root, "/m/Components/pump/Behavior/Every").find(NS + "PERIOD").text = value

    found, reports = edit(change)
    assert found.task("/pump").period == ms("1/30s")
    assert reports[0][2].endswith(f'"{value}", is no time in seconds')


def test_edited_offsets_deadlines_and_execution_times_count(edit):
    def change(root):
        by_path(root, "/m/Components/valve/Behavior/Every").find(NS + "OFFSET").text = "0.006"
        factor(by_path(root, "/m/Timing/Requirements/valve_deadline"), "MAXIMUM").text = "14000"
        for name in ("u1", "u2"):
            time = by_path(root, f"/m/Implementations/pump_fast/Resources/{name}")
            factor(time, "WORST-CASE-EXECUTION-TIME").text = "900"

    found, reports = edit(change)
    valve = found.task("valve")
    assert (valve.offset, valve.deadline) == (ms(6), ms(14))
    assert found.task("/pump").version("fast").wcet == ms("0.9ms")
    assert {code for code, _, _ in reports} == {EDITED.id}
    assert len(reports) == 4


def test_the_longest_execution_time_of_the_units_counts(edit):
    def change(root):
        time = by_path(root, "/m/Implementations/pump_slow/Resources/u2")
        factor(time, "WORST-CASE-EXECUTION-TIME").text = "2500"

    assert edit(change)[0].task("/pump").version("slow").wcet == ms("2.5ms")


def test_times_in_other_codes_are_reported(edit):
    def change(root):
        factor(by_path(root, "/m/Timing/Requirements/c_age"), "MAXIMUM").getprevious().text = "3"

    found, reports = edit(change)
    assert found.chains[0].max_age == ms("100/3ms")
    assert reports[0][2] == "MAXIMUM of /m/Timing/Requirements/c_age is no time in microseconds (CSE-CODE 0)"


def test_events_that_are_disabled_or_enabled_change_modes(edit):
    def change(root):
        for disabled in root.iter(NS + "DISABLED-MODE-IREFS"):
            for target in disabled.iter(NS + "TARGET-MODE-DECLARATION-REF"):
                target.text = "/m/Modes/Mode/run"

    found, reports = edit(change)
    runs = {m.name: [run.task for run in m.runs] for m in found.modes}
    assert runs == {"run": ["/pump", "vent"], "idle": ["/pump", "valve"]}
    assert [message for _, _, message in reports] == [
        'event of task "valve" is disabled in the mode',
        'event of task "valve" is not disabled in the mode',
    ]


def test_a_chain_follows_its_segments(edit):
    def change(root):
        refs = by_path(root, "/m/Timing/Requirements/c").find(NS + "SEGMENT-REFS")
        refs.remove(refs[0])

    assert edit(change)[0].chains[0].tasks == ("valve",)


# ----------------------------------------------------------------------------------------- damaged special data


@pytest.mark.parametrize(
    ("path", "key", "value", "part"),
    [
        ("/m/Implementations/pump_fast", "bound", "a third", '"bound" is unusable: '),
        ("/m/Implementations/pump_fast", "kind", "erase", "\"kind\" is unusable: 'erase' is not a valid AccessKind"),
        ("/m/Implementations/pump_fast", "start", "1", '"start" is unusable: '),
        ("/m/Implementations/valve_v", "max", "", '"max" is unusable: '),
        ("/m/Modes/Mode/run_to_idle", "max-length", "long", '"max-length" is unusable: '),
        ("/m/Modes/Mode/idle", "version", "turbo", 'names versions that task "/pump" does not have, or none'),
    ],
)
def test_special_data_that_cannot_be_read_are_reported(edit, path, key, value, part):
    def change(root):
        data(by_path(root, path), key).text = value

    found, reports = edit(change)
    assert any(message.startswith(part) for _, _, message in reports)
    assert {code for code, _, _ in reports} == {EDITED.id}
    assert found != SYSTEM


def test_a_unit_that_was_removed_is_missed_where_it_is_named(edit):
    def change(root):
        unit = all_of(root, "HW-ELEMENT")["u1"]
        unit.getparent().remove(unit)

    found, reports = edit(change)
    assert [unit.name for unit in found.units] == ["u2"]
    assert found.task("/pump").version("fast").units == ("u2",)
    assert {code for code, _, _ in reports} == {"HAL0511"}


def test_tools_may_wrap_and_move_what_they_keep(edit):
    """Blanks round values, units in another order, and a wrapped reference are no edits."""

    def change(root):
        for sd in root.iter(NS + "SD", NS + "SDX-REF", NS + "PERIOD", NS + "CSE-CODE-FACTOR"):
            sd.text = f"\n  {sd.text}\n"
        hardware = by_path(root, "/m/Platform").find(NS + "ELEMENTS")
        hardware[:] = sorted(hardware, key=lambda e: e.findtext(NS + "SHORT-NAME"))

    found, reports = edit(change)
    assert reports == []
    assert found == SYSTEM


def test_a_format_of_the_future_is_reported(edit):
    def change(root):
        data(root, "format").text = "2"

    assert [message for _, _, message in edit(change)[1]] == ["has the format 2; only 1 is known"]


def test_under_strict_an_edit_is_an_error(edit):
    def change(root):
        by_path(root, "/m/Components/pump/Behavior/Every").find(NS + "PERIOD").text = "0.04"

    with pytest.raises(HalpipeError) as refused:
        edit(change, strict=True)
    assert refused.value.exit is Exit.UNSUPPORTED


# ----------------------------------------------------------------------------------------------- whole inputs


def test_what_an_overlay_drops_is_gone_with_all_that_names_it(edit):
    found, reports = edit(nothing, overlay=Overlay({}, ("/pump",)))
    assert [task.name for task in found.tasks] == ["valve", "vent"]
    assert found.chains == ()
    assert found.task("valve").versions[0].precedences == ()
    assert [[run.task for run in m.runs] for m in found.modes] == [["valve", "vent"], []]
    assert reports == []


def test_two_models_are_refused(tmp_path):
    paths = []
    for name in ("a", "b"):
        paths.append(str(tmp_path / f"{name}.arxml"))
        (tmp_path / f"{name}.arxml").write_bytes(
            etree.tostring(write(model(PUMP, resources="bus", units="u1 u2", name=name)))
        )
    with pytest.raises(HalpipeError) as refused:
        FORMAT.read(paths, ImportOptions())
    assert [(d.code, d.path) for d in refused.value.diagnostics] == [(SECOND_MODEL.id, 'AR-PACKAGE "/b"')]


def test_components_beside_a_model_are_reported(edit):
    def change(root):
        other = etree.fromstring(etree.tostring(root.find(q("AR-PACKAGES/AR-PACKAGE"))))
        other.find(NS + "SHORT-NAME").text = "Other"
        other.remove(other.find(NS + "ADMIN-DATA"))
        root.find(NS + "AR-PACKAGES").append(other)

    found, reports = edit(change)
    assert found == SYSTEM
    names = "/Other/Components/pump, /Other/Components/valve, /Other/Components/vent, /Other/System/Composition"
    assert reports == [(BESIDE_MODEL.id, "", f"4 component types are not imported: {names}")]
