"""The schedule of a system: for every mode one table of jobs (theta, lambda, phi), and the tables between modes."""

from __future__ import annotations

from dataclasses import field, replace
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import NOWHERE, Location
from halpipe.core.quantities import format_percent
from halpipe.core.records import record
from halpipe.models.attributes import (
    DIGEST,
    DURATION,
    INDEX,
    NAME,
    NAMES,
    NUMBER,
    TEXT,
    TIMES,
    attribute,
    held,
    kept,
    named,
    word,
)
from halpipe.models.words import HealthAction, HealthEvent, Word

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from fractions import Fraction

    from halpipe.core.durations import Duration


class Status(Word):
    """Status that the author of a table claims; only verify decides."""

    VALID = "valid"
    NOT_FOUND = "not-found"


@record(kw_only=True)
class Part:
    """A part k of a job with gaps: wall-clock [start, end), execution [executed_from, executed_to) (MODEL 8.2)."""

    start: Duration = field(metadata=attribute(DURATION))
    end: Duration = field(metadata=attribute(DURATION))
    executed_from: Duration = field(
        metadata=attribute(
            DURATION, "What the part executes: from here, in execution time from the start of the job,", name="from"
        )
    )
    executed_to: Duration = field(metadata=attribute(DURATION, "to here.", name="to"))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Job:
    """Job `index` of a task: start theta in [0, t_P), end (may pass t_P), version lambda, units phi.

    A job in one piece has no `parts`, and ends its reserved length after its start: its WCET, if no interrupts are
    served on its units. A job with gaps has a part before, between and after them; their instants are not reduced
    modulo t_P.
    """

    task: str = field(metadata=attribute(NAME))
    index: int = field(metadata=attribute(INDEX, "Counts from 0 in each task."))
    start: Duration = field(metadata=attribute(DURATION, "In [0, hyperperiod); in a transition table, in [0, length)."))
    end: Duration = field(
        metadata=attribute(
            DURATION,
            "Start plus WCET, in one piece without interrupts; beyond the hyperperiod where the job wraps round.",
        )
    )
    version: str = field(metadata=attribute(NAME))
    units: tuple[str, ...] = field(metadata=attribute(NAMES, "As many as the gang size."))
    parts: tuple[Part, ...] = field(default=(), metadata=held(Part))
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def occupations(self) -> tuple[tuple[Duration, Duration], ...]:
        """Return when the job occupies its units: the wall-clock intervals [start, end) of its parts, in order."""
        return tuple((part.start, part.end) for part in self.parts) or ((self.start, self.end),)


@record(kw_only=True)
class CostTerms:
    """The terms of the cost function F (paper, section III; MODEL 4), exact.

    `overlap` and `precedence` are times in ticks, `access` in ticks times share of the resource, `unit` a count
    of jobs, `occupancy` and `timeliness` shares in [0, 1]. F = `total` is at most 0 exactly when the mode is valid.
    """

    total: Fraction = field(metadata=attribute(NUMBER))
    overlap: Fraction = field(metadata=attribute(NUMBER))
    access: Fraction = field(metadata=attribute(NUMBER))
    precedence: Fraction = field(metadata=attribute(NUMBER))
    unit: Fraction = field(metadata=attribute(NUMBER))
    occupancy: Fraction = field(metadata=attribute(NUMBER))
    timeliness: Fraction = field(metadata=attribute(NUMBER))


@record(kw_only=True)
class UnitLoad:
    """Busy time of a unit in one hyperperiod, and its share of it."""

    unit: str = field(metadata=attribute(NAME))
    busy: Duration = field(metadata=attribute(DURATION, "In one hyperperiod."))
    share: Fraction = field(metadata=attribute(NUMBER, "Of the hyperperiod."))


@record(kw_only=True)
class ResourceLoad:
    """Highest and mean sum of the bounds in force on a resource over one hyperperiod; None where too long to write."""

    resource: str = field(metadata=attribute(NAME))
    peak: Fraction | None = field(default=None, metadata=attribute(NUMBER, "Highest sum of the bounds in force."))
    mean: Fraction | None = field(default=None, metadata=attribute(NUMBER, "Mean sum of the bounds in force."))


