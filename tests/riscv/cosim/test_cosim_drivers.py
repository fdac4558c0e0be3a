"""Drivers of the board: called at the instants of the schedule, replaced by a plant, held to; and modes by request."""

import shutil

import pytest
from tampering import resealed, tampered

from halpipe.cli import invoke
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, CoSimulation, Plant
from halpipe.deploy.riscv.judge.check import static_findings
from halpipe.deploy.riscv.judge.qemu import EMULATOR
from halpipe.exporters.riscv import bundle
from one_fault import with_fault
from support import ms

BOARD = """
#include <stdint.h>
static volatile uint64_t *const device = (volatile uint64_t *)0x70000000UL;
static uint64_t taken;
void sample_read(void *data, uint64_t size) {
    for (uint64_t i = 0; i < size / 8; i++) ((uint64_t *)data)[i] = device[i];
}
void command_write(void *data, uint64_t size) { taken += size; device[1] = *(uint64_t *)data; }
"""
DRIVERS = """halpipe-drivers: 1
sources: board.c
inputs:
  - {buffer: sample, function: sample_read, time: 3us}
outputs:
  - {buffer: command, function: command_write, time: 2us, task: act}
"""
ASKING = DRIVERS + "requests:\n  - {buffer: command}\n"


@pytest.fixture(scope="module")
def driven(export):
    return export(drivers=DRIVERS, sources={"board.c": BOARD})


class Watching(Plant):
    def __init__(self):
        self.seen = []

    def reads(self, board, now, buffer):
        self.seen.append(("in", buffer, now))
        if buffer == "sample":
            samples = [each for each in self.seen if each[1] == buffer]
            board.write(buffer, len(samples).to_bytes(8, "little"))

    def written(self, board, now, buffer):
        self.seen.append(("out", buffer, now))


def test_the_plant_takes_the_place_of_drivers_at_the_instants_of_the_phases(driven):
    plant = Watching()
    CoSimulation(driven, plant=plant, cycles=2).run()
    samples = [now for kind, buffer, now in plant.seen if buffer == "sample"]
    commands = [now for kind, buffer, now in plant.seen if buffer == "command"]
    # sense starts at 0.6 and 5.6 ms and reads 100 us later; act at 4.5 and 9.5 ms, and its write ends 1 ms later
    due = [ms("0.7ms"), ms("5.7ms"), ms("10.7ms"), ms("15.7ms")]
    assert all(at <= now <= at + ms("10us") for at, now in zip(due, samples, strict=True))
    due = [ms("5.5ms"), ms("10.5ms"), ms("15.5ms"), ms("20.5ms")]
    assert all(at <= now <= at + ms("10us") for at, now in zip(due, commands, strict=True))


def test_what_the_plant_puts_in_is_what_the_job_reads(driven):
    run = CoSimulation(driven, plant=Watching(), cycles=1).run()
    read = [t.data[:8] for t in run.recorder.transfers if t.source == run.site.buffers["sample"].base]
    assert [int.from_bytes(data, "little") for data in read] == [1, 2]


@pytest.mark.slow
def test_a_driver_of_one_short_instruction_leaves_what_follows_it(export):
    """What takes the place of a driver that does nothing is no longer than it."""
    empty = "".join(f"void {name}(void *data, unsigned long size) {{}}\n" for name in ("command_write", "sample_read"))
    board = export(drivers=DRIVERS, sources={"board.c": empty})
    assert [d for d in DEPLOYMENT.check(board, CheckOptions(inject="none")).diagnostics if d.is_error] == []


@pytest.mark.slow
def test_nothing_is_found_and_drivers_are_reported(driven):
    checked = DEPLOYMENT.check(driven, CheckOptions())
    assert [d for d in checked.diagnostics if d.is_error] == []
    assert any(line.startswith("drivers were called ") for line in checked.lines)


@pytest.mark.slow  # the quicker one is the one before, without injected faults
@pytest.mark.parametrize(
    ("profile", "options"),  # with a DMA engine, and with a core that copies
    [
        ("vcu118", {"inject": "all"}),
        ("virt", {"inject": "all"}),
        ("fu540", {"engine": "qemu"}),
        ("virt", {"engine": "qemu"}),
    ],
)
def test_nothing_is_found_by_qemu_or_with_faults_injected(export, profile, options):
    longer = lambda text: text.replace('end="150us"', 'end="200us"')  # noqa: E731 - the core copies slowly
    target = export(drivers=ASKING, sources={"board.c": BOARD}, profile=profile, change=longer)
    if "engine" in options and shutil.which(EMULATOR) is None:
        pytest.skip("apt-get install qemu-system-misc")
    checked = DEPLOYMENT.check(target, CheckOptions(**options))
    assert [str(d) for d in checked.diagnostics if d.is_error] == []


