"""Shorthands for tests of the ARXML importer: short calls that write the long XML, and imports of it."""

from pathlib import Path

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.options import ArxmlImportOptions

FIXTURES = Path(__file__).parent / "arxml_fixtures"
NAMESPACE = "http://autosar.org/schema/r4.0"


class Overlay:
    """Stands in for an overlay in use: what it drops and which sources it gives a period."""

    names_units = False

    def __init__(self, sources, drop):
        self.sources = sources
        self.drop = drop

    def drops(self, name):
        return name in self.drop

    def source_period(self, name):
        return Duration.parse(self.sources[name]) if name in self.sources else None

    def task_wcet(self, name, *, is_known):
        return None

    def work_wcet(self, name):
        return None

    def states_interrupt(self, name):
        return False

    def task_period(self, name):
        return None


def read(*paths, sources=None, drop=(), **options):
    """Import files and directories."""
    overlay = Overlay(sources or {}, drop) if sources or drop else None
    options = ArxmlImportOptions(overlay=overlay, **options)
    return FORMAT.read([str(path) for path in paths], options)


def refusal(*paths, **options):
    """Return the exception of an import that fails."""
    try:
        read(*paths, **options)
    except HalpipeError as failure:
        return failure
    raise AssertionError("the import succeeded")


def found(imported, code):
    """Return the diagnostics of one code."""
    return [diagnostic for diagnostic in imported.diagnostics if diagnostic.code == code.id]


def orders(imported):
    """Return every precedence as "first > second"."""
    return {f"{p.task} > {task.name}" for task in imported.model.tasks for p in task.versions[0].precedences}


def periods(imported):
    """Return the period of every task as text."""
    return {task.name: str(task.period) for task in imported.model.tasks}


# -------------------------------------------------------------------------------------------- writing ARXML


def el(tag, *content, **attributes):
    """An element; attribute names are upper-cased."""
    stated = "".join(f' {name.upper()}="{value}"' for name, value in attributes.items())
    return f"<{tag}{stated}>" + "\n".join(content) + f"</{tag}>"


def named(tag, name, *content):
    return el(tag, el("SHORT-NAME", name), *content)


def ref(tag, path, dest=""):
    return el(tag, path, dest=dest) if dest else el(tag, path)


def write(directory, *packages, name="system.arxml"):
    """Write packages as a file and return its path."""
    path = directory / name
    path.write_text(document(*packages))
    return path


def package(name, *elements):
    return named("AR-PACKAGE", name, el("ELEMENTS", *elements))


def document(*packages):
    return f'<AUTOSAR xmlns="{NAMESPACE}">{el("AR-PACKAGES", *packages)}</AUTOSAR>'


def component(name, *events, runnables="", ports=(), extra=()):
    """A component type ``/T/name`` with behaviour ``B``; runnables by name, or as elements."""
    entities = [r if r.startswith("<") else named("RUNNABLE-ENTITY", r) for r in _split(runnables)]
    behavior = named("SWC-INTERNAL-BEHAVIOR", "B", el("EVENTS", *events), el("RUNNABLES", *entities))
    return named("APPLICATION-SW-COMPONENT-TYPE", name, el("PORTS", *ports), el("INTERNAL-BEHAVIORS", behavior), *extra)


def module(name, *events, entities=""):
    """A BSW module ``/T/name`` with behaviour ``B``."""
    inner = [named("BSW-SCHEDULABLE-ENTITY", entity) for entity in entities.split()]
    behavior = named("BSW-INTERNAL-BEHAVIOR", "B", el("ENTITYS", *inner), el("EVENTS", *events))
    return named("BSW-MODULE-DESCRIPTION", name, el("INTERNAL-BEHAVIORS", behavior))


def _split(runnables):
    return runnables.split() if isinstance(runnables, str) else runnables


def event(kind, name, runnable, *content):
    """An event that starts ``Type/Runnable``."""
    owner, entity = runnable.split("/")
    tag = "STARTS-ON-EVENT-REF" if kind.startswith("BSW-") else "START-ON-EVENT-REF"
    return named(kind, name, ref(tag, f"/T/{owner}/B/{entity}"), *content)


def every(period, name, runnable, *content):
    """A timing event; the period in seconds as text."""
    return event("TIMING-EVENT", name, runnable, *content, el("PERIOD", period))


def disabled(*modes):
    refs = [el("DISABLED-MODE-IREF", ref("TARGET-MODE-DECLARATION-REF", f"/T/{mode}")) for mode in modes]
    return el("DISABLED-MODE-IREFS", *refs)


