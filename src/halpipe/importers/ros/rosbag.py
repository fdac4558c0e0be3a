"""Periods from rosbag2 recordings: duration / (messages - 1) of every topic in metadata.yaml, versions 4 to 9.

Where too few messages were recorded for a rate, a deadline that the publishers offered (QoS) stands in for it. The
profiles are YAML within a text, or, in newer versions, plain lists.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import ZERO, Duration, seconds
from halpipe.core.files import YamlList, YamlMap, parse_yaml
from halpipe.importers.ros import codes
from halpipe.importers.ros.dot import DEADLINE, NO_DEADLINE
from halpipe.importers.ros.graph import Rate, printable

if TYPE_CHECKING:
    from halpipe.importers.common.base import Coverage

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
        if count >= FEWEST_MESSAGES and duration:
            rates.append(Rate(topic=name, period=Duration(duration) / (count - 1), source=ROSBAG, at=at))
        elif (deadline := _deadline(metadata.get("offered_qos_profiles"), file)) is not None:
            rates.append(Rate(topic=name, period=deadline, source=DEADLINE, at=at))
        else:
            coverage.ignored("bag_topic", name, f"{count} messages in {Duration(duration)} make no rate", at)
    return rates


def _deadline(profiles: Any, file: str) -> Duration | None:
    """Return the shortest finite deadline among QoS profiles; whatever else stands there is of no use."""
    if isinstance(profiles, str):
        try:
            profiles = parse_yaml(profiles.encode(), file)
        except HalpipeError:
            return None
    found = []
    for profile in profiles if isinstance(profiles, YamlList) else ():
        stated = profile.get("deadline") if isinstance(profile, YamlMap) else None
        sec, nsec = (str(stated.get(key)) for key in ("sec", "nsec")) if isinstance(stated, YamlMap) else ("", "")
        if _WHOLE.fullmatch(sec) and _WHOLE.fullmatch(nsec):
            deadline = seconds(int(sec)) + Duration(int(nsec))
            found += [deadline] if ZERO < deadline < NO_DEADLINE else []
    return min(found, default=None)


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
