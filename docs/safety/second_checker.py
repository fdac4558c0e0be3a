"""A second checker of schedules, independent of halpipe: it needs nothing but Python.

    python docs/safety/second_checker.py MODEL.xml SCHEDULE.xml

It decides the steady state of every mode and every switch, from the page that says what "valid" means, in exact time.
Of reported figures it knows hyperperiods, worst latencies and those of chains. One line per broken rule; exit code 0:
valid, 1: not valid, 2: cannot read.
"""

from __future__ import annotations

import hashlib
import re
import sys
import xml.etree.ElementTree as ET
from bisect import bisect_left, bisect_right
from collections import defaultdict
from fractions import Fraction
from functools import lru_cache
from graphlib import CycleError, TopologicalSorter
from itertools import pairwise
from math import lcm
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

NUMBER = re.compile(r"[0-9]{1,1000}(?:\.[0-9]{1,1000}|/0*[1-9][0-9]{0,999})?")
DURATION = re.compile(f"({NUMBER.pattern}) ?(ns|us|ms|s)")
SCALE = {"ns": 1, "us": 1000, "ms": 1000**2, "s": 1000**3}
LARGEST_FILE, MOST_JOBS = 64 * 1024 * 1024, 1_000_000
Part = tuple[int, int, int, int]
Limits = list[int | None]
Step = tuple["Job", int]  # a job, and how much later it runs than where it stands
Finding = tuple[str, str, str, int | str, str]


class UnreadableError(Exception):
    """The files do not hold a model and a schedule."""


def number(text: str) -> Fraction:
    if not NUMBER.fullmatch(text.strip()):
        raise UnreadableError(f"{text[:60]!a} is not a number")
    return Fraction(text.strip())


TICKS = [1]  # in a nanosecond: so many that every time of both files is a whole number of them


def fit(*roots: ET.Element) -> None:
    words = {word for root in roots for e in root.iter() for value in e.attrib.values() for word in value.split()}
    TICKS[0] = lcm(*(exact(word).denominator for word in words if DURATION.fullmatch(word)))


@lru_cache(maxsize=100_000)
def exact(text: str) -> Fraction:
    found = DURATION.fullmatch(text.strip())
    if not found:
        raise UnreadableError(f"{text[:60]!a} is not a duration")
    return Fraction(found[1]) * SCALE[found[2]]


def duration(text: str) -> int:
    return (exact(text) * TICKS[0]).numerator


def up(dividend: int, divisor: int) -> int:
    return -(-dividend // divisor)


def optional(element: ET.Element, name: str) -> int | None:
    return duration(element.get(name, "")) if name in element.attrib else None


def need(element: ET.Element, name: str) -> str:
    if name not in element.attrib:
        raise UnreadableError(f"{element.tag} has no {name}")
    return element.attrib[name]


def at(element: ET.Element, name: str) -> int:
    return duration(need(element, name))


def inside(element: ET.Element, *path: str) -> Iterator[ET.Element]:  # those on a path of names
    space = element.tag.partition("}")[0] + "}"
    return element.iterfind("/".join(space + name for name in path))


def root_of(path: str, kind: str) -> tuple[ET.Element, str]:
    with open(path, "rb") as file:
        data = file.read(LARGEST_FILE + 1)
    # Another encoding could hide a declaration from the scan.
    if len(data) > LARGEST_FILE or b"\0" in data or b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise UnreadableError(f"{path} is too large, has a document type or is not UTF-8")
    data.decode("utf-8")
    declared = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)", data.removeprefix(b"\xef\xbb\xbf"))
    if declared and declared[1].lower() not in (b"utf-8", b"us-ascii"):
        raise UnreadableError(f"{path} is not UTF-8")
    root = ET.fromstring(data)
    if root.tag != f"{{urn:halpipe:{kind}:1}}{kind}":
        raise UnreadableError(f"{path} is not a {kind}")
    return root, hashlib.sha256(data).hexdigest()


