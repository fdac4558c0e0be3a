"""Leftovers in scratchpads: a second run in which every job finds other bytes wherever nothing was put for it.

Scratchpads are not cleared between jobs: that would take longer than most jobs. A job finds in its stack and in
variables without a value what another one left; every byte of it that leaves a core is reported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.run.injection import Saboteur
from halpipe.models import AccessKind

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.riscv.judge.comparison import Seen
    from halpipe.deploy.riscv.run.expectation import Image
    from halpipe.deploy.riscv.run.observation import Execution
    from halpipe.deploy.riscv.target import Site

_OTHER = bytes(1 + 37 * i % 251 for i in range(251))
"""What lies everywhere: no run of the same byte, and no multiple of a word, so that it is no leftover by accident."""


class Rubbish(Saboteur):
    """Overwrites the data scratchpad of a job that begins, but for what was loaded, read or cleared for it."""

    def __init__(self, site: Site, images: Collection[Image]) -> None:
        super().__init__(site, (), ())
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
    findings = Findings()
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
                findings.add(codes.LEFTOVER(message, at=job.at, path=one.planned.path, help=help))
    yield from findings.items
