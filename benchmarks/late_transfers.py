"""Transfers that come late by up to a hyperperiod, in bundles of generated sets: ``python benchmarks/late_transfers.py``.

One transfer in every fourth table of a run is late. The runs are compared with what has to follow: the job is recorded,
so are those that wait for its channel or unit, and nothing else changes. Prints the findings of each set, which have to
be none; the last line is JSON with the counts.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.files import write_directory
from halpipe.deploy.riscv.judge import check, containment
from halpipe.exporters.native import format_model, paired
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow.formats import export, open_target, prepare_model
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate_with_witness
from halpipe.pipeline.solve.schedule import SearchOptions

if TYPE_CHECKING:
    from halpipe.deploy.base import Target

OPTIONS = RiscvOptions(profile="vcu118x8", toolchain="gcc")
TABLES = check.DELAYS * 4


def build(folder: Path, seed: int) -> Target:
    """Export a generated set whose units share resources, so that each has transfers on several channels."""
    parameters = SetParameters(tasks=8 + seed % 9, units=2 + seed % 3, unit_types=1, resources=2 + seed % 2)
    made, _ = generate_with_witness(parameters, seed)
    file = str(folder / "model.xml")
    prepared = prepare_model(parse_model(format_model(made), file), OPTIONS, dummy=True)
    for beside, content in prepared.files.items():
        (folder / beside).write_bytes(content)
    model = parse_model(format_model(prepared.model), file)
    scheduled = schedule_model(model, SearchOptions(), lambda *_: True)
    files = paired(model, replace(scheduled.schedule, model_sha256=model.digest))
    schedule = parse_schedule(files["schedule.xml"], "schedule.xml")
    write_directory(str(folder / "bundle"), export("riscv", parse_model(files["model.xml"], file), schedule, OPTIONS))
    return open_target(str(folder / "bundle"))


def main() -> int:
    """Delay transfers until there are enough; return 1 if anything is found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--delays", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--turns", type=int, default=5, help="runs of each set")
    chosen = parser.parse_args()
    begin, delays, held, sets, found = time.process_time(), 0, 0, 0, 0
    while delays < chosen.delays:
        seed = chosen.seed + sets
        sets += 1
        with tempfile.TemporaryDirectory() as name:
            target, injected = build(Path(name), seed), containment.Injected()
            (tour,) = containment.sweeps(target.schedule, 0)
            check.delay(target, tour, TABLES, injected, turns=chosen.turns)
        errors = [d for d in injected.findings if d.is_error]
        delays, held, found = delays + injected.delays, held + injected.held, found + len(errors)
        print(f"set {seed}: {injected.delays} late, {injected.held} wait, {len(errors)} findings", flush=True)
        for each in errors:
            print(f"  {each.code} {each.path}: {each.message}")
    counts = {"late": delays, "wait": held, "sets": sets, "findings": found}
    print(json.dumps(counts | {"seconds": int(time.process_time() - begin)}))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
