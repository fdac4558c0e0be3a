# ruff: noqa: E402 - the bundle of the tests is found by the path
"""Jobs that misbehave, one at a time, on both engines: ``python benchmarks/attacks.py``.

Each attack stands in place of the function of one task of the tests' bundle. It is contained if every finding is of
that task, and reported if there is one. Prints what each engine finds and how long it takes; the last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

TESTS = Path(__file__).parents[1] / "tests"
sys.path.insert(0, str(TESTS))
sys.path.insert(0, str(TESTS / "riscv" / "cosim"))

import conftest as case
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.exporters.native import paired
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow import formats
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.health import with_reactions
from riscv_attacks import ATTACKS, DECLARED, bodies

if TYPE_CHECKING:
    from halpipe.deploy.base import Target

VICTIM = "act"
PROFILE = "fu540"


def export(folder: Path, body: str = "") -> Target:
    """Export the bundle of the tests, with a body in place of one task's function."""
    folder.mkdir()
    for name in case.SOURCES:
        shutil.copy(case.HERE / name, folder / name)
    if body:
        (folder / f"{VICTIM}.c").write_text(f"#include <stdint.h>\n{DECLARED}\nvoid {VICTIM}(void) {{ {body} }}\n")
    system = parse_model(case.HERE.joinpath("model.xml").read_bytes(), str(folder / "model.xml"))
    pair = paired(system, with_reactions(system, case.tables_of(system)))
    model = parse_model(pair["model.xml"], str(folder / "model.xml"))
    schedule = parse_schedule(pair["schedule.xml"], str(folder / "schedule.xml"))
    options = RiscvOptions(profile=PROFILE, toolchain="zig", sources=str(folder))
    write_directory(str(folder / "out"), formats.export("riscv", model, schedule, options))
    return formats.open_target(str(folder / "out"))


def attacked(target: Target, engine: str) -> tuple[list[str], list[str], float]:
    """Return the codes that are found of the victim, what is found of others, and the seconds that it takes."""
    begin = time.monotonic()
    try:
        found = DEPLOYMENT.check(target, CheckOptions(engine=engine)).diagnostics
    except HalpipeError as failure:
        found = failure.diagnostics
    errors = [d for d in found if d.is_error]
    own = sorted({d.code for d in errors if f'task "{VICTIM}"' in d.path})
    others = [f"{d.code} {d.path}: {d.message}" for d in errors if f'task "{VICTIM}"' not in d.path]
    return own, others, time.monotonic() - begin


def main() -> int:
    """Try every attack; return 1 if one is not contained, or not reported."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engines", nargs="+", default=["cosim", "qemu"])
    chosen = parser.parse_args()
    contained = dict.fromkeys(chosen.engines, 0)
    longest = 0.0
    with tempfile.TemporaryDirectory() as name:
        on_second = bodies(export(Path(name) / "sound"), 1)
        for number, (title, body) in enumerate(on_second.items()):
            target = export(Path(name) / str(number), body)
            for engine in chosen.engines:
                own, others, seconds = attacked(target, engine)
                contained[engine] += bool(own) and not others
                longest = max(longest, seconds)
                said = " ".join(own) or "not reported"
                print(title, engine, said, *others[:2], f"{seconds:.1f} s", sep="; ", flush=True)
    print(json.dumps({"attacks": len(ATTACKS), **contained, "longest": round(longest, 1)}))
    return int(min(contained.values()) < len(ATTACKS))


if __name__ == "__main__":
    sys.exit(main())
