"""ROS executors: the timers start every job when the schedule says, and what they cannot do is said."""

from dataclasses import replace
from fractions import Fraction

import pytest
import yaml
from exporter_samples import roboracer, thirds, two_modes

from golden_file import assert_golden
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.codes import BAD_CPU, NEEDS_HOLD, NEEDS_SCHEDULE
from halpipe.exporters.ros import FORMAT, RosOptions, codes
from halpipe.models import Interrupt, Part, Split
from stated_options import option_of, stated
from support import access, job, model, ms, schedule, task, version


def write(system, planned, **options):
    return FORMAT.write(system, planned, RosOptions(**options))[""].decode()


def document(system, planned, **options):
    return yaml.safe_load(write(system, planned, **options))


def timers(written, mode=0):
    """(executor, task, timer) of a mode."""
    return [
        (executor["name"], group["task"], timer)
        for executor in written["modes"][mode]["executors"]
        for group in executor["callback-groups"]
        for timer in group["timers"]
    ]


def starts(written, mode=0):
    """Every start within one cycle, by playing the timers: (task, version, executor, ns)."""
    cycle = written["modes"][mode]["cycle-ns"]
    found = []
    for executor, owner, timer in timers(written, mode):
        assert cycle % timer["period-ns"] == 0
        assert 0 <= timer["offset-ns"] < timer["period-ns"]
        for turn in range(cycle // timer["period-ns"]):
            found.append((owner, timer["version"], executor, timer["offset-ns"] + turn * timer["period-ns"]))
    return sorted(found)


def expected(table):
    """The same from the schedule: jobs of as many hyperperiods as make whole nanoseconds."""
    turns = Fraction(table.hyperperiod.ns).denominator
    return sorted(
        (j.task, j.version, j.units[0], int(j.start.ns + turn * table.hyperperiod.ns))
        for j in table.jobs
        for turn in range(turns)
    )


@pytest.mark.parametrize("sample", [roboracer, thirds, two_modes])
def test_timers_start_every_job_and_nothing_else(sample):
    system, planned = sample()
    written = document(system, planned)
    for position, table in enumerate(planned.modes):
        assert starts(written, position) == expected(table)


def test_the_document():
    assert_golden("roboracer.executors.yaml", write(*roboracer(), cpus={"core1": 2, "core2": 3}))


def test_a_task_that_recurs_evenly_has_one_timer_and_others_have_one_for_each_job():
    even, odd = task("even", 10, version()), task("odd", 10, version(), slack=1)
    system = model(even, odd, task("slow", 20, version()))
    planned = schedule(
        system,
        20,
        *(job(system, "even", k, 10 * k + 3, "u1") for k in range(2)),
        job(system, "odd", 0, 0, "u1"),
        job(system, "odd", 1, 11, "u1"),
        job(system, "slow", 0, 16, "u1"),
    )
    found = [(owner, timer.get("job"), timer["period-ns"]) for _, owner, timer in timers(document(system, planned))]
    assert found == [
        ("even", None, 10_000_000),
        ("odd", 0, 20_000_000),
        ("odd", 1, 20_000_000),
        ("slow", None, 20_000_000),
    ]


def test_a_task_that_changes_its_unit_has_a_group_on_each_executor():
    system = model(task("a", 10, version(units="u1 u2")), task("b", 20, version(units="u1 u2")), units="u1 u2")
    planned = schedule(
        system, 20, job(system, "a", 0, 0, "u1"), job(system, "a", 1, 10, "u2"), job(system, "b", 0, 5, "u2")
    )
    groups = [
        group["name"]
        for executor in document(system, planned)["modes"][0]["executors"]
        for group in executor["callback-groups"]
    ]
    assert groups == ["a@u1", "a@u2", "b@u2"]


def test_cpus_are_stated_or_in_order_or_left_open():
    system, planned = roboracer()
    assert [executor["cpu"] for executor in document(system, planned)["modes"][0]["executors"]] == [0, 1, 2, 3]
    stated = document(system, planned, cpus={"core2": 7})["modes"][0]["executors"]
    assert {executor["name"]: executor.get("cpu") for executor in stated} == {
        "core1": None,
        "core2": 7,
        "core3": None,
        "core4": None,
    }


def test_the_priority_is_that_of_the_executors():
    assert document(*roboracer(), priority=42)["scheduling"] == {"policy": "SCHED_FIFO", "priority": 42}


def refusal(system, planned, **options):
    with pytest.raises(HalpipeError) as caught:
        write(system, planned, **options)
    return caught.value.diagnostics


def test_wrong_cpus_are_all_named():
    found = refusal(*roboracer(), cpus={"core1": 1, "core2": 1, "core_3": 2})
    assert [(d.code, d.path) for d in found] == [
        (BAD_CPU.id, 'unit "core2"'),
        (BAD_CPU.id, 'unit "core_3"'),
    ]
    assert "core3" in found[1].help


def test_a_cycle_may_have_as_many_jobs_as_there_may_be_timers_and_no_more(monkeypatch):
    monkeypatch.setattr("halpipe.exporters.ros.document.MOST_TIMERS", 30)

    def system_of(denominator, *names):
        period = f"1/{denominator}ns"
        system = model(*(task(name, period, version(wcet="0ns")) for name in names))
        return system, schedule(system, period, *(job(system, name, 0, 0, "u1") for name in names))

    assert len(timers(document(*system_of(30, "a")))) == 30
    assert len(timers(document(*system_of(15, "a", "b")))) == 30
    (found,) = refusal(*system_of(16, "a", "b"))
    assert found.code == codes.TOO_FINE.id
    assert found.message.endswith("repeats within whole nanoseconds only after 16 times, with 32 jobs")


def test_a_schedule_is_needed():
    (found,) = refusal(roboracer()[0], None)
    assert found.code == NEEDS_SCHEDULE.id


def messages(system, planned, **options):
    found = FORMAT.remarks(system, planned, RosOptions(**options), {})
    assert {d.code for d in found} <= {codes.UNREALISED.id}
    said = [d.message for d in found]
    assert document(system, planned, **options)["not-realised"] == said
    return said


def test_what_executors_do_fully_needs_no_words():
    system = model(task("a", 10, version()))
    assert messages(system, schedule(system, 10, job(system, "a", 0, 0, "u1")), cpus={"u1": 0}) == []


def test_what_executors_cannot_do_is_said():
    gang = version("g", "1ms", "u1 u2", gang=2)
    system = model(
        task("a", "1/3ms", version("v", "0.1ms", "u1", access("r", 0, "0.1ms"))),
        task("b", None, gang),
        units="u1 u2",
        resources="r",
    )
    planned = schedule(system, "1/3ms", job(system, "a", 0, "1/6ms", "u1"), job(system, "b", 0, 0, "u1 u2", "g"))
    planned = schedule(system, "4/3ms", *planned.modes[0].jobs)
    assert messages(system, planned, cpus={"u1": 0}) == [
        'started by timers, not by their messages: "b"',
        'run on one CPU, though they occupy several units: "b"',
        "bounds of access phases are not enforced",
        'jobs start up to 1ns early, since timers count whole nanoseconds: mode "all"',
        'executors without affinity: "u2"',
    ]


def test_exclusion_between_executors_is_by_time_only():
    shared = [version("v", "1ms", unit, access("group", 0, "1ms")) for unit in ("u1", "u2")]
    system = model(task("a", 10, shared[0]), task("b", 10, shared[1]), units="u1 u2", resources="group")
    planned = schedule(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 1, "u2"))
    assert 'callbacks that share "group"' in messages(system, planned, cpus={"u1": 0, "u2": 1})[0]


