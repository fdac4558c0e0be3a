"""``halpipe doctor``."""

from __future__ import annotations

import platform
import shutil

from halpipe import __version__
from halpipe.cli import output
from halpipe.cli.answers import AnswerFormat, Answers, print_json
from halpipe.core.diagnostics import Exit

PACKAGES = ("lxml", "xmlschema", "pyyaml", "jinja2", "typer", "rich", "graphviz", "packaging")
EXTRAS = {
    "autosar-data": "halpipe[arxml]",
    "ortools": "halpipe[exact]",
    "openpyxl": "halpipe[table]",
    "matplotlib": "halpipe[plot]",
    "distributed": "halpipe[cluster]",
    "starlette": "halpipe[serve]",
    "uvicorn": "halpipe[serve]",
    "ziglang": "halpipe[riscv]",
    "pyelftools": "halpipe[riscv]",
    "unicorn": "halpipe[riscv]",
    "numpy": "halpipe[riscv]",
}
PROGRAMS = {
    "dot": "apt-get install graphviz",
    "verilator": "apt-get install verilator g++ make",
    "iverilog": "apt-get install iverilog",
    "qemu-system-riscv64": "apt-get install qemu-system-misc",
    "riscv64-unknown-elf-gcc": "apt-get install gcc-riscv64-unknown-elf",
}


def doctor(format: Answers = AnswerFormat.TEXT) -> int:
    """Say what is installed, what is missing, and how to get it."""
    from halpipe.flow.formats import DEPLOYMENTS, EXPORTERS, IMPORTERS, formats

    if format is AnswerFormat.JSON:
        packages = {name: _version(name) or None for name in (*PACKAGES, *EXTRAS)}
        print_json(
            {
                "halpipe": __version__,
                "python": platform.python_version(),
                "system": f"{platform.system()} {platform.machine()}",
                "packages": packages,
                "programs": {name: shutil.which(name) is not None for name in PROGRAMS},
                "importers": formats(IMPORTERS),
                "exporters": formats(EXPORTERS),
                "bundles": formats(DEPLOYMENTS),
            }
        )
        return Exit.OK if all(packages[name] for name in PACKAGES) else Exit.FINDINGS
    output.result(
        f"halpipe {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}"
    )
    missing = False
    for name in PACKAGES:
        found = _version(name)
        missing = missing or not found
        output.result(f"  {name} {found or f'MISSING: pip install {name}'}")
    for name, extra in EXTRAS.items():
        output.result(f"  {name} {_version(name) or f'not installed (optional): pip install {extra}'}")
    for name, install in PROGRAMS.items():
        output.result(f"  {name}: {'found' if shutil.which(name) else f'not found (optional): {install}'}")
    output.result(f"  importers: {', '.join(formats(IMPORTERS))}")
    output.result(f"  exporters: {', '.join(formats(EXPORTERS))}")
    output.result(f"  bundles: {', '.join(formats(DEPLOYMENTS))}")
    return Exit.FINDINGS if missing else Exit.OK


def _version(name: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(name)
    except PackageNotFoundError:
        return ""
