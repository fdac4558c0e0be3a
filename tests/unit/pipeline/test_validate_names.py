"""Names: their form, duplicates, and references to what does not exist."""

from dataclasses import replace

import pytest
from validate_cases import alone, codes_of, found, the

from halpipe.core.diagnostics import Location, Subject, about
from halpipe.core.suggest import few
from halpipe.models import Mode, Run, Transfer, Unit
from halpipe.pipeline.validate import codes, validate
from halpipe.pipeline.validate.context import task_path, version_path
from support import access, after, chain, mode, model, task, version

A = task("a", 25, version("v", 5))
B = task("b", 25, version("v", 5))


def test_sound_model_has_no_findings():
    assert validate(model(A, B)) == ()


@pytest.mark.parametrize("name", ["", "two words", "a*", "ümlaut", "x" * 1001, "a\n"])
def test_bad_names(name):
    assert the(replace(alone(), name=name), codes.BAD_NAME).path.startswith("model")


@pytest.mark.parametrize(("length", "shown"), [(60, "é" * 60), (61, "é" * 60 + "...")])
def test_a_message_shows_sixty_characters_of_a_name(length, shown):
    assert f'"{shown}"' in the(replace(alone(), name="é" * length), codes.BAD_NAME).path


@pytest.mark.parametrize("name", ["/ns/node", "a.b:c~d+e@f$g%h-i_0", "x" * 1000])
def test_good_names(name):
    assert validate(replace(alone(), name=name)) == ()


@pytest.mark.parametrize(("count", "end"), [(5, '"n3", "n4"'), (6, '"n3", "n4" and 1 more')])
def test_a_message_lists_five_names(count, end):
    assert few(f"n{number}" for number in range(count)).endswith(end)


def test_every_kind_of_name_is_looked_at():
    phase = access("r 1", 0, 1)
    phase = replace(phase, transfers=(Transfer(buffer="b 1", symbol="s 1", size=1),))
    system = model(
        task("t 1", 25, version("v 1", 5, "u", phase)),
        resources="",
        chains=[replace(chain("c", "t"), name="c 1", tasks=("t 1",))],
        modes=[Mode(name="m 1", runs=(Run(task="t 1", versions=("v 1",)),))],
    )
    system = replace(system, units=(Unit(name="u", type="t y"), Unit(name="u 1")))
    paths = [d.path for d in found(system, codes.BAD_NAME)]
    assert sorted(paths) == [
        'chain "c 1"',
        'mode "m 1"',
        'task "t 1"',
        'task "t 1" version "v 1"',
        'task "t 1" version "v 1": buffer "b 1"',
        'task "t 1" version "v 1": symbol "s 1"',
        'unit "u 1"',
        'unit "u": type "t y"',
    ]


@pytest.mark.parametrize(
    ("system", "path"),
    [
        (model(A, units="u1 u1"), 'unit "u1"'),
        (alone("5ms", access("r", 0, 1), resources="r r"), 'resource "r"'),
        (model(A, A), 'task "a"'),
        (model(task("a", 25, version("v", 5), version("v", 4))), 'task "a" version "v"'),
        (model(A, B, chains=[chain("c", "a b"), chain("c", "b a")]), 'chain "c"'),
        (model(A, modes=[mode("m", [A]), mode("m", [A])]), 'mode "m"'),
    ],
)
def test_duplicate_names(system, path):
    assert the(system, codes.DUPLICATE_NAME).path == path


def test_duplicate_says_where_the_first_is():
    first, second = Unit(name="u1", at=Location("m.xml", 3)), Unit(name="u1", at=Location("m.xml", 4))
    finding = the(replace(alone(), units=(first, second)), codes.DUPLICATE_NAME)
    assert finding.at == Location("m.xml", 4)
    assert "line 3" in finding.message


def test_equal_names_of_different_kinds_are_no_duplicates():
    same = task("x", 25, version("x", 5, "x", access("x", 0, 1)))
    system = model(same, units="x", resources="x", chains=[chain("x", "x")], modes=[mode("x", [same])])
    assert found(system, codes.DUPLICATE_NAME) == []


