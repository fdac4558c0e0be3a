"""Files become one tree: encodings, split elements, reference bases, white space, files that do not belong."""

from itertools import permutations

import pytest
from arxml_case import (
    alarm,
    component,
    configuration,
    container,
    core,
    counter,
    document,
    el,
    every,
    found,
    mapped,
    named,
    order,
    os_task,
    package,
    periods,
    read,
    ref,
    refusal,
    rte,
    schedule_table,
    timing,
    write,
)

from halpipe.core.diagnostics import Exit, Findings
from halpipe.core.files import BROKEN_XML, CANNOT_READ
from halpipe.exporters.native import format_model
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.sniff import load
from halpipe.importers.arxml.system.reading import read_tree

PUMP = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables="Step")
TEXT = document(package("T", PUMP))
ONE_TASK = {"Pump/Step": "10ms"}


@pytest.mark.parametrize(
    "data",
    [
        TEXT.encode(),
        b'<?xml version="1.0" encoding="utf-8"?>\n' + TEXT.encode(),
        b'\xef\xbb\xbf<?xml version="1.0" encoding="utf-8"?>' + TEXT.encode(),
        b"\xef\xbb\xbf" + TEXT.encode(),
        b'<?xml version="1.0" encoding="ISO-8859-1"?><!-- \xe4 -->' + TEXT.encode(),
        b'<?xml version="1.0" encoding="UTF-16"?>'.decode().encode("utf-16") + TEXT.encode("utf-16")[2:],
        TEXT.replace("><", ">\r\n<").encode(),
        TEXT.replace("<AUTOSAR xmlns=", "<a:AUTOSAR xmlns:a=")
        .replace("</", "</a:")
        .replace("<", "<a:")
        .replace("<a:/a:", "</a:")
        .replace("<a:a:", "<a:")
        .encode(),
    ],
    ids=["no declaration", "utf-8", "BOM", "BOM only", "latin-1", "utf-16", "CRLF", "prefixed"],
)
def test_encodings_and_prefixes(tmp_path, data):
    path = tmp_path / "pump.arxml"
    path.write_bytes(data)
    assert periods(read(path)) == ONE_TASK


def test_white_space_in_references_and_names_is_ignored(tmp_path):
    text = TEXT.replace("/T/Pump/B/Step", "\n   /T/Pump\n   /B/Step ").replace(">Step<", "> Step\n<")
    path = tmp_path / "pump.arxml"
    path.write_text(text)
    imported = read(path)
    assert periods(imported) == ONE_TASK
    assert not found(imported, codes.DANGLING)


def test_an_element_split_over_files_is_one(tmp_path):
    event = every("0.01", "Tick", "Pump/Step")
    write(tmp_path, package("T", component("Pump", runnables="Step")), name="a.arxml")
    write(tmp_path, package("T", component("Pump", event)), name="b.arxml")
    assert periods(read(tmp_path)) == ONE_TASK


def test_equal_copies_are_no_conflict(tmp_path):
    write(tmp_path, package("T", PUMP), name="a.arxml")
    write(tmp_path, package("T", PUMP.replace("0.01", "1.0E-2")), name="b.arxml")
    imported = read(tmp_path)
    assert periods(imported) == ONE_TASK
    assert [task.origin.file for task in imported.model.tasks] == [str(tmp_path / "a.arxml")]


def test_a_conflict_names_both_places(tmp_path):
    first = write(tmp_path, package("T", PUMP), name="a.arxml")
    second = write(tmp_path, package("T", PUMP.replace("0.01", "0.02")), name="b.arxml")
    (conflict,) = [d for d in refusal(tmp_path).diagnostics if d.code == codes.CONFLICT.id]
    assert conflict.at.file == str(second)
    assert str(first) in conflict.message
    assert conflict.path == "/T/Pump/B/Tick"


TASKS = configuration("Os", os_task("A"), os_task("B"), counter(), counter("0.002", "Slow"))
CORES = configuration("EcuC", core("C0", "0"), core("C1", "1"))


