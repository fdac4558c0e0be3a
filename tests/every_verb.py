"""Valid systems through every verb: random models over all pairs of features, and the answers that must agree.

Usage: every_verb.py [SYSTEMS] [SEED] [--every N]. Each system has the two features of one pair and two more, and meets
validate, schedule, both checkers, explain, diff, the native export and its import through the Python API; every N-th
(50) meets the command of every verb. Each system with an internal error or two answers that disagree gets a line, its
files are kept, and the exit code is 1.
"""

from __future__ import annotations

import argparse
import random
import shutil
import sys
import tempfile
import traceback
from collections import Counter
from dataclasses import replace
from fractions import Fraction
from functools import partial
from itertools import combinations
from pathlib import Path

import halpipe
from command_line import run_here
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.native import format_model, format_schedule
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.models import (
    Access,
    Anchor,
    Binding,
    Chain,
    Edge,
    HealthAction,
    HealthEvent,
    HealthRule,
    Interrupt,
    Match,
    Mode,
    Precedence,
    Resource,
    ResourceKind,
    Run,
    Split,
    Task,
    TaskModel,
    Transition,
    Unit,
    Version,
)
from halpipe.pipeline.explain.witnesses import find_witnesses
from halpipe.selftest import second

FOUND, NOT_FOUND, INFEASIBLE = 0, 3, 4
UNITS = ("u0", "u1", "u2")
PERIOD = 12
"""Ticks of the longest period of most systems; a tick is drawn for each."""

LOT = 1000
"""Systems between two lines of progress."""

EXPLAINED = 0.25
"""Of the systems without a proof, those that meet the search of explain; its proofs meet all."""

PLAYED = 0.05
"""Of the bundles for Linux, those that are compiled and played."""


