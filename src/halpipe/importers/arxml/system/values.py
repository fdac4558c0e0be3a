"""Timing content of an ARXML input, as frozen values between the files and the task model.

Every element has a `Place`: its AUTOSAR path, its kind for the coverage report, and its file and line.
References that nothing resolves are None or absent here; they have been reported.
"""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Code, Findings, Location, named
from halpipe.core.records import record
from halpipe.models import Origin

if TYPE_CHECKING:
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.files.tree import Stated


@record
class Place:
    """Place of an element: AUTOSAR path, kind (XML tag, or ECU configuration definition), file and line."""

    path: str
    kind: str
    at: Location

    @property
    def name(self) -> str:
        """The short name."""
        return self.path.rpartition("/")[2]

    def report(self, findings: Findings, code: Code, message: str, help: str = "") -> None:
        """Report something of the element."""
        findings.report(code, message, at=self.at, path=named(self.kind, self.path), help=help)

    @property
    def origin(self) -> Origin:
        """The same as the origin of a model element."""
        return Origin(self.at.file, self.at.line, self.path)


# ----------------------------------------------------------------------------------------- software components


@record
class DataItem:
    """A data element at a port (paths), or a variable between runnables with an empty port."""

    port: str
    element: str


@record(kw_only=True)
class Runnable:
    """A RUNNABLE-ENTITY or BSW-SCHEDULABLE-ENTITY with the data it writes and reads; `symbol` is its C function.

    `interval` is the least time between two starts of it, `areas` are the exclusive areas that it enters or runs in.
    """

    place: Place
    symbol: str = ""
    writes: tuple[DataItem, ...] = ()
    reads: tuple[DataItem, ...] = ()
    interval: Stated | None = None
    areas: tuple[Place, ...] = ()


@record(kw_only=True)
class Event:
    """An RTE or BSW event: the runnable it starts (path, None if unresolved or none), and its stated times.

    `mode_ports` are the ports (paths) at which the modes arrive that it is disabled in.
    """

    place: Place
    runnable: str | None
    period: Stated | None = None
    offset: Stated | None = None
    data: DataItem | None = None
    disabled_in: tuple[str, ...] = ()
    mode_ports: tuple[str, ...] = ()

    @property
    def is_timing(self) -> bool:
        """Whether the event is meant to recur with a period."""
        return self.place.kind in ("TIMING-EVENT", "BSW-TIMING-EVENT")


@record(kw_only=True)
class Component:
    """A component type or BSW module description with its behaviours' runnables and events."""

    place: Place
    behaviors: tuple[Place, ...]
    runnables: tuple[Runnable, ...]
    events: tuple[Event, ...]

    @property
    def is_module(self) -> bool:
        """Whether it is basic software, which has no instances."""
        return self.place.kind == "BSW-MODULE-DESCRIPTION"


@record
class End:
    """One end of a connector: a component prototype (path, empty for the composition itself) and its port (path)."""

    prototype: str
    port: str


@record(kw_only=True)
class Connector:
    """An assembly or delegation connector, from where data comes to where it goes; an end is None if dangling."""

    place: Place
    source: End | None
    target: End | None


@record
class Prototype:
    """A component prototype: the use of a component type (path, None if dangling) in a composition."""

    place: Place
    type: str | None


@record(kw_only=True)
class Composition:
    """A COMPOSITION-SW-COMPONENT-TYPE; `periods` has that of an event in one of its component prototypes (paths)."""

    place: Place
    prototypes: tuple[Prototype, ...]
    connectors: tuple[Connector, ...]
    periods: dict[tuple[str, str], Stated] = field(default_factory=dict)


@record
class Instance:
    """A component in the system: `context` is its root composition and the prototypes down to it (paths).

    `label` is what tasks of it are called: the names of the prototypes below the root, or the name of the type.
    """

    label: str
    context: tuple[str, ...]
    component: Component

    @property
    def prototype(self) -> str:
        """The path of its component prototype, or of its type if it has none."""
        return self.context[-1]


# -------------------------------------------------------------------------------------------- ECU configuration


@record
class Core:
    """A processor core; `place` is None for one that is only numbered (OsApplicationCoreAssignment).

    `hardware` is the HW-ELEMENT (path) that it is, or runs on, where that is stated.
    """

    name: str
    id: int | None
    place: Place | None
    hardware: str | None = None


@record
class OsApplication:
    """An OsApplication: its tasks and interrupt routines (paths), and the name of the core it is bound to."""

    place: Place
    tasks: tuple[str, ...]
    core: str | None
    routines: tuple[str, ...] = ()


