"""Logical execution times on RISC-V: data in the co-simulation equal a reference of instants and values."""

import json
import shutil

import pytest
from tampering import resealed

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, CoSimulation, Plant
from halpipe.deploy.riscv import codes as declared
from halpipe.deploy.riscv.judge.board import board_trace
from halpipe.deploy.riscv.judge.check import static_findings
from halpipe.exporters.riscv import RiscvOptions, bundle
from halpipe.exporters.riscv.codes import COPIES_UNFIT
from halpipe.flow import formats
from halpipe.importers.native import parse_model
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from halpipe.pipeline.health import with_reactions
from one_fault import with_fault
from support import job, ms

CELLS = 16
TASKS = {  # period, LET, offset; what it reads and writes, and what it adds
    "first": (5, 4, 0, ("world",), "one", 1),
    "second": (10, 10, 0, ("one", "three"), "two", 100),
    "third": (5, 5, 0, ("two",), "three", 10000),
}
STARTS = {"first": ["0.2ms", "6.1ms"], "second": ["4.4ms"], "third": ["2.5ms", "8ms"]}
UNITS = {"first": "left", "second": "left", "third": "right"}


def _phase(kind, start, end, names, size=CELLS * 8):
    moved = "".join(f'<transfer buffer="{name}" symbol="v_{name}" size="{size}B"/>' for name in names)
    return f'<access resource="memory" start="{start}" end="{end}" kind="{kind}">{moved}</access>'


def _task(name):
    period, let, offset, reads, writes, _ = TASKS[name]
    phases = '<access resource="memory" start="0ms" end="300us" kind="load"/>'
    phases += _phase("read", "700us", "800us", reads) + _phase("write", "900us", "1000us", [writes])
    return (
        f'<task name="{name}" period="{period}ms" let="{let}ms" offset="{offset}ms" slack="{1 - 1 / period:g}">'
        f'<version name="v" wcet="1ms"><units names="left right"/>{phases}'
        f'<source files="{name}.c" entry="{name}"/></version></task>'
    )


def _source(name):
    _, _, _, reads, writes, more = TASKS[name]
    held = "".join(f"uint64_t v_{buffer}[{CELLS}];" for buffer in (*reads, writes))
    total = " + ".join(f"v_{buffer}[i]" for buffer in reads)
    body = f"for (int i = 0; i < {CELLS}; i++) v_{writes}[i] = {total} + {more};"
    return f"#include <stdint.h>\n{held}\nvoid {name}(void) {{ {body} }}\n"


TEXT = (
    '<task-model xmlns="urn:halpipe:task-model:1" name="let"><platform><unit name="left"/><unit name="right"/>'
    f'<resource name="memory" bandwidth="400MB/s"/></platform><tasks>{"".join(map(_task, TASKS))}</tasks>'
    '<modes><mode name="a">{runs}</mode><mode name="b">{runs}</mode></modes>'
    '<transitions><transition from="a" to="b"/></transitions></task-model>'
).replace("{runs}", "".join(f'<run task="{name}" versions="v"/>' for name in TASKS))


def _schedule(model, starts):
    jobs = tuple(job(model, name, i, at, UNITS[name]) for name in TASKS for i, at in enumerate(starts[name]))
    modes = tuple(ModeSchedule(name=name, hyperperiod=ms(10), status=Status.VALID, jobs=jobs) for name in ("a", "b"))
    switch = TransitionTable(source="a", target="b", length=ms(0), worst_latency=ms(10), status=Status.VALID)
    made = Schedule(model=model.name, model_sha256=model.digest, modes=modes, transitions=(switch,))
    return with_reactions(model, made)


def let_bundle(folder, text=TEXT, starts=STARTS, profile="vcu118", toolchain="zig"):
    """Export the model to a new folder."""
    folder.mkdir()
    for name in TASKS:
        folder.joinpath(f"{name}.c").write_text(_source(name))
    model = parse_model(text.encode(), str(folder / "model.xml"))
    options = RiscvOptions(profile=profile, toolchain=toolchain, sources=str(folder))
    write_directory(str(folder / "out"), formats.export("riscv", model, _schedule(model, starts), options))
    return formats.open_target(str(folder / "out"))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    pytest.importorskip("unicorn", reason="pip install unicorn")
    pytest.importorskip("ziglang", reason="pip install ziglang")

    return lambda *args, **options: let_bundle(tmp_path_factory.mktemp("let") / "bundle", *args, **options)


@pytest.fixture(scope="module")
def sound(made):
    return made()


def reference(cycles):
    """Values that LET gives the buffers: at each instant, first everything is written, then everything is read."""
    events = []
    for name, (period, let, offset, _, _, _) in TASKS.items():
        for release in range(offset, 10 * cycles, period):
            events += [(release, 1, name, release), (release + let, 0, name, release)]
    values, read, seen = {"one": 0, "two": 0, "three": 0}, {}, []
    for instant, reads, name, release in sorted(events):
        _, _, _, inputs, output, more = TASKS[name]
        if reads:
            values["world"] = instant
            read[name, release] = sum(values[buffer] for buffer in inputs)
        elif instant < 10 * cycles:
            values[output] = read[name, release] + more
            seen.append((instant, output, values[output]))
    return sorted(seen)


class World(Plant):
    """Shows the time in ms, and notes what is written."""

    def __init__(self):
        self.seen = []

    def reads(self, board, now, buffer):
        if buffer == "world":
            board.write("world", int(now.in_unit("ms")).to_bytes(8, "little") * CELLS)

    def written(self, board, now, buffer):
        words = {board.read(buffer)[at : at + 8] for at in range(0, CELLS * 8, 8)}
        assert len(words) == 1
        self.seen.append((int(now.in_unit("ms")), buffer, int.from_bytes(words.pop(), "little")))


