"""Health rules in the co-simulation: jobs fail, and the runtime does what the model says: that, and nothing else."""

from dataclasses import replace

import pytest
from tampering import tampered

from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.riscv import codes
from halpipe.deploy.riscv.judge import check, containment
from halpipe.deploy.riscv.run.injection import Kind
from halpipe.pipeline.health import with_reactions

RULES = """  <transition from="full" to="halt"/>
  </transitions>
  <health>
    <rule task="sense" on="overrun" count="3" cycles="2" action="switch" mode="halt"/>
    <rule task="act" on="fault" count="2" cycles="3" action="restart"/>
    <rule task="filter" action="switch" mode="calm"/>
    <rule task="act" on="overrun" count="4" cycles="3" action="stop"/>
  </health>
</task-model>"""


@pytest.fixture(scope="module")
def ruled(export):
    return export(change=lambda text: text.replace("  </transitions>\n</task-model>", RULES))


def errors(found):
    return [d for d in found if d.is_error]


def tried(target, only=lambda trial: True):
    """The findings of all trials of a target that are wanted."""
    found = check.Injected()
    for trial in filter(only, containment.trials(target)):
        check.try_rule(target, trial, found)
    assert found.trials
    return errors(found.findings)


@pytest.mark.slow
def test_rules_fire_when_they_have_to_and_not_otherwise(ruled):
    assert check.static_findings(ruled) == []
    assert tried(ruled) == []


@pytest.mark.slow
def test_the_trials_switch_restart_and_stop(ruled):
    """So that the test before says something: each kind of consequence is among them."""
    names, stops, restarts = set(), 0, 0
    site = check.read_site(ruled.bundle)
    images = check.read_images(ruled.bundle, site)
    for trial in containment.trials(ruled):

        def plan(tables, trial=trial):
            jobs = check.Expectation(ruled.bundle, ruled.model, site, images).jobs(tables)
            return jobs, containment.failing(trial, ruled.model, jobs)

        course = containment.course_of(ruled, site, trial.mode, (), trial.tables, plan)
        names.add((trial.mode, course.tables[-1].name))
        stops += course.stops
        restarts += any(ruled.model.health[f.rule].action == "restart" for f in course.firings if f.rule == trial.rule)
    assert {("full", "halt"), ("calm", "halt"), ("full", "calm")} <= names
    assert stops
    assert restarts


@pytest.mark.slow
def test_of_two_rules_the_first_of_the_model_prevails(mutant):
    change = lambda text: text.replace("  </transitions>\n</task-model>", RULES)  # noqa: E731
    forgets = mutant("health.c", "priority = rule->priority;", "", change=change)
    assert {d.code for d in tried(forgets, lambda trial: trial.beside is not None)} >= {codes.WRONG_TABLE.id}


@pytest.mark.slow
def test_the_check_of_every_day_tries_rules(ruled):
    checked = check.check_by_simulation(ruled, CheckOptions())
    assert errors(checked.diagnostics) == []
    assert any("health rules: 12 runs" in line for line in checked.lines)


@pytest.mark.parametrize(
    ("what", "change"),
    [
        ("count", lambda p, at: p.put(at + 13, p.get(at + 13, 1) + 1, 1)),
        ("cycles", lambda p, at: p.put(at + 14, p.get(at + 14, 1) + 1, 1)),
        ("flags", lambda p, at: p.put(at + 12, 0x57, 1)),
        ("action", lambda p, at: p.put(at + 15, 3, 1)),
        ("mode", lambda p, at: p.put(at + 4, 0, 4)),
    ],
)
def test_rules_that_are_others_are_found_before_anything_is_played(ruled, tmp_path, what, change):
    base = lambda program: program.symbols["hp_rules"][0]  # noqa: E731
    broken = tampered(ruled, tmp_path / "b", lambda p: change(p, base(p) + 16 * 3))
    found = [d for d in check.static_findings(broken) if d.code == codes.WRONG_OPERATIONS.id]
    assert found[0].path == "hp_rules", what


def test_a_job_with_the_rules_of_another_is_found(ruled, tmp_path):
    def change(program):
        base, size = program.symbols["hp_programs"]
        for at in range(base, base + size, 24):
            program.put(at + 20, 0, 4)

    broken = tampered(ruled, tmp_path / "b", change)
    assert codes.WRONG_OPERATIONS.id in {d.code for d in check.static_findings(broken)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rule", "kind"), [(0, Kind.SPIN), (1, Kind.TRAP), (2, Kind.TRAP), (3, Kind.SPIN)], ids=["0", "1", "2", "3"]
)
def test_a_runtime_with_other_rules_is_caught_by_what_it_does(ruled, rule, kind):
    """The model asks for what the program does not have: every rule counts one event more than the program does."""
    rules = [replace(r, count=r.count + 1) if i == rule else r for i, r in enumerate(ruled.model.health)]
    model = replace(ruled.model, health=tuple(rules))
    other = Target(bundle=ruled.bundle, model=model, schedule=with_reactions(model, ruled.schedule))
    found = tried(other, lambda trial: trial.rule == rule and trial.kind is kind)
    assert {d.code for d in found} & {codes.WRONG_HEALTH.id, codes.WRONG_TABLE.id, codes.NOT_FINISHED.id}
