"""Typed access to parsed YAML: every missing or wrong value becomes a finding with its line."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.files import YamlList, YamlMap
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.graph import printable

if TYPE_CHECKING:
    from collections.abc import Sequence


class Reader:
    """Reads values of one file and collects findings; what cannot be read comes back empty."""

    def __init__(
        self, file: str, findings: Findings, help: str = "repair the file or export it again with CARET"
    ) -> None:
        self.file = file
        self.findings = findings
        self._help = help

    def at(self, element: YamlMap) -> Location:
        """Return the place of a mapping."""
        return Location(self.file, element.line)

    def malformed(self, text: str, line: int, path: str) -> None:
        """Report a value of the wrong form."""
        self.findings.add(codes.MALFORMED(text, at=Location(self.file, line), path=path, help=self._help))

    def check_keys(self, element: YamlMap, path: str, known: Sequence[str]) -> None:
        """Report keys that nothing reads."""
        for key in element:
            if key not in known:
                help = did_you_mean(key, known, "remove it if it is a slip")
                at = Location(self.file, element.line_of(key))
                self.findings.add(codes.UNKNOWN_KEY(f'key "{key}" is not read', at=at, path=path, help=help))

    def optional(self, element: YamlMap, key: str, path: str) -> str | None:
        """Return text under `key`, or None when the key is absent or null."""
        value = element.get(key)
        if value is None or isinstance(value, str):
            return printable(value or "") or None
        self.malformed(f"{key} is not plain text", element.line_of(key), path)
        return None

    def text(self, element: YamlMap, key: str, path: str, *aliases: str) -> str:
        """Return the text under `key` or the first alias present; report it when there is none."""
        found = next((name for name in (key, *aliases) if name in element), key)
        value = self.optional(element, found, path)
        if value is None and not isinstance(element.get(found), list | dict | bool):
            self.malformed(f"{found} is missing or empty", element.line_of(found), path)
        return value or ""

    def entries(self, element: YamlMap, key: str, path: str) -> list[YamlMap]:
        """Return the mappings listed under `key`; an absent or null list is empty."""
        return [item for item, line in self._items(element, key, path) if self._is_map(item, key, line, path)]

    def names(self, element: YamlMap, key: str, path: str) -> list[tuple[str, int]]:
        """Return the texts listed under `key` with their lines; one text stands for a list of one."""
        if isinstance(element.get(key), str):
            return [(printable(element[key]), element.line_of(key))]
        found = []
        for item, line in self._items(element, key, path):
            if isinstance(item, str):
                found.append((printable(item), line))
            else:
                self.malformed(f"{key} lists something that is not plain text", line, path)
        return found

    def _items(self, element: YamlMap, key: str, path: str) -> list[tuple[Any, int]]:
        value = element.get(key)
        if value is None:
            return []
        if isinstance(value, YamlList):
            return list(zip(value, value.lines, strict=True))
        self.malformed(f"{key} is not a list", element.line_of(key), path)
        return []

    def _is_map(self, item: Any, key: str, line: int, path: str) -> bool:
        if isinstance(item, YamlMap):
            return True
        self.malformed(f"{key} lists something that is not a mapping", line, path)
        return False
