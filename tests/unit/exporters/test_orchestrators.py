"""Exports to TIMPANI, to the launch manager and to FEO, of whose own tools the schema of the launch manager judges."""

import json
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
import yaml

import halpipe
from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.orchestrator.feo import FORMAT as FEO
from halpipe.exporters.orchestrator.lifecycle import FORMAT as LIFECYCLE
from halpipe.exporters.orchestrator.timpani import FORMAT as TIMPANI
from halpipe.exporters.orchestrator.timpani import MOST_CPUS, MOST_LOAD
from halpipe.models import HealthRule, Mode, Run
from support import after, job, mode, model, ms, schedule, task, version

SENSE = task("sense", 10, version("v", "3ms", "u1"))
ACT = task("act", 10, version("v", "2ms", "u1 u2", after("sense", 0, 4, "end")))
LOG = task("log", 20, version("v", "2500ns", "u2"), offset=0)


def system(*tasks, **fields):
    return model(*tasks, units="u1 u2", **fields)


def planned(made):
    """Equidistant jobs of sense and log, jobs of act on two units."""
    jobs = [job(made, "sense", 0, 0, "u1"), job(made, "sense", 1, 10, "u1")]
    jobs += [job(made, "act", 0, 3, "u1"), job(made, "act", 1, 14, "u2"), job(made, "log", 0, 0, "u2")]
    return schedule(made, 20, *jobs)


def write(exporter, made, plan, **options):
    return exporter.write(made, plan, exporter.options(**options))[""]


def refusals(exporter, made, plan, **options):
    with pytest.raises(HalpipeError) as caught:
        write(exporter, made, plan, **options)
    return [(d.code, str(d.path), d.message) for d in caught.value.diagnostics]


def remarks(exporter, made, plan, **options):
    given = exporter.options(**options)
    found = exporter.remarks(made, plan, given, exporter.write(made, plan, given))
    assert {d.code for d in found} <= {"HAL1496"}
    return [d.message for d in found]


def workload(made, plan, **options):
    return {row["name"]: row for row in yaml.safe_load(write(TIMPANI, made, plan, **options))["tasks"]}


# ------------------------------------------------------------------------------------------------ TIMPANI


def test_equidistant_jobs_are_one_task_and_others_one_each():
    made = system(SENSE, ACT, LOG)
    rows = workload(made, planned(made))
    assert list(rows) == ["log", "sense", "act.0", "act.1"]
    assert rows["sense"] == {
        "name": "sense",
        "node_id": "node01",
        "priority": 50,
        "policy": 1,
        "cpu_affinity": 1,
        "period": 10_000,
        "runtime": 3_000,
        "deadline": 3_000,
        "release_time": 0,
        "max_dmiss": 0,
    }
    assert [(r["period"], r["release_time"], r["cpu_affinity"]) for r in rows.values()][2:] == [
        (20_000, 3_000, 1),
        (20_000, 14_000, 2),
    ]
    assert rows["log"]["runtime"] == 3, "a budget is rounded up"
    assert remarks(TIMPANI, made, planned(made)) == [
        'jobs of task "act" are not equidistant on one unit: each is a task of its own'
    ]


def test_cpus_and_node_are_as_stated():
    made = system(SENSE, ACT, LOG)
    rows = workload(made, planned(made), cpus={"u1": MOST_CPUS - 1, "u2": 2}, node="front")
    assert {(r["node_id"], r["cpu_affinity"]) for r in rows.values()} == {("front", 1 << 63), ("front", 4)}
    found = refusals(TIMPANI, made, planned(made), cpus={"u1": MOST_CPUS, "u2": 2})
    assert found == [("HAL1494", 'unit "u1"', "has no CPU from 0 to 63")]


@pytest.mark.parametrize(("wcet", "refused"), [("8999us", False), ("9ms", True)])
def test_a_unit_that_timpani_would_empty_is_refused(wcet, refused):
    made = model(task("a", 10, version("v", wcet, "u1")))
    plan = schedule(made, 10, job(made, "a", 0, 0, "u1"))
    assert refused is (ms(wcet) >= ms("10ms") * MOST_LOAD)
    if refused:
        assert refusals(TIMPANI, made, plan) == [("HAL1494", 'unit "u1"', "load is 90 %, not below 90 %")]
    else:
        assert workload(made, plan)["a"]["runtime"] == 8_999