@record(kw_only=True)
class ChainLatency:
    """Worst reaction time and data age of a chain (MODEL 3); None where no data ever arrives.

    The latency is stated where the model limits it, names events, or has a logical execution time (MODEL 10.7).
    """

    name: str = field(metadata=attribute(NAME))
    reaction: Duration | None = field(
        default=None, metadata=attribute(DURATION, "Absent where no data ever arrives at the end of the chain.")
    )
    age: Duration | None = field(default=None, metadata=attribute(DURATION, "Absent as above."))
    latency: Duration | None = field(
        default=None,
        metadata=attribute(DURATION, "Stated where the model limits it, names events, or has a LET; absent as above."),
    )


@record(kw_only=True)
class ModeSchedule:
    """The cyclic schedule of one mode."""

    name: str = field(metadata=attribute(NAME))
    hyperperiod: Duration = field(metadata=attribute(DURATION))
    status: Status = field(metadata=attribute(word(Status), "A claim; only verify decides."))
    margin: Fraction | None = field(
        default=None, metadata=attribute(NUMBER, "Least share of its length by which every job could stay longer.")
    )
    margin_bound: Fraction | None = field(
        default=None, metadata=attribute(NUMBER, "No valid schedule has a larger margin.", name="margin-bound")
    )
    jobs: tuple[Job, ...] = field(metadata=held(Job))
    cost: CostTerms | None = field(default=None, metadata=held(CostTerms, "cost"))
    unit_loads: tuple[UnitLoad, ...] = field(default=(), metadata=held(UnitLoad))
    resource_loads: tuple[ResourceLoad, ...] = field(default=(), metadata=held(ResourceLoad))
    chains: tuple[ChainLatency, ...] = field(default=(), metadata=held(ChainLatency, "chain"))
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def by_task(self) -> Mapping[str, Sequence[Job]]:
        """Return the jobs of each task that has some, in the order given."""
        return kept(self.jobs, _jobs_by_task)

    @property
    def margin_words(self) -> str:
        """The least margin in percent, with the largest that is possible, rounded up; empty where none is stated.

        0 % is said only of a margin that is proven best.
        """
        if self.margin is None:
            return ""
        if self.margin == self.margin_bound:
            return f"{format_percent(self.margin)}, the best possible"
        least = format_percent(self.margin) if self.margin else "none found"
        most = f", at most {format_percent(self.margin_bound, is_bound=True)} is possible" if self.margin_bound else ""
        return least + most


def _jobs_by_task(jobs: tuple[Job, ...]) -> dict[str, list[Job]]:
    found: dict[str, list[Job]] = {}
    for job in jobs:
        found.setdefault(job.task, []).append(job)
    return found


def _latencies(mode: ModeSchedule) -> str:
    return "; ".join(f"{c.name}: {c.reaction or 'never'}, {c.age or 'never'}" for c in mode.chains)


@record(kw_only=True)
class TransitionTable:
    """The jobs started between the last hyperperiod of `source` and the first of `target` (MODEL 5)."""

    source: str = field(metadata=attribute(NAME, name="from"))
    target: str = field(metadata=attribute(NAME, name="to"))
    length: Duration = field(metadata=attribute(DURATION, "Of the table; 0 where the modes fit end to end."))
    worst_latency: Duration = field(
        metadata=attribute(DURATION, "From a request to the first instant of the new mode.")
    )
    status: Status = field(metadata=attribute(word(Status)))
    jobs: tuple[Job, ...] = field(default=(), metadata=held(Job))
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def by_task(self) -> Mapping[str, Sequence[Job]]:
        """Return the jobs of each task that has some, in the order given."""
        return kept(self.jobs, _jobs_by_task)

    @property
    def name(self) -> str:
        """The name in traces, bundles and messages."""
        return f"{self.source}->{self.target}"