def bound(core_name):
    refs = [("OsAppTaskRef", "/E/Os/A"), ("OsApplicationCoreRef", f"/E/EcuC/{core_name}")]
    return configuration("Os", container("Os/OsApplication", "App", refs=refs))


def called(task):
    return configuration("Rte", rte(mapped("Pump/B/Tick", task, "1")))


def two_starts(*cycles):
    kind = "Os/OsAlarm/OsAlarmAutostart"
    starts = (container(kind, f"s{cycle}", params={"OsAlarmCycleTime": cycle}) for cycle in cycles)
    return configuration("Os", container("Os/OsAlarm", "Al", *starts))


@pytest.mark.parametrize(
    ("first", "second", "what"),
    [
        (called("A"), called("B"), "RteMappedToTaskRef"),
        (bound("C0"), bound("C1"), "core"),
        (
            configuration("Os", alarm("Al", "10", activates="A")),
            configuration("Os", alarm("Al", "10", activates="A").replace("/E/Os/Ticks", "/E/Os/Slow")),
            "OsAlarmCounterRef",
        ),
        (
            configuration("Os", alarm("Al", "10", activates="A")),
            configuration("Os", alarm("Al", "10", activates="B")),
            "OsAlarmActivateTaskRef",
        ),
        (
            configuration("Os", schedule_table("S", "10", [("p", "2", "A")])),
            configuration("Os", schedule_table("S", "10", [("p", "2", "B")])),
            "OsScheduleTableActivateTaskRef",
        ),
        (two_starts("10"), two_starts("20"), "OsAlarmAutostart"),
    ],
    ids=lambda value: value if len(value) < 40 else "",
)
def test_a_configuration_split_over_files_states_one_target_only(tmp_path, first, second, what):
    base = (package("T", PUMP), package("E", TASKS, CORES))
    one = write(tmp_path, *base, package("E", first), name="a.arxml")
    two = write(tmp_path, package("E", second), name="b.arxml")
    for paths in ((one, two), (two, one)):
        (told,) = {d for d in refusal(*paths).diagnostics if d.code == codes.CONFLICT.id}
        assert (told.message.partition(" is ")[0], told.at.file) == (what, str(two))
        assert str(one) in told.message


def test_the_order_in_which_files_are_named_changes_nothing(tmp_path):
    fan = component("Fan", every("0.02", "Tick", "Fan/Blow"), runnables="Blow")
    both = component("Both", every("0.01", "A", "Both/X"), every("0.01", "B", "Both/Y"), runnables="X Y")
    contents = [
        (package("T", PUMP, both),),
        (package("T", fan), timing(order("O", "Both/X Both/Y"))),
        (timing(order("P", "Both/Y Both/X")),),
    ]
    paths = [write(tmp_path, *each, name=f"{name}.arxml") for name, each in zip("abc", contents, strict=True)]
    texts = {format_model(read(*each).model) for each in permutations(paths)}
    assert len(texts) == 1


def test_files_that_disagree_about_a_reference_base_are_named(tmp_path):
    def based(target, *elements):
        base = bases((el("SHORT-LABEL", "x"), ref("PACKAGE-REF", target)))
        return named("AR-PACKAGE", "T", base, el("ELEMENTS", *elements))

    one = write(tmp_path, based("/T/Pump", PUMP), name="a.arxml")
    two = write(tmp_path, based("/T/Fan"), name="b.arxml")
    (told,) = [d for d in refusal(two, one).diagnostics if d.code == codes.CONFLICT.id]
    assert (told.at.file, told.path) == (str(two), "/T")
    assert f'"/T/Fan" here, but "/T/Pump" at {one}' in told.message


def test_values_that_nothing_reads_may_differ(tmp_path):
    write(tmp_path, package("T", PUMP, named("SYSTEM", "S", el("CATEGORY", "one"))), name="a.arxml")
    write(tmp_path, package("T", named("SYSTEM", "S", el("CATEGORY", "two"))), name="b.arxml")
    assert periods(read(tmp_path)) == ONE_TASK


