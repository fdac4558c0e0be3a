"""Valid systems through every verb, in small: `make endurance` drives thousands, and all pairs of features."""

from collections import Counter
from itertools import combinations

import pytest

import every_verb
import halpipe
from every_verb import FEATURES, PAIRS, DisagreementError, Drive, drive, system
from halpipe.pipeline.validate import validate


def driven(tmp_path, first, count, every=1):
    lines = []
    ends, codes, failed = drive(first, count, tmp_path, lines.append, every)
    assert not failed, "\n".join(lines)
    return ends, codes


@pytest.mark.slow
@pytest.mark.parametrize("seed", [7, 47, 142, 203])
def test_verbs_agree(tmp_path, seed):
    driven(tmp_path, seed, 1)


@pytest.mark.slow  # the test above has the same subject
@pytest.mark.endurance
def test_verbs_agree_on_every_pair_of_features(tmp_path):
    ends, codes = driven(tmp_path, 0, len(PAIRS), every=8)
    assert ends["found"] > len(PAIRS) // 2
    assert {verb for verb, _ in codes} >= {
        "size",
        "sensitivity",
        "diff frozen",
        "verify near",
        "import arxml",
        "compare",
    }
    assert {"schedule()", "explain()", "diff model()", "diff schedule()"} <= {verb for verb, _ in codes}


@pytest.mark.parametrize("answer", ["schedule", "explain", "verify"])
def test_an_error_in_an_answer_is_a_disagreement(tmp_path, monkeypatch, answer):
    monkeypatch.setattr(halpipe, answer, lambda *_, **__: {}["a bug"])
    monkeypatch.setattr(every_verb, "EXPLAINED", 1)
    _, _, failed = drive(7, 1, tmp_path, [].append)
    assert failed == [7]
    assert (tmp_path / "7" / "m.xml").is_file()


def test_a_schedule_that_is_refused_is_a_disagreement(tmp_path, monkeypatch):
    monkeypatch.setattr(halpipe, "verify", lambda *_: ["broken"])
    lines = []
    drive(7, 1, tmp_path, lines.append)
    assert "is refused" in lines[0]


def test_each_seed_has_its_pair_and_most_systems_are_valid_models():
    seen, valid = set(), 0
    for seed in range(len(PAIRS)):
        model, features = system(seed)
        seen.update(combinations(features, 2))
        valid += not any(found.is_error for found in validate(model))
    assert {(one.__name__, other.__name__) for one, other in PAIRS} <= seen
    assert len(PAIRS) == len(FEATURES) * (len(FEATURES) - 1) // 2
    assert valid > len(PAIRS) * 3 // 5


def test_a_wrong_exit_code_is_a_disagreement(tmp_path):
    (tmp_path / "m.xml").write_text("<nothing/>")
    with pytest.raises(DisagreementError, match="exit 1"):
        Drive(tmp_path, Counter()).run("validate", "m.xml")
