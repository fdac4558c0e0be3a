"""The page as plain values for the template, and its rendering."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from functools import cache
from importlib import resources
from itertools import repeat
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import is_shaped, load_json, read_bytes
from halpipe.core.quantities import format_rational
from halpipe.exporters.common.codes import NO_IMPORT_REPORT
from halpipe.exporters.common.palette import FILLS, INK, tone
from halpipe.exporters.common.templates import environment
from halpipe.exporters.regulator.picture import draw_bounds
from halpipe.exporters.report.axis import approximate, decimal, percent
from halpipe.exporters.report.chains import Hop, latency_of, path_chart, worst_age, worst_latency, worst_reaction
from halpipe.exporters.report.modegraph import build_mode_graph
from halpipe.exporters.report.scene import embedded, scene, waits
from halpipe.models import Status

if TYPE_CHECKING:
    from collections.abc import Iterator

    import jinja2

    from halpipe.core.durations import Duration
    from halpipe.exporters.report import ReportOptions
    from halpipe.models import (
        Chain,
        ChainLatency,
        ModeSchedule,
        Origin,
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


LISTED_JOBS = 100
"""Jobs in the tables of a page that is read without scripts, shared by the tables that are drawn."""

NAME_WIDTH = 190
"""Pixels beside a chain's picture for the names of its tasks."""

Row = dict[str, Any]
"""Plain values of one part of the page, by the names that the template uses."""


