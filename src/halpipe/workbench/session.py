"""Session of the workbench: a model with its schedule, history, variants and journal, without any server."""

from __future__ import annotations

import os
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Diagnostic, HalpipeError, Location, about, error, sort_diagnostics
from halpipe.core.files import CANNOT_WRITE, is_ended, read_own, sha256, write_outputs
from halpipe.core.grouping import grouped
from halpipe.core.records import record
from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.solve.codes import CANNOT_STAY
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.solve.workers import Workers
from halpipe.pipeline.stable import moved_jobs, settled
from halpipe.workbench.edits import BAD_EDIT, Edit, Pin, edited
from halpipe.workbench.journal import EDITS_LOST, Journal
from halpipe.workbench.overlay import SUFFIXES, overlay_of

if TYPE_CHECKING:
    from halpipe.exporters.common.base import ExportOptions
    from halpipe.exporters.report.beside import Beside
    from halpipe.exporters.report.scene import Drawn
    from halpipe.models import Job, ModeSchedule, Schedule, TaskModel

OUTDATED = error(
    "HAL0952",
    "The model was changed in another window",
    "Two windows work on one model. An edit is made on what its window shows; this one was made on an older state.",
)
CHANGED_ON_DISK = error(
    "HAL0953",
    "File is not overwritten unless that is asked for",
    "There is such a file, or the model's own was changed by another program since the workbench read or wrote it.",
)
NO_VARIANT = error(
    "HAL0956", "There is no such variant", "Variants are kept under names, and live as long as the server."
)
NOT_PROVEN = error(
    "HAL0957", "Nothing to export", "Only a schedule that has passed verify, of the model as it is shown, is exported."
)
UNTENABLE = error(
    "HAL0962",
    "Pinned task cannot stay",
    "Pinned jobs keep start and units. Offset, slack, deadline, LET, units or split points of the task forbid that.",
)
NO_SUCH_JOB = error("HAL0954", "There is no such job", "A job is named by its mode, its task and its number.")

BUDGET = 2_000
"""Moves per task for one answer; a person waits for it."""
HISTORY = 200
RESTORED = "edits of an earlier session"
LOWER = ("nothing", "variant", "trace")


@record
class State:
    """A model, what is pinned in it, and its schedule, which `findings` may say is none of this model any more.

    A schedule that is not `solved` yet is that of the state before, with what the edit says of its jobs.
    """

    model: TaskModel
    pins: tuple[Pin, ...] = ()
    schedule: Schedule | None = None
    findings: tuple[Diagnostic, ...] = ()
    what: str = "opened"
    solved: bool = True

    @property
    def is_valid(self) -> bool:
        """Whether the schedule is one of the model, and has passed verify."""
        return self.solved and self.schedule is not None and not any(found.is_error for found in self.findings)


@record
class Answered:
    """Effort behind the shown schedule: jobs that stayed of all, and seconds; None where nothing was solved."""

    stayed: int = 0
    jobs: int = 0
    seconds: float | None = None