def test_task_twice_in_a_mode():
    run = Run(task="a", versions=("v",))
    assert the(model(A, modes=[Mode(name="m", runs=(run, run))]), codes.DUPLICATE_RUN).path == 'mode "m" task "a"'


def test_version_repeated_in_a_mode():
    system = model(A, modes=[Mode(name="m", runs=(Run(task="a", versions=("v", "v")),))])
    assert 'version "v"' in the(system, codes.REPEATED_IN_LIST).message


def test_unit_repeated_in_a_version():
    assert 'unit "u1"' in the(alone(units="u1 u2 u1"), codes.REPEATED_IN_LIST).message


def test_unknown_unit_suggests_what_was_meant():
    system = replace(alone(units="core1 cor2"), units=(Unit(name="core1"), Unit(name="core2")))
    finding = the(system, codes.UNKNOWN_UNIT)
    assert finding.path == 'task "a" version "v"'
    assert finding.help == 'did you mean "core2" or "core1"?'


def test_unknown_resource():
    assert 'resource "ddr"' in the(alone("5ms", access("ddr", 0, 1)), codes.UNKNOWN_RESOURCE).message
    assert found(alone("5ms", access("ddr", 0, 1), resources="ddr"), codes.UNKNOWN_RESOURCE) == []


def test_unknown_tasks_wherever_they_are_named():
    system = model(
        task("a", 25, version("v", 5, "u1", after("x", 0, 1))),
        chains=[chain("c", "a y")],
        modes=[Mode(name="m", runs=(Run(task="a", versions=("v",)), Run(task="z", versions=("v",))))],
    )
    paths = {d.message: d.path for d in found(system, codes.UNKNOWN_TASK)}
    assert paths == {
        'task "x" does not exist': 'task "a" version "v"',
        'task "y" does not exist': 'chain "c"',
        'task "z" does not exist': 'mode "m"',
    }


def test_unknown_version():
    system = model(A, modes=[Mode(name="m", runs=(Run(task="a", versions=("v", "fast")),))])
    assert the(system, codes.UNKNOWN_VERSION).path == 'mode "m" task "a"'


def test_unknown_modes_of_a_transition():
    one, two = mode("one", [A]), mode("two", [A])
    assert codes_of(model(A, modes=[one, two], transitions=[("one", "two", None)])) == set()
    system = model(A, modes=[one, two], transitions=[("one", "twoo", None), ("on", "two", None)])
    assert [d.help for d in found(system, codes.UNKNOWN_MODE)] == ['did you mean "one"?', 'did you mean "two"?']


def test_all_findings_are_reported_and_not_only_the_first():
    names = [f"missing{i}" for i in range(50)]
    system = alone("5ms", *(after(name, 0, 1) for name in names))
    assert len(found(system, codes.UNKNOWN_TASK)) == 50


def test_an_unknown_name_is_a_subject_and_comes_with_its_fix():
    wrong = the(model(task("a", 25, version("v", 5, "cor1")), units="core1"), codes.UNKNOWN_UNIT)
    assert wrong.subjects == (Subject("task", "a"), Subject("version", "v"), Subject("unit", "cor1"))
    assert wrong.fix is not None
    assert (wrong.fix.old, wrong.fix.new, wrong.fix.at) == ("cor1", "core1", wrong.at)
    lost = the(model(task("a", 25, version("v", 5, "xyz")), units="core1"), codes.UNKNOWN_UNIT)
    assert lost.fix is None


def test_of_two_elements_with_one_name_both_places_are_given():
    first, second = (replace(A, at=Location("m.xml", line)) for line in (3, 8))
    found = the(model(first, second), codes.DUPLICATE_NAME)
    assert (found.at.line, [place.line for place in found.places]) == (8, [3])


def test_the_quick_paths_of_tasks_and_versions_are_those_of_all_elements():
    quick, slow = version_path(A, A.versions[0]), about(task="a", version="v")
    assert (str(quick), quick.subjects) == (str(slow), slow.subjects)
    quick, slow = task_path(A), about(task="a")
    assert (str(quick), quick.subjects) == (str(slow), slow.subjects)
