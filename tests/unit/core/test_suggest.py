"""Near names for messages."""

import pytest

from halpipe.core.suggest import did_you_mean, nearest

KNOWN = ("particle_filter", "pure_pursuit", "opponent_detection")


def test_the_nearest_name_comes_first():
    assert nearest("particel_filter", KNOWN)[0] == "particle_filter"


def test_at_most_the_wanted_number_of_names_is_given():
    cores = [f"core{n}" for n in range(10)]
    assert len(nearest("core", cores)) == 3
    assert len(nearest("core", cores, count=2)) == 2


def test_the_question_names_what_was_probably_meant():
    assert did_you_mean("pure_persuit", KNOWN) == 'did you mean "pure_pursuit"?'
    assert did_you_mean("core9", ["core1", "core2"]).count('"core') == 2


def test_nothing_near_gives_the_alternative():
    assert did_you_mean("zzz", KNOWN) == ""
    assert did_you_mean("zzz", KNOWN, "name one of the tasks") == "name one of the tasks"
    assert did_you_mean("zzz", []) == ""


@pytest.mark.parametrize(("typed", "near"), [("--list", []), ("--jobz", ["--jobs"]), ("--parallel", ["--workers"])])
def test_options_are_not_near_by_their_dashes(typed, near):
    assert nearest(typed, ["--quiet", "--mode", "--jobs", "--workers", "--format"]) == near
