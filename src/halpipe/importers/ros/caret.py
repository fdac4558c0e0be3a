"""Reader of CARET's architecture.yaml.

Keys after the format's documentation (tier4/caret_doc, "Architecture file"); older names of keys are accepted:
``path_name_aliases`` for ``named_paths``, ``type`` for ``callback_type``, ``callback_name`` (one) and
``callback_ids`` for ``callback_names``, ``callback_id`` and ``node_id`` for the names.

CARET leaves two thirds of the publications of a real system without a callback. In order: what is stated; the only
callback of the node; the last callback of a chain that a message context states; else an assumption, which is reported:
readers of the messages that a context carries on, the fastest timer, any callback.
"""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location, about, named
from halpipe.core.durations import Duration
from halpipe.core.files import YamlMap, refuse_more_than
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import (
    STATED,
    Callback,
    Certainty,
    Flow,
    Group,
    Kind,
    Node,
    Path,
    Publication,
    RosGraph,
    Step,
    Subscription,
    snapped,
)
from halpipe.importers.ros.yaml_reader import Reader

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.common.base import Coverage


MAX_ELEMENTS = 20_000
_TOP_KEYS = ("named_paths", "path_name_aliases", "executors", "nodes")
_EXECUTOR_KEYS = ("executor_type", "executor_name", "callback_group_names")
_PATH_KEYS = ("path_name", "node_chain")
_STEP_KEYS = (
    "node_name",
    "publish_topic_name",
    "subscribe_topic_name",
    "publisher_construction_order",
    "subscription_construction_order",
)


