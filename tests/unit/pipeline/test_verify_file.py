"""What verify says about the schedule file as a whole, and about models that give "valid" no meaning."""

from dataclasses import replace
from fractions import Fraction
from types import SimpleNamespace

import pytest
from verify_helpers import codes_found, errors, messages, only, plan_of, switch, table

from halpipe.core.diagnostics import Location
from halpipe.core.durations import Duration
from halpipe.models import Run, Schedule, Status
from halpipe.pipeline.verify import RULES, codes, tables, verify
from support import access, after, chain, job, mode, model, ms, schedule, task, version


def simple(**changes):
    return model(task("a", 10, version("v", 4)), **changes)


def plan(system, **changes):
    return replace(schedule(system, 10, job(system, "a", 0, 0, "u1")), **changes)


def test_a_valid_schedule_has_no_findings():
    assert verify(simple(), plan(simple())) == ()


def test_schedule_of_another_model():
    assert '"other", not for "m"' in only(simple(), plan(simple(), model="other"), codes.WRONG_MODEL)


def test_hash_counts_only_where_both_sides_have_one():
    hashed = simple().read_from("a" * 64)
    assert "b" * 64 in only(hashed, plan(hashed, model_sha256="b" * 64), codes.MODEL_CHANGED)
    assert not errors(hashed, plan(hashed, model_sha256=""))
    assert not errors(simple(), plan(simple(), model_sha256="b" * 64))


def test_tables_of_unknown_missing_and_repeated_modes():
    system = simple()
    good = plan(system).modes[0]
    assert 'modes: "all"' in str(verify(system, plan(system, modes=(good, replace(good, name="no")))))
    assert 'mode "no"' in only(system, plan(system, modes=(good, replace(good, name="no"))), codes.UNKNOWN_MODE)
    assert only(system, plan(system, modes=(good, good)), codes.REPEATED_TABLE).startswith('mode "all"')
    assert only(system, plan(system, modes=()), codes.MISSING_MODE).startswith('mode "all"')


def test_a_mode_that_was_not_found_is_an_error_and_its_best_attempt_is_checked():
    system = simple()
    attempt = replace(plan(system).modes[0], status=Status.NOT_FOUND)
    only(system, plan(system, modes=(attempt,)), codes.MODE_NOT_FOUND)
    only(system, plan(system, modes=(replace(attempt, jobs=()),)), codes.MODE_NOT_FOUND)
    late = replace(attempt, jobs=(replace(attempt.jobs[0], units=("u2",)),))
    assert set(codes_found(system, plan(system, modes=(late,)))) == {codes.MODE_NOT_FOUND.id, codes.WRONG_UNIT.id}


def test_hyperperiod_is_the_least_common_multiple():
    system = model(task("a", "1/30s", version("v", 1)), task("b", 25, version("v", 1, "u2")), units="u1 u2")
    jobs = [job(system, "a", k, Duration.parse(f"{100 * k}/3ms"), "u1") for k in range(3)]
    jobs += [job(system, "b", k, 25 * k, "u2") for k in range(4)]
    assert not errors(system, schedule(system, 100, *jobs))
    text = only(system, schedule(system, 200, *jobs), codes.WRONG_HYPERPERIOD)
    assert "200ms" in text
    assert "100ms" in text


def test_jobs_of_unknown_and_foreign_tasks():
    system = simple(modes=None)
    other = task("b", 10, version("v", 1))
    wider = replace(system, tasks=(*system.tasks, other))
    good = plan(system).modes[0].jobs[0]
    stranger = replace(good, task="b", start=ms(5), end=ms(6))
    found = plan(system, modes=(table("all", 10, good, stranger),))
    assert 'task "b" job 0' in only(system, found, codes.UNKNOWN_TASK)
    assert 'does not run in mode "all"' in only(wider, found, codes.NOT_IN_MODE)


@pytest.mark.parametrize("start", [Duration(-1), ms(10), ms(1000)])
def test_start_must_lie_in_the_hyperperiod(start):
    system = simple()
    good = plan(system).modes[0].jobs[0]
    moved = replace(good, start=start, end=start + ms(4))
    assert "outside [0, 10ms)" in only(system, plan(system, modes=(table("all", 10, moved),)), codes.BAD_START)


