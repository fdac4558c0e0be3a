"""On which units jobs run, as part of a constraint program, in two forms.

`Groups` places times only: units that are treated alike are one capacity, and a sweep assigns them when all starts are
known. That is a small program, but one that may, on a circle, find starts that cannot be assigned.
`Units` decides units and times at once. It is larger, but knows how full each unit is, which counts where nothing may
stay idle.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import Counter
from itertools import chain as concatenated
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import ZERO
from halpipe.pipeline.solve.kernel.assign_units import Arc, assign_units
from halpipe.pipeline.solve.lanes import interchangeable_units, is_bound

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.models import Unit, Version
    from halpipe.pipeline.jobs import ActiveTask, Expansion
    from halpipe.pipeline.solve.exactmodel import JobVars, Program
    from halpipe.pipeline.solve.lanes import UnitGroups

AssignedUnits = dict[tuple[str, int], tuple[str, ...]]
"""The units of every job, by task and index."""

MAX_SPLITS = 64
"""Ways to split a gang over groups of units up to which groups are taken as capacities."""


class Form(ABC):
    """Encoding of the units of jobs in a program; without `is_circle`, it has fewer solutions than the mode."""

    is_circle = True
    names_matter = False
    """Whether units that are treated alike, and turns of the whole schedule, are not the same."""

    def __init__(self, program: Program, units: Sequence[Unit]) -> None:
        self.program = program
        self.groups = interchangeable_units(program.expansion, units, grouped=True)

    @abstractmethod
    def state(self) -> None:
        """Write down variables and constraints."""

    @abstractmethod
    def deal(self, solver: Any) -> AssignedUnits | None:
        """Return the units of all jobs of a solution; None where its starts allow none."""

    def choices(self) -> Iterator[tuple[JobVars, Version, Any]]:
        """Yield the jobs with their versions and the literals of them."""
        for job in concatenated.from_iterable(self.program.tasks.values()):
            for version, chosen in job.versions:
                yield job, version, chosen

    def length(self, version: Version) -> int:
        """Return the WCET in ticks."""
        return self.program.ticks(version.wcet or ZERO)


def forms_of(expansion: Expansion, units: Sequence[Unit]) -> list[type[Form]]:
    """Return the forms in which a mode may be stated, the most promising first."""
    groups = interchangeable_units(expansion, units, grouped=True)
    versions = (version for active in expansion.tasks for version in active.versions)
    has_choice = any(map(is_bound, expansion.tasks))
    if has_choice or any(len(_splits(version, groups)) > MAX_SPLITS for version in versions):
        return [Units]
    return [Groups, Units, Line] if any(len(group) > 1 for group in groups) else [Units, Line]


def _splits(version: Version, groups: UnitGroups) -> list[Counter[int]]:
    """Return how many units of each group a job may take: one group, or all splits of a gang (too many: some)."""
    allowed = frozenset(version.units)
    sizes = {number: len(group) for number, group in enumerate(groups) if group[0] in allowed}
    found = []
    for pick in combinations_with_replacement(sizes, version.gang):
        split = Counter(pick)
        if all(count <= sizes[group] for group, count in split.items()):
            found.append(split)
        if len(found) > MAX_SPLITS:
            break
    return found


class Groups(Form):
    """Groups as capacities; units are assigned when all starts are known."""

    def state(self) -> None:
        """Every job takes its gang of one group, or splits it; no group ever holds more than it has units."""
        program = self.program
        self.taken: list[tuple[JobVars, Version, Counter[int], Any]] = []
        loads: list[list[tuple[int, Any, int]]] = [[] for _ in self.groups]
        intervals: list[list[Any]] = [[] for _ in self.groups]
        heights: list[list[int]] = [[] for _ in self.groups]
        known: dict[int, list[Counter[int]]] = {}
        for job, version, chosen in self.choices():
            if id(version) not in known:
                known[id(version)] = _splits(version, self.groups)
            splits = known[id(version)]
            literals = [chosen] if len(splits) == 1 else [program.literal() for _ in splits]
            if len(splits) != 1:
                program.cp.add(sum(literals) == chosen)
            for split, literal in zip(splits, literals, strict=True):
                self.taken.append((job, version, split, literal))
                for group, count in split.items():
                    parts = program.round_the_circle(job, 0, self.length(version), literal)
                    intervals[group] += parts
                    heights[group] += [count] * len(parts)
                    loads[group].append((self.length(version) * count, literal, count))
        for group, names in enumerate(self.groups):
            if len(names) == 1:
                program.cp.add_no_overlap(intervals[group])
            else:
                program.cp.add_cumulative(intervals[group], heights[group], len(names))
            state_load(program, [(work, literal) for work, literal, _ in loads[group]], len(names) * program.total)

    def deal(self, solver: Any) -> AssignedUnits | None:
        """Colour the arcs of every group: at each start of one, those in force have different units."""
        arcs: list[list[Arc]] = [[] for _ in self.groups]
        keys: list[tuple[str, int]] = []
        for job, version, split, literal in self.taken:
            if not solver.value(literal):
                continue
            for group, count in split.items():
                arcs[group].append(Arc(len(keys), int(solver.value(job.theta)), self.length(version), count))
            keys.append((job.active.name, job.index))
        assigned: AssignedUnits = dict.fromkeys(keys, ())
        for names, members in zip(self.groups, arcs, strict=True):
            coloured = assign_units(members, len(names), self.program.total) if members else {}
            if coloured is None:
                return None
            for number, places in coloured.items():
                assigned[keys[number]] += tuple(names[place] for place in places)
        return assigned


class Line(Groups):
    """Groups on a line: nothing passes the end of the hyperperiod. That is less than the rules allow, and no proof.

    Boards of rectangles that leave nothing idle are found sooner: their pieces meet at the end.
    """

    is_circle = False


class Units(Form):
    """Units and times at once: a literal for each job and unit, and no overlap on any of them."""

    def state(self) -> None:
        """A job takes as many of its version's units as its gang; the jobs of a unit never overlap on the circle."""
        program = self.program
        program.require(2 * sum(len(version.units) for _, version, _ in self.choices()))
        known = [name for group in self.groups for name in group]
        on_unit: dict[str, list[Any]] = {name: [] for name in known}
        loads: dict[str, list[tuple[int, Any]]] = {name: [] for name in known}
        self.units: list[tuple[JobVars, str, Any]] = []
        first_use = _FirstUse(self.groups)
        job = None
        for each, version, chosen in self.choices():
            if each is not job:
                job, reach = each, first_use.reach(each)
            names = [name for name in dict.fromkeys(version.units) if name in on_unit]
            taken = [chosen if len(names) == version.gang == 1 else program.literal() for _ in names]
            if len(names) != version.gang or version.gang != 1:
                program.cp.add(sum(taken) == version.gang * chosen)
            for name, literal in zip(names, taken, strict=True):
                self.units.append((job, name, literal))
                on_unit[name] += program.round_the_circle(job, 0, self.length(version), literal)
                loads[name].append((self.length(version), literal))
                if not (self.names_matter or first_use.allows(name, reach)):
                    program.cp.add(literal == 0)
        for name, intervals in on_unit.items():
            program.cp.add_no_overlap(intervals)
            state_load(program, loads[name], program.total)
        for active in filter(is_bound, program.expansion.tasks):
            self._state_binding(active)
        self._state_group_loads()

    def _state_binding(self, active: ActiveTask) -> None:
        """Let all jobs of a task take the same units."""
        program = self.program
        names = dict.fromkeys(name for version in active.versions for name in version.units)
        units = {name: program.literal() for name in names}
        for job, name, literal in self.units:
            if job.active is active:
                program.cp.add(units[name] >= literal)
        for job in program.tasks[active.name]:
            for version, chosen in job.versions:
                program.cp.add(sum(units.values()) == version.gang).only_enforce_if(chosen)

    def _state_group_loads(self) -> None:
        """Say once more, for units that are treated alike, how many jobs they hold at once: it shortens proofs."""
        for group in self.groups:
            if len(group) < 2:
                continue
            intervals: list[Any] = []
            heights: list[int] = []
            for job, version, chosen in self.choices():
                if set(version.units) == set(group):
                    parts = self.program.round_the_circle(job, 0, self.length(version), chosen)
                    intervals += parts
                    heights += [version.gang] * len(parts)
            self.program.cp.add_cumulative(intervals, heights, len(group))

    def deal(self, solver: Any) -> AssignedUnits | None:
        """Read the units of all jobs."""
        assigned: AssignedUnits = {}
        for job, name, literal in self.units:
            if solver.value(literal):
                key = job.active.name, job.index
                assigned[key] = (*assigned.get(key, ()), name)
        return assigned