def mode_group(name, modes, *transitions):
    """A mode group; transitions as "from to"."""
    declared = [named("MODE-DECLARATION", mode) for mode in modes.split()]
    moves = [
        named(
            "MODE-TRANSITION",
            f"t{index}",
            ref("ENTERED-MODE-REF", f"/T/{name}/{move.split()[1]}"),
            ref("EXITED-MODE-REF", f"/T/{name}/{move.split()[0]}"),
        )
        for index, move in enumerate(transitions)
    ]
    initial = ref("INITIAL-MODE-REF", f"/T/{name}/{modes.split()[-1]}")
    return named(
        "MODE-DECLARATION-GROUP", name, initial, el("MODE-DECLARATIONS", *declared), el("MODE-TRANSITIONS", *moves)
    )


def accesses(wrapper, *items):
    """A list of variable accesses, each "Type/port"."""
    inner = [
        named(
            "VARIABLE-ACCESS",
            f"{wrapper}{index}",
            el(
                "ACCESSED-VARIABLE",
                el(
                    "AUTOSAR-VARIABLE-IREF",
                    ref("PORT-PROTOTYPE-REF", f"/T/{item}"),
                    ref("TARGET-DATA-PROTOTYPE-REF", "/T/If/value"),
                ),
            ),
        )
        for index, item in enumerate(items)
    ]
    return el(wrapper, *inner)


def runnable(name, writes=(), reads=()):
    content = [accesses("DATA-WRITE-ACCESSS", *writes)] if writes else []
    content += [accesses("DATA-READ-ACCESSS", *reads)] if reads else []
    return named("RUNNABLE-ENTITY", name, *content)


def on_data(name, runnable_path, port):
    data = el("DATA-IREF", ref("CONTEXT-R-PORT-REF", f"/T/{port}"), ref("TARGET-DATA-ELEMENT-REF", "/T/If/value"))
    return event("DATA-RECEIVED-EVENT", name, runnable_path, data)


def out_port(name):
    return named("P-PORT-PROTOTYPE", name)


def in_port(name):
    return named("R-PORT-PROTOTYPE", name)


def composition(name, prototypes, *connectors, extra=(), ports=()):
    """A composition ``/T/name``; prototypes as "name:Type name:Type"."""
    inner = [
        named("SW-COMPONENT-PROTOTYPE", prototype, ref("TYPE-TREF", f"/T/{type}"))
        for prototype, type in (pair.split(":") for pair in prototypes.split())
    ]
    return named(
        "COMPOSITION-SW-COMPONENT-TYPE",
        name,
        el("PORTS", *ports),
        el("COMPONENTS", *inner),
        el("CONNECTORS", *connectors),
        *extra,
    )


def assembly(name, source, target):
    """A connector; ends as "Composition/prototype Type/port"."""
    return named("ASSEMBLY-SW-CONNECTOR", name, _end("PROVIDER-IREF", "P", source), _end("REQUESTER-IREF", "R", target))


def delegation(name, kind, inner, outer):
    """A delegation connector for a ``P`` or ``R`` port; ends as for `assembly`, the outer one as "Composition/port"."""
    inside = el("INNER-PORT-IREF", _end(f"{kind}-PORT-IN-COMPOSITION-INSTANCE-REF", kind, inner))
    return named("DELEGATION-SW-CONNECTOR", name, inside, ref("OUTER-PORT-REF", f"/T/{outer}"))


def _end(tag, kind, end):
    prototype, port = end.split()
    return el(tag, ref("CONTEXT-COMPONENT-REF", f"/T/{prototype}"), ref(f"TARGET-{kind}-PORT-REF", f"/T/{port}"))


def order(name, *steps):
    """An execution order constraint; steps as "Type/Runnable Type/Runnable", paths of events with three parts."""
    elements = {}
    for step in steps:
        first, second = step.split()
        elements.setdefault(first, []).append(second)
        elements.setdefault(second, [])
    names = {path: f"e{index}" for index, path in enumerate(elements)}
    content = [
        named(
            "EOC-EXECUTABLE-ENTITY-REF",
            names[path],
            ref("EXECUTABLE-REF", "/T/{}/B/{}".format(*path.split("/"))),
            el("SUCCESSOR-REFS", *[ref("SUCCESSOR-REF", f"/Orders/T/{name}/{names[n]}") for n in successors]),
        )
        for path, successors in elements.items()
    ]
    return named("EXECUTION-ORDER-CONSTRAINT", name, el("ORDERED-ELEMENTS", *content))


