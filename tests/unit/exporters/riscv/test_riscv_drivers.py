"""Drivers and recordings of a board's buffers: what their files state, and what does not fit the tasks."""

import pytest

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.core.quantities import quoted
from halpipe.exporters.riscv import drivers
from halpipe.exporters.riscv.codes import BAD_DRIVERS, BAD_INPUT, IDLE_DRIVER, MISSING_ENTRY
from halpipe.exporters.riscv.drivers import (
    NONE,
    REQUEST,
    Driver,
    Drivers,
    check_drivers,
    compile_drivers,
    read_drivers,
    read_inputs,
)
from halpipe.exporters.riscv.images import Part
from halpipe.exporters.riscv.sources import SourceTree
from halpipe.exporters.riscv.toolchain import Elf
from halpipe.models import AccessKind
from riscv_models import PHASES, deployed

SIZES = {"input": 64, "output": 64, "word": 8}
PARTS = [Part("scale", deployed(), (), ())]
TEXT = """halpipe-drivers: 1
sources: [board.c, more.c]
inputs: [{buffer: input, function: get, time: 20us}]
outputs: [{buffer: output, function: put, time: 3us, task: scale}]
requests: [{buffer: word, task: scale}, {buffer: other}]
"""


def read(folder, text):
    (folder / "drivers.yaml").write_text(text)
    return read_drivers(str(folder / "drivers.yaml"))


def refused(call, *arguments):
    with pytest.raises(HalpipeError) as failure:
        call(*arguments)
    return [(d.code, d.message, d.at.line) for d in failure.value.diagnostics]


def test_inputs_outputs_and_requests_are_drivers(tmp_path):
    found = read(tmp_path, TEXT)
    rows = [(d.buffer, d.function, d.time, d.kind, d.task, d.at.line) for d in found.drivers]
    assert rows == [
        ("input", "get", Duration.parse("20us"), AccessKind.READ, "", 3),
        ("output", "put", Duration.parse("3us"), AccessKind.WRITE, "scale", 4),
        ("word", REQUEST, Duration(0), AccessKind.WRITE, "scale", 5),
        ("other", REQUEST, Duration(0), AccessKind.WRITE, "", 5),
    ]
    assert [source.value for source in found.sources] == ["board.c", "more.c"]
    assert (found.functions, found.longest) == (("get", "put", REQUEST), Duration.parse("20us"))
    assert found.text == TEXT.encode()
    assert found
    assert read_drivers("") is NONE
    assert not NONE
    assert NONE.longest == Duration(0)


def test_a_driver_is_called_in_the_phases_that_move_its_buffer(tmp_path):
    found = read(tmp_path, TEXT)
    called = [[d.function for d in found.of("scale", access)] for access in PHASES]
    assert called == [[], ["get"], ["put"]]
    assert [d.function for d in found.of("another", PHASES[2])] == []
    assert [found.time("scale", access) for access in PHASES] == [Duration(0), Duration.parse("20us"), Duration(0)]


@pytest.mark.parametrize(
    ("text", "message", "line"),
    [
        ("# x\nhalpipe-drivers: 2\n", "is no file of drivers of version 1", 1),
        ("- x\n", "is no file of drivers of version 1", 1),
        ("halpipe-drivers: 1\n", "states no driver", 1),
        ("halpipe-drivers: 1\ninputs: [{buffer: b, function: f}]\n", 'lacks the key "time"', 2),
        ("halpipe-drivers: 1\nrequests: [{task: t}]\n", 'lacks the key "buffer"', 2),
    ],
)
def test_files_that_state_no_drivers(tmp_path, text, message, line):
    assert [found[1:] for found in refused(read, tmp_path, text)] == [(message, line)]


@pytest.mark.parametrize("name", ["9f", "f g", "hp_f", "x" * 202, ""])
def test_functions_that_are_none(tmp_path, name):
    text = f'halpipe-drivers: 1\ninputs: [{{buffer: b, function: "{name}", time: 1us}}]\n'
    ((_, message, line),) = refused(read, tmp_path, text)
    assert message.startswith(f'"function": {quoted(name)} is no C identifier')
    assert line == 2
    assert read(tmp_path, text.replace(f'"{name}"', "x" * 201)).functions == ("x" * 201,)


def test_a_driver_takes_some_time(tmp_path):
    text = "halpipe-drivers: 1\ninputs: [{buffer: b, function: f, time: 0us}]\n"
    ((_, message, _),) = refused(read, tmp_path, text)
    assert message.startswith('"time": 0us is no time that a driver takes')


