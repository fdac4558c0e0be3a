"""A search as the user sees it: progress, Ctrl-C, the time limit, and where its result is saved."""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe import __version__
from halpipe.cli import output
from halpipe.diagnostics import Exit
from halpipe.files import STDIO, write_output

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import FrameType

    from rich.progress import Progress

    from halpipe.models import TaskModel
    from halpipe.pipeline.checkpoint import Checkpoint
    from halpipe.pipeline.schedule import Scheduled, SearchOptions

SLOW_START = 1.5
"""Seconds without a sign of the kernel after which its compilation is announced."""


class Watch:
    """Watches one search: shows its progress and stops it on Ctrl-C or at the time limit."""

    def __init__(self, time_limit: float) -> None:
        self.interrupted = False
        self._began = time.monotonic()
        self._deadline = self._began + time_limit if time_limit else None
        self._progress: Progress | None = None
        self._bars: dict[str, int] = {}
        self._announcement = threading.Timer(SLOW_START, self._announce)
        self._announcement.daemon = True

    def __enter__(self) -> Watch:
        self._announcement.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._announcement.cancel()
        if self._progress is not None:
            self._progress.stop()

    def interrupt(self, signum: int, frame: FrameType | None) -> None:
        """Stop at the next slice; a second Ctrl-C stops at once."""
        if self.interrupted:
            raise KeyboardInterrupt
        self.interrupted = True
        output.say("stopping; the best placement so far will be saved")

    def on_progress(self, mode: str, moves: int, budget: int, best: int) -> bool:
        """Show how far the search is; return whether it may go on."""
        self._announcement.cancel()
        if not output.Settings.quiet and sys.stderr.isatty():
            self._show(mode, moves, budget, best)
        return not self.interrupted and (self._deadline is None or time.monotonic() < self._deadline)

    def _announce(self) -> None:
        output.inform("compiling the search kernel; this happens once per installation and takes about 20 s")

    def _show(self, mode: str, moves: int, budget: int, best: int) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        if self._progress is None:
            columns = (
                TextColumn("{task.description}"),
                BarColumn(bar_width=20),
                TextColumn("{task.fields[state]}"),
                TimeElapsedColumn(),
            )
            self._progress = Progress(*columns, console=Console(stderr=True), transient=True)
            self._progress.start()
        if mode not in self._bars:
            self._bars[mode] = self._progress.add_task(f"mode {mode}", total=budget, state="")
        state = "constructing" if best < 0 else f"{moves} moves, best cost {best}"
        self._progress.update(self._bars[mode], completed=moves, state=state)  # type: ignore[arg-type]


@contextmanager
def _handling(watch: Watch) -> Iterator[None]:
    before = signal.signal(signal.SIGINT, watch.interrupt), signal.signal(signal.SIGTERM, watch.interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before[0])
        signal.signal(signal.SIGTERM, before[1])


def find_schedule(
    model: TaskModel, options: SearchOptions, target: str, time_limit: float = 0, *, resume: bool = False
) -> int:
    """Search, write what was found, say how it went, and return the exit code."""
    from halpipe.exporters.native import format_schedule
    from halpipe.pipeline.stages import schedule_model

    began = time.monotonic()
    checkpoint = _checkpoint(model, options, target)
    if checkpoint is not None:
        if resume:
            checkpoint.load()
        options = replace(options, keeper=checkpoint)
    with Watch(time_limit) as watch, _handling(watch):
        scheduled = schedule_model(model, options, watch.on_progress)
    output.report(scheduled.diagnostics)
    if scheduled.is_complete:
        write_output(target, format_schedule(scheduled.schedule))
        if checkpoint is not None:
            checkpoint.remove()
        _summarise(scheduled, target, time.monotonic() - began)
        return Exit.FINDINGS if any(d.is_error for d in scheduled.diagnostics) else Exit.OK
    if checkpoint is not None:
        checkpoint.write()
    return _save_best(model, scheduled, target, interrupted=watch.interrupted)


def _checkpoint(model: TaskModel, options: SearchOptions, target: str) -> Checkpoint | None:
    """Return where the search is kept on its way: beside its target, as NAME.resume."""
    from halpipe.pipeline.checkpoint import Checkpoint, fingerprint

    if target == STDIO or (os.path.exists(target) and not os.path.isfile(target)):
        return None
    path = Path(target)
    identity = fingerprint(model, options, __version__)
    return Checkpoint(str(path.with_name(f"{path.stem}.resume")), identity, time.monotonic)


def _summarise(scheduled: Scheduled, target: str, seconds: float) -> None:
    schedule = scheduled.schedule
    for mode in schedule.modes:
        output.inform(f"mode {mode.name}: {len(mode.jobs)} jobs in {mode.hyperperiod}, valid")
    for table in schedule.transitions:
        output.inform(
            f"switch {table.source} to {table.target}: length {table.length}, worst latency {table.worst_latency}"
        )
    jobs = sum(len(mode.jobs) for mode in schedule.modes)
    output.inform(
        f"{target}: {len(schedule.modes)} modes, {jobs} jobs, verified; {scheduled.moves} moves in {seconds:.2f} s"
    )


def _save_best(model: TaskModel, scheduled: Scheduled, target: str, *, interrupted: bool) -> int:
    """Save the best placement beside the target, which stays as it was, and say what is still wrong with it."""
    from halpipe.exporters.native import format_schedule
    from halpipe.pipeline.stages import explain_failure

    output.report(explain_failure(model, scheduled, interrupted=interrupted))
    if target != STDIO:
        path = Path(target)
        best = str(path.with_name(f"{path.stem}.best{path.suffix or '.xml'}"))
        write_output(best, format_schedule(scheduled.schedule))
        output.inform(f"{best}: best placement so far, not valid; {target} was not touched")
        output.inform("--resume goes on from here; with a larger --budget if that was spent")
    return Exit.INTERRUPTED if interrupted else Exit.NOT_FOUND
