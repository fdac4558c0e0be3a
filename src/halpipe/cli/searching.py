"""Searches of commands: processors, Ctrl-C and time limit, progress, and what is saved of a search that fails."""

from __future__ import annotations

import itertools
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING

from halpipe import __version__
from halpipe.cli import output
from halpipe.core.diagnostics import Exit, HalpipeError, printable
from halpipe.core.files import STDIO, is_input, read_own, refuse_inputs, refuse_name, write_output
from halpipe.core.suggest import counted

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.progress import Progress

    from halpipe.core.durations import Duration
    from halpipe.models import TaskModel
    from halpipe.pipeline.solve.checkpoint import Checkpoint
    from halpipe.pipeline.solve.schedule import Scheduled, SearchOptions
    from halpipe.pipeline.solve.workers import Workers


GROUPS = Path("/sys/fs/cgroup")
MEMBERSHIP = Path("/proc/self/cgroup")


def processor_count() -> int:
    """Return the number of processors that are worth a thread each, at least 1."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min([allowed, *quotas()]))


def quotas() -> Iterator[int]:
    """Yield the limits that control groups set on processor time, in processors, rounded up.

    A group is bounded by those above it too. In a container, the path of the group may be the host's, while the files
    of the group itself lie at the root; both places are looked at.
    """
    for line in _text(MEMBERSHIP).splitlines():
        if line.startswith("0::"):
            yield from filter(None, map(_quota, _folders(GROUPS, line.removeprefix("0::"))))


def _folders(root: Path, path: str) -> Iterator[Path]:
    """Yield the folder of a group, of those above it, and the root."""
    inside = PurePosixPath(path.lstrip("/"))
    if ".." not in inside.parts:
        yield from (root / part for part in (inside, *inside.parents))


def _quota(folder: Path) -> int | None:
    """Return a quota in processors; None where there is none, which the file calls "max"."""
    quota, _, period = _text(folder / "cpu.max").strip().partition(" ")
    if not (quota.isdecimal() and period.isdecimal() and int(period)):
        return None
    return -(-int(quota) // int(period))


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="ascii", errors="replace")
    except OSError:
        return ""


class Stop:
    """Stop request of the user, named in `words`; a second Ctrl-C ends the command at once.

    A copy in another process has the time limit alone.
    """

    def __init__(self, words: str, time_limit: Duration | None = None) -> None:
        self.pressed = False
        self._words = words
        self._limit = float(time_limit.in_unit("s")) if time_limit else 0

    @contextmanager
    def listening(self) -> Iterator[None]:
        """Take Ctrl-C, the request to end, and the end of the terminal, unless that is ignored (nohup)."""
        numbers = [signal.SIGINT, signal.SIGTERM]
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        before = [(number, signal.signal(number, self._press)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)

    def _press(self, *_: object) -> None:
        if self.pressed:
            raise KeyboardInterrupt
        self.pressed = True
        output.say(self._words)

    def clock(self) -> Callable[..., bool]:
        """Return what one search asks whether to go on; its time begins now."""
        end = time.monotonic() + self._limit if self._limit else None
        return lambda *_: not self.pressed and (end is None or time.monotonic() < end)


NEAR = "HAL0414"
"""The note that says how many jobs stay; its module is loaded for --near alone."""


class Watch:
    """Watches one search: shows its progress and stops it on Ctrl-C or at the time limit."""

    def __init__(self, time_limit: Duration | None = None) -> None:
        self.stop = Stop("stopping; the best placement so far will be saved", time_limit)
        self.go_on = self.stop.clock()
        self._lock = threading.Lock()
        self._progress: Progress | None = None
        self._bars: dict[str, int] = {}
        self._better: dict[str, str] = {}

    def __enter__(self) -> Watch:
        return self

    def __exit__(self, *_: object) -> None:
        if self._progress is not None:
            self._progress.stop()

    def on_progress(self, mode: str, moves: int, budget: int, best: int) -> bool:
        """Show how far the search is; return whether it may go on."""
        if not output.Settings.quiet and output.is_terminal(sys.stderr):
            with self._lock:
                self._show(mode, moves, budget, best)
        return self.go_on()

    def on_better(self, mode: str, text: str) -> None:
        """Remember how far the objectives of a mode are."""
        self._better[mode] = text

    def _show(self, mode: str, moves: int, budget: int, best: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        from halpipe.pipeline.solve.one_mode import CONSTRUCTING
        from halpipe.pipeline.solve.schedule import SWITCHES, UNBOUNDED

        if self._progress is None:
            columns = (
                TextColumn("{task.description}", markup=False),
                BarColumn(bar_width=20),
                TextColumn("{task.fields[state]}"),
                TimeElapsedColumn(),
            )
            self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._progress.start()
        if mode not in self._bars:
            total = budget if budget < UNBOUNDED else None
            what = mode if mode == SWITCHES else f"mode {printable(mode)}"
            self._bars[mode] = self._progress.add_task(what, total=total, state="")
        if mode == SWITCHES:
            state = f"{moves} of {budget} mode pairs"
        else:
            state = "constructing" if best == CONSTRUCTING else f"{moves} moves, best cost {best}"
            state = self._better.get(mode, state)
        self._progress.update(self._bars[mode], completed=moves, state=state)  # type: ignore[arg-type]


def find_schedule(model: TaskModel, options: SearchOptions, target: str, *, resume: bool = False) -> int:
    """Search, write what was found, say how it went, and return the exit code."""
    from halpipe.exporters.native import format_schedule
    from halpipe.pipeline.checked import schedule_model
    from halpipe.pipeline.solve.limits import refuse_endless

    began = time.monotonic()
    refuse_inputs(target)
    refuse_name(target, ".xml")
    if options.budget is None:
        refuse_endless(model, options.modes)
    checkpoint = _checkpoint(model, options, target)
    if checkpoint is not None:
        if resume:
            checkpoint.load()
        else:
            checkpoint.claim()
        options = replace(options, keeper=checkpoint)
    with Watch(options.time_limit) as watch, watch.stop.listening():
        try:
            scheduled = schedule_model(model, replace(options, on_better=watch.on_better), watch.on_progress)
        except HalpipeError as failure:
            if failure.exit is Exit.INTERRUPTED and not watch.stop.pressed:  # it was the time limit
                failure.exit = Exit.NOT_FOUND
            raise
    output.report(scheduled.diagnostics)
    if scheduled.is_complete:
        write_output(target, format_schedule(scheduled.schedule))
        _summarise(scheduled, target, time.monotonic() - began)
        if checkpoint is not None:
            _finish(checkpoint, unimproved=scheduled.unimproved)
        if watch.stop.pressed:
            return Exit.INTERRUPTED
        return Exit.FINDINGS if any(d.is_error for d in scheduled.diagnostics) else Exit.OK
    if checkpoint is not None:
        checkpoint.write()
    return _save_best(model, scheduled, target, interrupted=watch.stop.pressed)


def _checkpoint(model: TaskModel, options: SearchOptions, target: str) -> Checkpoint | None:
    """Return where the search is kept on its way: beside its target, as NAME.resume."""
    from halpipe.pipeline.solve.checkpoint import Checkpoint, fingerprint

    if target == STDIO or (os.path.exists(target) and not os.path.isfile(target)):
        return None
    path = Path(target)
    identity = fingerprint(model, options, __version__)
    return Checkpoint(str(path.with_name(f"{path.stem}.resume")), identity, time.monotonic)


def _finish(checkpoint: Checkpoint, *, unimproved: bool) -> None:
    """Remove the checkpoint, unless the schedule could be improved further from there."""
    if not unimproved:
        checkpoint.remove()
        return
    checkpoint.write()
    output.inform("the schedule is valid, but improving it was cut short; --resume continues from here")


def workers_of(count: int | None) -> Workers:
    """Return as many workers as the user asked for, else as many as there are processors for it."""
    from halpipe.pipeline.solve.workers import Workers

    return Workers(processor_count() if count is None else count)


def _summarise(scheduled: Scheduled, target: str, seconds: float) -> None:
    schedule = scheduled.schedule
    for mode in schedule.modes:
        text = f"{counted(len(mode.jobs), 'job')} in {mode.hyperperiod}, valid"
        output.inform(f"mode {mode.name}: {text}; least margin of a WCET {mode.margin_words}")
    for told in scheduled.diagnostics:
        if told.code == NEAR and not output.Settings.verbose:
            output.inform(f"{told.path}: {told.message}")
    for reached in scheduled.reached:
        output.inform(f"mode {reached.mode}: {reached}")
    for table in schedule.transitions:
        output.inform(
            f"switch {table.source} to {table.target}: length {table.length}, worst latency {table.worst_latency}"
        )
    jobs = sum(len(mode.jobs) for mode in schedule.modes)
    amount = f"{counted(len(schedule.modes), 'mode')}, {counted(jobs, 'job')}"
    output.inform(f"{target}: {amount}, verified; {counted(scheduled.moves, 'move')} in {seconds:.2f} s")


def _save_best(model: TaskModel, scheduled: Scheduled, target: str, *, interrupted: bool) -> int:
    """Save the best placement beside the target, which stays as it was, and say what is still wrong with it."""
    from halpipe.exporters.native import format_schedule
    from halpipe.models import Status
    from halpipe.pipeline.checked import explain_failure

    output.report(explain_failure(model, scheduled, interrupted=interrupted))
    if target != STDIO:
        best = _place_for_best(target, model)
        write_output(best, format_schedule(scheduled.schedule))
        valid = all(mode.status is Status.VALID for mode in scheduled.schedule.modes)
        what = "what was found so far, not complete" if valid else "best placement so far, not valid"
        output.inform(f"{best}: {what}; {target} was not touched")
        output.inform("--resume continues from here; with a larger --budget if that was spent")
    return Exit.INTERRUPTED if interrupted else Exit.NOT_FOUND


def _place_for_best(target: str, model: TaskModel) -> str:
    """Return a name beside `target`: NAME.best.xml, numbered where that is an input or a file of the user's."""
    path = Path(target)
    suffix = path.suffix or ".xml"
    for number in itertools.count(1):
        best = str(path.with_name(f"{path.stem}.best{f'-{number}' if number > 1 else ''}{suffix}"))
        if not is_input(best) and (not os.path.lexists(best) or _is_unfinished(best, model)):
            return best
    raise AssertionError


def _is_unfinished(file: str, model: TaskModel) -> bool:
    """Return whether a file is what such a search left before; a complete schedule is never replaced."""
    from halpipe.importers.native import parse_schedule
    from halpipe.models import Status

    try:
        schedule = parse_schedule(read_own(file), file)
    except HalpipeError:
        return False
    every = all(mode.status is Status.VALID for mode in schedule.modes)
    return not every or len(schedule.modes) < len(model.modes)
