"""Runtimes with a fault each, built as bundles are: the check has to find every one, by what they do."""

import json
import shutil
from fractions import Fraction

import pytest
from tampering import COPY, DONE, RUN, STOP, resealed, tampered

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv import codes as declared
from halpipe.deploy.riscv.board.machine import Timing
from halpipe.deploy.riscv.judge import check
from halpipe.deploy.riscv.judge.containment import PREFIX
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.exporters.riscv import bundle
from halpipe.exporters.riscv.profile import FOLDER
from one_fault import with_fault
from profiles import in_turn

# file, what stands there, what stands there instead; the code that the check must find
CONTAINMENT = {
    "abandoning does nothing": ("runtime.c", "s->is_over = 1U;", "s->is_over = 0U;", declared.FOREIGN_TRANSFER),
    "the deadline is never armed": (
        "monitor.c",
        "MTIMECMP(hp_site[HART]) = box->deadline;",
        "MTIMECMP(hp_site[HART]) = NEVER;",
        declared.WRONG_CALL,
    ),
    "the deadline is a second late": (
        "monitor.c",
        "= box->deadline;",
        "= box->deadline + 1000000U;",
        declared.WRONG_CALL,
    ),
    "the timer is not enabled": ("monitor.c", "WRITE_CSR(mie, MIE_TIMER);", "", declared.WRONG_CALL),
    "faults are ignored": ("monitor.c", "box->status = FLAG_FAULT;", "box->status = 0U;", declared.FOREIGN_TRANSFER),
    "overruns are ignored": (
        "runtime.c",
        "uint64_t flags = FLAG_OVERRUN;",
        "uint64_t flags = 0U;",
        declared.FOREIGN_TRANSFER,
    ),
    "overruns look like returns": (
        "monitor.c",
        "box->status = FLAG_OVERRUN;",
        "box->status = 0U;",
        declared.TRACE_DISAGREES,
    ),
    "late transfers are ignored": (
        "runtime.c",
        "((state == DMA_BUSY) ? FLAG_LATE : 0U)",
        "0U",
        declared.NOT_CONTAINED,
    ),
    "errors of the DMA engine are ignored": (
        "runtime.c",
        "(state == DMA_FAILED) ? FLAG_ERROR",
        "(state == DMA_FAILED) ? 0U",
        declared.NOT_CONTAINED,
    ),
    "nothing is recorded": ("runtime.c", "CONTROL->faults = count + 1U;", "", declared.TRACE_DISAGREES),
    "the cause is not recorded": ("runtime.c", "box->epc : 0U", "0U : 0U", declared.NOT_CONTAINED),
    "what was abandoned goes on": ("runtime.c", "flags = FLAG_SKIPPED;", "flags = run(s, o);", None),
    "jobs execute in machine mode": ("monitor.S", "csrc mstatus, t0", "csrs mstatus, t0", None),
    "the protection is never armed": ("monitor.c", "WRITE_CSR(pmpcfg0, entries);", "", declared.OPEN_CORE),
    "the data of others is open": ("monitor.c", "hp_site[JOB_END] >> 2U", "NEVER >> 10U", declared.OPEN_CORE),
    "a trap keeps the stack of the job": ("monitor.S", "ld sp, hp_site + 40\n    call trapped", "call trapped", None),
    "the mailbox is open": ("monitor.c", "hp_site[JOB_END] >> 2U", "hp_site[DSPM_END] >> 2U", declared.OPEN_CORE),
}
OTHERS = {
    ".bss is not cleared": ("monitor.c", "*(volatile uint64_t *)word = 0U;", "(void)word;", declared.WRONG_DATA),
    "the rank is wrong": ("monitor.c", "ranks & 0xffffffffU", "(ranks & 0xffffffffU) + 1U", declared.WRONG_CALL),
    "the size of the gang is wrong": ("monitor.c", "ranks >> 32U", "(ranks >> 32U) + 1U", declared.WRONG_CALL),
    "the stack is at the mailbox": ("monitor.c", "hp_site[JOB_STACK])", "hp_site[BOX])", declared.WRONG_CALL),
    "counters are open": ("monitor.c", "WRITE_CSR(mcounteren, 0U)", "WRITE_CSR(mcounteren, 7U)", declared.WRONG_CALL),
    "registers are not cleared": ("monitor.S", "li \\register, 0", "nop", declared.WRONG_CALL),
    "floating point is on": (
        "monitor.S",
        "li t0, 0x1800 ",
        "li t0, 0x6000\n    csrs mstatus, t0\n    li t0, 0x1800 ",
        None,
    ),
    "old code is fetched": ("monitor.c", "fence\\n fence.i\\n csrsi", "fence\\n csrsi", declared.WRONG_CALL),
    "the runtime's own .bss is not cleared": ("start.S", "sd zero, 0(t0)", "nop", None),
    "half of each transfer": ("dma.c", "c->bytes = o->size;", "c->bytes = o->size / 2U;", declared.FOREIGN_TRANSFER),
    "a trap of the monitor for ever": ("monitor.S", "call trapped", ".word 0", declared.SPENT),
    "the management core polls": ("runtime.c", "wait_for_interrupt();", "", None),
    "the deadline is a tick late": (
        "runtime.c",
        "+ o->limit;\n        box->entry",
        "+ o->limit + 1U;\n        box->entry",
        declared.WRONG_CALL,
    ),
    "software interrupts end jobs": (
        "monitor.c",
        "MIE_TIMER);\n    __asm",
        "MIE_TIMER | MIE_SOFTWARE);\n    __asm",
        declared.WRONG_CALL,
    ),
    "a register that no job uses is not cleared": ("monitor.S", ", t5, t6", ", t5", declared.WRONG_CALL),
    "monitors are fetched from before": (
        "start.S",
        "fence.i\n    la t0, hp_monitors",
        "la t0, hp_monitors",
        declared.WRONG_CALL,
    ),
    "the core sleeps a tick too long": (
        "runtime.c",
        "wait_until(key >> 2U)",
        "wait_until((key >> 2U) + 1U)",
        declared.SLOW_DISPATCH,
    ),
    "requests are read early": ("runtime.c", "(end - HP_DECISION)", "(end - HP_DECISION - 40U)", declared.WRONG_TABLE),
    "transactions of one byte": ("dma.c", "0x66000000U", "0U", declared.TRANSFER_OUTSIDE_PHASE),
    "channels are not given up": ("dma.c", "c->control = 0U;", "", declared.TRACE_DISAGREES),
    "records with other words": ("runtime.c", "{MTIME, 0U, 0U};", "{MTIME, 1U, 0U};", declared.TRACE_DISAGREES),
    "records of other rows": ("runtime.c", "= current.row |", "= (current.row + 1U) |", declared.TRACE_DISAGREES),
    "records a tick late": (
        "runtime.c",
        "at.time = now - base;\n        record",
        "at.time = now - base + 1U;\n        record",
        declared.TRACE_DISAGREES,
    ),
    "tables at other instants": (
        "runtime.c",
        "        at.time = now - base;\n    }",
        "        at.time = now + base;\n    }",
        declared.TRACE_DISAGREES,
    ),
    "tables are not counted": ("runtime.c", "CONTROL->played = current.cycle;", "", declared.TRACE_DISAGREES),
    "failures of other operations": ("runtime.c", "(uint32_t)s->place;", "0U;", declared.TRACE_DISAGREES),
    "the core waits a tick too long": (
        "runtime.c",
        "while (MTIME < instant)",
        "while (MTIME <= instant)",
        declared.SLOW_DISPATCH,
    ),
    "ends of tables": ("runtime.c", "(start - base) + hp", "(start - base) - hp", declared.TRACE_DISAGREES),
    "modelled executions": (
        "runtime.c",
        "CONTROL->execution != 0U",
        "CONTROL->execution == 0U",
        declared.TRACE_DISAGREES,
    ),
    "no patience with cores": ("runtime.c", "; attempts++)", "; attempts--)", declared.TRACE_DISAGREES),
    "cores go where nothing sends them": ("start.S", "    beqz t1, 1b\n", "", declared.TRACE_DISAGREES),
    "counters as they were": ("monitor.c", "    WRITE_CSR(mcounteren, 0U);\n", "", declared.WRONG_CALL),
    "states of before": ("runtime.c", "    CONTROL->state = STATE_BOOTING;\n", "", declared.COLD_START),
    "requests are never read": ("runtime.c", 'amoswap.d %0, zero, (%1)"', 'li %0, 0"', declared.WRONG_TABLE),
}