class Draft:
    """A system in the making: tasks by name, and what the features need to know of it."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.unit = Duration(Fraction(rng.choice((1_000_000, 1_000_000, 250_000, Fraction(10**6, 7)))))
        self.units = [Unit(name=name) for name in UNITS[: rng.randint(1, 3)]]
        self.resources = [Resource(name="r"), Resource(name="l", kind=ResourceKind.LOCK)]
        self.tasks: dict[str, Task] = {}
        self.chains: list[Chain] = []
        self.modes = [("m", {}, Edge.OPEN)]
        self.transitions: list[Transition] = []
        self.health: list[HealthRule] = []
        for number in range(rng.randint(2, 3)):
            name = f"t{number}"
            period = rng.choice((PERIOD, PERIOD, PERIOD // 2, 2 * PERIOD))
            version = Version(name="v", wcet=self.ticks(rng.choice((1, 1, 2, 3))), units=self.names)
            slack = rng.choice((Fraction(1), Fraction(1), Fraction(1, 2)))
            self.tasks[name] = Task(name=name, period=self.ticks(period), slack=slack, versions=(version,))

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(unit.name for unit in self.units)

    def ticks(self, count: object) -> Duration:
        return self.unit * Fraction(count)

    def periodic(self) -> Task:
        """Draw a task with a period."""
        return self.rng.choice([task for task in self.tasks.values() if task.period is not None])

    def put(self, task: Task, **changes: object) -> None:
        self.tasks[task.name] = replace(self.tasks[task.name], **changes)

    def put_versions(self, task: Task, change: object) -> None:
        self.put(task, versions=tuple(map(change, self.tasks[task.name].versions)))

    def pair(self) -> tuple[Task, Task]:
        """Draw two tasks in the order of the model, so that constraints between them form no cycle."""
        names = list(self.tasks)
        one, two = sorted(self.rng.sample(range(len(names)), 2))
        return self.tasks[names[one]], self.tasks[names[two]]

    def model(self) -> TaskModel:
        modes = []
        for name, left_out, edge in self.modes:
            runs = [t for t in self.tasks.values() if t.name not in left_out]
            modes.append(
                Mode(
                    name=name,
                    edge=edge,
                    runs=tuple(Run(task=t.name, versions=tuple(v.name for v in t.versions)) for t in runs),
                )
            )
        return TaskModel(
            name="m",
            units=tuple(self.units),
            resources=tuple(self.resources),
            tasks=tuple(self.tasks.values()),
            chains=tuple(self.chains),
            modes=tuple(modes),
            transitions=tuple(self.transitions),
            health=tuple(self.health),
        )


# ---------------------------------------------------------------------------------------------- features


def gang(draft: Draft) -> None:
    count = draft.rng.randint(1, len(draft.units))
    draft.put_versions(draft.periodic(), lambda v: replace(v, gang=count))


def versions(draft: Draft) -> None:
    task = draft.periodic()
    first = draft.tasks[task.name].versions[0]
    other = replace(first, name="w", wcet=draft.ticks(1), units=draft.names[:1], gang=1, accesses=(), split=Split())
    draft.put(task, versions=(first, other))


def offset(draft: Draft) -> None:
    draft.put(draft.periodic(), offset=draft.ticks(Fraction(draft.rng.randrange(2 * PERIOD), draft.rng.choice((1, 2)))))


def strict(draft: Draft) -> None:
    draft.put(draft.periodic(), slack=Fraction(0))


def long_deadline(draft: Draft) -> None:
    task = draft.periodic()
    draft.put(task, deadline=task.period * draft.rng.choice((Fraction(1, 2), Fraction(3, 2), Fraction(2))))


def long_job(draft: Draft) -> None:
    """A task whose jobs take about their period, or more."""
    task = draft.periodic()
    wcet = task.period * draft.rng.choice((Fraction(2, 3), Fraction(1), Fraction(5, 4)))
    draft.put(task, deadline=task.period * 2)
    draft.put_versions(task, lambda v: replace(v, wcet=wcet))


def points(draft: Draft) -> None:
    def cut(v: Version) -> Version:
        return replace(v, split=Split(points=(v.wcet / 3, v.wcet * Fraction(2, 3)), resume=draft.ticks(0)))

    draft.put_versions(draft.periodic(), cut)


def anywhere(draft: Draft) -> None:
    def cut(v: Version) -> Version:
        least = draft.rng.choice((None, v.wcet / 4))
        resume = draft.ticks(draft.rng.choice((Fraction(0), Fraction(1, 4))))
        return replace(v, split=Split(anywhere=True, max_gaps=draft.rng.randint(0, 3), min_part=least, resume=resume))

    draft.put_versions(draft.periodic(), cut)


def interrupts(draft: Draft) -> None:
    row = Interrupt(name="i", distance=draft.ticks(draft.rng.choice((5, 7, 12))), wcet=draft.ticks(Fraction(1, 3)))
    number = draft.rng.randrange(len(draft.units))
    draft.units[number] = replace(draft.units[number], interrupts=(row,))


def bound_in_modes(draft: Draft) -> None:
    draft.put(draft.periodic(), binding=Binding.MODE)


def bound_everywhere(draft: Draft) -> None:
    draft.put(draft.periodic(), binding=Binding.SYSTEM)


def polling(draft: Draft) -> None:
    task = draft.periodic()
    distance = task.period * draft.rng.choice((1, Fraction(3, 2), 3))
    draft.put(task, distance=distance, deadline=draft.rng.choice((None, task.period * 4)), let=None)


def demanded(draft: Draft) -> None:
    """A task without a period, for one that is there."""
    name = f"d{len(draft.tasks)}"
    wish = Precedence(task=name, anchor=Anchor.END, max=draft.ticks(draft.rng.choice((4, PERIOD, 3 * PERIOD))))
    task = draft.periodic()
    before = Version(name="v", wcet=draft.ticks(1), units=draft.names)
    draft.tasks = {name: Task(name=name, versions=(before,)), **draft.tasks}
    draft.put_versions(task, lambda v: replace(v, precedences=(*v.precedences, wish)))


def window(draft: Draft) -> None:
    before, task = draft.pair()
    low = draft.rng.choice((0, 0, 2))
    row = Precedence(
        task=before.name,
        anchor=draft.rng.choice((Anchor.START, Anchor.END)),
        to=draft.rng.choice((Anchor.START, Anchor.START, Anchor.END)),
        min=draft.ticks(low),
        max=draft.ticks(low + draft.rng.choice((3, PERIOD, 2 * PERIOD))),
    )
    draft.put_versions(task, lambda v: replace(v, precedences=(*v.precedences, row)))


def same_cycle(draft: Draft) -> None:
    before, task = draft.pair()
    if before.period is not None and task.period is not None:
        row = Precedence(task=before.name, anchor=Anchor.END, match=Match.CYCLE, max=draft.ticks(2 * PERIOD))
        draft.put_versions(task, lambda v: replace(v, precedences=(*v.precedences, row)))


def instants(draft: Draft) -> None:
    before, task = draft.pair()
    if before.period is None:
        return
    least = min(v.wcet for v in draft.tasks[before.name].versions)
    anchor = draft.rng.choice((Anchor.RELEASE, Anchor.POINT))
    point = least / 2 if anchor is Anchor.POINT else None
    if anchor is Anchor.RELEASE:
        draft.put(before, offset=before.offset or draft.ticks(0))  # the search needs one
    row = Precedence(task=before.name, anchor=anchor, point=point, max=draft.ticks(2 * PERIOD))
    draft.put_versions(task, lambda v: replace(v, precedences=(*v.precedences, row)))


def _phase(draft: Draft, name: str, bound: Fraction) -> None:
    def phase(v: Version) -> Version:
        end = min((p for p in v.split.points), default=v.wcet)
        begin, end = draft.rng.choice(((draft.ticks(0), end), (end / 4, end / 2)))
        row = Access(resource=name, start=begin, end=end, bound=bound)
        return replace(v, accesses=(*v.accesses, row))

    for task in sorted({draft.periodic().name, draft.periodic().name}):  # the order of a set differs between runs
        draft.put_versions(draft.tasks[task], phase)


def memory(draft: Draft) -> None:
    _phase(draft, "r", draft.rng.choice((Fraction(1), Fraction(1, 2), Fraction(1, 3))))


def lock(draft: Draft) -> None:
    _phase(draft, "l", Fraction(1))


def closed(draft: Draft) -> None:
    draft.modes = [(name, left, Edge.CLOSED) for name, left, _ in draft.modes]


def logical(draft: Draft) -> None:
    task = draft.periodic()
    if task.distance is None:
        draft.put(task, let=min(task.period, task.deadline or task.period), offset=task.offset or draft.ticks(0))


def chains(draft: Draft) -> None:
    names = draft.rng.sample(list(draft.tasks), draft.rng.randint(1, min(3, len(draft.tasks))))
    factor = draft.rng.choice((3, 6, 12))
    draft.chains.append(
        Chain(
            name=f"c{len(draft.chains)}",
            tasks=tuple(names),
            max_reaction=draft.rng.choice((None, draft.ticks(factor * PERIOD))),
            max_age=draft.rng.choice((None, draft.ticks(factor * PERIOD))),
        )
    )


def modes(draft: Draft) -> None:
    """A second mode without one of the tasks, and switches both ways."""
    left = {draft.periodic().name} if len(draft.tasks) > 2 and draft.rng.random() < 0.6 else set()
    named = {row.task for task in draft.tasks.values() for v in task.versions for row in v.precedences}
    draft.modes.append((f"n{len(draft.modes)}", left - named, draft.modes[0][2]))
    last, first = draft.modes[-1][0], draft.modes[0][0]
    most = draft.rng.choice((None, draft.ticks(4 * PERIOD)))
    draft.transitions += [Transition(source=first, target=last, max_length=most), Transition(source=last, target=first)]


def health(draft: Draft) -> None:
    if len(draft.modes) == 1:
        modes(draft)
    action = draft.rng.choice(tuple(HealthAction))
    draft.health.append(
        HealthRule(
            task=draft.periodic().name,
            event=draft.rng.choice(tuple(HealthEvent)),
            action=action,
            mode=draft.modes[-1][0] if action is HealthAction.SWITCH else "",
        )
    )


def unlike_periods(draft: Draft) -> None:
    draft.put(draft.periodic(), period=draft.ticks(Fraction(draft.rng.choice((8, 9, 10, 15)))), let=None)


FEATURES = (
    unlike_periods, gang, versions, offset, strict, long_deadline, long_job, points, anywhere, interrupts,
    bound_in_modes, bound_everywhere, polling, demanded, window, same_cycle, instants, memory, lock, closed, logical,
    chains, modes, health,
)  # fmt: skip
PAIRS = tuple(combinations(FEATURES, 2))


def system(seed: int) -> tuple[TaskModel, list[str]]:
    """Return the model of a seed, with the names of its features: a pair by the number, and two more.

    A model that is invalid is drawn once more, so that each pair is in at least a hundredth of the valid ones.
    """
    for again in ("", "/again"):
        rng = random.Random(f"every verb/{seed}{again}")
        chosen = {*PAIRS[seed % len(PAIRS)], *rng.sample(FEATURES, 2)}
        draft = Draft(rng)
        used = [feature for feature in FEATURES if feature in chosen]
        for feature in used:
            feature(draft)
        model = draft.model()
        if not any(finding.is_error for finding in halpipe.validate(model)):
            break
    return model, [feature.__name__ for feature in used]


# ---------------------------------------------------------------------------------------------- verbs


class DisagreementError(Exception):
    """Two verbs, or a verb and its own words, do not agree; or a verb ended in an internal error."""


class Drive:
    """All verbs on one model in a folder; counts the exit codes by verb."""

    def __init__(self, folder: Path, counts: Counter[tuple[str, int]]) -> None:
        self.folder, self.counts = folder, counts
        self.last = ""

    def run(self, *words: str, lawful: tuple[int, ...] = (0,), label: str = "") -> int:
        """Run a command; raise where its exit code is none of the lawful ones."""
        self.last = " ".join(words)
        done = run_here(self.folder, *words)
        self.counts[label or words[0], done.returncode] += 1
        if done.returncode not in lawful or "Traceback" in done.stderr:
            raise DisagreementError(f"halpipe {self.last}: exit {done.returncode}\n{done.stderr[-1500:]}")
        return done.returncode

    def whole(self, rng: random.Random, model: TaskModel) -> str:
        """Run every verb, and return how the model ended: invalid, found, not found or infeasible."""
        (self.folder / "m.xml").write_bytes(format_model(model))
        if self.run("validate", "m.xml", "-q", lawful=(0, 1)):
            self.run("schedule", "m.xml", "-o", "s.xml", "-q", lawful=(1, 4), label="schedule invalid")
            self.run("explain", "m.xml", "-q", lawful=(1, 4), label="explain invalid")
            return "invalid"
        seed = str(rng.randrange(5))
        code = self.run("schedule", "m.xml", "-o", "s.xml", "--budget", "300", "--seed", seed, "-q", lawful=(0, 3, 4))
        exact = self.engine_exact()
        explained = self.run("explain", "m.xml", *rng.choice(((), ("--no-remedies",))), "-q", lawful=(0, 3, 4))
        if INFEASIBLE in (code, exact, explained) and FOUND in (code, exact, explained):
            raise DisagreementError(f"proven infeasible and found: schedule {code}, exact {exact}, explain {explained}")
        best = "s.xml" if code == FOUND else "x.xml" if exact == FOUND else ""
        self.sized(rng, bool(best))
        if best:
            self.found(rng, model, best)
        return "found" if best else "infeasible" if INFEASIBLE in (code, exact, explained) else "not found"

    def engine_exact(self) -> int:
        words = ("schedule", "m.xml", "-o", "x.xml", "--engine", "exact", "--time-limit", "5s", "-q")
        code = self.run(*words, lawful=(0, 1, 3, 4), label="schedule --engine exact")
        if code == FOUND:
            self.run("verify", "m.xml", "x.xml", "-q", label="verify exact")
        return code

    def sized(self, rng: random.Random, is_found: bool) -> None:
        kind = rng.choice(("--wcet-factor", "--bandwidth", "--units"))
        words = {"--wcet-factor": (), "--bandwidth": ("r",), "--units": ("",)}[kind]
        lawful = (0, 3) if is_found else (0, 3, 4)
        self.run("size", "m.xml", kind, *words, "--budget", "100", "--step", "1/4", "-q", lawful=(*lawful, 2, 1))

    def found(self, rng: random.Random, model: TaskModel, best: str) -> None:
        """Run the verbs that need a schedule."""
        self.run("verify", "m.xml", best, "-q")
        if not second.accepts(str(self.folder / "m.xml"), str(self.folder / best)):
            raise DisagreementError("the second checker refuses the schedule")
        self.run("sensitivity", "m.xml", best, "-q")
        self.run("schedule", "m.xml", "-o", "f.xml", "--freeze", best, "-q", label="schedule --freeze")
        self.run("diff", best, "f.xml", "-q", label="diff frozen")
        self.run("schedule", "m.xml", "-o", "n.xml", "--near", best, "-q", label="schedule --near")
        self.run("verify", "m.xml", "n.xml", "-q", label="verify near")
        wish = rng.choice(("chains", "jitter", "margin", "preemptions", "cost", "margin,jitter", "chains,cost"))
        options = ("--optimise", wish, "--budget", "100")
        self.run("schedule", "m.xml", "-o", "o.xml", *options, "-q", lawful=(0, 1, 3), label="schedule --optimise")
        self.run("show", best, "--model", "m.xml")
        self.exports(rng, model, best)

    def exports(self, rng: random.Random, model: TaskModel, best: str) -> None:
        for form, name in (("report", "r.html"), ("graph", "g.dot"), ("trace", "t.json")):
            self.run("export", form, "m.xml", best, "-o", name, "-q", label=f"export {form}")
        self.run("export", "btf", "m.xml", best, "-o", "t.btf", "-q", label="export btf")
        if len(model.modes) == 1:
            self.run("compare", best, "t.btf", "--model", "m.xml", "--tolerance", "2ns", "-q")  # BTF has whole ns
        for form, name in (("amalthea", "a.amxmi"), ("arxml", "a.arxml")):
            schedule = rng.choice(((), (best,)))
            code = self.run("export", form, "m.xml", *schedule, "-o", name, "-q", lawful=(0, 1), label=f"export {form}")
            if code == 0:
                self.run("import", form, name, "-o", "back.xml", "-q", label=f"import {form}")
                self.run("validate", "back.xml", "-q", label=f"validate {form}")
                if not schedule:
                    self.run("diff", "m.xml", "back.xml", "-q", label=f"diff {form}")
        self.run("export", "ros", "m.xml", best, "-o", "r.yaml", "-q", lawful=(0, 1), label="export ros")
        words = ("export", "linux", "m.xml", best, "-o", "linux", "--busy", "10", "-q")
        shutil.rmtree(self.folder / "linux", ignore_errors=True)
        if self.run(*words, lawful=(0, 1), label="export linux") == 0 and rng.random() < PLAYED:
            lawful = (0, 1)  # in real time, on a machine that may be busy
            self.run("deploy", "check", "linux", "-q", lawful=lawful, label="deploy check linux")


class Values:
    """The verbs that decide, on one model in memory: some thirty systems a second."""

    def __init__(self, folder: Path, counts: Counter[tuple[str, int]]) -> None:
        self.folder, self.counts = folder, counts

    def ask(self, verb: str, question: object, *lawful: Exit) -> tuple[object, int]:
        """Return an answer and its exit code; raise where it fails in any other way than by a lawful exit code."""
        try:
            answer, code = question(), FOUND
        except HalpipeError as failure:
            answer, code = None, int(failure.exit)
            if failure.exit not in lawful:
                raise DisagreementError(f"{verb}: exit {code}\n{failure}") from None
        except Exception:  # noqa: BLE001 - each is what is looked for
            raise DisagreementError(f"{verb}: {traceback.format_exc(limit=-4)}") from None
        self.counts[f"{verb}()", code] += 1
        return answer, code

    def whole(self, rng: random.Random, drafted: TaskModel) -> str:
        """Ask every question, and return how the model ended: invalid, found, not found or infeasible."""
        content = format_model(drafted)
        (self.folder / "m.xml").write_bytes(content)
        model = parse_model(content, "m.xml")
        self.same("model", drafted, content, format_model(model), model)
        found, _ = self.ask("validate", lambda: halpipe.validate(model))
        if any(finding.is_error for finding in found):
            self.ask("explain invalid", lambda: halpipe.explain(model, remedies=False))
            return "invalid"
        seed = rng.randrange(5)
        search = lambda: halpipe.schedule(model, budget=300, seed=seed)  # noqa: E731
        schedule, code = self.ask("schedule", search, Exit.NOT_FOUND, Exit.INFEASIBLE)
        if schedule is not None:
            self.found(model, schedule)
        proofs, _ = self.ask("witnesses", lambda: find_witnesses(model, ()))
        if not proofs and rng.random() > EXPLAINED:
            return {FOUND: "found", INFEASIBLE: "infeasible"}.get(code, "not found")
        explain = lambda: halpipe.explain(model, remedies=False, exact=False)  # noqa: E731
        explained, _ = self.ask("explain", explain, Exit.NOT_FOUND)
        self.counts["explained", int(explained.exit)] += 1
        if {FOUND, INFEASIBLE} <= {code, int(explained.exit)} or (code == FOUND and proofs):
            raise DisagreementError(f"proven infeasible and found: schedule {code}, explain {explained.exit}, {proofs}")
        return {FOUND: "found", INFEASIBLE: "infeasible"}.get(int(explained.exit) if code else code, "not found")

    def found(self, model: TaskModel, schedule: object) -> None:
        """Hold the schedule against both checkers, as it is and as it is read back."""
        content = format_schedule(schedule)
        (self.folder / "s.xml").write_bytes(content)
        again = parse_schedule(content, "s.xml")
        self.same("schedule", schedule, content, format_schedule(again), again)
        broken, _ = self.ask("verify", lambda: halpipe.verify(model, again))
        judged = second.module().judge(str(self.folder / "m.xml"), str(self.folder / "s.xml"))
        if broken or judged:
            raise DisagreementError(f"a schedule that was found is refused: {[*broken, *judged]}")

    def same(self, what: str, value: object, content: bytes, again: bytes, back: object) -> None:
        """Raise unless a file that is read and written again has the same bytes, and diff sees no difference."""
        difference, _ = self.ask(f"diff {what}", lambda: halpipe.diff(value, back))
        if content != again or (difference if isinstance(difference, tuple) else not difference.is_same):
            raise DisagreementError(f"the {what} that is read back differs: {difference}")


Failed = tuple[Counter[str], Counter[tuple[str, int]], list[int]]


def drive(first: int, count: int, keep: Path, said=print, every: int = 1) -> Failed:
    """Drive so many systems; return how they ended, exit codes by verb, and the seeds on which verbs disagree."""
    ends: Counter[str] = Counter()
    codes: Counter[tuple[str, int]] = Counter()
    failed = []
    for seed in range(first, first + count):
        model, features = system(seed)
        with tempfile.TemporaryDirectory(prefix="halpipe-verbs-") as place:
            drivers = [Values(Path(place), codes)] + [Drive(Path(place), codes)] * (seed % every == 0)
            try:
                for driver in drivers:
                    end = driver.whole(random.Random(seed), model)
                ends[end] += 1
                if end != "invalid":
                    ends.update(combinations(features, 2))
            except DisagreementError as failure:
                failed.append(seed)
                shutil.copytree(place, keep / str(seed), dirs_exist_ok=True)
                said(f"seed {seed} ({', '.join(features)}): {failure}")
    return ends, codes, failed


def main() -> int:
    """Drive the systems that are asked for."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("systems", type=int, nargs="?", default=2000)
    asked.add_argument("seed", type=int, nargs="?", default=0)
    asked.add_argument("--every", type=int, default=50)
    words = asked.parse_args()
    say = partial(print, flush=True)
    keep = Path(tempfile.mkdtemp(prefix="halpipe-disagreements-"))
    ends, codes, failed, done = Counter(), Counter(), [], 0
    while done < words.systems:
        lot = drive(words.seed + done, min(LOT, words.systems - done), keep, say, words.every)
        for whole, part in zip((ends, codes, failed), lot, strict=True):
            whole += part
        done += min(LOT, words.systems - done)
        say(f"{done} systems,", {end: n for end, n in ends.items() if isinstance(end, str)})
    say({f"{verb}: {code}": n for (verb, code), n in sorted(codes.items())})
    names = [(one.__name__, other.__name__) for one, other in PAIRS]
    rarest = min((ends[name], name) for name in names)
    say(f"{len(PAIRS)} pairs of features in valid models, the rarest", rarest)
    say(f"{words.systems} systems, {len(failed)} with a disagreement{f'; files in {keep}' if failed else ''}")
    is_rare = words.systems >= 100_000 and rarest[0] < words.systems // 100
    return 1 if failed or is_rare else 0


if __name__ == "__main__":
    sys.exit(main())
