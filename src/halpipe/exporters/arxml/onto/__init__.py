"""A schedule put onto the project that its model was imported from.

A merge of ARXML files can add to a project, but neither change nor remove; so there are three outputs: `delta` has
what is added, `edit` changes values in the project's own files and leaves every other byte, `changes` lists both.
`plan` decides what each expiry point does.
"""

from __future__ import annotations

from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from halpipe.core.diagnostics import Diagnostic

DELTA, CHANGES = "delta.arxml", "changes.json"


@record
class Change:
    """One value that is added (`old` None) or changed: where it stands, its container, its name; `new` None: not set.

    `name` is empty where the container itself is added or removed.
    """

    file: str
    path: str
    name: str
    old: str | None
    new: str | None


@record
class Onto:
    """The folder to write by relative names, all `additions` as one delta, the changes, and what users have to know.

    Additions to project data of EB tresos are in the changed files, and not in the delta of the folder.
    """

    files: dict[str, bytes]
    additions: bytes
    changes: tuple[Change, ...]
    findings: tuple[Diagnostic, ...]

    @property
    def summary(self) -> list[Change]:
        """The changes for people: a new container stands for all that is in it."""
        new = {change.path for change in self.changes if not change.name and change.old is None}
        return [c for c in self.changes if new.isdisjoint(map(str, PurePosixPath(f"{c.path}/{c.name}").parents))]