RUNTIMES = {
    "drivers are hardly ever called": (
        "runtime.c",
        "hp_drivers[o->source]((void *)o->target, o->size);",
        "if (s->number > 1000U) { hp_drivers[o->source]((void *)o->target, o->size); }",
    ),
    "drivers get another buffer": ("runtime.c", "((void *)o->target, o->size)", "((void *)(o->target + 64U), o->size)"),
    "drivers get another size": ("runtime.c", "((void *)o->target, o->size)", "((void *)o->target, o->size / 2U)"),
    "drivers are called twice": (
        "runtime.c",
        "hp_drivers[o->source]((void *)o->target, o->size);",
        "hp_drivers[o->source]((void *)o->target, o->size); hp_drivers[o->source]((void *)o->target, o->size);",
    ),
    "drivers of abandoned jobs are called": (
        "runtime.c",
        "if (s->is_over != 0U) {",
        (
            "if ((s->is_over != 0U) && (o->kind >= OP_INPUT)) { hp_drivers[o->source]((void *)o->target, o->size); } "
            "if (s->is_over != 0U) {"
        ),
    ),
}


@pytest.mark.slow  # test_tables_with_other_drivers_are_found needs no compiler
@pytest.mark.parametrize("fault", RUNTIMES)
def test_a_runtime_that_calls_drivers_wrongly_is_found(export, tmp_path, monkeypatch, fault):
    shutil.copytree(bundle.RUNTIME, tmp_path / "runtime")
    file, what, instead = RUNTIMES[fault]
    path = tmp_path / "runtime" / file
    path.write_text(with_fault(path.read_text(), what, instead))
    monkeypatch.setattr(bundle, "RUNTIME", tmp_path / "runtime")
    target = export(drivers=DRIVERS, sources={"board.c": BOARD})
    checked = DEPLOYMENT.check(target, CheckOptions())
    assert "HAL1069" in {d.code for d in checked.diagnostics if d.is_error}


INPUT, OUTPUT = 6, 7
CHANGES = {
    "another driver": (INPUT, 8, 8, lambda v: 1 - v),
    "another buffer": (INPUT, 16, 8, lambda v: v + 64),
    "another size": (OUTPUT, 24, 8, lambda v: v // 2),
    "a tick later": (OUTPUT, 0, 8, lambda v: v + 4),
    "no driver": (INPUT, 36, 1, lambda v: 3),
}


@pytest.mark.parametrize("change", CHANGES)
def test_tables_with_other_drivers_are_found(driven, tmp_path, change):
    kind, offset, size, make = CHANGES[change]

    def spoil(program):
        at = program.operations(kind)[0] + offset
        program.put(at, make(program.get(at, size)), size)

    found = static_findings(tampered(driven, tmp_path / "b", spoil))
    assert "HAL1057" in {d.code for d in found}


def test_a_file_of_drivers_that_states_others_is_found(driven, tmp_path):
    other = DRIVERS.replace("task: act", "task: sense")
    found = static_findings(resealed(driven, tmp_path / "b", {"drivers.yaml": other.encode()}))
    assert "HAL1057" in {d.code for d in found}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("inputs: 3", "\"inputs\" is the text '3'; it must be a list"),
        ("inputs: [{function: f}]", 'lacks the key "buffer"'),
        ("outputs: [{buffer: [a, b], function: f}]", '"buffer" is a list; it must be a text'),
        ("outputs: [{buffer: b, function: f, task: {a: 1}}]", '"task" is a mapping; it must be a text'),
        ("requests: {}", '"requests" is a mapping; it must be a list'),
        ("outputs: [7]", "\"outputs\" is the text '7'; it must be a mapping"),
    ],
)
def test_a_malformed_file_of_drivers_is_refused_with_its_line(driven, tmp_path, text, says):
    broken = resealed(driven, tmp_path / "b", {"drivers.yaml": f"halpipe-drivers: 1\n{text}\n".encode()})
    with pytest.raises(HalpipeError) as refused:
        static_findings(broken)
    [found] = refused.value.diagnostics
    assert says in found.message
    assert found.at.line == 2


# ------------------------------------------------------------------------------------------------ modes by request

ACT = """
#include <stdint.h>
uint64_t smooth[8], command;
void act(void) { command = %s; }
"""


