"""After an edit, modes and switches that it does not reach stay; the others are those of a whole solve."""

from dataclasses import replace

import pytest

from halpipe.core.durations import Duration
from halpipe.exporters.native import format_model, format_schedule
from halpipe.models import Binding
from halpipe.pipeline.solve import schedule as searching
from halpipe.pipeline.stable import settled
from halpipe.pipeline.transitions import tables
from halpipe.workbench import session as sessions
from halpipe.workbench.edits import Edit, Pin
from halpipe.workbench.session import Session
from support import chain, mode, model, task, version

EVERY = {(a, b) for a in ("park", "drive", "charge") for b in ("park", "drive", "charge") if a != b}


def three_modes(binding=Binding.JOB):
    """Park and drive share one task, charge has its own."""
    lights = replace(task("lights", "10ms", version("v", "1ms", "u1 u2")), binding=binding)
    steer, brake = (task(name, "5ms", version("v", "1ms", "u1 u2")) for name in ("steer", "brake"))
    pump = task("pump", "20ms", version("v", "3ms", "u1 u2"))
    modes = [mode("park", [lights]), mode("drive", [lights, steer, brake]), mode("charge", [pump])]
    return model(
        lights, steer, brake, pump, units="u1 u2", modes=modes, chains=[chain("turn", "steer brake", reaction="20ms")]
    )


def opened(folder, system):
    path = folder / "model.xml"
    path.write_bytes(format_model(system))
    found = Session(str(path))
    found.begin()
    return found


def solved(session, step, monkeypatch):
    """Make a step; return the modes and switches that are solved for it, and the schedule."""
    names, pairs = [], []
    of_mode, of_pair = searching.schedule_mode, tables._shortest
    with monkeypatch.context() as patch:
        patch.setattr(searching, "schedule_mode", lambda m, e, *more: names.append(e.mode.name) or of_mode(m, e, *more))
        patch.setattr(tables, "_shortest", lambda pair, *more: pairs.append(pair.name) or of_pair(pair, *more))
        step(session)
        assert session.state.is_valid
    return set(names), set(pairs), format_schedule(session.state.schedule)


STEPS = {
    "task of one mode": (lambda s: s.edit(Edit("version", "pump", "wcet", "4ms", "v")), {"charge"}),
    "task of two modes": (lambda s: s.edit(Edit("version", "lights", "wcet", "2ms", "v")), {"park", "drive"}),
    "chain": (lambda s: s.edit(Edit("chain", "turn", "max_reaction", "19ms")), {"drive"}),
    "tasks of a mode": (lambda s: s.edit(Edit("mode", "park", "tasks", "lights brake")), {"park"}),
    "platform": (lambda s: s.edit(Edit("add", "u3", "unit", "core")), {"park", "drive", "charge"}),
    "pin": (lambda s: s.pin(Pin("charge", "pump", 0, Duration.parse("7ms"))), {"charge"}),
}


@pytest.mark.parametrize("name", STEPS)
def test_only_what_an_edit_reaches_is_solved_again(name, tmp_path, monkeypatch):
    step, reached = STEPS[name]
    session = opened(tmp_path, three_modes())
    modes, pairs, found = solved(session, step, monkeypatch)
    assert modes == reached
    assert pairs == {pair for pair in EVERY if reached & {*pair}}
    session.undo()
    monkeypatch.setattr(sessions, "_settled", lambda *_: None)
    assert solved(session, step, monkeypatch) == ({"park", "drive", "charge"}, EVERY, found)


def test_a_task_without_migration_has_its_modes_solved_together(tmp_path, monkeypatch):
    session = opened(tmp_path, three_modes(Binding.SYSTEM))
    modes, _, _ = solved(session, lambda s: s.edit(Edit("version", "steer", "wcet", "2ms", "v")), monkeypatch)
    assert modes == {"park", "drive"}


def test_a_state_without_schedule_of_its_own_settles_nothing(tmp_path, monkeypatch):
    session = opened(tmp_path, three_modes())
    session.edit(Edit("version", "pump", "wcet", "30ms", "v"))
    assert not session.state.is_valid
    modes, _, _ = solved(session, lambda s: s.edit(Edit("version", "pump", "wcet", "4ms", "v")), monkeypatch)
    assert modes == {"park", "drive", "charge"}


def test_tables_of_other_transitions_are_not_settled(tmp_path):
    session = opened(tmp_path, three_modes())
    before, schedule = session.state.model, session.state.schedule
    same = settled(before, before, schedule, ())
    assert (same.modes, same.transitions) == (schedule.modes, schedule.transitions)
    listed = replace(before, transitions=tuple(before.allowed_transitions())[:1])
    assert settled(before, listed, schedule, ()).transitions == ()


def test_a_switch_that_needs_another_unreached_mode_is_solved_as_a_whole(tmp_path, monkeypatch):
    session = opened(tmp_path, three_modes())
    asked = []
    whole = sessions.schedule_model

    def without_a_switch(system, options, *more):
        asked.append(options.settled)
        found = whole(system, options, *more)
        kept = found.schedule.transitions[1:] if options.settled else found.schedule.transitions
        return replace(found, schedule=replace(found.schedule, transitions=kept))

    monkeypatch.setattr(sessions, "schedule_model", without_a_switch)
    session.edit(Edit("version", "pump", "wcet", "4ms", "v"))
    assert len(session.state.schedule.transitions) == len(EVERY)
    assert [kept is None for kept in asked] == [False, True]
