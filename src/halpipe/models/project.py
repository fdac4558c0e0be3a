"""An AUTOSAR project as an export sees it: the ECU configuration that a schedule is put onto, by its own paths.

Read by the importer of ARXML, used by its exporter; everything is as the project has it, and nothing is derived from
a schedule.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.durations import Duration


@record
class Item:
    """A module configuration or container: path, definition and its class as written, UUID (empty if none), place.

    `is_added` says that an export put it there; `places` are those of its parts.
    """

    path: str
    is_module: bool
    definition: str
    dest: str
    uuid: str
    at: Location
    is_added: bool = False
    places: tuple[Location, ...] = ()

    @property
    def name(self) -> str:
        """The short name."""
        return self.path.rpartition("/")[2]


@record
class Value:
    """A value or reference of a container: the short name of its definition, its text, whether a generator owns it."""

    name: str
    text: str
    at: Location
    is_generated: bool = False


@record(kw_only=True)
class Call:
    """An event mapping of a task: container, event and OsTask (paths, empty if none), and what triggers it now.

    `os_events`, `alarms` and `points` are the OS objects that the mapping uses. `has_period` tells that the event
    states its period itself.
    """

    mapping: str
    event: str
    is_bsw: bool
    os_task: str
    os_events: tuple[str, ...] = ()
    alarms: tuple[Value, ...] = ()
    points: tuple[Value, ...] = ()
    has_period: bool = True


@record
class LeftOut:
    """A task of the project that the model has not: its name, period, offset, and event mappings."""

    name: str
    period: Duration | None
    offset: Duration | None
    calls: tuple[Call, ...]


@record(kw_only=True)
class ProjectTask:
    """An OsTask: its unit of the model (empty if not bound), its OsApplication, and whether it waits for OS events.

    `priority` is None if the project states none; `is_preemptive` says that OsTasks above may interrupt it anywhere.
    `autostart` is the container (path) by which the OS activates it at its start, empty if it does not. `events` are
    the OsEvents that it waits for, `activations` how many of it can wait.
    """

    path: str
    unit: str
    application: str
    is_extended: bool
    activations: int = 1
    priority: int | None = None
    is_preemptive: bool = False
    autostart: str = ""
    events: tuple[str, ...] = ()


@record(kw_only=True)
class ProjectCounter:
    """An OsCounter: its unit of the model (empty if any), its tick (None: not stated, or impossible), and its range."""

    path: str
    unit: str
    tick: Duration | None
    max_value: int
    min_cycle: int
    at: Location


@record
class Deed:
    """Action of an alarm or expiry point on an OsTask (paths): its container, its expiry point, and its event.

    `event` is empty if the OsTask is activated.
    """

    path: str
    os_task: str
    point: str = ""
    event: str = ""


@record(kw_only=True)
class Starter:
    """An OsAlarm or OsScheduleTable: what it does, and what starts it.

    `autostart` is the container (path) by which the OS starts it, empty if it does not; `cycle` and `start` are in
    ticks. `calls` are the containers (paths) by which the Rte is to start it, without those that its generator made.
    `mode` is the reference to the application mode of the schedule, if the OS starts it in others, too. `is_kept` tells
    that only code starts the table, in place of one that the OS starts; `is_used` that a mapping of the Rte names it.
    `counter` is the OsCounter (path).
    """

    path: str
    is_table: bool
    deeds: tuple[Deed, ...]
    autostart: str = ""
    cycle: str = "0"
    start: str = "0"
    calls: tuple[str, ...] = ()
    mode: Value | None = None
    is_kept: bool = False
    is_used: bool = False
    counter: str = ""

    @property
    def is_coded(self) -> bool:
        """Whether only code starts it, in no place that the configuration states."""
        return not (self.autostart or self.calls)


@record(kw_only=True)
class Project:
    """A project for one model.

    `schema` is what the files say of their release; `os_module` is the path of the configuration of the Os;
    `items` has all containers and modules that may be named, `packages` the UUIDs of packages by path. `calls` has the
    event mappings of every task of the model, `left_out` those of other tasks, `alone` the OsTask of a task that no
    event makes, as a call without mapping. `starters` are the alarms and schedule tables that do something to OsTasks.
    `applications` has the unit of each OsApplication, `app_mode` the application mode (path) that the model is of,
    empty if there is none; `references` has what OsApplications and OsTasks refer to, `definitions` are the files that
    define modules, `files` those that hold the configurations of Os and Rte.
    """

    schema: str
    os_module: str
    items: Mapping[str, Item]
    packages: Mapping[str, str]
    calls: Mapping[str, tuple[Call, ...]]
    left_out: tuple[LeftOut, ...]
    alone: Mapping[str, Call]
    tasks: Mapping[str, ProjectTask]
    counters: tuple[ProjectCounter, ...]
    starters: tuple[Starter, ...]
    applications: Mapping[str, str]
    app_mode: str
    references: Mapping[str, tuple[Value, ...]]
    definitions: tuple[str, ...] = ()
    files: tuple[str, ...] = ()

    def place(self, path: str) -> Location:
        """Return where a container of the project is."""
        item = self.items.get(path)
        return item.at if item else Location()

    def os_tasks(self, task: str) -> list[str]:
        """Return the OsTasks (paths) that run a task of the model."""
        calls = (*self.calls.get(task, ()), *([self.alone[task]] if task in self.alone else []))
        return list(dict.fromkeys(call.os_task for call in calls if call.os_task))
