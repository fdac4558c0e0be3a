"""Near names for messages."""

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import read_bytes
from halpipe.core.suggest import counted, did_you_mean, nearest

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


@pytest.mark.parametrize(("typed", "far"), [("resume", "freeze"), ("quality", "quantise")])
def test_half_of_a_long_name_is_not_near(typed, far):
    assert nearest(typed, [far]) == []


@pytest.mark.parametrize(("typed", "near"), [("u2", "u1"), ("fool", "full")])
def test_half_of_a_short_name_is_near(typed, near):
    assert nearest(typed, [near]) == [near]


@pytest.mark.parametrize(
    ("typed", "meant"), [("modle.xml", "model.xml"), ("nonexist.xml", None), ("model", "model.xml")]
)
def test_a_file_is_not_near_by_its_kind_or_its_folder(typed, meant, tmp_path):
    for name in ("model.xml", "x.xml", "t.csv"):
        (tmp_path / name).touch()
    with pytest.raises(HalpipeError) as refused:
        read_bytes(str(tmp_path / typed))
    help = f'did you mean "{tmp_path / meant}"?' if meant else "name a file that exists and that you may read"
    assert refused.value.diagnostics[0].help == help


@pytest.mark.parametrize(("number", "text"), [(0, "0 modes"), (1, "1 mode"), (2, "2 modes")])
def test_one_of_a_kind_is_singular(number, text):
    assert counted(number, "mode") == text
