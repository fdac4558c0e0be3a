"""Stress the bandwidth regulator: ``python benchmarks/regulator.py --configurations 60 --seeds 1 2``.

With ``--faults``: how many faults put into the Verilog the simulation finds, and how many of the others the proof.
With ``--loaded``: how many faults put into what back-ends load the check finds; each that survives is printed.

Random systems (those of the tests) are exported, checked exactly, and simulated with every kind of traffic. Prints what
was simulated and every violation; the last line is JSON. Needs Verilator, or Icarus Verilog and much time.
"""

import argparse
import json
import random
import re
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests/unit/deploy/regulator"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

import test_regulator_devices as devices

import regulator_bundles as bundles
import regulator_mutants as mutants
import regulator_systems as systems
from halpipe.core.diagnostics import HalpipeError, render_text
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT
from halpipe.deploy.regulator.reading import read_tables
from halpipe.deploy.regulator.simulate import Icarus, choose_engine, design_of, judge, play
from halpipe.deploy.regulator.stimuli import TRAFFIC, plan
from regulator_proof import missing


def stress(configurations: int, seeds: list[int], windows: int) -> dict[str, object]:
    """Return what was simulated and what was found."""
    engine, told = choose_engine("auto")
    if engine is None:
        raise SystemExit(told)
    count = dict.fromkeys(("configurations", "runs", "windows", "unit_windows", "cycles", "switches", "carried"), 0)
    count |= {"violations": 0, "greedy_runs": 0, "greedy_exact": 0}
    seconds = 0.0
    with tempfile.TemporaryDirectory() as folder:
        for number in range(configurations):
            rng = random.Random(number)
            shape = systems.random_shape(rng)
            files = systems.export(Path(folder), *systems.random_system(rng, shape), shape)
            target = bundles.target(files)
            tables = read_tables(target.bundle)
            arithmetic = DEPLOYMENT.check(target, CheckOptions(engine="arithmetic"))
            found = list(arithmetic.diagnostics)
            with tempfile.TemporaryDirectory() as built:
                player = engine.build(design_of(target.bundle, tables), built)
                for seed in seeds:
                    for traffic in TRAFFIC:
                        run = plan(tables, traffic, seed, windows=windows)
                        begin = time.perf_counter()
                        trace = play(target.bundle, tables, player, run)
                        seconds += time.perf_counter() - begin
                        verdict = judge(tables, run, trace, target.bundle.at("table"))
                        found += verdict.findings
                        count["runs"] += 1
                        count["windows"] += verdict.windows
                        count["unit_windows"] += 2 * len(tables.units) * verdict.windows
                        count["cycles"] += verdict.windows * tables.platform.window_cycles
                        count["switches"] += verdict.switches
                        count["carried"] += verdict.carried
                        if traffic is TRAFFIC[0]:
                            count["greedy_runs"] += 1
                            count["greedy_exact"] += verdict.used == verdict.granted
            count["configurations"] += 1
            count["violations"] += len(found)
            for finding in found:
                print(f"configuration {number}: {render_text(finding)}")
    return {"engine": engine.name, **count, "simulation_s": round(seconds, 1)}


def bus_time(cycles: int = 250_000) -> dict[str, object]:
    """Return how long four greedy masters take for a millisecond of a bus of 250 MHz."""
    engine, _ = choose_engine("auto")
    assert engine is not None
    rng = random.Random(0)
    shape = systems.random_shape(rng)
    with tempfile.TemporaryDirectory() as folder:
        files = systems.export(Path(folder), *systems.random_system(rng, shape), shape)
        target = bundles.target(files)
        tables = read_tables(target.bundle)
        player = engine.build(design_of(target.bundle, tables), folder)
        run = plan(tables, TRAFFIC[0], 1, windows=cycles // shape.window, repeats=200)
        times = []
        for _ in range(5):
            begin = time.perf_counter()
            play(target.bundle, tables, player, run)
            times.append(time.perf_counter() - begin)
    simulated = len(run.expected) * shape.window
    return {"units": shape.units, "cycles": simulated, "best_s": round(min(times), 3)}


def faults() -> dict[str, object]:
    """Return how many faults of the Verilog the simulation finds, and how many of the others the proof."""
    engine, count, unseen = Icarus(), 0, []
    with tempfile.TemporaryDirectory() as folder:
        files = bundles.export(Path(folder), *bundles.system("100ns"))
    for name in mutants.MUTANTS:
        if mutants.simulated(mutants.mutated(files, name), engine):
            count += 1
        else:
            unseen.append(name)
    lacking = missing()
    refuted = [n for n in unseen if not lacking and mutants.refuted(mutants.mutated(files, n), mutants.MUTANTS[n][0])]
    for name in sorted(set(unseen) - set(refuted)):
        print(f"survives: {name}")
    return {"faults": len(mutants.MUTANTS), "by_simulation": count, "by_proof": len(refuted), "not_installed": lacking}


def changes(text: str, file: str) -> Iterator[tuple[str, list[str]]]:
    """Yield each fault of a file: of an image every bit of every word, of another every line and number."""
    lines = text.split("\n")
    if not file.endswith(".memh"):
        yield from devices.faults(text)
        return
    for number, line in enumerate(lines):
        for bit in range(4 * len(line.strip()) if re.fullmatch("[0-9a-f]+", line.strip()) else 0):
            word = f"{int(line, 16) ^ 1 << bit:0{len(line.strip())}x}"
            yield f"bit {bit} of word {number}", [*lines[:number], word, *lines[number + 1 :]]


def is_found(files: dict[str, bytes]) -> bool:
    """Return whether the check refuses a bundle, or finds an error in it."""
    try:
        return bool(devices.ids(files))
    except HalpipeError:
        return True


def loaded() -> dict[str, object]:
    """Return, for each form of a back-end, how many faults there are of lines and numbers, and how many are found."""
    counts: dict[str, object] = {}
    for name in ("table", *devices.SETTINGS):
        with tempfile.TemporaryDirectory() as folder:
            backend, files = devices.export(Path(folder), name)
        found = several = 0
        is_loaded = re.compile(r"tables\.json|table/.*\.memh" if name == "table" else f"{backend}/.*")
        for file in sorted(filter(is_loaded.fullmatch, files)):
            for what, lines in changes(files[file].decode(), file):
                several += 1
                if is_found({**files, file: "\n".join(lines).encode()}):
                    found += 1
                else:
                    print(f"survives: {name}, {file}: {what}")
        counts[name] = {"faults": several, "found": found}
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=60)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--windows", type=int, default=400)
    parser.add_argument("--faults", action="store_true", help="put faults into the Verilog instead")
    parser.add_argument("--loaded", action="store_true", help="put faults into what back-ends load instead")
    wanted = parser.parse_args()
    if wanted.loaded:
        print(json.dumps(loaded()))
        return
    if wanted.faults:
        result = faults()
        print(json.dumps(result))
        sys.exit(0 if result["by_simulation"] + result["by_proof"] == result["faults"] else 1)
    begin = time.perf_counter()
    result = stress(wanted.configurations, wanted.seeds, wanted.windows)
    total = round(time.perf_counter() - begin, 1)
    print(json.dumps({**result, "total_s": total, "millisecond": bus_time()}))
    sys.exit(1 if result["violations"] else 0)


if __name__ == "__main__":
    main()
