"""A bundle that does what its schedule says: nothing is found, everything is played, twice the same."""

import sys
from collections import Counter
from fractions import Fraction

import pytest

from halpipe.cli import invoke
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, CoSimulation, Plant
from halpipe.deploy.riscv.codes import ENGINE_ABSENT
from halpipe.deploy.riscv.judge.conditions import tick_of
from halpipe.deploy.riscv.run.observation import Outcome
from halpipe.exporters.riscv.profile import read_profile
from halpipe.exporters.riscv.render import margin
from support import ms

VCU118 = read_profile("vcu118")


@pytest.mark.parametrize("execution", ["real", "modelled"])
def test_nothing_is_found_in_a_sound_bundle(sound, play, execution):
    assert [found for outcome in play(sound, execution=execution) for found in outcome.findings] == []


@pytest.mark.slow
@pytest.mark.parametrize("profile", ["fu540", "mpfs", "virt", "vcu118x8"])
@pytest.mark.parametrize("execution", ["real", "modelled"])
def test_nothing_is_found_in_a_sound_bundle_for_another_target(export, play, profile, execution):
    outcomes = play(export(profile=profile), execution=execution)
    assert [found for outcome in outcomes for found in outcome.findings] == []


def test_every_mode_and_every_transition_is_played(sound, play):
    (outcome,) = play(sound)
    played = Counter(table.name for table in outcome.tables)
    assert set(played) == {"full", "calm", "halt", "full->calm", "calm->full", "calm->halt"}
    assert min(played["full"], played["calm"], played["halt"]) >= 2


def test_every_job_is_seen_with_its_executions_and_transfers(sound, play):
    (outcome,) = play(sound)
    assert all(None not in seen.executions + seen.transfers for seen in outcome.jobs)
    assert all(e.outcome is Outcome.RETURNED for seen in outcome.jobs for e in seen.executions)


def test_starts_are_late_by_microseconds_only(sound, play):
    (outcome,) = play(sound)
    late = [outcome.run.since(seen.begin) - outcome.run.site.tick * seen.planned.begin for seen in outcome.jobs]
    assert Duration(0) <= min(late)
    assert max(late) <= ms("10us")


@pytest.mark.slow
def test_the_trace_is_the_same_in_every_run_and_says_what_was_seen(sound):
    first, second = (DEPLOYMENT.check(sound, CheckOptions()) for _ in range(2))
    assert first == second
    lines = first.files["trace"].decode().splitlines()
    assert lines[0] == "cycle,mode,task,job,units,start,end"
    cycle, mode, task, index, units, start, end = lines[1].split(",")
    assert (cycle, mode, task, index, units) == ("0", "full", "filter", "0", "left")
    assert 0 <= int(start) <= 10_000  # nanoseconds
    assert 3_900_000 <= int(end) <= 4_000_000


@pytest.mark.slow
def test_the_result_says_what_was_played(sound):
    checked = DEPLOYMENT.check(sound, CheckOptions(cycles=3))
    assert checked.diagnostics == ()
    assert checked.lines[-1].endswith("as scheduled")
    assert any(line.startswith("full->calm") for line in checked.lines)


def test_modelled_executions_take_the_time_of_the_schedule(sound, play):
    (real,), (modelled,) = play(sound), play(sound, execution="modelled")
    lengths = [
        max(outcome.run.since(e.end - e.begin + outcome.run.zero) for seen in outcome.jobs for e in seen.executions)
        for outcome in (real, modelled)
    ]
    assert lengths[0] < ms("1ms") < ms("3.7ms") < lengths[1] <= ms("3.75ms")
    pairs = [(p, e) for job in modelled.jobs for p, e in zip(job.planned.executions, job.executions, strict=True)]
    assert {planned.end - tick_of(modelled.run, execution.end) for planned, execution in pairs} == {margin(VCU118)}


class Ramp(Plant):
    """A world whose sample grows by one with every cycle."""

    def __init__(self):
        self.cycles, self.commands, self.read = [], [], []

    def start(self, board):
        board.write("sample", (100).to_bytes(8, "little") * 8)

    def cycle(self, board, now, cycle, table):
        self.cycles.append((now, cycle, table))
        board.write("sample", (100 + cycle).to_bytes(8, "little") * 8)

    def reads(self, board, now, buffer):
        self.read.append((now, buffer))

    def written(self, board, now, buffer):
        if buffer == "command":
            self.commands.append((now, int.from_bytes(board.read("command")[:8], "little")))


