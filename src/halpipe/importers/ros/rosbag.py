"""Periods from rosbag2 recordings: duration / (messages - 1) of every topic in metadata.yaml, versions 4 to 9."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from halpipe.diagnostics import Findings, Location
from halpipe.durations import Duration
from halpipe.files import YamlList, YamlMap
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import Rate
from halpipe.importers.ros.names import printable

if TYPE_CHECKING:
    from halpipe.importers.base import Coverage

ROSBAG = "rosbag2 recording"
FEWEST_MESSAGES = 10
"""A handful of messages is a latched or an aperiodic topic, not a rate."""

_WHOLE = re.compile(r"[0-9]{1,19}")


def read_bag(document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> list[Rate]:
    """Return the period of every topic that has enough messages; account for the others as ignored."""
    info: YamlMap = document["rosbag2_bagfile_information"]
    reader = _BagReader(file, findings)
    duration = reader.whole(reader.child(info, "duration", YamlMap), "nanoseconds", "bag")
    rates = []
    topics = reader.child(info, "topics_with_message_count", YamlList) or YamlList(info.line)
    for entry, line in zip(topics, topics.lines, strict=True):
        metadata = reader.child(entry, "topic_metadata", YamlMap, line)
        name = metadata.get("name") if metadata is not None else None
        if not isinstance(name, str):
            reader.malformed("topics_with_message_count", "an entry has no topic_metadata with a name", line)
            continue
        name = printable(name)
        count = reader.whole(entry, "message_count", f'topic "{name}"')
        if duration is None or count is None:
            continue
        at = Location(file, metadata.line_of("name") if metadata is not None else line)
        if count < FEWEST_MESSAGES or duration == 0:
            coverage.ignored("bag_topic", name, f"{count} messages in {Duration(duration)} make no rate", at)
        else:
            rates.append(Rate(topic=name, period=Duration(duration) / (count - 1), source=ROSBAG, at=at))
    return rates


class _BagReader:
    def __init__(self, file: str, findings: Findings) -> None:
        self._file = file
        self._findings = findings

    def malformed(self, path: str, text: str, line: int) -> None:
        self._findings.add(
            codes.MALFORMED(text, at=Location(self._file, line), path=path, help="run ros2 bag reindex on the bag")
        )

    def child(self, parent: Any, key: str, kind: type, line: int = 0) -> Any:
        """Return the mapping or sequence under `key`, or None with a finding."""
        value = parent.get(key) if isinstance(parent, YamlMap) else None
        if isinstance(value, kind):
            return value
        form = "mapping" if kind is YamlMap else "list"
        self.malformed(key, f"is missing or no {form}", parent.line_of(key) if isinstance(parent, YamlMap) else line)
        return None

    def whole(self, parent: Any, key: str, path: str) -> int | None:
        """Return a whole, non-negative number under `key`, or None with a finding."""
        if parent is None:
            return None
        value = parent.get(key)
        if isinstance(value, str) and _WHOLE.fullmatch(value):
            return int(value)
        shown = f'"{value}" is no' if key in parent else "is missing; it must be a"
        self._findings.add(
            codes.BAD_PERIOD(
                f"{key} {shown} whole number of at most 19 digits",
                at=Location(self._file, parent.line_of(key)),
                path=path,
                help="run ros2 bag reindex on the bag",
            )
        )
        return None