def found_in(target, **options):
    return {d.code for d in DEPLOYMENT.check(target, CheckOptions(**options)).diagnostics if d.is_error}


@pytest.mark.parametrize("name", in_turn(CONTAINMENT))
@pytest.mark.slow  # test_cosim_faults.py has the quick ones
def test_what_does_not_contain_faults(mutant, name):
    file, what, instead, code = CONTAINMENT[name]
    found = found_in(mutant(file, what, instead))
    assert found
    assert code is None or code.id in found


@pytest.mark.parametrize("name", in_turn(OTHERS))
@pytest.mark.slow
def test_what_calls_jobs_in_a_wrong_way(mutant, name):
    file, what, instead, code = OTHERS[name]
    found = found_in(mutant(file, what, instead))
    assert found
    assert code is None or code.id in found


def spoil(target, tmp_path, change):
    described = json.loads(target.bundle.files["target.json"])
    change(described)
    return resealed(target, tmp_path / "b", {"target.json": json.dumps(described).encode()})


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d["dma"].update(bandwidth=800_000_000),
        lambda d: d["dma"].update(setup="1us"),
        lambda d: d.update(clock=200_000_000),
        lambda d: d.update(service="9us"),
        lambda d: d.update(stack=4096),
        lambda d: d["units"][0].update(mailbox=hex(int(d["units"][0]["mailbox"], 16) - 256)),
        lambda d: d.update(qemu=["-machine", "virt"]),
    ],
)
def test_a_machine_that_is_not_the_profile(sound, tmp_path, change):
    assert declared.FOREIGN_MACHINE.id in found_in(spoil(sound, tmp_path, change), inject="none")


