"""Plays the tables of a bundle on its own Verilog, between managers that ask for all they can get."""

from __future__ import annotations

from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.records import record
from halpipe.deploy.regulator import stimuli
from halpipe.deploy.regulator.codes import NO_ENGINE
from halpipe.deploy.regulator.engines import ENGINES, Design
from halpipe.deploy.regulator.forms import FOLDER, image_names, images
from halpipe.deploy.regulator.observe import judge

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.regulator.engines import Engine, Player
    from halpipe.deploy.regulator.observe import Verdict
    from halpipe.deploy.regulator.reading import Tables
    from halpipe.deploy.regulator.stimuli import Run

BENCH = files("halpipe.deploy.regulator") / "bench"
CYCLES = {"verilator": (160_000_000, 3_000_000), "icarus": (800_000, 160_000)}
"""Cycles of the greedy run and of each other, of all units together, if the user does not say how many hyperperiods."""

STEPPED_CYCLES = {"verilator": 2**31, "icarus": 400_000}
"""Cycles of the run that steps through every table: whatever it takes, or what an interpreter does in some seconds."""


@record
class Played:
    """A simulated run with its findings."""

    run: Run
    verdict: Verdict


def choose_engine(wanted: str) -> tuple[Engine | None, str]:
    """Return the engine to use, and in words which one and why not another; raise `HalpipeError` if it is missing."""
    reasons: list[str] = []
    for engine in ENGINES:
        if wanted in ("auto", engine.name):
            missing = engine.missing()
            if not missing:
                return engine, "; ".join([f"engine {engine.name}", *reasons])
            reasons.append(f"{engine.name}: {missing}")
    if wanted != "auto":
        help = f"install it (Debian: apt-get install {wanted.replace('icarus', 'iverilog')}), or use --engine auto"
        raise HalpipeError(NO_ENGINE("; ".join(reasons), help=help))
    return None, "no simulation: " + "; ".join(reasons)


def design_of(bundle: Bundle, tables: Tables) -> Design:
    """Return the bench with the Verilog of the bundle, as large as its tables need, in steps of powers of two."""
    prefix = f"{FOLDER}/rtl/"
    sources = {name.removeprefix(prefix): data for name, data in bundle.files.items() if name.startswith(prefix)}
    sources = {name.replace("/", "_"): data for name, data in sources.items() if name.endswith((".v", ".sv"))}
    bench = {path.name: path.read_bytes() for path in BENCH.iterdir() if path.name.endswith((".v", ".cpp"))}
    clocks = {"clocked.v", "clocked.cpp"}
    units = len(tables.units)
    depth, headers = stimuli.sizes(tables)
    return Design(
        sources={**sources, **{name: data for name, data in bench.items() if name not in clocks}},
        for_verilator={"clocked.cpp": bench["clocked.cpp"]},
        for_icarus={"clocked.v": bench["clocked.v"]},
        parameters={
            "UNITS": units,
            "DEPTH": depth,
            "TABLES": headers,
            "SIZE": stimuli.beat_size(tables),
            "FIRST": stimuli.first_window(units),
        },
    )


def simulate(bundle: Bundle, tables: Tables, engine: Engine, *, seed: int, cycles: int) -> Iterator[Played]:
    """Build the bench and yield each run with its verdict; raise `HalpipeError` when the simulator fails.

    With `cycles`, every mode is played that often before it is left, and all switches are made in every run; without,
    as much as fits into the cycles that the engine simulates in a short time: random traffic has excerpts of tables.
    """
    with scratch_folder() as folder:
        player = engine.build(design_of(bundle, tables), folder)
        for number, traffic in enumerate((stimuli.STEPPED, *stimuli.TRAFFIC)):
            share = STEPPED_CYCLES[engine.name] if traffic.is_silent else CYCLES[engine.name][number > 1]
            share = share if traffic.is_silent else share // len(tables.units)
            length = traffic.cycles or tables.platform.window_cycles
            windows = 2**31 if cycles and not traffic.is_silent else max(4, share // length)
            played = stimuli.excerpt(tables, windows) if number > 1 and not cycles else tables
            run = stimuli.plan(played, traffic, seed, windows=windows, repeats=1 if traffic.is_silent else cycles or 1)
            loaded = bundle if played is tables else replace(bundle, files=images(played))
            yield Played(run, judge(played, run, play(loaded, played, player, run), bundle.at(FOLDER)))


def play(bundle: Bundle, tables: Tables, player: Player, run: Run) -> bytes:
    """Simulate one run in a folder of its own and return the trace."""
    with scratch_folder() as folder:
        place = Path(folder)
        for unit in tables.units:
            for name, empty in zip(image_names(unit), (b"", b"0\n" * stimuli.sizes(tables)[1]), strict=True):
                content = empty if run.traffic.by_software else bundle.files.get(name, b"")
                (place / Path(name).name).write_bytes(content)
        (place / "script.txt").write_bytes(stimuli.format_script(run.script))
        player.run(folder, *_arguments(tables, run))
        return (place / "trace.txt").read_bytes()


def _arguments(tables: Tables, run: Run) -> list[str]:
    platform = tables.platform
    kinds = "".join(f"{kind:02x}" for kind in reversed(run.kinds))
    longest = min(256, max(1, platform.burst_bytes // platform.bus_bytes))
    # The memory takes what is shown within a window; so it is with one that serves its capacity, and is assumed.
    settings = {
        "cycles": run.cycles,
        "extra": run.extra.numerator,
        "of": run.extra.denominator,
        "windows": len(run.expected),
        "seed": run.seed % 2**32,
        "hold": len(run.expected) * run.cycles * 3 // 4 if run.traffic.is_owing else 0,
        "latency": min(run.traffic.latency, max(0, run.cycles - 2 * len(tables.units) * longest)),
        "depth": run.traffic.depth,
        "longest": 1 if run.traffic.is_owing else longest,
    }
    return [*(f"+{name}={value}" for name, value in settings.items()), f"+kinds={kinds}"]
