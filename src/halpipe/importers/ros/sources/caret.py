"""Reader of CARET's architecture.yaml.

Keys after the format's documentation (tier4/caret_doc, "Architecture file"); older names of keys are accepted:
``path_name_aliases`` for ``named_paths``, ``type`` for ``callback_type``, ``callback_name`` (one) and
``callback_ids`` for ``callback_names``, ``callback_id`` and ``node_id`` for the names.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location, named
from halpipe.core.files import refuse_more_than
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.sources.graph import Callback, Group, Node, Path, RosGraph, Step
from halpipe.importers.ros.sources.nodes import UNDEFINED, NodeReader
from halpipe.importers.ros.sources.yaml_reader import Reader

if TYPE_CHECKING:
    from halpipe.core.files import YamlMap
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
        callbacks=_flat([node.callbacks for node in nodes]),
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


def _flat(lists: list[list[Callback]]) -> tuple[Callback, ...]:
    return tuple(callback for callbacks in lists for callback in callbacks)


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
    for entry in reader.entries(document, "executors", "file"):
        name = reader.text(entry, "executor_name", "executor")
        path = named("executor", name)
        reader.check_keys(entry, path, _EXECUTOR_KEYS)
        kind = reader.text(entry, "executor_type", path)
        callbacks: list[str] = []
        for group, line in reader.names(entry, "callback_group_names", path):
            if group in members:
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
            steps.append(Step(node=node, subscribed=subscribed, published=published, at=reader.at(step)))
        paths.append(Path(name=name, steps=tuple(steps), at=reader.at(entry)))
    return tuple(paths)