@pytest.mark.parametrize("cpi", ["1.75", "2", "1.50"])
def test_a_profile_of_ones_own_with_cycles_that_are_no_whole_number(export, tmp_path, cpi):
    (tmp_path / "slow.yaml").write_text(FOLDER.joinpath("vcu118.yaml").read_text() + f"cpi: {cpi}\n")
    assert check.static_findings(export(profile=str(tmp_path / "slow.yaml"))) == []


def test_a_buffer_of_another_size(sound, tmp_path):
    target = spoil(sound, tmp_path, lambda d: d["buffers"][-1].update(size=d["buffers"][-1]["size"] + 8))
    (found,) = check.static_findings(target)
    assert (found.code, found.path) == (declared.FOREIGN_CONTENT.id, 'buffer "track"')
    assert "it has 72 bytes; by the model it has 64" in found.message


def test_a_flat_program_that_is_another(sound, tmp_path):
    data = bytearray(sound.bundle.files["bundle.bin"])
    data[0x100:0x140] = bytes(64)
    target = resealed(sound, tmp_path / "b", {"bundle.bin": bytes(data)})
    assert found_in(target, inject="none") == {declared.FOREIGN_CONTENT.id}


def test_an_image_whose_bytes_are_not_those_in_the_program(sound, tmp_path):
    def change(program):
        base = int(json.loads(sound.bundle.files["target.json"])["images"][0]["load"][0]["source"], 16)
        program.put(base, 0, 4)

    assert declared.FOREIGN_CONTENT.id in found_in(tampered(sound, tmp_path / "b", change), inject="none")


@pytest.mark.parametrize("key", ["bss", "load"])
def test_images_described_wrongly(sound, tmp_path, key):
    def change(described):
        found = described["images"][0][key]
        found = found[0] if isinstance(found, list) else found
        found["size"] += 8

    assert declared.FOREIGN_CONTENT.id in found_in(spoil(sound, tmp_path, change), inject="none")


@pytest.mark.slow
def test_faults_are_injected_into_every_job_and_contained(sound):
    checked = DEPLOYMENT.check(sound, CheckOptions(inject="all"))
    assert checked.diagnostics == ()
    assert "injected: 143 faults of 13 kinds into 11 jobs" in checked.lines


def test_what_takes_too_long_to_inject_is_told(sound, monkeypatch):
    monkeypatch.setattr(check, "BRIEF", 1)
    (found,) = DEPLOYMENT.check(sound, CheckOptions()).diagnostics
    assert found.code == declared.NOT_INJECTED.id
    assert found.message == "24 of the 26 cycles that have every fault in every job were not played"


def spoilt_table(kind, offset, change, size=8):
    """A change of the first operation of a kind."""

    def spoil(program):
        at = program.operations(kind)[0]
        program.put(at + offset, change(program.get(at + offset, size)), size)

    return spoil