def test_end_is_start_plus_wcet_and_not_reduced():
    system = simple()
    jobs = plan(system).modes[0].jobs
    wrapped = replace(jobs[0], start=ms(8), end=ms(12))
    assert not errors(system, plan(system, modes=(table("all", 10, wrapped),)))
    wrong = plan(system, modes=(table("all", 10, replace(wrapped, end=ms(2))),))
    assert "ends at 2ms, but its start 8ms and WCET 4ms make 12ms" in only(system, wrong, codes.WRONG_END)


def test_findings_point_to_the_job_in_the_file():
    system = simple()
    here = Location("plan.xml", 7)
    bad = replace(plan(system).modes[0].jobs[0], units=("u9",), at=here)
    (found,) = verify(system, plan(system, modes=(table("all", 10, bad),)))
    assert found.at == here


def test_times_finer_than_can_be_compared_are_refused():
    system = simple()
    primes = [p for p in range(3, 6000, 2) if all(p % q for q in range(3, int(p**0.5) + 1, 2))]
    jobs = [job(system, "a", k, Duration(Fraction(1, p)), "u1") for k, p in enumerate(primes)]
    assert codes.TOO_FINE.id in codes_found(system, schedule(system, 10, *jobs))
    phases = [access("r", "0ms", "1ms", Fraction(1, p)) for p in primes]
    fine = model(task("a", 10, version("v", 4, "u1", *phases)), resources="r")
    assert codes_found(fine, plan(fine)) == [codes.TOO_FINE.id]


# ------------------------------------------------------------------------------------------------ faults of the model

BAD_VERSIONS = {
    "no WCET": replace(version(), wcet=None),
    "WCET -1ns; it must be above 0": replace(version(), wcet=Duration(-1)),
    "WCET 0ms; it must be above 0": replace(version(), wcet=Duration(0)),
    "gang size 0": version(gang=0),
    "begins below zero": version("v", 1, "u1", replace(after("a", "0ms", 5), min=Duration(-1))),
    "with bound 3/2": version("v", 1, "u1", access("r", "0ms", "1ms", "3/2")),
    "with bound 0": version("v", 1, "u1", access("r", "0ms", "1ms", 0)),
    "from 1ms to 2ms": version("v", 1, "u1", access("r", "1ms", "2ms")),
    "from 1ms to 1ms": version("v", 1, "u1", access("r", "1ms", "1ms")),
}


@pytest.mark.parametrize("text", BAD_VERSIONS)
def test_versions_that_cannot_be_scheduled_are_faults_of_the_model(text):
    system = model(task("a", 10, version("v", 1)), task("b", 10, BAD_VERSIONS[text]), resources="r")
    good = job(system, "a", 0, 0, "u1")
    plan = schedule(system, 10, good, replace(good, task="b", start=ms(5), end=ms(6)))
    assert any(text.replace("3/2", "3/2") in line for line in messages(system, plan, codes.MODEL_FAULT))


def test_a_version_without_wcet_that_no_mode_uses_is_no_fault():
    a = task("a", 10, version("v", 4), replace(version("w"), wcet=None))
    used = replace(mode("all", [a]), runs=(Run(task="a", versions=("v",)),))
    system = model(a, modes=[used])
    assert not errors(system, plan(system))


def faulty(**changes):
    return replace(simple(), **changes)


a, b = task("a", 10, version("v", 4)), task("b", None, version("v", 1))
FAULTY = {
    'task "a": is defined more than once': faulty(tasks=(a, a)),
    'version "v": is defined more than once': faulty(tasks=(replace(a, versions=a.versions * 2),)),
    'unit "u1": is defined more than once': faulty(units=simple().units * 2),
    'mode "all": is defined more than once': faulty(modes=simple().modes * 2),
    'runs task "no", which does not exist': faulty(modes=(mode("all", [a, replace(a, name="no")]),)),
    'runs version "w" of task "a"': faulty(modes=(mode("all", [task("a", 10, version("v"), version("w"))]),)),
    'runs task "a" more than once': faulty(modes=(mode("all", [a, a]),)),
    'chain "c": names task "no"': faulty(chains=(chain("c", "a no"),)),
    'names mode "no"': simple(transitions=[("all", "no", None)]),
    "the period 0ms": faulty(tasks=(replace(a, period=ms("0ms")),)),
    "the slack 2": faulty(tasks=(replace(a, slack=Fraction(2)),)),
    "the slack -1": faulty(tasks=(replace(a, slack=Fraction(-1)),)),
    "no periodic task runs in it": faulty(modes=(mode("all", []),)),
}


@pytest.mark.parametrize("text", FAULTY)
def test_faults_of_the_model_are_reported_and_never_raised(text):
    system = FAULTY[text]
    assert any(text in line for line in messages(system, plan(simple()), codes.MODEL_FAULT)), errors(
        system, plan(simple())
    )


