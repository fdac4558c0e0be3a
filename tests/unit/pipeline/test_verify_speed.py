"""verify stays linear in the parts of a schedule."""

from dataclasses import replace

import pytest

from growth import growth, half_way
from halpipe.models import Interrupt, Job, Part, Split
from halpipe.pipeline.verify import codes, verify
from support import access, chain, model, ms, schedule, task, version

SHORT, LONG, PIECE = ms("0.2ms"), ms("4ms"), ms("0.7ms")
RESUME, INTERRUPT = ms("10us"), ms("1us")


def many_parts(cores=12):
    """On each core a job every millisecond, and one every 10 ms cut into six parts around those."""
    names = [f"c{k}" for k in range(cores)]
    tasks, jobs = [], []
    for core in names:
        split = Split(anywhere=True, max_gaps=9, resume=RESUME)
        slow = version("v", LONG, core, access("m", 0, "0.5ms", "1/100"))
        tasks += [
            task(f"fast-{core}", 1, version("v", SHORT, core)),
            task(f"slow-{core}", 10, replace(slow, split=split), slack=1),
        ]
        jobs += [_job(f"fast-{core}", n, core, ms(n), ms(n) + SHORT + INTERRUPT) for n in range(1000)]
        jobs += [_slow(f"slow-{core}", n, core) for n in range(100)]
    tasks.append(task("rare", 1000, version("v", 1, "spare")))
    jobs.append(_job("rare", 0, "spare", ms(0), ms(1) + INTERRUPT))
    served = (Interrupt(name="tick", distance=ms(50), wcet=INTERRUPT),)
    limits = [chain("c", "fast-c0 slow-c0", reaction=100, age=100)]
    system = model(*tasks, units=" ".join([*names, "spare"]), resources="m", chains=limits)
    system = replace(system, units=tuple(replace(unit, interrupts=served) for unit in system.units))
    return system, schedule(system, 1000, *jobs)


def _job(name, index, core, start, end, parts=()):
    return Job(task=name, index=index, start=start, end=end, version="v", units=(core,), parts=parts)


def _slow(name, index, core):
    parts, done, at = [], ms(0), ms(10 * index) + ms("0.25ms")
    while done < LONG:
        work = min(LONG - done, PIECE)
        length = work + INTERRUPT + (RESUME if parts else ms(0))
        parts.append(Part(start=at, end=at + length, executed_from=done, executed_to=done + work))
        done, at = done + work, at + ms(1)
    return _job(name, index, core, parts[0].start, parts[-1].end, tuple(parts))


def test_the_schedule_is_valid():
    assert {d.code for d in verify(*many_parts(1))} == {codes.PRIORITIES.id}


@pytest.mark.slow  # the rules themselves: test_verify_split
def test_verify_is_linear_in_the_parts():
    def prepare(cores):
        system, plan = many_parts(cores)
        return lambda: verify(system, plan)

    assert growth(prepare, 1, 12) < half_way(12)