@pytest.mark.parametrize(
    "change",
    [
        spoilt_table(COPY, 8, lambda source: source + 8),
        spoilt_table(COPY, 24, lambda size: size // 2),
        spoilt_table(COPY, 37, lambda channel: channel + 1, 1),
        spoilt_table(COPY, 0, lambda key: key + (60_000 << 2)),
        spoilt_table(RUN, 8, lambda function: function + 4),
        spoilt_table(RUN, 24, lambda bss: 0 if bss else 8),
        spoilt_table(RUN, 32, lambda limit: limit + 1, 4),
        spoilt_table(RUN, 40, lambda rank: rank + 1, 4),
        spoilt_table(RUN, 44, lambda ranks: ranks + 1, 4),
        spoilt_table(STOP, 0, lambda key: key - (4 << 2)),
        spoilt_table(STOP, 38, lambda unit: 1 - unit, 1),
        spoilt_table(STOP, 39, lambda reserved: 1, 1),
        spoilt_table(STOP, 8, lambda source: 1),
        spoilt_table(DONE, 32, lambda limit: 1 << 27, 4),
        spoilt_table(DONE, 38, lambda unit: 1 - unit, 1),
        spoilt_table(COPY, 40, lambda rank: 1, 4),
        lambda program: program.put(program.get(program.symbols["hp_tables"][0], 8) + 12, 1, 4),  # behind a release
    ],
)
def test_tables_that_are_not_those_of_the_schedule_are_found_without_playing(sound, tmp_path, change):
    found = check.static_findings(tampered(sound, tmp_path / "b", change))
    assert {d.code for d in found} == {declared.WRONG_OPERATIONS.id}
    assert check.static_findings(sound) == []


@pytest.mark.parametrize("at", [0, 8, 16, 24])
def test_a_monitor_that_is_put_elsewhere_is_found_without_playing(sound, tmp_path, at):
    def spoil(program):
        row = program.symbols["hp_units"][0] + at
        program.put(row, program.get(row) + 8)

    (found,) = check.static_findings(tampered(sound, tmp_path / "b", spoil))
    assert found.message == "its code, or where that is put, is another in bundle.elf"


def _with_runtime(export, tmp_path, monkeypatch, what, instead, change=lambda text: text):
    shutil.copytree(bundle.RUNTIME, tmp_path / "runtime")
    path = tmp_path / "runtime" / "runtime.c"
    path.write_text(with_fault(path.read_text(), what, instead))
    monkeypatch.setattr(bundle, "RUNTIME", tmp_path / "runtime")
    return export(change=change)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "instead", "said"),
    [
        ("clear(HP_BUFFERS, HP_BUFFERS_END);", "(void)0;", "holds after a cold start"),
        ("clear(HP_BUFFERS, HP_BUFFERS_END);", "clear(HP_BUFFERS, HP_BUFFERS + 8U);", "holds after a cold start"),
        (
            "(CONTROL->first < HP_MODES) ? (uint32_t)CONTROL->first : 0U",
            "(CONTROL->magic != HP_MAGIC) ? 1U : (CONTROL->first < HP_MODES) ? (uint32_t)CONTROL->first : 0U",
            '"calm" begins',
        ),
        ("(CONTROL->first < HP_MODES)", "(CONTROL->first <= HP_MODES)", "where the first mode is stated as one behind"),
        (
            "clear(HP_CONTROL + (uint64_t)offsetof(hp_control, base), HP_CONTROL + (uint64_t)sizeof(hp_control));",
            "(void)0;",
            "counts what the memory held before a cold start",
        ),
    ],
)
def test_a_runtime_that_does_not_prepare_memory_is_found_by_a_cold_start(
    export, tmp_path, monkeypatch, what, instead, said
):
    checked = DEPLOYMENT.check(_with_runtime(export, tmp_path, monkeypatch, what, instead), CheckOptions(inject="none"))
    found = [d for d in checked.diagnostics if d.is_error]
    assert {d.code for d in found} == {declared.COLD_START.id}
    assert all(said in d.message for d in found)


@pytest.mark.slow
def test_a_runtime_that_takes_requests_without_a_table_is_found(export, tmp_path, monkeypatch):
    what, instead = "if (index != HP_NO_TABLE) {", "if (index != 0U) {"
    checked = DEPLOYMENT.check(_with_runtime(export, tmp_path, monkeypatch, what, instead), CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error]


@pytest.mark.slow  # seven runs; test_a_unit_of_time_for_slow_cores has the arithmetic
def test_the_margin_is_found_to_a_tenth(sound):
    lines = DEPLOYMENT.check(sound, CheckOptions(inject="none", margin=True)).lines
    most = next(line for line in lines if line.startswith("works up to ")).split()[3]
    tour = tours(sound.schedule, check.CYCLES)[0]
    tenth = Fraction(1, 10)
    assert [d for d in check.simulate(sound, tour, cpi=Fraction(most)).findings if d.is_error] == []
    assert [d for d in check.simulate(sound, tour, cpi=Fraction(most) + tenth).findings if d.is_error]


