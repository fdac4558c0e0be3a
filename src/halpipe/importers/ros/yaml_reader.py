"""Reader of the YAML of other tools: names become printable, keys have older names, and unknown keys are warnings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.settings import Fields
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.files import YamlMap


class Reader:
    """Reads values of one file and collects findings; what cannot be read comes back empty."""

    def __init__(
        self, file: str, findings: Findings, help: str = "repair the file or export it again with CARET"
    ) -> None:
        self.file = file
        self.findings = findings
        self._written = codes.MALFORMED, help

    def _fields(self, element: YamlMap, path: str, known: Sequence[str] = ()) -> Fields:
        keys = tuple(known)
        return Fields(self.file, self.findings, element, path, keys, written=self._written, unknown=codes.UNKNOWN_KEY)

    def at(self, element: YamlMap) -> Location:
        """Return the place of a mapping."""
        return Location(self.file, element.line)

    def malformed(self, text: str, line: int, path: str) -> None:
        """Report a value of the wrong form."""
        self.findings.add(codes.MALFORMED(text, at=Location(self.file, line), path=path, help=self._written[1]))

    def check_keys(self, element: YamlMap, path: str, known: Sequence[str]) -> None:
        """Report keys that nothing reads."""
        self._fields(element, path, known)

    def optional(self, element: YamlMap, key: str, path: str) -> str | None:
        """Return text under `key`, or None when the key is absent or null."""
        return self._fields(element, path).value(key, printable, None) or None

    def text(self, element: YamlMap, key: str, path: str, *aliases: str) -> str:
        """Return the text under `key` or the first alias present; report it when there is none."""
        found = next((name for name in (key, *aliases) if name in element), key)
        value = self.optional(element, found, path) or ""
        if not value and isinstance(element.get(found), str | None):
            self.malformed(f"{found} is missing or empty", element.line_of(found), path)
        return value

    def entries(self, element: YamlMap, key: str, path: str) -> list[YamlMap]:
        """Return the mappings listed under `key`; an absent or null list is empty."""
        return [entry.data for entry in self._fields(element, path).items(key, path=path)]

    def names(self, element: YamlMap, key: str, path: str) -> list[tuple[str, int]]:
        """Return the texts listed under `key` with their lines; one text stands for a list of one."""
        return [(name.value, name.at.line) for name in self._fields(element, path).texts(key, printable)]
