"""A second checker of schedules, independent of halpipe: it needs nothing but Python.

    python docs/safety/second_checker.py MODEL.xml SCHEDULE.xml

It decides the steady state of every mode, with split jobs, interrupts, bindings and sporadic arrivals, from
the page that says what "valid" means. It does not judge switches between modes, and says so. Times are exact.
Of a task without period it counts the
jobs; the page does not say which number belongs to which demand.
One line per broken rule; exit code 0: valid, 1: not valid, 2: cannot read.
"""

import argparse
import re
import sys
import xml.etree.ElementTree as ET
from collections import defaultdict
from fractions import Fraction
from itertools import pairwise
from math import ceil, floor, gcd, lcm

MODEL_SPACE = "{urn:halpipe:task-model:1}"
SCHEDULE_SPACE = "{urn:halpipe:schedule:1}"
SCALE = {"ns": 1, "us": 1000, "ms": 1000**2, "s": 1000**3}
LARGEST_FILE = 64 * 1024 * 1024
MOST_JOBS = 1_000_000


class UnreadableError(Exception):
    """The files do not hold a model and a schedule."""


def number(text):
    found = re.fullmatch(r"[0-9]{1,1000}(\.[0-9]{1,1000}|/0*[1-9][0-9]{0,999})?", text.strip())
    if not found:
        raise UnreadableError(f"{text[:60]!a} is not a number")
    return Fraction(text.strip())


def duration(text):
    """Return nanoseconds."""
    found = re.fullmatch(r"\s*([0-9./]+)(ns|us|ms|s)\s*", text)
    if not found:
        raise UnreadableError(f"{text[:60]!a} is not a duration")
    return number(found[1]) * SCALE[found[2]]


def optional(element, name, default=None):
    return duration(element.get(name)) if element.get(name) is not None else default


def need(element, name):
    if element.get(name) is None:
        raise UnreadableError(f"{element.tag} has no {name}")
    return element.get(name)


def root_of(path, tag):
    with open(path, "rb") as file:
        data = file.read(LARGEST_FILE + 1)
    if len(data) > LARGEST_FILE:
        raise UnreadableError(f"{path} is too large")
    # Another encoding could hide a declaration from the scan.
    if b"\0" in data or b"<!DOCTYPE" in data or b"<!ENTITY" in data:
        raise UnreadableError(f"{path} has a document type or is not UTF-8")
    data.decode("utf-8")
    declared = re.match(rb"\s*<\?xml[^>]*encoding\s*=\s*[\"']([^\"']*)", data.removeprefix(b"\xef\xbb\xbf"))
    if declared and declared[1].lower() not in (b"utf-8", b"us-ascii"):
        raise UnreadableError(f"{path} is not UTF-8")
    root = ET.fromstring(data)
    if root.tag != tag:
        raise UnreadableError(f"{path} is not a {tag}")
    return root


class Version:
    def __init__(self, element):
        self.name = need(element, "name")
        self.wcet = duration(need(element, "wcet"))
        split = element.get("split", "none").split()
        self.anywhere = split == ["anywhere"]
        self.points = set() if split in (["none"], ["anywhere"]) else {duration(point) for point in split}
        self.resume = optional(element, "resume", Fraction(0))
        gaps = element.get("max-gaps")
        self.max_gaps = None if gaps is None else int(gaps)
        self.min_part = optional(element, "min-part", Fraction(0))
        units = element.find(MODEL_SPACE + "units")
        if units is None:
            raise UnreadableError(f"version {self.name!a} has no units")
        self.units = set(need(units, "names").split())
        self.gang = int(units.get("gang", "1"))
        self.phases = [
            (need(a, "resource"), duration(need(a, "start")), duration(need(a, "end")), number(a.get("bound", "1")))
            for a in element.iterfind(MODEL_SPACE + "access")
        ]
        self.constraints = [
            (need(p, "task"), p.get("from", "start"), optional(p, "min", Fraction(0)), duration(need(p, "max")))
            for p in element.iterfind(MODEL_SPACE + "precedence")
        ]

    def may_split(self, at):
        if self.anywhere:
            return 0 < at < self.wcet and not any(p < at < q for _, p, q, _ in self.phases)
        return at in self.points


