"""Files to `System`: the part of the import that reads XML, with the manifests of the Adaptive Platform.

Adaptive elements moved between releases; every form is read: function groups in a MACHINE (00043 to 00048) or a set of
their own (from 00049), mode-dependent (to 00046) or state-dependent startup configurations (from 00047)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.sniff import load
from halpipe.importers.arxml.files.tree import Node, Tree
from halpipe.importers.arxml.files.words import parse_number
from halpipe.importers.arxml.system.components import (
    is_component_type,
    place_of,
    read_components,
    read_compositions,
    read_ecus,
    read_hardware,
    read_holders,
    read_mode_groups,
    read_twins,
)
from halpipe.importers.arxml.system.containers import standard_modules
from halpipe.importers.arxml.system.ecuc import read_configuration
from halpipe.importers.arxml.system.instances import find_instances, keep_own, report_absent, select_ecu
from halpipe.importers.arxml.system.timing import read_execution_times, read_orders, read_timing
from halpipe.importers.arxml.system.values import Component, Configuration, Machine, ModeGroup, Place, Process, System

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from halpipe.importers.arxml.files.variants import Choice

_ADAPTIVE = """
ADAPTIVE-APPLICATION-SW-COMPONENT-TYPE EXECUTABLE FUNCTION-GROUP-SET MACHINE MACHINE-DESIGN PROCESS
PROCESS-TO-MACHINE-MAPPING-SET SOFTWARE-CLUSTER STARTUP-CONFIG STARTUP-CONFIG-SET
"""
ADAPTIVE = tuple(_ADAPTIVE.split())
_GROUP = "MODE-DECLARATION-GROUP-PROTOTYPE"
_STARTUPS = (
    "STATE-DEPENDENT-STARTUP-CONFIGS/STATE-DEPENDENT-STARTUP-CONFIG",
    "MODE-DEPENDENT-STARTUP-CONFIGS/MODE-DEPENDENT-STARTUP-CONFIG",
)
_STATES = (
    "FUNCTION-GROUP-STATE-IREFS/FUNCTION-GROUP-STATE-IREF",
    "FUNCTION-GROUP-IREFS/FUNCTION-GROUP-IREF",
    "FUNCTION-GROUP-MODE-IREFS/FUNCTION-GROUP-MODE-IREF",
    "MACHINE-MODE-IREFS/MACHINE-MODE-IREF",
)


def read_machines(tree: Tree) -> tuple[Machine, ...]:
    """Read every machine with the cores of its processors."""
    return tuple(
        Machine(
            place=place_of(node),
            cores=tuple(place_of(core) for cpu in node.inside("PROCESSOR") for core in cpu.inside("PROCESSOR-CORE")),
        )
        for node in tree.tagged("MACHINE")
    )


def read_function_groups(tree: Tree) -> tuple[ModeGroup, ...]:
    """Read every function group as a mode group of its own, since several may share their states' declarations."""
    types = {group.place.path: group for group in read_mode_groups(tree)}
    found = []
    for node in tree.tagged(_GROUP):
        owner = node.parent
        if owner is None or owner.tag not in ("FUNCTION-GROUP-SET", "MACHINE"):
            continue
        type = tree.target(node, "TYPE-TREF", ("MODE-DECLARATION-GROUP",))
        if type is not None and type.path in types:
            found.append(_instance(node, types[type.path]))
    return tuple(found)


def _instance(node: Node, type: ModeGroup) -> ModeGroup:
    def state(path: str) -> str:
        return f"{node.path}/{path.rpartition('/')[2]}"

    return ModeGroup(
        place=place_of(node),
        modes=tuple(Place(state(mode.path), "MODE-DECLARATION", mode.at) for mode in type.modes),
        transitions=tuple((place, state(exited), state(entered)) for place, exited, entered in type.transitions),
        parts=(type.place, *type.modes),
    )


def read_processes(tree: Tree, machines: tuple[Machine, ...], groups: tuple[ModeGroup, ...]) -> tuple[Process, ...]:
    """Read every process with the states in which it runs and the cores that it may use."""
    mappings = tree.tagged("PROCESS-TO-MACHINE-MAPPING")
    mapped = {tree.path_at(node, "PROCESS-REF", ("PROCESS",)): node for node in mappings}
    return tuple(_process(tree, node, mapped.get(node.path), machines, groups) for node in tree.tagged("PROCESS"))


def _process(
    tree: Tree, node: Node, mapping: Node | None, machines: tuple[Machine, ...], groups: tuple[ModeGroup, ...]
) -> Process:
    states = tuple(dict.fromkeys(_states(tree, node)))
    own = [group for group in groups if any(mode.path in states for mode in group.modes)]
    client = tree.target(node, "DETERMINISTIC-CLIENT-REF", ("DETERMINISTIC-CLIENT",))
    workers = tree.text(client, "NUMBER-OF-WORKERS") if client else None
    count = parse_number(workers.text) if workers else None
    machine, cores = _allowed(tree, mapping, machines) if mapping else (None, ())
    return Process(
        place=place_of(node),
        disabled_in=tuple(mode.path for group in own for mode in group.modes if mode.path not in states),
        machine=machine,
        cores=cores,
        cycle=tree.text(client, "CYCLE-TIME-VALUE") if client else None,
        workers=int(count) if count and count.denominator == 1 else 1,
        parts=tuple(place_of(part) for part in (mapping, client) if part is not None),
    )


