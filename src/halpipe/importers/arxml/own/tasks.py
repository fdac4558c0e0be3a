"""The tasks and versions of models that halpipe wrote: runnables with their events, and implementations."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.core.durations import Duration
from halpipe.importers.arxml.files.special import BLANKS, data_of, edited, microseconds, seconds_of, whole
from halpipe.importers.arxml.names import legal_name, unique_name
from halpipe.importers.arxml.system.swc import place_of
from halpipe.models import (
    WHOLE,
    Access,
    Precedence,
    Source,
    Split,
    Task,
    Transfer,
    Version,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.importers.arxml.coverage import Ledger
    from halpipe.importers.arxml.files.special import Data
    from halpipe.importers.arxml.files.tree import Node, Tree

_NAME = re.compile(r"[A-Za-z0-9_./:~+@$%-]{1,1000}")
_BLANK = re.compile(r"[ \t\r\n]")
_RUNNABLE = "RUNNABLE-ENTITY"
_HARDWARE = "HW-ELEMENT"
_MOST_UNITS = 1_000_000


def take_name(name: str, taken: set[str]) -> str:
    """Return a name that a model may have, not among those taken, and take it."""
    stripped = name.strip(BLANKS)
    return unique_name(stripped if _NAME.fullmatch(stripped) else legal_name(stripped), taken)


class Tasks:
    """Reads tasks; then tells their names by the paths of runnables, their versions, and where they are disabled.

    `units` and `resources` are the names of hardware elements by path.
    """

    def __init__(
        self,
        tree: Tree,
        within: Callable[..., Iterator[Node]],
        ledger: Ledger,
        units: dict[str, str],
        resources: dict[str, str],
    ) -> None:
        self.by_path: dict[str, str] = {}
        self.dropped: set[str] = set()
        self.versions: dict[str, tuple[str, ...]] = {}
        self.disabled_in: dict[str, frozenset[str]] = {}
        self._tree = tree
        self._within = within
        self._ledger = ledger
        self._units = units
        self._resources = resources
        self._marked: dict[str, Data] = {}

    def read(self, drops: Callable[[str], bool] | None) -> Iterator[Task]:
        """Yield the tasks in their order, without those that an overlay drops."""
        taken: set[str] = set()
        for node in self._within(_RUNNABLE):
            data = data_of(self._tree, node, "task")
            if data is None:
                continue
            name = take_name(data.text("name") or node.name, taken)
            if drops is not None and drops(name):
                self.dropped.add(node.path)
                self._ledger.ignored(place_of(node), "left out by the overlay")
                continue
            self.by_path[node.path] = name
            self._marked[node.path] = data
        implementations = self._implementations()
        deadlines = dict(self._deadlines())
        for path, data in self._marked.items():
            yield self._task(data, implementations.get(path, []), deadlines.get(path))

    def _task(self, data: Data, implementations: list[Data], deadline: Duration | None) -> Task:
        node, name = data.node, self.by_path[data.node.path]
        self._ledger.mapped(place_of(node))
        taken: set[str] = set()
        versions = tuple(self._version(found, taken) for found in implementations)
        self.versions[name] = tuple(version.name for version in versions)
        period, offset = self._times(data, name)
        return Task(
            name=name,
            period=period,
            offset=offset,
            deadline=deadline,
            **data.attributes(Task, "name", "period", "offset", "deadline"),
            versions=versions,
            origin=data.origin(),
        )

    def _times(self, data: Data, name: str) -> tuple[Duration | None, Duration | None]:
        """Return the period and the offset of a task; only its event tells whether it is periodic."""
        event = self._event(data.node)
        offset = data.value("offset", Duration.parse)
        if event is None:
            if data.text("period") is not None:
                edited(data, "has a period, but no event starts it")
            return None, offset
        self._ledger.mapped(place_of(event))
        period = seconds_of(self._tree, event, "PERIOD", data, "period")
        if self._tree.text(event, "OFFSET") is not None:
            offset = seconds_of(self._tree, event, "OFFSET", data, "offset")
        if not period:
            return None, offset
        refs = self._tree.refs(event, "DISABLED-MODE-IREFS/DISABLED-MODE-IREF/TARGET-MODE-DECLARATION-REF")
        self.disabled_in[name] = frozenset(ref.path for ref in refs)
        return period, offset

    def _event(self, runnable: Node) -> Node | None:
        behavior = runnable.parent
        assert behavior is not None
        for event in behavior.inside("TIMING-EVENT"):
            start = self._tree.ref(event, "START-ON-EVENT-REF")
            if start is not None and start.path == runnable.path:
                return event
        return None

    def _deadlines(self) -> Iterator[tuple[str, Duration]]:
        for node in self._within("LATENCY-TIMING-CONSTRAINT"):
            data = data_of(self._tree, node, "deadline")
            runnable = data.target(_RUNNABLE) if data else None
            if data is not None and runnable is not None:
                self._ledger.mapped(place_of(node))
                deadline = microseconds(self._tree, node, "MAXIMUM", data, "exact", up=False)
                if deadline is not None:
                    yield runnable, deadline

    # ------------------------------------------------------------------------------------------- versions

    def _implementations(self) -> dict[str, list[Data]]:
        """Return the implementations of each runnable, by the behaviours that they name."""
        owners = {path.rpartition("/")[0]: path for path in self.by_path}
        found: dict[str, list[Data]] = {}
        for node in self._within("SWC-IMPLEMENTATION"):
            data = data_of(self._tree, node, "version")
            ref = self._tree.ref(node, "BEHAVIOR-REF")
            if data is not None and ref is not None and ref.path in owners:
                self._ledger.mapped(place_of(node))
                found.setdefault(owners[ref.path], []).append(data)
        return found

    def _version(self, data: Data, taken: set[str]) -> Version:
        units = [self._units.get(path) for group in data.groups("units") for path in group.targets(_HARDWARE)]
        gang = data.value("gang", whole)
        if gang is not None and gang > _MOST_UNITS:
            edited(data, f"a job of {gang} units is more than {_MOST_UNITS}")
            gang = None
        return Version(
            name=take_name(data.text("name") or data.node.name, taken),
            wcet=self._wcet(data),
            **data.attributes(Version, "name", "wcet"),
            units=tuple(unit for unit in units if unit is not None),
            gang=1 if gang is None else gang,
            accesses=tuple(access for group in data.groups("access") for access in self._access(group)),
            precedences=tuple(found for group in data.groups("precedence") for found in self._precedence(group)),
            source=next((source for group in data.groups("source") for source in _source(group)), None),
            split=next(map(_split, data.groups("split")), WHOLE),
            origin=data.origin(),
        )

    def _wcet(self, data: Data) -> Duration | None:
        """Return the longest of the execution times on the units."""
        found = []
        for resources in data.node.inside("RESOURCE-CONSUMPTION"):
            for time in resources.inside("ANALYZED-EXECUTION-TIME"):
                self._ledger.mapped(place_of(time))
                found.append(microseconds(self._tree, time, "WORST-CASE-EXECUTION-TIME", data, "wcet", up=True))
        stated = [time for time in found if time is not None]
        if not stated and data.text("wcet") is not None:
            edited(data, "has an exact execution time, but no ANALYZED-EXECUTION-TIME")
        return max(stated) if stated else None

    def _access(self, data: Data) -> Iterator[Access]:
        resource = self._resources.get(data.target(_HARDWARE) or "")
        stated = data.attributes(Access, "resource")
        if resource is None or not {"start", "end", "bound"} <= stated.keys():
            edited(data, "lacks resource, start, end or bound of an access")
            return
        transfers = tuple(transfer for group in data.groups("transfer") for transfer in _transfer(group))
        yield Access(resource=resource, **stated, transfers=transfers)

    def _precedence(self, data: Data) -> Iterator[Precedence]:
        path = data.target(_RUNNABLE)
        if path in self.dropped:
            return
        task = self.by_path.get(path or "")
        stated = data.attributes(Precedence, "task")
        if task is None or "max" not in stated:
            edited(data, "lacks task or maximum of a precedence")
            return
        yield Precedence(task=task, **stated, origin=data.origin())


def _split(data: Data) -> Split:
    try:
        points = tuple(Duration.parse(text) for text in data.texts("point"))
    except ValueError as failure:
        edited(data, f"has a split point that cannot be read: {failure}")
        return WHOLE
    return Split(
        points=points,
        anywhere=data.text("anywhere") == "true",
        max_gaps=data.value("max-gaps", whole),
        **data.attributes(Split, "max-gaps"),
    )


def _transfer(data: Data) -> Iterator[Transfer]:
    stated = data.attributes(Transfer)
    names = {field: take_name(stated[field], set()) for field in ("buffer", "symbol") if stated.get(field)}
    if len(names) < 2 or "size" not in stated:
        edited(data, "lacks buffer, symbol or size of a transfer")
        return
    yield Transfer(**{**stated, **names})


def _source(data: Data) -> Iterator[Source]:
    files, defines = ([text.strip(BLANKS) for text in data.texts(key)] for key in ("file", "define"))
    entry = data.text("entry")
    if not files or entry is None or any(not text or _BLANK.search(text) for text in (*files, *defines)):
        edited(data, "lacks files or entry of a source, or has white space in one")
        return
    words = [word for word in _BLANK.split(entry) if word]
    yield Source(files=tuple(files), entry=" ".join(words), defines=tuple(defines))