class Task:
    def __init__(self, element, binding):
        self.name = need(element, "name")
        self.period = optional(element, "period")
        if self.period == 0:
            raise UnreadableError(f"task {self.name!a} has the period 0")
        self.slack = number(element.get("slack", "0"))
        self.offset = optional(element, "offset")
        self.distance = optional(element, "distance")
        self.deadline = optional(element, "deadline", self.period if self.distance is None else self.distance)
        self.binding = element.get("binding", binding)
        self.versions = {v.name: v for v in map(Version, element.iterfind(MODEL_SPACE + "version"))}


class Model:
    def __init__(self, path):
        root = root_of(path, MODEL_SPACE + "task-model")
        self.interrupts = {
            need(unit, "name"): [
                (duration(need(i, "distance")), duration(need(i, "wcet")))
                for i in unit.iterfind(MODEL_SPACE + "interrupt")
            ]
            for unit in root.iterfind(f"{MODEL_SPACE}platform/{MODEL_SPACE}unit")
        }
        if any(distance == 0 for found in self.interrupts.values() for distance, _ in found):
            raise UnreadableError("an interrupt has the distance 0")
        tasks = root.find(MODEL_SPACE + "tasks")
        if tasks is None:
            raise UnreadableError("the model has no tasks")
        binding = tasks.get("binding", "job")
        self.tasks = {t.name: t for t in (Task(e, binding) for e in tasks.iterfind(MODEL_SPACE + "task"))}
        self.chains = [
            (need(c, "name"), need(c, "tasks").split(), optional(c, "max-reaction"), optional(c, "max-age"))
            for c in root.iterfind(f"{MODEL_SPACE}chains/{MODEL_SPACE}chain")
        ]
        self.modes = {
            need(mode, "name"): {
                need(run, "task"): need(run, "versions").split() for run in mode.iterfind(MODEL_SPACE + "run")
            }
            for mode in root.iterfind(f"{MODEL_SPACE}modes/{MODEL_SPACE}mode")
        }
        for mode, runs in self.modes.items():
            for task, versions in runs.items():
                if task not in self.tasks or not set(versions) <= set(self.tasks[task].versions):
                    raise UnreadableError(f"mode {mode!a} runs what does not exist: {task!a}")

    def reserved(self, units, work):
        """Return L(work), or None where interrupts leave no room."""
        found = [pair for unit in sorted(units) for pair in self.interrupts[unit]]
        if sum((c / distance for distance, c in found), Fraction(0)) >= 1:
            return None
        length = work
        while True:
            longer = work + sum(ceil(length / distance) * c for distance, c in found)
            if longer == length:
                return length
            length = longer


class Job:
    """One job of the schedule; parts are (start, end, from, to)."""

    def __init__(self, element):
        self.task, self.index = need(element, "task"), int(need(element, "index"))
        self.start, self.end = duration(need(element, "start")), duration(need(element, "end"))
        self.chosen = need(element, "version")
        self.unit_list = need(element, "units").split()
        self.units = set(self.unit_list)
        self.written = [
            tuple(duration(need(part, name)) for name in ("start", "end", "from", "to"))
            for part in element.iterfind(SCHEDULE_SPACE + "part")
        ]
        self.version, self.parts = None, []

    def bind(self, version):
        self.version = version
        self.parts = self.written or [(self.start, self.end, Fraction(0), version.wcet)]

    def lost(self, number):
        return self.version.resume if number else Fraction(0)


