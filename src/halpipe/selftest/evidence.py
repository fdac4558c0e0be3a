"""Folder of evidence for the argument of a tool's confidence, with the same bytes whenever it is made again."""

from __future__ import annotations

import json
import platform
import re
import sys
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core import programs
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import sha256
from halpipe.core.records import record
from halpipe.selftest import confidence, second
from halpipe.selftest.bill import bill, installed
from halpipe.selftest.requirements import NO_RUN, PACKAGE, ROOT, Results, requirements

if TYPE_CHECKING:
    from halpipe.selftest.run import Outcome

CPUINFO = Path("/proc/cpuinfo")
WALK = "assessor.md"
ARGUMENTS = ("common-causes.md", "known-malfunctions.md")
FIGURES = "figures.md"


@record
class Commit:
    """The commit of a checkout with its `moment` in seconds since 1970, and whether files differ from it."""

    id: str
    moment: int
    changed: bool


def folder(outcome: Outcome, mutants: int, seed: int, results: Results = NO_RUN) -> dict[str, bytes]:
    """Return the files of the evidence with the manifest that seals them."""
    commit, hashes = _commit(), _hashes()
    values = {
        "environment.json": _environment(commit),
        "requirements.json": {"results": results.files, "requirements": requirements(results)},
        "validation.json": _validation(outcome, mutants, seed),
        "sbom.cdx.json": bill(hashes, _timestamp(commit)),
        "hashes.json": hashes,
    }
    files = arguments() | {FIGURES: second.path(FIGURES).read_bytes()}
    files |= {name: (json.dumps(value, indent=1) + "\n").encode() for name, value in values.items()}
    files[WALK] = _walk(second.path(WALK).read_text(encoding="utf-8"), _summary(values, outcome)).encode()
    return seal("evidence", files, {"halpipe": __version__})


def _summary(values: dict[str, Any], outcome: Outcome) -> dict[str, str]:
    """Return the result of each file in a few words."""
    tool, python = values["environment.json"]["tool"], values["environment.json"]["python"]
    commit = f"commit {tool['commit'][:12]}" if tool["commit"] else "no checkout"
    changed = ", files differ from it" if values["environment.json"]["changed since the commit"] else ""
    counts = Counter(entry["result"] for entry in values["requirements.json"]["requirements"])
    levels = Counter(use.level for use in confidence.USES)
    judged, rules = outcome.valid + outcome.broken, len(outcome.alone)
    shown = f"{rules - len(outcome.unseen)} of {rules} rules alone refuse a schedule"
    return {
        "environment.json": f"halpipe {tool['version']}, {commit}{changed}, Python {python['version']}",
        "requirements.json": f"{counts.total()} requirements: {_counted(counts)}",
        "validation.json": f"{judged} schedules, {len(outcome.differing)} disagreements; {shown}",
        "sbom.cdx.json": f"{len(values['sbom.cdx.json']['components'])} components",
        "hashes.json": f"{len(values['hashes.json'])} files",
        "tool-confidence.md": f"{levels.total()} uses: {_counted(levels)}",
        "known-malfunctions.md": f"{second.path('known-malfunctions.md').read_bytes().count(b'| K')} entries",
    }


def _counted(counts: Counter[str]) -> str:
    return ", ".join(f"{count} {name}" for name, count in sorted(counts.items()))


def _walk(page: str, summary: dict[str, str]) -> str:
    """Return the page for assessors with the results of the files that each row names."""
    lines = []
    for line in page.splitlines():
        found = [f"{name}: {summary[name]}" for name in re.findall("`([^`]+)`", line) if name in summary]
        if line.startswith("|"):
            cell = " result |" if line.startswith("| clause") else "---|" if line.startswith("|-") else None
            line += cell or f" {'; '.join(found)} |"
        lines.append(line)
    return "\n".join((*lines, ""))


def arguments() -> dict[str, bytes]:
    """Return what does not depend on the machine: uses and confidence, common causes, known malfunctions."""
    texts = {name: second.path(name).read_bytes() for name in ARGUMENTS}
    return texts | {"tool-confidence.md": confidence.table().encode()}


def _environment(commit: Commit | None) -> dict[str, Any]:
    return {
        "tool": {"name": "halpipe", "version": __version__, "commit": commit and commit.id},
        "changed since the commit": commit and commit.changed,
        "python": {"implementation": sys.implementation.name, "version": platform.python_version()},
        "system": {
            "name": platform.system(),
            "release": platform.release(),
            "machine": platform.machine(),
            "byteorder": sys.byteorder,
            "C library": " ".join(platform.libc_ver()).strip(),
            "processor": _processor(),
        },
        "packages": {name: package.version for name, (package, _) in installed().items()},
    }


def _processor() -> str:
    """Return the models of the processor by Linux, or what Python knows about it."""
    try:
        lines = CPUINFO.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []
    models = {line.partition(":")[2].strip() for line in lines if line.startswith("model name")}
    return ", ".join(sorted(models)) or platform.processor()


def _commit() -> Commit | None:
    """Return the commit of a checkout; None where halpipe is no checkout, or git does not answer."""
    if not (ROOT / ".git").exists():
        return None
    git = ["git", "--no-optional-locks", "-C", str(ROOT)]
    try:
        shown = programs.run([*git, "show", "-s", "--format=%H %ct", "HEAD"])
        status = programs.run([*git, "status", "--porcelain"])
    except HalpipeError:
        return None
    if shown.returncode or status.returncode:
        return None
    id, moment = shown.stdout.split()
    return Commit(id, int(moment), bool(status.stdout.strip()))


def _timestamp(commit: Commit | None) -> str:
    """Return the moment of the bill, the same at each repetition: that of the commit, or of the installation."""
    seconds = commit.moment if commit else int(Path(__file__).stat().st_mtime)
    return datetime.fromtimestamp(seconds, UTC).strftime("%Y-%m-%dT%H:%M:%SZ")


def _validation(outcome: Outcome, mutants: int, seed: int) -> dict[str, Any]:
    return {
        "command": f"halpipe selftest --mutants {mutants} --seed {seed}",
        "second checker": {"sha256": sha256(second.path().read_bytes())},
        "schedules": outcome.valid + outcome.broken,
        "valid": outcome.valid,
        "not valid": outcome.broken,
        "disagreements": outcome.differing,
        "refused by one rule alone": outcome.alone,
        "by fault": {
            fault: {"not valid": broken, "valid": valid} for fault, (broken, valid) in sorted(outcome.by_fault.items())
        },
    }


def _hashes() -> dict[str, str]:
    """Return the SHA-256 of every file of the package, compiled ones left out."""
    files = (path for path in sorted(PACKAGE.rglob("*")) if path.is_file() and "__pycache__" not in path.parts)
    return {path.relative_to(PACKAGE).as_posix(): sha256(path.read_bytes()) for path in files}