def test_a_cycle_of_predecessors_is_named():
    one = task("a", None, version("v", 1, "u1", after("b", 0, 5)))
    two = task("b", 10, version("v", 1, "u1", after("a", 0, 5)))
    system = model(one, two)
    text = " ".join(messages(system, schedule(system, 10, job(system, "b", 0, 0, "u1")), codes.MODEL_FAULT))
    assert '"a" after "b" after "a"' in text or '"b" after "a" after "b"' in text


def test_a_hyperperiod_out_of_reach_is_refused():
    primes = [p for p in range(10**9, 10**9 + 4000) if all(p % q for q in range(2, 200))]
    system = model(*(task(f"t{p}", f"{p}ns", version("v", "1ns")) for p in primes))
    assert any("4096 bits" in line for line in messages(system, schedule(system, 10), codes.MODEL_FAULT))


def test_a_huge_number_of_jobs_is_counted_and_not_listed():
    system = model(task("a", "1ns", version("v", "1ns")), task("b", "1000000000s", version("v", "1ns")))
    plan = schedule(system, "1000000000s", job(system, "a", 5, "5ns", "u1"), job(system, "b", 0, "6ns", "u1"))
    text = only(system, plan, codes.MISSING_JOB)
    assert "missing: 0 to 4, 6 to 999999999999999999" in text


def test_an_empty_model_and_an_empty_schedule():
    assert verify(model(modes=()), Schedule(model="m", model_sha256="")) == ()


def test_every_rule_has_a_name_and_a_sentence():
    assert len({rule.name for rule in RULES}) == len(RULES)
    for rule in RULES:
        assert rule.sentence.endswith(".")
        assert rule.sentence[0].isupper()


def test_switches_are_checked_only_where_both_modes_can_be():
    system = model(a, modes=[mode("one", [a]), mode("two", [a])])
    own = job(system, "a", 0, 0, "u1")
    good = plan_of(system, table("one", 10, own), table("two", 10, own))
    for kept in (good.modes[:1], good.modes[1:]):
        found = codes_found(system, replace(switch(good, 0), modes=kept))
        assert codes.MISSING_MODE.id in found
        assert not [code for code in found if code >= codes.NOT_ALLOWED.id and code != codes.NO_TABLE.id]


@pytest.mark.parametrize(("bits", "is_fine"), [(tables.MAX_BITS, True), (tables.MAX_BITS + 1, False)])
def test_a_hyperperiod_of_many_bits(bits, is_fine):
    period = Duration(1 << bits - 1)
    system = model(replace(task("a", 10, version("v", 1)), period=period))
    written = schedule(system, 10, job(system, "a", 0, 0, "u1"))
    found = errors(system, replace(written, modes=(replace(written.modes[0], hyperperiod=period),)))
    assert any(f"more than {tables.MAX_BITS} bits" in each for each in found) is not is_fine


@pytest.mark.parametrize(
    ("most", "jobs", "cycles"), [(20, 4, 5), (19, 4, 2), (5, 1, 5), (4, 1, 2), (5, 0, 5), (4, 0, 2)]
)
def test_a_line_of_too_many_jobs_has_two_cycles(monkeypatch, most, jobs, cycles):
    monkeypatch.setattr(tables, "MAX_LINE", most)
    line = SimpleNamespace(cycles_needed=lambda jobs: 5, target=SimpleNamespace(jobs=[None] * jobs))
    assert tables.Switch.cycles_of(line, []) == cycles


@pytest.mark.parametrize(("bits", "is_fine"), [(tables.MAX_BITS, True), (tables.MAX_BITS + 1, False)])
def test_a_common_denominator_of_many_bits(bits, is_fine):
    wide = 1 << bits - 1
    assert tables.common_denominator([1, wide]) == (wide if is_fine else None)


def test_a_line_is_as_long_as_the_job_in_progress_that_ends_last():
    line = SimpleNamespace(length=5, target=SimpleNamespace(period=10))
    jobs = [SimpleNamespace(stretches=(1, 2), version=None, end=end) for end in (15, 36, 25)]
    assert tables.Switch.cycles_needed(line, jobs) == 4
    assert tables.Switch.cycles_needed(line, jobs[:1]) == 2
    whole = SimpleNamespace(stretches=(1,), version=None, end=95)
    assert tables.Switch.cycles_needed(line, [*jobs[:1], whole]) == 2
