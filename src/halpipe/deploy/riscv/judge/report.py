"""Report and exit of a run, as terminals and emulators get them, compared with the memory that they are made of."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING, Any

from halpipe.core.durations import milliseconds, seconds
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge.conditions import REPORT, is_confined
from halpipe.deploy.riscv.judge.truth import ends_in_time
from halpipe.deploy.riscv.run.cosimulation import EXECUTIONS, CoSimulation, plan
from halpipe.deploy.riscv.run.injection import CODES, Injection, Saboteur, code_of, victim
from halpipe.deploy.riscv.run.recording import CALIBRATION, Flag, Memory, Word
from halpipe.deploy.riscv.run.sequence import played_tables
from halpipe.deploy.riscv.target import CONTROL_SIZE, Ring, Site, read_site

if TYPE_CHECKING:
    from collections.abc import Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.deploy.base import Target
    from halpipe.deploy.riscv.board.machine import Budget

SEMIHOSTING, FINISHER = 1, 2
_NO_CORE, _TRAPPED, _ILLEGAL = 3, 4, 2
_PATIENCE = milliseconds(10)
"""How long the runtime waits for a core at least."""

_LONGEST = seconds(Fraction(1))
"""Until when a run has come to its end, from the end of its table on."""


def printed(memory: Memory, site: Site, *, calibrates: bool) -> str:
    """Return what the runtime has to print of the records that are left."""

    def words(name: str, at: int, size: int) -> str:
        return " ".join([name, *(f"{memory.word(at + i):x}" for i in range(0, size, 8))])

    def records(name: str, ring: Ring, counter: int) -> list[str]:
        count = memory.word(site.control + 8 * counter)
        kept = range(max(count - ring.capacity, 0), count)
        return [words(name, ring.base + i % ring.capacity * ring.record, ring.record) for i in kept]

    lines = [words("control", site.control, CONTROL_SIZE), *records("trace", site.trace, Word.TRACED)]
    lines += records("fault", site.faults, Word.FAULTS)
    at = site.control + CALIBRATION
    lines += [words("calibration", at + 8 + 24 * i, 24) for i in range(memory.word(at) if calibrates else 0)]
    return "\n".join([*lines, "end", ""])


def wrong_reports(target: Target, budget: Budget) -> Iterator[Diagnostic]:
    """Yield where a run without faults and one with a fault print or end otherwise than their memory says."""
    site = read_site(target.bundle)
    first = min(target.schedule.modes, key=lambda mode: (not mode.jobs, len(mode.jobs))).name
    tables = played_tables(target.schedule, first, (), 1, site.tick)
    jobs = [job for job in plan(target, site, tables) if victim(CODES[0], job)]
    kind = next((kind for kind in CODES[2:] if code_of(kind, site, site.units[0])), None)
    failing = [Injection(kind, 0, jobs[0].row)] if jobs and kind else []
    ways = [SEMIHOSTING] + [FINISHER] * bool(site.finisher)
    for leaves, injections in [*((way, []) for way in ways), (ways[-1], failing)]:
        saboteur = Saboteur(site, jobs, injections) if injections else None
        plays: dict[str, Any] = {"cycles": 1, "first": first, "execution": EXECUTIONS[not injections], "health": False}
        simulation = CoSimulation(target, budget=budget, saboteur=saboteur, **plays)
        simulation.disturb()
        run = simulation.run(tables[0].length + _LONGEST, leaves=leaves)
        if run.exhausted:
            yield codes.SPENT(f"{run.exhausted}, in the report at its end", help=REPORT)
            continue
        yield from ends_in_time(run)
        wanted = printed(run.memory, site, calibrates=simulation.calibrates)
        found = run.uart.decode("ascii", "replace")
        if found != wanted:
            place = next(i for i, (a, b) in enumerate(zip(found + "\0", wanted + "\0", strict=False)) if a != b)
            message = (
                f"it prints {found[place : place + 30]!r} for {wanted[place : place + 30]!r}, at character {place}"
            )
            yield codes.TRACE_DISAGREES(message, path="report", help=REPORT)
        if run.status != bool(run.word(Word.FAULTS)):
            message = f"it ends with status {run.status} where {run.word(Word.FAULTS)} jobs were abandoned"
            yield codes.TRACE_DISAGREES(message, path="exit", help=REPORT)
    yield from _wrong_states(target, budget)


def _overdue(target: Target, budget: Budget) -> Iterator[Diagnostic]:
    """Yield what monitors leave after a job whose time was over before it began: the next ones are as all others."""
    first = min(target.schedule.modes, key=lambda mode: (not mode.jobs, len(mode.jobs)))
    simulation = CoSimulation(target, budget=budget, cycles=3, first=first.name, health=False)
    simulation.overtake()
    run = simulation.run(3 * first.hyperperiod + _LONGEST)
    yield from is_confined(run)
    flags = {entry.flags for entry in run.recording.abandoned}
    if flags != {Flag.OVERRUN} and first.jobs and not simulation.calibrates:
        message = (
            f"it ends in state {run.state} with flags {sorted(flags)} of jobs whose time was over before they began"
        )
        yield codes.TRACE_DISAGREES(message, path="faults", help=REPORT)


def _wrong_states(target: Target, budget: Budget) -> Iterator[Diagnostic]:
    """Yield where the control block does not say that the management core trapped, or that cores lack user mode."""
    simulation = CoSimulation(target, budget=budget)
    address = simulation.break_down()
    run = simulation.run(_LONGEST)
    seen = run.state, run.word(Word.CAUSE), run.word(Word.EPC)
    if seen != (_TRAPPED, _ILLEGAL, address):
        message = f"state, cause and pc are {seen} after an illegal instruction of the management core at {address:#x}"
        yield codes.TRACE_DISAGREES(message, path="state", help=REPORT)
    yield from _overdue(target, budget)
    for what, spoil in (("has no user mode", CoSimulation.withdraw_user_mode), ("traps", CoSimulation.break_monitor)):
        simulation = CoSimulation(target, budget=budget)
        spoil(simulation)
        run = simulation.run(_LONGEST, leaves=SEMIHOSTING)
        if (run.state, run.status) != (_NO_CORE, 1) or run.duration < _PATIENCE:
            message = f"it ends in state {run.state} with status {run.status} after {run.duration} with a core that "
            message += f"{what}; it has to end in state {_NO_CORE} with status 1 after {_PATIENCE} or more"
            yield codes.TRACE_DISAGREES(message, path="state", help=REPORT)