def test_a_phase_within_a_job_that_may_be_early_is_refused():
    """Only models that split jobs or serve interrupts say anything of jobs that are early (MODEL 8.2, run time)."""
    late = version("v", "2ms", "u1", access("m", 1, 2, "1/2"))
    system = model(task("a", 10, late), resources="m")
    planned = schedule(system, 10, job(system, "a", 0, 0, "u1", "v"))
    assert write(system, planned, cpus={"u1": 0})
    served = Interrupt(name="i", distance=ms(100), wcet=ms("0.1ms"))
    system = replace(system, units=(replace(system.units[0], interrupts=(served,)),))
    with pytest.raises(HalpipeError) as refused:
        write(system, planned, cpus={"u1": 0})
    assert [d.code for d in refused.value.diagnostics] == [NEEDS_HOLD.id]


@pytest.mark.parametrize(
    ("split", "said"),
    [(Split(anywhere=True, max_gaps=1), "--package"), (Split(points=(ms(1),)), "which holds programs at split points")],
)
def test_split_jobs_run_in_one_piece(split, said):
    """The package plays what is interrupted anywhere, only; so it is no remedy for split points."""
    system = model(task("a", 10, replace(version("v", "2ms", "u1"), split=split)))
    planned = schedule(system, 10, job(system, "a", 0, 0, "u1", "v"))
    whole = planned.modes[0].jobs[0]
    pieces = (
        Part(start=ms(0), end=ms(1), executed_from=ms(0), executed_to=ms(1)),
        Part(start=ms(2), end=ms(3), executed_from=ms(1), executed_to=ms(2)),
    )
    table = replace(planned.modes[0], jobs=(replace(whole, parts=pieces, end=ms(3)),))
    with pytest.raises(HalpipeError) as refused:
        write(system, replace(planned, modes=(table,)), cpus={"u1": 0})
    (found,) = refused.value.diagnostics
    assert found.code == NEEDS_HOLD.id
    assert found.message == "job 0 has 2 parts; an executor interrupts no callback"
    assert said in found.help


