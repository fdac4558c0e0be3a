"""What ends a search from outside: once politely, twice at once; afterwards all is as it was."""

import itertools
import pickle
import re
import signal

import pytest

from halpipe.cli import invoke
from halpipe.cli.searching import Stop
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.durations import seconds
from halpipe.pipeline.solve.codes import INTERRUPTED

SIGNALS = (signal.SIGINT, signal.SIGTERM)


@pytest.mark.parametrize("number", SIGNALS)
def test_the_first_stops_politely_and_the_second_at_once(number, capsys):
    stop, before = Stop("stopping"), [signal.getsignal(each) for each in SIGNALS]
    go_on = stop.clock()
    with stop.listening():
        assert go_on()
        signal.raise_signal(number)
        assert not go_on("mode", 1, 2, 3)
        assert "stopping" in capsys.readouterr().err
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(number)
    assert [signal.getsignal(each) for each in SIGNALS] == before


def test_each_search_has_the_whole_time_limit_also_elsewhere(monkeypatch):
    now = [100.0]
    monkeypatch.setattr("halpipe.cli.searching.time.monotonic", lambda: now[0])
    stop = pickle.loads(pickle.dumps(Stop("", seconds(2))))
    first = stop.clock()
    now[0] += 1.5
    second = stop.clock()
    now[0] += 1
    assert (first(), second()) == (False, True)


def test_the_time_of_a_search_is_from_its_begin_to_its_end(tmp_path, monkeypatch, capsys):
    now = itertools.count(100, 3)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("halpipe.cli.searching.time.monotonic", lambda: next(now))
    assert invoke(["new", "first"]) == 0
    assert invoke(["schedule", "first/model.xml", "-o", "s.xml"]) == 0
    assert 0 < float(re.search(r"moves? in ([0-9.]+) s", capsys.readouterr().err)[1]) <= next(now) - 100


def test_an_explanation_that_is_stopped_ends_as_interrupted(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert invoke(["new", "first"]) == 0
    clock = Stop.clock
    monkeypatch.setattr(Stop, "clock", lambda stop: signal.raise_signal(signal.SIGINT) or clock(stop))
    assert invoke(["explain", "first/model.xml"]) == 130
    assert "stopping; what was found so far follows" in capsys.readouterr().err


@pytest.mark.parametrize("is_user", [True, False])
def test_a_search_that_ends_with_nothing_was_stopped_by_the_user_or_by_its_limit(is_user, tmp_path, monkeypatch):
    def ended(*_):
        if is_user:
            signal.raise_signal(signal.SIGINT)
        raise HalpipeError(INTERRUPTED("stopped"), exit=Exit.INTERRUPTED)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("halpipe.pipeline.checked.schedule_model", ended)
    assert invoke(["new", "first"]) == 0
    assert invoke(["schedule", "first/model.xml", "-o", "s.xml"]) == (Exit.INTERRUPTED if is_user else Exit.NOT_FOUND)


SEARCHING = (
    "schedule first/model.xml -o made.xml",
    "schedule first/model.xml -o made/",
    "explain first/model.xml",
    "size first/model.xml --wcet-factor",
    "sensitivity first/model.xml s.xml --search",
)


@pytest.fixture
def scheduled(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke(["new", "first"]) == 0
    assert invoke(["schedule", "first/model.xml", "-o", "s.xml"]) == 0


@pytest.mark.parametrize("words", SEARCHING)
def test_a_large_search_begins_where_its_end_is_stated(words, scheduled, monkeypatch, capsys):
    monkeypatch.setattr("halpipe.pipeline.solve.limits.MOST_UNLIMITED", 5)
    assert invoke(words.split()) == 1
    assert "HAL0417" in "".join(capsys.readouterr())
    assert invoke([*words.split(), "--time-limit", "1000s"]) == 0
    if not words.startswith("explain"):
        assert invoke([*words.split(), "--budget", "50"]) == 0


def test_a_fleet_says_that_a_large_model_was_not_begun(scheduled, monkeypatch, capsys):
    monkeypatch.setattr("halpipe.pipeline.solve.limits.MOST_UNLIMITED", 5)
    assert invoke(["schedule", "first/model.xml", "-o", "made/"]) == 1
    assert "not begun: large" in capsys.readouterr().out


def test_what_is_too_much_for_its_units_has_a_large_question_of_size_too(scheduled, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("halpipe.pipeline.solve.limits.MOST_UNLIMITED", 5)
    model = tmp_path / "first" / "model.xml"
    model.write_text(model.read_text().replace('wcet="', 'wcet="9', 1))
    assert invoke(["validate", "first/model.xml"]) == 1
    capsys.readouterr()
    assert invoke(["size", "first/model.xml", "--wcet-factor"]) == 1
    assert "HAL0417" in "".join(capsys.readouterr())


def test_a_large_pipeline_states_its_end_too(scheduled, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("halpipe.pipeline.solve.limits.MOST_UNLIMITED", 5)
    steps = "halpipe-pipeline: 1\nmodel: first/model.xml\nschedule: {output: made.xml}\n"
    (tmp_path / "run.yaml").write_text(steps)
    assert invoke(["run", "run.yaml"]) == 1
    assert "HAL0417" in "".join(capsys.readouterr())
    (tmp_path / "run.yaml").write_text(steps.replace("made.xml", "made.xml, budget: 50"))
    assert invoke(["run", "run.yaml"]) == 0


def test_a_model_that_is_not_valid_needs_no_end(scheduled, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("halpipe.pipeline.solve.limits.MOST_UNLIMITED", 5)
    model = tmp_path / "first" / "model.xml"
    model.write_text(model.read_text().replace('wcet="', 'wcet="9', 1))
    assert invoke(["schedule", "first/model.xml", "-o", "made.xml"]) != 0
    assert "HAL0417" not in "".join(capsys.readouterr())


@pytest.mark.parametrize("words", SEARCHING[2:])
def test_an_answer_that_time_cuts_short_says_so(words, scheduled, monkeypatch, capsys):
    """Nothing was searched: nothing is found, but for what the schedule shows."""
    monkeypatch.setattr(Stop, "clock", lambda stop: lambda *_: False)
    code = invoke(words.split())
    assert code == (0 if words.startswith("sens") else 3)
    assert "HAL0447" in "".join(capsys.readouterr())
