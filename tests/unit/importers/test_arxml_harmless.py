"""The list of kinds that cannot decide timing: each is put in, changed, and the model stays; all others are told."""

import pytest
from arxml_case import (
    alarm,
    component,
    configuration,
    container,
    core,
    counter,
    el,
    every,
    found,
    mapped,
    named,
    os_task,
    package,
    read,
    refusal,
    rte,
    write,
)

from halpipe.core.diagnostics import Exit
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.coverage import _REASONS, reason_of
from halpipe.importers.arxml.files.slim import tags_to_drop
from halpipe.importers.arxml.files.words import NS

OF_ECUC = [
    "EcuCGeneral",
    "BswInitialization",
    "InitFunction",
    "Pdu*",
    "PostbuildLoadable",
    "VectorCommonData",
    "CommonPublishedInformation",
]
OF_OS = ["ALL", "AUTO", "Automatic", "FALSE", "Standard", "TRUE"]


def module_of(kind):
    """The module that a kind of container belongs to, empty for elements of the system."""
    if kind in OF_OS or kind.startswith(("Os", "Arc")):
        return "Os"
    if kind.startswith("Rte"):
        return "Rte"
    return "EcuC" if kind in OF_ECUC or kind.startswith("Ecuc") else ""


def project(folder, *elements, os=(), rtes=(), ecuc=(), inside=""):
    """A pump on one of two cores, with something more."""
    step = named("RUNNABLE-ENTITY", "Step", inside)
    pump = component("Pump", every("0.01", "Tick", "Pump/Step"), runnables=[step])
    parts = [
        configuration("Os", counter(), os_task("Main"), os_task("Lone"), alarm("Al", "20", activates="Lone"), *os),
        configuration("Rte", rte(mapped("Pump/B/Tick", "Main", "1")), *rtes),
        configuration("EcuC", core("First", "0"), core("Second", "1"), *ecuc),
    ]
    folder.mkdir(exist_ok=True)
    return write(folder, package("T", pump, *elements), package("E", *parts))


def with_one(folder, kind, name, content):
    """The project with one element of a kind."""
    module = module_of(kind)
    kind = kind.replace("*", "X")
    if not module:
        return project(folder, named(kind, name, content))
    more = container(f"{module}/{kind}", name, params={"OsPriority": "7"} if content else {})
    return project(folder, **{{"Os": "os", "Rte": "rtes", "EcuC": "ecuc"}[module]: (more,)})


def shape(imported):
    """The model without the lines of its origins."""
    return [
        (t.name, t.period, t.offset, t.deadline, [(v.wcet, v.units, v.accesses, v.split) for v in t.versions])
        for t in imported.model.tasks
    ], [unit.name for unit in imported.model.units]


@pytest.mark.parametrize("kind", [kind for known in _REASONS.values() for kind in known.split()])
def test_a_harmless_kind_changes_nothing_and_is_not_told(tmp_path, kind):
    plain = read(project(tmp_path / "plain"))
    for name, content in (("One", ""), ("Other", el("PERIOD", "0.001"))):
        imported = read(with_one(tmp_path / name, kind, name, content))
        assert shape(imported) == shape(plain)
        assert found(imported, codes.UNUSED_KIND) == []


TELLING = {
    "a kind that nobody knows": {"elements": [named("FANCY-CONSTRAINT", "C")]},
    "logical execution time of the system": {"elements": [named("TD-EVENT-SLLET-PORT", "L")]},
    "a runnable that waits": {"inside": named("WAIT-POINT", "W")},
    "a server that runs elsewhere": {"inside": named("ASYNCHRONOUS-SERVER-CALL-POINT", "S")},
    "a runnable that triggers others": {"inside": named("INTERNAL-TRIGGERING-POINT", "I")},
    "a spinlock": {"os": [container("Os/OsSpinlock", "Spin")]},
    "a table that is synchronised": {"os": [container("Os/OsScheduleTable/OsScheduleTableSync", "Sync")]},
    "a timing protection": {"os": [container("Os/OsTask/OsTaskTimingProtection", "P")]},
    "cores that wait for each other": {"os": [container("Os/OsBarrier", "B")]},
    "a container without a definition": {"os": [named("ECUC-CONTAINER-VALUE", "C")]},
    "a point that synchronises calls": {"rtes": [container("Rte/RteOsInteraction/RteSyncPoint", "P")]},
}


@pytest.mark.parametrize("more", TELLING.values(), ids=TELLING)
def test_what_may_decide_timing_is_told(tmp_path, more):
    path = project(tmp_path / "p", *more.get("elements", ()), **{k: v for k, v in more.items() if k != "elements"})
    (told,) = found(read(path), codes.UNUSED_KIND)
    assert told.code == "HAL0536"
    assert told.help
    assert told.at.line
    assert "1  are" not in told.message
    assert refusal(path, strict=True).exit is Exit.UNSUPPORTED


def test_what_large_inputs_leave_out_is_harmless():
    """Groups of elements, which have no name, go by what stands in them."""
    groups = {"ANNOTATIONS", "DESC", "INTRODUCTION", "LONG-NAME", "ADMIN-DATA", "INIT-VALUE", "OPERATION-IREF"}
    groups |= {"SW-DATA-DEF-PROPS", "PORT-API-OPTIONS", "ECUC-NUMERICAL-PARAM-VALUE", "ECUC-TEXTUAL-PARAM-VALUE"}
    groups |= {"HEAP-USAGES", "STACK-USAGES", "INCLUDED-DATA-TYPE-SETS", "PROVIDED-ENTRYS", "FIBEX-ELEMENTS"}
    groups |= {"PROVIDED-COM-SPECS", "REQUIRED-COM-SPECS"}
    single = {"COMM-CONTROLLERS": "CAN-COMMUNICATION-CONTROLLER", "SERVICE-DEPENDENCYS": "SWC-SERVICE-DEPENDENCY"}
    single |= {"BSW-MODULE-DEPENDENCYS": "BSW-MODULE-DEPENDENCY", "MODE-ACCESS-POINTS": "MODE-ACCESS-POINT"}
    variables = ("EXPLICIT-INTER-RUNNABLE-VARIABLES", "IMPLICIT-INTER-RUNNABLE-VARIABLES", "STATIC-MEMORYS")
    variables = (*variables, "AR-TYPED-PER-INSTANCE-MEMORYS")
    single |= dict.fromkeys(variables, "VARIABLE-DATA-PROTOTYPE")
    single |= {"PER-INSTANCE-MEMORYS": "PER-INSTANCE-MEMORY", "MEMORY-SECTIONS": "MEMORY-SECTION"}
    single |= dict.fromkeys(("PER-INSTANCE-PARAMETERS", "SHARED-PARAMETERS"), "PARAMETER-DATA-PROTOTYPE")
    single |= {"PARAMETER-ACCESSS": "PARAMETER-ACCESS"}
    tags = {tag.removeprefix(NS) for tag in tags_to_drop()} - groups
    assert [tag for tag in sorted(tags) if not reason_of(single.get(tag, tag))] == []
