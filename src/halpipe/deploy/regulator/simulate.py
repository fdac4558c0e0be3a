"""Simulation of the tables of a bundle on its own Verilog, by Verilator or, as the second choice, Icarus Verilog.

A bench that Verilator has compiled is kept in the user's cache, by the hash of everything it was made of, so that the
next check of a bundle with as many units starts at once. What the monitor of the bench counts is judged window by
window, by the tables and by nothing of the regulator.
"""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.caches import cache_folder, is_ours, keep
from halpipe.core.diagnostics import Code, Diagnostic, HalpipeError, Location, about
from halpipe.core.files import sha256
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.core.records import record
from halpipe.deploy.regulator import codes, stimuli
from halpipe.deploy.regulator.codes import ENGINE_FAILED, NO_ENGINE
from halpipe.deploy.regulator.forms import FOLDER, image_names, images
from halpipe.deploy.regulator.reading import DIRECTIONS, Table, Tables, Unit

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.regulator.stimuli import Expected, Run

FIELDS = 13
UNKNOWN = 2**32 - 2
_FAULTS = (
    "a read was withdrawn or changed before it was taken",
    "a write was withdrawn or changed before it was taken",
    "a burst passed on one side of the regulator only",
    "data was shown to the memory before its address",
    "table or window changed within a window",
    "data was held back although its address had been shown",
    "more than 255 writes were shown whose data had not passed",
)
_HELP = "the Verilog in the bundle or its tables were changed; export the bundle again"


@record
class Count:
    """One direction of one unit in one window, in bytes: taken; of these carried over; shown and left waiting."""

    taken: int
    carried: int
    waiting: int

    def admitted(self, owed: int) -> int:
        """Return the bytes first shown in this window; `owed` was waiting when it began."""
        still = owed and self.taken == 0 and self.waiting == owed
        return self.taken - self.carried + (0 if still else self.waiting)


@dataclass(slots=True)
class Verdict:
    """Figures of a run, and its findings."""

    run: Run
    windows: int = 0
    granted: int = 0
    used: int = 0
    carried: int = 0
    largest_sum: int = 0
    findings: list[Diagnostic] = field(default_factory=list)


def judge(tables: Tables, run: Run, trace: bytes, at: Location) -> Verdict:
    """Return the verdict on the trace of a run."""
    judge = _Judge(tables, run, at)
    for line in trace.decode("latin-1").splitlines():
        judge.line(line)
    judge.finish()
    return judge.verdict


