"""Checks of cause-effect chains and of transitions between modes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.durations import ZERO, Duration
from halpipe.core.suggest import few
from halpipe.models import Anchor, Chain
from halpipe.pipeline.validate import codes
from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context, check, place, repeated

if TYPE_CHECKING:
    from collections.abc import Iterator


def _path(chain: Chain) -> str:
    return about(chain=chain.name)


@check("chains", codes.EMPTY_CHAIN, codes.REPEATED_IN_CHAIN)
def check_chain_tasks(context: Context) -> Iterator[Diagnostic]:
    """Every chain lists at least one task; one that is listed twice is pointed out.

    (D) One task makes a chain: its reaction time is one wait for the next job and one execution.
    """
    for chain in context.model.chains:
        at, path = place(chain), _path(chain)
        if not chain.tasks:
            yield codes.EMPTY_CHAIN("lists no task", at=at, path=path, help="list the tasks from cause to effect")
        for name in repeated(chain.tasks):
            help = "list it once, unless the data really passes it again"
            yield codes.REPEATED_IN_CHAIN(f'passes task "{name}" more than once', at=at, path=path, help=help)


@check("chain-modes", codes.CHAIN_NEVER_RUNS, codes.CHAIN_NOT_IN_MODE)
def check_chain_modes(context: Context) -> Iterator[Diagnostic]:
    """All tasks of every chain run together in some mode; modes in which they do not are noted."""
    for chain in context.model.chains:
        known = [name for name in chain.tasks if name in context.tasks]
        if not known or not context.active:
            continue
        absent = {mode.path: [n for n in dict.fromkeys(known) if n not in mode.tasks] for mode in context.active}
        at, path = place(chain), _path(chain)
        if all(absent.values()):
            text = "in no mode do all its tasks run, so it is never checked"
            help = "let its tasks run together in a mode, or remove the chain"
            yield codes.CHAIN_NEVER_RUNS(text, at=at, path=path, help=help)
            continue
        for mode, names in absent.items():
            if names:
                text = f"is not checked in {mode}, where {few(names)} {'do' if len(names) > 1 else 'does'} not run"
                help = "nothing to do, unless the chain matters in that mode"
                yield codes.CHAIN_NOT_IN_MODE(text, at=at, path=path, help=help)


# ------------------------------------------------------------------------------------------------ limits


@check("chain-limits", codes.CHAIN_LIMIT_TOO_LOW)
def check_limits(context: Context) -> Iterator[Diagnostic]:
    """In every mode the limits of a chain are at least the sum of its tasks' smallest WCETs, for the reaction time
    plus the period of its first task.

    Each job of a chain starts at or after the end of the one before, so both latencies are at least the sum of the
    smallest WCETs. The N starts of a periodic first task are on average a period apart round the hyperperiod, so some
    stimulus waits at least a period for the job that sees it, and the reaction time is at least that much longer.
    """
    for chain in context.model.chains:
        for mode in context.active:
            if chain.tasks and all(name in mode.tasks for name in chain.tasks):
                yield from _limits(chain, mode)


def _limits(chain: Chain, mode: ActiveMode) -> Iterator[Diagnostic]:
    work = Duration(sum(least.ns for least in _least(chain, mode)))
    first = mode.tasks[chain.tasks[0]]
    wait = first.task.period if first.is_periodic and first.task.period is not None else ZERO
    bounds = (
        ("latency", chain.max_latency, work, f"the WCETs and LETs {work}"),
        ("reaction time", chain.max_reaction, work + wait, f"the period {wait} and the WCETs {work}"),
        ("data age", chain.max_age, work, f"the WCETs {work}"),
    )
    for what, limit, least, why in bounds:
        if limit is not None and limit < least:
            text = f"limits its {what} to {limit}, but in {mode.path} {why} of its tasks make at least {least}"
            help = f"raise the limit to at least {least}, or shorten the tasks"
            yield codes.CHAIN_LIMIT_TOO_LOW(text, at=place(chain), path=_path(chain), help=help)


def _least(chain: Chain, mode: ActiveMode) -> Iterator[Duration]:
    """Yield what each job adds at least: a LET where its data are read and written, else its WCET, or nothing."""
    last = len(chain.tasks) - 1
    for number, name in enumerate(chain.tasks):
        active = mode.tasks[name]
        begin = chain.anchor if number == 0 else None
        end = chain.to if number == last else None
        if begin is Anchor.END or end is Anchor.START:
            yield ZERO
        elif active.task.let is not None and begin in (None, Anchor.RELEASE) and end is None:
            yield active.task.let
        else:
            yield _shortest(active)


def _shortest(active: ActiveTask) -> Duration:
    return min((v.wcet for v in active.versions if v.wcet is not None), default=ZERO)


# ------------------------------------------------------------------------------------------------ transitions


@check("transitions", codes.SELF_TRANSITION, codes.DUPLICATE_TRANSITION)
def check_transitions(context: Context) -> Iterator[Diagnostic]:
    """Every transition leads from one mode to another and is listed once."""
    seen: set[tuple[str, str]] = set()
    for transition in context.model.transitions:
        pair = (transition.source, transition.target)
        at, path = place(transition), about(transition=(pair[0], pair[1]))
        if pair[0] == pair[1]:
            yield codes.SELF_TRANSITION(
                "leads nowhere", at=at, path=path, help="remove it, or correct one of the modes"
            )
        elif pair in seen:
            yield codes.DUPLICATE_TRANSITION("is listed twice", at=at, path=path, help="keep one of the two")
        seen.add(pair)
