"""Bill of materials in CycloneDX 1.5: what halpipe needs at run time, by the metadata of the installed packages."""

from __future__ import annotations

import json
import platform
import re
import sys
from base64 import urlsafe_b64decode
from email.utils import getaddresses
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

from packaging.licenses import InvalidLicenseExpression, canonicalize_license_expression
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from halpipe import __version__
from halpipe.core.files import sha256

AUTHOR = "The halpipe authors"
FOR_DEVELOPERS = {"dev", "docs"}
"""Extras that no verb uses."""

HASH_RULE = (
    "The SHA-256 of a package is that of the lines `SHA-256  path` of its files, sorted by path: by its RECORD, "
    "without what the installer adds; of halpipe, by hashes.json."
)
_HOMES = ("homepage", "home", "source", "source code", "code", "repository", "github", "documentation")
"""Names of links to what a supplier says of a package, the most general first."""

_BY_INSTALLER = {"INSTALLER", "RECORD", "REQUESTED", "direct_url.json"}
_COMPILED = re.compile(r"\.(so|pyd|dll|dylib)(\.|$)")
_LONGEST_NAME = 100  # some packages have the text of the licence in the place of its name


def installed() -> dict[str, tuple[Distribution, list[str]]]:
    """Return halpipe and what it needs at run time, as far as installed, each with the names that it needs."""
    found: dict[str, tuple[Distribution, list[str]]] = {}
    wanted: dict[str, set[str]] = {}
    try:
        own = set(distribution("halpipe").metadata.get_all("Provides-Extra") or ()) - FOR_DEVELOPERS
    except PackageNotFoundError:
        return found
    waiting = [("halpipe", own)]
    while waiting:
        name, extras = waiting.pop()
        if name in wanted and extras <= wanted[name]:
            continue
        try:
            package = distribution(name)
        except PackageNotFoundError:
            continue
        wanted[name] = wanted.get(name, set()) | extras
        needs = _needs(package, wanted[name])
        found[name] = package, sorted({need for need, _ in needs})
        waiting += needs
    return {
        name: (package, [need for need in needs if need in found]) for name, (package, needs) in sorted(found.items())
    }


def _needs(package: Distribution, extras: set[str]) -> list[tuple[str, set[str]]]:
    """Return the names and extras that a package needs on this machine."""
    return [
        (canonicalize_name(need.name), need.extras)
        for need in map(Requirement, package.requires or ())
        if need.marker is None or any(need.marker.evaluate({"extra": extra}) for extra in {"", *extras})
    ]


def bill(hashes: dict[str, str], timestamp: str) -> dict[str, Any]:
    """Return the bill; `hashes` are those of halpipe's own files, and its number follows from its contents."""
    packages = installed()
    python = _python()
    parts = {name: _package(name, package) for name, (package, _) in packages.items() if name != "halpipe"}
    subject = {
        "type": "application",
        "bom-ref": f"pkg:pypi/halpipe@{__version__}",
        "supplier": {"name": AUTHOR},
        "name": "halpipe",
        "version": __version__,
        "licenses": [{"expression": "Apache-2.0"}],
        "purl": f"pkg:pypi/halpipe@{__version__}",
        **_hashed(hashes),
    }
    refs = {"halpipe": subject["bom-ref"]} | {name: part["bom-ref"] for name, part in parts.items()}
    graph = {refs[name]: [refs[need] for need in needs] for name, (_, needs) in packages.items()}
    graph[refs["halpipe"]] = [*graph.get(refs["halpipe"], ()), python["bom-ref"]]
    contents = {
        "metadata": {
            "timestamp": timestamp,
            "tools": {"components": [{"type": "application", "name": "halpipe", "version": __version__}]},
            "authors": [{"name": AUTHOR}],
            "component": subject,
            "properties": [{"name": "halpipe:hashes", "value": HASH_RULE}],
        },
        "components": [*parts.values(), python],
        "dependencies": [{"ref": ref, "dependsOn": needs} for ref, needs in graph.items()],
    }
    number = uuid5(NAMESPACE_URL, json.dumps(contents, sort_keys=True))
    return {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "serialNumber": f"urn:uuid:{number}",
        "version": 1,
    } | contents


