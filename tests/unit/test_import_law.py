"""The import law of the architecture: who may import whom, who may touch the world, and what is imported late.

The tables are the law; docs/explanation/architecture.md gives the reasons.
"""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest

import halpipe

SOURCE = Path(halpipe.__file__).parent

# A form of classes, as much a part of the language as `dataclasses`.
EVERYWHERE = {"core.records"}

# Part of the package -> the parts it may import besides itself. The longest matching name rules.
MAY_IMPORT = {
    "core": set(),
    # Within the foundation, too, arrows have one direction.
    "core.records": set(),
    "core.quantities": set(),
    "core.durations": {"core.quantities"},
    "core.suggest": set(),
    "core.diagnostics": set(),
    "core.files": {"core.diagnostics", "core.suggest"},
    "core.settings": {"core.diagnostics", "core.files", "core.quantities", "core.suggest"},
    "core.options": {
        "core.diagnostics",
        "core.durations",
        "core.quantities",
        "core.settings",
        "core.suggest",
    },
    "core.extent": set(),
    "core.caches": set(),
    "core.libraries": {"core.diagnostics"},
    "core.programs": {"core.diagnostics"},
    "core.bundles": {"core.diagnostics", "core.files", "core.settings"},
    "starters": set(),
    "models": {"core.diagnostics", "core.durations", "core.quantities"},
    "schemas": {"core.diagnostics", "core.suggest"},
    "importers": {"core", "models", "schemas"},
    # Facts of makers about their devices, for who writes and who checks.
    "devices": {"core"},
    "exporters": {"core", "models", "schemas", "pipeline.parts", "devices"},
    # Checks of bundles share nothing with the exporters that write them.
    # What ran is judged in one place, which sees no exporter either.
    "deploy": {"core", "models", "devices", "pipeline.compare"},
    "pipeline": {"core", "models"},
    "pipeline.compare": {"core", "models", "pipeline"},
    # What interruptions make of a job has one home for the solver and all exporters.
    "pipeline.parts": {"core.durations", "models"},
    # Modes by their names: an option of every verb.
    "models.modes": {"core.diagnostics", "core.suggest", "models"},
    # The checker shares nothing with the solver or the exporters, so that a fault of theirs cannot hide in it.
    "pipeline.verify": {"models", "core.durations", "core.quantities", "core.diagnostics"},
    # The flow wires the three groups together, and nothing else does.
    "flow": {"core", "models", "importers", "exporters", "deploy", "pipeline"},
    # The workbench does what the command line does, for a browser.
    "workbench": {"core", "models", "importers", "exporters", "pipeline", "flow", "api"},
    # The tool from Python does what the command line does.
    "api": {"core", "models", "schemas", "importers", "exporters", "deploy", "pipeline", "flow"},
    "selftest": {"core", "models", "importers", "exporters", "pipeline"},
    "cli": {
        "core",
        "models",
        "schemas",
        "importers",
        "exporters",
        "deploy",
        "pipeline",
        "flow",
        "starters",
        "selftest",
        "workbench",
    },
}

# Modules of the outside world -> the parts that may import them.
WORLD = {
    "time": {"api", "cli", "workbench", "pipeline.solve.workers", "deploy"},
    "datetime": {"cli", "pipeline.solve.workers", "selftest"},
    # The generator draws from a seed that it is given; nothing else may draw at all.
    "random": {"pipeline.generate", "selftest"},
    "signal": {"cli", "pipeline.solve.workers"},
    # What keeps a program from starting is told in one place; the package graphviz has exceptions of its own.
    "subprocess": {"core.programs", "exporters.graph"},
    "multiprocessing": {"cli", "pipeline.solve.workers"},
    "concurrent": {"cli", "pipeline.solve.workers", "exporters.riscv"},
    "threading": {
        "cli",
        "pipeline.solve.workers",
        "pipeline.solve.checkpoint",
        "pipeline.solve.groups",
        "pipeline.solve.kernel",
        "workbench",
    },
    "socket": {"cli.serve"},
    "urllib": set(),
    "tempfile": {"cli", "core.files", "core.caches"},
    "os": {"cli", "workbench", "pipeline.solve.workers", "core.files", "exporters.riscv", "deploy", "core.caches"},
    "platform": {"cli", "selftest"},
    "shutil": {"cli", "core.files", "exporters.riscv", "deploy"},
}

# What of these modules only computes with text: free for all.
PURE = {f"os.path.{name}" for name in ("basename", "dirname", "join", "normpath", "split", "splitext")}
PURE |= {"os.fsencode", "os.fsdecode", "os.PathLike", "os.fspath"}
PURE |= {f"urllib.parse.{name}" for name in ("quote", "quote_plus", "unquote_plus")}