def timing(*constraints):
    return package("Orders", named("SWC-TIMING", "T", el("TIMING-REQUIREMENTS", *constraints)))


# ------------------------------------------------------------------------------------------ ECU configuration


def container(kind, name, *content, params=None, refs=(), prefix="/Vendor/X"):
    """A configuration container of definition `kind`; references as (name, target) pairs."""
    definition = ref("DEFINITION-REF", f"{prefix}/{kind}")
    values = [
        el("ECUC-NUMERICAL-PARAM-VALUE", ref("DEFINITION-REF", f"{prefix}/{kind}/{key}"), el("VALUE", value))
        for key, value in (params or {}).items()
    ]
    targets = [
        el("ECUC-REFERENCE-VALUE", ref("DEFINITION-REF", f"{prefix}/{kind}/{key}"), ref("VALUE-REF", path))
        for key, path in refs
    ]
    return named(
        "ECUC-CONTAINER-VALUE",
        name,
        definition,
        el("PARAMETER-VALUES", *values),
        el("REFERENCE-VALUES", *targets),
        el("SUB-CONTAINERS", *content),
    )


def configuration(name, *containers, prefix="/Vendor/X"):
    """A module configuration ``/E/name``."""
    definition = ref("DEFINITION-REF", f"{prefix}/{name}")
    return named("ECUC-MODULE-CONFIGURATION-VALUES", name, definition, el("CONTAINERS", *containers))


def os_task(name, **params):
    return container("Os/OsTask", name, params=params)


def counter(seconds_per_tick="0.001", name="Ticks"):
    return container("Os/OsCounter", name, params={"OsSecondsPerTick": seconds_per_tick})


def alarm(name, cycle, *, start="0", activates="", sets=""):
    """An alarm that activates an OsTask or sets an OsEvent."""
    kind = "Os/OsAlarm/OsAlarmAction"
    action = []
    if activates:
        refs = [("OsAlarmActivateTaskRef", f"/E/Os/{activates}")]
        action.append(container(f"{kind}/OsAlarmActivateTask", "a", refs=refs))
    if sets:
        action.append(container(f"{kind}/OsAlarmSetEvent", "a", refs=[("OsAlarmSetEventRef", f"/E/Os/{sets}")]))
    cycling = container(
        "Os/OsAlarm/OsAlarmAutostart", "s", params={"OsAlarmCycleTime": cycle, "OsAlarmAlarmTime": start}
    )
    return container(
        "Os/OsAlarm", name, cycling, container(kind, "act", *action), refs=[("OsAlarmCounterRef", "/E/Os/Ticks")]
    )


def schedule_table(name, duration, points, repeating="true"):
    """A schedule table; points as (name, offset, activated OsTask)."""
    kind = "Os/OsScheduleTable/OsScheduleTableExpiryPoint"
    inner = [
        container(
            kind,
            point,
            container(
                f"{kind}/OsScheduleTableTaskActivation",
                "act",
                refs=[("OsScheduleTableActivateTaskRef", f"/E/Os/{task}")],
            ),
            params={"OsScheduleTblExpPointOffset": offset},
        )
        for point, offset, task in points
    ]
    return container(
        "Os/OsScheduleTable",
        name,
        *inner,
        params={"OsScheduleTableDuration": duration, "OsScheduleTableRepeating": repeating},
        refs=[("OsScheduleTableCounterRef", "/E/Os/Ticks")],
    )


def mapped(event_path, task, position="", *, offset="", bsw=False, more=()):
    """The mapping of the event ``/T/event_path`` to an OsTask."""
    infix = "Bsw" if bsw else ""
    parent = "RteBswModuleInstance" if bsw else "RteSwComponentInstance"
    params = {f"Rte{infix}PositionInTask": position} if position else {}
    params |= {f"Rte{infix}ActivationOffset": offset} if offset else {}
    return container(
        f"Rte/{parent}/Rte{infix}EventToTaskMapping",
        event_path.replace("/", "_"),
        params=params,
        refs=[(f"Rte{infix}EventRef", f"/T/{event_path}"), (f"Rte{infix}MappedToTaskRef", f"/E/Os/{task}"), *more],
    )


def rte(*mappings, prototype=""):
    refs = [("RteSoftwareComponentInstanceRef", f"/T/{prototype}")] if prototype else []
    name = prototype.replace("/", "_") or "instance"
    return container("Rte/RteSwComponentInstance", name, *mappings, refs=refs)