class Version:
    def __init__(self, element: ET.Element, locks: set[str]) -> None:
        self.name, self.wcet, self.locks = need(element, "name"), at(element, "wcet"), locks
        split = element.get("split", "none").split()
        self.anywhere = split == ["anywhere"]
        self.points: set[int] = set() if split in (["none"], ["anywhere"]) else {duration(point) for point in split}
        self.resume = duration(element.get("resume", "0ns"))
        self.max_gaps = int(element.get("max-gaps", "1000000000"))
        self.min_part = duration(element.get("min-part", "0ns"))
        units = next(inside(element, "units"), element)
        self.units = set(need(units, "names").split())
        self.gang = int(units.get("gang", "1"))
        self.phases = [
            (need(a, "resource"), at(a, "start"), at(a, "end"), number(a.get("bound", "1")))
            for a in inside(element, "access")
        ]
        cut = {name for name, p, q, _ in self.phases if any(p < point < q for point in self.points)}
        if not cut <= locks or any(name in locks and bound != 1 for name, *_, bound in self.phases):
            raise UnreadableError("a phase has a split point inside, or a lock is taken by less than the whole")
        self.constraints = [Constraint(p) for p in inside(element, "precedence")]


class Constraint:
    def __init__(self, element: ET.Element) -> None:
        self.task, self.origin = need(element, "task"), element.get("from", "start")
        self.point, self.to = optional(element, "point") or 0, element.get("to", "start")
        self.least, self.most = duration(element.get("min", "0ns")), at(element, "max")
        self.is_cycle = element.get("match", "window") == "cycle"
        if self.to not in ("start", "end") or (self.origin == "point") != ("point" in element.attrib):
            raise UnreadableError(f"a constraint on {self.task!a} has no such instant")

    def gap(self, before: Job, job: Job) -> int:
        return (job.end if self.to == "end" else job.start) - before.instant(self.origin, self.point)


class Task:
    def __init__(self, element: ET.Element, binding: str, locks: set[str]) -> None:
        self.name, self.let = need(element, "name"), optional(element, "let")
        self.period = optional(element, "period") or 0  # 0: on demand
        if "period" in element.attrib and not self.period:
            raise UnreadableError(f"task {self.name!a} has the period 0")
        self.slack = number(element.get("slack", "0"))
        self.offset, self.distance = optional(element, "offset"), optional(element, "distance")
        given = "deadline" if "deadline" in element.attrib else "period" if self.distance is None else "distance"
        self.deadline = optional(element, given) or 0
        self.binding = element.get("binding", binding)
        if self.let is not None and not (self.period and 0 < self.let <= self.deadline):
            raise UnreadableError(f"task {self.name!a} has a logical execution time beyond its deadline")
        self.versions = {v.name: v for v in (Version(version, locks) for version in inside(element, "version"))}


class Model:
    def __init__(self, root: ET.Element, digest: str) -> None:
        self.name, self.digest = need(root, "name"), digest
        self.interrupts, self.modes = dict[str, list[tuple[int, int]]](), dict[str, dict[str, list[str]]]()
        for unit in inside(root, "platform", "unit"):
            found = [(at(i, "distance"), at(i, "wcet")) for i in inside(unit, "interrupt")]
            if any(distance == 0 for distance, _ in found):
                raise UnreadableError("an interrupt has the distance 0")
            self.interrupts[need(unit, "name")] = found
        binding = next(inside(root, "tasks"), root).get("binding", "job")
        locks = {need(r, "name") for r in inside(root, "platform", "resource") if r.get("kind") == "lock"}
        self.tasks = {t.name: t for t in (Task(element, binding, locks) for element in inside(root, "tasks", "task"))}
        self.chains = [Chain(c) for c in inside(root, "chains", "chain")]
        self.closed = {need(mode, "name") for mode in inside(root, "modes", "mode") if mode.get("edge") == "closed"}
        for mode in inside(root, "modes", "mode"):
            runs = inside(mode, "run")
            self.modes[need(mode, "name")] = {need(run, "task"): need(run, "versions").split() for run in runs}
        pairs = [(a, b) for a in self.modes for b in self.modes if a != b]
        self.switches: dict[tuple[str, str], int | None] = dict.fromkeys(pairs)
        if next(inside(root, "transitions"), None) is not None:
            listed = inside(root, "transitions", "transition")
            self.switches = {(need(t, "from"), need(t, "to")): optional(t, "max-length") for t in listed}
        for name, running in self.modes.items():
            for task, versions in running.items():
                if task not in self.tasks or not set(versions) <= set(self.tasks[task].versions):
                    raise UnreadableError(f"mode {name!a} runs what does not exist: {task!a}")
            self.in_first(running)
            self.refuse_ring(name)
        if any(c.origin == "release" and not self.tasks[c.tasks[0]].period for c in self.chains):
            raise UnreadableError("a chain counts from a release that its first task has not")

    def in_first(self, running: dict[str, list[str]]) -> set[str]:  # tasks whose phase lies in the first period
        named = {name for name in running if self.tasks[name].let is not None}
        for name in running:
            for row in (row for version in running[name] for row in self.tasks[name].versions[version].constraints):
                if row.task not in running:
                    continue
                other = self.tasks[row.task]
                lacks_release = not other.period and (row.is_cycle or row.origin == "release")
                shortest = min(other.versions[v].wcet for v in running[row.task])
                if lacks_release or (row.is_cycle and not self.tasks[name].period) or row.point > shortest:
                    raise UnreadableError(f"a constraint of {name!a} counts from an instant that is not there")
                named |= {name, row.task} if row.is_cycle else set()
        return named

    def before(self, mode: str, name: str) -> list[list[str]]:  # for each version, the tasks that it waits for
        versions = (self.tasks[name].versions[version] for version in self.modes[mode][name])
        return [[row.task for row in version.constraints] for version in versions]

    def refuse_ring(self, mode: str) -> None:
        try:
            TopologicalSorter({name: set().union(*self.before(mode, name)) for name in self.modes[mode]}).prepare()
        except CycleError:
            raise UnreadableError(f"the constraints of mode {mode!a} form a ring") from None

    def reserved(self, units: set[str], work: int) -> int | None:  # L(work); None where interrupts leave no room
        found = [pair for unit in sorted(units) for pair in self.interrupts.get(unit, ())]
        if sum(Fraction(c, distance) for distance, c in found) >= 1:
            return None
        length, shorter = work, -1
        while length != shorter:
            length, shorter = work + sum(up(length, distance) * c for distance, c in found), length
        return length