HEAVY = (
    "lxml",
    "yaml",
    "xmlschema",
    "numpy",
    "jinja2",
    "graphviz",
    "ortools",
    "autosar_data",
    "unicorn",
    "elftools",
    "ziglang",
)

MODULES = sorted(SOURCE.rglob("*.py"))


def part_of(path):
    """The dotted name of a module inside the package: ``pipeline.verify.rules``."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def rule_for(part, table):
    names = [name for name in table if part == name or part.startswith(f"{name}.")]
    return max(names, key=len, default=None)


def imports(path):
    """Every module that a file imports, at any level, with the line; of ``os``, what is used of it."""
    package = ["halpipe", *path.relative_to(SOURCE).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names if alias.name != "os" or alias.asname)
        elif isinstance(node, ast.Attribute):
            used = re.fullmatch(r"os\.(?!path$)\w+|os\.path\.\w+", ast.unparse(node))
            yield from [(used[0], node.lineno)] if used else []
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *([node.module] if node.module else [])])
            yield from ((f"{module}.{alias.name}", node.lineno) for alias in node.names)


def breaches(path, part=None):
    """The imports of a file that the law forbids."""
    part = part_of(path) if part is None else part
    own = rule_for(part, MAY_IMPORT)
    for name, line in imports(path):
        top, _, rest = name.partition(".")
        if top == "halpipe":
            target = rule_for(rest, MAY_IMPORT) if rest else None
            allowed = (
                own is None
                or target is None
                or any(
                    target == known or target.startswith(f"{known}.") for known in {own, *EVERYWHERE, *MAY_IMPORT[own]}
                )
            )
        else:
            allowed = name in PURE or top not in WORLD or rule_for(part, dict.fromkeys(WORLD[top])) is not None
        if not allowed:
            yield f"{path.name}:{line}: {part} must not import {name}"


@pytest.mark.parametrize("path", MODULES, ids=lambda path: part_of(path) or "halpipe")
def test_module_keeps_the_law(path):
    assert list(breaches(path)) == []


def test_every_part_of_the_package_has_a_rule():
    unruled = [part_of(p) for p in MODULES if rule_for(part_of(p), MAY_IMPORT) is None]
    assert unruled in ([""], ["", "__main__"])


@pytest.mark.parametrize(
    ("part", "text", "is_allowed"),
    [
        ("models.system", "from halpipe.core.durations import ZERO", True),
        ("models.system", "from halpipe.core.files import parse_xml", False),
        ("pipeline.verify.rules", "from halpipe.core.records import record", True),
        ("core.records", "from halpipe.core.durations import ZERO", False),
        ("importers.ros", "from halpipe.pipeline.validate import validate", False),
        ("importers.ros", "def f():\n    import halpipe.exporters.graph", False),
        ("importers.ros", "from halpipe.importers.common.base import Imported", True),
        ("exporters.graph", "from halpipe import pipeline", False),
        ("pipeline.solve.kernel.kernel", "from halpipe.importers.common.base import Imported", False),
        ("flow.formats", "from halpipe.importers.common.base import Imported", True),
        ("pipeline.verify.rules", "from halpipe.pipeline.jobs import expand", False),
        ("pipeline.verify.rules", "from halpipe.pipeline.verify import codes", True),
        ("pipeline.verify.rules", "from halpipe.core.suggest import nearest", False),
        ("flow.formats", "from halpipe.cli import main", False),
        ("cli.show", "from halpipe.flow.formats import schedule_model", True),
        ("pipeline.jobs", "import time", False),
        ("importers.ros", "from os import environ", False),
        ("importers.ros", "import os\nos.environ['HOME']", False),
        ("importers.ros", "import os\nos.path.exists('x')", False),
        ("importers.ros", "import os\nos.path.basename('x')", True),
        ("cli.run", "import time", True),
    ],
)
def test_the_law_itself(tmp_path, part, text, is_allowed):
    """Each rule lets through what it should and stops what it should."""
    path = SOURCE / "imagined.py"
    found = list(_breaches_of_text(path, part, text, tmp_path))
    assert (found == []) is is_allowed


def _breaches_of_text(path, part, text, folder):
    written = folder / path.name
    written.write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(globals(), "SOURCE", folder)
        yield from breaches(written, part)


@pytest.mark.parametrize(
    "statement",
    [
        "import halpipe",
        "import halpipe.models, halpipe.core.durations, halpipe.core.files",
        "import halpipe.pipeline.validate",
        "import halpipe.pipeline.verify",
        "import halpipe.flow.formats",
        "from halpipe.cli import invoke; invoke(['--help'])",
    ],
)
def test_heavy_libraries_are_imported_on_use_only(statement):
    """Loading them takes longer than all else that ``halpipe --help`` does."""
    code = f"import sys\n{statement}\nprint('loaded:', *sorted(set({HEAVY!r}) & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "loaded:"
