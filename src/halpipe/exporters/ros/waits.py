"""Jobs of a package that wait for their messages: options that cannot be, and what verify has to hold for late starts.

A job that waits begins anywhere between its instant and the end of its wait, and ends as if it had begun at once, since
its WCET contains the wait.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Findings, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.ros.codes import NO_EVENT, NO_TIME_LEFT
from halpipe.models import Access, Anchor, Chain, Precedence, TaskModel, Version

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator, Mapping, Sequence

    from halpipe.exporters.ros import RosOptions

_LIMITS = ("max_latency", "max_reaction", "max_age")


def with_late_starts(model: TaskModel, waits: Mapping[str, Duration]) -> TaskModel:
    """Return a model whose valid schedules hold wherever within its wait each job begins.

    What counts from a start is narrowed by the wait: a window of the task loses its end, one of its successors its
    beginning. An access phase lasts from its earliest begin to its latest end.
    """

    def narrowed(row: Precedence, wait: Duration) -> Precedence:
        late = ZERO if row.anchor in (Anchor.END, Anchor.RELEASE) else waits.get(row.task, ZERO)
        own = wait if row.to is Anchor.START else ZERO
        return replace(row, min=row.min + late, max=row.max - own)  # with min above max nothing lies in it

    def changed(version: Version, wait: Duration) -> Version:
        rows = tuple(narrowed(row, wait) for row in version.precedences)
        return replace(version, precedences=rows, accesses=tuple(_lengthened(version, wait)))

    tasks = tuple(
        replace(task, versions=tuple(changed(version, waits.get(task.name, ZERO)) for version in task.versions))
        for task in model.tasks
    )
    chains = tuple(_narrowed_chain(chain, waits) for chain in model.chains)
    return replace(model, tasks=tasks, chains=chains).read_from(model.digest)


def _narrowed_chain(chain: Chain, waits: Mapping[str, Duration]) -> Chain:
    """Return the chain with less time to the start of its last task; `refuse_waits` refuses a wait beyond a limit."""
    wait = waits.get(chain.tasks[-1], ZERO) if chain.to is Anchor.START else ZERO
    stated = {name: limit for name in _LIMITS if (limit := getattr(chain, name)) is not None}
    return replace(chain, **{name: limit - min(wait, limit) for name, limit in stated.items()})


def _lengthened(version: Version, wait: Duration) -> Iterator[Access]:
    """Yield the phases of a version as long as they may last; where two of a resource meet, the larger bound counts."""
    if not wait or version.wcet is None:
        yield from version.accesses
        return
    end = version.wcet
    for resource in dict.fromkeys(access.resource for access in version.accesses):
        own = [replace(a, end=min(a.end + wait, end)) for a in version.accesses if a.resource == resource]
        for start, stop in pairwise(sorted({instant for a in own for instant in (a.start, a.end)})):
            if during := [a for a in own if a.start <= start and stop <= a.end]:
                most = max(during, key=lambda a: a.bound)
                yield replace(most, start=start, end=stop, transfers=())


def refuse_waits(
    model: TaskModel, tasks: Collection[str], modes: Sequence[str], options: RosOptions, findings: Findings
) -> None:
    """Report waits and modes for missing messages that cannot be as stated."""
    waits, missing = options.wait or {}, options.missing or {}
    for task in dict.fromkeys([*waits, *missing]):
        binding = (options.bindings or {}).get(task)
        if task not in tasks:
            help = did_you_mean(task, tasks, "name a task of the schedule")
            findings.add(NO_EVENT("the schedule has no jobs of it", path=about(task=task), help=help))
        elif binding is not None and binding.kind != "subscription":
            help = "name tasks that are subscriptions"
            findings.add(NO_EVENT("its callback is a timer", at=model.task(task).at, path=about(task=task), help=help))
        elif task in waits and (least := min(v.wcet or waits[task] for v in model.task(task).versions)) <= waits[task]:
            text = f"the wait is {waits[task]}, and its shortest WCET {least}"
            help = f"add {waits[task]} to the WCET, which contains the wait, and schedule again"
            findings.add(NO_EVENT(text, at=model.task(task).at, path=about(task=task), help=help))
        elif task in waits and (short := _shorter_limit(model, task, waits[task])) is not None:
            help = f"wait shorter, or let the chain count to the end of {task}"
            text = f'chain "{short.name}" ends at its start, and a limit of it is less than the wait of {waits[task]}'
            findings.add(NO_EVENT(text, at=short.at, path=about(task=task), help=help))
        elif task in missing and missing[task] not in modes:
            help = did_you_mean(missing[task], modes, "the modes are " + ", ".join(modes))
            findings.add(NO_EVENT(f'there is no mode "{missing[task]}"', path=about(task=task), help=help))


def wait_remarks(model: TaskModel, options: RosOptions) -> list[Diagnostic]:
    """Return a warning for each task that was measured to take longer than its WCET leaves beside its wait."""
    found = []
    for task, wait in (options.wait or {}).items():
        binding = (options.bindings or {}).get(task)
        known = [version.wcet for version in model.task(task).versions if version.wcet is not None]
        longest = Duration(binding.longest) if binding is not None else ZERO
        if known and longest + wait > min(known):
            text = f"a job took {longest}, and {min(known) - wait} of the WCET of {min(known)} is left after the wait"
            help = f"make the WCET {longest + wait} or longer and schedule again, or wait shorter"
            found.append(NO_TIME_LEFT(text, at=model.task(task).at, path=about(task=task), help=help))
    return found


def _shorter_limit(model: TaskModel, task: str, wait: Duration) -> Chain | None:
    """Return a chain to the start of a task with a limit below its wait."""
    own = (chain for chain in model.chains if chain.tasks[-1] == task and chain.to is Anchor.START)
    limits = ((chain, getattr(chain, name)) for chain in own for name in _LIMITS)
    return next((chain for chain, limit in limits if limit is not None and limit < wait), None)