def test_a_plant_is_in_the_loop(sound):
    plant = Ramp()
    run = CoSimulation(sound, plant=plant, cycles=20, requests=[(ms("25ms"), "calm")]).run()
    assert plant.cycles[:4] == [
        (ms("0ms"), 0, "full"),
        (ms("10ms"), 1, "full"),
        (ms("20ms"), 2, "full"),
        (ms("30ms"), 3, "full->calm"),
    ]
    assert plant.cycles[4] == (ms("30ms"), 4, "calm")
    assert run.requests[0].instant == ms("25ms")
    assert (ms("600us") < plant.read[1][0] < ms("1ms")) or plant.read[0][1] == "track"
    instants, values = zip(*plant.commands, strict=True)
    assert len(values) == 2 * 19  # the last job of the last cycle, which wraps, too
    assert values[-1] > values[4] > 0
    assert all(ms("450us") <= Duration(now.fraction % 5_000_000) <= ms("500us") for now in instants)


def test_state_survives_in_main_memory_only(sound):
    class Look(Plant):
        def __init__(self):
            self.counts = []

        def written(self, board, now, buffer):
            if buffer == "state":
                self.counts.append(int.from_bytes(board.read("state")[:8], "little"))

    plant = Look()
    CoSimulation(sound, plant=plant, cycles=3).run()
    assert plant.counts == [1, 2, 3, 4, 5, 6]


def test_a_plant_can_request_a_mode_and_stop(sound):
    class Halting(Plant):
        def cycle(self, board, now, cycle, table):
            if cycle == 1:
                board.request("calm")
            if table == "halt":
                board.stop()
            elif table == "calm":
                board.request("halt")

    run = CoSimulation(sound, plant=Halting()).run(ms("1s"))
    assert [table.name for table in run.tables] == ["full", "full", "full->calm", "calm", "calm->halt", "halt"]


def test_a_request_without_a_transition_is_refused_by_the_runtime(sound):
    run = CoSimulation(sound, cycles=3, requests=[(ms("5ms"), "halt")]).run()
    assert [table.name for table in run.tables] == ["full"] * 3
    assert run.word(15) == 1


def test_more_than_a_buffer_holds_cannot_be_written(sound):
    class Flood(Plant):
        def start(self, board):
            board.write("sample", bytes(65))

    with pytest.raises(ValueError, match="has 64 bytes, not 65"):
        CoSimulation(sound, plant=Flood(), cycles=1).run()


@pytest.mark.slow  # one run and its trace are what the tests before are about
def test_every_run_has_a_trace_of_its_own(export, tmp_path):
    """Where full does not lead back to calm, its switch to halt needs a second run."""
    target = export(change=lambda text: text.replace('<transition from="calm" to="full"/>', ""))
    checked = DEPLOYMENT.check(target, CheckOptions())
    assert sorted(checked.files) == ["trace"]
    again = export(change=lambda text: text.replace('<transition from="full" to="calm"/>', ""))
    checked = DEPLOYMENT.check(again, CheckOptions())
    assert checked.diagnostics == ()
    assert sorted(checked.files) == ["trace", "trace-2"]
    assert invoke(["deploy", "check", again.bundle.path, "--trace", str(tmp_path / "seen.csv")]) == 0
    assert tmp_path.joinpath("seen-2.csv").read_bytes() == checked.files["trace-2"]


def test_without_the_emulator_the_way_to_install_it_is_told(sound, monkeypatch):
    monkeypatch.setitem(sys.modules, "unicorn", None)
    with pytest.raises(HalpipeError) as failure:
        CoSimulation(sound)
    (found,) = failure.value.diagnostics
    assert found.code == ENGINE_ABSENT.id
    assert "pip install ziglang pyelftools unicorn" in found.help


@pytest.mark.slow
def test_the_command_ends_with_0_for_a_sound_bundle_and_writes_the_trace(sound, tmp_path, capsys):
    trace = tmp_path / "trace.csv"
    assert invoke(["deploy", "check", sound.bundle.path, "--trace", str(trace)]) == 0
    assert "every start, end and transfer is as scheduled" in capsys.readouterr().out
    assert trace.read_text().startswith("cycle,mode,task,job,units,start,end\n0,full,filter,0,left,")


@pytest.mark.slow
def test_transfers_take_the_time_of_the_slower_of_engine_and_resource(sound, export, play):
    slower = export(change=lambda text: text.replace("400MB/s", "10MB/s"))
    for target, rate in ((sound, 400), (slower, 10)):
        (outcome,) = play(target)
        assert outcome.findings == []
        for transfer in outcome.run.recorder.transfers:
            took = outcome.run.since(transfer.end - transfer.begin + outcome.run.zero)
            assert took == outcome.run.site.dma.latency + Duration(Fraction(1000 * transfer.size, rate))