def format_page(model: TaskModel, schedule: Schedule, options: ReportOptions) -> str:
    """Return the HTML page of a schedule that fits `model` (see `select`)."""
    drawn = scene(model, schedule, beside=options.beside)
    modes = list(zip(schedule.modes, drawn["modes"], strict=True))
    switches = list(zip(schedule.transitions, drawn["switches"], strict=True))
    for table, mode in modes:
        mode["waits"] = waits(model, table)
    shown = {table.name for table in schedule.modes}
    filled = [bool(mode.jobs) for mode in schedule.modes] + [bool(table.jobs) for table in schedule.transitions]
    most = -(-LISTED_JOBS // max(1, sum(filled)))
    return _template().render(
        title=options.title or f"{model.name} schedule",
        model=model,
        schedule=schedule,
        missing=[mode.name for mode in model.modes if mode.name not in shown],
        facts=_facts(model, schedule),
        graph=build_mode_graph(model, schedule),
        bandwidths=list(draw_bounds(model, schedule).values()),
        account=build_account(model, options.import_report),
        beside=options.beside,
        modes=[_mode(model, table, f"mode-{n}", mode) for n, (table, mode) in enumerate(modes, 1)],
        listed={table["name"]: _listed(drawn, table, most) for table in drawn["modes"] + drawn["switches"]},
        scene=embedded(drawn),
        transitions=[_transition(model, table, f"switch-{n}", switch) for n, (table, switch) in enumerate(switches, 1)],
        tasks=_tasks(model, schedule),
        glossary=GLOSSARY,
    )


def _listed(drawn: Row, table: Row, most: int) -> Row:
    """Return the first `most` jobs of a table as the script lists them, and how many are left out."""
    pairs = zip(table["jobs"], table.get("waits") or repeat(""), strict=False)
    jobs = sorted((each for each in pairs if 0 <= each[0][4] < table["length"]), key=lambda each: each[0][4])
    rows = []
    for (task, index, version, lanes, _, _, start, end, parts, _), wait in jobs[:most]:
        units = " ".join(drawn["units"][lane] for lane in lanes)
        gaps = f", {len(parts) - 1} gaps" if parts else ""
        rows.append((drawn["tasks"][task]["name"], index, start, end + gaps, version, units, wait))
    return {"rows": rows, "left": len(jobs) - len(rows)}


@cache
def _template() -> jinja2.Template:
    found = environment(resources.files(__package__) / "templates", autoescape=True)
    found.filters["decimal"] = lambda value: decimal(value, 4)
    found.globals.update(fills=FILLS, ink=INK, name_width=NAME_WIDTH)
    return found.get_template("report.html.j2")


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


def _mode(model: TaskModel, table: ModeSchedule, id: str, drawn: Row) -> Row:
    chains = {chain.name: chain for chain in model.chains}
    cost = table.cost
    return {
        "id": id,
        "name": table.name,
        "valid": table.status is Status.VALID,
        "hyperperiod": str(table.hyperperiod),
        "job_count": len(table.jobs),
        "task_count": len({job.task for job in table.jobs}),
        "unit_count": len({unit for job in table.jobs for unit in job.units}),
        "margin": table.margin_words,
        "cost": "" if cost is None else approximate(cost.total),
        "terms": [] if cost is None else [(name, approximate(getattr(cost, name)), text) for name, text in _TERMS],
        "strip": drawn["strip"],
        "chains": [
            _chain(model, table, chains[row.name], row, f"{id}-chain-{n}") for n, row in enumerate(table.chains, 1)
        ],
        "unit_loads": _unit_loads(model, table),
        "resource_loads": [
            _gauge(load.resource, f"peak {percent(load.peak)}", load.peak, f"mean {percent(load.mean)}")
            for load in table.resource_loads
            if load.peak is not None and load.mean is not None
        ],
    }


def _gauge(name: str, text: str, share: Fraction | None, detail: str) -> Row:
    """Return a bar with its text: a load, or a latency against its limit."""
    width = "0" if share is None else decimal(min(share, Fraction(1)) * 100, 2)
    return {"name": name, "text": text, "width": width, "detail": detail, "over": share is not None and share > 1}


def _unit_loads(model: TaskModel, table: ModeSchedule) -> list[Row]:
    served = {
        unit.name: "".join(f", {i.name} {i.wcet} in {i.distance}" for i in unit.interrupts) for unit in model.units
    }
    return [
        _gauge(load.unit, percent(load.share), load.share, f"{load.busy} busy{served[load.unit]}")
        for load in table.unit_loads
    ]


def _chain(model: TaskModel, table: ModeSchedule, chain: Chain, found: ChainLatency, id: str) -> Row:
    gauges = (
        _latency("latency", latency_of(model, chain, table, found), chain.max_latency),
        _latency("reaction time", found.reaction, chain.max_reaction),
        _latency("data age", found.age, chain.max_age),
    )
    ways: list[Row] = []

    def draw(kind: str, title: str, way: list[Hop], limit: Duration | None, after: str = "") -> None:
        if way:
            text = f"{title} {way[-1].finish - way[0].begin}{after}"
            ways.append(path_chart(model, f"{id}-{kind}", text, way, limit, missed=kind == "reaction"))

    first, last = chain.tasks[0], chain.tasks[-1]
    if found.latency is not None:  # the model refers to it
        title = f"The data of {first} that take longest to {last}:"
        draw("latency", title, worst_latency(model, chain, table), chain.max_latency)
    title = f"A stimulus that comes just too late for one job of {first}: answered"
    draw("reaction", title, worst_reaction(model, chain, table), chain.max_reaction, " later")
    title = f"The oldest data behind a result of {last}:"
    draw("age", title, worst_age(model, chain, table), chain.max_age, " old")
    return {"name": chain.name, "path": " → ".join(chain.tasks), "gauges": gauges, "ways": ways}


def _latency(name: str, value: Duration | None, limit: Duration | None) -> Row:
    if value is None:
        return _gauge(name, "no data arrives", None, f"limit {limit}" if limit else "no limit") | {"over": bool(limit)}
    if not limit:
        return _gauge(name, str(value), None, "no limit")
    return _gauge(name, str(value), value / limit, f"{percent(value / limit)} of the limit {limit}")


# --------------------------------------------------------------------------------------------- transitions


def _transition(model: TaskModel, table: TransitionTable, id: str, drawn: Row) -> Row:
    limits = {(pair.source, pair.target): pair.max_length for pair in model.transitions}
    limit = limits.get((table.source, table.target))
    return {
        "id": id,
        "name": table.name,
        "source": table.source,
        "target": table.target,
        "valid": table.status is Status.VALID,
        "length": str(table.length),
        "limit": "" if limit is None else str(limit),
        "worst_latency": str(table.worst_latency),
        "job_count": len(table.jobs),
        "drawn": drawn["begin"] < drawn["end"],
        "strip": drawn["strip"],
    }


# --------------------------------------------------------------------------------------------------- tasks


def _tasks(model: TaskModel, schedule: Schedule) -> list[Row]:
    uses: Counter[tuple[str, str, str]] = Counter()
    gaps: Counter[tuple[str, str, str]] = Counter()
    for table in schedule.modes:
        for job in table.jobs:
            uses[table.name, job.task, job.version] += 1
            gaps[table.name, job.task, job.version] += len(job.parts[1:])

    def used(task: Task, version: Version) -> str:
        keys = [(table.name, task.name, version.name) for table in schedule.modes]
        return ", ".join(
            f"{key[0]} ({uses[key]}{f', {gaps[key]} gaps' if gaps[key] else ''})" for key in keys if uses[key]
        )

    return [
        {
            "tone": tone(number),
            "name": task.name,
            "period": _period(task),
            "slack": percent(task.slack),
            "offset": "" if task.offset is None else str(task.offset),
            "deadline": _deadline(task),
            "versions": [_version(version, used(task, version)) for version in task.versions],
        }
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


def _version(version: Version, used: str) -> Row:
    gang = f"{version.gang} of " if version.gang > 1 else ""
    return {
        "name": version.name,
        "wcet": ("not stated" if version.wcet is None else str(version.wcet)) + _split(version.split),
        "units": gang + _some(version.units),
        "accesses": [
            f"{a.resource} {a.start} – {a.end}, bound {format_rational(a.bound)}" + (f", {a.kind}" if a.kind else "")
            for a in version.accesses
        ],
        "precedences": [f"{p.min} – {p.max} {p.words}" for p in version.precedences],
        "used": used,
    }


def _split(split: Split) -> str:
    """Return where jobs may be interrupted, and what that costs."""
    if not split.is_allowed:
        return ""
    where = "anywhere" if split.anywhere else "at " + " ".join(map(str, split.points))
    return f", split {where}" + (f", {split.resume} to resume" if split.resume else "")


def _some(units: tuple[str, ...]) -> str:
    """Return the names, of many only the first and how many there are."""
    return ", ".join(units) if len(units) <= 6 else f"{', '.join(units[:3])} … ({len(units)} units)"


# ---------------------------------------------------------------------------------------------- account of the import

_KINDS = ("units", "resources", "tasks", "versions", "chains", "modes", "transitions")
_MOST_REASONS = 30


def build_account(model: TaskModel, report: str) -> Row | None:
    """Return what the import was, with the import report in the file `report`; None if neither says anything.

    Elements, reasons and defaults are empty without an import report.
    """
    kinds = [kind for kind in _KINDS if getattr(model, kind, ()) or kind == "versions"]
    sources = _sources(model, kinds)
    account = {"kinds": kinds, "sources": sources, "elements": [], "share": "", "reasons": [], "defaults": []}
    if not report:
        return account if any(row["file"] for row in sources) else None
    document = _read(report)
    elements = [(e["kind"], e["read"], e["mapped"], e["ignored"]) for e in document["elements"]]
    read, mapped = sum(e[1] for e in elements), sum(e[2] for e in elements)
    reasons = Counter(entry["reason"] for entry in document["ignored"])
    defaults = Counter((entry["what"], entry["value"]) for entry in document["defaults"])
    listed = sorted(reasons.items(), key=lambda entry: (-entry[1], entry[0]))
    if others := listed[_MOST_REASONS:]:
        listed[_MOST_REASONS:] = [(f"{len(others)} other reasons", sum(count for _, count in others))]
    share = f" ({percent(Fraction(mapped, read))})" if read else ""
    return account | {
        "elements": elements,
        "share": f"{mapped} of {read} elements shaped the model{share}",
        "reasons": listed,
        "defaults": [(what, value, count) for (what, value), count in sorted(defaults.items())],
    }


def _sources(model: TaskModel, kinds: list[str]) -> list[Row]:
    """Count the elements of each kind by the file they came from; elements without an origin come last."""
    counts: dict[str, Counter[str]] = {}
    for kind, origin in _origins(model):
        counts.setdefault(origin.file if origin else "", Counter())[kind] += 1
    names = sorted(counts, key=lambda name: (not name, name))
    return [{"file": name, "counts": [counts[name][kind] for kind in kinds]} for name in names]


def _origins(model: TaskModel) -> Iterator[tuple[str, Origin | None]]:
    for kind in _KINDS:
        for element in getattr(model, kind, ()):
            yield kind, element.origin
    for task in model.tasks:
        for version in task.versions:
            # A version without an origin of its own came with its task.
            yield "versions", version.origin or task.origin


def _read(file: str) -> dict[str, Any]:
    """Return the import report in `file`; raise `HalpipeError` if it is none."""
    try:
        document = load_json(read_bytes(file))
    except ValueError as failure:
        raise _no_report(file, f"it {failure}") from None
    shapes: dict[str, dict[str, type]] = {
        "elements": {"kind": str, "read": int, "mapped": int, "ignored": int},
        "ignored": {"kind": str, "name": str, "reason": str, "file": str, "line": int},
        "dropped": {"kind": str, "count": int},
        "defaults": {"element": str, "what": str, "value": str, "file": str, "line": int},
    }
    if not isinstance(document, dict) or document.get("halpipe-import-report") != 1:
        raise _no_report(file, 'it does not state "halpipe-import-report": 1')
    if not is_shaped(document, {"halpipe-import-report": int, "model": str, **dict.fromkeys(shapes, list)}):
        raise _no_report(file, f"it states something else than a model and the lists {', '.join(shapes)}")
    for key, shape in shapes.items():
        if not all(is_shaped(row, shape) for row in document[key]):
            raise _no_report(file, f'"{key}" is no list of entries with {", ".join(shape)}')
    return document


def _no_report(file: str, message: str) -> HalpipeError:
    help = "write one with `halpipe import ... --report FILE`"
    return HalpipeError(NO_IMPORT_REPORT(message, at=Location(file), help=help))