@pytest.mark.parametrize(
    ("period", "start", "text"),
    [
        ("10ms", "1500ns", "start 1.5us is no"),
        ("100/3ms", "0ms", "hyperperiod 100/3ms"),
        ("7200s", "0ms", "up to 1 h"),
    ],
)
def test_times_that_timpani_cannot_hold_are_refused(period, start, text):
    made = model(task("a", period, version("v", "1us", "u1")))
    (found,) = refusals(TIMPANI, made, schedule(made, period, job(made, "a", 0, start, "u1")))
    assert found[0] == "HAL1494"
    assert text in found[2]


@pytest.mark.parametrize("exporter", [TIMPANI, FEO])
def test_gangs_and_several_modes_are_refused(exporter):
    gang = task("a", 10, version("v", "1ms", "u1 u2", gang=2))
    made = system(gang)
    plan = schedule(made, 10, job(made, "a", 0, 0, "u1 u2"))
    assert [message for _, _, message in refusals(exporter, made, plan)] == ["takes 2 units together"]
    both = system(SENSE, modes=[mode("one", [SENSE]), mode("two", [SENSE])])
    tables = [schedule(both, 10, job(both, "sense", 0, 0, "u1"), mode_name=name).modes[0] for name in ("one", "two")]
    plan = replace(schedule(both, 10), modes=tuple(tables))
    ((code, _, message),) = refusals(exporter, both, plan)
    assert (code, "has 2" in message) == ("HAL1494", True)
    assert write(exporter, both, plan, mode="two")


@pytest.mark.parametrize("exporter", [TIMPANI, FEO])
def test_a_logical_execution_time_is_refused(exporter):
    made = system(replace(SENSE, let=ms(5)))
    plan = schedule(made, 10, job(made, "sense", 0, 0, "u1"))
    assert [code for code, _, _ in refusals(exporter, made, plan)] == ["HAL1097"]


def test_long_names_and_health_rules_are_named():
    made = system(task("a-name-of-16-byte", 10, version("v", "1ms", "u1")))
    made = replace(made, health=(HealthRule(task="a-name-of-16-byte", action="stop"),))
    texts = remarks(TIMPANI, made, schedule(made, 10, job(made, "a-name-of-16-byte", 0, 0, "u1")))
    assert [text.split(" ")[0] for text in texts] == ["name", "health"]


# ------------------------------------------------------------------------------------------------ launch manager


def moded(*rules):
    """Two modes; the second runs `act` alone."""
    modes = [mode("drive", [SENSE, ACT]), Mode(name="limp", runs=(Run(task="act", versions=("v",)),))]
    return replace(system(SENSE, ACT, modes=modes), health=rules)


def launch(made, **options):
    return json.loads(write(LIFECYCLE, made, None, **options))


def test_modes_are_run_targets_and_rules_recovery_actions():
    rules = (
        HealthRule(task="sense", action="switch", mode="limp"),
        HealthRule(task="act", event="fault", action="stop"),
    )
    made = moded(*rules)
    found = launch(made)
    assert found["initial_run_target"] == "drive"
    assert found["run_targets"] == {"drive": {"depends_on": ["sense", "act"]}, "limp": {"depends_on": ["act"]}}
    sense, act = found["components"]["sense"], found["components"]["act"]
    assert sense["deployment_config"] == {"recovery_action": {"switch_run_target": {"run_target": "limp"}}}
    assert sense["component_properties"]["application_profile"] == {
        "application_type": "Reporting_And_Supervised",
        "alive_supervision": {
            "reporting_cycle": 0.02,
            "failed_cycles_tolerance": 0,
            "min_indications": 1,
            "max_indications": 3,
        },
    }
    assert act["deployment_config"]["recovery_action"]["switch_run_target"]["run_target"] == "fallback_run_target"
    assert act["component_properties"]["application_profile"] == {"application_type": "Native"}
    assert remarks(LIFECYCLE, made, None) == []
    assert list(launch(made, mode="limp")["components"]) == ["act"]


SCHEMA = Path(__file__).parents[4] / "shared/data/published/score-lifecycle/launch_manager.schema.json"


@pytest.mark.skipif(not SCHEMA.is_file(), reason="the schema of the launch manager is not part of the project")
def test_the_schema_of_the_launch_manager_accepts_the_file():
    jsonschema = pytest.importorskip("jsonschema", reason="the extra [dev]")
    made = launch(moded(HealthRule(task="sense", action="switch", mode="limp")))
    judge = jsonschema.Draft202012Validator(json.loads(SCHEMA.read_text()))
    judge.validate(made)
    with pytest.raises(jsonschema.ValidationError):
        judge.validate(made | {"initial_run_target": 1})


