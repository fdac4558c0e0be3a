"""One node of CARET's architecture.yaml: callbacks, callback groups, publications, subscriptions, inner data flow."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location, about, named
from halpipe.core.durations import Duration
from halpipe.core.files import refuse_more_than
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.periods import STATED, snap
from halpipe.importers.ros.publishers import Context, Publishers
from halpipe.importers.ros.sources.graph import Callback, Flow, Group, Kind, Publication, Subscription

if TYPE_CHECKING:
    from halpipe.core.files import YamlMap
    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.sources.yaml_reader import Reader

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

    def _period(self, entry: YamlMap, path: str) -> Duration | None:
        reader = self._reader
        value = entry.get("period_ns")
        at = Location(reader.file, entry.line_of("period_ns"))
        if not isinstance(value, str) or not _WHOLE.fullmatch(value) or int(value) == 0:
            shown = f'period_ns is "{value}"' if "period_ns" in entry else "a timer has no period_ns"
            help = "state the period as a positive whole number of nanoseconds"
            reader.findings.add(codes.BAD_PERIOD(shown, at=at, path=path, help=help))
            return None
        measured = Duration(int(value))
        period = snap(measured, STATED)
        if period != measured:
            help = "nothing to do unless the odd period is meant"
            reader.findings.add(codes.SNAPPED(f"period {measured} rounded to {period}", at=at, path=path, help=help))
        return period

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