def core(name, number):
    return container("EcuC/EcucHardware/EcucCoreDefinition", name, params={"EcucCoreId": number})


# ------------------------------------------------------------------------------------------- timing extension


def cse(tag, factor, code=0):
    """A time of the timing extension; code 0 counts microseconds."""
    return el(tag, el("CSE-CODE", str(code)), el("CSE-CODE-FACTOR", str(factor)))


def observed(name, runnable_path, what, prototype=""):
    """A timing description event of ``Type/Runnable``: ACTIVATED, STARTED or TERMINATED."""
    where = el("COMPONENT-IREF", ref("TARGET-COMPONENT-REF", f"/T/{prototype}")) if prototype else ""
    owner, entity = runnable_path.split("/")
    return named(
        "TD-EVENT-SWC-INTERNAL-BEHAVIOR",
        name,
        where,
        ref("RUNNABLE-REF", f"/T/{owner}/B/{entity}"),
        el("TD-EVENT-SWC-INTERNAL-BEHAVIOR-TYPE", f"RUNNABLE-ENTITY-{what}"),
    )


def data_observed(name, port, what):
    """A timing description event of the data at ``Type/port``: SENT or RECEIVED."""
    return named(
        "TD-EVENT-VARIABLE-DATA-PROTOTYPE",
        name,
        ref("DATA-ELEMENT-REF", "/T/If/value"),
        ref("PORT-REF", f"/T/{port}"),
        el("TD-EVENT-VARIABLE-DATA-PROTOTYPE-TYPE", f"VARIABLE-DATA-PROTOTYPE-{what}"),
    )


def event_chain(name, stimulus, response, *segments):
    inner = [ref("SEGMENT-REF", f"/Timing/X/{segment}") for segment in segments]
    return named(
        "TIMING-DESCRIPTION-EVENT-CHAIN",
        name,
        ref("STIMULUS-REF", f"/Timing/X/{stimulus}"),
        ref("RESPONSE-REF", f"/Timing/X/{response}"),
        el("SEGMENT-REFS", *inner),
    )


def latency(name, chain, maximum, kind="REACTION"):
    """A latency constraint; the maximum in microseconds."""
    scope = ref("SCOPE-REF", f"/Timing/X/{chain}")
    return named("LATENCY-TIMING-CONSTRAINT", name, el("LATENCY-CONSTRAINT-TYPE", kind), scope, cse("MAXIMUM", maximum))


def triggering(kind, name, event, *content):
    return named(f"{kind}-EVENT-TRIGGERING", name, ref("EVENT-REF", f"/Timing/X/{event}"), *content)


def extension(descriptions, *requirements, guarantees=()):
    """A package ``/Timing`` with the timing extension ``X``."""
    return package(
        "Timing",
        named(
            "SYSTEM-TIMING",
            "X",
            el("TIMING-DESCRIPTIONS", *descriptions),
            el("TIMING-GUARANTEES", *guarantees),
            el("TIMING-REQUIREMENTS", *requirements),
        ),
    )


def execution_time(kind, name, runnable_path, value, factor, hardware="", code=0):
    owner, entity = runnable_path.split("/")
    on = ref("HW-ELEMENT-REF", f"/T/{hardware}") if hardware else ""
    return named(
        f"{kind}-EXECUTION-TIME",
        name,
        ref("EXECUTABLE-ENTITY-REF", f"/T/{owner}/B/{entity}"),
        on,
        cse(value, factor, code),
    )


def implementation(*times):
    return named("SWC-IMPLEMENTATION", "Impl", named("RESOURCE-CONSUMPTION", "Used", el("EXECUTION-TIMES", *times)))


def hardware(*names, **holders):
    """Processing units ``/T/name``, and elements in which others are nested: ``Cluster="Big Little"``."""
    category = el("HW-CATEGORY-REFS", ref("HW-CATEGORY-REF", "/T/ProcessingUnit"))
    units = [named("HW-CATEGORY", "ProcessingUnit"), *(named("HW-ELEMENT", name, category) for name in names)]
    for holder, nested in holders.items():
        inner = (el("HW-ELEMENT-REF-CONDITIONAL", ref("HW-ELEMENT-REF", f"/T/{each}")) for each in nested.split())
        units.append(named("HW-ELEMENT", holder, el("NESTED-ELEMENTS", *inner)))
    return "".join(units)