class Session:
    """State of a workbench; one thread at a time may call it."""

    def __init__(self, path: str, workers: int = 1) -> None:
        content = read_own(path)
        self.path = path
        self.lock = threading.Lock()
        self.revision = 0
        self.variants: dict[str, State] = {}
        self.answered = Answered()
        self.progress: tuple[str, int, int] | None = None
        self._cancelled = threading.Event()
        self._workers = Workers(workers)
        self._on_disk = sha256(content)
        self.past: list[State] = []
        self.future: list[State] = []
        self.opened = self._saved = parse_model(content, path)
        self.drawn: Drawn = {}
        """State of each task as last sent to the page."""
        self.lower = ("nothing", "")
        """Kind, one of `LOWER`, and name of what is drawn under the schedule: that of the variant, or the file."""
        self.shown = State(self.opened)
        """State as it is drawn: an edit is drawn before it is solved."""
        self.journal = Journal(path)
        kept = self.journal.read(self._on_disk)
        if kept is not None:
            self._remember()
            self.shown = State(*kept, what=RESTORED)

    def begin(self) -> None:
        """Find the first schedule."""
        with self.lock:
            self._show(self._solved(self.shown, None), self.answered)

    @property
    def state(self) -> State:
        """The state with its verified schedule, or with the reasons against one; see `settle`."""
        self.settle()
        return self.shown

    def settle(self) -> None:
        """Find the schedule near the last one for an edit that is drawn and not solved yet."""
        if not self.shown.solved:
            self.shown = self._solved(self.shown, self.past[-1])

    # ---- what a person does

    def check(self, revision: int) -> None:
        """Refuse an order that a page gives on another state than this one."""
        if revision != self.revision:
            help = "look at what is shown now, and make the edit again if it is still wanted"
            raise HalpipeError(OUTDATED("the model was changed in another window", help=help))

    def edit(self, edit: Edit) -> None:
        """Change one attribute; the next look at `state` finds a schedule near the one that is shown."""
        model = edited(self.state.model, edit)
        what = edit.place if edit.kind == "remove" else f"{edit.place} = {edit.value or 'nothing'}"
        self._enter(replace(self.state, model=model, what=what))

    def pin(self, pin: Pin) -> None:
        """Put a job somewhere; it stays there, and the rest gives way."""
        held = self._held(pin)
        others = tuple(p for p in self.state.pins if (p.mode, p.task) != (pin.mode, pin.task))
        what = f'job {pin.index} of "{pin.task}" at {pin.start}'
        self._enter(replace(self.state, pins=(*others, *held), what=what))

    def unpin(self) -> None:
        """Release the jobs of every task."""
        self._enter(replace(self.state, pins=(), what="unpin all"))

    def undo(self) -> None:
        """Go back one step, if there is one."""
        if self.past:
            self.future.append(self.state)
            self._show(self.past.pop())

    def redo(self) -> None:
        """Go forward again, if there is a step."""
        if self.future:
            self.past.append(self.state)
            self._show(self.future.pop())

    def keep(self, name: str) -> None:
        """Keep what is shown as a variant of that name."""
        self.variants[name] = self.state
        self.revision += 1

    def take(self, name: str) -> None:
        """Show a variant again; the step can be undone."""
        kept = self.variant(name)
        self._remember()
        self._show(replace(kept, what=f'variant "{name}"'))

    def draw_under(self, kind: str, name: str) -> None:
        """Draw a variant or a recorded trace under the schedule from now on, or nothing."""
        before, self.lower = self.lower, (kind, name)
        try:
            self.beside()
        except HalpipeError:
            self.lower = before
            raise
        self.revision += 1

    def save(self, path: str, *, force: bool = False) -> str:
        """Write the model, or into a YAML file the edits as an overlay; over a file that is there only if asked for."""
        target = path or self.path
        if os.path.isdir(target) or not is_ended(target):  # a pipe would block every later order
            raise HalpipeError(CANNOT_WRITE("is no plain file", at=Location(target), help="name a plain file"))
        is_overlay = os.path.splitext(target)[1].lower() in SUFFIXES
        content = overlay_of(self.opened, self.state.model) if is_overlay else format_model(self.state.model)
        is_source = os.path.realpath(target) == os.path.realpath(self.path)
        if not force and os.path.lexists(target):
            text = "was changed since it was read" if is_source and self.changed_on_disk() else "is there already"
            help = "save under another name, or save over it on purpose"
            raise HalpipeError(CHANGED_ON_DISK(f"{target} {text}", path=target, help=help))
        write_outputs({target: content})
        if is_source:
            self._on_disk = sha256(content)
            self._saved = self.state.model
            self.shown = replace(self.shown, what="saved")
            self._note()
        return target

    def close(self) -> None:
        """Keep the edits for the next session; raise `HalpipeError` where that cannot be done."""
        self._note()
        if self.journal.fault:
            text = f"the edits since the last journal are lost: {self.journal.fault}"
            raise HalpipeError(EDITS_LOST(text, path=self.journal.path, help="make room, and repeat the edits"))

    def cancel(self) -> None:
        """End the search that runs."""
        self._cancelled.set()

    # ---- what may be asked

    def changed_on_disk(self) -> bool:
        """Return whether the file is not what was read or written."""
        try:
            return sha256(read_own(self.path)) != self._on_disk
        except HalpipeError:
            return True

    def variant(self, name: str) -> State:
        """Return what was kept under a name."""
        if name not in self.variants:
            raise HalpipeError(NO_VARIANT(f'there is no variant "{name}"', help="keep one first"))
        return self.variants[name]

    def beside(self) -> Beside | None:
        """Return what is drawn under the schedule; raise `HalpipeError` where it does not fit, None for nothing."""
        kind, name = self.lower
        shown = self.shown
        if kind == "nothing" or shown.schedule is None or not shown.is_valid:
            return None
        from halpipe.exporters.report import ReportOptions
        from halpipe.flow.beside import against, with_beside

        if kind == "trace":
            model = self._as_read(shown.model)
            return with_beside(model, shown.schedule, ReportOptions(trace=name))[0].beside
        other = self.variant(name).schedule
        return against(shown.model, shown.schedule, other, f'variant "{name}"') if other else None

    def why(self, mode: str) -> tuple[Diagnostic, ...]:
        """Return why a mode (empty: any) has no schedule and what would help; a cancelled search ends early."""
        from halpipe.pipeline.explain.explanation import ExplainOptions, explain

        self._cancelled.clear()
        model = self._as_read(self.state.model)
        return explain(model, ExplainOptions(mode=mode), lambda: not self._cancelled.is_set()).diagnostics

    def margins(self) -> dict[str, float]:
        """Return for each task by how much of it the WCET can grow before the schedule breaks, the least of all."""
        from halpipe.pipeline.whatif.sensitivity import sensitivities

        rows = sensitivities(self._as_read(self.state.model), self._proven(), frozenset())
        shares = grouped((row.task, float(row.growth / row.wcet)) for row in rows if row.growth is not None)
        return {task: min(found) for task, found in shares.items()}

    def exported(self, format: str, options: ExportOptions) -> dict[str, bytes]:
        """Return the files of an export of what is shown."""
        from halpipe.flow.formats import export

        return export(format, self._as_read(self.state.model), self._proven(), options)

    def _proven(self) -> Schedule:
        if self.state.schedule is None or not self.state.is_valid:
            raise HalpipeError(NOT_PROVEN("there is no valid schedule of this model", help="undo, or edit on"))
        return self.state.schedule

    def _as_read(self, model: TaskModel) -> TaskModel:
        """Return the model as it would be read from its file, whose form the writer has looked at."""
        return parse_model(format_model(model), self.path, is_checked=True)

    # ---- inside

    def _enter(self, wanted: State) -> None:
        format_model(wanted.model)  # what no file can state is refused before anything changes
        self._remember()
        self.future.clear()
        self._show(replace(wanted, schedule=_drawn(self.state, wanted), findings=(), solved=False))

    def _remember(self) -> None:
        self.past.append(self.state)
        del self.past[:-HISTORY]

    def _show(self, state: State, answered: Answered | None = None) -> None:
        self.shown, self.answered = state, answered or Answered()
        self.revision += 1
        self._note()

    def _note(self) -> None:
        """Keep what the file of the model does not have yet, for the next session."""
        if self.shown.pins or self.shown.model != self._saved:
            self.journal.write(self._on_disk, self.shown.model, self.shown.pins)
        else:
            self.journal.remove()

    def _held(self, pin: Pin) -> list[Pin]:
        """Return pins for all jobs of a task: without slack, the others move as far; else they stay where they are."""
        schedule = self.state.schedule
        modes = {} if schedule is None else {mode.name: mode for mode in schedule.modes}
        jobs = {job.index: job for job in modes[pin.mode].jobs if job.task == pin.task} if pin.mode in modes else {}
        task = next((task for task in self.state.model.tasks if task.name == pin.task), None)
        if pin.index not in jobs or task is None:  # what is drawn may be the schedule of another model
            message = f'mode "{pin.mode}" has no job {pin.index} of "{pin.task}"'
            raise HalpipeError(NO_SUCH_JOB(message, help="choose one that is shown"))
        if pin.unit and pin.unit not in {unit.name for unit in self.state.model.units}:
            text = f'there is no unit "{pin.unit}"'
            raise HalpipeError(BAD_EDIT(text, path=about(task=pin.task), help="choose one that is shown"))
        length = modes[pin.mode].hyperperiod
        moved = pin.start - jobs[pin.index].start
        rigid = not task.slack
        held = []
        for job in jobs.values():
            start = (job.start + moved) % length if rigid or job.index == pin.index else job.start
            held.append(replace(pin, index=job.index, start=start))
        return held

    def _solved(self, state: State, shown: State | None) -> State:
        """Return the state with a verified schedule, or with the reasons of a refusal and the schedule before."""
        schedule = before = None if shown is None else shown.schedule
        if state.pins and before is None:  # they hold jobs of a schedule
            free = self._solved(replace(state, pins=()), None)
            return self._solved(state, free) if free.schedule else replace(free, pins=state.pins)
        began = time.monotonic()
        self._cancelled.clear()
        findings = []
        shipped = _pinned(state, before) if state.pins and before else None
        options = SearchOptions(budget=BUDGET, workers=self._workers, near=before, shipped=shipped)
        try:
            model = self._as_read(state.model)
            kept = _settled(shown, state, model)
            scheduled = schedule_model(model, replace(options, settled=kept), self._on_progress)
            if (
                kept and before and len(scheduled.schedule.transitions) < len(before.transitions)
            ):  # other modes may help
                scheduled = schedule_model(model, options, self._on_progress)
            lost = [found for found in scheduled.diagnostics if shipped and found.code == CANNOT_STAY.id]
            if lost:
                text, help = "cannot stay where it is pinned", "undo, or unpin all and drag it to another place"
                findings = [UNTENABLE(text, at=found.at, path=found.path, help=help) for found in lost]
            elif scheduled.is_complete:
                schedule = scheduled.schedule
            else:
                from halpipe.pipeline.checked import explain_failure

                findings = explain_failure(model, scheduled, interrupted=scheduled.stopped)
        except HalpipeError as refused:
            findings = list(refused.diagnostics)
        self.answered = _answered(before, None if findings else schedule, time.monotonic() - began)
        self.progress = None
        return replace(state, schedule=schedule, findings=tuple(sort_diagnostics(findings)), solved=True)

    def _on_progress(self, mode: str, made: int, allowed: int, least: int, *_: Any) -> bool:
        self.progress = (mode, made, allowed)
        return not self._cancelled.is_set()


