"""Small platforms, systems and schedules that the regulator export is tried on.

The clock is 1 MHz and the window 1000 cycles, so that a window is 1 ms; a burst is 64 bytes and a bound of 1 promises
6.4 MB/s, which is 6400 bytes or 100 bursts per window. So a bound of 0.25 is 25 bursts.
"""

from dataclasses import replace
from fractions import Fraction

from halpipe.exporters.regulator.platform import read_platform
from halpipe.exporters.regulator.tables import TableBuilder
from halpipe.exporters.regulator.words import AUTO
from halpipe.exporters.regulator.writing import backend
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from support import access, job, mode, model, ms, task, version

PLATFORM = """\
halpipe-regulator: 1
resource: mem
clock: 1MHz
bus: 64bit
burst: 64B
window: 1000
guaranteed: 6.4MB/s
units:
  u1: {manager: 0, port: afifm2, core: 0, group: one}
  u2: {manager: 2, port: afifm3, core: 1, group: two}
"""

FULL = {"capacity": "6.6MB/s"}
"""Room for the burst of every row that may be carried over, beside a bound of 1."""


def platform_file(folder, text=PLATFORM, **changes):
    """Write a platform, with keys of it replaced or added; return its path."""
    lines = text.splitlines()
    for key, value in changes.items():
        key = key.replace("_", "-")
        lines = [line for line in lines if not line.startswith(f"{key}:")]
        if value is not None:
            lines.append(f"{key}: {value}")
    path = folder / "platform.yaml"
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def platform(folder, text=PLATFORM, **changes):
    return read_platform(platform_file(folder, text, **changes))


def one_mode(system, hyperperiod, *jobs):
    """A schedule of the only mode of `system`."""
    table = ModeSchedule(name=system.modes[0].name, hyperperiod=ms(hyperperiod), status=Status.VALID, jobs=jobs)
    return Schedule(model=system.name, model_sha256=system.digest, modes=(table,))


def build(folder, system, schedule, rounding=AUTO, backend_name="table", text=PLATFORM, **changes):
    """Return the table object and the findings of a schedule on the sample platform."""
    builder = TableBuilder(system, schedule, platform(folder, text, **changes), backend(backend_name))
    return builder.build(rounding), builder.findings.items


def two_units():
    """Unit u1 reads a quarter for 4 ms; u2 writes a half in the middle of it, and its job wraps round the end."""
    reader = task("reader", 10, version("v", 4, "u1", access("mem", 0, 4, "0.25", "read")))
    writer = task(
        "writer", 10, version("v", 6, "u2", access("mem", 0, 2, "0.5", "write"), access("mem", 5, 6, 1, "load"))
    )
    system = model(reader, writer, units="u1 u2 u3", resources="mem other", name="two-units")
    return system, one_mode(system, 10, job(system, "reader", 0, 1, "u1"), job(system, "writer", 0, 5, "u2"))


def switching():
    """Two modes and both switches: `fast` runs a job that reaches 2 ms into what follows, `slow` another that does.

    fast -> slow has a table of 1 ms with a job in it; slow -> fast is a plain switch, but for a job of `slow` that is
    still reading in the first cycle of `fast`.
    """
    a = task("a", 10, version("v", 5, "u1", access("mem", 0, 5, "0.25", "read")))
    b = task("b", 5, version("v", 3, "u2", access("mem", 0, 3, "0.5", "read"), access("mem", 2, 3, "0.1", "write")))
    modes = (mode("fast", [a]), mode("slow", [b]))
    system = model(
        a,
        b,
        units="u1 u2",
        resources="mem",
        modes=modes,
        name="switching",
        transitions=[("fast", "slow", None), ("slow", "fast", None)],
    )
    first = ModeSchedule(name="fast", hyperperiod=ms(10), status=Status.VALID, jobs=(job(system, "a", 0, 7, "u1"),))
    second = ModeSchedule(name="slow", hyperperiod=ms(5), status=Status.VALID, jobs=(job(system, "b", 0, 4, "u2"),))
    tables = (
        TransitionTable(
            source="fast",
            target="slow",
            length=ms(1),
            worst_latency=ms(11),
            status=Status.VALID,
            jobs=(job(system, "b", 0, 0, "u2"),),
        ),
        TransitionTable(source="slow", target="fast", length=ms(0), worst_latency=ms(5), status=Status.VALID),
    )
    return system, Schedule(model=system.name, model_sha256="", modes=(first, second), transitions=tables)


def gang():
    """A job on both units, reading three eighths between them."""
    both = task("both", 10, version("v", 4, "u1 u2", access("mem", 1, 3, Fraction(3, 8), "read"), gang=2))
    system = model(both, units="u1 u2", resources="mem", name="gang")
    return system, one_mode(system, 10, job(system, "both", 0, 0, "u1 u2"))


DIGEST = "0123456789abcdef" * 4
WIDE = {"capacity": "7.4MB/s"}
ROOMY = {"capacity": "16MB/s", "bus": "128bit"}  # for the steps of cores, and what they write back
LOW = {
    "table": {},
    "axi-realm": {},
    "qos400": {"qos400": "{clock: 1MHz}"},
    "memguard": ROOMY,
    "resctrl": ROOMY,
}


def low_bounds():
    """Two modes with bounds that even one rate per unit can serve."""
    a = task("a", 10, version("v", 5, "u1", access("mem", 0, 5, "0.25", "read")))
    b = task("b", 5, version("v", 3, "u2", access("mem", 0, 3, "0.3", "read"), access("mem", 2, 3, "0.1", "write")))
    system, schedule = switching()
    return replace(system, tasks=(a, b)), schedule


def made(tmp_path, name, sample=low_bounds, **changes):
    tables, findings = build(tmp_path, *sample(), backend_name=name, **(WIDE | LOW[name] | changes))
    return tables, [*findings, *backend(name).check(tables)]


def files(tmp_path, name, sample=low_bounds, **changes):
    tables, found = made(tmp_path, name, sample, **changes)
    assert [d for d in found if d.is_error] == []
    return backend(name).write(tables, DIGEST)


def nearly_all():
    """Two units that read 0.55 and 0.45 at the same time."""
    a = task("a", 10, version("v", 5, "u1", access("mem", 0, 5, "0.55", "read")))
    b = task("b", 10, version("v", 5, "u2", access("mem", 0, 5, "0.45", "read")))
    system = model(a, b, units="u1 u2", resources="mem")
    return system, one_mode(system, 10, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 0, "u2"))