def _package(name: str, package: Distribution) -> dict[str, Any]:
    purl = f"pkg:pypi/{name}@{package.version}"
    stated = (link.split(", ", 1) for link in package.metadata.get_all("Project-URL") or () if ", " in link)
    links = {name.casefold(): address for name, address in stated}
    home = _stated(package, "Home-page") or next((links[name] for name in _HOMES if name in links), "")
    return {
        "type": "library",
        "bom-ref": purl,
        "supplier": {"name": _supplier(package) or "not stated"} | ({"url": [home]} if home else {}),
        "name": name,
        "version": package.version,
        "licenses": _licenses(package),
        "purl": purl,
        **_hashed(_recorded(package)),
    }


def _supplier(package: Distribution) -> str:
    """Return the authors or maintainers that the metadata names, by their addresses where they have no names."""
    for field in ("Author", "Maintainer"):
        people = getaddresses(package.metadata.get_all(f"{field}-email") or [])
        found = _stated(package, field) or ", ".join(name or address for name, address in people)
        if found:
            return found
    return ""


def _stated(package: Distribution, field: str) -> str:
    return next(iter(package.metadata.get_all(field) or ()), "").strip()


def _licenses(package: Distribution) -> list[dict[str, Any]]:
    """Return the licence as an expression of SPDX if it is one, or else by what the metadata says about it."""
    said = _stated(package, "License-Expression") or _stated(package, "License")
    try:
        return [{"expression": canonicalize_license_expression(said)}]
    except InvalidLicenseExpression:
        classifiers = package.metadata.get_all("Classifier") or ()
        names = [line.rpartition(" :: ")[2] for line in classifiers if line.startswith("License :: ")]
        if said and len(said) <= _LONGEST_NAME and "\n" not in said:
            names = [said]
    names = names or [f"see {file}" for file in package.metadata.get_all("License-File") or ()] or ["not stated"]
    return [{"license": {"name": name}} for name in names]


def _recorded(package: Distribution) -> dict[str, str]:
    """Return the SHA-256 of the files of a package, by its RECORD: none where the installer wrote none."""
    return {
        file.as_posix(): urlsafe_b64decode(f"{file.hash.value}==").hex()
        for file in package.files or ()
        if file.hash and file.hash.mode == "sha256" and ".." not in file.parts and file.suffix != ".pyc"
        if not (file.name in _BY_INSTALLER and file.parent.suffix == ".dist-info")
    }


def _hashed(hashes: dict[str, str]) -> dict[str, Any]:
    """Return the hash of a package, and its compiled files as parts of it."""
    if not hashes:
        return {}
    lines = "".join(f"{digest}  {path}\n" for path, digest in sorted(hashes.items()))
    compiled = [
        {"type": "file", "name": path, "hashes": [{"alg": "SHA-256", "content": digest}]}
        for path, digest in sorted(hashes.items())
        if _COMPILED.search(path)
    ]
    found = {"hashes": [{"alg": "SHA-256", "content": sha256(lines.encode())}]}
    return found | ({"components": compiled} if compiled else {})


def _python() -> dict[str, Any]:
    """Return the interpreter, with the hash of its program."""
    name, program = sys.implementation.name, Path(sys.executable).resolve()
    purl = f"pkg:generic/{name}@{platform.python_version()}"
    known = name == "cpython"
    return {
        "type": "platform",
        "bom-ref": purl,
        "supplier": {"name": "Python Software Foundation" if known else "not stated"},
        "name": name,
        "version": platform.python_version(),
        "licenses": [{"expression": "Python-2.0.1"} if known else {"license": {"name": "not stated"}}],
        "hashes": [{"alg": "SHA-256", "content": sha256(program.read_bytes())}] if program.is_file() else [],
        "purl": purl,
    }
