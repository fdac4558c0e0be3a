"""Faults on purpose, each of which the check has to catch, and to name."""

import json
from dataclasses import replace

import pytest
from tampering import COPY, RUN, STOP, resealed, tampered

from halpipe.core.bundles import open_bundle
from halpipe.core.diagnostics import Location
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import CoSimulation
from halpipe.deploy.riscv import codes as declared
from halpipe.deploy.riscv.board.elf import read_program
from halpipe.deploy.riscv.judge.check import check_by_simulation, simulate
from halpipe.deploy.riscv.judge.tables import Tables
from halpipe.deploy.riscv.judge.truth import tells_the_truth
from halpipe.deploy.riscv.run.cosimulation import load_program, plan
from halpipe.deploy.riscv.run.injection import Injection, Kind
from halpipe.deploy.riscv.run.recording import Flag
from halpipe.deploy.riscv.run.sequence import Tour, played_tables
from halpipe.deploy.riscv.target import read_site
from support import ms


def find(outcomes, code):
    """The findings of one code, of which there must be some."""
    found = [d for outcome in outcomes for d in outcome.findings if d.code == code.id]
    assert found, {d.code for outcome in outcomes for d in outcome.findings}
    return found


WILD = """#include <stdint.h>
uint64_t smooth[8], command;
void act(void) { command = 1; *(volatile uint64_t *)%s = 7; }
"""


@pytest.mark.parametrize(
    ("address", "where"),
    [
        pytest.param("0x80000000ull", "0x80000000"),  # main memory
        pytest.param("0x01040000ull", "data of left", marks=pytest.mark.slow),  # another core's scratchpad
        pytest.param("0x01840000ull", "code of right", marks=pytest.mark.slow),  # its own code
        pytest.param("0x02004000ull", "0x2004000", marks=pytest.mark.slow),  # the management core's timer
        pytest.param("0x03000000ull", "0x3000000", marks=pytest.mark.slow),  # the DMA engine
        pytest.param("0x64000000ull", "0x64000000", marks=pytest.mark.slow),  # the serial line
    ],
)
def test_a_job_that_writes_outside_its_scratchpad(export, play, address, where):
    outcomes = play(export(sources={"act.c": WILD % address}))
    fault = find(outcomes, declared.FAULT)[0]
    assert "store to memory that is not its own" in fault.message
    assert where in fault.message
    assert 'task "act"' in fault.path
    assert "the job trapped" in find(outcomes, declared.MISSING_TRANSFER)[0].message
    # Contained: nothing else suffers.
    assert {d.code for o in outcomes for d in o.findings} == {declared.FAULT.id, declared.MISSING_TRANSFER.id}
    assert all('task "act"' in d.path for o in outcomes for d in o.findings)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("statement", "what"),
    [
        ("command = *(volatile uint64_t *)0x80000000ull", "load from memory that is not its own"),
        ("((void (*)(void))0x80000000ull)()", "fetch from memory that is not its own"),
        ('__asm__ volatile(".word 0xffffffff")', "illegal instruction"),
        ('__asm__ volatile("lw t0, 2(%0)" ::"r"(smooth) : "t0")', "misaligned load"),
        ('__asm__ volatile("sd zero, 4(%0)" ::"r"(smooth))', "misaligned store"),
        ('__asm__ volatile("csrw pmpcfg0, zero")', "illegal instruction"),
        ('__asm__ volatile("csrr zero, 0x3a1")', "illegal instruction"),
        ('__asm__ volatile("csrw mtvec, zero")', "illegal instruction"),
        ('__asm__ volatile("rdcycle t0" ::: "t0")', "illegal instruction"),
        ('__asm__ volatile("mret")', "illegal instruction"),
        ('__asm__ volatile("ecall")', "system call"),
        ("*(volatile uint64_t *)0x0107ff08ull = 0", "store to memory that is not its own"),  # its mailbox
    ],
)
def test_a_job_that_loads_or_jumps_where_it_must_not(export, play, statement, what):
    source = f"#include <stdint.h>\nuint64_t smooth[8], command;\nvoid act(void) {{ {statement}; }}\n"
    assert what in find(play(export(sources={"act.c": source})), declared.FAULT)[0].message


