"""Every verb under limits of the system: memory, sizes of files, open files. It ends in order, with whole outputs.

Usage: limits.py [VERB ...]. Each verb is run with more and more of what is limited until it does its work. Before that
it must end with a documented exit code and a message: no traceback, no internal error, the old output whole, nothing
left over.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

PATIENCE = 120
KNOWN = {0, 1, 3, 4}
"""Exit codes that say how a verb ended; 2 is wrong usage, 70 a bug."""

SYSTEM = Path(__file__).parents[1] / "src" / "halpipe" / "selftest" / "systems" / "modes.xml"
PAIR = "model.xml s.xml"
PIPELINE = """\
halpipe-pipeline: 1
model: model.xml
schedule: {output: out/s.xml}
exports:
  - {format: report, output: out/r.html}
"""
OVERLAY = """\
halpipe-overlay: 1
platform: {units: [{name: u}]}
sources: {in: {period: 10ms}}
tasks: {"*": {wcet: 1ms, units: [u]}}
"""
GRAPH = 'digraph { "in" [shape=ellipse]; "a" [shape=box]; "in" -> "a" -> "out"; }\n'
VERBS = {
    "new": "new out/first",
    "import amalthea": "import amalthea a.amxmi -o out/m.xml --report out/i.json -q",
    "import arxml": "import arxml a.arxml -o out/m.xml -q",
    "import ros": "import ros a.dot --overlay o.yaml -o out/m.xml -q",
    "validate": "validate model.xml",
    "schedule": "schedule model.xml -o out/s.xml -q",
    "schedule in vain": "schedule hopeless.xml --budget 500 -o out/h.xml -q",
    "schedule a fleet": "schedule model.xml one.xml -o out/fleet -q",
    "verify": f"verify {PAIR}",
    "explain": "explain hopeless.xml",
    "size": "size model.xml --wcet-factor --budget 200",
    "sensitivity": f"sensitivity {PAIR} --budget 50",
    "show": "show s.xml",
    "diff": "diff s.xml s.xml",
    "compare": "compare s.xml t.json",
    "run": "run pipe.yaml -q",
    "generate": "generate -o out/g.xml --witness out/w.xml --tasks 5 -q",
    "bench": "bench tiny -o out/bench --seeds 1 --row 12 -q",
    "selftest": "selftest --mutants 20",
    "selftest evidence": "selftest --mutants 20 --evidence out/evidence",
    "doctor": "doctor",
    **{f"export {form}": f"export {form} {PAIR} -o out/{form} -q" for form in
       ("report", "graph", "trace", "btf", "amalthea", "arxml", "ros")},
    "export linux": f"export linux {PAIR} --busy 50 -o out/linux -q",
    "export regulator": f"export regulator {PAIR} --platform platform.yaml -o out/regulator -q",
    "deploy check regulator": "deploy check regulator --engine arithmetic",
    "deploy check linux": "deploy check linux --engine native",
}  # fmt: skip


class Kind:
    """What is limited: a name, the least of it that a program in Python needs, and how it grows from run to run."""

    def __init__(self, name: str, what: int, least: int, factor: float) -> None:
        self.name, self.what, self.least, self.factor = name, what, least, factor

    def values(self):
        """Return one limit after the other."""
        value = self.least
        while True:
            yield value
            value = int(value * self.factor) + 1


def prepared(folder: Path) -> None:
    """Make an input of every kind."""
    from test_cli_regulator import PLATFORM

    from halpipe.exporters.native import format_model
    from support import hopeless_model, small_model

    (folder / "model.xml").write_bytes(format_model(small_model()))
    (folder / "one.xml").write_bytes(format_model(small_model()))
    (folder / "hopeless.xml").write_bytes(format_model(hopeless_model()))
    (folder / "platform.yaml").write_text(PLATFORM)
    (folder / "pipe.yaml").write_text(PIPELINE)
    (folder / "a.dot").write_text(GRAPH)
    (folder / "o.yaml").write_text(OVERLAY)
    for words in (
        "schedule model.xml -o s.xml", f"export amalthea {PAIR} -o a.amxmi", f"export arxml {PAIR} -o a.arxml",
        f"export trace {PAIR} -o t.json", f"export linux {PAIR} --busy 50 -o linux",
        f"export regulator {PAIR} --platform platform.yaml -o regulator",
    ):  # fmt: skip
        done = run(folder, f"{words} -q")
        if done.returncode:
            raise RuntimeError(f"{words}: {done.stderr}")


def run(folder: Path, words: str, what: int = 0, limit: int | None = None) -> subprocess.CompletedProcess[str]:
    """Run a verb under a limit."""
    return subprocess.run(
        [sys.executable, "-m", "halpipe", *words.split()],
        cwd=folder, text=True, capture_output=True, errors="replace", timeout=PATIENCE, check=False,
        preexec_fn=(lambda: resource.setrlimit(what, (limit, limit))) if limit is not None else None,
        env={**os.environ, "TMPDIR": str(folder / "tmp"), "XDG_CACHE_HOME": str(folder / "cache"),
             "PYTHONDONTWRITEBYTECODE": "", "PYTHONPYCACHEPREFIX": str(folder / "compiled")},
    )  # fmt: skip


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def _top(name: str) -> str:
    """Return what is an output as a whole: a file or folder in out/."""
    return "/".join(name.split("/")[: 2 if name.startswith("out/") else 1])


def trespasses(done: subprocess.CompletedProcess[str], before, good, after) -> list[str]:
    """Say what is wrong with the end of a verb, by the files there `before` it, `after` it, and after a `good` end."""
    said = done.stdout + done.stderr
    wrong = [f"ends with {done.returncode}"] if done.returncode not in KNOWN else []
    wrong += [f"says {words!r}" for words in ("Traceback", "internal error") if words in said]
    if done.returncode == 1 and "error" not in said:
        wrong.append("says nothing")
    for top in {_top(name) for name in after}:
        states = [{n: d for n, d in state.items() if _top(n) == top} for state in (after, before, good)]
        if states[0] not in states[1:]:
            wrong.append(f"leaves {top} {'half done' if states[2] else 'over'}")
    if done.returncode in (0, 3) and after != good:
        wrong.append("does not do its work")
    return wrong
