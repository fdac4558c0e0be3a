"""The folder of evidence: what the argument of a tool's confidence needs, the same bytes whenever it is made again."""

from __future__ import annotations

import json
import platform
import re
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe import __version__
from halpipe.core import programs
from halpipe.core.bundles import seal
from halpipe.core.diagnostics import REGISTER, HalpipeError
from halpipe.core.files import sha256
from halpipe.core.records import record
from halpipe.selftest import confidence, second
from halpipe.selftest.bill import bill, installed

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.selftest.run import Outcome

PACKAGE = Path(__file__).parents[1]
ROOT = PACKAGE.parents[1]
TESTS = ROOT / "tests"
CPUINFO = Path("/proc/cpuinfo")
ARGUMENTS = Path(__file__).with_name("arguments")
_CODE = re.compile(rb"HAL\d{4}")


@record
class Commit:
    """The commit of a checkout with its `moment` in seconds since 1970, and whether files differ from it."""

    id: str
    moment: int
    changed: bool


def folder(outcome: Outcome, mutants: int, seed: int) -> dict[str, bytes]:
    """Return the files of the evidence with the manifest that seals them."""
    commit, hashes = _commit(), _hashes()
    files = {
        **arguments(),
        "environment.json": _json(_environment(commit)),
        "requirements.json": _json(list(_requirements())),
        "validation.json": _json(_validation(outcome, mutants, seed)),
        "sbom.cdx.json": _json(bill(hashes, _timestamp(commit))),
        "hashes.json": _json(hashes),
    }
    return seal("evidence", files, {"halpipe": __version__})


def arguments() -> dict[str, bytes]:
    """Return what does not depend on the machine: uses and confidence, common causes, known problems."""
    texts = {path.name: path.read_bytes() for path in sorted(ARGUMENTS.glob("*.md"))}
    return texts | {"tool-confidence.md": confidence.table().encode()}


def argument_hash() -> str:
    """Return one hash of the arguments: of the hashes of its files, by name."""
    return sha256("".join(f"{sha256(text)}  {name}\n" for name, text in sorted(arguments().items())).encode())


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, ensure_ascii=True) + "\n").encode()


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


def _requirements() -> Iterator[dict[str, Any]]:
    """Yield every rule and check with its sentence, and the tests that name it or one of its codes."""
    from halpipe.pipeline.validate import CHECKS
    from halpipe.pipeline.verify import RULES

    naming = _tests()
    for rule in RULES:
        id = f"verify/{rule.name}"
        module = str(rule.check.__module__)
        codes = sorted({code for code in REGISTER if code.startswith("HAL03")} & _codes_of(module))
        yield {"id": id, "text": rule.sentence, "check": module, "codes": codes, "tests": _of(codes, naming)}
    for check in CHECKS:
        codes = [code.id for code in check.codes]
        module = str(check.run.__module__)
        yield {
            "id": f"validate/{check.name}", "text": check.sentence, "check": module, "codes": codes,
            "tests": _of(codes, naming),
        }  # fmt: skip


def _codes_of(module: str) -> set[str]:
    """Return the codes that a module of verify reports: the constants of `codes` that it names."""
    from halpipe.pipeline.verify import codes

    source = PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py").read_text(encoding="utf-8")
    return {getattr(codes, name).id for name in re.findall(r"codes\.([A-Z_]+)", source) if hasattr(codes, name)}


def _of(codes: list[str], naming: dict[str, list[str]]) -> list[str]:
    return sorted({test for code in codes for test in naming.get(code, ())})


def _tests() -> dict[str, list[str]]:
    """Return, for each code, the tests and fixtures that name it; none where they are not installed."""
    names = {code.id: name for name, code in _constants()}
    naming: dict[str, list[str]] = {}
    files = [path for path in TESTS.rglob("*") if path.name.startswith(("test_", "HAL")) and path.suffix != ".pyc"]
    for path in sorted(file for file in files if file.is_file()):
        text = path.read_bytes()
        spelled = {found.decode() for found in _CODE.findall(path.name.encode() + text)}
        words = set(re.findall(rb"\b[A-Z][A-Z_]{3,}\b", text))
        for id in REGISTER:
            if id in spelled or names.get(id, "?").encode() in words:
                naming.setdefault(id, []).append(path.relative_to(TESTS.parent).as_posix())
    return naming


def _constants() -> Iterator[tuple[str, Any]]:
    from halpipe.pipeline.validate import codes as validate
    from halpipe.pipeline.verify import codes as verify

    for module in (validate, verify):
        yield from ((name, code) for name, code in vars(module).items() if getattr(code, "id", "") in REGISTER)


def _validation(outcome: Outcome, mutants: int, seed: int) -> dict[str, Any]:
    return {
        "command": f"halpipe selftest --mutants {mutants} --seed {seed}",
        "second checker": {"sha256": sha256(second.path().read_bytes())},
        "schedules": mutants,
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