@record(kw_only=True)
class Reaction:
    """Reaction to a health rule in `mode`: the rule, and the longest time from its last event to the end (MODEL 9).

    The end is the first instant of mode `target` for a switch, and the end of the last table for a stop; a restart
    has none.
    """

    mode: str = field(metadata=attribute(NAME, "In which mode the rule holds."))
    task: str = field(metadata=attribute(NAME))
    event: HealthEvent = field(metadata=attribute(word(HealthEvent), name="on"))
    count: int = field(metadata=attribute(TIMES))
    cycles: int = field(metadata=attribute(TIMES))
    action: HealthAction = field(metadata=attribute(word(HealthAction)))
    target: str = field(default="", metadata=attribute(NAME, "The mode that a switch leads to.", name="to"))
    within: Duration | None = field(
        default=None,
        metadata=attribute(
            DURATION,
            "The longest time from the last event to the first instant of that mode, or to the end of the last table.",
        ),
    )
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Schedule:
    """Schedules of all modes of one model, tied to it by `model` (its name) and `model_sha256` (its file)."""

    model: str = field(metadata=attribute(NAME))
    model_sha256: str = field(default="", metadata=attribute(DIGEST, always=True))
    generator: str = field(default="", metadata=attribute(TEXT))
    solver: str = field(default="", metadata=attribute(TEXT))
    seed: int | None = field(default=None, metadata=attribute(INDEX))
    tick: Duration | None = field(default=None, metadata=attribute(DURATION))
    modes: tuple[ModeSchedule, ...] = field(default=(), metadata=held(ModeSchedule, "mode"))
    transitions: tuple[TransitionTable, ...] = field(default=(), metadata=held(TransitionTable, "transition"))
    reactions: tuple[Reaction, ...] = field(default=(), metadata=held(Reaction))
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def all_jobs(self) -> list[Job]:
        """Return the jobs of all modes, then those of all switches."""
        jobs = [job for mode in self.modes for job in mode.jobs]
        return jobs + [job for table in self.transitions for job in table.jobs]

    def _repr_html_(self) -> str:
        """Return what a notebook shows: the modes with their jobs and chains, and the switches."""
        from html import escape

        rows = [
            (mode.name, str(mode.hyperperiod), str(len(mode.jobs)), _latencies(mode), str(mode.status))
            for mode in self.modes
        ]
        rows += [
            (f"{t.source} to {t.target}", str(t.length), str(len(t.jobs)), "", str(t.status)) for t in self.transitions
        ]
        head = ("mode", "length", "jobs", "chains: reaction, age", "claimed")
        lines = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
        return f"<table><tr>{''.join(f'<th>{name}</th>' for name in head)}</tr>{lines}</table>"

    def plot(self, mode: str = "") -> Any:
        """Draw the jobs of a mode, else of the first, on a line for each unit; return the axes of matplotlib.

        A task has one colour. Times are in milliseconds, as floats: the drawing decides nothing.
        """
        try:
            from matplotlib import pyplot
        except ModuleNotFoundError as missing:
            help = "plot() draws with matplotlib: pip install 'halpipe[plot]'"
            raise ModuleNotFoundError(help, name=missing.name) from None
        table = self.mode(mode) if mode else self.modes[0]
        units = sorted({unit for job in table.jobs for unit in job.units}, reverse=True)
        tasks = list(dict.fromkeys(job.task for job in table.jobs))
        _, axes = pyplot.subplots(figsize=(10, 1 + 0.5 * len(units)))
        for task in tasks:
            for place, unit in enumerate(units):
                held = [job.occupations() for job in table.jobs if job.task == task and unit in job.units]
                bars = [(start, end) for spans in held for start, end in spans]
                spans = [(float(start.in_unit("ms")), float((end - start).in_unit("ms"))) for start, end in bars]
                axes.broken_barh(spans, (place - 0.4, 0.8), color=f"C{tasks.index(task)}", label=task)
        named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
        axes.legend(named.values(), named, loc="upper left", bbox_to_anchor=(1, 1))
        axes.set(title=table.name, xlabel="ms", yticks=range(len(units)), yticklabels=units)
        axes.set_xlim(0, float(table.hyperperiod.in_unit("ms")))
        return axes

    def alone(self, modes: tuple[ModeSchedule, ...], transitions: tuple[TransitionTable, ...] = ()) -> Schedule:
        """Return the schedule of these modes, with no more than these switches and without reactions."""
        return replace(self, modes=modes, transitions=transitions, reactions=())

    def mode(self, name: str) -> ModeSchedule:
        """Return the schedule of the mode called `name`; raise ``KeyError`` if there is none."""
        return named(self.modes, name)
