"""Short builders for models and schedules in tests: ``task("a", "25ms", version("full", "5ms", "u1 u2"))``."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from fractions import Fraction

from halpipe.core.diagnostics import NOWHERE
from halpipe.core.durations import Duration
from halpipe.models import (
    Access,
    Anchor,
    Chain,
    Job,
    Mode,
    ModeSchedule,
    Precedence,
    Resource,
    Run,
    Schedule,
    Status,
    Task,
    TaskModel,
    Transition,
    Unit,
    Version,
)


def bare(value):
    """Return a value without the places that it came from."""
    if isinstance(value, tuple):
        return tuple(map(bare, value))
    if not is_dataclass(value):
        return value
    changes = {
        field.name: bare(getattr(value, field.name)) for field in fields(value) if field.name != "_ns" and field.init
    }
    for name, nothing in (("origin", None), ("at", NOWHERE), ("digest", "")):
        if name in changes:
            changes[name] = nothing
    return replace(value, **changes) if changes else value


def ms(text: str | int | Duration | None) -> Duration | None:
    """Read a duration, taking bare numbers as milliseconds."""
    if text is None or isinstance(text, Duration):
        return text
    return Duration.parse(f"{text}ms" if isinstance(text, int) or text[-1].isdigit() else text)


def access(resource, start, end, bound=1, kind=None):
    return Access(resource=resource, start=ms(start), end=ms(end), bound=Fraction(bound), kind=kind)


def after(task, low, high, anchor="start"):
    return Precedence(task=task, min=ms(low), max=ms(high), anchor=Anchor(anchor))


def version(name="v", wcet="1ms", units="u1", *parts, gang=1):
    return Version(
        name=name,
        wcet=ms(wcet),
        units=tuple(units.split()),
        gang=gang,
        accesses=tuple(p for p in parts if isinstance(p, Access)),
        precedences=tuple(p for p in parts if isinstance(p, Precedence)),
    )


def task(name, period, *versions, slack=0, offset=None, deadline=None):
    return Task(
        name=name,
        period=ms(period),
        slack=Fraction(slack),
        offset=ms(offset),
        deadline=ms(deadline),
        versions=versions,
    )


def chain(name, tasks, reaction=None, age=None):
    return Chain(name=name, tasks=tuple(tasks.split()), max_reaction=ms(reaction), max_age=ms(age))


def mode(name, tasks):
    """A mode that runs every version of the given tasks; ``tasks`` are Task objects."""
    return Mode(name=name, runs=tuple(Run(task=t.name, versions=tuple(v.name for v in t.versions)) for t in tasks))


def model(*tasks, units="u1", resources="", chains=(), modes=None, transitions=(), name="m"):
    """A model over the given tasks; without ``modes`` one mode called ``all`` runs everything."""
    return TaskModel(
        name=name,
        units=tuple(Unit(name=u) for u in units.split()),
        resources=tuple(Resource(name=r) for r in resources.split()),
        tasks=tasks,
        chains=tuple(chains),
        modes=tuple(modes) if modes is not None else (mode("all", tasks),),
        transitions=tuple(Transition(source=a, target=b, max_length=ms(m)) for a, b, m in transitions),
    )


def job(system, task_name, index, start, units, version_name=None):
    """A job whose end follows from the version's WCET; the first version is the default."""
    owner = system.task(task_name)
    chosen = owner.version(version_name) if version_name else owner.versions[0]
    begin = ms(start)
    return Job(
        task=task_name,
        index=index,
        start=begin,
        end=begin + chosen.wcet,
        version=chosen.name,
        units=tuple(units.split()),
    )


def schedule(system, hyperperiod, *jobs, mode_name="all", status=Status.VALID):
    """A one-mode schedule."""
    table = ModeSchedule(name=mode_name, hyperperiod=ms(hyperperiod), status=status, jobs=jobs)
    return Schedule(model=system.name, model_sha256=system.digest, modes=(table,))


CORES = "c1 c2"


def small_model():
    """Two tasks and a chain on two units: schedulable at once."""
    sense = task("sense", "10ms", version("v", "3ms", CORES, access("mem", "0ms", "1ms")))
    act = task("act", "10ms", version("v", "2ms", CORES, after("sense", "0ms", "4ms", "end")))
    return model(sense, act, units=CORES, resources="mem", chains=[chain("c", "sense act", reaction="40ms")])


def hopeless_model():
    """Three tasks of which no two fit on one unit, and two units: valid as a model, and no search succeeds."""
    wcets = {"first": "7ms", "second": "7ms", "third": "6ms"}
    return model(*(task(name, "10ms", version("v", wcet, CORES)) for name, wcet in wcets.items()), units=CORES)