def test_modes_and_assumed_cpus_are_said():
    said = messages(*two_modes())
    assert said[0].startswith("2 modes, each with executors of its own")
    assert said[-1].startswith("CPUs are numbered in the order of the units")


def test_one_mode_alone_needs_no_switching():
    system, planned = two_modes()
    written = document(system, planned, mode="race")
    assert [mode["name"] for mode in written["modes"]] == ["race"]
    assert not any("switch" in said for said in written["not-realised"])


@pytest.mark.parametrize("text", ["a", "a=", "=1", "a=1,a=2", "a=-1", "a=12345"])
def test_cpus_that_cannot_be_read(text):
    with pytest.raises(ValueError, match=";"):
        option_of(FORMAT, "cpus").from_text(text)


def test_cpus_that_can_be_read():
    assert option_of(FORMAT, "cpus").from_text("core1=2, a=b=0") == {"core1": 2, "a=b": 0}
    with pytest.raises(ValueError, match="empty"):
        option_of(FORMAT, "cpus").from_text("")


@pytest.mark.parametrize("text", ["0", "100", "x", "-1"])
def test_priorities_out_of_range(text):
    with pytest.raises(ValueError, match="1 to 99"):
        option_of(FORMAT, "priority").from_text(text)


def pipeline_options(text):
    return stated(FORMAT, text, mode="race")


def test_options_of_a_pipeline_file():
    options, found = pipeline_options("cpus: {core1: 2}\npriority: 10\n")
    assert (options, found) == (RosOptions(mode="race", cpus={"core1": 2}, priority=10), [])
    assert pipeline_options("priority: 99\n")[0].cpus is None
    assert [d.at.line for d in pipeline_options("cpus:\n  core1: x\npriority: 0\n")[1]] == [2, 3]


def test_options_of_a_package_in_a_pipeline_file():
    text = "package: true\nmessages: oldest\ngraph: [g.yaml, /t]\nwait: {a: 1ms}\nmissing: {a: stop}\n"
    options, found = stated(FORMAT, text, "/base")
    assert found == []
    assert options == RosOptions(
        package=True, messages="oldest", graphs=("/base/g.yaml", "/t"), wait={"a": ms(1)}, missing={"a": "stop"}
    )
    assert RosOptions().package is False
    assert [RosOptions(package=each).unused() for each in (True, False)] == [
        (), ("messages", "graphs", "wait", "missing")
    ]  # fmt: skip


def test_a_period_of_part_of_a_nanosecond_has_a_timer_for_each_job():
    """One timer cannot have the period; its jobs repeat with the cycle."""
    system = model(task("a", "1/2ns", version(wcet="0ns")))
    planned = schedule(system, "1ns", job(system, "a", 0, 0, "u1"), job(system, "a", 1, "1/2ns", "u1"))
    found = [(t["job"], t["period-ns"], t["offset-ns"]) for _, _, t in timers(document(system, planned))]
    assert found == [(0, 1, 0), (1, 1, 0)]


def test_jobs_of_a_cycle_of_several_hyperperiods_are_listed_by_their_offsets():
    system = model(task("a", "1/2ns", version(wcet="0ns")), task("b", "1/2ns", version(wcet="0ns"), slack=1))
    jobs = (job(system, "b", 0, "1/4ns", "u1"), job(system, "a", 0, 0, "u1"))
    found = [(owner, t["job"], t["offset-ns"], t["budget-ns"]) for _, owner, t in timers(
        document(system, schedule(system, "1/2ns", *jobs)))]  # fmt: skip
    assert found == [("a", 0, 0, 0), ("a", 0, 0, 0), ("b", 0, 0, 0), ("b", 0, 0, 0)]


def test_budgets_are_rounded_up_and_starts_down():
    system = model(task("a", 1, version(wcet="5/2ns")))
    planned = schedule(system, 1, job(system, "a", 0, "7/2ns", "u1"))
    [(_, _, timer)] = timers(document(system, planned))
    assert (timer["offset-ns"], timer["budget-ns"]) == (3, 3)


def test_a_gang_names_the_units_that_are_kept_free_for_it():
    system = model(task("a", 10, version("v", "1ms", "u1 u2 u3", gang=3)), units="u1 u2 u3")
    [(executor, _, timer)] = timers(document(system, schedule(system, 10, job(system, "a", 0, 0, "u2 u1 u3"))))
    assert (executor, timer["keeps-free"]) == ("u2", ["u1", "u3"])