def _states(tree: Tree, node: Node) -> Iterator[str]:
    """Yield the states of function groups in which a process runs, as paths below the function group."""
    what = f'PROCESS "{node.path}"'
    for startup in _STARTUPS:
        for state in _STATES:
            for element, file in node.elements(f"{startup}/{state}"):
                contexts, mode = tree.instance(node, element, file)
                found = tree.find(mode, what, ("MODE-DECLARATION",)) if mode else None
                if contexts and tree.find(contexts[0], what, (_GROUP,)) and found is not None:
                    yield f"{contexts[0].path}/{found.name}"


def _allowed(tree: Tree, mapping: Node, machines: tuple[Machine, ...]) -> tuple[str | None, tuple[str, ...]]:
    """Return the machine (path) of a mapping, and which of its cores the process may use."""
    target = tree.target(mapping, "MACHINE-REF", ("MACHINE",))
    machine = next((m for m in machines if target is not None and m.place.path == target.path), None)
    if machine is None:
        return None, ()
    allowed, forbidden = (
        [node.path for node in tree.targets(mapping, path, ("PROCESSOR-CORE",))]
        for path in ("SHALL-RUN-ON-REFS/SHALL-RUN-ON-REF", "SHALL-NOT-RUN-ON-REFS/SHALL-NOT-RUN-ON-REF")
    )
    cores = [core.path for core in machine.cores]
    left = tuple(core for core in cores if (not allowed or core in allowed) and core not in forbidden)
    if cores and not left:
        message = "leaves the process no core; all of its machine are assumed"
        help = "correct SHALL-RUN-ON-REFS and SHALL-NOT-RUN-ON-REFS, or state the units in the overlay"
        mapping.report(tree.findings, codes.NO_CORE, message, help=help)
    return machine.place.path, left or tuple(cores)


_CLASSIC = ("COMPOSITION-SW-COMPONENT-TYPE", "ECUC-MODULE-CONFIGURATION-VALUES", "ECU-INSTANCE")


def read_tree(
    paths: Sequence[str],
    findings: Findings,
    choice: Choice | None = None,
    *,
    marks: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> Tree:
    """Parse and merge all files, of one variant if one is chosen, with the `marks` of tools if those are wanted.

    Raise `HalpipeError` if nothing in them could be a task.
    """
    tree = Tree(load(paths, findings, marks=marks, on_progress=on_progress), findings, choice)
    _check_platform(tree)
    return tree


def read_system(tree: Tree, ecu: str = "") -> System:
    """Read everything that influences timing out of the merged elements, for one ECU if there are several.

    Raise `HalpipeError` if there are several, and `ecu` names none of them.
    """
    components = read_components(tree)
    compositions = read_compositions(tree)
    ecus = read_ecus(tree)
    selection = select_ecu(tree, ecus, ecu)
    configuration = read_configuration(tree, selection.modules)
    mapped, is_one = configuration.instances, selection.ecu is None
    instances, copies, configured = find_instances(tree, components, compositions, mapped, is_one=is_one)
    machines, groups = read_machines(tree), read_function_groups(tree)
    report_absent(tree)
    _report_unmapped(tree, configuration, components)
    system = System(
        place=_place(tree),
        components=components,
        compositions=compositions,
        instances=instances,
        copies=copies,
        configured=configured,
        configuration=configuration,
        mode_groups=(*read_mode_groups(tree), *groups),
        orders=read_orders(tree),
        twins=read_twins(tree),
        execution_times=read_execution_times(tree),
        ecus=() if selection.is_whole else ecus,
        hardware=read_hardware(tree),
        holders=read_holders(tree),
        timing=read_timing(tree),
        machines=machines,
        processes=read_processes(tree, machines, groups),
    )
    return system if selection.ecu is None else keep_own(tree, system, selection.ecu)


def _report_unmapped(tree: Tree, configuration: Configuration, components: Sequence[Component]) -> None:
    """Report a configuration of the Rte that maps no event to one of the OsTasks that there are."""
    is_timed = any(event.is_timing for component in components for event in component.events)
    if not is_timed or not configuration.tasks or any(m.is_called for m in configuration.mappings):
        return
    found = [path for path, module in standard_modules(tree).items() if module == "Rte"]
    if found:
        message = f"none of its {len(configuration.mappings)} event mappings names an OsTask"
        help = "map the events in the configurator, or bind the tasks in the overlay (units, precedence)"
        tree.nodes_at(found[0])[0].report(tree.findings, codes.MAPS_NOTHING, message, help=help)


def _check_platform(tree: Tree) -> None:
    """Raise `HalpipeError` if the files are of the Adaptive Platform only and have no process that could be a task."""
    first = next((node for tag in ADAPTIVE for node in tree.tagged(tag)), None)
    if first is None or tree.tagged("PROCESS"):
        return
    tags = {node.tag for node in tree.nodes()}
    if any(tag in _CLASSIC or (is_component_type(tag) and not tag.startswith("ADAPTIVE-")) for tag in tags):
        return
    counts = ", ".join(f"{len(found)} {tag}" for tag in ADAPTIVE if (found := tree.tagged(tag)))
    message = f"holds only Adaptive elements, and no PROCESS: {counts}"
    help = "add the execution manifest that has the processes"
    tree.findings.report(codes.ADAPTIVE_ONLY, message, at=first.at, help=help)
    raise HalpipeError(*tree.findings.items)


def _place(tree: Tree) -> Place | None:
    """Return what the system is named after: its only ECU, root composition, SYSTEM, composition or machine."""
    tags = ("ECU-INSTANCE", "ROOT-SW-COMPOSITION-PROTOTYPE", "SYSTEM", "COMPOSITION-SW-COMPONENT-TYPE", "MACHINE")
    return next((place_of(found[0]) for tag in tags if len(found := tree.tagged(tag)) == 1), None)
