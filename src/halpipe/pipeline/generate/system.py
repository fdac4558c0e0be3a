"""From the filled schedule to the task model and its witness (paper, section VI-B)."""

from __future__ import annotations

import math
import random
from bisect import bisect_left
from collections import Counter
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.models import (
    Access,
    Job,
    Mode,
    Precedence,
    Resource,
    Run,
    Schedule,
    Status,
    Task,
    TaskModel,
    Unit,
    Version,
)
from halpipe.pipeline.generate.parameters import TICK, SetParameters
from halpipe.pipeline.generate.tiling import CAPACITY, Window, WindowPlacer, fill_units, unit_types
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.cost import mode_report

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

MODE = "all"
BASE, ALTERNATIVE = "base", "alternative"
STRETCH = Fraction(3, 2)
"""Execution time of an alternative version in terms of the original one."""

EARLIEST, LATEST = Fraction(1, 4), Fraction(7, 4)
"""The window of a precedence constraint in terms of the difference in generated start times."""


@record
class Achieved:
    """Properties of a set: shares of the units' time, of the resources' time, and of the tasks; and its windows."""

    jobs: int
    utilisation: Fraction
    resource_fill: Fraction
    windows: int
    multi_version: Fraction
    precedence: Fraction
    gang: Fraction


def generate(parameters: SetParameters, seed: int) -> TaskModel:
    """Return the task set of these parameters and this seed; raise `HalpipeError` if no set can have them."""
    return _Set(parameters, seed).model()


def generate_with_witness(parameters: SetParameters, seed: int) -> tuple[TaskModel, Schedule]:
    """Return a task set with the schedule it was cut from, which proves that it is schedulable."""
    made = _Set(parameters, seed)
    model = made.model()
    table = mode_report(model, expand(model, model.modes[0]), made.jobs(), Status.VALID)
    return model, Schedule(model=model.name, model_sha256="", solver="witness", seed=seed, tick=TICK, modes=(table,))


def achieved(model: TaskModel) -> Achieved:
    """Measure a generated set: every task in its first version."""
    expansion = expand(model, model.modes[0])
    busy = used = Fraction(0)
    for active in expansion.tasks:
        version = active.task.versions[0]
        busy += (version.wcet or ZERO) / expansion.hyperperiod * active.jobs * version.gang
        for access in version.accesses:
            used += (access.end - access.start) / expansion.hyperperiod * active.jobs * access.bound
    first = [task.versions[0] for task in model.tasks]
    return Achieved(
        jobs=expansion.job_count,
        utilisation=busy / len(model.units),
        resource_fill=used / max(1, len(model.resources)),
        windows=sum(len(version.accesses) for version in first),
        multi_version=Fraction(sum(len(task.versions) > 1 for task in model.tasks), len(model.tasks)),
        precedence=Fraction(sum(bool(version.precedences) for version in first), len(model.tasks)),
        gang=Fraction(sum(version.gang > 1 for version in first), len(model.tasks)),
    )


