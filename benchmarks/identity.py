"""Does a change of the search keep every byte? Schedule some hundred small models of all kinds in all ways.

    python benchmarks/identity.py models FOLDER                 makes the models, once for both sides
    PYTHONPATH=OLD/src python benchmarks/identity.py run FOLDER old.json
    python benchmarks/identity.py run FOLDER new.json --against old.json

A result is the exit code with the hashes of the schedule and, of a search that failed, of its best placement. Nothing
is used but the command line, so that it does not matter how the sources of either side are laid out.
"""

import argparse
import contextlib
import hashlib
import itertools
import json
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).parents[1]
TESTS = ROOT / "tests"
sys.path[:0] = [str(TESTS), str(TESTS / "properties")]

from halpipe.models import Mode, TaskModel, Transition  # noqa: E402

SCHEDULE = ("schedule", "--quiet", "--seed", "7")
BUDGET = ("--budget", "400")
"""Moves per task: enough for most models, so that failures are compared, too."""

SHIPPED = ".shipped.xml"
"""Ends the name of a model without some of its tasks: its schedule is frozen in that of the whole."""

RANDOM_MODELS, SETS_OF_A_KIND = 360, 14


# ------------------------------------------------------------------------------------------------ models


def models() -> Iterator[TaskModel]:
    """Make models of all kinds; their names tell them apart."""
    from halpipe.importers.native import read_model
    from halpipe.pipeline.generate import generate
    from table_iii import TABLE_III

    yield from random_models()
    for name, parameters in kinds().items():
        for seed in range(SETS_OF_A_KIND):
            yield replace(generate(parameters, seed + 1), name=f"{name}_{seed:02}")
    for experiment in TABLE_III:
        for number, cell in enumerate(experiment.cells[:: len(experiment.cells) // 2]):
            yield replace(generate(cell, 11), name=f"table3_{experiment.number}_{number}")
    yield replace(read_model(str(ROOT / "examples/roboracer/model.xml")), name="roboracer")


def random_models() -> Iterator[TaskModel]:
    """Make models with every feature, of one mode or of two with switches, that a first look does not refuse."""
    import halpipe

    made = map(_random_model, itertools.count())
    accepted = (model for model in made if not any(found.is_error for found in halpipe.validate(model)))
    yield from itertools.islice(accepted, RANDOM_MODELS)


def _random_model(seed: int) -> TaskModel:
    from scheduler_systems import random_model

    model = replace(random_model(seed, grain=1 + seed % 3), name=f"random_{seed:03}")
    shorter = without_some_tasks(model)
    if seed % 4 or shorter is None:
        return model
    names = {task.name for task in shorter.tasks}
    second = Mode(name="two", runs=tuple(run for run in model.modes[0].runs if run.task in names))
    switches = (Transition(source="one", target="two"), Transition(source="two", target="one"))
    return replace(model, modes=(*model.modes, second), transitions=switches)


def kinds() -> dict[str, object]:
    """Return parameters of generated sets, for each a kind of set that the kernel treats in its own way."""
    from halpipe.pipeline.generate import SetParameters

    plain = SetParameters(tasks=14, units=4)
    tight = replace(plain, utilisation=Fraction(9, 10))
    share = Fraction(2, 5)
    return {
        "plain": plain,
        "tight": tight,
        "many": replace(tight, tasks=36, units=6),
        "linked": replace(plain, precedence=share),
        "manylinked": replace(plain, tasks=36, units=6, precedence=share),
        "versions": replace(plain, multi_version=share),
        "gang": replace(plain, gang=Fraction(1, 4)),
        "fractional": replace(plain, fractional=True, resource_fill=Fraction(7, 10)),
        "slack": replace(tight, slack=Fraction(1, 10)),
        "unlike": replace(plain, unlike_units=True, unit_types=2),
        "mixed": replace(
            plain,
            tasks=18,
            multi_version=share,
            precedence=share,
            gang=Fraction(1, 5),
            fractional=True,
            slack=share / 4,
        ),
    }


def without_some_tasks(model: TaskModel) -> TaskModel | None:
    """Leave away every third of the tasks that nobody names; None where there is none."""
    named = {row.task for task in model.tasks for version in task.versions for row in version.precedences}
    named |= {name for chain in model.chains for name in chain.tasks}
    gone = {task.name for task in [task for task in model.tasks if task.name not in named][::3]}
    kept = tuple(task for task in model.tasks if task.name not in gone)
    if not gone or not kept:
        return None
    modes = tuple(replace(m, runs=tuple(run for run in m.runs if run.task not in gone)) for m in model.modes)
    return replace(model, tasks=kept, modes=modes)


def write_models(folder: Path) -> None:
    """Write all models, and beside each the one whose schedule has shipped."""
    from halpipe.exporters.native import format_model

    folder.mkdir(parents=True)
    for model in models():
        (folder / f"{model.name}.xml").write_bytes(format_model(model))
        shorter = without_some_tasks(model)
        if shorter is not None:
            (folder / f"{model.name}{SHIPPED}").write_bytes(format_model(shorter))
    print(f"{len(list(folder.iterdir()))} models, with those that have shipped")


# ------------------------------------------------------------------------------------------------ ways


def first(model: Path, folder: Path, workers: int) -> list[object]:
    """Schedule with so many threads."""
    return [command(model, folder, *BUDGET, "--workers", str(workers))]


def improved(model: Path, folder: Path, objectives: str) -> list[object]:
    """Improve the first valid schedule."""
    return [command(model, folder, *BUDGET, "--workers", "2", "--optimise", objectives)]


def frozen(model: Path, folder: Path) -> list[object]:
    """Schedule the shorter model, then the whole one around it."""
    shorter = model.with_name(model.stem + SHIPPED)
    if not shorter.exists():
        return []
    shipped = command(shorter, folder, *BUDGET, "--seed", "5", target="shipped.xml")
    if shipped[0]:
        return [shipped]
    return [shipped, command(model, folder, *BUDGET, "--freeze", str(folder / "shipped.xml"))]


def resumed(model: Path, folder: Path) -> list[object]:
    """Stop a search three times after some slices, then go on to its end; a clock that leaps has every slice saved."""
    clock = itertools.count(0, 10)
    found = []
    way = (*BUDGET, "--optimise", "cost", "--workers", "1")
    with mock.patch("time.monotonic", side_effect=clock):
        for limit in (("--time-limit", "45"),) * 3 + ((),):
            again = ("--resume",) if (folder / "s.resume").exists() else ()
            found.append(command(model, folder, *way, *limit, *again))
            if not (folder / "s.resume").exists():
                break
    return found


WAYS = {
    "first": lambda model, folder: first(model, folder, 1),
    "two workers": lambda model, folder: first(model, folder, 2),
    "eight workers": lambda model, folder: first(model, folder, 8),
    "cost": lambda model, folder: improved(model, folder, "cost"),
    "margin": lambda model, folder: improved(model, folder, "margin"),
    "freeze": frozen,
    "resumed": resumed,
}

LONG = ("margin", "two workers", "resumed")
"""Ways that large sets are spared."""


def command(model: Path, folder: Path, *options: str, target: str = "s.xml") -> list[object]:
    """Run a command; return its exit code and the hashes of what it wrote, None for what it did not."""
    from command_line import run_here

    outputs = [folder / target, folder / target.replace(".xml", ".best.xml")]
    for output in outputs:
        output.unlink(missing_ok=True)
    done = run_here(folder, *SCHEDULE, str(model), "-o", target, *options)
    if done.returncode not in (0, 1, 3, 4):
        raise SystemExit(f"{model.name} {' '.join(options)}: exit {done.returncode}\n{done.stderr}")
    return [done.returncode, *(digest(output) for output in outputs)]


def digest(file: Path) -> str | None:
    """Return the start of the hash of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()[:20] if file.exists() else None


def run(folder: Path, only: str) -> dict[str, dict[str, list[object]]]:
    """Return the results of every model, by way."""
    found: dict[str, dict[str, list[object]]] = {}
    for model in sorted(folder.resolve().glob("*.xml")):
        if model.name.endswith(SHIPPED) or only not in model.name:
            continue
        results: dict[str, list[object]] = {"model": [digest(model)]}
        for name, way in WAYS.items():
            if model.name.startswith("table3") and name in LONG:
                continue
            with tempfile.TemporaryDirectory() as scratch, contextlib.chdir(scratch):
                results[name] = way(model, Path(scratch))
        found[model.stem] = results
    return found


# ------------------------------------------------------------------------------------------------ comparison


def compare(new: dict[str, dict[str, list[object]]], old: dict[str, dict[str, list[object]]]) -> int:
    """Print what differs; return how many results do."""
    different = 0
    for name in sorted({*new, *old}):
        for way in ("model", *WAYS):
            pair = new.get(name, {}).get(way), old.get(name, {}).get(way)
            if pair[0] != pair[1]:
                different += 1
                print(f"{name}, {way}: {pair[0]} instead of {pair[1]}")
    return different


def summary(found: dict[str, dict[str, list[object]]]) -> str:
    """Count models, searches and schedules found, and hash everything."""
    ways = [result for results in found.values() for way, result in results.items() if way != "model"]
    searches = [search for result in ways for search in result]
    valid = sum(search[0] == 0 for search in searches)  # type: ignore[index]
    best = sum(search[2] is not None for search in searches)  # type: ignore[index]
    whole = hashlib.sha256(json.dumps(found, sort_keys=True).encode()).hexdigest()[:20]
    return f"{len(found)} models, {len(searches)} searches: {valid} schedules, {best} best placements; digest {whole}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    verbs.add_parser("models").add_argument("folder", type=Path)
    running = verbs.add_parser("run")
    running.add_argument("folder", type=Path)
    running.add_argument("results", type=Path)
    running.add_argument("--against", type=Path)
    running.add_argument("--only", default="", help="part of the name of a model")
    chosen = parser.parse_args()
    if chosen.verb == "models":
        write_models(chosen.folder)
        return 0
    began = time.process_time()
    found = run(chosen.folder, chosen.only)
    chosen.results.write_text(json.dumps(found, indent=1, sort_keys=True))
    print(f"{summary(found)}; {time.process_time() - began:.0f} s")
    if chosen.against is None:
        return 0
    old = {name: results for name, results in json.loads(chosen.against.read_text()).items() if chosen.only in name}
    different = compare(found, old)
    print(f"{different} results differ" if different else "all results are the same")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
