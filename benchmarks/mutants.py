# ruff: noqa: E402, E501 - the tests it takes its faults from are found by the path; texts of C stay on one line
"""RISC-V bundles with a fault each, checked: ``python benchmarks/mutants.py --engines cosim qemu``.

The faults are those of the tests, and more: in the sources of runtime and monitors (compiled anew), in the operation
tables and in ``target.json``. Prints what each engine finds, then the survivors; the last line is JSON with the counts.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

TESTS = Path(__file__).parents[1] / "tests"
sys.path.insert(0, str(TESTS))
sys.path.insert(0, str(TESTS / "riscv" / "cosim"))

from tampering import COPY, DONE, RUN, STOP, resealed, tampered
from test_cosim_health import RULES
from test_cosim_mutants import CONTAINMENT, OTHERS

import conftest as case
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.exporters.native import paired
from halpipe.exporters.riscv import RiscvOptions, bundle
from halpipe.flow import formats
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.health import with_reactions
from one_fault import with_fault

if TYPE_CHECKING:
    from halpipe.deploy.base import Target

PROFILE = "fu540"
SOURCES = {
    "releases are a tick late": ("runtime.c", "s->base = current.start + job->time;", "s->base = current.start + job->time + 5U;"),
    "the deadline counts from the start": ("runtime.c", "s->base + (o->key >> 2U) + o->limit;\n        box->entry", "s->base + o->limit;\n        box->entry"),
    "the wrong core is woken": ("runtime.c", "MSIP(o->unit + 1U) = 1U;\n        flags = 0U;", "MSIP(((o->unit + 1U) % HP_UNITS) + 1U) = 1U;\n        flags = 0U;"),
    "a busy core gets a job": ("runtime.c", "if (box->done == box->request) {\n        uint64_t deadline", "if (box->ready <= 1U) {\n        uint64_t deadline"),
    "the end of .bss is its size": ("runtime.c", "box->bss_end = o->target + o->size;", "box->bss_end = o->size;"),
    "the entry is four bytes on": ("runtime.c", "box->entry = o->source;", "box->entry = o->source + 4U;"),
    "each table is played once too often": ("runtime.c", "current.cycle >= CONTROL->cycles)", "current.cycle > CONTROL->cycles)"),
    "a switch forgets its table": ("runtime.c", "current.next = index;", "current.next = (uint32_t)(wanted - 1U);"),
    "requests are read too late": ("runtime.c", "(end - HP_DECISION) << 2U", "(end - 1U) << 2U"),
    "a refused request is taken": ("runtime.c", "if (index != HP_NO_TABLE) {", "if (index != 0U) {"),
    "tables begin a tick later each": ("runtime.c", "begin_table(current.next, end);", "begin_table(current.next, end + 1U);"),
    "records name the next cycle": ("runtime.c", "s->where = current.cycle |", "s->where = (current.cycle + 1U) |"),
    "records are counted twice": ("runtime.c", "traced++;", "traced += 2U;"),
    "the trace ring is one too short": ("runtime.c", "cursor == &TRACE[HP_TRACE_CAPACITY]", "cursor == &TRACE[16]"),
    "the fault has another hart": ("runtime.c", "f->hart = (uint16_t)(o->unit + 1U);", "f->hart = (uint16_t)(o->unit + 2U);"),
    "the value of a trap is not recorded": ("runtime.c", "box->tval : 0U", "0U : 0U"),
    "buffers are not cleared": ("runtime.c", "clear(HP_BUFFERS, HP_BUFFERS_END);", "(void)0;"),
    "the mailbox is not cleared": ("runtime.c", "clear(box, box + MAILBOX_SIZE);", "(void)box;"),
    "half the monitor is copied": ("runtime.c", "at < u->code_size; at += 8U", "at < (u->code_size / 2U); at += 8U"),
    "a channel too few": ("dma.c", "((uint64_t)channel * HP_DMA_STRIDE)", "(0U * HP_DMA_STRIDE)"),
    "transfers from a word on": ("dma.c", "c->source = o->source;", "c->source = o->source + 8U;"),
    "transfers to a word on": ("dma.c", "c->target = o->target;", "c->target = o->target + 8U;"),
    "transfers are never started": ("dma.c", "c->control = CLAIM | RUN;", "c->control = CLAIM;"),
    "transfers look idle at once": ("dma.c", "state = DMA_BUSY;", "state = DMA_IDLE;"),
    "errors are those of the next job": ("dma.c", "(owners[channel] == owner)", "(owners[channel] != owner)"),
    "only the start of .bss is cleared": ("monitor.c", "word < end; word += 8U", "word < (box->bss + 8U); word += 8U"),
    "the beginning is not recorded": ("monitor.c", "box->begin = MTIME;", "box->begin = 0U;"),
    "the end is recorded a tick early": ("monitor.c", "box->end = MTIME;", "box->end = MTIME - 9U;"),
    "every trap is a return": ("monitor.c", "(cause != CALL_FROM_USER) || (epc != (uint64_t)job_return)", "(cause == 99U)"),
    "a system call anywhere is a return": ("monitor.c", "(cause != CALL_FROM_USER) || (epc != (uint64_t)job_return)", "cause != CALL_FROM_USER"),
    "registers keep what others left": ("monitor.S", "li \\register, 0", "nop"),
    "jobs see the counters": ("monitor.c", "WRITE_CSR(mcounteren, 0U);", "WRITE_CSR(mcounteren, 7U);"),
    "code may be written": ("monitor.c", "(PMP_TOR | PMP_R | PMP_X | PMP_LOCKED) << 8U", "(PMP_TOR | PMP_R | PMP_W | PMP_X | PMP_LOCKED) << 8U"),
    "data may be executed": ("monitor.c", "(PMP_TOR | PMP_R | PMP_W | PMP_LOCKED) << 24U", "(PMP_TOR | PMP_R | PMP_W | PMP_X | PMP_LOCKED) << 24U"),
    "the rest is not forbidden": ("monitor.c", "(PMP_NAPOT | PMP_LOCKED) << 56U", "(PMP_NAPOT | PMP_R | PMP_W | PMP_LOCKED) << 56U"),
    "health rules never fire": ("health.c", "fires = 1U;", "fires = 0U;"),
    "health rules fire an event late": ("health.c", "< rule->cycles)", "<= rule->cycles)"),
    "health rules switch to the first mode": ("health.c", "wanted = rule->mode + 1U;", "wanted = 1U;"),
    "health rules never stop": ("health.c", "is_stopping = 1U;", "is_stopping = 0U;"),
    "health rules count everything": ("health.c", "((flags & rule->flags) != 0U)", "(flags != 0U)"),
    "health rules restart nothing": ("runtime.c", "boxes[o->unit]->restart = 1U;", "boxes[o->unit]->restart = 0U;"),
}  # fmt: skip


def _word(kind: int, offset: int, change: Any, size: int = 8) -> Any:
    def spoil(program: Any) -> None:
        at = program.operations(kind)[-1]
        program.put(at + offset, change(program.get(at + offset, size)) % (1 << 8 * size), size)

    return spoil


TABLES = {
    "a transfer from elsewhere": _word(COPY, 8, lambda v: v + 8),
    "half a transfer": _word(COPY, 24, lambda v: v // 2),
    "a transfer on another channel": _word(COPY, 37, lambda v: v + 1, 1),
    "a transfer in another phase": _word(COPY, 0, lambda v: v + (60_000 << 2)),
    "a check a tick early": _word(DONE, 0, lambda v: v - 4),
    "another function": _word(RUN, 8, lambda v: v + 4),
    "no .bss": _word(RUN, 24, lambda v: 0 if v else 8),
    "a deadline a tick late": _word(RUN, 32, lambda v: v + 1, 4),
    "another rank": _word(RUN, 40, lambda v: v + 1, 4),
    "another size of the gang": _word(RUN, 44, lambda v: v + 1, 4),
    "an end too early": _word(STOP, 0, lambda v: v - 16),
    "the end of another core": _word(STOP, 38, lambda v: 1 - v, 1),
}


def _described(**changes: Any) -> Any:
    return lambda described: described.update(changes)


TARGETS = {
    "another bandwidth": lambda d: d["dma"].update(bandwidth=800_000_000),
    "another set-up time": lambda d: d["dma"].update(setup="1us"),
    "another clock": _described(clock=200_000_000),
    "another reserve": _described(service="9us"),
    "another stack": _described(stack=4096),
    "other cycles": _described(cpi="2"),
    "another decision": _described(decision=3),
    "another margin": _described(margin=9),
    "another place of .bss": lambda d: d["images"][0]["bss"].update(size=d["images"][0]["bss"]["size"] + 8),
    "other loads": lambda d: d["images"][0]["load"][0].update(size=d["images"][0]["load"][0]["size"] + 8),
    "another symbol": lambda d: next(iter(d["images"][0]["symbols"].values())).update(address="0x1000"),
}


def build(folder: Path, runtime: tuple[str, str, str] | None = None) -> Target:
    """Export the bundle of the tests, with health rules, perhaps with one text of the runtime replaced."""
    for name in case.SOURCES:
        shutil.copy(case.HERE / name, folder / name)
    text = case.HERE.joinpath("model.xml").read_text().replace("  </transitions>\n</task-model>", RULES)
    system = parse_model(text.encode(), str(folder / "model.xml"))
    pair = paired(system, with_reactions(system, case.tables_of(system)))
    model = parse_model(pair["model.xml"], str(folder / "model.xml"))
    schedule = parse_schedule(pair["schedule.xml"], str(folder / "schedule.xml"))
    sound = bundle.RUNTIME
    try:
        if runtime is not None:
            shutil.copytree(sound, folder / "runtime")
            file, what, instead = runtime
            path = folder / "runtime" / file
            path.write_text(with_fault(path.read_text(), what, instead))
            bundle.RUNTIME = folder / "runtime"
        options = RiscvOptions(profile=PROFILE, toolchain="zig", sources=str(folder))
        write_directory(str(folder / "out"), formats.export("riscv", model, schedule, options))
    finally:
        bundle.RUNTIME = sound
    return formats.open_target(str(folder / "out"))


def found_by(engine: str, target: Target) -> list[str]:
    """Return the codes of the errors that an engine finds, with what is injected every day."""
    try:
        checked = DEPLOYMENT.check(target, CheckOptions(engine=engine))
        return sorted({d.code for d in checked.diagnostics if d.is_error})
    except HalpipeError as failure:
        return sorted({d.code for d in failure.diagnostics})


def mutants(folder: Path, sound: Target) -> Any:
    """Yield name, and what makes the mutant in a folder."""
    for name, (file, what, instead, _) in {**CONTAINMENT, **OTHERS}.items():
        yield name, lambda at, one=(file, what, instead): build(at, one)
    for name, one in SOURCES.items():
        yield name, lambda at, one=one: build(at, one)
    for name, change in TABLES.items():
        yield f"table: {name}", lambda at, change=change: tampered(sound, at / "b", change)
    for name, change in TARGETS.items():
        yield f"target.json: {name}", lambda at, change=change: _retargeted(sound, at / "b", change)


def _retargeted(sound: Target, path: Path, change: Any) -> Target:
    described = json.loads(sound.bundle.files["target.json"])
    change(described)
    return resealed(sound, path, {"target.json": json.dumps(described).encode()})


def main() -> int:
    """Check every mutant; return 1 if the sound bundle is found faulty."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--engines", nargs="+", default=["cosim", "qemu"])
    parser.add_argument("--share", default="0/1", help="of the mutants: K/N takes every N-th from the K-th on")
    chosen = parser.parse_args()
    first, step = map(int, chosen.share.split("/"))
    caught: dict[str, dict[str, list[str]]] = {}
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "sound").mkdir()
        sound = build(folder / "sound")
        for engine in chosen.engines:
            if found_by(engine, sound):
                print(f"the sound bundle: {engine} finds {found_by(engine, sound)}")
                return 1
        for number, (title, make) in enumerate(mutants(folder, sound)):
            if number % step != first:
                continue
            (folder / str(number)).mkdir()
            try:
                target = make(folder / str(number))
                caught[title] = {engine: found_by(engine, target) for engine in chosen.engines}
            except HalpipeError as refused:
                caught[title] = {"export": sorted({d.code for d in refused.diagnostics})}
            print(title, *(f"{e}: {' '.join(c) or '-'}" for e, c in caught[title].items()), sep="; ", flush=True)
            shutil.rmtree(folder / str(number))
    survivors = [title for title, by in caught.items() if not any(by.values())]
    print("survivors:", *survivors, sep="\n  ")
    counts = {engine: sum(bool(by.get(engine)) for by in caught.values()) for engine in chosen.engines}
    print(
        json.dumps(
            {
                "mutants": len(caught),
                "caught": len(caught) - len(survivors),
                **counts,
                "seconds": int(time.process_time() - begin),
            }
        )
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
