"""Models that halpipe's own export wrote: standard elements, with exact values and the rest in special data groups.

Where a standard element and the exact value beside it disagree, somebody edited the file: then the element counts.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.core.durations import Duration
from halpipe.core.quantities import parse_bandwidth
from halpipe.importers.arxml.coverage import Ledger
from halpipe.importers.arxml.files.special import Data, data_of, each_data, edited, microseconds, whole
from halpipe.importers.arxml.names import listed
from halpipe.importers.arxml.own import codes as codes
from halpipe.importers.arxml.own.tasks import Tasks, take_name
from halpipe.importers.arxml.system.containers import container_kinds
from halpipe.importers.arxml.system.swc import place_of
from halpipe.models import (
    Chain,
    HealthAction,
    HealthEvent,
    HealthRule,
    Interrupt,
    Mode,
    Resource,
    Run,
    TaskModel,
    Transition,
    Unit,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.importers.arxml.files.tree import Node, Tree
    from halpipe.importers.common.base import Coverage, ImportOptions

_LATENCY = "LATENCY-TIMING-CONSTRAINT"
_CHAIN = "TIMING-DESCRIPTION-EVENT-CHAIN"
_EVENT = "TD-EVENT-SWC-INTERNAL-BEHAVIOR"
_MODE = "MODE-DECLARATION"
_FORMAT = 1


def find_carried(tree: Tree) -> Node | None:
    """Return the package of a model that halpipe wrote, None if there is none; report what cannot be read with it."""
    found = [node for node in tree.tagged("AR-PACKAGE") if data_of(tree, node, "model") is not None]
    for other in found[1:]:
        tree.findings.add(
            codes.SECOND_MODEL(
                f"holds a model of halpipe, but so does {found[0].at}",
                at=other.at,
                path=named("AR-PACKAGE", other.path),
                help="import one of the two",
            )
        )
    tree.findings.stop_on_errors()
    return found[0] if found else None


def read_carried(tree: Tree, package: Node, options: ImportOptions) -> tuple[TaskModel, Coverage]:
    """Return the model that halpipe wrote into a package, and the account of every element."""
    ledger = Ledger()
    reader = _Reader(tree, package, options, ledger)
    model = reader.model()
    kinds = container_kinds(tree)
    strangers = []
    for node in tree.nodes():
        own = node.path == package.path or node.path.startswith(package.path + "/")
        place = place_of(node)
        reason = "follows from other elements" if own else "beside a model that halpipe wrote"
        if node.tag == "ECUC-CONTAINER-VALUE" and node.path in kinds:
            place = type(place)(place.path, kinds[node.path], place.at)
        ledger.ignored(place, reason)
        if not own and node.tag.endswith("-SW-COMPONENT-TYPE"):
            strangers.append(node)
    if strangers:
        tree.findings.add(
            codes.BESIDE_MODEL(
                f"{len(strangers)} component types are not imported: {listed([node.path for node in strangers])}",
                at=strangers[0].at,
                help="import them on their own, or add their tasks to the model by hand",
            )
        )
    return model, ledger.close(tree, kinds)


class _Reader:
    """Reads the parts of a model, later ones by what earlier ones found."""

    def __init__(self, tree: Tree, package: Node, options: ImportOptions, ledger: Ledger) -> None:
        self._tree = tree
        self._package = package
        self._options = options
        self._ledger = ledger
        self._units: dict[str, str] = {}
        self._resources: dict[str, str] = {}
        self._modes: dict[str, str] = {}

    def model(self) -> TaskModel:
        """Return the whole model."""
        data = data_of(self._tree, self._package, "model")
        assert data is not None
        format = data.value("format", whole)
        if format != _FORMAT:
            edited(data, f"has the format {format}; only {_FORMAT} is known")
        self._ledger.mapped(place_of(self._package))
        units, resources = tuple(self._each_unit()), tuple(self._each_resource())
        tasks = Tasks(self._tree, self._within, self._ledger, self._units, self._resources)
        dropped = self._options.overlay.drops if self._options.overlay else None
        found = tuple(tasks.read(dropped))
        name = self._options.name or data.text("name") or self._package.name
        modes = tuple(self._each_mode(tasks))
        return TaskModel(
            name=take_name(name, set()),
            units=units,
            resources=resources,
            tasks=found,
            chains=tuple(self._each_chain(tasks)),
            modes=modes,
            transitions=tuple(self._each_transition()),
            health=tuple(self._each_rule(data, tasks)),
            origin=data.origin(),
        )

    def _within(self, *tags: str) -> Iterator[Node]:
        prefix = self._package.path + "/"
        return (node for node in self._tree.tagged(*tags) if node.path.startswith(prefix))

    def _marked(self, kind: str, *tags: str) -> Iterator[tuple[Node, Data]]:
        """Yield the elements that have special data of a kind."""
        for node in self._within(*tags):
            data = data_of(self._tree, node, kind)
            if data is not None:
                self._ledger.mapped(place_of(node))
                yield node, data

    # ------------------------------------------------------------------------------------------- platform

    def _each_unit(self) -> Iterator[Unit]:
        taken: set[str] = set()
        for node, data in self._marked("unit", "HW-ELEMENT"):
            name = take_name(data.text("name") or node.name, taken)
            self._units[node.path] = name
            type = data.text("type") or ""
            type = take_name(type, set()) if type else ""
            served = tuple(_interrupts(data))
            yield Unit(name=name, type=type, interrupts=served, origin=data.origin())

    def _each_resource(self) -> Iterator[Resource]:
        taken: set[str] = set()
        for node, data in self._marked("resource", "HW-ELEMENT"):
            name = take_name(data.text("name") or node.name, taken)
            self._resources[node.path] = name
            yield Resource(name=name, bandwidth=data.value("bandwidth", parse_bandwidth), origin=data.origin())

    # --------------------------------------------------------------------------------------------- chains

    def _each_chain(self, tasks: Tasks) -> Iterator[Chain]:
        limits = {(kind, chain): limit for kind, chain, limit in self._limits()}
        taken: set[str] = set()
        for node, data in self._marked("chain", _CHAIN):
            paths = list(self._runnables(node))
            names = [tasks.by_path.get(path) for path in paths]
            if not names or None in names:
                if tasks.dropped.isdisjoint(paths):
                    edited(data, "has segments that start no task of the model")
                continue
            yield Chain(
                name=take_name(data.text("name") or node.name, taken),
                tasks=tuple(name for name in names if name is not None),
                max_reaction=limits.get(("REACTION", node.path)),
                max_age=limits.get(("AGE", node.path)),
                **data.attributes(Chain, "name", "tasks", "max-reaction", "max-age"),
                origin=data.origin(),
            )

    def _runnables(self, chain: Node) -> Iterator[str]:
        """Yield the runnables whose starts are the stimuli of the segments of a chain."""
        what = f'{_CHAIN} "{chain.path}"'
        for ref in self._tree.refs(chain, "SEGMENT-REFS/SEGMENT-REF"):
            segment = self._tree.find(ref, what, (_CHAIN,))
            stimulus = self._tree.ref(segment, "STIMULUS-REF") if segment else None
            event = self._tree.find(stimulus, what, (_EVENT,)) if stimulus else None
            runnable = self._tree.ref(event, "RUNNABLE-REF") if event else None
            if segment and event:
                self._ledger.mapped(place_of(segment), place_of(event))
            yield runnable.path if runnable else ""

    def _limits(self) -> Iterator[tuple[str, str, Duration | None]]:
        """Yield kind, chain (path) and value of the latency constraints that limit chains."""
        for node, data in self._marked("limit", _LATENCY):
            kind = self._tree.text(node, "LATENCY-CONSTRAINT-TYPE")
            scope = self._tree.ref(node, "SCOPE-REF")
            if kind is not None and scope is not None:
                yield kind.value, scope.path, microseconds(self._tree, node, "MAXIMUM", data, "exact", up=False)

    # ---------------------------------------------------------------------------------------------- modes

    def _each_mode(self, tasks: Tasks) -> Iterator[Mode]:
        taken: set[str] = set()
        for node, data in self._marked("mode", _MODE):
            name = take_name(data.text("name") or node.name, taken)
            self._modes[node.path] = name
            yield Mode(name=name, runs=tuple(self._runs(node, data, tasks)), origin=data.origin())

    def _runs(self, mode: Node, data: Data, tasks: Tasks) -> Iterator[Run]:
        """Yield the runs that were written, unless the events were since disabled or enabled in the mode."""
        active = {name for name, modes in tasks.disabled_in.items() if mode.path not in modes}
        named: set[str] = set()
        for inner in data.groups("run"):
            task = tasks.by_path.get(inner.target("RUNNABLE-ENTITY") or "")
            if task is None or task in named:
                continue
            named.add(task)
            if task in tasks.disabled_in and task not in active:
                edited(data, f'event of task "{task}" is disabled in the mode')
                continue
            versions = tuple(dict.fromkeys(take_name(version, set()) for version in inner.texts("version")))
            kept = tuple(version for version in versions if version in tasks.versions[task])
            if kept != versions or not kept:
                edited(data, f'names versions that task "{task}" does not have, or none')
            if kept:
                yield Run(task=task, versions=kept)
        for task in tasks.disabled_in:
            if task in active - named and tasks.versions[task]:
                edited(data, f'event of task "{task}" is not disabled in the mode')
                yield Run(task=task, versions=tasks.versions[task])

    def _each_transition(self) -> Iterator[Transition]:
        for node in self._within("MODE-DECLARATION-GROUP"):
            for data in each_data(self._tree, node, "transition"):
                yield from self._transition(data.targets(_MODE), data)
        for node, data in self._marked("transition", "MODE-TRANSITION"):
            refs = [self._tree.ref(node, f"{end}-MODE-REF") for end in ("EXITED", "ENTERED")]
            yield from self._transition([ref.path for ref in refs if ref], data)

    def _each_rule(self, model: Data, tasks: Tasks) -> Iterator[HealthRule]:
        for data in model.groups("rule"):
            task = tasks.by_path.get(data.target("RUNNABLE-ENTITY") or "")
            event, action = data.value("on", HealthEvent), data.value("action", HealthAction)
            count, cycles = data.value("count", _times), data.value("cycles", _times)
            modes = data.targets(_MODE)
            if task is None or event is None or action is None or count is None or cycles is None:
                edited(data, "lacks the task, the event, the numbers or the action of a health rule")
            elif (action is HealthAction.SWITCH) != (len(modes) == 1 and modes[0] in self._modes):
                edited(data, "does not name the one mode that a health rule switches to")
            else:
                yield HealthRule(
                    task=task,
                    event=event,
                    count=count,
                    cycles=cycles,
                    action=action,
                    mode=self._modes[modes[0]] if modes else "",
                    origin=data.origin(),
                )

    def _transition(self, ends: list[str], data: Data) -> Iterator[Transition]:
        names = [self._modes[path] for path in ends if path in self._modes]
        if len(names) == 2:
            limit = data.value("max-length", Duration.parse)
            yield Transition(source=names[0], target=names[1], max_length=limit, origin=data.origin())
        else:
            edited(data, "does not name two modes of the model")


def _times(text: str) -> int:
    number = whole(text)
    if not 1 <= number <= 255:
        raise ValueError(f"{number} is not between 1 and 255")
    return number


def _interrupts(data: Data) -> Iterator[Interrupt]:
    """Yield the interrupts of a unit."""
    taken: set[str] = set()
    for group in data.groups("interrupt"):
        stated = group.attributes(Interrupt)
        if not stated.get("name") or not {"distance", "wcet"} <= stated.keys():
            edited(group, "lacks name, distance or execution time of an interrupt")
            continue
        yield Interrupt(**{**stated, "name": take_name(stated["name"], taken)}, origin=group.origin())