@pytest.mark.slow
def test_a_job_that_overflows_its_stack(export, play):
    source = """#include <stdint.h>
uint64_t smooth[8], command;
static uint64_t deep(volatile uint64_t *above) {
    volatile uint64_t here[128];
    here[0] = above[0] + 1;
    return deep(here) + here[0];
}
void act(void) { volatile uint64_t first[1] = {0}; command = deep(first); }
"""
    assert "store to memory" in find(play(export(sources={"act.c": source})), declared.FAULT)[0].message


@pytest.mark.slow
def test_a_job_that_takes_too_long(export, play):
    outcomes = play(export(change=lambda text: text.replace('ROUNDS=20"', 'ROUNDS=40000"')))
    overrun = find(outcomes, declared.OVERRUN)[0]
    assert "had not returned on left after 750us" in overrun.message
    assert '"calm", job 0 of task "filter"' in overrun.path
    assert all('"filter"' in d.path for o in outcomes for d in o.findings)


@pytest.mark.slow
def test_a_job_that_never_ends_does_not_stop_the_others(export, play):
    source = "#include <stdint.h>\nuint64_t track[8], smooth[8];\nvoid filter(void) { for (;;) smooth[0]++; }\n"
    outcomes = play(export(sources={"filter.c": source}))
    assert find(outcomes, declared.OVERRUN)
    assert all('"filter"' in d.path for o in outcomes for d in o.findings)


def test_a_dma_engine_slower_than_planned(sound, play):
    slow = tuple(replace(resource, bandwidth=500_000) for resource in sound.model.resources)
    outcomes = play(replace(sound, model=replace(sound.model, resources=slow)))
    late = find(outcomes, declared.MISSING_TRANSFER) + find(outcomes, declared.MISSING_JOB)
    assert any("transfer not complete in time" in d.message for d in late)
    outside = find(outcomes, declared.TRANSFER_OUTSIDE_PHASE)
    assert "its phase is" in outside[0].message
    assert "deploy prepare" in outside[0].help


def with_a_camera(text):
    """The model of these tests; filter reads for three milliseconds, over a channel of its own."""
    memory = '<resource name="memory" bandwidth="400MB/s"/>'
    read = '<access resource="memory" start="100us" end="150us" kind="read">\n          <transfer buffer="track"'
    assert memory in text
    assert read in text
    text = text.replace(read, read.replace("memory", "camera").replace("150us", "3ms"), 1)
    return text.replace(memory, memory + memory.replace("memory", "camera"))


def test_an_error_of_a_transfer_is_kept_while_others_look_for_late_ones(export):
    """While filter's transfer fails, act overruns; sense is loaded next, and must not take the engine's answer."""
    target = export(change=with_a_camera)
    tour = Tour("full", (), 4)
    site = read_site(target.bundle)
    jobs = plan(target, site, played_tables(target.schedule, tour.first, (), tour.tables, site.tick))
    rows = {(job.job.task, job.job.index): job.row for job in jobs}
    overruns = Injection(Kind.SPIN, 0, rows["act", 1])
    fails = Injection(Kind.DMA_ERROR, 1, rows["filter", 0])
    assert simulate(target, tour, injections=[overruns, fails]).findings == []


def test_a_release_at_another_instant(sound, play, tmp_path):
    def change(program):
        base, size = program.symbols["table_0"]
        row = next(at for at in range(base, base + size, 16) if program.get(at) == 5600)
        program.put(row, 5650)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    wrong = find(outcomes, declared.WRONG_INSTANT)[0]
    assert '"full", job 1 of task "sense"' in wrong.path
    assert "scheduled is 5.75ms" in wrong.message


def test_a_release_that_is_too_early(sound, play, tmp_path):
    def change(program):
        base, size = program.symbols["table_0"]
        row = next(at for at in range(base, base + size, 16) if program.get(at) == 5600)
        program.put(row, 5550)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert "scheduled is 5.75ms" in find(outcomes, declared.WRONG_INSTANT)[0].message
    assert "its phase is 5.6ms to 5.7ms" in find(outcomes, declared.TRANSFER_OUTSIDE_PHASE)[0].message


def test_an_execution_of_another_function(sound, play, tmp_path):
    def change(program):
        at = program.operations(RUN)[0]
        program.put(at + 8, program.get(at + 8) + 4)

    assert find(play(tampered(sound, tmp_path / "b", change)), declared.MISSING_JOB)