@record
class OsTask:
    """An OsTask; `core` is that of its OsApplication, `period` its own OsTaskPeriod.

    `schedule` is OsTaskSchedule: FULL, NON, or empty where it is not stated. `is_basic` tells that it cannot wait for
    OsEvents, `budget` is the execution budget of its timing `protection`, and `resources` are the OsResources it takes.
    """

    place: Place
    core: str | None
    period: Duration | None
    schedule: str = ""
    is_basic: bool = False
    budget: Duration | None = None
    resources: tuple[Place, ...] = ()
    protection: Place | None = None


@record
class OsIsr:
    """An interrupt routine; `core` is that of its OsApplication.

    Its timing protection, if any, states a `budget` for its execution and the least `distance` of two arrivals.
    """

    place: Place
    core: str | None
    budget: Duration | None
    distance: Duration | None


@record(kw_only=True)
class Trigger:
    """A recurring action of the OS: an alarm, or an expiry point of a repeating schedule table.

    Activates tasks and sets OS events (paths) every `period`, first at `offset`. `through` are the counter that
    gives ticks their length and the table of the expiry point; `wakes` are the tasks that wait for the events.
    """

    place: Place
    period: Duration
    offset: Duration
    tasks: tuple[str, ...]
    events: tuple[str, ...]
    through: tuple[Place, ...]
    wakes: tuple[str, ...] = ()

    @property
    def table(self) -> str:
        """The path of the schedule table of an expiry point, empty for an alarm."""
        return self.place.path.rpartition("/")[0] if self.place.kind == "OsScheduleTableExpiryPoint" else ""


@record(kw_only=True)
class EventMapping:
    """RteEventToTaskMapping or RteBswEventToTaskMapping: an event (path) of an instance, run by an OsTask (path).

    `prototype` is what the configuration calls the instance: often a prototype of the flattened ECU extract.
    `is_called` tells a mapping that names no OsTask from one whose OsTask is in no file. `period` replaces that of the
    event.
    """

    place: Place
    prototype: str | None
    event: str | None
    task: str | None
    position: int | None
    offset: Stated | None
    triggers: tuple[str, ...]
    is_called: bool = True
    period: Stated | None = None


@record(kw_only=True)
class RteInstance:
    """RteSwComponentInstance: the component prototype (path) that it names, where, and its events (paths)."""

    place: Place
    prototype: str
    at: Location
    events: tuple[str, ...]


@record(kw_only=True)
class Configuration:
    """The ECU configuration of Os, Rte and EcuC; `instances` are the component instances that Rte names.

    `modules` are the module configurations (paths) of the ECU that was chosen, of whatever kind; empty if none was.
    `spinlocks` are those with the OsTasks (paths) that take them, where it is clear which those are. `kinds` has the
    short name of the definition of every container (path), of any ECU.
    """

    cores: tuple[Core, ...] = ()
    applications: tuple[OsApplication, ...] = ()
    tasks: tuple[OsTask, ...] = ()
    triggers: tuple[Trigger, ...] = ()
    mappings: tuple[EventMapping, ...] = ()
    instances: tuple[RteInstance, ...] = ()
    modules: tuple[str, ...] = ()
    routines: tuple[OsIsr, ...] = ()
    spinlocks: tuple[tuple[Place, tuple[str, ...]], ...] = ()
    kinds: dict[str, str] = field(default_factory=dict)


@record(kw_only=True)
class ModeGroup:
    """A MODE-DECLARATION-GROUP, or a function group of that type: its modes, the initial one first, and transitions.

    Transitions have the paths of the modes exited and entered; `parts` are the elements that a function group's
    modes are declared by.
    """

    place: Place
    modes: tuple[Place, ...]
    transitions: tuple[tuple[Place, str, str], ...]
    parts: tuple[Place, ...] = ()


@record
class Ordered:
    """Member of an execution order: a runnable or event (path), in one component prototype if that is stated."""

    path: str
    prototype: str | None = None


@record
class Order:
    """An order from an EXECUTION-ORDER-CONSTRAINT or SYNCHRONIZATION-POINT-CONSTRAINT: `first` before `second`."""

    place: Place
    first: Ordered
    second: Ordered


@record
class ExecutionTime:
    """A worst-case execution time of a runnable (path) on a HW-ELEMENT (path, None: on any); the place has its kind."""

    place: Place
    runnable: str
    time: Duration
    hardware: str | None = None


# ------------------------------------------------------------------------------------------- timing extension


@record(kw_only=True)
class Observable:
    """A timing description event: what happens (`activated`, `started`, `terminated`, `sent`, `received`), and to what.

    `subject` is the runnable, or the data element (path) at `port`; `prototype` the component prototype, if stated.
    """

    place: Place
    what: str
    subject: str
    port: str = ""
    prototype: str | None = None


@record(kw_only=True)
class EventChain:
    """A TIMING-DESCRIPTION-EVENT-CHAIN: paths of its timing description events, and of the chains it consists of."""

    place: Place
    stimulus: str | None
    response: str | None
    segments: tuple[str, ...] = ()


