"""A core of an AUTOSAR OS that plays an exported configuration: read from the file alone, written from the standard.

Jobs end early and interrupts come as the test wants. What is noted is when each job reaches, and leaves, which position
of its execution. Times are whole nanoseconds.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field

from arxml_reading import containers, parameters, special, tables
from halpipe.core.durations import Duration


@dataclass
class Run:
    """A job: the stretches that it still has, as [time left, position at their end], and where it got when."""

    task: str
    start: int
    stretches: list
    at: int | None = 0
    waits: str = ""
    reached: dict = field(default_factory=dict)
    left: dict = field(default_factory=dict)
    arrivals: Counter = field(default_factory=Counter)


@dataclass(frozen=True)
class OsTask:
    """Its priority, whether it is preempted, and the events that it waits for in turn, by position in nanoseconds."""

    priority: int
    is_full: bool
    holds: dict


def read_tasks(root):
    """Every OsTask that works, by name."""
    found = {}
    for name, container in containers(root, "OsTask").items():
        data = special(container, "work")
        if data is not None:
            holds = [dict(inner) for key, inner in data if key == "halpipe:hold"]
            events = defaultdict(list)
            for hold in holds:
                events[int(Duration.parse(hold["at"]).ns)].append(hold["ECUC-CONTAINER-VALUE"].rpartition("/")[2])
            values = parameters(container)
            found[name] = OsTask(int(values["OsTaskPriority"]), values["OsTaskSchedule"] == "FULL", events)
    return found


class Core:
    """Plays the tables of one core, named in their order; `program` gives the stretches of the job that starts."""

    def __init__(self, root, names, tick, program):
        self.tasks = read_tasks(root)
        found = tables(root)
        self.tables = [found[name] for name in names]
        self.tick = tick
        self.program = program
        self.now = 0
        self.open = {}
        self.ready = []
        self.running = None
        self.events = defaultdict(set)
        self.interrupted = 0  # time that interrupts still take
        self.done = []
        self.lost = []

    def play(self, interrupts):
        """Return every job that ran; `interrupts` are instants with the time that each takes."""
        queue = sorted([*self._actions(), *((at, 2, time) for at, time in interrupts)], key=lambda a: a[:2])
        while queue or self.running or self.interrupted:
            self._dispatch()
            left = self.interrupted or (self.open[self.running].stretches[0][0] if self.running else None)
            until = queue[0][0] if queue else None
            if left is not None and (until is None or self.now + left <= until):
                self._pass(left)
            elif until is not None:
                self._pass(until - self.now)
                self._act(*queue.pop(0)[1:])
            else:
                break
        return self.done

    def _actions(self):
        """Yield the expiry points: of one instant, activations come before events."""
        begin = 0
        for table in self.tables:
            for offset, activated in table.points:
                at = begin + offset * self.tick
                yield from ((at, 0, name) for name in activated if name in self.tasks)
                yield from ((at, 1, pair) for pair in table.events.get(offset, ()))
            begin += table.duration * self.tick

    def _act(self, kind, what):
        if kind == 2:
            self.interrupted += what
        elif kind == 0 and what in self.open:
            self.lost.append((what, self.now))  # E_OS_LIMIT
        elif kind == 0:
            self.open[what] = Run(what, self.now, self.program(what, self.now))
            self.events[what].clear()
            self.ready.append(what)
        elif what[0] in self.open:  # an event of a task that is suspended is lost: E_OS_STATE
            run = self.open[what[0]]
            if run.waits == what[1]:
                run.waits = ""
                self.ready.append(run.task)
            else:
                self.events[run.task].add(what[1])

    def _pass(self, time):
        if self.interrupted:
            self.interrupted -= time
        elif self.running:
            run = self.open[self.running]
            if run.at is not None:
                run.left[run.at], run.at = self.now, None
            run.stretches[0][0] -= time
        self.now += time
        while not self.interrupted and self.running and not self.open[self.running].stretches[0][0]:
            self._arrive(self.open[self.running])

    def _arrive(self, run):
        """Let the running job wait, end or go on at the end of a stretch."""
        if run.at is not None:
            run.left[run.at] = self.now
        run.at = run.stretches.pop(0)[1]
        run.reached.setdefault(run.at, self.now)
        waits = self.tasks[run.task].holds.get(run.at, ())
        event = waits[run.arrivals[run.at]] if run.arrivals[run.at] < len(waits) else None
        run.arrivals[run.at] += 1
        if not run.stretches:
            self.done.append(self.open.pop(run.task))
            self.running = None
        elif event is not None and event in self.events[run.task]:
            self.events[run.task].discard(event)
        elif event is not None:
            run.waits, self.running = event, None

    def _dispatch(self):
        """Run the ready task of the highest priority, of those the first; only a FULL one is preempted."""
        best = max(self.ready, key=lambda name: self.tasks[name].priority, default=None)
        if best is None or self.interrupted:
            return
        if self.running is not None:
            task = self.tasks[self.running]
            if not task.is_full or self.tasks[best].priority <= task.priority:
                return
            self.ready.insert(0, self.running)
        self.ready.remove(best)
        self.running = best
