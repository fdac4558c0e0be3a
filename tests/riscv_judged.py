"""Small systems with faults that other judges play beside the co-simulation: RTL of tiles, Spike."""

import json
import struct
import subprocess
import sys
from collections import defaultdict

from halpipe.deploy.riscv.run.recording import Flag, Kind
from halpipe.flow import formats
from riscv_attacks import DECLARED, bodies

FAULTS = {
    "illegal": '__asm__ volatile(".word 0xc0001073");',
    "wild": "*(volatile uint64_t *)0x80000000UL = 1;",
    "misaligned": '__asm__ volatile("ld t0, 1(%0)" ::"r"(x));',
    "amo": '__asm__ volatile("amoadd.d t0, t0, (%0)" ::"r"(0x80000000UL));',
    "jump": "((void (*)(void))0x80000000UL)();",
    "csr": '__asm__ volatile("csrw mtvec, zero");',
    "spin": 'for (;;) { __asm__ volatile(""); }',
}
GOOD = {
    "good": "for (int i = 0; i < 8; i++) out[i] = in[i] * 3 + 1;",
    "next": "for (int i = 0; i < 8; i++) out[i] = in[i] / 3 + in[7 - i] + (uint64_t)i;",
}


def phase(kind, at, buffer, symbol, size=64):
    moved = f'<transfer buffer="{buffer}" symbol="{symbol}" size="{size}B"/>'
    return f'<access resource="m" start="{at}us" end="{at + 10}us" kind="{kind}">{moved}</access>'


def task(name, unit, phases="", wcet=500):
    return (
        f'<task name="{name}" period="20ms"><version name="v" wcet="{wcet}us"><units names="{unit}"/>{phases}'
        f'<source files="{name}.c" entry="{name}"/></version></task>'
    )


def failing_model(faults=FAULTS):
    tasks = [
        task(name, unit, phase("read", 0, source, "in") + phase("write", 400, target, "out"), 410)
        for name, unit, source, target in (("good", "u1", "a", "b"), ("next", "u2", "b", "a"))
    ]
    tasks += [task(name, f"u{1 + i % 3}") for i, name in enumerate(faults)]
    return system(tasks, (*GOOD, *faults), 3)


def system(tasks, names, units):
    runs = "".join(f'<run task="{name}" versions="v"/>' for name in names)
    platform = "".join(f'<unit name="u{i + 1}"/>' for i in range(units))
    return (
        f'<task-model xmlns="urn:halpipe:task-model:1" name="rtl"><platform>{platform}<resource name="m"/></platform>'
        f'<tasks>{"".join(tasks)}</tasks><modes><mode name="on">{runs}</mode></modes></task-model>'
    )


def exported(folder, model, sources, profile):
    """Export a model with its sources, each a function of the file's name."""
    folder.joinpath("own.yaml").write_text(profile)
    folder.joinpath("m.xml").write_text(model)
    for name, (declared, body) in sources.items():
        text = f"#include <stdint.h>\n{declared}\nvoid {name}(void) {{ {body} }}\n"
        folder.joinpath(f"{name}.c").write_text(text)
    return exported_files(folder, folder / "m.xml", folder, "--profile", str(folder / "own.yaml"))


def exported_files(folder, model, sources, *options):
    """Export the model of a file with its sources into a folder."""
    own = ["--sources", str(sources), *options]
    prepared, schedule = (str(folder / name) for name in ("p.xml", "s.xml"))
    for command in (
        ["deploy", "prepare", str(model), "-o", prepared, *own],
        ["schedule", prepared, "-o", schedule, "--tick", "1us"],
        ["export", "riscv", prepared, schedule, "-o", str(folder / "b"), *own],
    ):
        subprocess.run([sys.executable, "-m", "halpipe", *command], check=True, capture_output=True)
    return formats.open_target(str(folder / "b"))


def exported_failing(folder, profile, faults=FAULTS, declared="uint64_t x[2];"):
    """Export two jobs that exchange data, and one with each fault, on three units in turn."""
    sources = {name: ("uint64_t in[8], out[8];", body) for name, body in GOOD.items()}
    sources |= {name: (declared, body) for name, body in faults.items()}
    return exported(folder, failing_model(faults), sources, profile)


def exported_attacks(folder, profile, sound, left_out=()):
    """Export two jobs that exchange data, and one with each attack; addresses are those of a `sound` bundle."""
    texts = [bodies(sound, position) for position in range(3)]
    titles = [title for title in texts[0] if title not in left_out]
    faults = {f"attack{i}": texts[i % 3][title] for i, title in enumerate(titles)}
    return exported_failing(folder, profile, faults, DECLARED)


def memory_of(target, size, leaves, reports=1):
    """Return main memory with a program and its control block: one table, a report or none, and this way to end."""
    described = json.loads(target.bundle.files["target.json"])
    memory = bytearray(size)
    program = target.bundle.files["bundle.bin"]
    memory[: len(program)] = program
    place = int(described["control"], 16) - int(described["main"]["base"], 16)
    control = (0x48414C5049504531, 1, 0, 0, reports, leaves, described["timebase"] // 1000, 0)
    struct.pack_into("<8Q", memory, place, *control)
    return bytes(memory)


def by_slot(recording):
    """Return what the runtime did, in order, for each job."""
    found = defaultdict(list)
    for r in recording.records:
        if r.kind is not Kind.TABLE:
            found[r.cycle, r.table, r.release].append((r.program, r.operation, r.kind, int(r.flags), r.hart))
    return found


def faults_of(recording):
    faults = [a for a in recording.abandoned if a.flags == Flag.FAULT]
    return {(a.cycle, a.release): (int(a.flags), a.cause, a.epc, a.tval) for a in faults}