@record(kw_only=True)
class Arrival:
    """An event triggering: how often a timing description event (path) occurs.

    `offsets` None: unforeseen, but not sooner than a `period` after the last; else at these offsets in each period.
    """

    place: Place
    event: str
    period: Duration
    offsets: tuple[Duration, ...] | None
    jitter: Duration | None = None


@record(kw_only=True)
class Limit:
    """A LATENCY-TIMING-CONSTRAINT of a chain, or an AGE-CONSTRAINT of an event (path): at most `maximum`."""

    place: Place
    scope: str
    maximum: Duration
    is_age: bool


@record(kw_only=True)
class Distance:
    """An OFFSET-TIMING-CONSTRAINT: the event `target` occurs `minimum` to `maximum` after `source` (paths)."""

    place: Place
    source: str
    target: str
    minimum: Duration | None
    maximum: Duration | None


@record
class Synchronisation:
    """A SYNCHRONIZATION-TIMING-CONSTRAINT: the `events` (paths) occur within `tolerance` of each other."""

    place: Place
    events: tuple[str, ...]
    tolerance: Duration


@record
class LetGroup:
    """Contents of one LET interval: runnables or events, and the event chain (path) that is the interval."""

    place: Place
    interval: str
    members: tuple[Ordered, ...]


@record(kw_only=True)
class Timing:
    """Timing extension: observable events, and the requirements on them."""

    observables: tuple[Observable, ...] = ()
    chains: tuple[EventChain, ...] = ()
    arrivals: tuple[Arrival, ...] = ()
    limits: tuple[Limit, ...] = ()
    distances: tuple[Distance, ...] = ()
    synchronisations: tuple[Synchronisation, ...] = ()
    lets: tuple[LetGroup, ...] = ()


@record(kw_only=True)
class Machine:
    """A MACHINE with its processor cores."""

    place: Place
    cores: tuple[Place, ...]


@record(kw_only=True)
class Process:
    """A PROCESS: the states (paths below their function group) in which it does not run, and the cores it may use.

    `machine` is None if it is mapped to none. `cycle` and `workers` are those of its DETERMINISTIC-CLIENT; `parts`
    are the elements without a name of their own that say all this.
    """

    place: Place
    disabled_in: tuple[str, ...] = ()
    machine: str | None = None
    cores: tuple[str, ...] = ()
    cycle: Stated | None = None
    workers: int = 1
    parts: tuple[Place, ...] = ()


@record
class Ecu:
    """An ECU-INSTANCE, and the SWC-TO-ECU-MAPPINGs that put component prototypes on it.

    `hardware` has the HW-ELEMENT (path) of those prototypes whose mapping names a processing unit; `chains` has each
    prototype with those that hold it, as the mapping states them.
    """

    place: Place
    mappings: tuple[Place, ...]
    hardware: tuple[tuple[str, str], ...]
    chains: tuple[tuple[str, ...], ...]

    @property
    def prototypes(self) -> tuple[str, ...]:
        """The component prototypes (paths) that are put on it."""
        return tuple(chain[-1] for chain in self.chains)


@record(kw_only=True)
class System:
    """Everything that the input says about timing; `place` is the element that gives the system its name.

    `configured` has the context of the instance that each prototype (path) of the Rte configuration stands for,
    `twins` the runnable that is the same function as a BSW entity (paths), and `holders` the HW-ELEMENTs (paths) that
    an HW-ELEMENT is nested in.
    """

    place: Place | None = None
    components: tuple[Component, ...] = ()
    compositions: tuple[Composition, ...] = ()
    instances: tuple[Instance, ...] = ()
    copies: tuple[str, ...] = ()
    configured: dict[str, tuple[str, ...]] = field(default_factory=dict)
    configuration: Configuration = field(default_factory=Configuration)
    mode_groups: tuple[ModeGroup, ...] = ()
    orders: tuple[Order, ...] = ()
    twins: dict[str, str] = field(default_factory=dict)
    execution_times: tuple[ExecutionTime, ...] = ()
    ecus: tuple[Ecu, ...] = ()
    hardware: tuple[Place, ...] = ()
    holders: dict[str, tuple[str, ...]] = field(default_factory=dict)
    timing: Timing = field(default_factory=Timing)
    machines: tuple[Machine, ...] = ()
    processes: tuple[Process, ...] = ()

    @property
    def name(self) -> str:
        """The name of the ECU, root composition or system, or ``arxml`` where there is not exactly one."""
        return self.place.name if self.place else "arxml"

    @property
    def events(self) -> tuple[Event, ...]:
        """Every event of every component type and module."""
        return tuple(event for component in self.components for event in component.events)