def bases(*entries):
    return el("REFERENCE-BASES", *[el("REFERENCE-BASE", *entry) for entry in entries])


def test_relative_references_use_the_base_they_name_or_the_default_of_their_package(tmp_path):
    def pump(event_ref):
        behavior = named(
            "SWC-INTERNAL-BEHAVIOR",
            "B",
            el("EVENTS", named("TIMING-EVENT", "Tick", event_ref, el("PERIOD", "0.01"))),
            el("RUNNABLES", named("RUNNABLE-ENTITY", "Step")),
        )
        return named("APPLICATION-SW-COMPONENT-TYPE", "Pump", el("INTERNAL-BEHAVIORS", behavior))

    target = ref("PACKAGE-REF", "/T", "AR-PACKAGE")
    label = el("SHORT-LABEL", "types")
    cases = [
        ('<START-ON-EVENT-REF BASE="types">Pump/B/Step</START-ON-EVENT-REF>', (label, target)),
        (
            "<START-ON-EVENT-REF>Pump/B/Step</START-ON-EVENT-REF>",
            (label, el("IS-DEFAULT", "true"), target),
        ),
        (
            '<START-ON-EVENT-REF BASE="types">Pump/B/Step</START-ON-EVENT-REF>',
            (label, el("BASE-IS-THIS-PACKAGE", "true"), ref("PACKAGE-REF", "/elsewhere")),
        ),
        (
            "<START-ON-EVENT-REF>Pump/B/Step</START-ON-EVENT-REF>",
            (label, el("IS-DEFAULT", "true"), el("BASE-IS-THIS-PACKAGE", "1")),
        ),
    ]
    for event_ref, base in cases:
        content = named("AR-PACKAGE", "T", bases(base), el("ELEMENTS", pump(event_ref)))
        assert periods(read(write(tmp_path, content))) == ONE_TASK


def test_the_nearest_package_that_declares_the_label_counts(tmp_path):
    event = named("TIMING-EVENT", "Tick", '<START-ON-EVENT-REF BASE="far">Pump/B/Step</START-ON-EVENT-REF>')
    event = event.replace("</TIMING-EVENT>", "<PERIOD>0.01</PERIOD></TIMING-EVENT>")
    inner = named("AR-PACKAGE", "Inner", bases((el("SHORT-LABEL", "near"), ref("PACKAGE-REF", "/none"))))
    inner = inner.replace("</AR-PACKAGE>", el("ELEMENTS", component("Fan", event)) + "</AR-PACKAGE>")
    far = bases((el("SHORT-LABEL", "far"), ref("PACKAGE-REF", "/T")))
    outer = named("AR-PACKAGE", "T", far, el("ELEMENTS", PUMP), el("AR-PACKAGES", inner))
    assert [d.code for d in read(write(tmp_path, outer)).diagnostics if d.code == codes.DANGLING.id] == []


def test_a_relative_reference_to_nothing_is_reported_as_it_is_written(tmp_path):
    event = named("TIMING-EVENT", "Tick", '<START-ON-EVENT-REF BASE="far">Pump/B/Step</START-ON-EVENT-REF>')
    content = package("T", PUMP, component("Fan", event))
    told = found(read(write(tmp_path, content)), codes.DANGLING)
    assert 'refers to "Pump/B/Step" of the base far, which is /Pump/B/Step' in told[0].message


@pytest.mark.parametrize("noise", ["<!-- -->", "<?tool x?>"])
def test_comments_and_instructions_inside_values_change_nothing(tmp_path, noise):
    plain = document(package("T", PUMP))
    noisy = plain
    for text in ("0.01", "/T/Pump/B/Step", "Tick", "Step</SHORT"):
        noisy = noisy.replace(text, f"{noise}{text[:1]}{noise}{text[1:]}" if "<" not in text else noise + text)
    paths = [tmp_path / "plain.arxml", tmp_path / "noisy.arxml"]
    for path, text in zip(paths, (plain, noisy), strict=True):
        path.write_text(text)
    assert periods(read(paths[0])) == periods(read(paths[1])) == ONE_TASK