class _Set:
    """A set while it is made. Indices are positions in `pieces`, in the order of the tasks of the model."""

    def __init__(self, parameters: SetParameters, seed: int) -> None:
        parameters.check()
        self._parameters = parameters
        self._seed = seed
        self._rng = random.Random(seed)
        self._hyperperiod = int(parameters.span / TICK)
        self._types = unit_types(parameters)
        self._pieces = fill_units(parameters, self._rng)
        self._rng.shuffle(self._pieces)
        self._lengths = self._shorten()
        placer = WindowPlacer(parameters, self._pieces, self._lengths, self._hyperperiod)
        placer.place_all(parameters, self._rng)
        self._windows = placer.windows
        self._predecessors = self._connect()
        self._multiple = self._choose_multiple()
        self._barred = self._bar()
        self._names = _names("t", len(self._pieces))
        self._unit_names = _names("u", parameters.units)
        self._resource_names = _names("r", parameters.resources)

    def _shorten(self) -> list[int]:
        """Return the tasks' lengths at the wanted utilisation.

        "All values were then multiplied with the utilization value, resulting in processor idle time." (D) The values
        are the execution times and what lies in them; periods and start times stay, else no idle time would result.
        What rounding takes from one task is given to the next. Where a unit has so few tasks that they cannot fill
        it, they are shortened less; stated periods leave idle time anyway, and are shortened as written.
        """
        jobs = [self._hyperperiod // piece.period * len(piece.units) for piece in self._pieces]
        filled = sum(count * piece.length for count, piece in zip(jobs, self._pieces, strict=True))
        wanted = self._parameters.utilisation
        if not self._parameters.periods:
            wanted = min(Fraction(1), wanted * self._parameters.units * self._hyperperiod / filled)
        lengths = []
        left = 0
        for count, piece in zip(jobs, self._pieces, strict=True):
            left += count * piece.length * wanted.numerator
            length = max(1, min(piece.length, left // (count * wanted.denominator)))
            left -= length * count * wanted.denominator
            lengths.append(length)
        return lengths

    # ---- precedence, alternative versions

    def _connect(self) -> dict[int, tuple[int, int]]:
        """Give tasks a predecessor, and the difference in start times; in shuffled order, up to the wanted share.

        (D) Predecessors start earlier in the generated schedule, so no cycle can arise. All jobs of a task must keep
        the one window, so the predecessor's period divides the task's; the difference is to its latest job before.
        """
        order = self._shuffled()
        wanted = round(self._parameters.precedence * len(order))
        by_period: dict[int, list[tuple[int, int]]] = {}
        for number, piece in sorted(enumerate(self._pieces), key=lambda item: (item[1].start, item[0])):
            by_period.setdefault(piece.period, []).append((piece.start, number))
        chosen: dict[int, tuple[int, int]] = {}
        for number in order if wanted else ():
            own = self._pieces[number]
            earlier = [
                (group, bisect_left(group, (own.start,)))
                for period, group in sorted(by_period.items())
                if own.period % period == 0
            ]
            count = sum(end for _, end in earlier)
            if count:
                start, other = _pick(earlier, self._rng.randrange(count))
                period = self._pieces[other].period
                chosen[number] = other, (own.start - start) % period or period
            if len(chosen) == wanted:
                break
        return chosen

    def _choose_multiple(self) -> frozenset[int]:
        """Choose the tasks with an alternative version, among those whose longer version fits the period."""
        order = self._shuffled()
        fitting = [n for n in order if int(self._lengths[n] * STRETCH) <= self._pieces[n].period]
        return frozenset(fitting[: round(self._parameters.multi_version * len(order))])

    def _bar(self) -> dict[int, int]:
        """Return for every task a unit of its type that it cannot run on, so that no two units are alike (D)."""
        if not self._parameters.unlike_units:
            return {}
        barred: dict[int, int] = {}
        turns: Counter[int] = Counter()
        for number in self._shuffled():
            own = self._pieces[number].units
            kind = self._types[own[0]]
            others = [unit for unit in self._units_of(kind) if unit not in own]
            if others:
                barred[number] = others[turns[kind] % len(others)]
                turns[kind] += 1
        return barred

    def _shuffled(self) -> list[int]:
        order = list(range(len(self._pieces)))
        self._rng.shuffle(order)
        return order

    def _units_of(self, kind: int) -> list[int]:
        return [unit for unit, own in enumerate(self._types) if own == kind]

    # ---- the model and its witness

    def model(self) -> TaskModel:
        """Return the task model."""
        tasks = tuple(self._task(number) for number in range(len(self._pieces)))
        runs = tuple(Run(task=task.name, versions=tuple(v.name for v in task.versions)) for task in tasks)
        return TaskModel(
            name=f"generated-{self._seed}",
            units=tuple(
                Unit(name=name, type=f"type{kind + 1}")
                for name, kind in zip(self._unit_names, self._types, strict=True)
            ),
            resources=tuple(Resource(name=name) for name in self._resource_names),
            tasks=tasks,
            modes=(Mode(name=MODE, runs=runs),),
        )

    def jobs(self) -> Iterator[Job]:
        """Yield the jobs of the schedule that the set was cut from."""
        for number, piece in enumerate(self._pieces):
            for index in range(self._hyperperiod // piece.period):
                start = piece.start + index * piece.period
                yield Job(
                    task=self._names[number],
                    index=index,
                    start=TICK * start,
                    end=TICK * (start + self._lengths[number]),
                    version=BASE,
                    units=tuple(self._unit_names[unit] for unit in piece.units),
                )

    def _task(self, number: int) -> Task:
        piece = self._pieces[number]
        kind = self._types[piece.units[0]]
        valid = [unit for unit in self._units_of(kind) if unit != self._barred.get(number)]
        versions = [self._version(number, BASE, valid, Fraction(1))]
        if number in self._multiple:
            # (D) Alternative versions are for units of another type, where there are enough of them.
            others = self._units_of((kind + 1) % self._parameters.unit_types)
            chosen = others if len(others) >= len(piece.units) else valid
            versions.append(self._version(number, ALTERNATIVE, chosen, STRETCH))
        return Task(
            name=self._names[number],
            period=TICK * piece.period,
            slack=self._parameters.slack,
            versions=tuple(versions),
        )

    def _version(self, number: int, name: str, units: Iterable[int], factor: Fraction) -> Version:
        windows = sorted(self._windows[number], key=lambda window: (window.start, window.resource))
        return Version(
            name=name,
            wcet=TICK * int(self._lengths[number] * factor),
            units=tuple(self._unit_names[unit] for unit in units),
            gang=len(self._pieces[number].units),
            accesses=tuple(self._access(window, factor) for window in windows),
            precedences=tuple(self._precedences(number)),
        )

    def _access(self, window: Window, factor: Fraction) -> Access:
        return Access(
            resource=self._resource_names[window.resource],
            start=TICK * int(window.start * factor),
            end=TICK * int(window.end * factor),
            bound=Fraction(window.height, CAPACITY),
        )

    def _precedences(self, number: int) -> Iterator[Precedence]:
        if number in self._predecessors:
            other, difference = self._predecessors[number]
            low, high = math.floor(difference * EARLIEST), math.ceil(difference * LATEST)
            yield Precedence(task=self._names[other], min=TICK * low, max=TICK * high)


def _pick(groups: list[tuple[list[tuple[int, int]], int]], place: int) -> tuple[int, int]:
    """Return the item at `place` of the beginnings of these lists, laid end to end."""
    for items, end in groups:
        if place < end:
            return items[place]
        place -= end
    raise IndexError(place)


def _names(prefix: str, count: int) -> list[str]:
    """Return names in numeric order that also sort so."""
    digits = len(str(count))
    return [f"{prefix}{number:0{digits}d}" for number in range(1, count + 1)]
