"""Bundles: folders that are loaded onto a target and stand alone, sealed by a manifest with the hash of every file.

A bundle carries the model and the schedule that it realises, so that the folder alone is enough to check it.
"""

from __future__ import annotations

import json
import re
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, Findings, HalpipeError, Location, error
from halpipe.core.files import (
    MANIFEST,
    MANIFEST_KEY,
    Number,
    YamlMap,
    is_folder_without,
    parse_json,
    read_plain,
    sha256,
)
from halpipe.core.records import record
from halpipe.core.settings import Fields

if TYPE_CHECKING:
    from collections.abc import Mapping

NOT_A_BUNDLE = error(
    "HAL1001",
    "Folder is no bundle",
    f'A bundle is a folder with a {MANIFEST} that has "halpipe-bundle": 1, a kind, and the SHA-256 of every file.',
)
CHANGED_FILE = error(
    "HAL1002",
    "File of a bundle is not the one that was exported",
    "The file is missing or its SHA-256 is another than the manifest states: it was edited, damaged or mixed up. "
    "Nothing is concluded from such a bundle.",
)

VERSION = 1
MODEL = "model.xml"
SCHEDULE = "schedule.xml"
_HELP = "name a folder that `halpipe export` regulator, riscv, linux, or arxml --onto, wrote"
_SAFE_NAME = re.compile(r"(?![. ])[A-Za-z0-9_.+@~%= -]+(/(?![. ])[A-Za-z0-9_.+@~%= -]+)*")


@record
class Bundle:
    """A bundle on disk: its `kind`, the `facts` of its manifest, and its files as they were sealed."""

    path: str
    kind: str
    facts: YamlMap
    files: Mapping[str, bytes]

    def at(self, name: str, line: int = 0) -> Location:
        """Return the place of a file of the bundle, for diagnostics."""
        return Location(f"{self.path}/{name}", line)

    def fields(self, findings: Findings, keys: tuple[str, ...] = ()) -> Fields:
        """Return the facts for typed access; those that are not among the `keys` of the kind, if any, are reported."""
        return Fields(self.at(MANIFEST).file, findings, self.facts, "", keys, written=(NOT_A_BUNDLE, _HELP))


def seal(kind: str, files: Mapping[str, bytes], facts: Mapping[str, Any]) -> dict[str, bytes]:
    """Return `files` with the manifest that seals them; `facts` are what a reader needs first, JSON values only."""
    assert all(_SAFE_NAME.fullmatch(name) and name != MANIFEST for name in files), "names of a bundle are relative"
    manifest = {
        MANIFEST_KEY: VERSION,
        "kind": kind,
        **facts,
        "files": {name: sha256(files[name]) for name in sorted(files)},
    }
    text = json.dumps(manifest, indent=1, ensure_ascii=True) + "\n"
    return {MANIFEST: text.encode(), **{name: files[name] for name in sorted(files)}}


def open_bundle(path: str) -> Bundle:
    """Read a bundle and hold every file against the manifest; raise `HalpipeError` with all that differ."""
    folder = path.rstrip("/") or path
    manifest = _manifest(folder)
    listed: dict[str, str] = manifest["files"]
    findings = Findings()
    files = {}
    for name, stated in listed.items():
        content = _content(folder, name, stated, findings)
        if content is not None:
            files[name] = content
    findings.stop_on_errors()
    kind = manifest.pop("kind")
    del manifest[MANIFEST_KEY], manifest["files"]
    return Bundle(folder, kind, manifest, files)


def _manifest(folder: str) -> YamlMap:
    name = f"{folder}/{MANIFEST}"
    if is_folder_without(folder, MANIFEST):
        raise HalpipeError(_no_bundle(name, "the folder has no such file"))
    try:
        manifest = parse_json(read_plain(name))
    except ValueError as failure:
        raise HalpipeError(_no_bundle(name, f"the manifest {failure}")) from None
    version = manifest.get(MANIFEST_KEY) if isinstance(manifest, YamlMap) else None
    if not isinstance(manifest, YamlMap) or not isinstance(version, Number) or version != str(VERSION):
        raise HalpipeError(_no_bundle(name, f'it does not state "halpipe-bundle": {VERSION}'))
    listed = manifest.get("files")
    if type(manifest.get("kind")) is not str or not isinstance(listed, YamlMap):
        raise HalpipeError(_no_bundle(name, 'it lacks "kind" or "files"'))
    unsafe = [entry for entry in listed if not _SAFE_NAME.fullmatch(entry) or type(listed[entry]) is not str]
    if unsafe:
        raise HalpipeError(*(_no_bundle(name, f"it lists {entry[:60]!r}, which is no file inside") for entry in unsafe))
    lacking = [entry for entry in (MODEL, SCHEDULE) if entry not in listed]
    if lacking:
        raise HalpipeError(*(_no_bundle(name, f"it lists no {entry}") for entry in lacking))
    return manifest


def _no_bundle(name: str, message: str) -> Diagnostic:
    return NOT_A_BUNDLE(message, at=Location(name), help=_HELP)


def _content(folder: str, name: str, stated: str, findings: Findings) -> bytes | None:
    """Return a file as it was sealed; otherwise collect what is wrong with it."""
    try:
        content = read_plain(f"{folder}/{name}")
    except HalpipeError as failure:
        findings.extend(failure.diagnostics)
        return None
    found = sha256(content)
    if found == stated:
        return content
    message = f"SHA-256 is {found[:16]}..., the manifest states {stated[:16]}..."
    help = "export the bundle again; edit the model or its sources, not the bundle"
    findings.add(CHANGED_FILE(message, at=Location(f"{folder}/{name}"), help=help))
    return None