def _asked(export, expression):
    return export(drivers=ASKING, sources={"board.c": BOARD, "act.c": ACT % expression})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("2", ["full", "full->calm", "calm", "calm"]),
        ("1", ["full", "full", "full", "full"]),  # it is in force
        ("3", ["full", "full", "full", "full"]),  # no table leads there from here
        ("0", ["full", "full", "full", "full"]),
        ("77", ["full", "full", "full", "full"]),
        ("~0ul", ["full", "full", "full", "full"]),
    ],
)
def test_a_task_asks_for_a_mode(export, mode, expected):
    run = CoSimulation(_asked(export, mode), cycles=4).run()
    assert [table.name for table in run.tables] == expected


@pytest.mark.slow
def test_what_tasks_ask_for_is_played_and_held_in_the_check(export):
    checked = DEPLOYMENT.check(_asked(export, "2"), CheckOptions())
    assert [str(d) for d in checked.diagnostics if d.is_error] == []
    assert any("tasks asked" in line and "led to 1 switches" in line for line in checked.lines)


@pytest.mark.slow
def test_a_request_at_the_last_instant_counts_and_a_later_one_waits(export):
    # act 1 ends at 10.5 ms, after the decision of its cycle; act 0 at 5.5 ms before it. Only the first job asks.
    run = CoSimulation(_asked(export, "2"), cycles=3).run()
    assert run.requests[0].mode == "calm"
    assert run.requests[0].instant == ms("5.5ms")


# ------------------------------------------------------------------------------------------------ what is refused

BAD = {
    "halpipe-drivers: 2\n": "HAL0892",
    "halpipe-drivers: 1\n": "HAL0892",
    DRIVERS.replace("buffer: sample", "buffer: smple"): "HAL0892",
    DRIVERS.replace("task: act", "task: atc"): "HAL0892",
    DRIVERS.replace("task: act", "task: sense"): "HAL0893",
    DRIVERS.replace("function: sample_read", "function: sample_reed"): "HAL0848",
    DRIVERS.replace("function: sample_read", "function: hp_drivers"): "HAL0023",
    DRIVERS.replace("function: sample_read", "function: 'a b; rm'"): "HAL0023",
    DRIVERS.replace("time: 3us", "time: 0us"): "HAL0023",
    DRIVERS.replace(", time: 3us", ""): "HAL0024",
    DRIVERS.replace("buffer: sample", "bufer: sample"): "HAL0021",
    DRIVERS.replace("board.c", "../board.c"): "HAL0845",
    DRIVERS.replace("board.c", "absent.c"): "HAL0844",
    DRIVERS + "requests: [{buffer: track}]\n": "HAL0892",
    DRIVERS.replace("time: 3us", "time: 60us"): "HAL0855",
}


@pytest.mark.parametrize("text", BAD)
def test_drivers_that_cannot_be_are_refused_with_their_place(export, text):
    with pytest.raises(HalpipeError) as failure:
        export(drivers=text, sources={"board.c": BOARD})
    found = failure.value.diagnostics
    assert BAD[text] in {d.code for d in found}
    assert all(d.help for d in found)


def test_a_driver_that_the_compiler_refuses_is_named_with_its_line(export):
    with pytest.raises(HalpipeError) as failure:
        export(drivers=DRIVERS, sources={"board.c": BOARD + "\nint f(void) { return x; }\n"})
    (found,) = failure.value.diagnostics
    assert found.code == "HAL0846"
    assert found.at.line == BOARD.count("\n") + 2


def test_a_bundle_without_drivers_has_nothing_of_them(sound):
    assert "drivers.yaml" not in sound.bundle.files
    assert b"HP_DRIVERS" not in sound.bundle.files["runtime/platform.h"]


def test_prepare_makes_room_for_drivers(tmp_path, driven):
    from halpipe.exporters.native import format_model

    folder = tmp_path
    for name in ("sense.c", "filter.c", "act.c"):
        (folder / name).write_bytes(driven.bundle.files[f"src/{name}"])
    (folder / "m.xml").write_bytes(format_model(driven.model))
    (folder / "board.c").write_text(BOARD)
    (folder / "drivers.yaml").write_text(DRIVERS.replace("time: 3us", "time: 80us"))
    command = ["deploy", "prepare", str(folder / "m.xml"), "--drivers", str(folder / "drivers.yaml")]
    assert invoke([*command, "-o", str(folder / "p.xml")]) == 0
    before, after = driven.model, (folder / "p.xml").read_text()
    assert str(before.task("sense").versions[0].wcet) == "2ms"
    assert 'name="sense"' in after
    from halpipe.importers.native import read_model

    (version,) = read_model(str(folder / "p.xml")).task("sense").versions
    read = next(a for a in version.accesses if a.transfers and str(a.kind) == "read")
    assert read.end - read.start >= ms("80us")
