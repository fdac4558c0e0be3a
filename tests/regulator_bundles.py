"""Small regulator bundles for tests: a system of three units, two modes and their switches, and faults for its tables.

A window is 64 cycles of 10 ns, a burst 64 B, and a bound of 1 promises 8 bursts in a window.
"""

from __future__ import annotations

import json
from copy import deepcopy

from halpipe.core.bundles import Bundle
from halpipe.core.durations import Duration
from halpipe.deploy.base import Target
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.models import AccessKind, Schedule, Status, TransitionTable
from support import access, job, mode, model, ms, schedule, task, version

WINDOW = "0.64us"
PLATFORM = """halpipe-regulator: 1
name: tiny
resource: mem
clock: {clock}
bus: 64bit
burst: 64B
window: {window}
guaranteed: 800MB/s
capacity: {capacity}
backend: table
units:
{units}"""


def us(windows):
    """A time in windows."""
    return str(Duration.parse(WINDOW) * windows)


def tasks():
    read, write, load = AccessKind.READ, AccessKind.WRITE, AccessKind.LOAD
    a = task(
        "a",
        us(40),
        version(
            "v",
            us(30),
            "u1",
            access("mem", us(0), us(6), "1/2", load),
            access("mem", us(10), us(13), "1/4", read),
            access("mem", us(26), us(30), "3/8", write),
        ),
    )
    b = task(
        "b",
        us(20),
        version(
            "v", us(14), "u2", access("mem", us(0), us(4), "1/4", read), access("mem", us(9), us(14), "1/8", write)
        ),
        version("w", us(7), "u2", access("mem", us(2), us(7), "1/8", read)),
    )
    c = task("c", us(40), version("v", us(12), "u3", access("mem", us(3), us(12), "1/4")))
    return a, b, c


def system(shift="0ns"):
    """The model and a schedule; the jobs of `a` wrap, `shift` takes all of them off the grid of windows."""
    a, b, c = tasks()
    modes = [mode("full", (a, b, c)), mode("lean", (b, c))]
    pairs = [("full", "lean", None), ("lean", "full", None)]
    m = model(a, b, c, units="u1 u2 u3", resources="mem", modes=modes, transitions=pairs)
    by = Duration.parse(shift)

    def at(windows):
        return Duration.parse(us(windows)) + by

    full = [job(m, "a", 0, at(20), "u1"), job(m, "b", 0, at(1), "u2"), job(m, "b", 1, at(21), "u2")]
    full += [job(m, "c", 0, at(3), "u3")]
    lean = [job(m, "b", 0, at(1), "u2", "w"), job(m, "b", 1, at(21), "u2", "w"), job(m, "c", 0, at(3), "u3")]
    first = schedule(m, us(40), *full, mode_name="full").modes[0]
    second = schedule(m, us(40), *lean, mode_name="lean").modes[0]
    early = (job(m, "b", 0, at(1), "u2", "w"), job(m, "c", 0, at(3), "u3"))
    return m, Schedule(
        model=m.name,
        model_sha256="",
        modes=(first, second),
        transitions=(_switch("full", "lean", us(20), early), _switch("lean", "full", "0ns", ())),
    )


def switch(source, target, length, latency, jobs):
    """A transition table of milliseconds."""
    return TransitionTable(
        source=source, target=target, length=ms(length), worst_latency=ms(latency), status=Status.VALID, jobs=jobs
    )


def _switch(source, target, length, jobs):
    span = Duration.parse(length)
    latency = Duration.parse(us(40)) + span
    return TransitionTable(
        source=source, target=target, length=span, worst_latency=latency, status=Status.VALID, jobs=jobs
    )


def export(folder, m, s, *, window="64", rounding="auto", backend="", units=3, clock="100MHz", capacity="800MB/s"):
    """The files of the bundle, as the exporter writes them; the managers are in another order than the units."""
    path = folder / "platform.yaml"
    managers = "".join(f"  u{n + 1}: {{manager: {(n - 1) % units}}}\n" for n in range(units))
    path.write_text(PLATFORM.format(window=window, units=managers, clock=clock, capacity=capacity))
    options = RegulatorOptions(platform=str(path), rounding=rounding, backend=backend)
    return RegulatorExporter().write(m, s, options)