class Job:  # One job of the schedule; parts are (start, end, from, to).
    def __init__(self, element: ET.Element) -> None:
        self.version: Version
        self.task, self.index = need(element, "task"), int(need(element, "index"))
        self.start, self.end = at(element, "start"), at(element, "end")
        self.chosen = need(element, "version")
        self.unit_list = need(element, "units").split()
        self.units = set(self.unit_list)
        self.written = [(at(p, "start"), at(p, "end"), at(p, "from"), at(p, "to")) for p in inside(element, "part")]
        self.parts, self.where = self.written, ""
        self.model: Model
        self.let: int | None = None
        self.delay, self.lap = 0, 0  # since its release, which in a table is its start; a job of the cycle before

    def moved(self, by: int, where: str) -> Job:
        other = Job.__new__(Job)
        vars(other).update(vars(self), start=self.start + by, end=self.end + by, where=where)
        other.parts = [(start + by, end + by, begin, to) for start, end, begin, to in self.parts]
        return other

    def instant(self, origin: str, point: int = 0) -> int:
        for number, (start, _, begin, to) in enumerate(self.parts if origin == "point" else ()):
            if point <= to:
                return start + (
                    self.model.reserved(self.units, self.version.resume * (number > 0) + point - begin) or 0
                )
        release = self.start - self.delay
        if origin == "write" and self.let is not None:
            return release + self.let
        if origin in ("end", "write"):
            return self.end
        return release if origin == "release" or (origin == "read" and self.let is not None) else self.start


class Chain:
    def __init__(self, element: ET.Element) -> None:
        self.name, self.tasks = need(element, "name"), need(element, "tasks").split()
        self.origin, self.to = element.get("from", "read"), element.get("to", "write")
        self.limits = [optional(element, f"max-{what}") for what in ("latency", "reaction", "age")]
        is_back = (len(self.tasks), self.origin, self.to) == (1, "end", "start")
        if is_back or self.origin == "point" or self.to not in ("write", "start", "end"):
            raise UnreadableError(f"chain {self.name!a} has no such event")


