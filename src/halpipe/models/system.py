"""The task model of a system (paper, Table I): units U, resources R, tasks T with versions, modes M_n.

Every element has `at`, the place in the model file it was read from (not part of its value), and may have
an `origin`, the place in the OEM's file it was imported from (part of its value).
"""

from __future__ import annotations

from dataclasses import fields, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import NOWHERE, Location
from halpipe.core.durations import ZERO
from halpipe.core.records import field, record
from halpipe.models.attributes import (
    BANDWIDTH,
    BOUND,
    DURATION,
    GANG,
    GAPS,
    INDEX,
    NAME,
    NAMES,
    POSITIVE,
    SHARE,
    SIZE,
    TEXT,
    TEXTS,
    TIMES,
    TOKEN,
    WEIGHT,
    attribute,
    held,
    named,
    word,
)
from halpipe.models.coercion import Coercion
from halpipe.models.words import (
    AccessKind,
    Anchor,
    Binding,
    Edge,
    HealthAction,
    HealthEvent,
    Match,
    ResourceKind,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.models.coercion import (
        Choice,
        DurationLike,
        Exact,
        Items,
        Names,
        OptionalChoice,
        OptionalSize,
        OptionalTime,
        Size,
        Time,
        Times,
    )

DEFAULT = "default"
"""Name of the version and the mode of a model that has no need of more."""

_COERCIONS: dict[type, Coercion] = {}

T = TypeVar("T")


class Element:
    """Base of classes of fields, which accept plain values such as "25ms" (see `halpipe.models.coercion`)."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Turn what was given for the fields into their types."""
        kind = type(self)
        coerce = _COERCIONS.get(kind)
        if coerce is None:
            coerce = _COERCIONS[kind] = Coercion(kind, globals())
        coerce(self)


@record
class Origin:
    """Source of an imported element: file name, line, and the element's own path in that file."""

    file: str = field(metadata=attribute(TEXT, "As the user named it."))
    line: int = field(default=0, metadata=attribute(INDEX, "0 where the format has no lines."))
    path: str = field(default="", metadata=attribute(TEXT, "The element's own path in that file."))

    @property
    def location(self) -> Location:
        """The origin as a place that a diagnostic can point to."""
        return Location(self.file, self.line)


@record(kw_only=True)
class Interrupt(Element):
    """Sporadic work of a unit: `wcet` c at most once in `distance` T; it interrupts every job at once (MODEL 8.1)."""

    name: str = field(metadata=attribute(NAME))
    distance: Time = field(metadata=attribute(POSITIVE, "The least time between two of them."))
    wcet: Time = field(metadata=attribute(POSITIVE, "The longest time that one takes."))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Unit(Element):
    """An execution unit u of U, with the interrupts that it serves besides the table."""

    name: str = field(metadata=attribute(NAME))
    type: str = field(default="", metadata=attribute(NAME, "Such as the kind of core; not interpreted."))
    interrupts: Items[Interrupt] = field(default=(), metadata=held(Interrupt))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Resource(Element):
    """A shared resource r of R; `bandwidth` is its peak in bytes per second, for the exporters."""

    name: str = field(metadata=attribute(NAME))
    bandwidth: OptionalSize = field(
        default=None, metadata=attribute(BANDWIDTH, "The peak, for exporters; no rule depends on it.")
    )
    kind: Choice[ResourceKind] = field(
        default=ResourceKind.MEMORY,
        metadata=attribute(word(ResourceKind), "A lock is held by one job at a time, gaps included."),
    )
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Transfer(Element):
    """Data moved in an access phase between a buffer in main memory and a symbol of the task; `size` in bytes."""

    buffer: str = field(metadata=attribute(NAME, "In the shared memory."))
    symbol: str = field(metadata=attribute(NAME, "In the task's program."))
    size: Size = field(metadata=attribute(SIZE))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Access(Element):
    """An access phase of A_i^v with its bound B_i^v: in force on [start, end) from the job's start."""

    resource: str = field(metadata=attribute(NAME))
    start: Time = field(metadata=attribute(DURATION, "From the start of the job."))
    end: Time = field(
        metadata=attribute(POSITIVE, "From the start of the job; at most the WCET. The span is half-open.")
    )
    bound: Exact = field(
        default=Fraction(1), metadata=attribute(BOUND, "The share of the resource: above 0, at most 1.", always=True)
    )
    kind: OptionalChoice[AccessKind] = field(default=None, metadata=attribute(word(AccessKind)))
    transfers: Items[Transfer] = field(default=(), metadata=held(Transfer))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Precedence(Element):
    """A constraint of P_i^v: an instant of some job of `task` lies between `min` and `max` before one of this job.

    `anchor` is the instant of the predecessor, `to` that of this job: its start or end. With ``match="cycle"`` the job
    of the predecessor is that of the same cycle (MODEL 10.2 and 10.3).
    """

    task: str = field(metadata=attribute(NAME, "The predecessor."))
    anchor: Choice[Anchor] = field(
        default=Anchor.START,
        metadata=attribute(
            word(Anchor), "The instant of the predecessor from which the window counts.", name="from", always=True
        ),
    )
    point: OptionalTime = field(
        default=None,
        metadata=attribute(DURATION, "The execution time of the predecessor from which the window counts."),
    )
    to: Choice[Anchor] = field(
        default=Anchor.START,
        metadata=attribute(word(Anchor), "The instant of this job that lies in the window: its start or its end."),
    )
    match: Choice[Match] = field(
        default=Match.WINDOW,
        metadata=attribute(word(Match), "Any job of the predecessor in the window, or the one of the same cycle."),
    )
    min: Time = field(default=ZERO, metadata=attribute(DURATION, always=True))
    max: Time = field(metadata=attribute(DURATION))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    @property
    def is_plain(self) -> bool:
        """Whether the window leads from the start or the end of any job of the predecessor to the start of this one."""
        is_between = self.anchor in (Anchor.START, Anchor.END) and self.to is Anchor.START
        return is_between and self.match is Match.WINDOW

    @property
    def words(self) -> str:
        """The window in words: from which instant of which job to which instant of this one."""
        cycle = "" if self.match is Match.WINDOW else " of the same cycle"
        until = "" if self.to is Anchor.START else f", until the {self.to}"
        return f"after the {self.instant} of {self.task}{cycle}{until}"

    @property
    def instant(self) -> str:
        """The instant of the predecessor, in words."""
        return f"instant {self.point} of the execution" if self.anchor is Anchor.POINT else str(self.anchor)


@record(kw_only=True)
class Source(Element):
    """The C sources of a version, for deployment: files, entry function, preprocessor definitions."""

    files: Names = field(metadata=attribute(TEXTS, "Names without white space."))
    entry: str = field(metadata=attribute(TOKEN, "The function of one job."))
    defines: Names = field(
        default=(), metadata=attribute(TEXTS, "Definitions for the preprocessor, such as PARTICLES=500.")
    )
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Split(Element):
    """Preemption points of a version, in execution time: 0 is their start, C their end (MODEL 8.1).

    `points` is the list of split points; `anywhere` allows every instant of (0, C) not strictly inside an access
    phase. `resume` is the preemption overhead, lost at each resumption. `max_gaps` None is no limit, for a list.
    `min_part` is the least execution time of each part of a job with gaps. The default: a job runs in one piece.
    """

    points: Times = field(default=())
    anywhere: bool = False
    resume: Time = field(default=ZERO, metadata=attribute(DURATION, "Preemption overhead, lost when a job resumes."))
    max_gaps: int | None = field(
        default=None, metadata=attribute(GAPS, 'Absent: no limit, for split points; must be stated for "anywhere".')
    )
    min_part: OptionalTime = field(
        default=None,
        metadata=attribute(POSITIVE, 'The least execution time of each part of a job with gaps; for "anywhere" only.'),
    )

    @property
    def is_allowed(self) -> bool:
        """Whether jobs may be preempted at all."""
        return self.anywhere or bool(self.points)

    def scaled(self, factor: Fraction) -> Split:
        """Return the split of a version whose WCET is `factor` times as long; resumptions cost what they did."""
        points = tuple(point * factor for point in self.points)
        min_part = None if self.min_part is None else self.min_part * factor
        return replace(self, points=points, min_part=min_part)


WHOLE = Split()
"""Jobs run in one piece."""


@record(kw_only=True)
class Version(Element):
    """A version v of a task: WCET C, valid units U, gang size, access phases, precedence constraints, sources.

    `wcet` is None while no source has stated it: an imported model may be stored so, but not scheduled.
    """

    name: str = field(metadata=attribute(NAME))
    wcet: OptionalTime = field(
        default=None,
        metadata=attribute(
            POSITIVE, "Absent in an imported model whose source states no WCET; such a model cannot be scheduled yet."
        ),
    )
    units: Names = field(
        default=(),
        metadata=attribute(
            NAMES,
            "Absent in an imported model whose source states how many units a job takes, but not which.",
            name="names",
            element="units",
        ),
    )
    gang: int = field(default=1, metadata=attribute(GANG, "How many of them a job takes together.", element="units"))
    accesses: Items[Access] = field(default=(), metadata=held(Access))
    precedences: Items[Precedence] = field(default=(), metadata=held(Precedence))
    source: Source | None = field(default=None, metadata=held(Source))
    split: Split = WHOLE
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Task(Element):
    """A task tau of T: period D (None: on demand), slack gamma, optional offset and deadline, versions.

    With `distance` it serves sporadic arrivals at least so far apart: its period is that of polling, and its deadline
    (default: the distance) counts from the arrival (MODEL 8.1).
    """

    name: str = field(metadata=attribute(NAME))
    period: OptionalTime = field(
        default=None,
        metadata=attribute(POSITIVE, "Absent: the task runs on demand of the precedence constraints that name it."),
    )
    slack: Exact = field(
        default=Fraction(0),
        metadata=attribute(SHARE, "The share of the period by which a job may start after its release."),
    )
    offset: OptionalTime = field(
        default=None, metadata=attribute(DURATION, "The first release, modulo the period. Absent: free.")
    )
    deadline: OptionalTime = field(
        default=None,
        metadata=attribute(
            POSITIVE,
            "Counted from the release, or, with a distance, from the arrival. Absent: the period, or the distance.",
        ),
    )
    distance: OptionalTime = field(
        default=None,
        metadata=attribute(
            POSITIVE,
            "The least time between two of the sporadic arrivals that the task serves by polling with its period.",
        ),
    )
    let: OptionalTime = field(
        default=None,
        metadata=attribute(
            POSITIVE, "Logical execution time: data are read at the release and written so long after it."
        ),
    )
    binding: Choice[Binding] = field(
        default=Binding.JOB,
        metadata=attribute(
            word(Binding),
            "Whether its jobs keep to one set of units: each for itself, in each mode, or in the whole system. "
            "Absent: as stated for all tasks.",
            common=True,
        ),
    )
    versions: Items[Version] = field(default=(), metadata=held(Version))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def version(self, name: str) -> Version:
        """Return the version called `name`; raise ``KeyError`` if there is none."""
        return named(self.versions, name)


@record(kw_only=True)
class Chain(Element):
    """A cause-effect chain: tasks in order, with optional limits on reaction time and data age."""

    name: str = field(metadata=attribute(NAME))
    tasks: Names = field(metadata=attribute(NAMES, "In the order of the data."))
    max_latency: OptionalTime = field(
        default=None,
        metadata=attribute(POSITIVE, "From a job of the first task to the first job of the last that has its data."),
    )
    max_reaction: OptionalTime = field(
        default=None, metadata=attribute(POSITIVE, "From a stimulus to the end of the last task that has seen it.")
    )
    max_age: OptionalTime = field(
        default=None,
        metadata=attribute(POSITIVE, "From the start of the first task to the end of the last that uses its data."),
    )
    anchor: OptionalChoice[Anchor] = field(
        default=None,
        metadata=attribute(
            word(Anchor),
            "The instant of the first task from which latencies count. Absent: its start, or release with a LET.",
            name="from",
        ),
    )
    to: OptionalChoice[Anchor] = field(
        default=None,
        metadata=attribute(
            word(Anchor),
            "The instant of the last task to which latencies count. Absent: its end, or release + LET with a LET.",
        ),
    )
    weight: Exact = field(
        default=Fraction(1),
        metadata=attribute(WEIGHT, "What its latencies count beside those of others."),
    )
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Run(Element):
    """A task that runs in a mode, with the versions available there."""

    task: str = field(metadata=attribute(NAME))
    versions: Names = field(metadata=attribute(NAMES, "Those available in the mode."))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Mode(Element):
    """An execution mode M_n; a task without a run is not scheduled in it."""

    name: str = field(metadata=attribute(NAME))
    edge: Choice[Edge] = field(
        default=Edge.OPEN,
        metadata=attribute(word(Edge), "Closed: no job and no access is in progress where the table begins again."),
    )
    runs: Items[Run] = field(metadata=held(Run))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class Transition(Element):
    """An ordered pair of modes that may be switched, optionally within a maximum length of the table."""

    source: str = field(metadata=attribute(NAME, name="from"))
    target: str = field(metadata=attribute(NAME, name="to"))
    max_length: OptionalTime = field(
        default=None, metadata=attribute(DURATION, "Of the table between the two modes. Absent: any.")
    )
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class HealthRule(Element):
    """After `count` events of jobs of `task` within `cycles` tables in a row the target takes an action (MODEL 9).

    `mode` is where a switch leads; there the rule does not hold.
    """

    task: str = field(metadata=attribute(NAME))
    event: Choice[HealthEvent] = field(
        default=HealthEvent.ANY,
        metadata=attribute(
            word(HealthEvent),
            "What counts: an execution or a transfer that is not over in time; "
            "a trap, or a transfer that fails; or both.",
            name="on",
        ),
    )
    count: int = field(default=1, metadata=attribute(TIMES, "After how many of them"))
    cycles: int = field(
        default=1, metadata=attribute(TIMES, "in how many tables in a row, those of modes and of transitions.")
    )
    action: Choice[HealthAction] = field(
        default=HealthAction.SWITCH,
        metadata=attribute(
            word(HealthAction),
            "Switch to a mode through the transition table; restart the cores of the job; or stop after the table.",
            required=True,
        ),
    )
    mode: str = field(default="", metadata=attribute(NAME, "Where a switch leads; required there, and only there."))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    at: Location = field(default=NOWHERE, compare=False, repr=False)


@record(kw_only=True)
class TaskModel(Element):
    """A whole system. `digest` is the SHA-256 of the file it was read from (hexadecimal, empty if none).

    A model that is changed, as by ``dataclasses.replace``, has none: it is no longer that of the file.
    """

    name: str = field(metadata=attribute(NAME))
    units: Items[Unit] = field(default=(), metadata=held(Unit, section="platform"))
    resources: Items[Resource] = field(default=(), metadata=held(Resource, section="platform"))
    tasks: Items[Task] = field(default=(), metadata=held(Task, section="tasks"))
    chains: Items[Chain] = field(default=(), metadata=held(Chain, section="chains"))
    modes: Items[Mode] = field(default=(), metadata=held(Mode, section="modes"))
    transitions: Items[Transition] = field(default=(), metadata=held(Transition, section="transitions"))
    health: Items[HealthRule] = field(default=(), metadata=held(HealthRule, "rule", section="health"))
    origin: Origin | None = field(default=None, metadata=held(Origin))
    digest: str = field(default="", init=False, compare=False, repr=False)
    at: Location = field(default=NOWHERE, compare=False, repr=False)

    def read_from(self, digest: str) -> TaskModel:
        """Return the model with the hash of the file that it was read from."""
        model = replace(self)
        object.__setattr__(model, "digest", digest)
        return model

    def add_task(
        self,
        name: str,
        *,
        wcet: DurationLike | None = None,
        units: str | Iterable[str] = (),
        modes: Iterable[str] = (),
        **fields: Any,
    ) -> TaskModel:
        """Return the model with one more task; `fields` are those of `Task`.

        With `wcet`, the task has one version called "default" on `units`, which are added where the model lacks them.
        The task runs in `modes`, else in every mode; in one called "default" where there is none.
        """
        named = (units,) if isinstance(units, str) else tuple(units)
        if wcet is not None:
            fields["versions"] = (Version(name=DEFAULT, wcet=wcet, units=list(named)),)
        task = _made(Task, name=name, **fields)
        new = {unit: Unit(name=unit) for version in task.versions for unit in version.units}
        known = {mode.name: mode for mode in self.modes}
        for mode in modes or known or (DEFAULT,):
            old = known.get(mode, Mode(name=mode, runs=()))
            run = Run(task=name, versions=[version.name for version in task.versions])
            known[mode] = replace(old, runs=(*old.runs, run))
        for unit in self.units:
            new.pop(unit.name, None)
        all_units = (*self.units, *new.values())
        return replace(self, units=all_units, tasks=(*self.tasks, task), modes=tuple(known.values()))

    def add_chain(self, name: str, *tasks: str, **fields: Any) -> TaskModel:
        """Return the model with one more chain through `tasks`; `fields` are those of `Chain`."""
        return replace(self, chains=(*self.chains, _made(Chain, name=name, tasks=list(tasks), **fields)))

    def task(self, name: str) -> Task:
        """Return the task called `name`; raise ``KeyError`` if there is none."""
        return named(self.tasks, name)

    def mode(self, name: str) -> Mode:
        """Return the mode called `name`; raise ``KeyError`` if there is none."""
        return named(self.modes, name)

    def alone(self, *modes: str, transitions: tuple[Transition, ...] = ()) -> TaskModel:
        """Return the model of these modes, with no more than these switches and without the health rules."""
        kept = tuple(mode for mode in self.modes if mode.name in modes)
        return replace(self, modes=kept, transitions=transitions, health=())

    def refinements(self) -> Iterator[tuple[str, Location]]:
        """Yield the requirements on instants, cycles, edges and LET (MODEL 10), by name, with their places."""
        yield from ((f'closed edge of mode "{m.name}"', m.at) for m in self.modes if m.edge is Edge.CLOSED)
        for task in self.tasks:
            if task.let is not None:
                yield f'logical execution time of task "{task.name}"', task.at
            for row in (p for v in task.versions for p in v.precedences):
                if row.match is Match.CYCLE:
                    yield f'constraint of task "{task.name}" on the same cycle', row.at
                if row.to is not Anchor.START or row.anchor not in (Anchor.START, Anchor.END):
                    yield f'constraint of task "{task.name}" from {row.anchor} to {row.to}', row.at
        for chain in self.chains:
            if (chain.anchor, chain.to, chain.max_latency) != (None, None, None):
                yield f'events or latency of chain "{chain.name}"', chain.at

    def allowed_transitions(self) -> Iterator[Transition]:
        """Yield the mode pairs that may be switched: those listed, or every ordered pair when none is (MODEL 2)."""
        if self.transitions:
            yield from self.transitions
            return
        for source in self.modes:
            for target in self.modes:
                if source.name != target.name:
                    yield Transition(source=source.name, target=target.name)


def _made(kind: type[T], **given: Any) -> T:
    """Return an element; raise ``TypeError`` that names the fields for a keyword that is none."""
    known = [field.name for field in fields(kind)]  # type: ignore[arg-type]
    for name in given.keys() - set(known):
        raise TypeError(f"{kind.__name__} has no field {name!r}; write one of {', '.join(known)}")
    return kind(**given)