def test_rules_that_the_launch_manager_lacks_are_named():
    rules = [
        HealthRule(task="act", action="restart"),
        HealthRule(task="act", action="switch", mode="limp"),
        HealthRule(task="act", action="stop"),
        HealthRule(task="sense", action="switch", mode="limp", count=2, cycles=3),
    ]
    assert remarks(LIFECYCLE, moded(*rules), None) == [
        "health rule with action restart is not written",
        "health rule with action stop is not written",
        "counts 2 events in 3 tables; the launch manager, in consecutive cycles",
    ]
    assert len(remarks(LIFECYCLE, moded(*rules), None, mode="drive")) == 3, "limp is no run target"


def test_names_that_the_launch_manager_refuses():
    tasks = [task(name, 10, version("v", "1ms", "u1")) for name in ("a.b", "same")]
    made = system(*tasks, modes=[mode("same", tasks), mode("fallback_run_target", tasks)])
    found = refusals(LIFECYCLE, made, None)
    assert [code for code, _, _ in found] == ["HAL1495"] * 3


# ------------------------------------------------------------------------------------------------ FEO


def cycle():
    """Three units: a fork, a join, and one that ends where another starts."""
    rows = {
        "a": (0, 2, "u1"),
        "b": (2, 3, "u1"),
        "c": (2, 4, "u2"),
        "d": (6, 2, "u1"),
        "e": (1, 4, "u3"),
        "f": (8, 2, "u2"),
    }
    tasks = [task(name, 10, version("v", f"{long}ms", unit)) for name, (_, long, unit) in rows.items()]
    made = model(*tasks, units="u1 u2 u3")
    return made, schedule(made, 10, *(job(made, name, 0, start, unit) for name, (start, _, unit) in rows.items()))


def test_the_cycle_has_the_order_of_the_table_and_no_more():
    made, plan = cycle()
    found = json.loads(write(FEO, made, plan))
    name = found["halpipe"]["activities"]
    deps = {name[key]: sorted(name[str(n)] for n in row) for key, row in found["activity_deps"].items()}
    assert deps == {"a": [], "b": ["a"], "c": ["a"], "d": ["b", "c", "e"], "e": [], "f": ["d"]}
    assert {found["halpipe"]["workers"][w]: len(row) for w, row in found["worker_assignments"].items()} == {
        "u1": 3,
        "u2": 2,
        "u3": 1,
    }
    assert found["agent_assignments"] == {"1000000": [100001, 100002, 100003]}
    assert found["halpipe"]["cycle"] == "10ms"


def test_jobs_that_end_early_move_none_beyond_its_place():
    made, plan = cycle()
    found = json.loads(write(FEO, made, plan))
    name = found["halpipe"]["activities"]
    table = {job.task: job for job in plan.modes[0].jobs}
    for shares in product((1, 4), repeat=len(table)):
        ends, starts = {}, {}
        for (key, row), share in zip(found["activity_deps"].items(), shares, strict=True):
            planned_job = table[name[key]]
            starts[key] = max((ends[str(n)] for n in row), default=ms(0))
            ends[key] = starts[key] + (planned_job.end - planned_job.start) / share
            assert starts[key] <= planned_job.start
        for one, other in product(table, repeat=2):
            keys = {task_name: key for key, task_name in name.items()}
            if table[one].end <= table[other].start:
                assert ends[keys[one]] <= starts[keys[other]]


def test_what_no_cycle_has_is_refused_and_windows_are_named():
    made = system(SENSE, ACT, LOG)
    found = refusals(FEO, made, planned(made))
    assert sorted((code, path) for code, path, _ in found) == [
        ("HAL1494", 'mode "all" task "act" job 1'),
        ("HAL1494", 'mode "all" task "sense" job 1'),
    ]
    made = system(SENSE, ACT)
    late = schedule(made, 10, job(made, "sense", 0, 5, "u1"), job(made, "act", 0, 9, "u2"))
    assert [message for _, _, message in refusals(FEO, made, late)] == ["ends at 11ms, after the cycle of 10ms"]
    made = replace(system(replace(SENSE, offset=ms(1)), ACT), health=(HealthRule(task="act", action="stop"),))
    plan = schedule(made, 10, job(made, "sense", 0, 1, "u1"), job(made, "act", 0, 4, "u2"))
    assert [text.split()[0] for text in remarks(FEO, made, plan)] == ["offset", "window", "health"]


def test_the_formats_are_registered():
    made = system(replace(SENSE, offset=ms(0)))
    plan = halpipe.schedule(made)
    for name in ("timpani", "feo", "launch-manager"):
        assert halpipe.export(name, made, plan)[""]
