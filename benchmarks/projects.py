"""Put a schedule onto AUTOSAR projects, play the Os of the merged projects, and compare every action with the schedule.

    python benchmarks/projects.py PROJECT_DIR ... [--granularity ostask] [--tick 1ms] [--actions 100000] [--seeds 3]

The player is that of the tests, which shares nothing with halpipe. Each task has 10 us, unless an overlay states more.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.core.files import MANIFEST
from halpipe.flow.formats import import_model
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml.options import ArxmlImportOptions
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.schedule import SearchOptions

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from merged_os import differences

if TYPE_CHECKING:
    from halpipe.exporters.arxml.onto import Onto

_OVERLAY = 'halpipe-overlay: 1\ntasks:\n  "*": {wcet: 10us}\n'


def main() -> None:
    """Print a row for each project and seed, and the sums."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("projects", nargs="+", type=Path, help="folders with .arxml and .xdm files")
    parser.add_argument("--granularity", default="ostask", choices=("ostask", "runnable"))
    parser.add_argument("--tick", type=Duration.parse, help="tick of the schedule, such as 1ms")
    parser.add_argument("--overlay", type=Path, action="append", default=[], help="further overlays of the model")
    parser.add_argument("--ecu", default="", help="the ECU to import")
    parser.add_argument("--actions", type=int, default=1000, help="actions on OsTasks to play for each seed")
    parser.add_argument("--seeds", type=int, default=1)
    chosen = parser.parse_args()
    played, wrong = 0, 0
    print("| project | seed | tasks | jobs | actions played | extra or missing |\n|---|---|---|---|---|---|")
    for project in chosen.projects:
        for seed in range(1, chosen.seeds + 1):
            try:
                row, actions, found = _play(project, seed, chosen)
            except HalpipeError as refused:
                first = next(d for d in refused.diagnostics if d.is_error)
                row, actions, found = f"refused: {first.code} {first.message}", 0, []
            print(f"| {project.name} | {seed} | {row} | {actions} | {len(found)} |", *found[:3], flush=True)
            played, wrong = played + actions, wrong + len(found)
    print(f"{played} actions, {wrong} extra or missing")


def _play(project: Path, seed: int, chosen: argparse.Namespace) -> tuple[str, int, list[str]]:
    with tempfile.TemporaryDirectory(prefix="halpipe-projects-") as name:
        folder = Path(name) / "project"
        for path in (path for path in project.rglob("*") if path.suffix in (".arxml", ".xdm")):
            target = folder / path.relative_to(project)
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(path, target)
        overlay = Path(name) / "wcet.yaml"
        overlay.write_text(_OVERLAY)
        options = ArxmlImportOptions(
            ecu=chosen.ecu,
            granularity=chosen.granularity,
            overlays=(str(overlay), *map(str, chosen.overlay)),
        )
        model = import_model("arxml", [str(folder)], options).model
        schedule = schedule_model(model, SearchOptions(tick=chosen.tick, seed=seed), lambda *_: True).schedule
        onto = export_onto(model, schedule, str(folder), ArxmlImportOptions(ecu=chosen.ecu))
        _merge(folder, onto)
        origins = {task.name: task.origin.path for task in model.tasks}
        coded = json.loads(onto.files[MANIFEST])["code"]
        _, each = differences(folder, schedule, origins, coded)
        turns = max(1, -(-chosen.actions // max(each, 1)))
        found, actions = differences(folder, schedule, origins, coded, turns)
        return f"{len(model.tasks)} | {len(schedule.modes[0].jobs)}", actions, found


def _merge(folder: Path, onto: Onto) -> None:
    for name, content in onto.files.items():
        if name.endswith((".arxml", ".xdm")):
            (folder / name.removeprefix("changed/")).write_bytes(content)


if __name__ == "__main__":
    main()
