"""The page as plain values for the template, and its rendering."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from functools import cache
from importlib import resources
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.exporters.common.palette import FILLS, INK, RESOURCES, tone
from halpipe.exporters.common.timeline import Window, links, shows_context, unroll, unroll_switch
from halpipe.exporters.regulator.picture import draw_bounds
from halpipe.exporters.report.account import build_account
from halpipe.exporters.report.chains import latency_of, path_chart, worst_age, worst_latency, worst_reaction
from halpipe.exporters.report.chart import (
    BASE_WIDTH,
    GRID,
    METER_HEIGHT,
    NAME_WIDTH,
    REGION_HEIGHT,
    ZOOM_LEVELS,
    Caption,
    Chart,
    build_chart,
    region,
)
from halpipe.exporters.report.modegraph import build_mode_graph
from halpipe.exporters.report.numbers import approximate, decimal, percent
from halpipe.exporters.report.scene import embedded, figures, jobs_by_task, scene
from halpipe.models import Anchor, Status

if TYPE_CHECKING:
    import jinja2

    from halpipe.core.durations import Duration
    from halpipe.exporters.common.timeline import Link
    from halpipe.exporters.report import ReportOptions
    from halpipe.exporters.report.chains import Hop, PathChart
    from halpipe.models import (
        Chain,
        ChainLatency,
        CostTerms,
        ModeSchedule,
        Schedule,
        Split,
        Task,
        TaskModel,
        TransitionTable,
        Version,
    )

_TERMS = (
    ("overlap", "time in which two jobs share a unit, in ticks"),
    ("access", "demand on resources beyond their capacity, in ticks times share"),
    ("precedence", "distance of constraints and chains from their windows, in ticks"),
    ("unit", "jobs on a unit that their version does not allow"),
    ("occupancy", "share of units left empty, a bonus"),
    ("timeliness", "how near jobs keep to their release, a bonus; 1 is exactly on time"),
)

GLOSSARY = (
    ("task", "a piece of software that runs again and again; each run is a job"),
    ("unit", "what runs jobs, one at a time: a core, or an accelerator"),
    ("mode", "a way of working of the whole system, with its own set of tasks"),
    ("hyperperiod", "the length of the cycle of a mode: after it, everything repeats"),
    ("WCET", "worst-case execution time: no job of the version runs longer"),
    ("version", "one of several ways to run a task, such as on another kind of unit or with less quality"),
    ("slack", "the share of its period by which a start may be moved"),
    ("resource", "what jobs share while they run, such as the memory; their shares never exceed 100 %"),
    ("chain", "tasks that pass data on, from a sensor to an actuator"),
    ("reaction time", "from an event that was just missed to the result that takes it into account, at worst"),
    ("data age", "how old the data behind a result can be when the result is ready"),
    ("transition table", "jobs that are run once between two modes, so that no rule is broken on the way"),
    ("worst latency", "of a switch: the wait for the end of the cycle, and the transition table"),
    ("valid", "an independent check of every rule has found no violation"),
)


LARGE = 1500
"""Jobs of all modes beyond which charts are drawn by the viewer and tables are filled as they are looked at."""


@record
class Gauge:
    """A bar with its text: a load, or a latency against its limit."""

    name: str
    text: str
    width: str
    detail: str = ""
    over: bool = False


@record
class JobRow:
    """A line of the table of jobs."""

    tone: int
    task: str
    index: int
    start: str
    end: str
    version: str
    units: str
    waits: str


@record
class FigureRow:
    """What a task comes to in a mode; the times as text, and in milliseconds to sort by."""

    tone: int
    task: str
    period: str
    jobs: int
    gaps: int
    response: str = ""
    response_ms: float = 0.0
    margin: str = ""
    margin_ms: float = 0.0
    jitter: str = ""
    jitter_ms: float = 0.0


@record
class ChainRow:
    """A chain with its two latencies."""

    name: str
    path: str
    gauges: tuple[Gauge, ...]
    ways: tuple[PathChart, ...]


@record(kw_only=True)
class ModeView:
    """One mode, ready to be printed."""

    id: str
    name: str
    valid: bool
    hyperperiod: str
    job_count: int
    task_count: int
    unit_count: int
    cost: str
    terms: tuple[tuple[str, str, str], ...]
    chart: Chart | None
    chains: tuple[ChainRow, ...]
    unit_loads: tuple[Gauge, ...]
    resource_loads: tuple[Gauge, ...]
    jobs: tuple[JobRow, ...]
    figures: tuple[FigureRow, ...]


@record(kw_only=True)
class TransitionView:
    """One switch, ready to be printed."""

    id: str
    source: str
    target: str
    valid: bool
    length: str
    limit: str
    worst_latency: str
    jobs: tuple[JobRow, ...]
    chart: Chart | None


@record
class VersionRow:
    """A version of a task in the table of tasks."""

    name: str
    wcet: str
    units: str
    accesses: tuple[str, ...]
    precedences: tuple[str, ...]
    used: str


@record
class TaskRow:
    """A line of the table of tasks."""

    tone: int
    name: str
    period: str
    slack: str
    offset: str
    deadline: str
    versions: tuple[VersionRow, ...]


def format_page(model: TaskModel, schedule: Schedule, options: ReportOptions) -> str:
    """Return the HTML page of a schedule that fits `model` (see `select`)."""
    context = shows_context(schedule)
    is_large = sum(len(mode.jobs) for mode in schedule.modes) > LARGE
    shown = {table.name for table in schedule.modes}
    return _template().render(
        title=options.title or f"{model.name} schedule",
        model=model,
        schedule=schedule,
        missing=[mode.name for mode in model.modes if mode.name not in shown],
        facts=_facts(model, schedule),
        graph=build_mode_graph(model, schedule),
        bandwidths=list(draw_bounds(model, schedule).values()),
        account=build_account(model, options.import_report),
        modes=[_mode(model, table, f"mode-{n}", is_large=is_large) for n, table in enumerate(schedule.modes, 1)],
        scene=embedded(scene(model, schedule)) if is_large else "",
        transitions=[
            _transition(model, schedule, table, f"switch-{n}", context)
            for n, table in enumerate(schedule.transitions, 1)
        ],
        tasks=[] if is_large else _tasks(model, schedule),
        glossary=GLOSSARY,
    )


@cache
def _template() -> jinja2.Template:
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.FunctionLoader(_source),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters["decimal"] = lambda value: decimal(value, 4)
    environment.globals.update(
        fills=FILLS,
        ink=INK,
        resource_colours=RESOURCES,
        grid=GRID,
        base_width=BASE_WIDTH,
        name_width=NAME_WIDTH,
        meter_height=METER_HEIGHT,
        region_height=REGION_HEIGHT,
        zoom_levels=ZOOM_LEVELS,
    )
    return environment.get_template("report.html.j2")


def _source(name: str) -> str:
    return (resources.files("halpipe.exporters.report") / "templates" / name).read_text("utf-8")


def _facts(model: TaskModel, schedule: Schedule) -> list[tuple[str, str]]:
    facts = [
        ("Model", model.name),
        ("Model SHA-256", schedule.model_sha256),
        ("Made by", schedule.generator),
        ("Solver", schedule.solver),
        ("Seed", "" if schedule.seed is None else str(schedule.seed)),
        ("Tick", "" if schedule.tick is None else str(schedule.tick)),
        ("Size", _size(model)),
    ]
    return [(name, text) for name, text in facts if text]


def _size(model: TaskModel) -> str:
    parts = [(len(model.units), "unit"), (len(model.resources), "resource"), (len(model.tasks), "task")]
    parts += [(len(model.chains), "chain"), (len(model.modes), "mode")]
    return ", ".join(f"{count} {noun}{'' if count == 1 else 's'}" for count, noun in parts if count)


# --------------------------------------------------------------------------------------------------- modes


def _mode(model: TaskModel, table: ModeSchedule, id: str, *, is_large: bool) -> ModeView:
    used = {unit for job in table.jobs for unit in job.units}
    tasks = {job.task for job in table.jobs}
    loads = {load.unit: load.share for load in table.unit_loads}
    caption = Caption(
        name=id,
        title=f"Gantt chart of mode {table.name}",
        description=f"{len(table.jobs)} jobs of {len(tasks)} tasks on {len(used)} units over one cycle of "
        f"{table.hyperperiod}. The table of jobs below holds the same in text.",
        loads=loads,
    )
    return ModeView(
        id=id,
        name=table.name,
        valid=table.status is Status.VALID,
        hyperperiod=str(table.hyperperiod),
        job_count=len(table.jobs),
        task_count=len(tasks),
        unit_count=len(used),
        cost="" if table.cost is None else approximate(table.cost.total),
        terms=() if table.cost is None else _terms(table.cost),
        chart=None if is_large else build_chart(model, unroll(table), Window(ZERO, table.hyperperiod), caption),
        chains=_chains(model, table, id),
        unit_loads=_unit_loads(model, table),
        resource_loads=_resource_loads(table),
        jobs=() if is_large else _jobs(model, table),
        figures=() if is_large else _figures(model, table),
    )


def _figures(model: TaskModel, table: ModeSchedule) -> tuple[FigureRow, ...]:
    by_task = jobs_by_task(table)
    rows = []
    for position, task in enumerate(model.tasks):
        found = figures(task, by_task.get(task.name, []), table.hyperperiod)
        if found:
            period = "" if task.period is None else str(task.period)
            rows.append(FigureRow(tone=tone(position), task=task.name, period=period, **found))
    return tuple(rows)


def _unit_loads(model: TaskModel, table: ModeSchedule) -> tuple[Gauge, ...]:
    served = {
        unit.name: "".join(f", {i.name} {i.wcet} in {i.distance}" for i in unit.interrupts) for unit in model.units
    }
    return tuple(
        Gauge(
            load.unit, percent(load.share), _width(load.share), f"{load.busy} busy{served[load.unit]}", load.share > 1
        )
        for load in table.unit_loads
    )


def _resource_loads(table: ModeSchedule) -> tuple[Gauge, ...]:
    return tuple(
        Gauge(
            load.resource, f"peak {percent(load.peak)}", _width(load.peak), f"mean {percent(load.mean)}", load.peak > 1
        )
        for load in table.resource_loads
        if load.peak is not None and load.mean is not None
    )


def _terms(cost: CostTerms) -> tuple[tuple[str, str, str], ...]:
    return tuple((name, approximate(getattr(cost, name)), meaning) for name, meaning in _TERMS)


def _width(share: Fraction) -> str:
    return decimal(min(share, Fraction(1)) * 100, 2)


def _chains(model: TaskModel, table: ModeSchedule, id: str) -> tuple[ChainRow, ...]:
    chains = {chain.name: chain for chain in model.chains}
    return tuple(
        _chain(model, table, chains[found.name], found, f"{id}-chain-{n}") for n, found in enumerate(table.chains, 1)
    )


def _chain(model: TaskModel, table: ModeSchedule, chain: Chain, found: ChainLatency, id: str) -> ChainRow:
    gauges = (
        _latency("latency", latency_of(model, chain, table, found), chain.max_latency),
        _latency("reaction time", found.reaction, chain.max_reaction),
        _latency("data age", found.age, chain.max_age),
    )
    ways: list[PathChart] = []

    def draw(kind: str, title: str, way: list[Hop], limit: Duration | None) -> None:
        if way:
            text = title.format(way[-1].finish - way[0].begin)
            ways.append(path_chart(model, f"{id}-{kind}", text, way, limit, missed=kind == "reaction"))

    if found.latency is not None:  # the model refers to it
        title = f"The data of {chain.tasks[0]} that take longest to {chain.tasks[-1]}: {{}}"
        draw("latency", title, worst_latency(model, chain, table), chain.max_latency)
    title = f"A stimulus that comes just too late for one job of {chain.tasks[0]}: answered {{}} later"
    draw("reaction", title, worst_reaction(model, chain, table), chain.max_reaction)
    title = f"The oldest data behind a result of {chain.tasks[-1]}: {{}} old"
    draw("age", title, worst_age(model, chain, table), chain.max_age)
    return ChainRow(chain.name, " → ".join(chain.tasks), gauges, tuple(ways))


def _latency(name: str, value: Duration | None, limit: Duration | None) -> Gauge:
    if value is None:
        return Gauge(name, "no data arrives", "0", f"limit {limit}" if limit else "no limit", limit is not None)
    if not limit:
        return Gauge(name, str(value), "0", "no limit")
    share = value / limit
    return Gauge(name, str(value), _width(share), f"{percent(share)} of the limit {limit}", value > limit)


def _jobs(model: TaskModel, table: ModeSchedule) -> tuple[JobRow, ...]:
    waits: dict[tuple[str, int], list[str]] = {}
    for link in links(model, table):
        waits.setdefault((link.job.task, link.job.index), []).append(_waits(link))
    return _job_rows(model, table, waits)


def _job_rows(
    model: TaskModel, table: ModeSchedule | TransitionTable, waits: dict[tuple[str, int], list[str]]
) -> tuple[JobRow, ...]:
    tones = {task.name: tone(number) for number, task in enumerate(model.tasks)}
    order = {task.name: number for number, task in enumerate(model.tasks)}
    jobs = sorted(table.jobs, key=lambda job: (job.start.ns, order[job.task], job.index))
    return tuple(
        JobRow(
            tone=tones[job.task],
            task=job.task,
            index=job.index,
            start=str(job.start),
            end=str(job.end) + _gaps(max(0, len(job.parts) - 1)),
            version=job.version,
            units=", ".join(job.units),
            waits="; ".join(waits.get((job.task, job.index), ())),
        )
        for job in jobs
    )


def _waits(link: Link) -> str:
    event = "started" if link.precedence.anchor is Anchor.START else "ended"
    return f"{link.predecessor.task} #{link.predecessor.index} {event} {link.distance} before"


# --------------------------------------------------------------------------------------------- transitions


def _transition(model: TaskModel, schedule: Schedule, table: TransitionTable, id: str, context: bool) -> TransitionView:
    source, target = schedule.mode(table.source), schedule.mode(table.target)
    window, placements = unroll_switch(table, source, target, context=context)
    limits = {(pair.source, pair.target): pair.max_length for pair in model.transitions}
    limit = limits.get((table.source, table.target))
    regions = [region(window, ZERO, table.length, "transition table", "table")] if table.length else []
    if context:
        regions.insert(0, region(window, window.start, ZERO, f"last cycle of {table.source}", "mode"))
        cycles = (window.end - table.length) // target.hyperperiod
        first = f"first {cycles} cycles" if cycles > 1 else "first cycle"
        regions.append(region(window, table.length, window.end, f"{first} of {table.target}", "mode"))
    caption = Caption(
        name=id,
        title=f"Switch from {table.source} to {table.target}",
        description=f"The switch happens at 0. {len(table.jobs)} jobs start in a transition table of "
        f"{table.length}; then {table.target} begins.",
        loads={},
        regions=tuple(regions),
        fine=False,
    )
    return TransitionView(
        id=id,
        source=table.source,
        target=table.target,
        valid=table.status is Status.VALID,
        length=str(table.length),
        limit="" if limit is None else str(limit),
        worst_latency=str(table.worst_latency),
        jobs=_job_rows(model, table, {}),
        chart=build_chart(model, placements, window, caption) if window.length else None,
    )


# --------------------------------------------------------------------------------------------------- tasks


def _tasks(model: TaskModel, schedule: Schedule) -> list[TaskRow]:
    uses: Counter[tuple[str, str, str]] = Counter()
    gaps: Counter[tuple[str, str, str]] = Counter()
    for table in schedule.modes:
        for job in table.jobs:
            uses[table.name, job.task, job.version] += 1
            gaps[table.name, job.task, job.version] += max(0, len(job.parts) - 1)
    modes = [table.name for table in schedule.modes]
    return [
        TaskRow(
            tone=tone(number),
            name=task.name,
            period=_period(task),
            slack=percent(task.slack),
            offset="" if task.offset is None else str(task.offset),
            deadline=_deadline(task),
            versions=tuple(
                _version(
                    version,
                    [(m, uses[m, task.name, version.name], gaps[m, task.name, version.name]) for m in modes],
                )
                for version in task.versions
            ),
        )
        for number, task in enumerate(model.tasks)
    ]


def _period(task: Task) -> str:
    if task.period is None:
        return "on demand"
    return f"{task.period}, polls arrivals {task.distance} apart" if task.distance is not None else str(task.period)


def _deadline(task: Task) -> str:
    if task.distance is not None:
        return f"{task.deadline or task.distance} from the arrival"
    if task.deadline is not None:
        return str(task.deadline)
    return "" if task.period is None else "period"


def _version(version: Version, uses: list[tuple[str, int, int]]) -> VersionRow:
    gang = f"{version.gang} of " if version.gang > 1 else ""
    return VersionRow(
        name=version.name,
        wcet=("not stated" if version.wcet is None else str(version.wcet)) + _split(version.split),
        units=gang + _some(version.units),
        accesses=tuple(
            f"{a.resource} {a.start} – {a.end}, bound {format_rational(a.bound)}" + (f", {a.kind}" if a.kind else "")
            for a in version.accesses
        ),
        precedences=tuple(f"{p.min} – {p.max} {p.words}" for p in version.precedences),
        used=", ".join(f"{mode} ({count}{_gaps(gaps)})" for mode, count, gaps in uses if count),
    )


def _gaps(count: int) -> str:
    return f", {count} gaps" if count else ""


def _split(split: Split) -> str:
    """Return where jobs may be interrupted, and what that costs."""
    if not split.is_allowed:
        return ""
    where = "anywhere" if split.anywhere else "at " + " ".join(map(str, split.points))
    return f", split {where}" + (f", {split.resume} to resume" if split.resume else "")


def _some(names: tuple[str, ...], most: int = 6) -> str:
    """Return the names, of many only the first and how many there are."""
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[: most // 2])} … ({len(names)} units)"
