"""Manifests of the Adaptive Platform: machines with their cores, processes, and states of function groups.

Elements moved between releases; every form is read: function groups in a MACHINE (00043 to 00048) or a set of their
own (from 00049), mode-dependent (to 00046) or state-dependent startup configurations (from 00047).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files.numbers import parse_number
from halpipe.importers.arxml.files.tree import local
from halpipe.importers.arxml.system.modes import read_mode_groups
from halpipe.importers.arxml.system.swc import place_of, stated
from halpipe.importers.arxml.system.values import Machine, ModeGroup, Place, Process

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.importers.arxml.files.tree import Node, Tree

ADAPTIVE = (
    "ADAPTIVE-APPLICATION-SW-COMPONENT-TYPE",
    "EXECUTABLE",
    "FUNCTION-GROUP-SET",
    "MACHINE",
    "MACHINE-DESIGN",
    "PROCESS",
    "PROCESS-TO-MACHINE-MAPPING-SET",
    "SOFTWARE-CLUSTER",
    "STARTUP-CONFIG",
    "STARTUP-CONFIG-SET",
)
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
        ref = tree.ref(node, "TYPE-TREF")
        type = tree.find(ref, f'{_GROUP} "{node.path}"', ("MODE-DECLARATION-GROUP",)) if ref else None
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
    mapped = {process: node for node, process in _mappings(tree)}
    return tuple(_process(tree, node, mapped.get(node.path), machines, groups) for node in tree.tagged("PROCESS"))


def _mappings(tree: Tree) -> Iterator[tuple[Node, str]]:
    for node in tree.tagged("PROCESS-TO-MACHINE-MAPPING"):
        ref = tree.ref(node, "PROCESS-REF")
        process = tree.find(ref, f'{node.tag} "{node.path}"', ("PROCESS",)) if ref else None
        if process is not None:
            yield node, process.path


def _process(
    tree: Tree, node: Node, mapping: Node | None, machines: tuple[Machine, ...], groups: tuple[ModeGroup, ...]
) -> Process:
    states = tuple(dict.fromkeys(_states(tree, node)))
    own = [group for group in groups if any(mode.path in states for mode in group.modes)]
    client_ref = tree.ref(node, "DETERMINISTIC-CLIENT-REF")
    client = tree.find(client_ref, f'PROCESS "{node.path}"', ("DETERMINISTIC-CLIENT",)) if client_ref else None
    workers = tree.text(client, "NUMBER-OF-WORKERS") if client else None
    count = parse_number(workers.value) if workers else None
    machine, cores = _allowed(tree, mapping, machines) if mapping else (None, ())
    return Process(
        place=place_of(node),
        states=states,
        disabled_in=tuple(mode.path for group in own for mode in group.modes if mode.path not in states),
        machine=machine,
        cores=cores,
        cycle=stated(tree.text(client, "CYCLE-TIME-VALUE")) if client else None,
        workers=int(count) if count and count.denominator == 1 else 1,
        parts=tuple(place_of(part) for part in (mapping, client) if part is not None),
    )


def _states(tree: Tree, node: Node) -> Iterator[str]:
    """Yield the states of function groups in which a process runs, as paths below the function group."""
    what = f'PROCESS "{node.path}"'
    for startup in _STARTUPS:
        for state in _STATES:
            for element, file in node.elements(f"{startup}/{state}"):
                refs = {local(child): child for child in element.iterchildren("*")}
                context = next((c for tag, c in refs.items() if tag.startswith("CONTEXT-")), None)
                target = next((c for tag, c in refs.items() if tag.startswith("TARGET-")), None)
                group = tree.reference(node, context, file) if context is not None else None
                mode = tree.reference(node, target, file) if target is not None else None
                found = tree.find(mode, what, ("MODE-DECLARATION",)) if mode else None
                if group is not None and tree.find(group, what, (_GROUP,)) and found is not None:
                    yield f"{group.path}/{found.name}"


def _allowed(tree: Tree, mapping: Node, machines: tuple[Machine, ...]) -> tuple[str | None, tuple[str, ...]]:
    """Return the machine (path) of a mapping, and which of its cores the process may use."""
    what = f'{mapping.tag} "{mapping.path}"'
    ref = tree.ref(mapping, "MACHINE-REF")
    target = tree.find(ref, what, ("MACHINE",)) if ref else None
    machine = next((m for m in machines if target is not None and m.place.path == target.path), None)
    if machine is None:
        return None, ()
    allowed, forbidden = (
        [node.path for ref in tree.refs(mapping, path) if (node := tree.find(ref, what, ("PROCESSOR-CORE",)))]
        for path in ("SHALL-RUN-ON-REFS/SHALL-RUN-ON-REF", "SHALL-NOT-RUN-ON-REFS/SHALL-NOT-RUN-ON-REF")
    )
    cores = [core.path for core in machine.cores]
    left = tuple(core for core in cores if (not allowed or core in allowed) and core not in forbidden)
    if cores and not left:
        tree.findings.add(
            codes.NO_CORE(
                "leaves the process no core; all of its machine are assumed",
                at=mapping.at,
                path=what,
                help="correct SHALL-RUN-ON-REFS and SHALL-NOT-RUN-ON-REFS, or state the units in the overlay",
            )
        )
    return machine.place.path, left or tuple(cores)