class NamedUnits(Units):
    """Units and times, where it matters which of several units that are alike a job has, and when it starts."""

    names_matter = True


def state_load(program: Program, loads: list[tuple[int, Any]], room: int) -> None:
    """Say that work fits into the time there is: a sum in which whole numbers show what intervals do not."""
    if any(not isinstance(literal, int) for _, literal in loads):
        program.cp.add(sum(work * literal for work, literal in loads) <= room)


class _FirstUse:
    """Of units that are treated alike, only the order in which jobs first use them may be fixed: it changes names only.

    The first job takes the first units of a group, and every later one at most as many further as its gang needs.
    """

    def __init__(self, groups: UnitGroups) -> None:
        self._place = {name: (number, at) for number, group in enumerate(groups) for at, name in enumerate(group)}
        self._seen = [0] * len(groups)

    def reach(self, job: JobVars) -> list[int]:
        """Return how many units of every group the jobs up to this one can have used."""
        gangs = [0] * len(self._seen)
        for version, _ in job.versions:
            for group in {self._place[name][0] for name in version.units if name in self._place}:
                gangs[group] = max(gangs[group], version.gang)
        self._seen = [seen + gang for seen, gang in zip(self._seen, gangs, strict=True)]
        return self._seen

    def allows(self, name: str, reach: list[int]) -> bool:
        """Tell whether the unit is among the first that may be in use by now."""
        group, place = self._place[name]
        return place < reach[group]
