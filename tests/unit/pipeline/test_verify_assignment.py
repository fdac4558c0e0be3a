"""Rules version and unit."""

from dataclasses import replace

from verify_helpers import errors, only

from halpipe.models import Run
from halpipe.pipeline.verify import codes, verify
from support import job, mode, model, schedule, task, version


def gang():
    return model(task("a", 10, version("pair", 2, "u1 u2 u3", gang=2), version("one", 2, "u1")), units="u1 u2 u3 u4")


def on(system, units, chosen=None):
    return schedule(system, 10, job(system, "a", 0, 0, units, chosen))


def test_a_gang_occupies_exactly_its_distinct_valid_units():
    system = gang()
    assert not errors(system, on(system, "u3 u1"))
    assert 'has 1 units where version "pair" occupies 2' in only(system, on(system, "u1"), codes.WRONG_UNIT)
    assert "has 3 units" in only(system, on(system, "u1 u2 u3"), codes.WRONG_UNIT)
    assert "names a unit more than once; has 1 units" in only(system, on(system, "u1 u1"), codes.WRONG_UNIT)
    assert 'unit "u4", which is not valid for version "pair"' in only(system, on(system, "u1 u4"), codes.WRONG_UNIT)
    assert 'unit "u9", which does not exist' in only(system, on(system, "u1 u9"), codes.WRONG_UNIT)
    assert "has 0 units" in only(system, on(system, ""), codes.WRONG_UNIT)
    assert 'has 3 units where version "pair"' in only(system, on(system, "u1 u2 u2 u3"), codes.WRONG_UNIT)


def test_a_repeated_unit_beside_a_full_gang_is_still_wrong():
    text = only(gang(), on(gang(), "u1 u2 u2"), codes.WRONG_UNIT)
    assert text.endswith("names a unit more than once")


def test_a_unit_that_the_version_names_but_the_platform_lacks_is_not_valid():
    system = model(task("a", 10, version("v", 1, "u1 ghost")))
    assert 'unit "ghost", which does not exist' in only(system, on(system, "ghost"), codes.WRONG_UNIT)
    (found,) = verify(system, on(system, "ghost"))
    assert found.help == "valid units: u1"


def test_units_depend_on_the_version():
    assert 'not valid for version "one"' in only(gang(), on(gang(), "u2", "one"), codes.WRONG_UNIT)


def test_version_must_exist_and_be_available():
    system = gang()
    unknown = replace(on(system, "u1").modes[0].jobs[0], version="none")
    assert 'uses version "none"' in only(system, schedule(system, 10, unknown), codes.WRONG_VERSION)
    own = system.tasks[0]
    fewer = replace(mode("all", [own]), runs=(Run(task="a", versions=("one",)),))
    narrow = replace(system, modes=(fewer,))
    assert 'uses version "pair"' in only(narrow, on(narrow, "u1 u2", "pair"), codes.WRONG_VERSION)
    assert not errors(narrow, on(narrow, "u1", "one"))
