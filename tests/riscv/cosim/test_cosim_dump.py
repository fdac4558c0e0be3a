"""What a board leaves of a run, read from a dump of its memory, or as the runtime prints it."""

import struct
from contextlib import contextmanager
from pathlib import Path

import pytest

from halpipe import cli
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.deploy.riscv import CoSimulation, codes
from halpipe.deploy.riscv.judge.board import board_trace
from halpipe.deploy.riscv.run.cosimulation import Word
from halpipe.deploy.riscv.run.recording import Flag, Kind, read_board
from halpipe.exporters.riscv import cores, render, target


@pytest.fixture(scope="module")
def run(sound):
    return CoSimulation(sound, cycles=6).run()


@pytest.fixture(scope="module")
def memory(run):
    return run.memory.read(run.site.main.base, run.site.main.size)


def test_a_binary_dump_holds_what_was_recorded(sound, run, memory):
    assert read_board(sound.bundle, memory, "m") == run.recording


def test_a_part_of_memory_from_an_address_is_enough(sound, run, memory):
    site = run.site
    first = min(site.control, site.trace.base, site.faults.base)
    assert read_board(sound.bundle, memory[first - site.main.base :], "m", first) == run.recording


def test_compare_takes_the_jobs_of_a_board(sound, memory, tmp_path, capsys):
    path = tmp_path / "memory.bin"
    path.write_bytes(memory)
    bundle = Path(sound.bundle.path)
    assert cli.invoke(["deploy", "trace", str(bundle), str(path), "-o", str(tmp_path / "t.csv")]) == 0
    assert "0 older ones were overwritten" in capsys.readouterr().err
    lines = (tmp_path / "t.csv").read_text().splitlines()
    assert lines[0] == "cycle,mode,task,job,units,start,end"
    arguments = ["compare", str(bundle / "schedule.xml"), str(tmp_path / "t.csv"), "--tolerance", "40us"]
    assert cli.invoke([*arguments, "--origin", "0ms"]) == 0
    assert cli.invoke([*arguments[:-1], "1ns", "--origin", "0ms"]) == 1  # starts are known by the tick


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda raw, site: raw[:4096], "are not in the dump"),
        (lambda raw, site: bytes(len(raw)), "no run of this bundle"),
        (lambda raw, site: b"control 1 2 3\ntrace 1\n", "cut off"),
        (lambda raw, site: b"", "are not in the dump"),
    ],
)
def test_what_is_no_recording_is_refused(sound, run, memory, spoil, said):
    with pytest.raises(HalpipeError) as failure:
        read_board(sound.bundle, spoil(memory, run.site), "m")
    assert [d.code for d in failure.value.diagnostics] == [codes.NO_RECORDING.id]
    assert said in failure.value.diagnostics[0].message


def test_a_record_of_nothing_is_refused(sound, run, memory):
    at = run.site.trace.base - run.site.main.base + 3 * run.site.trace.record
    spoilt = bytearray(memory)
    struct.pack_into("<I", spoilt, at + 28, 99)  # the table
    with pytest.raises(HalpipeError) as failure:
        board_trace(sound, read_board(sound.bundle, bytes(spoilt), "m"), "m")
    assert "does not have" in failure.value.diagnostics[0].message


TRAP = 'unsigned long smooth[8], command;\nvoid act(void) { __asm__ volatile(".word 0xc0001073"); }\n'


@contextmanager
def short_rings():
    """Export bundles whose rings have few records."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (cores, render, target):
            patch.setattr(module, "TRACE_RECORDS", 48)
            patch.setattr(module, "FAULT_RECORDS", 4)
        yield


def ring_faults(target):
    """Return why short rings do not hold the last records in order, each written when the simulator saw it counted."""
    run = CoSimulation(target, cycles=4, health=False).run(Duration.parse("100ms"))
    records, seen = run.recording.records, run.recorder.traced
    if (len(records), len(run.recording.abandoned)) != (48, 4) or len(seen) <= 2 * 48:
        return "not full"
    if run.recording.lost != len(seen) - 48 + run.word(Word.FAULTS) - 4:
        return "counts"
    ticks = [(now - run.zero) // run.tick for now, _ in seen[-49:]]
    timed = [(low, r, high) for low, r, high in zip(ticks, records, ticks[1:], strict=False) if r.kind != Kind.TABLE]
    if not all(low <= r.time <= high for low, r, high in timed):
        return "order"
    failed = [(r.cycle, r.release) for r in records if r.flags & Flag.FAULT]
    abandoned = [(a.cycle, a.release) for a in run.recording.abandoned]
    return "" if failed and abandoned[-len(failed) :] == failed[-4:] else "failures"


@pytest.mark.slow
def test_both_rings_wrap(export):
    with short_rings():
        short = export(sources={"act.c": TRAP})
    assert ring_faults(short) == ""


@pytest.mark.parametrize(("what", "instead"), [("cursor = TRACE;\n    }", "}"), ("count % HP_FAULT_CAPACITY", "count")])
def test_a_ring_that_does_not_wrap_is_found(mutant, what, instead):
    with short_rings():
        short = mutant("runtime.c", what, instead, sources={"act.c": TRAP})
    assert ring_faults(short)
