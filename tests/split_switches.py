"""Two modes on one unit, and the tables between: jobs with gaps in progress over a switch, and in the table of one.

`kept` is cut at 1 and 3 ms, and runs in both modes; `brief` runs in the gaps. Other tests take versions of their own.
"""

from dataclasses import replace

from halpipe.models import ModeSchedule, Schedule, Split, Status, TransitionTable
from halpipe.pipeline.parts import job_of
from support import access, job, mode, model, ms, task, version

POINTS = Split(points=(ms(1), ms(3)), resume=ms("0.1ms"))
SPANS = ((ms(0), ms(1)), (ms(1), ms(3)), (ms(3), ms(4)))


def system(kept=None, brief=None, split=POINTS):
    """Tasks `kept` (4 ms of 20) and `brief` (1 ms of 5) in modes "one" and "two", with switches both ways."""
    kept = kept or version("v", 4, "u1", access("mem", 1, 2, "1/2"), access("mem", 3, 4, "1/3"))
    brief = brief or version("v", 1, "u1", access("mem", 0, 1, "1/2"))
    tasks = [task("kept", 20, replace(kept, split=split), slack=1), task("brief", 5, brief, slack=1)]
    modes = [mode(name, tasks) for name in ("one", "two")]
    return model(*tasks, resources="mem", modes=modes, transitions=[("one", "two", 20), ("two", "one", 20)])


def kept(owner, *starts, index=0):
    """A job of `kept` whose parts start at these instants in milliseconds."""
    spans = [(ms(at), *span) for at, span in zip(starts, SPANS, strict=True)]
    return job_of("kept", index, owner.task("kept").versions[0], ("u1",), spans, ())


def brief(owner, *starts):
    """Jobs of `brief` at these instants in milliseconds."""
    return tuple(job(owner, "brief", index, at, "u1") for index, at in enumerate(starts))


def plan(owner):
    """What is valid for the system.

    A job of "kept" is in progress at the end of "one": it goes on 2 and 12 ms after it, across the table of 5 ms. The
    table of 10 ms back has a job of "kept" of its own, which goes on 1 ms after its end.
    """
    jobs = {
        "one": (kept(owner, 17, 22, 32), *brief(owner, 0, 5, 10, 15)),
        "two": (kept(owner, 11, 13, 17), *brief(owner, 0, 5, 10, "15.5ms")),
    }
    modes = tuple(
        ModeSchedule(name=name, hyperperiod=ms(20), status=Status.VALID, jobs=found) for name, found in jobs.items()
    )
    tables = (
        switch("one", "two", 5, *brief(owner, 0)),
        switch("two", "one", 10, kept(owner, 1, 3, 11), *brief(owner, 0, "5.5ms")),
    )
    return Schedule(model=owner.name, model_sha256="", modes=modes, transitions=tables)


def switch(source, target, length, *jobs):
    """A table between two modes."""
    return TransitionTable(
        source=source, target=target, length=ms(length), worst_latency=ms(20 + length), status=Status.VALID, jobs=jobs
    )