def test_swapped_transfers(sound, play, tmp_path):
    def change(program):
        reads = [at for at in program.operations(COPY) if program.get(at + 24) == 64 and program.get(at + 8) > 1 << 31]
        one, other = reads[0], next(at for at in reads if program.get(at + 8) != program.get(reads[0] + 8))
        first, second = program.get(one + 8), program.get(other + 8)
        program.put(one + 8, second)
        program.put(other + 8, first)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    foreign = find(outcomes, declared.FOREIGN_TRANSFER)[0]
    assert 'from buffer "' in foreign.message
    assert find(outcomes, declared.MISSING_TRANSFER)


def test_a_transfer_of_fewer_bytes(sound, play, tmp_path):
    def change(program):
        at = next(at for at in program.operations(COPY) if program.get(at + 24) == 64)
        program.put(at + 24, 56)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert any("56 bytes" in d.message for d in find(outcomes, declared.FOREIGN_TRANSFER))
    assert find(outcomes, declared.MISSING_TRANSFER)


def test_a_job_that_is_released_twice(sound, play, tmp_path):
    """The second sense of mode full becomes one more act."""

    def change(program):
        base, size = program.symbols["table_0"]
        rows = {program.get(at): at for at in range(base, base + size, 16)}
        program.put(rows[5600] + 8, program.get(rows[4500] + 8, 4), 4)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert 'right executes task "act"' in find(outcomes, declared.FOREIGN_JOB)[0].message


def test_a_switch_that_leads_to_the_wrong_table(sound, play, tmp_path):
    def change(program):
        base, size = program.symbols["hp_switches"]
        assert size == 36  # 3 modes: 9 numbers of 32 bits
        program.put(base + 4, 4, 4)  # full to calm: calm->full

    outcomes = play(tampered(sound, tmp_path / "b", change))
    wrong = find(outcomes, declared.WRONG_TABLE)[0]
    assert 'plays "calm->full"' in wrong.message
    assert 'it has to be "full->calm"' in wrong.message


def test_a_mode_that_lasts_too_long(sound, play, tmp_path):
    def change(program):
        base, _ = program.symbols["hp_tables"]
        assert program.get(base + 8) == 10_000
        program.put(base + 8, 10_100)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert "it has to be at 10ms" in find(outcomes, declared.WRONG_TABLE)[0].message


