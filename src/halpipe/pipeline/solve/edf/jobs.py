"""Input and outcome of a simulation of earliest deadline first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.pipeline.solve.edf.works import Way
    from halpipe.pipeline.solve.integers import Ints

Span = tuple[int, int, int, int]
"""A part: start, end, and what it executes, from and to."""


@record
class Plan:
    """Input of the simulation: for each task its option, the phase of its releases, and the urgency of its jobs.

    `urgency` is the deadline by which jobs are ordered, from their release; they are held back for `holds` after it.
    With `fresh` a job waits, as long as it can, for the job of its predecessor that was released before it or with it.
    """

    ways: tuple[Way, ...]
    phases: tuple[int, ...]
    urgency: tuple[int, ...]
    holds: tuple[int, ...]
    fresh: bool = True


@record
class Table:
    """One hyperperiod: where the jobs of each task lie, their starts in [0, hyperperiod).

    The jobs of task n are numbers `places[n]` to `places[n + 1]` of the arrays; `indices` are theirs within the task.
    `releases` are the instants of release that belong to those starts. The parts of each are `counts` rows of `parts`
    (start, end, executed from, to) from row `firsts` on; a job that did not start in the hyperperiod has none. `late`
    sums for each task by how much its jobs start or end too late. A table that is not `closed` does not repeat.
    """

    places: Ints
    indices: Ints
    releases: Ints
    starts: Ints
    ends: Ints
    firsts: Ints
    counts: Ints
    parts: Ints
    late: tuple[int, ...]
    closed: bool

    def __len__(self) -> int:
        return len(self.counts) - self.counts.count(0)

    @property
    def part_count(self) -> int:
        """How many parts all jobs have."""
        return sum(self.counts)

    def is_whole(self, task: int) -> bool:
        """Return whether a task has jobs, and each of them started in the hyperperiod."""
        counts = self.counts[self.places[task] : self.places[task + 1]]
        return bool(counts) and 0 not in counts

    def jobs(self, task: int) -> Iterator[tuple[int, tuple[Span, ...]]]:
        """Yield the index and the parts of each job of a task."""
        for place in range(self.places[task], self.places[task + 1]):
            if self.counts[place]:
                yield self.indices[place], self.spans(place)

    def spans(self, place: int) -> tuple[Span, ...]:
        """Return the parts of a job."""
        first = 4 * self.firsts[place]
        flat = self.parts[first : first + 4 * self.counts[place]]
        return tuple(zip(flat[::4], flat[1::4], flat[2::4], flat[3::4], strict=True))

    def slips(self, task: int) -> list[int]:
        """Return how long after their release the jobs of a task start, of those that started."""
        begin, end = self.places[task], self.places[task + 1]
        numbers = range(begin, end)
        return [self.starts[n] - self.releases[n] for n in numbers if self.counts[n]]
