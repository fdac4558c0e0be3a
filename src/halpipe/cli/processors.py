"""Number of processors of this process: its affinity, within the quota of its container."""

from __future__ import annotations

import os
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator

GROUPS = Path("/sys/fs/cgroup")
MEMBERSHIP = Path("/proc/self/cgroup")


def processor_count() -> int:
    """Return the number of processors that are worth a thread each, at least 1."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([allowed, *quotas()]))


def quotas() -> Iterator[int]:
    """Yield the limits that control groups set on processor time, in processors, rounded up.

    A group is bounded by those above it too. In a container, the path of the group may be the host's, while the files
    of the group itself lie at the root; both places are looked at.
    """
    for line in _text(MEMBERSHIP).splitlines():
        number, _, rest = line.partition(":")
        controllers, _, path = rest.partition(":")
        if number == "0" and not controllers:
            yield from filter(None, (_quota_v2(folder) for folder in _folders(GROUPS, path)))
        elif "cpu" in controllers.split(","):
            for name in (controllers, "cpu"):
                yield from filter(None, (_quota_v1(folder) for folder in _folders(GROUPS / name, path)))


def _folders(root: Path, path: str) -> Iterator[Path]:
    """Yield the folder of a group, of those above it, and the root."""
    inside = PurePosixPath(path.lstrip("/"))
    if ".." not in inside.parts:
        yield from (root / part for part in (inside, *inside.parents))


def _quota_v2(folder: Path) -> int | None:
    quota, _, period = _text(folder / "cpu.max").strip().partition(" ")
    return _processors(quota, period)


def _quota_v1(folder: Path) -> int | None:
    return _processors(_text(folder / "cpu.cfs_quota_us").strip(), _text(folder / "cpu.cfs_period_us").strip())


def _processors(quota: str, period: str) -> int | None:
    """Return a quota in processors; None where there is none: v2 says "max", v1 -1."""
    if not (quota.isdecimal() and period.isdecimal() and int(period)):
        return None
    return -(-int(quota) // int(period))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""