def test_a_text_of_more_than_ten_megabytes_drops_no_file(tmp_path):
    content = package("T", PUMP).replace("<ELEMENTS>", el("DESC", "x" * 10_100_000) + "<ELEMENTS>", 1)
    assert periods(read(write(tmp_path, content))) == ONE_TASK


def test_two_variants_of_an_event_are_no_contradiction(tmp_path):
    def tick(label, value, period):
        condition = el("SW-SYSCOND", f'<SYSC-REF DEST="SW-SYSTEMCONST">/V/P</SYSC-REF> == {value}')
        point = el("VARIATION-POINT", el("SHORT-LABEL", label), condition)
        return every(period, "Tick", "Pump/Step", point)

    pump = component("Pump", tick("A", 1, "0.01"), tick("B", 2, "0.02"), runnables="Step")
    imported = read(write(tmp_path, package("T", pump)))
    assert periods(imported) == ONE_TASK
    assert any('PERIOD is "0.02" here, but "0.01"' in d.message for d in found(imported, codes.VARIANT))


def test_a_file_named_twice_is_read_once(tmp_path):
    path = str(write(tmp_path, package("T", PUMP)))
    assert [document.name for document in load([path, path], Findings())] == [path]


def test_elements_of_one_path_and_different_kinds_are_told_apart(tmp_path):
    imported = read(write(tmp_path, package("T", named("CLIENT-SERVER-INTERFACE", "Pump"), PUMP)))
    assert periods(imported) == ONE_TASK
    assert ("CLIENT-SERVER-INTERFACE", 1, 0, 1) in imported.coverage.rows()


def test_a_dangling_reference_suggests_where_the_name_exists(tmp_path):
    path = write(tmp_path, package("T", PUMP.replace("/T/Pump/B/Step", "/Other/Pump/B/Step")))
    (dangling,) = [d for d in refusal(path).diagnostics if d.code == codes.DANGLING.id]
    assert "/T/Pump/B/Step" in dangling.help


def test_every_path_of_the_input_is_a_node(tmp_path):
    tree = read_tree([str(write(tmp_path, package("T", PUMP)))], Findings())
    assert [node.path for node in tree.nodes()] == ["/T", "/T/Pump", "/T/Pump/B", "/T/Pump/B/Tick", "/T/Pump/B/Step"]


def test_an_empty_directory_is_an_error(tmp_path):
    failure = refusal(tmp_path)
    assert [d.code for d in failure.diagnostics] == [codes.NO_INPUT.id]
    assert failure.exit is Exit.FINDINGS


def test_nothing_named_is_an_error():
    assert [d.code for d in refusal().diagnostics] == [codes.NO_INPUT.id]


def test_a_missing_file_is_an_error(tmp_path):
    assert [d.code for d in refusal(tmp_path / "none.arxml").diagnostics] == [CANNOT_READ.id]


def test_every_unusable_file_is_reported(tmp_path):
    good = write(tmp_path, package("T", PUMP), name="good.arxml")
    broken = tmp_path / "broken.arxml"
    broken.write_text("<AUTOSAR>")
    other = tmp_path / "other.arxml"
    other.write_text("<html/>")
    reported = {(d.at.file, d.code) for d in refusal(good, broken, other).diagnostics}
    assert reported == {(str(broken), BROKEN_XML.id), (str(other), codes.NOT_ARXML.id)}


def test_a_directory_of_unusable_files_is_an_error(tmp_path):
    (tmp_path / "other.arxml").write_text("<html/>")
    assert {d.code for d in refusal(tmp_path).diagnostics} == {codes.SKIPPED_FILE.id, codes.NO_INPUT.id}


def test_files_are_named_as_the_user_named_them(tmp_path, monkeypatch):
    (tmp_path / "in").mkdir()
    write(tmp_path / "in", package("T", PUMP), name="pump.arxml")
    monkeypatch.chdir(tmp_path)
    imported = read("in")
    assert [task.origin.file for task in imported.model.tasks] == ["in/pump.arxml"]