class Mode:
    """The steady state of one mode; findings are (rule, mode, task, job, what)."""

    def __init__(self, model, name, jobs):
        self.model, self.name, self.runs, self.findings = model, name, model.modes[name], []
        self.total = self.hyperperiod()
        self.jobs, self.of = [], defaultdict(list)
        for job in jobs:
            task = model.tasks.get(job.task)
            if job.task not in self.runs:
                self.broken("complete", job, "the task does not run in this mode")
            elif job.chosen not in self.runs[job.task]:
                self.broken("version", job, f"version {job.chosen!a} is not available")
            else:
                job.bind(task.versions[job.chosen])
                self.jobs.append(job)
            self.of[job.task].append(job)
        self.bound = defaultdict(list)
        for job in self.jobs:
            self.bound[job.task].append(job)

    def broken(self, rule, job, what):
        task, index = (job.task, job.index) if isinstance(job, Job) else (job, "-")
        self.findings.append((rule, self.name, task, index, what))

    def hyperperiod(self):
        periods = [p for p in (self.model.tasks[name].period for name in self.runs) if p is not None]
        if not periods:
            return None
        total = Fraction(lcm(*(p.numerator for p in periods)), gcd(*(p.denominator for p in periods)))
        if sum(total / p for p in periods) > MOST_JOBS:
            raise UnreadableError(f"mode {self.name!a} has too many jobs")
        return total

    def check(self):
        if self.total is None:
            for job in self.jobs:
                self.broken("complete", job, "no task of the mode has a period")
            return self.findings
        self.complete()
        sound = [job for job in self.jobs if self.units(job) and self.parts(job)]
        for name in self.runs:
            self.periodic(name)
            self.binding(name)
        self.exclusive(sound)
        self.nested(sound)
        self.access(sound)
        for job in self.jobs:
            self.precedence(job)
        for chain in self.model.chains:
            self.chain(*chain)
        return self.findings

    def demands(self, name):
        """Return how many jobs a task without period has under the chosen versions."""
        return sum(1 for job in self.jobs for to, *_ in job.version.constraints if to == name and job.task != name)

    def complete(self):
        for name in self.runs:
            period = self.model.tasks[name].period
            expected = self.demands(name) if period is None else int(self.total / period)
            indices = [job.index for job in self.of[name]]
            if len(indices) != expected:
                self.broken("complete", name, f"{len(indices)} jobs instead of {expected}")
            elif len(set(indices)) != len(indices):
                self.broken("complete", name, "two jobs have the same index")
            elif period is not None and set(indices) != set(range(expected)):
                self.broken("complete", name, f"the jobs are not numbered 0 to {expected - 1}")

    def units(self, job):
        version = job.version
        if len(job.unit_list) != len(job.units) or len(job.units) != version.gang:
            self.broken("unit", job, f"{len(job.units)} units instead of {version.gang}")
        elif not job.units <= version.units or not job.units <= set(self.model.interrupts):
            self.broken("unit", job, "a unit is not valid for the version")
        elif self.model.reserved(job.units, Fraction(0)) is None:
            self.broken("unit", job, "the interrupts leave no time")
        else:
            return True
        return False

    def parts(self, job):
        before, version = len(self.findings), job.version
        if not 0 <= job.start < self.total:
            self.broken("parts", job, "the start is not within the hyperperiod")
        first, last = job.parts[0], job.parts[-1]
        if (first[0], last[1], first[2], last[3]) != (job.start, job.end, 0, version.wcet):
            self.broken("parts", job, "the parts do not run from start to end and from 0 to the WCET")
        for one, two in pairwise(job.parts):
            if one[3] != two[2] or not version.may_split(one[3]):
                self.broken("parts", job, f"not interrupted at a permitted point: {one[3]} ns")
            if not two[0] > one[1]:
                self.broken("parts", job, "no gap between two parts")
        if version.max_gaps is not None and len(job.parts) - 1 > version.max_gaps:
            self.broken("parts", job, "too many gaps")
        for number, (start, end, begin, to) in enumerate(job.parts):
            if not begin < to:
                self.broken("parts", job, "a part executes nothing")
            elif end - start != self.model.reserved(job.units, job.lost(number) + to - begin):
                self.broken("parts", job, f"part {number + 1} has the wrong length")
            elif len(job.parts) > 1 and version.anywhere and to - begin < version.min_part:
                self.broken("parts", job, f"part {number + 1} is too short")
        return len(self.findings) == before

    def periodic(self, name):
        task, jobs = self.model.tasks[name], self.bound[name]
        if task.distance is not None:
            self.arrivals(task, jobs)
        if task.period is None:
            for job in jobs:
                if task.deadline is not None and job.end - job.start > task.deadline:
                    self.broken("deadline", job, "longer than its deadline")
            return
        places = [(job, (job.start - job.index * task.period) % self.total) for job in jobs]
        phases = {at for _, at in places} if task.offset is None else {task.offset % task.period}
        verdicts = [self.delays(task, places, phase) for phase in sorted(phases)]
        for rule, job, what in min(verdicts, key=len, default=[]):
            self.broken(rule, job, what)

    def delays(self, task, places, phase):
        found = []
        for job, at in places:
            delta = (at - phase) % self.total
            if delta > task.slack * task.period:
                found.append(("periodic", job, f"{delta} ns after its release"))
            if task.distance is None and delta + job.end - job.start > task.deadline:
                found.append(("deadline", job, f"ends {delta + job.end - job.start} ns after its release"))
        return found

    def arrivals(self, task, jobs):
        ordered = sorted(jobs, key=lambda job: (job.start, job.index))
        for number, job in enumerate(ordered):
            before = ordered[number - 1].start - (0 if number else self.total)
            if job.start - before > task.distance:
                self.broken("deadline", job, "an arrival could be missed: the start before is too long ago")
            if job.end - before > task.deadline:
                self.broken("deadline", job, f"an arrival is served after {job.end - before} ns")

    def binding(self, name):
        if self.model.tasks[name].binding != "job" and len({frozenset(j.units) for j in self.bound[name]}) > 1:
            self.broken("binding", name, "its jobs of the mode are on different units")

    def folded(self, start, end):
        """Return how often an interval covers the whole circle, and the rest in [0, hyperperiod)."""
        whole, rest = divmod(end - start, self.total)
        at = start % self.total
        if at + rest <= self.total:
            return whole, [(at, at + rest)] if rest else []
        return whole, [(at, self.total), (Fraction(0), at + rest - self.total)]

    def exclusive(self, jobs):
        taken = defaultdict(list)
        for job in jobs:
            for start, end, *_ in job.parts:
                whole, rest = self.folded(start, end)
                for unit in job.units:
                    spans = rest + [(Fraction(0), self.total)] * int(min(whole, 2))
                    taken[unit] += [(*span, job.task, job.index, job) for span in spans]
        for unit, spans in taken.items():
            spans.sort(key=lambda span: span[:4])
            reach, owner = Fraction(0), None
            for start, end, *_, job in spans:
                if start < reach:
                    self.broken("exclusive", job, f"overlaps {owner.task} {owner.index} on {unit}")
                if end > reach:
                    reach, owner = end, job

    def nested(self, jobs):
        sharing = defaultdict(list)
        for number, job in enumerate(jobs):
            for unit in job.units:
                sharing[unit].append(number)
        pairs = {(a, b) for group in sharing.values() for a in group for b in group if a <= b}
        for a, b in sorted(pairs):
            self.nested_pair(jobs[a], jobs[b])

    def nested_pair(self, one, two):
        first, last = floor((one.start - two.end) / self.total), ceil((one.end - two.start) / self.total)
        for turns in range(first, last + 1):
            shift = turns * self.total
            start, end = two.start + shift, two.end + shift
            if (one is two and turns == 0) or start >= one.end or one.start >= end:
                continue
            inside = in_gap(one.parts, start, end) or in_gap(two.parts, one.start - shift, one.end - shift)
            if one.task == two.task or not inside:
                self.broken("nested", one, f"crosses {two.task} {two.index}")
                return

    def access(self, jobs):
        changes, always = defaultdict(list), defaultdict(Fraction)
        for job in jobs:
            for resource, begin, to, bound in job.version.phases:
                holds = [(n, p) for n, p in enumerate(job.parts) if p[2] <= begin and to <= p[3]]
                if not holds:
                    self.broken("access", job, f"a phase on {resource} is interrupted")
                    continue
                number, (start, _, origin, _) = holds[0]
                lost = job.lost(number)
                over = self.model.reserved(job.units, lost + to - origin)
                whole, rest = self.folded(start + lost + begin - origin, start + over)
                always[resource] += whole * bound
                changes[resource] += [(0, Fraction(0), job)] if whole else []
                for at, until in rest:
                    changes[resource] += [(at, bound, job), (until, -bound, job)]
        for resource, found in changes.items():
            level = always[resource]
            for at, change, job in sorted(found, key=lambda entry: entry[:2]):
                level += change
                if level > 1 and change >= 0:
                    self.broken("access", job, f"{resource} is taken {level} times at {at} ns")
                    break

    def precedence(self, job):
        for name, origin, least, most in job.version.constraints:
            for other in self.bound[name]:
                since = job.start - (other.end if origin == "end" else other.start)
                turns = max(0, ceil((least - since) / self.total))
                if least <= since + turns * self.total <= most:
                    break
            else:
                self.broken("precedence", job, f"no job of {name} starts or ends within the window")

    def chain(self, name, tasks, max_reaction, max_age):
        if any(task not in self.runs for task in tasks) or (max_reaction is None and max_age is None):
            return
        lines = [sorted(self.bound[task], key=lambda job: (job.start, job.end)) for task in tasks]
        if not all(lines):
            self.broken("chain", tasks[0], f"{name}: a task has no job")
            return
        reaction = max(self.reaction(lines, number) for number in range(len(lines[0])))
        age = max(self.age(lines, job) for job in lines[-1])
        if max_reaction is not None and reaction > max_reaction:
            self.broken("chain", tasks[0], f"{name}: reaction {reaction} ns")
        if max_age is not None and age > max_age:
            self.broken("chain", tasks[-1], f"{name}: age {age} ns")

    def reaction(self, lines, number):
        begun, after = lines[0][number].start, (number + 1) % len(lines[0])
        end = lines[0][after].end + (0 if after > number else self.total)
        for line in lines[1:]:
            start, length = min((job.start + ceil((end - job.start) / self.total) * self.total, job.end - job.start)
                                for job in line)  # fmt: skip
            end = start + length
        return end - begun

    def age(self, lines, job):
        start = job.start
        for line in reversed(lines[:-1]):
            start = max(one.start + floor((start - one.end) / self.total) * self.total for one in line)
        return job.end - start


