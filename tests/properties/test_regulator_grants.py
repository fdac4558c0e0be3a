"""Grants of devices with registers and tables, against arithmetic from the bounds alone: random platforms.

`HALPIPE_PLATFORMS=10000 pytest tests/properties/test_regulator_grants.py` tries so many of each device.
"""

import os
import random
import re
from fractions import Fraction
from math import ceil

import pytest

import regulator_bundles as bundles
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import seconds
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import ARITHMETIC, DEPLOYMENT
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from support import access, job, mode, model, schedule, task, version

PLATFORMS = int(os.environ.get("HALPIPE_PLATFORMS", "30"))
WINDOWS = 20
PORTS = {"afifm2": 0xFD747100, "afifm3": 0xFD74A100, "afifm4": 0xFD74B100, "afifm5": 0xFD74C100}
TEXT = """halpipe-regulator: 1
resource: mem
clock: {clock}Hz
bus: {bus}B
burst: {burst}B
window: {window}
guaranteed: {guaranteed}B/s
capacity: {capacity}B/s
units:
{units}axi-realm: {{base: 0x1000}}
qos400: {{clock: {interconnect}Hz, granularity: phase}}
"""


def drawn(rng):
    """A platform, and for each unit its manager, direction, bound, and the windows of its only access phase."""
    clock, window = rng.choice([10**6, 10**8, 25 * 10**7]), rng.choice([500, 1000, 4000])
    bus = rng.choice([4, 8, 16, 64])
    burst = bus * rng.choice([1, 4, 8, 16])
    p = {"clock": clock, "bus": bus, "burst": burst, "window": window, "interconnect": rng.choice([10**8, 533_333_333])}
    p |= {"guaranteed": bus * clock // rng.choice([20, 33, 77]), "capacity": bus * clock}
    units = []
    for manager in rng.sample(range(8), rng.randint(1, 4)):
        begin = rng.randrange(WINDOWS - 1)
        bound = Fraction(1, rng.randint(5, 40))
        units.append((manager, rng.choice(["read", "write"]), bound, begin, rng.randint(begin + 1, WINDOWS)))
    return p, units


def export(folder, device, p, units):
    width = seconds(Fraction(p["window"], p["clock"]))
    tasks, jobs = [], []
    for n, (_, direction, bound, begin, end) in enumerate(units):
        phase = access("mem", 0, width * (end - begin), bound, direction)
        tasks.append(task(f"t{n}", width * WINDOWS, version("v", width * (end - begin), f"u{n}", phase)))
        jobs.append((f"t{n}", 0, width * begin, f"u{n}"))
    m = model(*tasks, units=" ".join(f"u{n}" for n in range(len(units))), resources="mem", modes=[mode("m", tasks)])
    keys = (f"manager: {unit[0]}, port: {port}" for unit, port in zip(units, PORTS, strict=False))
    path = folder / "p.yaml"
    path.write_text(TEXT.format(units="".join(f"  u{n}: {{{key}}}\n" for n, key in enumerate(keys)), **p))
    options = RegulatorOptions(platform=str(path), backend=device, rounding="whole")
    return RegulatorExporter().write(
        m, schedule(m, width * WINDOWS, *(job(m, *j) for j in jobs), mode_name="m"), options
    )


def writes(files, name):
    found = re.findall(r"WRITE\((-?\d+), (0x\w+), (0x\w+)\)", files[name].decode())
    return [(int(at), int(offset, 16), int(value, 16)) for at, offset, value in found]


def windows_of(starts):
    """A value for each window, from those that begin in some."""
    found = []
    for window in range(WINDOWS):
        found.append(starts[window] if window in starts else found[-1])
    return found


def table(files, p, units):
    for n in range(len(units)):
        lines = files[f"table/unit{n}.tab.memh"].decode().split()[:-1]
        for place, d in ((8, "read"), (16, "write")):
            yield n, d, windows_of({int(line[:8], 16): int(line[place : place + 8], 16) for line in lines}), 0


def axi_realm(files, p, units):
    """A write in a window counts from the next one on; a row without a promise keeps a burst."""
    steps = writes(files, "axi-realm/0-m.txt")
    for n, (manager, *_) in enumerate(units):
        for bank, d in ((0x164, "read"), (0x124, "write")):
            budgets = {at + 1: value for at, offset, value in steps if offset == bank + 8 * manager}
            yield n, d, windows_of(budgets), p["burst"]


@pytest.mark.parametrize(("device", "grants"), [("table", table), ("axi-realm", axi_realm)])
def test_each_window_grants_the_promise_rounded_up_to_bursts(tmp_path, device, grants):
    rng, served = random.Random(device), 0
    for _ in range(PLATFORMS):
        p, units = drawn(rng)
        try:
            files = export(tmp_path, device, p, units)
        except HalpipeError:
            continue
        served += 1
        for n, direction, budgets, least in grants(files, p, units):
            _, own, bound, begin, end = units[n]
            promised = bound * p["guaranteed"] * p["window"] / p["clock"] if own == direction else 0
            budget = max(least, ceil(promised / p["burst"]) * p["burst"])
            expected = [budget if begin <= window < end else least for window in range(WINDOWS)]
            assert budgets == expected, (p, units)
        passes(files)
    assert served * 2 > PLATFORMS


def test_each_phase_has_the_least_rate_that_serves_it(tmp_path):
    """QoS-400: a rate is so many 4096ths of a transfer in a cycle of the interconnect."""
    rng, served = random.Random("qos400"), 0
    for _ in range(PLATFORMS):
        p, units = drawn(rng)
        try:
            files = export(tmp_path, "qos400", p, units)
        except HalpipeError:
            continue
        served += 1
        width = Fraction(p["window"] * 10**9, p["clock"])
        rates = {}
        for at, address, value in writes(files, "qos400/0-m.txt"):
            rates.setdefault(address, {})[max(at, 0)] = value >> 20
        for (_, own, bound, begin, end), base in zip(units, PORTS.values(), strict=False):
            least = max(1, ceil(bound * p["guaranteed"] * 4096 / (p["burst"] * p["interconnect"])))
            for offset, direction in ((0x2C, "read"), (0x20, "write")):
                steps = {0: 1, int(begin * width): least, int(end * width): 1} if own == direction else {0: 1}
                changes = {at: rate for at, rate in steps.items() if at < int(WINDOWS * width)}
                now, expected = None, {}
                for at in sorted(changes):
                    if changes[at] != now:
                        expected[at] = now = changes[at]
                assert rates[base + offset] == expected, (p, units)
        passes(files)
    assert served * 2 > PLATFORMS


def passes(files):
    found = DEPLOYMENT.check(bundles.target(files), CheckOptions(engine=ARITHMETIC)).diagnostics
    assert [str(d) for d in found if d.is_error] == []
