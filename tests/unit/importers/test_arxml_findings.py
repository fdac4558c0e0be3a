"""Every diagnostic of the ARXML importer has a small input that triggers it at the line marked HERE."""

from pathlib import Path
from types import SimpleNamespace

import pytest
from arxml_case import FIXTURES, read, refusal

from halpipe.core.diagnostics import Code, Findings, HalpipeError, Severity
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.build import check_tasks

CASES = sorted((FIXTURES / "findings").iterdir())
WITHOUT_FIXTURE = {
    codes.NO_INPUT.id,  # an empty directory
    # an option, an overlay or an export comes into it: test_arxml_ecus, _variants, _onto, _meaning and _embedded
    *(f"HAL{number:04}" for first, last in ((515, 519), (533, 536), (575, 592)) for number in range(first, last + 1)),
    codes.SEVERAL_RATES_OF_TASK.id,
    *(code.id for code in (codes.SYNCHRONISED, codes.OTHER_START, codes.MAPS_NOTHING)),  # test_arxml_joint
    *(codes.SECOND_MAPPING.id, codes.BLUEPRINT.id),  # test_arxml_meaning
    codes.WHOLE_JOB.id,  # test_arxml_inner
    codes.ONE_VARIANT.id,  # test_arxml_variants
    codes.OTHER_COPY.id,  # test_arxml_xdm
    codes.OLD_TIMES.id,  # test_arxml_releases
}


def diagnose(path):
    try:
        return read(path).diagnostics
    except HalpipeError as failure:
        return failure.diagnostics


def marked_place(case):
    """Return the (file, line) marked HERE, None if none is."""
    for path in sorted(case.iterdir()) if case.is_dir() else [case]:
        for number, line in enumerate(path.read_text().splitlines(), 1):
            if "HERE" in line:
                return str(path), number
    return None


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_it_reports_the_code_at_the_line(case):
    code = case.name.split("-")[0]
    reported = [diagnostic for diagnostic in diagnose(case) if diagnostic.code == code]
    assert reported
    place = marked_place(case)
    if place is not None:
        assert place in {(diagnostic.at.file, diagnostic.at.line) for diagnostic in reported}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_errors_and_warnings_name_file_and_what_to_do(case):
    for diagnostic in diagnose(case):
        assert Path(diagnostic.at.file).exists()
        if diagnostic.severity is not Severity.NOTE:
            assert diagnostic.help


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_strict_turns_warnings_into_errors_and_lets_notes_pass(case):
    lossy = any(diagnostic.severity is not Severity.NOTE for diagnostic in diagnose(case))
    if not lossy:
        read(case, strict=True)
        return
    severities = {diagnostic.severity for diagnostic in refusal(case, strict=True).diagnostics}
    assert Severity.ERROR in severities
    assert Severity.WARNING not in severities


def test_every_code_has_a_fixture():
    declared = {value.id for value in vars(codes).values() if isinstance(value, Code)}
    shown = {case.name.split("-")[0] for case in CASES}
    assert declared - WITHOUT_FIXTURE <= shown
    assert not declared & WITHOUT_FIXTURE & shown


@pytest.mark.parametrize(
    ("counts", "held", "advice"),
    [
        ({}, "nothing that runs", "add the files with component types and their events, or the ECU configuration"),
        ({"events": 2}, "2 events", "add the ECU configuration of Os and Rte that triggers the events"),
        ({"tasks": 3, "mappings": 1}, "3 OS tasks, 1 event mappings", "add the files with component types"),
        ({"events": 2, "tasks": 3}, "2 events, 3 OS tasks", "add the files with component types and their events, or"),
        ({"limits": 1, "arrivals": 2, "orders": 4}, "7 timing constraints", "add the files with component types"),
        ({"components": 5}, "5 component types", "add the files with component types"),
    ],
)
def test_input_without_a_task_is_told_from_what_it_holds(counts, held, advice):
    """And from what is missing: the configuration of the OS beside events, the events beside tasks."""
    of = {name: range(counts.get(name, 0)) for name in ("components", "events", "tasks", "mappings", "limits")}
    of |= {name: range(counts.get(name, 0)) for name in ("arrivals", "orders")}
    system = SimpleNamespace(
        components=of["components"],
        events=of["events"],
        orders=of["orders"],
        configuration=SimpleNamespace(tasks=of["tasks"], mappings=of["mappings"]),
        timing=SimpleNamespace(limits=of["limits"], arrivals=of["arrivals"]),
    )
    with pytest.raises(HalpipeError) as refused:
        check_tasks(system, [], ["a.arxml"], Findings())
    (found,) = refused.value.diagnostics
    assert found.message == f"no periodic task in the input, which holds {held}"
    assert found.help.startswith(advice)
    check_tasks(system, [object()], ["a.arxml"], Findings())
