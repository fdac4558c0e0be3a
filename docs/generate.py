"""Writes the reference pages that are made from the code: ``make docs``, or ``python docs/generate.py``.

A page is a pure function of what the code declares, so that a test can hold the files on disk against it.
"""

from __future__ import annotations

import importlib
import pkgutil
import re
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

import halpipe
from halpipe.diagnostics import REGISTER, Exit

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.diagnostics import Code

REFERENCE = Path(__file__).parent / "reference"

GENERATED = "<!-- Made from the code by docs/generate.py; change it there and run `make docs`. -->"

RANGES = {
    "HAL00": "Files",
    "HAL01": "Documents and their schemas",
    "HAL02": "The task model: validate",
    "HAL03": "Schedules: verify",
    "HAL04": "The search for a schedule",
    "HAL05": "Import of ARXML",
    "HAL06": "Import of ROS graphs",
    "HAL07": "Overlays",
    "HAL08": "Exports",
    "HAL09": "The tool chain",
}

MEANINGS = {
    Exit.OK: "The work is done. Warnings and notes may have been reported.",
    Exit.FINDINGS: "The input has errors: a file that cannot be read, an invalid model, an invalid schedule.",
    Exit.USAGE: "The command line is wrong.",
    Exit.NOT_FOUND: "The search ended without a valid schedule. This does not mean that there is none.",
    Exit.INFEASIBLE: "It is proven that no valid schedule exists; the witness is in the diagnostics.",
    Exit.UNSUPPORTED: "Under `--strict`, the source has something that the importer would have left out.",
    Exit.INTERNAL: "A bug in halpipe. A report was saved; please send it.",
    Exit.INTERRUPTED: "Interrupted. The best result so far has been saved where the command saves results.",
}


def load_everything() -> None:
    """Import every module of the package, so that every code has registered itself."""
    for module in pkgutil.walk_packages(halpipe.__path__, "halpipe."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


def pages() -> dict[str, str]:
    """Return every generated page by its name in docs/reference."""
    load_everything()
    return {
        "diagnostics.md": diagnostics_page(),
        "checks.md": checks_page(),
        "exit-codes.md": exit_codes_page(),
    }


def _page(title: str, *paragraphs: str) -> str:
    return "\n\n".join((f"# {title}", GENERATED, *(p for p in paragraphs if p))) + "\n"


# ------------------------------------------------------------------------------------------------ diagnostics


def diagnostics_page() -> str:
    """Every diagnostic code, by number."""
    intro = (
        "Every message of halpipe carries one of these codes. An *error* stops the work, a *warning* should be looked "
        "at, a *note* says what was done or assumed. A message names the file and line, the element, and what to do."
    )
    parts = [intro]
    reporters = _reporters()
    codes = [REGISTER[id] for id in sorted(REGISTER)]
    for prefix, group in groupby(codes, key=lambda code: code.id[:5]):
        parts.append(f"## {RANGES.get(prefix, 'Further diagnostics')}: {prefix}xx")
        parts += (_code(code, reporters.get(code.id, ())) for code in group)
    return _page("Diagnostics", *parts)


def _code(code: Code, checks: Iterable[str]) -> str:
    text = f"### {code.id}\n\n**{_escaped(code.title)}** ({code.severity}).\n{_escaped(code.explanation)}".rstrip()
    names = ", ".join(f"`{name}`" for name in checks)
    return f"{text}\n\nReported by the check {names}." if names else text


def _escaped(text: str) -> str:
    """Keep Markdown from taking tags for markup, except inside code spans."""
    return "".join(part if part.startswith("`") else part.replace("<", "&lt;") for part in re.split(r"(`[^`]*`)", text))


def _reporters() -> dict[str, list[str]]:
    """Return the names of the checks that report a code."""
    from halpipe.pipeline.validate import CHECKS

    reporters: dict[str, list[str]] = {}
    for check in CHECKS:
        for code in check.codes:
            reporters.setdefault(code.id, []).append(check.name)
    return reporters


# ------------------------------------------------------------------------------------------------ checks


def checks_page() -> str:
    """What validate and verify check, one sentence each."""
    from halpipe.pipeline.validate import CHECKS
    from halpipe.pipeline.verify import RULES

    checks = (
        f"| `{check.name}` | {check.sentence} | {' '.join(_link(code.id) for code in check.codes)} |"
        for check in CHECKS
    )
    rules = (f"| `{rule.name}` | {rule.sentence} |" for rule in RULES)
    return _page(
        "Checks",
        "## The model: `halpipe validate`",
        "Every check is made, and every finding reported. Only errors keep a model from being scheduled.",
        "\n".join(("| check | what holds | codes |", "|---|---|---|", *checks)),
        "## The schedule: `halpipe verify`",
        "A schedule is valid if and only if every rule holds. The checker shares no code with the search.",
        "\n".join(("| rule | what holds |", "|---|---|", *rules)),
    )


def _link(code: str) -> str:
    return f"[{code}](diagnostics.md#{code.lower()})"


# ------------------------------------------------------------------------------------------------ exit codes


def exit_codes_page() -> str:
    """The exit codes of every command."""
    rows = (f"| {int(code)} | {code.name.lower().replace('_', ' ')} | {MEANINGS[code]} |" for code in Exit)
    return _page(
        "Exit codes",
        "The same for every command, so that scripts can tell the cases apart.",
        "\n".join(("| code | name | meaning |", "|---|---|---|", *rows)),
    )


def main() -> None:
    """Write the pages."""
    REFERENCE.mkdir(exist_ok=True)
    for name, text in pages().items():
        (REFERENCE / name).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
