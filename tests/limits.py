"""Every verb under limits of the system: memory, sizes of files, open files. It ends in order, with whole outputs.

Usage: limits.py [VERB ...]. Each verb is run with more and more of what is limited until it does its work. Before that
it must end with a documented exit code and a message: no traceback, no internal error, the old output whole, nothing
left over.
"""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

PATIENCE = 60
"""Seconds of the processor for one run; a busy machine makes none fail."""
KNOWN = {0, 1, 3, 4}
"""Exit codes that say how a verb ended; 2 is wrong usage, 70 a bug."""

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
    "sensitivity": f"sensitivity {PAIR} --search --budget 50",
    "show": "show s.xml",
    "diff": "diff s.xml s.xml",
    "compare": "compare s.xml t.json",
    "run": "run pipe.yaml -q",
    "generate": "generate -o out/g.xml --witness out/w.xml --tasks 5 -q",
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


@dataclass(frozen=True)
class Kind:
    """What is limited, the least of it with which Python starts, and how it grows from run to run."""

    what: int
    least: int
    factor: float

    def values(self) -> Iterator[int]:
        """Return one limit after the other."""
        value = self.least
        while True:
            yield value
            value = int(value * self.factor) + 1


KINDS = {
    "memory": Kind(resource.RLIMIT_AS, 24 << 20, 1.06),
    "sizes of files": Kind(resource.RLIMIT_FSIZE, 0, 2),
    "open files": Kind(resource.RLIMIT_NOFILE, 5, 1),
}


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

    def bounded() -> None:
        resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))
        if limit is not None:
            resource.setrlimit(what, (limit, limit))

    return subprocess.run(
        [sys.executable, "-m", "halpipe", *words.split()],
        cwd=folder, text=True, capture_output=True, errors="replace", check=False, preexec_fn=bounded,
        env={**os.environ, "TMPDIR": str(folder / "tmp"), "XDG_CACHE_HOME": str(folder / "cache"),
             "PYTHONDONTWRITEBYTECODE": "" if limit is None else "1", "PYTHONPYCACHEPREFIX": str(folder / "compiled")},
    )  # fmt: skip


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder but those of caches."""
    found = {str(path.relative_to(folder)): path for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: path.read_bytes() for name, path in found.items() if name.split("/")[0] not in ("cache", "compiled")}


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
    for top in sorted({_top(name) for name in (*before, *after)}):
        states = [{n: d for n, d in state.items() if _top(n) == top} for state in (after, before, good)]
        if states[0] not in states[1:]:
            wrong.append(f"leaves {top} {'half done' if states[2] else 'over'}")
    if done.returncode in (0, 3) and [n for n in good if n not in after]:
        wrong.append("does not do its work")
    return wrong


def cleared(folder: Path, old: dict[str, bytes]) -> dict[str, bytes]:
    """Take away what a verb wrote, put `old` output there, and return all files."""
    for name in ("out", "tmp", "cache"):
        shutil.rmtree(folder / name, ignore_errors=True)
    for name in ("out", "tmp"):
        (folder / name).mkdir()
    for name, data in old.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return contents(folder)


def tried(folder: Path, words: str, what: int, limits: Iterable[int]) -> tuple[int, list[str]]:
    """Run a verb under limits until it does its work; every other time there is an older output."""
    cleared(folder, {})
    whole = run(folder, words)
    for _ in range(4):  # what runs in real time is late on a busy machine, and ends with 1 as without room
        whole = run(folder, words) if whole.returncode == 1 else whole
    if whole.returncode not in KNOWN:
        raise RuntimeError(f"{words}: {whole.stderr}")
    good = contents(folder)
    files = [name for name in good if name.startswith("out/") and name.count("/") == 1 and "out/h." not in name]
    older = {name: good[name] + b"<!-- older -->" for name in files}
    wrong, count = [], 0
    for count, limit in enumerate(limits, 1):
        before = cleared(folder, older if count % 2 else {})
        done = run(folder, words, what, limit)
        wrong += [f"{words}, limit {limit}: {text}" for text in trespasses(done, before, good, contents(folder))]
        if done.returncode == whole.returncode:
            break
    return count, wrong


def main(verbs: list[str]) -> int:
    """Try verbs, or all of them, with every kind of limit."""
    broken = 0
    with tempfile.TemporaryDirectory(prefix="halpipe-limits-") as place:
        prepared(Path(place))
        for name, words in VERBS.items():
            for kind, limited in KINDS.items() if not verbs or name in verbs else ():
                count, wrong = tried(Path(place), words, limited.what, limited.values())
                broken += len(wrong)
                print(f"{name:24} {kind:16} {count:4} runs, {len(wrong)} broken", *wrong, sep="\n  ", flush=True)
    return 1 if broken else 0


if __name__ == "__main__":
    sys.path.append(str(Path(__file__).parent / "cli"))
    sys.exit(main(sys.argv[1:]))
