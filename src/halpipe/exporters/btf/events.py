"""Lines of a BTF trace (BTF 2.1.5), and the run that they describe.

Trace Compass ties tasks to cores only where a core's name begins with ``Core`` and a task's with ``TASK``. The start of
each table is marked by a stimulus, so that a comparison needs no guess. A job is activated at its release, from which
tools count response times; a job of a transition table or of a task on demand has none, and is activated at its start.
A job runs one runnable, the code of its version: the function that the version states, or ``<task>.<version>``.
"""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.records import record
from halpipe.exporters.common.timeline import delays_of
from halpipe.models.modes import tour

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.exporters.btf import BtfOptions
    from halpipe.models import Job, Schedule, TaskModel

CREATED = "1970-01-01T00:00:00Z"
"""The format wants a date; the same schedule gives the same bytes, so it is always this one."""

_LEAVE, _TERMINATE, _MARK, _ACTIVATE, _START, _ENTER = range(6)
"""At one instant: ends and pauses first, then marks, then begins and resumptions; runnables within their tasks."""


@record
class Piece:
    """A table of the run, played from `start` on."""

    name: str
    start: Duration
    jobs: tuple[Job, ...]


def format_btf(model: TaskModel, schedule: Schedule, options: BtfOptions) -> str:
    """Return the trace of a run through every mode and switch that can be reached from the first mode."""
    pieces, unreached = run_of(schedule, options.cycles)
    mixed = _overlapping(pieces)
    runnables = {
        (task.name, version.name): f"RUN_{version.source.entry if version.source else f'{task.name}.{version.name}'}"
        for task in model.tasks
        for version in (() if task.name in mixed else task.versions)
    }
    events, rounded, early = _events(pieces, _releases(model, schedule), runnables)
    header = [
        "#version 2.1.5",
        "#creator halpipe",
        f"#creationDate {CREATED}",
        "#timeScale ns",
        f"# {options.title or model.name}",
        f"# model SHA-256 {schedule.model_sha256}",
        f"# {rounded} instants rounded down to whole nanoseconds",
        *([f"# {early} releases before the trace begins stand at 0"] if early else []),
        *(f"# without runnables, since jobs of it overlap: TASK_{task}" for task in sorted(mixed)),
        *(f"# not reached from {schedule.modes[0].name}: {name}" for name in unreached),
        *_entities(pieces, runnables),
    ]
    return "\n".join([*header, *events]) + "\n"


def run_of(schedule: Schedule, cycles: int) -> tuple[list[Piece], list[str]]:
    """Return a run that plays each mode `cycles` times per visit and takes every switch at least once.

    Also return the names of modes and switches that no allowed path from the first mode leads to.
    """
    switches = {(table.source, table.target): table for table in schedule.transitions}
    modes = {mode.name: mode for mode in schedule.modes}
    first = schedule.modes[0].name
    path = [first, *tour(first, schedule.transitions, dict.fromkeys(switches))]
    pieces, now = [], ZERO
    for before, mode in zip(["", *path], path, strict=False):
        if before:
            switch = switches[before, mode]
            pieces.append(Piece(switch.name, now, switch.jobs))
            now += switch.length
        for _ in range(cycles):
            pieces.append(Piece(mode, now, modes[mode].jobs))
            now += modes[mode].hyperperiod
    seen = {piece.name for piece in pieces}
    names = [*modes, *(table.name for table in schedule.transitions)]
    return pieces, [name for name in names if name not in seen]


