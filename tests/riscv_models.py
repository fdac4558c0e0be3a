"""Small systems with C sources for RISC-V bundles: a task that scales numbers, on any units and in any phases."""

from dataclasses import replace

from halpipe.exporters.native import paired
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.models import AccessKind, Source, Transfer
from support import access, job, mode, model, schedule, task, version

SCALE = """#include <stdint.h>
uint32_t numbers[16];
uint32_t scaled[16];
void scale(void) {
    for (int i = 0; i < 16; i++) scaled[i] = numbers[i] * 3;
}
"""


def moving(resource, start, end, kind, *transfers, bound=1):
    """A phase with transfers, each (buffer, symbol, bytes)."""
    phase = access(resource, start, end, bound, AccessKind(kind) if kind else None)
    return replace(phase, transfers=tuple(Transfer(buffer=b, symbol=s, size=n) for b, s, n in transfers))


PHASES = (
    moving("memory", "0ms", "0.1ms", "load"),
    moving("memory", "0.1ms", "0.2ms", "read", ("input", "numbers", 64)),
    moving("memory", "0.9ms", "1ms", "write", ("output", "scaled", 64)),
)


def deployed(name="v", wcet="1ms", units="u1", phases=PHASES, files="scale.c", entry="scale", defines="", gang=1):
    """A version with sources."""
    source = Source(files=tuple(files.split()), entry=entry, defines=tuple(defines.split()))
    return replace(version(name, wcet, units, *phases, gang=gang), source=source)


def single(*versions, units="u1", resources="memory", period="5ms"):
    """A system of one task called ``scale``, and its schedule: a job at 0 of its first version, on its first units."""
    owner = task("scale", period, *(versions or (deployed(units=units),)))
    system = model(owner, units=units, resources=resources)
    chosen = owner.versions[0]
    return system, schedule(system, period, job(system, "scale", 0, 0, " ".join(chosen.units[: chosen.gang])))


def several(tasks, modes, transitions=(), units="u1 u2", resources="memory"):
    """A system without a schedule; `modes` are (name, tasks)."""
    found = [mode(name, used) for name, used in modes]
    return model(*tasks, units=units, resources=resources, modes=found, transitions=transitions)


def on_disk(folder, system, tables, **sources):
    """Write sources (``scale_c="..."``) into a folder; return model and schedule as read from it."""
    texts = {"scale_c": SCALE} | sources
    for name, text in texts.items():
        stem, _, suffix = name.rpartition("_")
        folder.joinpath(f"{stem}.{suffix}").write_text(text)
    files = paired(system, tables)
    for name, content in files.items():
        folder.joinpath(name).write_bytes(content)
    return (
        parse_model(files["model.xml"], str(folder / "model.xml")),
        parse_schedule(files["schedule.xml"], str(folder / "schedule.xml")),
    )
