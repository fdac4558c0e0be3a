"""Builds the libraries in C and the JSON schemas when halpipe is installed or made into a wheel: hatchling calls it.

For a wheel of another system, set HALPIPE_TARGET to a name in `build_native.TARGETS`, as ``make wheels`` does. For a
package index, set HALPIPE_SOURCE to the address at which the sources of the version can be read, as a release does.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

sys.path.insert(0, str(Path(__file__).parent))

import build_native

EXAMPLES = ("roboracer", "platforms")
"""Folders that ``halpipe new --example`` copies."""

SAFETY = ("second_checker.py", "assessor.md", "common-causes.md", "figures.md", "known-malfunctions.md")
"""Files of docs/safety that ``halpipe selftest`` uses."""

MADE = {"out", "__pycache__"}
"""Folders in them that running an example makes."""


_LINK = re.compile(r"(!?)\[([^]]*)\]\((?![a-z]+:|#)([^)\s]+)\)")
"""A link or picture of Markdown that leads to a file beside the page."""


class Description(MetadataHookInterface):
    """The README as the description of the package, with links that lead somewhere on the page of an index."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Add the description, and the addresses of the sources where they are stated."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        if source := os.environ.get("HALPIPE_SOURCE", ""):
            text = with_absolute_links(text, source)
            pages = {"Source": "", "Documentation": "/docs/index.md", "Changelog": "/CHANGELOG.md"}
            metadata["urls"] = {name: source + page for name, page in pages.items()}
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def with_absolute_links(text: str, source: str) -> str:
    """Return Markdown whose links to files beside it lead to the sources at an address."""

    def absolute(link: re.Match[str]) -> str:
        picture, words, place = link.groups()
        return f"{picture}[{words}]({source}/{place}{'?raw=true' if picture else ''})"

    return _LINK.sub(absolute, text)


class Libraries(BuildHookInterface[Any]):
    """Puts the libraries into the wheel, and the name of the system into that of the wheel."""

    _made: Path | None = None

    def dependencies(self) -> list[str]:
        """Return what must be installed to build: nothing where there is a compiler that works."""
        needs_zig = self.target_name == "wheel" and (_target() or not build_native.own_compiler())
        return [build_native.ZIG] if needs_zig else []

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build for a wheel, or in place for an editable installation."""
        if self.target_name != "wheel":
            return
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{build_native.tag(_target())}"
        if version == "editable":
            build_native.in_place()
            return
        self._made = Path(tempfile.mkdtemp())
        made = build_native.build(self._made, _target()) | build_native.write_schemas(self._made)
        build_data["force_include"].update({str(path): place for place, path in made.items()})
        for name in SAFETY:
            build_data["force_include"][str(Path(self.root, "docs", "safety", name))] = f"halpipe/selftest/{name}"
        examples = Path(self.root, "examples")
        for path in sorted(path for example in EXAMPLES for path in Path(examples, example).rglob("*")):
            place = path.relative_to(examples)
            if path.is_file() and not MADE & set(place.parts):
                build_data["force_include"][str(path)] = f"halpipe/examples/{place.as_posix()}"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what the wheel has a copy of."""
        if self._made is not None:
            shutil.rmtree(self._made, ignore_errors=True)


def _target() -> str:
    return os.environ.get("HALPIPE_TARGET", "")