class _Judge:
    """Reads a trace and reports the first finding of each kind on each row, with the number of further ones."""

    def __init__(self, tables: Tables, run: Run, at: Location) -> None:
        self.verdict = Verdict(run)
        self._tables, self._run, self._at = tables, run, at
        self._rows = list(tables.rows())
        self._owed = [0] * len(self._rows)
        self._noted: dict[tuple[Code, str], tuple[str, int]] = {}
        self._faults = 0
        self._reads = {(cycle, address): value for cycle, address, value in run.reads}
        self._budgets: dict[tuple[int, int, str], list[int]] = {}

    def line(self, text: str) -> None:
        words = text.split()
        try:
            numbers = [int(word) for word in words[1:]]
        except ValueError:  # Verilog's x: a register that was never written
            numbers = [int(word) if word.isdecimal() else UNKNOWN for word in words[1:]]
        if words[:1] == ["R"]:
            self._register(*numbers)
        elif words[:1] == ["W"]:
            self._window(numbers[0], numbers[1:])

    def finish(self) -> None:
        """Make the findings of what was seen, and of what should have been."""
        for cycle, address in self._reads:
            self._note(codes.BROKE_PROTOCOL, "registers", f"register {address:#x} was not read in cycle {cycle}")
        if self.verdict.windows != len(self._run.expected):
            text = f"the trace has {self.verdict.windows} windows, {len(self._run.expected)} were simulated"
            self._note(codes.PLAYED_WRONG, "trace", text)
        name = self._run.traffic.name
        for (code, path), (text, times) in self._noted.items():
            more = times - 1
            tail = f", and {more} windows more" if more else ""
            message = f"{text}{tail} (traffic: {name}, seed {self._run.seed})"
            self.verdict.findings.append(code(message, at=self._at, path=path, help=_HELP))

    def _note(self, code: Code, path: str, text: str) -> None:
        first, times = self._noted.get((code, path), (text, 0))
        self._noted[code, path] = first, times + 1

    def _register(self, cycle: int, address: int, value: int) -> None:
        expected = self._reads.pop((cycle, address), None)
        if expected is not None and expected != value:
            text = f"register {address:#x} held {value:#x} in cycle {cycle}, it must hold {expected:#x}"
            self._note(codes.BROKE_PROTOCOL, "registers", text)

    def _window(self, number: int, fields: Sequence[int]) -> None:
        self.verdict.windows += 1
        if number >= len(self._run.expected):
            return
        expected = self._run.expected[number]
        total = 0
        for unit in self._tables.units:
            base = FIELDS * unit.index
            self._played(number, expected, unit.name, fields[base], fields[base + 1])
            self._protocol(number, unit.name, fields[base + 10])
            for half, direction in enumerate(DIRECTIONS):
                count = Count(*fields[base + 2 + 3 * half : base + 5 + 3 * half])
                budget = self._budget(expected, unit, direction)
                self._row(number, 2 * unit.index + half, count, budget, fields[base + 11 + half])
                total += count.taken
        self.verdict.largest_sum = max(self.verdict.largest_sum, total)
        if total > self._tables.platform.capacity_bytes:
            text = f"{total} B in window {number}, the capacity is {self._tables.platform.capacity_bytes} B"
            self._note(codes.SHARED_TOO_MUCH, "all units", text)

    def _row(self, number: int, row: int, count: Count, budget: int, left: int) -> None:
        """Hold one direction of one unit against its budget.

        What was shown before and not yet taken is charged to this window as well; all else must fit the rest, which is
        also what the regulator must have `left` when the window begins.
        """
        owed, self._owed[row] = self._owed[row], count.waiting
        room = max(0, budget - owed)
        admitted = count.admitted(owed)
        self.verdict.granted += budget
        self.verdict.used += count.taken
        self.verdict.carried += count.carried > 0
        unit, direction = self._rows[row]
        path = f'unit "{unit.name}", {direction}'
        if admitted > room or count.carried > owed:
            text = f"{count.taken} B in window {number} ({self._where(number)}), the budget is {budget} B"
            self._note(codes.SPENT_TOO_MUCH, path, text)
        if left != room:
            code = codes.SPENT_TOO_MUCH if left > room else codes.GOT_TOO_LITTLE
            text = f"has {left} B in window {number} ({self._where(number)}), it must have {room} B"
            self._note(code, path, text)
        is_asking = self._run.kinds[unit.index] >> (4 * (direction == "write")) & 1
        if self._run.traffic.greedy and is_asking and admitted < room - room % self._tables.platform.burst_bytes:
            text = f"{count.taken} B in window {number} ({self._where(number)}), the budget is {budget} B"
            self._note(codes.GOT_TOO_LITTLE, path, text)

    def _played(self, number: int, expected: Expected, unit: str, table: int, window: int) -> None:
        if (table if expected.running else 0, window) != (expected.table, expected.window):
            found = f'table {table} "{self._name(table)}", window {window}' if window != 2**32 - 1 else "its defaults"
            text = f"plays {found} in window {number}, it must play {self._where(number)}"
            self._note(codes.PLAYED_WRONG, about(unit=unit), text)

    def _protocol(self, number: int, unit: str, faults: int) -> None:
        for bit, what in enumerate(_FAULTS):
            if faults >> bit & 1 and not self._faults >> bit & 1:
                code = codes.PLAYED_WRONG if bit == 4 else codes.BROKE_PROTOCOL
                self._note(code, about(unit=unit), f"{what}, seen in window {number}")
        self._faults |= faults

    def _budget(self, expected: Expected, unit: Unit, direction: str) -> int:
        if not expected.running:
            return 0 if expected.is_calm else unit.default[direction]
        key = (expected.table, unit.index, direction)
        if key not in self._budgets:
            self._budgets[key] = self._tables.tables[expected.table].budgets(unit.name, direction)
        return self._budgets[key][expected.window]

    def _where(self, number: int) -> str:
        expected = self._run.expected[number]
        if not expected.running:
            return "its defaults"
        return f'table {expected.table} "{self._name(expected.table)}", window {expected.window}'

    def _name(self, table: int) -> str:
        known: Sequence[Table] = self._tables.tables
        return known[table].name if 0 <= table < len(known) else "unknown"


CACHE = "regulator"
"""What compiled benches are kept under."""

TOP = "bench"
BUILD_SECONDS = 600
RUN_SECONDS = 1800


@record(kw_only=True)
class Design:
    """Sources by name, with a clock for each engine, and parameters."""

    sources: Mapping[str, bytes]
    parameters: Mapping[str, int]

    def digest(self, engine: str, *tools: str) -> str:
        """Return a name for what `engine` makes of this design with `tools`."""
        parts = [engine, os.uname().machine, *tools, *(f"{name}={self.parameters[name]}" for name in self.parameters)]
        for name, content in sorted(self.sources.items()):
            parts += [name, sha256(content)]
        return sha256("\n".join(parts).encode())


Command = tuple[str, ...]
"""What runs a compiled bench, in a folder that holds the files it reads."""


def run_bench(command: Command, folder: str, *arguments: str) -> None:
    """Run a bench in `folder`; raise `HalpipeError` when it does not come to its end."""
    _call([*command, *arguments], folder, RUN_SECONDS)