def _entities(pieces: list[Piece], runnables: Mapping[tuple[str, str], str]) -> list[str]:
    """Return the tables of types and entities, which viewers read for their trees."""
    tasks = dict.fromkeys(f"TASK_{job.task}" for piece in pieces for job in piece.jobs)
    cores = dict.fromkeys(f"Core_{unit}" for piece in pieces for job in piece.jobs for unit in job.units)
    marks = dict.fromkeys(f"STI_TABLE_{piece.name}" for piece in pieces)
    stimuli = dict.fromkeys(f"STI_{job.task}" for piece in pieces for job in piece.jobs)
    played = {(job.task, job.version) for piece in pieces for job in piece.jobs}
    codes = {runnables[key] for key in played & runnables.keys()}
    types = {"C": sorted(cores), "T": sorted(tasks), "R": sorted(codes), "STI": sorted([*marks, *stimuli])}
    names = [(kind, name) for kind, found in types.items() for name in found]
    return [
        "#typeTable",
        *(f"#-{number} {kind}" for number, kind in enumerate(types)),
        "#entityTable",
        *(f"#-{number} {name}" for number, (_, name) in enumerate(names)),
        "#entityTypeTable",
        *(f"#-{kind} {name}" for kind, name in names),
    ]


def _releases(model: TaskModel, schedule: Schedule) -> dict[tuple[str, str, int], Duration]:
    """Return how long after its release each job of a periodic task starts, by mode, task and index."""
    found = {}
    for mode in schedule.modes:
        for name, jobs in mode.by_task().items():
            task = model.task(name)
            if task.period is not None:
                delays = delays_of(task, task.period, jobs, mode.hyperperiod)
                found.update({(mode.name, name, j.index): late for j, late in zip(jobs, delays, strict=True)})
    return found


def _overlapping(pieces: list[Piece]) -> set[str]:
    """Return the tasks of which a job starts before the one before ends: tools find a runnable's core by its task."""
    ends: dict[str, Duration] = {}
    found = set()
    for piece in pieces:
        for job in sorted(piece.jobs, key=lambda job: job.start.ns):
            if piece.start + job.start < ends.get(job.task, ZERO):
                found.add(job.task)
            ends[job.task] = max(piece.start + job.end, ends.get(job.task, ZERO))
    return found


def _events(
    pieces: list[Piece],
    delays: Mapping[tuple[str, str, int], Duration],
    runnables: Mapping[tuple[str, str], str],
) -> tuple[list[str], int, int]:
    """Return the events in the order of time, how many instants are rounded, and how many releases come too early."""
    found: list[tuple[int, int, str]] = []
    instances: Counter[str] = Counter()
    rounded = early = 0

    def put(at: Duration, rank: int, text: str) -> None:
        nonlocal rounded
        whole = int(at.ns // 1)
        rounded += at.ns != whole
        found.append((whole, rank, text))

    for cycle, piece in enumerate(pieces):
        put(piece.start, _MARK, f"STI_TABLE_{piece.name},{cycle},STI,STI_TABLE_{piece.name},{cycle},trigger")
        for job in sorted(piece.jobs, key=lambda job: (job.start.ns, job.task, job.index)):
            stretches = [(piece.start + start, piece.start + end) for start, end in job.occupations()]
            start, end = stretches[0][0], stretches[-1][1]
            release = start - delays.get((piece.name, job.task, job.index), ZERO)
            early += release < ZERO
            for unit in job.units:
                # A gang job is one instance on each of its units: BTF knows jobs on one core only.
                name, instance = job.task, instances[job.task]
                instances[name] += 1
                put(max(release, ZERO), _ACTIVATE, f"STI_{name},{instance},T,TASK_{name},{instance},activate")
                on = f"Core_{unit},0,T,TASK_{name},{instance}"
                put(start, _START, f"{on},start")
                for (_, pause), (again, _) in pairwise(stretches):
                    put(pause, _TERMINATE, f"{on},preempt")
                    put(again, _START, f"{on},resume")
                put(end, _TERMINATE, f"{on},terminate")
                if (runnable := runnables.get((name, job.version))) is None:
                    continue
                within = f"TASK_{name},{instance},R,{runnable},{instance}"
                for number, (enter, leave) in enumerate(stretches, 1):
                    put(enter, _ENTER, f"{within},{'start' if number == 1 else 'resume'}")
                    put(leave, _LEAVE, f"{within},{'terminate' if number == len(stretches) else 'suspend'}")
    found.sort(key=lambda event: event[:2])
    return [f"{at},{text}" for at, _, text in found], rounded, early
