"""Periods from rosbag2 recordings: duration / (messages - 1) of every topic in metadata.yaml, versions 1 to 9.

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
from halpipe.importers.ros.graph import Rate
from halpipe.importers.ros.yaml_reader import Reader

if TYPE_CHECKING:
    from halpipe.importers.common.base import Coverage

ROSBAG = "rosbag2 recording"
FEWEST_MESSAGES = 10
"""A handful of messages is a latched or an aperiodic topic, not a rate."""

_PARTS: dict[str, type] = {"duration": YamlMap, "topics_with_message_count": YamlList}
_VERSIONS = tuple(map(str, range(1, 10)))
_REINDEX = "run ros2 bag reindex on the bag"
_WHOLE = re.compile(r"[0-9]{1,19}")


def read_bag(document: YamlMap, file: str, findings: Findings, coverage: Coverage) -> list[Rate]:
    """Return the period of every topic that has enough messages; account for the others as ignored."""
    info: YamlMap = document["rosbag2_bagfile_information"]
    reader = Reader(file, findings, _REINDEX)
    lacking = [key for key, kind in _PARTS.items() if not isinstance(info.get(key), kind)]
    for key in lacking:
        reader.malformed(f"{key} is missing or has another form", info.line_of(key), "bag")
    if lacking:
        return []
    duration = _whole(reader, info["duration"], "nanoseconds", "bag")
    rates, counts = [], []
    for entry in reader.entries(info, "topics_with_message_count", "bag"):
        metadata = entry.get("topic_metadata")
        name = reader.optional(metadata, "name", "topic") if isinstance(metadata, YamlMap) else None
        if not isinstance(metadata, YamlMap) or name is None:
            reader.malformed("an entry has no topic_metadata with a name", entry.line, "topics_with_message_count")
            continue
        count = _whole(reader, entry, "message_count", f'topic "{name}"')
        counts.append(count)
        if duration is None or count is None:
            continue
        at = Location(file, metadata.line_of("name"))
        if count >= FEWEST_MESSAGES and duration:
            rates.append(Rate(topic=name, period=Duration(duration) / (count - 1), source=ROSBAG, at=at))
        elif (deadline := _deadline(metadata.get("offered_qos_profiles"), file)) is not None:
            rates.append(Rate(topic=name, period=deadline, source=DEADLINE, at=at))
        else:
            coverage.ignored("bag_topic", name, f"{count} messages in {Duration(duration)} make no rate", at)
    doubts = [] if str(info.get("version")) in _VERSIONS else [f'version "{info.get("version")}" is not known']
    total = str(sum(filter(None, counts)))
    if None not in counts and (stated := info.get("message_count", total)) != total:
        doubts.append(f"message_count is {stated}, and the topics have {total} messages")
    for doubt in doubts:
        findings.add(codes.ODD_BAG(doubt, at=reader.at(info), path="bag", help=_REINDEX))
    return rates


def _whole(reader: Reader, parent: YamlMap, key: str, path: str) -> int | None:
    """Return the whole, non-negative number under `key`, or None with a finding."""
    value = parent.get(key)
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value)
    shown = f'"{value}" is no' if key in parent else "is missing; it must be a"
    text, at = f"{key} {shown} whole number of at most 19 digits", Location(reader.file, parent.line_of(key))
    reader.findings.add(codes.BAD_PERIOD(text, at=at, path=path, help=_REINDEX))
    return None


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