def in_gap(parts, start, end):
    return any(one[1] <= start and end <= two[0] for one, two in pairwise(parts))


def judge(model_path, schedule_path):
    """Return the findings and whether switches were left out."""
    model = Model(model_path)
    root = root_of(schedule_path, SCHEDULE_SPACE + "schedule")
    modes, findings, bound = {}, [], defaultdict(set)
    for element in root.iterfind(SCHEDULE_SPACE + "mode"):
        if need(element, "name") in modes:
            raise UnreadableError("a mode has two schedules")
        modes[element.get("name")] = [Job(job) for job in element.iterfind(SCHEDULE_SPACE + "job")]
    for name in modes.keys() - model.modes.keys():
        findings.append(("complete", name, "-", "-", "the model has no such mode"))
    for name in model.modes:
        if name not in modes:
            findings.append(("complete", name, "-", "-", "the mode has no schedule"))
            continue
        findings += Mode(model, name, modes[name]).check()
        for job in modes[name]:
            bound[job.task].add(frozenset(job.units))
    for task in model.tasks.values():
        if task.binding == "system" and len(bound[task.name]) > 1:
            findings.append(("binding", "-", task.name, "-", "its jobs of the system are on different units"))
    switches = root.find(SCHEDULE_SPACE + "transition") is not None or len(model.modes) > 1
    return findings, switches


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("model")
    parser.add_argument("schedule")
    options = parser.parse_args()
    try:
        findings, switches = judge(options.model, options.schedule)
    except (UnreadableError, OSError, ValueError, ET.ParseError, RecursionError) as error:
        print(f"cannot read: {str(error)!a}", file=sys.stderr)
        return 2
    for rule, mode, task, job, what in findings:
        print(ascii(f"{rule}: mode {mode}, task {task}, job {job}: {what}")[1:-1])
    if switches:
        print("not judged: switches between modes")
    print("not valid" if findings else "valid")
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