@pytest.mark.slow
@pytest.mark.parametrize("execution", ["real", "modelled"])
def test_data_are_those_of_the_reference(sound, execution):
    world = World()
    CoSimulation(sound, plant=world, cycles=8, execution=execution, requests=[(ms(35), "b")]).run()
    played = [entry for entry in world.seen if entry[0] < 70]
    assert sorted(played) == [entry for entry in reference(8) if entry[0] < 70]
    assert len({value for _, buffer, value in played if buffer == "two"}) == 6


@pytest.mark.slow
def test_when_jobs_run_does_not_change_the_data(made):
    others = {"first": ["2.9ms", "7ms"], "second": ["0.2ms"], "third": ["1.5ms", "8.9ms"]}
    seen = []
    for starts in (STARTS, others):
        world = World()
        CoSimulation(made(starts=starts), plant=world, cycles=4).run()
        seen.append(sorted(entry for entry in world.seen if entry[0] < 40))
    assert seen[0] == seen[1]


@pytest.mark.slow
def test_the_check_holds_copies_to_their_instants(sound):
    checked = DEPLOYMENT.check(sound, CheckOptions())
    assert checked.diagnostics == ()
    starts = [line.split(",")[5] for line in checked.files["trace"].decode().splitlines()[1:] if ",second," in line]
    assert starts[0].startswith("4400")  # the job, not its copies


@pytest.mark.slow
def test_a_core_restarts_beside_copies(made):
    """It has been given other images since it began, and what the rule does is a record of its own."""
    rule = '<health><rule task="first" on="overrun" count="2" cycles="3" action="restart"/></health></task-model>'
    checked = DEPLOYMENT.check(made(TEXT.replace("</task-model>", rule)), CheckOptions())
    assert checked.diagnostics == ()
    assert any(line.startswith("health rules: ") for line in checked.lines)


@pytest.mark.slow
def test_a_target_without_an_engine_copies_as_well(made):
    target = made(profile="virt")
    world = World()
    CoSimulation(target, plant=world, cycles=4).run()
    assert sorted(e for e in world.seen if e[0] < 30) == [e for e in reference(4) if e[0] < 30]


@pytest.mark.parametrize(
    ("start", "text", "said"),
    [
        (
            {"first": ["0ms", "6.1ms"]},
            TEXT.replace('end="300us"', 'end="100us"').replace('start="700us"', 'start="110us"'),
            "when its copies are complete after",
        ),
        ({}, TEXT.replace('let="4ms"', 'let="4.9ms"'), "ticks after another, all copies need"),
        ({"second": ["4.1ms"]}, TEXT.replace(' let="10ms"', ""), 'is copied while a phase of "second" moves it'),
    ],
)
def test_copies_that_do_not_fit_are_refused(made, start, text, said):
    with pytest.raises(HalpipeError) as refused:
        made(text, STARTS | start)
    found = [d for d in refused.value.diagnostics if d.code == COPIES_UNFIT.id]
    assert any(said in d.message for d in found), [d.message for d in refused.value.diagnostics]


@pytest.mark.parametrize(
    ("change", "help"),
    [  # the model that is refused; following the help leads to TEXT, which is exported (see `sound`)
        ((' offset="0ms"', ""), 'state offset="0ms" for first, second, third, and schedule again: their instants'),
        (('let="4ms"', 'let="4.9ms"'), 'make their LETs multiples of 200us, state offset="0ms" for first, second'),
    ],
)
def test_instants_too_close_have_a_remedy(made, change, help):
    with pytest.raises(HalpipeError) as refused:
        made(TEXT.replace(*change), STARTS | {"first": ["0.3ms", "6.1ms"]})
    assert any(d.help.startswith(help) for d in refused.value.diagnostics), [d.help for d in refused.value.diagnostics]


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["turns"][0].update(after=c["turns"][0]["after"] + 1),
        lambda c: c["turns"][0].update(kind="read"),
        lambda c: c.update(channel=0),
        lambda c: c["turns"][0]["buffers"][0].update(address=c["turns"][1]["buffers"][0]["address"]),
    ],
)
def test_copies_that_the_target_describes_wrongly_are_found(sound, tmp_path, change):
    described = json.loads(sound.bundle.files["target.json"])
    change(described["copies"])
    target = resealed(sound, tmp_path / "b", {"target.json": json.dumps(described).encode()})
    try:
        found = {d.code for d in static_findings(target)}
    except HalpipeError as refused:
        found = {d.code for d in refused.diagnostics}
    assert found & {declared.BROKEN_TARGET.id, declared.WRONG_OPERATIONS.id}


def test_a_board_tells_jobs_from_copies(sound):
    run = CoSimulation(sound, cycles=2).run()
    rows = board_trace(sound, run.recording, "memory.bin")[0].decode().splitlines()
    assert next(row for row in rows if ",second," in row).split(",")[5] == "4400000"


@pytest.mark.slow
def test_a_runtime_that_releases_a_job_over_the_copies_of_the_last_is_found(made, tmp_path, monkeypatch):
    shutil.copytree(bundle.RUNTIME, tmp_path / "runtime")
    path = tmp_path / "runtime" / "runtime.c"
    path.write_text(with_fault(path.read_text(), "program->slots > 1U", "program->slots > 2U"))
    monkeypatch.setattr(bundle, "RUNTIME", tmp_path / "runtime")
    found = {d.code for d in DEPLOYMENT.check(made(), CheckOptions(inject="none")).diagnostics if d.is_error}
    assert declared.MISSING_TRANSFER.id in found
