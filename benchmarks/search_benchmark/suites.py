"""What is measured: rows of cells, every cell with several seeds."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Protocol, TypeAlias

from halpipe.core.durations import Duration, milliseconds, seconds
from halpipe.core.records import record
from halpipe.importers.native import read_model
from halpipe.models import Binding
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.measure.objectives import Objective
from search_benchmark.families import FullSlack, ManyVersions, RigidChains
from search_benchmark.real import Engine, EngineControl, Waters2019
from table_iii import TABLE_III

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.models import TaskModel


class Family(Protocol):
    """A family of systems, one for each seed."""

    def draw(self, seed: int) -> TaskModel:
        """Return the system of a seed."""


Cell: TypeAlias = "SetParameters | Family"
"""What sets are drawn from: parameters of generated ones, or systems of another kind."""


@record(kw_only=True)
class Row:
    """A line of the table: sets of several parameters, with what was aimed at and what the paper reports for them."""

    name: str
    cells: tuple[Cell, ...]
    goal_success: Fraction = Fraction(1)
    goal_kernel: Duration | None = None
    goal_whole: Duration | None = None
    paper_seconds: tuple[int, int] | None = None
    is_open: bool = False
    """Whether the time limit alone ends a search, as with `schedule --time-limit`, and not a number of moves."""
    optimise: tuple[Objective, ...] = ()
    """Objectives, as with `schedule --optimise`."""


@record
class Given:
    """A model of the user's: one system, whatever the seed."""

    path: str

    def draw(self, seed: int) -> TaskModel:
        """Return the model."""
        del seed
        return read_model(self.path)


def given_rows(paths: Sequence[str]) -> tuple[Row, ...]:
    """Return a row for each model of the user's, such as imported systems."""
    return tuple(Row(name=read_model(path).name, cells=(Given(path),)) for path in paths)


@record
class Bound:
    """The sets of some parameters, each task bound to one set of units in the whole system."""

    parameters: SetParameters

    def draw(self, seed: int) -> TaskModel:
        """Return the set of a seed."""
        model = generate(self.parameters, seed)
        return replace(model, tasks=tuple(replace(task, binding=Binding.SYSTEM) for task in model.tasks))


def _table3() -> Iterator[Row]:
    """One row for each value that an experiment varies."""
    for experiment in TABLE_III:
        for value in dict.fromkeys(getattr(cell, experiment.varies) for cell in experiment.cells):
            cells = tuple(cell for cell in experiment.cells if getattr(cell, experiment.varies) == value)
            shown = f"{value * 100} %" if isinstance(value, Fraction) else str(value)
            yield Row(
                name=f"({experiment.number}) {experiment.varies.replace('_', '-')} {shown}",
                cells=cells,
                goal_kernel=milliseconds(5 if cells[0].tasks == 60 else 10),
                paper_seconds=experiment.paper_seconds,
            )


_TENTH = Fraction(1, 10)
_SIX = SetParameters(multi_version=_TENTH, resource_fill=Fraction(3, 5))
_TWELVE = replace(_SIX, tasks=240, units=12, unit_types=3, utilisation=Fraction(7, 10), resource_fill=Fraction(3, 4))
_MIXED_RATES = tuple(milliseconds(n) for n in (5, 10, 11, 20, 25, 33, 66, 400))
"""A task of 5 ms beside one of 400 ms; all together 6981 jobs in 13.2 s."""


def _hard() -> Iterator[Row]:
    """The goals of the project, on sets like those on which the goals were set.

    On 6 units, windows fill the two resources to three fifths; on 12 and 24 units, to three quarters where nothing else
    is stated. Where 60 % of the tasks were to have a predecessor, a third had one. What the same words can mean
    otherwise, and is harder, is a suite of its own. The largest sets have a resource for three units and a window for
    each task, as in Table III.
    """
    cells = [cell for experiment in TABLE_III for cell in experiment.cells]
    sixty = tuple(cell for cell in cells if cell.tasks == 60)
    larger = tuple(cell for cell in cells if cell.tasks in (112, 120) and cell.utilisation == Fraction(7, 10))
    yield Row(name="Table III, 60 tasks", cells=sixty, goal_kernel=milliseconds(5))
    yield Row(name="Table III, 112 and 120 tasks, 70 %", cells=larger, goal_kernel=milliseconds(10))
    for tasks, percent, success, goal in ((120, 85, 100, 200), (144, 90, 95, 10_000), (144, 95, 95, 60_000)):
        yield Row(
            name=f"{tasks} tasks on 6, {percent} %",
            cells=(replace(_SIX, tasks=tasks, utilisation=Fraction(percent, 100)),),
            goal_success=Fraction(success, 100),
            goal_kernel=milliseconds(goal),
        )
    most = Fraction(95, 100)
    yield Row(
        name="240 on 12, 70 %, fractional bounds, resources 65 % full",
        cells=(replace(_TWELVE, fractional=True, resource_fill=Fraction(65, 100)),),
        goal_success=most,
        goal_kernel=seconds(5),
    )
    yield Row(
        name="240 on 12, 70 %, precedence (60 % drawn, a third linked)",
        cells=(replace(_TWELVE, precedence=Fraction(1, 3)),),
        goal_kernel=milliseconds(500),
    )
    yield Row(
        name="480 on 24, 70 %, resources 75 % full",
        cells=(replace(_TWELVE, tasks=480, units=24),),
        goal_kernel=milliseconds(200),
    )
    yield Row(
        name="2400 on 120, 70 %",
        cells=(replace(_TWELVE, tasks=2400, units=120, resources=40, resource_fill=None),),
        goal_kernel=seconds(3),
    )
    yield Row(
        name="10000 on 500, 60 %",
        cells=(
            replace(_TWELVE, tasks=10_000, units=500, resources=166, resource_fill=None, utilisation=Fraction(3, 5)),
        ),
        goal_success=most,
        goal_kernel=seconds(60),
    )
    yield Row(
        name="5 ms beside 400 ms in 13.2 s",
        cells=(SetParameters(units=2, unit_types=1, resources=1, periods=_MIXED_RATES),),
        goal_kernel=seconds(5),
    )
    yield Row(
        name="no two units alike, 240 on 12, 65 %",
        cells=(replace(_TWELVE, unlike_units=True, utilisation=Fraction(65, 100)),),
        goal_success=most,
        goal_kernel=seconds(5),
    )


