"""verify stays linear in the parts of a schedule."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from growth import growth, half_way
from halpipe.models import Binding, Interrupt, Job, Part, Split
from halpipe.pipeline.verify import codes, verify
from halpipe.pipeline.verify.jobs import SYSTEM_BINDING, Tables
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


def test_the_rule_of_bound_tasks_is_linear_in_them_and_in_the_jobs_of_tables():
    def prepare(count):
        free = [task(f"t{n}", 1000, version("v", 1, "u")) for n in range(count)]
        system = model(*(replace(each, binding=Binding.SYSTEM) for each in free), units="u")
        jobs = [SimpleNamespace(job=_job(each.name, 0, "u", ms(0), ms(1))) for each in free]
        everything = Tables(system, (), (SimpleNamespace(jobs=jobs),))
        return lambda: list(SYSTEM_BINDING.check(everything))

    assert growth(prepare, 200, 3_200) < half_way(16)
