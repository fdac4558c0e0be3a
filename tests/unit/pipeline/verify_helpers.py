"""What the tests of verify's rules share."""

from dataclasses import replace

from halpipe.core.diagnostics import render_text
from halpipe.core.durations import ZERO
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from halpipe.pipeline.verify import verify
from support import ms


def errors(system, plan):
    """The findings that make the schedule invalid, as printed on their first line."""
    found = [d for d in verify(system, plan) if d.is_error]
    assert all(d.subjects or d.path == "schedule" for d in found), "each says what it is about"
    return [render_text(d).splitlines()[0] for d in found]


def codes_found(system, plan):
    return [d.code for d in verify(system, plan)]


def only(system, plan, code):
    """Return the one message of the one finding, which must be of `code`."""
    found = [d for d in verify(system, plan) if d.is_error]
    assert [d.code for d in found] == [code.id], errors(system, plan)
    assert found[0].help
    return f"{found[0].path}: {found[0].message}"


def messages(system, plan, code):
    return [f"{d.path}: {d.message}" for d in verify(system, plan) if d.code == code.id]


def table(name, hyperperiod, *jobs, **more):
    return ModeSchedule(name=name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs, **more)


def plan_of(system, *tables, transitions=()):
    return Schedule(model=system.name, model_sha256=system.digest, modes=tables, transitions=transitions)


def switch(plan, length, *jobs, source="one", target="two", status=Status.VALID):
    """Add the table of a switch, with the worst latency that follows."""
    wait = plan.mode(source).hyperperiod
    given = TransitionTable(
        source=source,
        target=target,
        length=ms(length) or ZERO,
        worst_latency=wait + (ms(length) or ZERO),
        status=status,
        jobs=jobs,
    )
    return replace(plan, transitions=(*plan.transitions, given))