def _families() -> Iterator[Row]:
    """Small sets that leave nothing idle, and rigid ones: what is lost by going in small steps."""
    chains = (
        RigidChains(chains=3, length=9, units=1, load=Fraction(2, 5)),
        RigidChains(chains=3, length=9, units=3, load=Fraction(2, 5)),
        RigidChains(chains=1, length=16, units=1, load=Fraction(1, 2), width=3),
    )
    families: tuple[tuple[str, tuple[Cell, ...]], ...] = (
        ("rigid chains, 16 and 27 tasks", chains),
        ("30 tasks with 8 versions", (ManyVersions(tasks=30, versions=8, units=6),)),
        ("slack 1, 100 % of 2 units", (FullSlack(units=2, slots=4),)),
    )
    for name, cells in families:
        yield Row(name=name, cells=cells, goal_whole=seconds(1), is_open=True)
    yield Row(
        name="144 tasks on 6, 98 %",
        cells=(replace(_SIX, tasks=144, utilisation=Fraction(98, 100)),),
        goal_success=Fraction(1, 2),
        goal_whole=seconds(60),
        is_open=True,
    )


def _harder() -> Iterator[Row]:
    """Beyond the goals: a window for each task, which fills the resources further, and 60 % of the tasks linked."""
    for tasks, percent in ((120, 85), (144, 90), (144, 95)):
        yield Row(
            name=f"{tasks} tasks on 6, {percent} %, a window for each task",
            cells=(replace(_SIX, tasks=tasks, utilisation=Fraction(percent, 100), resource_fill=None),),
        )
    yield Row(name="240 on 12, 70 %, 60 % precedence, all linked", cells=(replace(_TWELVE, precedence=Fraction(3, 5)),))


def _real() -> Iterator[Row]:
    """Systems like those that are published; what is aimed at is the whole command."""
    for cores, percent, success, goal in (
        (1, 70, 100, 2),
        (1, 80, 100, 2),
        (1, 90, 100, 2),
        (1, 95, 95, 5),
        (4, 80, 100, 10),
    ):
        yield Row(
            name=f"WATERS 2015, {cores} core{'s' if cores > 1 else ''}, {percent} %",
            cells=(EngineControl(cores=cores, load=Fraction(percent, 100)),),
            goal_success=Fraction(success, 100),
            goal_whole=seconds(goal),
        )
    yield Row(
        name="like FMTV 2017, 4 cores, interrupts, angle task, 80 %",
        cells=(Engine(load=Fraction(4, 5)),),
        goal_whole=seconds(30),
    )
    yield Row(name="WATERS 2019, pieces of at most 5 ms", cells=(Waters2019(),), goal_whole=seconds(10))
    yield Row(name="WATERS 2019, --optimise chains", cells=(Waters2019(),), optimise=(Objective.CHAINS,))
    cells = [cell for experiment in TABLE_III for cell in experiment.cells]
    for percent in (60, 70):
        bound = tuple(Bound(cell) for cell in cells if cell.utilisation == Fraction(percent, 100))
        yield Row(name=f"Table III, bound to units, {percent} %", cells=bound, goal_whole=seconds(1))


def _tiny() -> Iterator[Row]:
    """Sets that take no time: to try the benchmark itself."""
    yield Row(name="12 tasks", cells=(SetParameters(tasks=12, units=3),), paper_seconds=(1, 2))
    hopeless = SetParameters(tasks=48, units=2, utilisation=Fraction(1))
    yield Row(name="48 tasks, nothing idle", cells=(hopeless,), goal_kernel=milliseconds(1))


SUITES = {
    "table3": tuple(_table3()),
    "hard": (*_hard(), *_families()),
    "harder": tuple(_harder()),
    "real": tuple(_real()),
    "tiny": tuple(_tiny()),
}
"""The benchmarks by name."""