def test_a_flipped_byte_breaks_the_seal(sound, tmp_path, refused):
    target = resealed(sound, tmp_path / "b", {})
    elf = tmp_path / "b" / "bundle.elf"
    data = bytearray(elf.read_bytes())
    data[len(data) // 2] ^= 1
    elf.write_bytes(data)
    assert [d.code for d in refused(open_bundle, target.bundle.path)] == ["HAL1002"]


def test_an_image_in_the_program_that_is_not_the_one_that_was_built(sound, play, tmp_path):
    """The seal is renewed, so only the comparison of what is executed with the image's own file can tell."""

    def change(program):
        at = max(program.operations(COPY), key=lambda at: program.get(at + 24))
        image = program.get(at + 8)
        program.put(image + program.get(at + 24) - 4, 0x00000013, 4)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert "are not those that were loaded" in find(outcomes, declared.WRONG_DATA)[0].message


def test_cores_that_never_lock_their_protection(sound, play, tmp_path):
    def change(program):
        patched = 0
        for address, length, _ in program.parts:
            for at in range(address, address + length - 4, 2):
                if program.get(at, 4) & 0xFFF0707F == 0x3A001073:  # csrw pmpcfg0, rs
                    program.put(at, 0x00000013, 4)
                    patched += 1
        assert patched >= 2

    outcomes = play(tampered(sound, tmp_path / "b", change))
    opened = find(outcomes, declared.OPEN_CORE)
    assert {d.path for d in opened} == {'unit "left"', 'unit "right"'}
    assert "never armed" in opened[0].message


def test_a_runtime_that_does_not_begin(sound, play, tmp_path):
    def change(program):
        program.put(program.symbols["_start"][0], 0x0000006F, 4)  # j . for all cores

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert "did not come to the first table" in find(outcomes, declared.NOT_FINISHED)[0].message


def test_a_management_core_that_traps(sound, play, tmp_path):
    def change(program):
        program.put(program.symbols["runtime"][0], 0xFFFFFFFF, 4)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert "the management core trapped" in find(outcomes, declared.NOT_FINISHED)[0].message


def test_a_stop_that_comes_too_early_is_seen_in_the_record(sound, play, tmp_path):
    def change(program):
        at = program.operations(STOP)[0]
        program.put(at, program.get(at) - (3700 << 2))

    assert play(tampered(sound, tmp_path / "b", change))[0].findings


def test_everything_is_reported_by_the_check(sound, tmp_path):
    def change(program):
        program.put(program.symbols["hp_switches"][0] + 4, 4, 4)

    checked = check_by_simulation(tampered(sound, tmp_path / "b", change), CheckOptions())
    assert any(d.code == declared.WRONG_TABLE.id for d in checked.diagnostics)
    assert not any("as scheduled" in line for line in checked.lines)


def test_a_transfer_that_touches_a_core_at_work(sound, play, tmp_path):
    """While filter executes on left from 150us on, sense is released early, and its image loaded into left's data."""

    def change(program):
        base, size = program.symbols["table_0"]
        rows = {program.get(at): at for at in range(base, base + size, 16)}
        program.put(rows[600], 160)
        index = program.get(rows[600] + 8, 4)
        first = program.symbols[f"program_{index}"][0]
        program.put(first + 16, 0x01060000)

    outcomes = play(tampered(sound, tmp_path / "b", change))
    assert "data of left (0x1060000)" in find(outcomes, declared.TRANSFERS_TOGETHER)[0].message


@pytest.mark.parametrize(
    "lie",
    [
        lambda r: [replace(x, begin=x.begin + 50) if x.kind == STOP and x.begin else x for x in r],
        lambda r: [x for x in r if x.kind != COPY],
        lambda r: [replace(x, flags=Flag.OVERRUN) if x.kind == STOP else x for x in r],
        lambda r: [replace(x, begin=x.begin + 1) if x.kind == 0 else x for x in r],
    ],
)
def test_a_runtime_that_records_something_else(sound, play, lie):
    (outcome,) = play(sound)
    records = tuple(lie(outcome.run.recording.records))
    assert records != outcome.run.recording.records
    run = replace(outcome.run, recording=replace(outcome.run.recording, records=records))
    tables = Tables(load_program(sound.bundle, run.site), sound.model)
    assert {d.code for d in tells_the_truth(run, tables, outcome.tables)} == {declared.TRACE_DISAGREES.id}
    assert list(tells_the_truth(outcome.run, tables, outcome.tables)) == []


@pytest.mark.parametrize(
    "wrong",
    [{"first": "calmer"}, {"execution": "imagined"}, {"cycles": -1}, {"cpi": 0}, {"requests": [(ms(1), "fast")]}],
)
def test_what_cannot_be_simulated_is_refused(sound, refused, wrong):
    assert [d.code for d in refused(CoSimulation, sound, **wrong)] == [declared.BAD_REQUEST.id]


def test_a_program_outside_main_memory_is_refused(sound, tmp_path, refused):
    data = bytearray(sound.bundle.files["bundle.elf"])
    headers = int.from_bytes(data[32:40], "little")
    data[headers + 24 : headers + 32] = (0x1000).to_bytes(8, "little")  # p_paddr of the first segment
    target = resealed(sound, tmp_path / "b", {"bundle.elf": bytes(data)})
    assert declared.BROKEN_PROGRAM.id in {d.code for d in refused(CoSimulation, target)}


@pytest.mark.parametrize("place", [1 << 27, 1 << 60])
def test_an_image_outside_the_memories_of_its_core_is_refused(sound, tmp_path, refused, place):
    """The end of what is cleared for it lies far behind; as many zeros are in no memory."""
    name = "images/0.elf"
    data = sound.bundle.files[name]
    (end, _) = read_program(data, Location(name)).symbols["hp_bss_end"]
    spoilt = data.replace(end.to_bytes(8, "little"), (end + place).to_bytes(8, "little"))
    assert spoilt != data
    (found,) = refused(check_by_simulation, resealed(sound, tmp_path / "b", {name: spoilt}), CheckOptions())
    assert found.code == declared.BROKEN_PROGRAM.id
    assert "are not in the scratchpads of its core" in found.message


def test_tables_that_are_not_those_of_the_schedule_are_refused(sound, tmp_path, refused, play):
    described = json.loads(sound.bundle.files["target.json"])
    described["tables"][0]["length"] += 1
    target = resealed(sound, tmp_path / "b", {"target.json": json.dumps(described).encode()})
    (found,) = refused(play, target)
    assert found.code == declared.BROKEN_TARGET.id
    assert "full (10.001ms)" in found.message