@pytest.mark.parametrize("cycles", [1, 2, Fraction(19, 10), Fraction(7, 3)])
def test_a_unit_of_time_for_slow_cores(cycles):
    timing = Timing.of(100_000_000, 1_000_000, cycles)
    assert Fraction(timing.cycle, timing.rate) == Fraction(cycles) / 100_000_000
    assert Fraction(timing.tick, timing.rate) == Fraction(1, 1_000_000)


@pytest.mark.parametrize(
    ("what", "instead"),
    [
        ("if (is_suspect != 0U) {", "if (0) {"),
        ("(state == DMA_IDLE) && (is_held(s, o) != 0U)", "0"),
        pytest.param("is_suspect = 1U;", "is_suspect = 0U;", marks=pytest.mark.slow),
    ],
)
def test_a_runtime_that_gives_a_unit_away_under_a_late_transfer(export, tmp_path, monkeypatch, what, instead):
    target = _with_runtime(export, tmp_path, monkeypatch, what, instead, two_channels)
    found = [d for d in DEPLOYMENT.check(target, CheckOptions()).diagnostics if d.is_error]
    assert any(d.message.startswith(PREFIX) for d in found)


def two_channels(text):
    """The model of these tests, with a channel of its own for what is read."""
    read = '<access resource="memory" start="100us" end="150us" kind="read">'
    known = '<resource name="memory" bandwidth="400MB/s"/>'
    assert read in text
    assert known in text
    text = text.replace(read, read.replace("memory", "sensors"))
    return text.replace(known, known + known.replace("memory", "sensors"))


@pytest.mark.slow
@pytest.mark.parametrize("change", [lambda text: text, two_channels])
def test_a_transfer_late_by_up_to_a_hyperperiod_holds_its_channel_and_unit(export, change):
    checked = DEPLOYMENT.check(export(change=change), CheckOptions())
    assert checked.diagnostics == ()
    (line,) = (line for line in checked.lines if "transfers late by up to a hyperperiod" in line)
    assert int(line.split("the ")[1].split()[0]) > 5


@pytest.mark.parametrize(
    ("what", "instead", "said"),
    [
        ("    idle();\n    fence();", "    idle();", "answers without a fence"),
        ("    fence();\n    box->done = box->request;", "    box->done = box->request;\n    fence();", "answers"),
        ("        fence(); /* a request", "        /* a request", "takes a request without a fence"),
        ("    fence(); /* what is asked", "    /* what is asked", "takes a request without a fence"),
    ],
)
def test_a_monitor_without_a_fence(mutant, play, what, instead, said):
    found = [d for outcome in play(mutant("monitor.c", what, instead)) for d in outcome.findings]
    assert {d.code for d in found} == {declared.WRONG_CALL.id}
    assert {d.path for d in found} == {'unit "left"', 'unit "right"'}
    assert all(said in d.message for d in found)


def test_words_that_are_copied_byte_by_byte(mutant, play):
    change = lambda text: text.replace(' bandwidth="400MB/s"', "")  # noqa: E731
    slow = mutant("dma.c", "(done + WORD) <= size", "(done + WORD) < size", profile="virt", change=change)
    found = [d for outcome in play(slow) for d in outcome.findings]
    assert {d.code for d in found} == {declared.TRANSFER_OUTSIDE_PHASE.id}
    assert all("moves 1 bytes at a time" in d.message for d in found)


def coinciding(text):
    """The model of these tests, in which units begin transfers at the same tick, and one with a table."""
    memory = '<resource name="memory" bandwidth="400MB/s"/>'
    read = '<access resource="memory" start="100us" end="150us" kind="read">\n          <transfer buffer="{}"'
    for buffer, start, end in (("track", "600us", "700us"), ("smooth", "500us", "550us")):
        known = read.format(buffer)
        assert known in text
        moved = known.replace("100us", start).replace("150us", end).replace("memory", "camera")
        text = text.replace(known, moved, 1)
    return text.replace(memory, memory + memory.replace("memory", "camera"))


ORDERS = {"slots": ("if (keys[i] < key) {", "if (keys[i] <= key) {"), "tables": ("SECOND 1UL", "SECOND 2UL")}


@pytest.mark.parametrize("what", ORDERS)
def test_what_is_due_together_is_done_in_another_order(mutant, play, what):
    found = [d for outcome in play(mutant("runtime.c", *ORDERS[what], change=coinciding)) for d in outcome.findings]
    assert {d.code for d in found} == {declared.SLOW_DISPATCH.id}
    assert all("begins after what is due at" in d.message for d in found)


def test_what_is_due_together_is_done_in_its_order(export, play):
    assert [d for outcome in play(export(change=coinciding)) for d in outcome.findings] == []
