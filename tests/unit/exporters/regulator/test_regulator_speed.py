"""The export of a large system: 120 tasks, 8 units, 4 modes and their 12 switches."""

from fractions import Fraction

import pytest

from growth import growth, half_way
from halpipe.exporters.regulator import FORMAT, RegulatorOptions
from halpipe.models import ModeSchedule, Schedule, Status, TransitionTable
from support import access, job, mode, model, ms, task, version

UNITS = [f"u{n}" for n in range(8)]
PLATFORM = """\
halpipe-regulator: 1
clock: 250MHz
bus: 128bit
burst: 256B
window: 4000
guaranteed: 3.2GB/s
table: {depth: 65280}
units:
""" + "".join(f"  {unit}: {{manager: {n}}}\n" for n, unit in enumerate(UNITS))


def large(modes):
    """Fifteen tasks on each unit, 8 ms each one after the other, from another of them on in each mode; full load."""
    tasks = []
    for n in range(120):
        read = access("mem", "0ms", "5.003ms", Fraction(1, 8), "read")
        write = access("mem", "5.003ms", "8ms", Fraction(1, 8), "write")
        tasks.append(task(f"t{n}", 120, version("v", 8, UNITS[n % 8], read, write)))
    names = ["a", "b", "c", "d"][:modes]
    pairs = [(x, y) for x in names for y in names if x != y]
    system = model(
        *tasks,
        units=" ".join(UNITS),
        resources="mem",
        modes=[mode(name, tasks) for name in names],
        transitions=[(x, y, None) for x, y in pairs],
    )
    tables = tuple(
        ModeSchedule(
            name=name,
            hyperperiod=ms(120),
            status=Status.VALID,
            jobs=tuple(
                job(system, f"t{n}", 0, f"{(8 * (n // 8 + 3 * number) + n % 8) % 120}ms", UNITS[n % 8])
                for n in range(120)
            ),
        )
        for number, name in enumerate(names)
    )
    switches = tuple(
        TransitionTable(source=x, target=y, length=ms(0), worst_latency=ms(120), status=Status.VALID) for x, y in pairs
    )
    return system, Schedule(model=system.name, model_sha256="", modes=tables, transitions=switches)


@pytest.mark.slow
@pytest.mark.parametrize("rounding", ["whole", "controlled"])
def test_the_time_of_an_export_grows_with_the_modes_and_switches(tmp_path, rounding):
    (tmp_path / "p.yaml").write_text(PLATFORM + "capacity: 3.6GB/s\n")
    options = RegulatorOptions(platform=str(tmp_path / "p.yaml"), rounding=rounding)

    def prepare(modes):
        system, schedule = large(modes)
        return lambda: FORMAT.write(system, schedule, options)

    assert growth(prepare, 1, 4) < half_way(16)  # one table against four and those of twelve switches
