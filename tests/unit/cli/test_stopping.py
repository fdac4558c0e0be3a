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