class Order:  # The jobs of a task as they read, or write; with a cycle, they come again in each.
    def __init__(self, jobs: list[Job], what: str, cycle: int) -> None:
        names = ("write", "read", "release") if what == "write" else ("read",)  # the newest of equal ones is the last
        self.cycle = cycle

        def rank(step: Step) -> tuple[int, ...]:
            job, by = step
            return *(job.instant(name) + by for name in names), job.index

        self.steps = sorted(((job, -(job.instant(what) // cycle * cycle) if cycle else 0) for job in jobs), key=rank)
        self.instants = [job.instant(what) + by for job, by in self.steps]

    def near(self, instant: int, bisect: Callable[[list[int], int], int], before: int) -> Step | None:
        turn, rest = divmod(instant, self.cycle) if self.cycle else (0, instant)
        place = bisect(self.instants, rest) - before
        if not self.steps or (not self.cycle and not 0 <= place < len(self.steps)):
            return None
        job, by = self.steps[place % len(self.steps)]
        return job, by + (turn + place // len(self.steps)) * self.cycle


class Table:  # What modes and switches have in common: jobs that must be well formed and must not meet on a line.
    until: int | None = None  # Paths of chains count if they cross the time from 0 to this; in a mode, all do.

    def __init__(self, model: Model, name: str, total: int) -> None:
        self.model, self.name, self.total, self.jobs, self.findings = model, name, total, list[Job](), list[Finding]()

    def broken(self, rule: str, job: Job | str, what: str) -> None:
        task, index = (job.task, job.index) if isinstance(job, Job) else (job, "-")
        self.findings.append((rule, self.name, task, index, what))

    def take(self, job: Job, runs: dict[str, list[str]], where: str = "") -> None:  # keeps a job that runs
        if job.task not in runs or job.chosen not in runs[job.task]:
            self.broken("version", job, "the task does not run, or not in this version")
            return
        job.version, job.where = self.model.tasks[job.task].versions[job.chosen], where
        job.parts = job.written or [(job.start, job.end, 0, job.version.wcet)]
        job.model, job.let = self.model, self.model.tasks[job.task].let
        self.jobs.append(job)

    def units(self, job: Job) -> bool:
        valid = job.version.units & set(self.model.interrupts)
        is_gang = len(job.unit_list) == len(job.units) == job.version.gang and job.units <= valid
        if not is_gang:
            self.broken("unit", job, "not as many distinct, valid units as it takes")
        return is_gang

    def parts(self, job: Job) -> bool:
        before, version = len(self.findings), job.version
        first, last, gaps = job.parts[0], job.parts[-1], list(pairwise(job.parts))
        if not 0 <= job.start < self.total:
            self.broken("parts", job, "the start is not within the table")
        if (first[0], last[1], first[2], last[3]) != (job.start, job.end, 0, version.wcet):
            self.broken("parts", job, "the parts do not run from start to end and from 0 to the WCET")
        if any(one[3] != two[2] or not (version.anywhere or one[3] in version.points) for one, two in gaps):
            self.broken("parts", job, "not interrupted at a permitted point")
        if any(two[0] <= one[1] for one, two in gaps) or len(gaps) > version.max_gaps:
            self.broken("parts", job, "no gap between two parts, or too many")
        for number, (start, end, begin, to) in enumerate(job.parts):
            lost = version.resume if number else 0
            if begin >= to or end - start != self.model.reserved(job.units, lost + to - begin):
                self.broken("parts", job, f"part {number + 1} has the wrong length")
            elif gaps and version.anywhere and to - begin < version.min_part:
                self.broken("parts", job, f"part {number + 1} is too short")
        return len(self.findings) == before

    def late(self, task: Task, before: int, job: Job) -> None:
        distance = task.distance
        if distance is not None and (job.start - before > distance or job.end - before > task.deadline):
            self.broken("deadline", job, "an arrival just after the job before is missed or served too late")

    def bind(self, name: str, jobs: list[Job]) -> None:
        if self.model.tasks[name].binding != "job" and len({frozenset(job.units) for job in jobs}) > 1:
            self.broken("binding", name, "its jobs are on different units")

    def meet(self, line: list[Job]) -> None:
        """Of two jobs on a unit, one is over before the other begins or lies in a gap of it; so no parts overlap."""
        held: dict[str, list[Job]] = defaultdict(list)
        for job in sorted(line, key=lambda job: (job.start, job.end)):
            for unit in job.units:
                held[unit] = [other for other in held[unit] if other.end > job.start]
                for other in held[unit]:
                    if other.task == job.task or not any(
                        one[1] <= job.start and job.end <= two[0] for one, two in pairwise(other.parts)
                    ):
                        self.broken("nested", job, f"crosses {other.task} {other.index}")
                held[unit].append(job)

    def access(self, line: list[Job]) -> None:
        changes: dict[str, list[tuple[int, Fraction, Job]]] = defaultdict(list)
        for job in line:
            for resource, begin, to, bound in job.version.phases:
                # A lock is held from its first instant to its last, also in the gaps between.
                if resource not in job.version.locks and any(begin < part[3] < to for part in job.parts):
                    self.broken("access", job, f"a phase on {resource} is interrupted")
                for number, (start, _, origin, until) in enumerate(job.parts):
                    lost = start + (job.version.resume if number else 0) - origin
                    if origin <= begin < until:
                        changes[resource].append((lost + begin, bound, job))
                    if origin < to <= until:
                        over = self.model.reserved(job.units, lost + to - start) or 0
                        changes[resource].append((start + over, -bound, job))
        for resource, found in changes.items():
            level = Fraction()
            for _, change, job in sorted(found, key=lambda entry: entry[:2]):
                level += change
                if level > 1:
                    self.broken("access", job, f"{resource} is taken {level} times")
                    break

    def chain(self, chain: Chain, jobs: dict[str, list[Job]], cycle: int) -> Limits:
        """Return the worst latency, reaction and age of a chain; with a cycle, the jobs come again in each."""
        worst: Limits = []
        reads, writes = ({task: Order(jobs[task], what, cycle) for task in chain.tasks} for what in ("read", "write"))
        first, last = jobs[chain.tasks[0]], jobs[chain.tasks[-1]]
        ahead = (self.forward(chain, first, reads, is_missed) for is_missed in (False, True))
        figures = (*ahead, self.ages(chain, last, writes))
        for what, ends, limit in zip(("latency", "reaction", "age"), figures, chain.limits, strict=True):
            most = max(ends, default=None)
            worst.append(most)
            if most is not None and limit is not None and most > limit:
                self.broken("chain", chain.tasks[0], f"{chain.name}: the {what} is too long")
        return worst

    def counts(self, one: Step, two: Step) -> bool:
        return self.until is None or (one[0].start + one[1] < self.until and two[0].start + two[1] >= 0)

    def forward(self, chain: Chain, jobs: list[Job], reads: dict[str, Order], is_missed: bool) -> Iterator[int]:
        for job in jobs:
            # A stimulus just after this job read is seen by the next one.
            found = reads[job.task].near(job.instant("read"), bisect_right, 0) if is_missed else (job, 0)
            for task in chain.tasks[1:]:
                found = found and reads[task].near(found[0].instant("write") + found[1], bisect_left, 0)
            if found and self.counts((job, 0), found):
                yield found[0].instant(chain.to) + found[1] - job.instant(chain.origin)

    def ages(self, chain: Chain, jobs: list[Job], writes: dict[str, Order]) -> Iterator[int]:
        for last in jobs:
            found: Step | None = last, 0
            for task in reversed(chain.tasks[:-1]):
                found = found and writes[task].near(found[0].instant("read") + found[1], bisect_right, 1)
            if found and self.counts(found, (last, 0)):
                yield last.instant(chain.to) - found[0].instant(chain.origin) - found[1]


class Mode(Table):  # The steady state of one mode; findings are (rule, mode, task, job, what).
    def __init__(self, model: Model, name: str, jobs: list[Job]) -> None:
        super().__init__(model, name, 0)
        self.runs = model.modes[name]
        self.first = model.in_first(self.runs)
        self.total, self.counted, self.figures = self.hyperperiod(), dict[str, int](), dict[str, Limits]()
        self.bound: dict[str, list[Job]] = defaultdict(list)
        for job in jobs:
            self.take(job, self.runs)
        for job in self.jobs:
            self.bound[job.task].append(job)

    def hyperperiod(self) -> int:
        periods = [p for p in (self.model.tasks[name].period for name in self.runs) if p]
        if not periods:
            raise UnreadableError(f"no task of mode {self.name!a} has a period")
        total = lcm(*periods)
        if sum(total // p for p in periods) > MOST_JOBS:
            raise UnreadableError(f"mode {self.name!a} has too many jobs")
        return total

    def check(self) -> list[Finding]:
        self.complete()
        sound = [job for job in self.jobs if self.units(job) and self.parts(job)]
        for name in self.runs:
            self.periodic(name)
            self.bind(name, self.bound[name])
        line = self.line(sound)
        self.meet(line)
        self.access(line)
        for job in self.jobs:
            self.precedence(job)
            if self.name in self.model.closed and job.end > self.total:
                self.broken("edge", job, "in progress at the end of the table")
        for chain in self.model.chains:
            if all(task in self.runs for task in chain.tasks):
                self.latencies(chain)
        return self.findings

    def line(self, jobs: list[Job]) -> list[Job]:
        # A job that is longer than a cycle meets itself in the next one.
        return [job.moved(turn * self.total, f"cycle {turn}") for turn in range(-2, 2) for job in jobs]

    def most_demands(self, by: str, name: str) -> int:  # constraints on it of one version
        return max((before.count(name) for before in self.model.before(self.name, by)), default=0)

    def count(self, name: str) -> int:
        if self.model.tasks[name].period:
            return self.total // self.model.tasks[name].period
        if name not in self.counted:
            demanding = [by for by in self.runs if self.most_demands(by, name)]
            self.counted[name] = sum(self.most_demands(by, name) * self.count(by) for by in demanding)
        return self.counted[name]

    def expected(self, name: str) -> set[int]:
        if self.model.tasks[name].period:
            return set(range(self.count(name)))
        arising, base = set[int](), 0
        for by in self.model.tasks:
            most = self.most_demands(by, name) if by in self.runs else 0
            for job in self.bound[by]:
                slots = sum(row.task == name for row in job.version.constraints)
                arising |= set(range(base + job.index * most, base + job.index * most + slots))
            base += most * self.count(by) if most else 0
        return arising

    def complete(self) -> None:
        for name in self.runs:
            expected, indices = self.expected(name), [job.index for job in self.bound[name]]
            if sorted(indices) != sorted(expected):
                missing, more = sorted(expected - set(indices))[:5], sorted(set(indices) - expected)[:5]
                self.broken("complete", name, f"jobs {missing} are missing, jobs {more} not demanded, or one is double")

    def periodic(self, name: str) -> None:
        task, jobs = self.model.tasks[name], self.bound[name]
        ordered = sorted(jobs, key=lambda job: (job.start, job.index))
        for number, job in enumerate(ordered):
            self.late(task, ordered[number - 1].start - (0 if number else self.total), job)
        if not task.period:
            return  # it has no releases
        places = [(job, (job.start - job.index * task.period) % self.total) for job in jobs]
        phases = {place for _, place in places} if task.offset is None else {task.offset % task.period}
        verdicts = [(phase, self.delays(task, places, phase)) for phase in sorted(phases)]
        phase, verdict = min(verdicts, key=lambda pair: len(pair[1]), default=(0, []))
        self.findings += [(rule, self.name, name, job.index, what) for rule, job, what in verdict]
        for job, place in places:
            is_before = job.start < job.index * task.period + (task.offset or 0) % task.period
            job.delay, job.lap = (place - phase) % self.total, self.total * is_before
        if name in self.first and phase >= task.period:
            # An earlier phase may do as well; data are read at the latest one.
            most, sooner = task.slack * task.period, phase - task.period
            rooms = [(job.delay, task.deadline - job.end + job.start) for job in jobs]
            if task.let or any(sooner + delay >= min(most, Fraction(room)) for delay, room in rooms):
                self.broken("periodic", name, "its first release is not in the first period")

    def delays(self, task: Task, places: list[tuple[Job, int]], phase: int) -> list[tuple[str, Job, str]]:
        found = []
        for job, place in places:
            delta = (place - phase) % self.total
            if delta > task.slack * task.period:
                found.append(("periodic", job, "too long after its release"))
            if delta + job.end - job.start > (task.let or task.deadline):
                found.append(("deadline", job, "ends too long after its release"))
        return found

    def precedence(self, job: Job) -> None:
        for row in job.version.constraints:
            others = self.bound[row.task]
            if row.is_cycle:
                periods = self.model.tasks[job.task].period, self.model.tasks[row.task].period
                same = [other for other in others if other.index == job.index * periods[0] // periods[1]]
                ages = [row.gap(other, job) + job.lap - other.lap for other in same]
            else:
                near = (row.gap(other, job) for other in others)
                ages = [age + up(row.least - age, self.total) * self.total for age in near]
            if not any(row.least <= age <= row.most for age in ages):
                self.broken("precedence", job, f"no job of {row.task} lies within the window")

    def latencies(self, chain: Chain) -> None:
        if chain.limits != [None] * 3 and not all(self.bound[task] for task in chain.tasks):
            self.broken("chain", chain.tasks[0], f"{chain.name}: a task has no job")
        worst = self.chain(chain, self.bound, self.total)
        given = self.figures.get(chain.name, worst)
        if given[1:] != worst[1:] or given[0] not in (None, worst[0]):
            self.broken("figures", chain.tasks[0], f"{chain.name}: a reported latency is wrong")


# The line of one switch: cycles of the mode before up to 0, the table on [0, length), the mode to come.
class Switch(Table):
    def __init__(self, source: Mode, target: Mode, length: int, longest: int | None, jobs: list[Job]) -> None:
        super().__init__(source.model, f"{source.name} -> {target.name}", length)
        self.source, self.target, self.until, self.longest = source, target, length, longest
        for job in jobs:
            self.take(job, target.runs, "table")
        if len({(job.task, job.index) for job in jobs}) < len(jobs):
            self.broken("length", "-", "a job is given twice")

    def line(self, before: int, after: int, tasks: list[str] | None = None) -> list[Job]:
        everyone = (self.source.jobs, self.target.jobs, self.jobs)
        old, new, own = ([job for job in jobs if tasks is None or job.task in tasks] for jobs in everyone)
        if before * len(old) + after * len(new) > MOST_JOBS:
            raise UnreadableError("a switch has too many jobs in reach")
        line = [job.moved(-turn * self.source.total, "before") for turn in range(1, before + 1) for job in old]
        line += [job.moved(self.total + turn * self.target.total, "after") for turn in range(after) for job in new]
        return line + own

    def check(self) -> list[Finding]:
        if self.longest is not None and self.total > self.longest:
            self.broken("length", "-", "longer than the model allows")
        sound = [job for job in self.jobs if self.units(job) and self.parts(job)]
        if len(sound) < len(self.jobs) or self.source.findings or self.target.findings:
            return self.findings  # the faults are reported; places on the line would not mean anything
        last = max((job.end for job in self.line(2, 0)), default=0)
        near = self.line(2, max(2, up(last - self.total, self.target.total)))
        self.meet(near)
        self.access(near)
        for job in self.line(2, 0):
            if job.end > self.total and self.target.name in self.model.closed:
                self.broken("edge", job, "in progress where the mode to come begins from idle")
            if job.let and job.end - job.start > job.let:
                self.broken("edge", job, "lasts longer than its logical execution time")
        for name in dict.fromkeys(job.task for job in self.jobs):
            self.bind(name, [job for job in [*self.jobs, *self.target.jobs] if job.task == name])
        self.continuity()
        self.entering()
        self.precedence()
        for chain in self.model.chains:
            tasks = chain.tasks
            if any(chain.limits) and all(task in self.source.runs and task in self.target.runs for task in tasks):
                lets = sum(self.model.tasks[task].let or 0 for task in tasks)
                before, after = (4 * len(tasks) + 2 + up(lets, mode.total) for mode in (self.source, self.target))
                line = self.line(before, after, tasks)
                self.chain(chain, {task: [job for job in line if job.task == task] for task in tasks}, 0)
        return self.findings

    def continuity(self) -> None:
        line = sorted(self.line(2, 2), key=lambda job: (job.start, job.index))
        for task in (self.model.tasks[name] for name in self.source.runs if name in self.target.runs):
            own = [job for job in line if job.task == task.name]
            for number, two in enumerate(own):
                for one in (one for one in own[:number] if not one.where == two.where != "table"):
                    if one.end > two.start:
                        self.broken("continuity", two, "starts before one from before has ended")
                    if one is own[number - 1]:
                        self.late(task, one.start, two)
                        if task.period and two.start - one.start > (1 + task.slack) * task.period:
                            self.broken("continuity", two, "starts too long after the job before")

    def wants(self, cycles: int) -> list[tuple[Job, Constraint]]:
        return [(job, constraint) for job in self.line(0, cycles) for constraint in job.version.constraints]

    def entering(self) -> None:
        wants, cycle = self.wants(1), self.target.total
        for job in (job for job in self.jobs if job.task not in self.source.runs):
            for other, row in wants:
                gap = row.gap(job, other)
                gap += max(0, (row.most - gap) // cycle) * cycle if other.where == "after" else 0
                if row.task == job.task and row.least <= gap <= row.most:
                    break
            else:
                self.broken("entering", job, "no constraint needs it so early")

    def precedence(self) -> None:
        """Check windows in cycles up to those whose predecessors all lie in the mode to come.

        Where the job of its cycle lies in a window, so does the nearest one.
        """
        kinds: dict[str, set[tuple[str, int]]] = defaultdict(set)
        for _, row in self.wants(1):
            kinds[row.task].add((row.origin, row.point))
        furthest = max((row.most for _, row in self.wants(1)), default=0)
        before = 3 + up(furthest, self.source.total)
        after = 3 + up(furthest, self.target.total)
        found: dict[tuple[str, str, int], list[int]] = defaultdict(list)
        for job in self.line(before, after + 2):
            for kind in kinds[job.task]:
                found[job.task, *kind].append(job.instant(*kind))
        for instants in found.values():
            instants.sort()
        for job, row in self.wants(after):
            instants, own = found[row.task, row.origin, row.point], job.end if row.to == "end" else job.start
            place = bisect_right(instants, own - row.least)
            if not place or instants[place - 1] < own - row.most:
                self.broken("precedence", job, f"no job of {row.task} lies within the window")


def judge(model_path: str, schedule_path: str) -> list[Finding]:  # what is broken: (rule, mode, task, job, what)
    (system, digest), (root, _) = root_of(model_path, "task-model"), root_of(schedule_path, "schedule")
    fit(system, root)
    model = Model(system, digest)
    findings, tables, switches = list[Finding](), dict[str, Mode](), dict[tuple[str, str], Switch]()
    bound: dict[str, set[frozenset[str]]] = defaultdict(set)
    if root.get("model") != model.name or root.get("model-sha256", model.digest) not in ("", model.digest):
        findings.append(("figures", "-", "-", "-", "the schedule was made for another model"))
    for element in inside(root, "mode"):
        name = need(element, "name")
        if name in tables or name not in model.modes:
            raise UnreadableError("a mode has two schedules, or is not of the model")
        tables[name] = mode = Mode(model, name, [Job(job) for job in inside(element, "job")])
        for chain in inside(element, "chain"):
            mode.figures[need(chain, "name")] = [optional(chain, what) for what in ("latency", "reaction", "age")]
        findings += mode.check()
        if at(element, "hyperperiod") != mode.total or element.get("status") != "valid":
            findings.append(("figures", name, "-", "-", "not called valid, or the hyperperiod is another"))
    findings += [("complete", name, "-", "-", "the mode has no schedule") for name in model.modes if name not in tables]
    for element in inside(root, "transition"):
        pair = need(element, "from"), need(element, "to")
        if pair in switches or pair not in model.switches or not set(pair) <= set(tables):
            raise UnreadableError("a switch is given twice, is not allowed, or has no mode")
        jobs = [Job(job) for job in inside(element, "job")]
        if not jobs and element.get("status") != "valid":
            continue  # it must not be performed
        source, target, length = tables[pair[0]], tables[pair[1]], at(element, "length")
        switches[pair] = switch = Switch(source, target, length, model.switches[pair], jobs)
        findings += switch.check()
        if at(element, "worst-latency") != source.total + length:
            findings.append(("figures", switch.name, "-", "-", "the worst latency is hyperperiod and length"))
    for table in (*tables.values(), *switches.values()):
        for job in table.jobs:
            bound[job.task].add(frozenset(job.units))
    for task in model.tasks.values():
        if task.binding == "system" and len(bound[task.name]) > 1:
            findings.append(("binding", "-", task.name, "-", "its jobs of the system are on different units"))
    return findings


def main() -> int:
    if len(sys.argv) != 3:
        print(__doc__, file=sys.stderr)
        return 2
    try:
        findings = judge(*sys.argv[1:])
    except (UnreadableError, OSError, ValueError, ET.ParseError, RecursionError) as error:
        print(f"cannot read: {str(error)!a}", file=sys.stderr)
        return 2
    for rule, mode, task, job, what in findings:
        print(ascii(f"{rule}: mode {mode}, task {task}, job {job}: {what}")[1:-1])
    print("not valid" if findings else "valid")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