def _pinned(state: State, before: Schedule) -> Schedule:
    """Return the pinned jobs of a schedule at their places."""
    modes = []
    for mode in before.modes:
        pins = _pins(state, mode)
        held = tuple(_moved(job, pins[job.task, job.index]) for job in mode.jobs if (job.task, job.index) in pins)
        modes.append(replace(mode, jobs=held))
    return before.alone(tuple(modes))


def _drawn(before: State, wanted: State) -> Schedule | None:
    """Return the schedule before with pinned jobs at their places, and jobs as much longer as their WCETs are."""
    if before.schedule is None:
        return None
    old, new = ({(t.name, v.name): v.wcet for t in state.model.tasks for v in t.versions} for state in (before, wanted))
    grown = {key: wcet - was for key, wcet in new.items() if wcet and (was := old.get(key)) and wcet != was}

    def drawn(job: Job, pin: Pin | None) -> Job:
        moved = job if pin is None else _moved(job, pin)
        more = grown.get((job.task, job.version))
        return moved if more is None or moved.parts else replace(moved, end=moved.end + more)

    modes = []
    for mode in before.schedule.modes:
        pins = _pins(wanted, mode)
        modes.append(replace(mode, jobs=tuple(drawn(job, pins.get((job.task, job.index))) for job in mode.jobs)))
    return replace(before.schedule, modes=tuple(modes))


def _settled(before: State | None, wanted: State, model: TaskModel) -> Schedule | None:
    """Return the tables that the last step does not reach."""
    if before is None or before.schedule is None or not before.is_valid:
        return None
    moved = {pin.mode for pin in {*before.pins} ^ {*wanted.pins}}
    return settled(before.model, model, before.schedule, moved)


def _pins(state: State, mode: ModeSchedule) -> dict[tuple[str, int], Pin]:
    return {(pin.task, pin.index): pin for pin in state.pins if pin.mode == mode.name}


def _moved(job: Job, pin: Pin) -> Job:
    units = (pin.unit,) if pin.unit and len(job.units) == 1 else job.units
    return replace(job, start=pin.start, end=pin.start + (job.end - job.start), units=units, parts=())


def _answered(before: Schedule | None, after: Schedule | None, seconds: float) -> Answered:
    if before is None or after is None:
        return Answered(seconds=seconds)
    jobs = sum(len(mode.jobs) for mode in after.modes)
    return Answered(jobs - sum(map(len, moved_jobs(before, after).values())), jobs, seconds)