class Verilator:
    """Compiles the design to a native program: millions of cycles a second, after a build of some seconds."""

    name = "verilator"
    tools = ("verilator", "g++", "make")

    def build(self, design: Design, folder: str) -> Command:
        """Compile, or take what an earlier check compiled."""
        versions = [run([tool, "--version"]).stdout.partition("\n")[0] for tool in ("verilator", "g++")]
        digest = design.digest(self.name, *versions, *_FLAGS)
        kept = cache_folder(CACHE)
        if kept is not None and is_ours(kept / digest) and os.access(kept / digest, os.X_OK):
            return (str(kept / digest),)
        names = [name for name in _write(folder, design.sources) if name != f"{_ICARUS_TOP}.v"]
        parameters = [f"-G{name}={value}" for name, value in design.parameters.items()]
        quiet = ["-Wno-fatal", "-Wno-lint", "-Wno-style", "--top-module", TOP, "--Mdir", "made", "-o", TOP]
        _call(["verilator", *_FLAGS, *quiet, *parameters, *names], folder, BUILD_SECONDS)
        program = Path(folder, "made", TOP)
        if kept is not None and keep(kept / digest, program.read_bytes(), executable=True):
            program = kept / digest
        return (str(program),)


class Icarus:
    """Interprets the design: starts at once, some ten thousand cycles a second."""

    name = "icarus"
    tools = ("iverilog", "vvp")

    def build(self, design: Design, folder: str) -> Command:
        """Compile to the interpreter's form."""
        sources = [name for name in _write(folder, design.sources) if name.endswith(".v")]
        parameters = [f"-P{_ICARUS_TOP}.{name}={value}" for name, value in design.parameters.items()]
        command = ["iverilog", "-g2005-sv", "-s", _ICARUS_TOP, *parameters, "-o", "bench.vvp", *sources]
        _call(command, folder, BUILD_SECONDS)
        return "vvp", "-n", os.path.join(folder, "bench.vvp")


_ICARUS_TOP = "clocked"
Engine = Verilator | Icarus
ENGINES = (Verilator(), Icarus())


_FLAGS = (
    *("--cc", "--exe", "--build", "-j", "1", "-O3", "--x-assign", "fast", "--noassert"),
    *("-MAKEFLAGS", "OPT_GLOBAL=-O1"),  # Verilator's own library: most of the time of a build, little of a run
)


def _write(folder: str, contents: Mapping[str, bytes]) -> list[str]:
    for name, content in contents.items():
        Path(folder, name).write_bytes(content)
    return sorted(contents)


def _call(command: Sequence[str], folder: str, seconds: int) -> None:
    """Run a tool; its own last words are the message when it fails."""
    tool = os.path.basename(command[0])
    try:
        done = run(command, folder, seconds=seconds)
    except TimeoutExpired:
        raise HalpipeError(_failed(f"{tool}: took more than {seconds} s")) from None
    if done.returncode != 0:
        said = [line.strip() for line in (done.stderr + done.stdout).splitlines() if line.strip()]
        telling = [line for line in said if "rror" in line] or said
        raise HalpipeError(_failed(f"{tool} ended with {done.returncode}: {' | '.join(telling[:3])[:400]}"))


def _failed(message: str) -> Diagnostic:
    help = "look at the message of the tool; --engine arithmetic checks without simulation, another --engine may work"
    return ENGINE_FAILED(message, help=help)


BENCH = files("halpipe.deploy.regulator") / "bench"
CYCLES = {"verilator": (160_000_000, 3_000_000), "icarus": (800_000, 160_000)}
"""Cycles of the greedy run and of each other, of all units together, if the user does not say how many hyperperiods."""

STEPPED_CYCLES = {"verilator": 2**31, "icarus": 400_000}
"""Cycles of the run that steps through every table: whatever it takes, or what an interpreter does in some seconds."""


def choose_engine(wanted: str) -> tuple[Engine | None, str]:
    """Return the engine to use, and in words which one and why not another; raise `HalpipeError` if it is missing."""
    reasons: list[str] = []
    for engine in ENGINES:
        if wanted in ("auto", engine.name):
            missing = [tool for tool in engine.tools if shutil.which(tool) is None]
            if not missing:
                return engine, "; ".join([f"engine {engine.name}", *reasons])
            reasons.append(f"{engine.name}: {', '.join(missing)} not installed")
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
    units = len(tables.units)
    depth, headers = stimuli.sizes(tables)
    return Design(
        sources={**sources, **bench},
        parameters={
            "UNITS": units,
            "DEPTH": depth,
            "TABLES": headers,
            "SIZE": stimuli.beat_size(tables),
            "FIRST": stimuli.first_window(units),
        },
    )


def simulate(bundle: Bundle, tables: Tables, engine: Engine, *, seed: int, cycles: int) -> Iterator[Verdict]:
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
            yield judge(played, run, play(loaded, played, player, run), bundle.at(FOLDER))


def play(bundle: Bundle, tables: Tables, player: Command, run: Run) -> bytes:
    """Simulate one run in a folder of its own and return the trace."""
    with scratch_folder() as folder:
        place = Path(folder)
        for unit in tables.units:
            for name, empty in zip(image_names(unit), (b"", b"0\n" * stimuli.sizes(tables)[1]), strict=True):
                content = empty if run.traffic.by_software else bundle.files.get(name, b"")
                (place / Path(name).name).write_bytes(content)
        (place / "script.txt").write_bytes(stimuli.format_script(run.script))
        run_bench(player, folder, *_arguments(tables, run))
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
