"""Random regulated systems: schedules that use the memory to the last bit, off every grid, with switches between modes.

Each unit runs one job that lasts the whole hyperperiod and wraps at a random instant; its access phases have random
bounds, at most 1 in sum at every instant, in whole cycles of the bus.
"""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

from halpipe.core.durations import Duration
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.models import (
    Access,
    AccessKind,
    Job,
    Mode,
    ModeSchedule,
    Resource,
    Run,
    Schedule,
    Status,
    Task,
    TaskModel,
    Transition,
    TransitionTable,
    Unit,
    Version,
)

CYCLE = Fraction(10)  # nanoseconds; a clock of 100 MHz


@dataclass(frozen=True)
class Shape:
    """What a configuration is like."""

    units: int
    window: int  # cycles
    bus: int  # bytes
    burst: int  # bytes
    load: Fraction  # highest sum of the bounds
    modes: tuple[int, ...]  # windows of their hyperperiods


def random_shape(rng):
    bus = rng.choice([8, 16])
    burst = bus * rng.choice([4, 8, 16])
    window = rng.choice([4, 6, 8, 12]) * 64
    return Shape(
        units=4,
        window=window,
        bus=bus,
        burst=burst,
        load=rng.choice([Fraction(1), Fraction(1), Fraction(4, 5), Fraction(1, 2)]),
        modes=tuple(rng.randint(8, 24) for _ in range(2)),
    )


def random_system(rng, shape):
    """A model and a schedule of two modes: a switch with jobs of its own, and one that waits for what is left over.

    With half a load it does not wait: the first cycle of the new mode then runs on top of what is left over.
    """
    units = [f"u{n}" for n in range(shape.units)]
    tasks, tables, transitions = {unit: [] for unit in units}, [], []
    for number, windows in enumerate(shape.modes):
        span = windows * shape.window
        turn = rng.choice([0, rng.randrange(span)]) if number == 0 else 0  # mode 1 starts on the edge
        phases = _phases(rng, units, span, shape)
        tables.append((f"m{number}", span, turn))
        for unit in units:
            tasks[unit].append(_version(f"m{number}", unit, span, phases[unit]))
    length = rng.randint(1, 4) * shape.window
    phases = _phases(rng, units, length, shape)
    model = TaskModel(
        name="random",
        units=tuple(Unit(name=unit) for unit in units),
        resources=(Resource(name="mem"),),
        tasks=tuple(
            Task(
                name=f"t{unit}",
                period=_time(max(span for _, span, _ in tables)),
                versions=(*tasks[unit], _version("switch", unit, length, phases[unit])),
            )
            for unit in units
        ),
        modes=tuple(
            Mode(name=name, runs=tuple(Run(task=f"t{unit}", versions=(name,)) for unit in units)) for name, *_ in tables
        ),
        transitions=(Transition(source="m0", target="m1"), Transition(source="m1", target="m0")),
    )
    modes = tuple(
        ModeSchedule(
            name=name,
            hyperperiod=_time(span),
            status=Status.VALID,
            jobs=tuple(_job(unit, name, turn, span) for unit in units),
        )
        for name, span, turn in tables
    )
    tail = -(-tables[0][2] // shape.window) * shape.window  # what is left over of mode 0
    for source, target, length_, jobs in (
        ("m1", "m0", length, tuple(_job(unit, "switch", 0, length) for unit in units)),
        ("m0", "m1", 0 if shape.load <= Fraction(1, 2) else tail, ()),
    ):
        transitions.append(
            TransitionTable(
                source=source,
                target=target,
                length=_time(length_),
                worst_latency=_time(length_),
                status=Status.VALID,
                jobs=jobs,
            )
        )
    return model, Schedule(model="random", model_sha256="", modes=modes, transitions=tuple(transitions))


def _time(cycles):
    return Duration(cycles * CYCLE)


def _version(name, unit, span, phases):
    accesses = tuple(
        Access(resource="mem", start=_time(a), end=_time(b), bound=bound, kind=kind) for a, b, bound, kind in phases
    )
    return Version(name=name, wcet=_time(span), units=(unit,), accesses=accesses)


def _job(unit, version, start, span):
    return Job(task=f"t{unit}", index=0, start=_time(start), end=_time(start + span), version=version, units=(unit,))


def _phases(rng, units, span, shape):
    """For each unit (start, end, bound, kind); the sum of the bounds is 1, or less, at every instant."""
    count = min(rng.randint(2, 7), span // 2)
    edges = [0, *sorted(rng.sample(range(1, span), count)), span]
    found = {unit: [] for unit in units}
    for a, b in pairwise(edges):
        weights = [rng.choice([0, 1, 2, 5, 9]) * 100 + rng.randint(0, 99) for _ in units]
        total = sum(weights) / shape.load
        for unit, weight in zip(units, weights, strict=True):
            if weight:
                kind = rng.choice([*AccessKind, None])
                found[unit].append((a, b, weight / total, kind))
    return found


def export(folder, model, schedule, shape, *, rounding="controlled"):
    """The bundle that the exporter writes for a platform of this shape.

    What is not guaranteed has room for a burst of every row that is carried over.
    """
    path = folder / "platform.yaml"
    capacity = shape.bus * 100 * 10**6
    carried = 2 * shape.units * shape.burst * 100 * 10**6
    guaranteed = capacity - -(-carried // shape.window)
    units = "".join(f"  {unit.name}: {{manager: {n}}}\n" for n, unit in enumerate(model.units))
    path.write_text(
        f"halpipe-regulator: 1\nname: random\nresource: mem\nclock: 100MHz\nbus: {shape.bus * 8}bit\n"
        f"burst: {shape.burst}B\nwindow: {shape.window}\nguaranteed: {guaranteed}B/s\n"
        f"capacity: {capacity}B/s\nbackend: table\nunits:\n{units}"
    )
    return RegulatorExporter().write(model, schedule, RegulatorOptions(platform=str(path), rounding=rounding))