def target(files):
    """What a check is given for these files."""
    bundle = Bundle("cfg", "regulator", {}, files)
    return Target(
        bundle=bundle,
        model=parse_model(files["model.xml"], "cfg/model.xml"),
        schedule=parse_schedule(files["schedule.xml"], "cfg/schedule.xml"),
    )


def changed(files, change):
    """The files with `change` made to the object in tables.json."""
    data = json.loads(files["tables.json"])
    change(data)
    return {**files, "tables.json": json.dumps(data).encode()}


def budgets(data, table, unit):
    """A unit's budgets in every window of a table: lists of (read, write) bursts."""
    entries = data["tables"][table]["entries"][unit]
    ends = [*(e["window"] for e in entries[1:]), data["tables"][table]["windows"]]
    return [
        [e["read_bursts"], e["write_bursts"]]
        for e, end in zip(entries, ends, strict=True)
        for _ in range(end - e["window"])
    ]


def set_budgets(data, table, unit, values):
    """Put budgets back as run-length entries."""
    burst = data["platform"]["burst_bytes"]
    entries = []
    for window, (read, write) in enumerate(values):
        if not entries or [entries[-1]["read_bursts"], entries[-1]["write_bursts"]] != [read, write]:
            entries.append(
                {
                    "window": window,
                    "read_bytes": read * burst,
                    "write_bytes": write * burst,
                    "read_bursts": read,
                    "write_bursts": write,
                }
            )
    data["tables"][table]["entries"][unit] = entries


def _edit(unit, edit, table=0):
    def change(data):
        values = deepcopy(budgets(data, table, unit))
        set_budgets(data, table, unit, edit(values))

    return change


def _one_more(values):
    busy = next(n for n, (read, _) in enumerate(values) if read)
    values[busy][0] += 1
    return values


def _one_less(values):
    busy = next(n for n, (read, _) in enumerate(values) if read)
    values[busy][0] -= 1
    return values


def _swap_units(data):
    entries = data["tables"][0]["entries"]
    entries["u1"], entries["u2"] = entries["u2"], entries["u1"]


def _drop_entry(data):
    entries = data["tables"][0]["entries"]["u1"]
    del entries[len(entries) // 2]


def _other_successor(data):
    data["tables"][2]["successor"] = 0


FAULTS = {
    "one burst more": _edit("u1", _one_more),
    "one burst less": _edit("u1", _one_less),
    "one burst more in a switch": _edit("u2", _one_more, table=2),
    "a window late": _edit("u2", lambda values: [*values[-1:], *values[:-1]]),
    "read and write swapped": _edit("u1", lambda values: [[write, read] for read, write in values]),
    "two units swapped": _swap_units,
    "another successor": _other_successor,
    "entry dropped": _drop_entry,
}


def forms_of(files):
    """The memory images that follow from tables.json, made here: what hardware would load of a faulty table."""
    data = json.loads(files["tables.json"])
    images = {}
    for unit in data["units"]:
        entries, headers = [], []
        for table in data["tables"]:
            headers.append(f"{table['successor']:02x}{len(entries):06x}{table['windows']:08x}\n")
            for e in table["entries"][unit["unit"]]:
                entries.append(f"{e['window']:08x}{e['read_bytes']:08x}{e['write_bytes']:08x}\n")
        headers += ["0" * 16 + "\n"] * (16 - len(headers))
        entries.append("ffffffff" + "0" * 16 + "\n")
        images[f"table/unit{unit['index']}.tab.memh"] = "".join(entries).encode()
        images[f"table/unit{unit['index']}.hdr.memh"] = "".join(headers).encode()
    return images


def wide_system(units):
    """A system of many units that read and write in turn; the sum of the bounds is 1 at its highest.

    It is for a window that is as many times longer as there are units.
    """
    made = []
    for n in range(units):
        phases = [
            access("mem", us(0 * units), us(4 * units), f"1/{units}", AccessKind.READ if n % 2 else AccessKind.WRITE),
            access("mem", us(5 * units), us(8 * units), f"1/{2 * units}", AccessKind.READ),
        ]
        made.append(task(f"t{n}", us(12 * units), version("v", us(9 * units), f"u{n + 1}", *phases)))
    m = model(*made, units=" ".join(f"u{n + 1}" for n in range(units)), resources="mem")
    jobs = [job(m, t.name, 0, us(1 * units), t.versions[0].units[0]) for t in made]
    return m, schedule(m, us(12 * units), *jobs)
