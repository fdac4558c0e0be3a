"""Event chains, chains of processes and ages of data as cause-effect chains of tasks."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from halpipe.importers.amalthea import codes
from halpipe.importers.amalthea.properties import agrees, optional_duration, value_of

if TYPE_CHECKING:
    from halpipe.durations import Duration
    from halpipe.importers.amalthea.entities import Entities
    from halpipe.importers.amalthea.parts import Draft
    from halpipe.importers.amalthea.xmi import Forest, Item

_ITEM_TAGS = ("items", "segments", "strands")
_MOST_LEVELS = 50
_BEGINS = ("activate", "start")


@dataclass(frozen=True, slots=True)
class Chained:
    """A chain of drafts in the order of the data, with its limits."""

    name: str
    drafts: tuple[Draft, ...]
    item: Item
    reaction: Duration | None = None
    age: Duration | None = None


def read_chains(forest: Forest, entities: Entities) -> list[Chained]:
    """Read all chains and their limits; report those that name no tasks."""
    reader = _Reader(forest, entities)
    chains = [chain for item in forest.within("ConstraintsModel", "eventChains") for chain in reader.chains(item)]
    chains = reader.limited(chains)
    chains += reader.processes()
    chains += reader.ages()
    help = "let events name tasks, or runnables that one task calls"
    forest.report_each(codes.BAD_CHAIN, "chains name no tasks", reader.bad, help)
    forest.report_each(
        codes.NOT_IMPORTED, "limits of chains", reader.unread, "the upper limits of age and reaction are imported"
    )
    return chains


class _Reader:
    def __init__(self, forest: Forest, entities: Entities) -> None:
        self.forest = forest
        self.entities = entities
        self.bad: list[Item] = []
        self.unread: list[Item] = []

    # ------------------------------------------------------------------------------------ event chains

    def chains(self, item: Item) -> list[Chained]:
        """Return the chain of tasks of an event chain, several where parts are parallel."""
        found = self._sequences(item, 0)
        paths = [path for events in found if (path := self._tasks(events)) is not None]
        if not paths or len(paths) < len(found):
            self.bad.append(item)
        if paths:
            item.use_all()
        names = [item.name] if len(paths) == 1 else [f"{item.name}.{i}" for i, _ in enumerate(paths, 1)]
        return [Chained(name, path, item) for name, path in zip(names, paths, strict=True)]

    def _sequences(self, item: Item, level: int) -> list[list[Item | None]]:
        """Return the events along a chain, for each way through it."""
        ends: list[Item | None] = [self.forest.ref(item, "stimulus"), self.forest.ref(item, "response")]
        inner = [link for tag in _ITEM_TAGS for link in item.all(tag)]
        if not inner or level > _MOST_LEVELS:
            return [ends]
        links = [self._sequences(chain, level + 1) for link in inner if (chain := self._chain(link)) is not None]
        if item.get("itemType") == "parallel" or all(link.tag == "strands" for link in inner):
            return [[ends[0], *way, ends[1]] for ways in links for way in ways]
        ways: list[list[Item | None]] = [[ends[0]]]
        for choices in links:
            ways = [[*way, *choice] for way in ways for choice in choices][:_MOST_LEVELS]
        return [[*way, ends[1]] for way in ways]

    def _chain(self, link: Item) -> Item | None:
        """Return the chain that a link contains or refers to; until 0.8.0 the link is the chain."""
        link.use()
        if link.kind == "EventChainReference" or link.get("eventChain"):
            return self.forest.ref(link, "eventChain")
        return link.one("eventChain") or link

    def _tasks(self, events: list[Item | None]) -> tuple[Draft, ...] | None:
        """Return the tasks in which events happen, each once where several events of one follow on each other."""
        groups: list[list[tuple[Item, Draft]]] = []
        for event in events:
            place = self.entities.place(event)
            if event is None or place is None or len({draft.task for draft in place.drafts}) != 1:
                return None
            if not groups or groups[-1][-1][1].task is not place.drafts[0].task:
                groups.append([])
            groups[-1].append((event, place.drafts[0]))
        found = [self._through(group, group is groups[-1]) for group in groups]
        return tuple(draft for drafts in found for draft in drafts)

    def _through(self, group: list[tuple[Item, Draft]], is_last: bool) -> list[Draft]:
        """Return the parts of a task that data passes: all of them, unless the chain begins or ends inside."""
        if is_last and all(event.get("eventType") in _BEGINS for event, _ in group):
            return [group[0][1]]
        if any(event.kind == "ProcessEvent" for event, _ in group):
            return self.entities.path(group[0][1].task)
        drafts = list(dict.fromkeys(draft for _, draft in group))
        rest = [] if is_last else self.entities.path(drafts[-1].task)
        return drafts + (rest[rest.index(drafts[-1]) + 1 :] if drafts[-1] in rest else [])

    def limited(self, chains: list[Chained]) -> list[Chained]:
        """Return the chains with their latency constraints."""
        limits: dict[Item, dict[str, Duration]] = {}
        for item in self.forest.kinds("EventChainLatencyConstraint", "AgeConstraint", "ReactionConstraint"):
            scope = self.forest.ref(item, "scope")
            kind = item.get("type") or item.kind.removesuffix("Constraint")
            stated = item.one("maximum")
            standard = None if stated is None else self.forest.time(stated)
            exact = value_of(self.forest, item, "maximum", optional_duration)
            time = exact if exact is not None and agrees(exact, standard) else standard
            minimum = item.one("minimum")
            least = None if minimum is None else self.forest.time(minimum)
            if scope is None or time is None or kind not in ("Age", "Reaction"):
                self.unread.append(item)
                continue
            if least:
                self.unread.append(item)
            item.use_all()
            kept = limits.setdefault(scope, {})
            kept[kind] = min(time, kept.get(kind, time))
        return [
            replace(
                chain, reaction=limits.get(chain.item, {}).get("Reaction"), age=limits.get(chain.item, {}).get("Age")
            )
            for chain in chains
        ]

    # ------------------------------------------------------------------------- processes and data ages

    def processes(self) -> list[Chained]:
        """Return chains of processes; an end-to-end limit counts from the first start to the last end."""
        limits: dict[Item, Duration] = {}
        for item in self.forest.kinds("ProcessChainRequirement"):
            chain, limit = self.forest.ref(item, "processChain"), item.one("limit")
            stated = None if limit is None else limit.one("limitValue")
            time = None if stated is None else self.forest.time(stated)
            upper = limit is not None and limit.get("limitType") in ("UpperLimit", "")
            if chain is None or time is None or limit is None or limit.get("metric") != "EndToEnd" or not upper:
                self.unread.append(item)
                continue
            item.use_all()
            limits[chain] = min(time, limits.get(chain, time))
        found = []
        for item in self.forest.kinds("ProcessChain"):
            drafts = [draft for task in self.forest.refs(item, "processes") for draft in self.entities.of(task)[:1]]
            if drafts:
                item.use_all()
                found.append(Chained(item.name, tuple(drafts), item, age=limits.get(item)))
            else:
                self.bad.append(item)
        return found

    def ages(self) -> list[Chained]:
        """Return a chain from each writer of a label to the tasks whose runnable must read it fresh."""
        found = []
        for item in self.forest.kinds("DataAgeConstraint"):
            runnable, label = self.forest.ref(item, "runnable"), self.forest.ref(item, "label")
            age = item.one("dataAge")
            stated = None if age is None else age.one("maximumTime")
            time = None if stated is None else self.forest.time(stated)
            if runnable is None or label is None or time is None:
                self.unread.append(item)
                continue
            readers, writers = self.entities.callers(runnable), self.entities.writers(label)
            pairs = [(writer, reader) for writer in writers for reader in readers if writer is not reader]
            if not pairs:
                self.bad.append(item)
                continue
            item.use_all()
            names = [item.name] if len(pairs) == 1 else [f"{item.name}.{i}" for i, _ in enumerate(pairs, 1)]
            found += [Chained(name, pair, item, age=time) for name, pair in zip(names, pairs, strict=True)]
        return found
