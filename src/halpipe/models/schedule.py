"""The schedule of a system: for every mode one table of jobs (theta, lambda, phi), and the tables between modes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from halpipe.diagnostics import NOWHERE, Location
from halpipe.models.system import HealthAction, HealthEvent, Word

if TYPE_CHECKING:
    from fractions import Fraction

    from halpipe.durations import Duration


class Status(Word):
    """What the author of a table claims of it; only verify decides."""

    VALID = "valid"
    NOT_FOUND = "not-found"


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A part k of a job with gaps: wall-clock [start, end), execution [executed_from, executed_to) (MODEL 8.2)."""

    start: Duration
    end: Duration
    executed_from: Duration
    executed_to: Duration
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """Job `index` of a task: start theta in [0, t_P), end (may pass t_P), version lambda, units phi.

    A job in one piece has no `parts`, and ends its reserved length after its start: its WCET, if no interrupts are
    served on its units. A job with gaps has a part before, between and after them; their instants are not reduced
    modulo t_P.
    """

    task: str
    index: int
    start: Duration
    end: Duration
    version: str
    units: tuple[str, ...]
    parts: tuple[Part, ...] = ()
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def occupations(self) -> tuple[tuple[Duration, Duration], ...]:
        """Return when the job occupies its units: the wall-clock intervals [start, end) of its parts, in order."""
        return tuple((part.start, part.end) for part in self.parts) or ((self.start, self.end),)


@dataclass(frozen=True, slots=True, kw_only=True)
class CostTerms:
    """The terms of the cost function F (paper, section III; MODEL 4), exact.

    `overlap` and `precedence` are times in ticks, `access` in ticks times share of the resource, `unit` a count
    of jobs, `occupancy` and `timeliness` shares in [0, 1]. F = `total` is at most 0 exactly when the mode is valid.
    """

    total: Fraction
    overlap: Fraction
    access: Fraction
    precedence: Fraction
    unit: Fraction
    occupancy: Fraction
    timeliness: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class UnitLoad:
    """Busy time of a unit in one hyperperiod, and its share of it."""

    unit: str
    busy: Duration
    share: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class ResourceLoad:
    """Highest and mean sum of the bounds in force on a resource over one hyperperiod."""

    resource: str
    peak: Fraction
    mean: Fraction


@dataclass(frozen=True, slots=True, kw_only=True)
class ChainLatency:
    """Worst reaction time and data age of a chain (MODEL 3); None where no instance ever gets through."""

    name: str
    reaction: Duration | None
    age: Duration | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ModeSchedule:
    """The cyclic schedule of one mode."""

    name: str
    hyperperiod: Duration
    status: Status
    jobs: tuple[Job, ...]
    cost: CostTerms | None = None
    unit_loads: tuple[UnitLoad, ...] = ()
    resource_loads: tuple[ResourceLoad, ...] = ()
    chains: tuple[ChainLatency, ...] = ()
    at: Location = field(default=NOWHERE, compare=False, repr=False)


def _latencies(mode: ModeSchedule) -> str:
    return "; ".join(f"{c.name}: {c.reaction or 'never'}, {c.age or 'never'}" for c in mode.chains)


@dataclass(frozen=True, slots=True, kw_only=True)
class TransitionTable:
    """The jobs started between the last hyperperiod of `source` and the first of `target` (MODEL 5)."""

    source: str
    target: str
    length: Duration
    worst_latency: Duration
    status: Status
    jobs: tuple[Job, ...] = ()
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Reaction:
    """What a health rule leads to in `mode`: the rule, and the longest time from its last event to the end (MODEL 9).

    The end is the first instant of mode `target` for a switch, and the end of the last table for a stop; a restart
    has none.
    """

    mode: str
    task: str
    event: HealthEvent
    count: int
    cycles: int
    action: HealthAction
    target: str = ""
    within: Duration | None = None
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Schedules of all modes of one model, tied to it by `model` (its name) and `model_sha256` (its file)."""

    model: str
    model_sha256: str
    generator: str = ""
    solver: str = ""
    seed: int | None = None
    tick: Duration | None = None
    modes: tuple[ModeSchedule, ...] = ()
    transitions: tuple[TransitionTable, ...] = ()
    reactions: tuple[Reaction, ...] = ()
    at: Location = field(default=NOWHERE, compare=False, repr=False)

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

    def alone(self, modes: tuple[ModeSchedule, ...], transitions: tuple[TransitionTable, ...] = ()) -> Schedule:
        """Return the schedule of these modes, with no more than these switches and without reactions."""
        return replace(self, modes=modes, transitions=transitions, reactions=())

    def mode(self, name: str) -> ModeSchedule:
        """Return the schedule of the mode called `name`; raise ``KeyError`` if there is none."""
        for mode in self.modes:
            if mode.name == name:
                return mode
        raise KeyError(name)