def driver(buffer, kind, function="f", task=""):
    return Driver(buffer, function, Duration(1), kind, task, Location("d", 7))


READ, WRITE = AccessKind.READ, AccessKind.WRITE


@pytest.mark.parametrize(
    ("found", "code", "message"),
    [
        (driver("input", READ), None, ""),
        (driver("output", WRITE, task="scale"), None, ""),
        (driver("absent", READ), BAD_DRIVERS, 'there is no buffer "absent"'),
        (driver("input", READ, task="other"), BAD_DRIVERS, 'no task "other" is deployed'),
        (driver("output", WRITE, REQUEST), BAD_DRIVERS, "asks for a mode, and has 64 bytes"),
        (driver("word", WRITE, REQUEST), IDLE_DRIVER, "no task writes it, so its driver is never called"),
        (driver("output", READ), IDLE_DRIVER, "no task reads it, so its driver is never called"),
        (
            driver("input", WRITE, task="scale"),
            IDLE_DRIVER,
            'task "scale" never writes it, so its driver is never called',
        ),
    ],
)
def test_drivers_that_no_phase_calls(found, code, message):
    findings = Findings()
    check_drivers(Drivers((found,)), PARTS, SIZES, findings)
    assert [(d.code, d.message, d.at.line) for d in findings.items] == ([(code.id, message, 7)] if code else [])


# ------------------------------------------------------------------------------------------------ recordings


def recorded(folder, **files):
    """Read a folder of recordings; return the names that are found and what is refused."""
    for name, size in files.items():
        path = folder / name.replace("__", "/").replace("_", ".")
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(bytes(size))
    findings = Findings()
    found = read_inputs(str(folder), PARTS, SIZES, findings)
    assert {d.code for d in findings.items} <= {BAD_INPUT.id}
    return {name: len(content) for name, content in found.items()}, [d.message for d in findings.items]


@pytest.mark.parametrize("size", [64, 128, 640])
def test_a_recording_has_one_or_more_contents_of_its_buffer(tmp_path, size):
    assert recorded(tmp_path, input_bin=size) == ({"inputs/input.bin": size}, [])


@pytest.mark.parametrize("size", [0, 1, 63, 65, 127])
def test_a_recording_is_whole(tmp_path, size):
    assert recorded(tmp_path, input_bin=size)[1] == [f"has {size} bytes, its buffer 64"]


def test_recordings_are_of_buffers_that_tasks_read_alone(tmp_path):
    found, refusals = recorded(tmp_path, output_bin=64, input=64, other_bin=8, sub__input_bin=64)
    assert found == {}
    assert refusals == [
        'there is no buffer "input"',
        'there is no buffer "other"',
        "its buffer is written by a task",
        'there is no buffer "sub/input"',
    ]


def test_a_folder_without_a_recording(tmp_path):
    assert recorded(tmp_path) == ({}, ["has no recording"])
    assert read_inputs("", PARTS, SIZES, Findings()) == {}


# ------------------------------------------------------------------------------------------------ sources


def test_a_driver_is_defined_by_its_sources(monkeypatch, tmp_path):
    """The function that asks for a mode is the runtime's own; each that is missing is named where it first stands."""

    class Shop:
        def __init__(self):
            self.compiled = []

        def compile(self, steps):
            self.compiled += steps
            return []

        def read(self, name):
            return name

    symbols = {"build/drivers/0.o": {"get": 1}, "build/drivers/1.o": {"put": 1}}
    monkeypatch.setattr(drivers, "read_elf", lambda name: Elf((), symbols[name]))
    tree, shop = SourceTree(tmp_path, Findings()), Shop()
    known = [driver("input", READ, "get"), driver("output", WRITE, "put"), driver("word", WRITE, REQUEST)]
    assert compile_drivers(shop, Drivers(tuple(known)), ["a.c", "b.c"], tree) == (*symbols,)
    assert [(step.source, step.target) for step in shop.compiled] == [*zip(("a.c", "b.c"), symbols, strict=True)]
    absent = [Driver("output", "gone", Duration(1), WRITE, "", Location("d", line)) for line in (3, 4)]
    assert refused(compile_drivers, shop, Drivers((*known, *absent)), ["a.c", "b.c"], tree) == [
        (MISSING_ENTRY.id, 'no source defines the driver "gone"', 3)
    ]
