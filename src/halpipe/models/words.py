"""Words of models: the enumerations whose values stand in attributes."""

from __future__ import annotations

from enum import StrEnum


class Word(StrEnum):
    """One of a few words; its `repr` reads back."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}.{self.name}"


class AccessKind(Word):
    """Kind of an access phase on its resource."""

    LOAD = "load"
    READ = "read"
    WRITE = "write"


class ResourceKind(Word):
    """Kind of a shared resource: one that phases take shares of, or one that a single job holds (MODEL 10.5)."""

    MEMORY = "memory"
    LOCK = "lock"
    """Held by one job at a time, from the first to the last instant of its access, gaps included."""


class Anchor(Word):
    """An instant of a job to which a requirement refers (MODEL 10.1)."""

    START = "start"
    END = "end"
    RELEASE = "release"
    """The release of a periodic job: phase plus multiple of the period."""
    POINT = "point"
    """A stated execution time of the job, at worst-case pace."""


class Match(Word):
    """Jobs of the predecessor that satisfy a precedence constraint (MODEL 10.3)."""

    WINDOW = "window"
    """Any job in the window."""
    CYCLE = "cycle"
    """The job of the same cycle."""


class Edge(Word):
    """Edge of the table of a mode: whether jobs may be in progress where it begins again (MODEL 10.4)."""

    OPEN = "open"
    CLOSED = "closed"


class Binding(Word):
    """Migration of the jobs of a task between sets of units: job-level, mode-level or none (MODEL 8.1)."""

    JOB = "job"
    """Every job may use other units."""
    MODE = "mode"
    """All jobs of a mode, and of the tables into it, use one unit set."""
    SYSTEM = "system"
    """The same unit set in all modes and tables, whatever the version."""


class HealthEvent(Word):
    """Event of a job that a health rule counts (MODEL 9)."""

    OVERRUN = "overrun"
    """It did not come to an end, or its data did not, in the time that it has."""
    FAULT = "fault"
    """It trapped, its core did not answer, or the transfer of its data failed."""
    ANY = "any"


class HealthAction(Word):
    """Action of the target when a health rule fires."""

    SWITCH = "switch"
    """Go to another mode through the transition table."""
    RESTART = "restart"
    """Start the cores of the job anew."""
    STOP = "stop"
    """Play no further table."""