def read_caret(document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> RosGraph:
    """Read a recognised architecture.yaml; every finding is collected, elements in error are left out."""
    reader = Reader(file, findings)
    reader.check_keys(document, "file", _TOP_KEYS)
    _bound(document, file)
    nodes = [NodeReader(reader, entry, coverage) for entry in reader.entries(document, "nodes", "file")]
    _check_unique(nodes, reader)
    groups = [group for node in nodes for group in node.groups]
    executors = _executors(document, groups, reader)
    return RosGraph(
        file=file,
        nodes=tuple(Node(name=node.name, at=node.at) for node in nodes),
        callbacks=tuple(callback for node in nodes for callback in node.callbacks),
        publications=tuple(p for node in nodes for p in node.publications),
        subscriptions=tuple(s for node in nodes for s in node.subscriptions),
        flows=tuple(flow for node in nodes for flow in node.flows),
        groups=(*executors, *groups),
        paths=_paths(document, {node.name for node in nodes}, reader),
    )


def _bound(document: YamlMap, file: str) -> None:
    """Refuse graphs that are far larger than those of any vehicle before each of their elements is looked at."""
    nodes = [node for node in document.get("nodes") or () if isinstance(node, dict)]
    lists = [value for node in nodes for value in node.values() if isinstance(value, list)]
    count = len(nodes) + sum(map(len, lists))
    refuse_more_than(MAX_ELEMENTS, count, "nodes, callbacks, publications and the like", Location(file, document.line))


def _check_unique(nodes: list[NodeReader], reader: Reader) -> None:
    first_node: dict[str, int] = {}
    first_callback: dict[str, int] = {}
    for node in nodes:
        places = [(first_node, f'node "{node.name}"', node.name, node.at)]
        places += [(first_callback, f'callback "{c.name}"', c.name, c.at) for c in node.callbacks]
        for first, path, name, at in places:
            if name in first:
                help = "rename one of the two; names identify nodes and callbacks"
                text = f"is declared again, first on line {first[name]}"
                reader.findings.add(codes.DUPLICATE(text, at=at, path=path, help=help))
            first.setdefault(name, at.line)


def _executors(document: YamlMap, groups: list[Group], reader: Reader) -> tuple[Group, ...]:
    members = {group.name: group.callbacks for group in groups}
    executors = []
    owners = Owners(reader, "callback group", "executor")
    for entry in reader.entries(document, "executors", "file"):
        name = reader.text(entry, "executor_name", "executor")
        path = named("executor", name)
        reader.check_keys(entry, path, _EXECUTOR_KEYS)
        kind = reader.text(entry, "executor_type", path)
        callbacks: list[str] = []
        for group, line in reader.names(entry, "callback_group_names", path):
            if group in members:
                owners.check(group, name, line)
                callbacks.extend(members[group])
                continue
            help = did_you_mean(group, members, "declare it in callback_groups of its node")
            at = Location(reader.file, line)
            reader.findings.add(codes.DANGLING(f'no callback group "{group}"', at=at, path=path, help=help))
        single = "single" in kind
        executors.append(
            Group(kind="executor", name=name, exclusive=single, callbacks=tuple(callbacks), at=reader.at(entry))
        )
    return tuple(executors)


def _paths(document: YamlMap, nodes: set[str], reader: Reader) -> tuple[Path, ...]:
    paths = []
    key = "named_paths" if "named_paths" in document else "path_name_aliases"
    for entry in reader.entries(document, key, "file"):
        name = reader.text(entry, "path_name", "path")
        where = f'path "{name}"'
        reader.check_keys(entry, where, _PATH_KEYS)
        steps = []
        for step in reader.entries(entry, "node_chain", where):
            reader.check_keys(step, where, _STEP_KEYS)
            node = reader.text(step, "node_name", where)
            if node and node not in nodes:
                help = did_you_mean(node, sorted(nodes), "declare the node or remove it from the path")
                reader.findings.add(codes.DANGLING(f'no node "{node}"', at=reader.at(step), path=where, help=help))
            topics = [reader.optional(step, f"{side}_topic_name", where) for side in ("subscribe", "publish")]
            subscribed, published = (None if topic == UNDEFINED else topic for topic in topics)
            steps.append(Step(node=node, subscribed=subscribed, published=published))
        paths.append(Path(name=name, steps=tuple(steps), at=reader.at(entry)))
    return tuple(paths)


class Owners:
    """Finds elements of one kind that two elements of another kind name as theirs."""

    def __init__(self, reader: Reader, kind: str, owning: str) -> None:
        self._reader = reader
        self._kind = kind
        self._owning = owning
        self._first: dict[str, tuple[str, int]] = {}

    def check(self, name: str, owner: str, line: int) -> None:
        """Report that `owner` names what another one has named before."""
        first, where = self._first.setdefault(name, (owner, line))
        if first != owner:
            text = f'is in {self._owning} "{owner}", and on line {where} in "{first}"'
            at = Location(self._reader.file, line)
            help = f"name it in the {self._owning} that the program puts it into, and remove it from the other"
            self._reader.findings.add(codes.TWO_OWNERS(text, at=at, path=named(self._kind, name), help=help))


MAX_FLOWS = 50_000
UNDEFINED = "UNDEFINED"
"""What CARET writes where it found nothing out."""

_NODE_KEYS = (
    "node_name",
    "node_id",
    "callback_groups",
    "callbacks",
    "variable_passings",
    "publishes",
    "subscribes",
    "message_contexts",
    "services",
)
_GROUP_KEYS = ("callback_group_type", "callback_group_name", "callback_group_id", "callback_names", "callback_ids")
_CALLBACK_KEYS = (
    "callback_name",
    "callback_id",
    "callback_type",
    "type",
    "symbol",
    "period_ns",
    "topic_name",
    "service_name",
    "construction_order",
)
_KEY_OF = {Kind.TIMER: "period_ns", Kind.SUBSCRIPTION: "topic_name", Kind.SERVICE: "service_name"}
"""The key that callbacks of one type have, and those of the others do not."""
_PASSING_KEYS = ("callback_name_write", "callback_name_read", "callback_id_write", "callback_id_read")
_PUBLISH_KEYS = ("topic_name", "callback_names", "callback_name", "callback_ids", "callback_id", "construction_order")
_SUBSCRIBE_KEYS = ("topic_name", "callback_name", "callback_id", "construction_order")
_CONTEXT_KEYS = (
    "context_type",
    "type",
    "subscription_topic_name",
    "publisher_topic_name",
    "subscription_construction_order",
    "publisher_construction_order",
    "callbacks",
)
_GROUP_TYPES = ("mutually_exclusive", "reentrant", UNDEFINED)
_WHOLE = re.compile(r"[0-9]{1,19}")


class NodeReader:
    """Reads one entry of ``nodes``; its attributes hold what was found."""

    def __init__(self, reader: Reader, entry: YamlMap, coverage: Coverage) -> None:
        self._reader = reader
        self._entry = entry
        self._coverage = coverage
        self.at = reader.at(entry)
        self.name = reader.text(entry, "node_name", "node", "node_id")
        self._path = named("node", self.name)
        reader.check_keys(entry, self._path, _NODE_KEYS)
        self._known: dict[str, str] = {}
        self._group_of = Owners(reader, "callback", "callback group")
        self.callbacks = [c for c in map(self._callback, reader.entries(entry, "callbacks", self._path)) if c]
        self.groups = [self._group(e) for e in reader.entries(entry, "callback_groups", self._path)]
        self.flows = self._passings()
        contexts = [self._context(e) for e in reader.entries(entry, "message_contexts", self._path)]
        self._publishers = Publishers(self.callbacks, contexts)
        self._inputs = {callback.name: callback.inputs for callback in reversed(self.callbacks)}
        self.publications = [self._publication(e) for e in reader.entries(entry, "publishes", self._path)]
        self._flows_of_contexts(contexts)
        self.subscriptions = [self._subscription(e) for e in reader.entries(entry, "subscribes", self._path)]

    # ------------------------------------------------------------------------------------------- callbacks

    def _callback(self, entry: YamlMap) -> Callback | None:
        reader = self._reader
        stated = reader.text(entry, "callback_name", self._path, "callback_id")
        name = stated if stated.startswith("/") else f"{self.name}/{stated}"
        path = named("callback", name)
        reader.check_keys(entry, path, _CALLBACK_KEYS)
        for alias in {stated, name, str(entry.get("callback_id") or name)}:
            self._known[alias] = name
        kind = self._kind(entry, path)
        self._check_keys_of(kind, entry, path)
        at = Location(reader.file, entry.line)
        if kind is Kind.TIMER:
            return Callback(name=name, node=self.name, kind=kind, period=self._period(entry, path), at=at)
        if kind is Kind.SUBSCRIPTION:
            topic = reader.text(entry, "topic_name", path)
            return Callback(name=name, node=self.name, kind=kind, inputs=(topic,), at=at)
        return Callback(name=name, node=self.name, kind=kind, at=at) if kind else None

    def _kind(self, entry: YamlMap, path: str) -> Kind | None:
        stated = self._reader.text(entry, "callback_type", path, "type")
        known = (Kind.TIMER, Kind.SUBSCRIPTION, Kind.SERVICE)
        if stated in known:
            return Kind(stated)
        if stated:
            key = "callback_type" if "callback_type" in entry else "type"
            at = Location(self._reader.file, entry.line_of(key))
            help = did_you_mean(stated, known, "use one of " + ", ".join(known))
            self._reader.findings.add(codes.BAD_CALLBACK_TYPE(f'no type "{stated}"', at=at, path=path, help=help))
        return None

    def _check_keys_of(self, kind: Kind | None, entry: YamlMap, path: str) -> None:
        """Report keys of callbacks of another type."""
        for other, key in _KEY_OF.items():
            if kind not in (None, other) and entry.get(key) not in (None, UNDEFINED):
                at = Location(self._reader.file, entry.line_of(key))
                help = f"remove it, or state the type {other} if that is what it is"
                text = f'key "{key}" of a {kind} is not read'
                self._reader.findings.add(codes.UNKNOWN_KEY(text, at=at, path=path, help=help))

    def _period(self, entry: YamlMap, path: str) -> Duration | None:
        reader = self._reader
        value = entry.get("period_ns")
        at = Location(reader.file, entry.line_of("period_ns"))
        if not isinstance(value, str) or not _WHOLE.fullmatch(value) or int(value) == 0:
            shown = f'period_ns is "{value}"' if "period_ns" in entry else "a timer has no period_ns"
            help = "state the period as a positive whole number of nanoseconds"
            reader.findings.add(codes.BAD_PERIOD(shown, at=at, path=path, help=help))
            return None
        return snapped(Duration(int(value)), STATED, at, path, reader.findings)

    def _group(self, entry: YamlMap) -> Group:
        reader = self._reader
        name = reader.text(entry, "callback_group_name", self._path, "callback_group_id")
        path = named("callback group", name)
        reader.check_keys(entry, path, _GROUP_KEYS)
        kind = reader.optional(entry, "callback_group_type", path)
        if kind in (None, UNDEFINED):
            self._coverage.defaulted(name, "callback group type", "mutually_exclusive", reader.at(entry))
        elif kind not in _GROUP_TYPES:
            known = ", ".join(_GROUP_TYPES)
            reader.malformed(f'"{kind}" is no type of group: {known}', entry.line_of("callback_group_type"), path)
        exclusive = kind != "reentrant"
        callbacks = self._references(entry, path, "callback_names", "callback_ids")
        for callback in callbacks:
            self._group_of.check(callback, name, entry.line)
        return Group(kind="callback_group", name=name, exclusive=exclusive, callbacks=callbacks, at=reader.at(entry))

    def _references(self, entry: YamlMap, path: str, *keys: str) -> tuple[str, ...]:
        """Return the callbacks named under the first of `keys` present, leaving out UNDEFINED."""
        key = next((key for key in keys if key in entry), keys[0])
        found = (self._resolve(name, line, path) for name, line in self._reader.names(entry, key, path))
        return tuple(dict.fromkeys(name for name in found if name))

    def _reference(self, entry: YamlMap, path: str, *keys: str) -> str | None:
        return next(iter(self._references(entry, path, *keys)), None)

    def _resolve(self, name: str, line: int, path: str) -> str | None:
        if name in ("", UNDEFINED):
            return None
        if name not in self._known:
            help = did_you_mean(name, self._known, f'declare it under callbacks of node "{self.name}"')
            text = f'no callback "{name}" in node "{self.name}"'
            at = Location(self._reader.file, line)
            self._reader.findings.add(codes.DANGLING(text, at=at, path=path, help=help))
        return self._known.get(name)

    # ------------------------------------------------------------------------------------------- data flow

    def _passings(self) -> list[Flow]:
        flows = []
        for entry in self._reader.entries(self._entry, "variable_passings", self._path):
            self._reader.check_keys(entry, self._path, _PASSING_KEYS)
            writer = self._reference(entry, self._path, "callback_name_write", "callback_id_write")
            reader = self._reference(entry, self._path, "callback_name_read", "callback_id_read")
            if writer and reader:
                flows.append(Flow(writer=writer, reader=reader))
                self._coverage.mapped("variable_passing")
            else:
                self._coverage.ignored("variable_passing", self.name, "is UNDEFINED", self._reader.at(entry))
        return flows

    def _context(self, entry: YamlMap) -> Context:
        reader, path = self._reader, self._path
        reader.check_keys(entry, path, _CONTEXT_KEYS)
        kind = reader.text(entry, "context_type", path, "type")
        subscribed = reader.text(entry, "subscription_topic_name", path)
        published = reader.text(entry, "publisher_topic_name", path)
        if kind == UNDEFINED:
            name = f"{self.name}: {subscribed} -> {published}"
            self._coverage.ignored("message_context", name, "its type is UNDEFINED", reader.at(entry))
        else:
            self._coverage.mapped("message_context")
        callbacks = self._references(entry, path, "callbacks") if kind == "callback_chain" else ()
        return Context(kind=kind, subscribed=subscribed, published=published, callbacks=callbacks)

    def _publication(self, entry: YamlMap) -> Publication:
        topic = self._reader.text(entry, "topic_name", self._path)
        path = about(self._path, publishing=topic)
        self._reader.check_keys(entry, path, _PUBLISH_KEYS)
        stated = self._references(entry, path, "callback_names", "callback_name", "callback_ids", "callback_id")
        callbacks, certainty = self._publishers.of(topic, stated)
        at = Location(self._reader.file, entry.line)
        return Publication(node=self.name, topic=topic, callbacks=callbacks, certainty=certainty, at=at)

    def _flows_of_contexts(self, contexts: list[Context]) -> None:
        """Connect the callback of a context's subscription to the callbacks that publish its topic."""
        publishing = {publication.topic: publication.callbacks for publication in self.publications}
        for context in contexts:
            if context.kind == UNDEFINED:
                continue
            writers = self._publishers.readers.get(context.subscribed, ())
            readers = publishing.get(context.published, ())
            count = len(self.flows) + len(writers) * len(readers)
            refuse_more_than(MAX_FLOWS, count, "flows of data within a node", self.at)
            self.flows.extend(Flow(writer=w, reader=r) for w in writers for r in readers if w != r)

    def _subscription(self, entry: YamlMap) -> Subscription:
        topic = self._reader.text(entry, "topic_name", self._path)
        path = about(self._path, subscribing=topic)
        self._reader.check_keys(entry, path, _SUBSCRIBE_KEYS)
        name = self._reference(entry, path, "callback_name", "callback_id")
        if name is None and len(self.callbacks) == 1:
            name = self._poll(topic)
        elif name and topic not in self._inputs.get(name, (topic,)):
            self._reader.malformed(f'callback "{name}" does not read this topic', entry.line_of("callback_name"), path)
        return Subscription(node=self.name, topic=topic, callback=name, at=self._reader.at(entry))

    def _poll(self, topic: str) -> str:
        """Let the node's only callback read a topic that triggers nothing."""
        only = self.callbacks[0]
        if topic not in only.inputs + only.polled:
            self.callbacks[0] = replace(only, polled=(*only.polled, topic))
        return only.name


_CARRYING = ("callback_chain", "inherit_unique_stamp", "tilde")
"""Contexts in which a message that comes in makes one go out; the latest message may be published by any callback."""


@record(kw_only=True)
class Context:
    """A message context: how a node relates what it publishes to what it subscribes."""

    kind: str
    subscribed: str
    published: str
    callbacks: tuple[str, ...] = ()


class Publishers:
    """The callbacks of one node that may publish, looked through once for all its topics."""

    def __init__(self, callbacks: Sequence[Callback], contexts: Sequence[Context]) -> None:
        self.readers: dict[str, list[str]] = {}
        """By topic, the names of the callbacks that it triggers."""
        able = [callback for callback in callbacks if callback.kind is not Kind.SERVICE]
        timers = [(callback.period, position) for position, callback in enumerate(able) if callback.period is not None]
        self._able = tuple(callback.name for callback in able)
        self._fastest = able[min(timers)[1]].name if timers else None
        self._position = {name: position for position, name in enumerate(self._able)}
        for callback in callbacks:
            for topic in dict.fromkeys(callback.inputs):
                self.readers.setdefault(topic, []).append(callback.name)
        self._about: dict[str, list[Context]] = {}
        for context in contexts:
            self._about.setdefault(context.published, []).append(context)

    def of(self, topic: str, stated: tuple[str, ...]) -> tuple[tuple[str, ...], Certainty]:
        """Return the callbacks that may publish `topic`, none if it is published outside of callbacks.

        Several that are assumed are candidates, of which `activation.settled` takes one.
        """
        if stated:
            return stated, Certainty.STATED
        if len(self._able) <= 1:
            return self._able, Certainty.INFERRED
        about = self._about.get(topic, ())
        ends = dict.fromkeys(context.callbacks[-1] for context in about if context.callbacks)
        if ends:
            return tuple(ends), Certainty.INFERRED if len(ends) == 1 else Certainty.ASSUMED
        kept = dict.fromkeys(context.subscribed for context in about if context.kind in _CARRYING)
        carrying = {name for read in kept for name in self.readers.get(read, ()) if name in self._position}
        if carrying:
            return tuple(sorted(carrying, key=self._position.__getitem__)), Certainty.ASSUMED
        return (self._able if self._fastest is None else (self._fastest,)), Certainty.ASSUMED
