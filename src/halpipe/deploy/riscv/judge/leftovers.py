"""Runs in another state of the memory: rubbish in scratchpads between jobs, and a start without preparation."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, named
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.conditions import REPORT
from halpipe.deploy.riscv.run.cosimulation import CoSimulation
from halpipe.deploy.riscv.run.drivers import Board, Plant
from halpipe.deploy.riscv.run.injection import Injection, Saboteur
from halpipe.deploy.riscv.run.recording import Word
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from halpipe.core.durations import Duration
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.board.machine import Budget
    from halpipe.deploy.riscv.judge.comparison import Seen
    from halpipe.deploy.riscv.run.expectation import Image, PlannedJob
    from halpipe.deploy.riscv.run.observation import Execution
    from halpipe.deploy.riscv.target import Site

_OTHER = bytes(1 + 37 * i % 251 for i in range(251))
"""What lies everywhere: no run of the same byte, and no multiple of a word, so that it is no leftover by accident."""


class Rubbish(Saboteur):
    """Overwrites the data scratchpad of a job that begins, but for what was loaded, read or cleared for it."""

    def __init__(
        self, images: Collection[Image], site: Site, jobs: Sequence[PlannedJob], injections: Sequence[Injection]
    ) -> None:
        super().__init__(site, jobs, injections)
        self._images = images

    def code(self, execution: Execution) -> bytes:
        """Put other bytes under a job; it executes what it should."""
        image = execution.image
        if image is not None and execution.function == image.site.entries[0]:
            unit = self._site.unit_of(execution.hart)
            # A job of several functions may be suspended: its variables lie behind those of others.
            kept = [part for other in self._images if other is not image for part in _suspended(other, execution.hart)]
            at = unit.dspm.base
            for low, size in sorted([*execution.given, *kept, (unit.reserved, 0)]):
                if at < low <= unit.reserved:
                    self.memory.write(at, (_OTHER * ((low - at) // len(_OTHER) + 1))[: low - at])
                at = max(at, low + size) if low <= unit.reserved else at
        return b""


def _suspended(image: Image, hart: int) -> Iterator[tuple[int, int]]:
    """Yield what a job of several functions has in the scratchpads of a core."""
    if image.hart == hart and len(image.site.entries) > 1:
        yield from ((segment.target, len(segment.data)) for segment in image.program.segments)
        yield image.site.bss.base, image.site.bss.size
        yield from ((area.base, area.size) for area in image.site.symbols.values())


def leftovers(plain: Iterable[Seen], other: Iterable[Seen]) -> Iterator[Diagnostic]:
    """Yield which bytes that leave a core differ in two runs, for jobs that read the same in both."""
    known = set()
    for one, two in zip(plain, other, strict=True):
        moved = list(zip(one.planned.transfers, one.transfers, two.transfers, strict=True))
        if any(a and b and a.data != b.data for planned, a, b in moved if planned.kind is not AccessKind.WRITE):
            continue
        job = one.planned.job
        for planned, a, b in moved:
            key = (job.task, job.version, planned.what)
            if planned.kind is AccessKind.WRITE and a and b and a.data != b.data and key not in known:
                known.add(key)
                places = [i for i, (x, y) in enumerate(zip(a.data, b.data, strict=True)) if x != y]
                message = (
                    f"{len(places)} of {planned.size} bytes that it writes into {planned.what} depend on what the "
                )
                message += f"scratchpad held before, the first of them byte {places[0]}"
                help = "give every byte of the variable a value in each job, and every local variable before it is read"
                yield codes.LEFTOVER(message, at=job.at, path=one.planned.path, help=help)


class _Witness(Plant):
    """Looks at the buffers when the first table begins, and ends the run then."""

    def __init__(self, buffers: list[str]) -> None:
        self.buffers = buffers
        self.first = ""
        self.full: list[str] = []

    def cycle(self, board: Board, now: Duration, cycle: int, table: str) -> None:
        """Note what is there."""
        self.first = table
        self.full = [name for name in self.buffers if any(board.read(name))]
        board.stop()


def cold_start(target: Target, budget: Budget, limit: Duration) -> Iterator[Diagnostic]:
    """Yield what a bundle does otherwise than docs/reference/riscv-bundle.md when it starts by itself."""
    witness = _Witness([])
    simulation = CoSimulation(target, plant=witness, budget=budget)
    witness.buffers = list(simulation.site.buffers)
    run = simulation.run(limit, is_cold=True)
    first = target.schedule.modes[0].name
    if witness.first != first:
        yield _begins_with(witness, first, "after a cold start")
    if run.word(Word.FAULTS) or run.word(Word.REFUSED):
        message = "the control block counts what the memory held before a cold start"
        yield codes.COLD_START(message, path="control", help=REPORT)
    found, wanted = [run.word(word) for word in range(1, 9)], [0, 0, 0, 0, 0, max(run.site.timebase // 1000, 1), 0, 0]
    if found != wanted or run.recorder.states != [0, 1]:
        message = f"words 1 to 8 are {found} and the states {run.recorder.states} after a cold start; they have to be "
        yield codes.COLD_START(f"{message}{wanted} and [0, 1]", path="control", help=REPORT)
    for name in witness.full:
        message = "holds after a cold start what the memory held before"
        yield codes.COLD_START(message, path=named("buffer", name), help=REPORT)
    witness = _Witness([])
    simulation = CoSimulation(target, plant=witness, budget=budget)
    simulation.misdirect()
    simulation.run(limit)
    if witness.first != first:
        yield _begins_with(witness, first, "where the first mode is stated as one behind the last")


def _begins_with(witness: _Witness, first: str, when: str) -> Diagnostic:
    does = f'"{witness.first}" begins' if witness.first else "no table begins"
    return codes.COLD_START(f'{when} {does}; it has to be "{first}"', help=REPORT)
