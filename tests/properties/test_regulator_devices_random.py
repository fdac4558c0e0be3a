"""Random platforms of every device with settings of its own: what is exported is what its check expects."""

import random
from dataclasses import replace
from fractions import Fraction

import pytest

import regulator_bundles as bundles
import regulator_systems as systems
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions

PLATFORM = """halpipe-regulator: 1
resource: mem
clock: {clock}
bus: {bus}B
burst: {burst}B
window: {window}ns
guaranteed: {guaranteed}B/s
capacity: {capacity}B/s
overshoot: {overshoot}B
units:
{units}{settings}
"""


def settings(rng, device, units):
    """The settings of a device, some of them left out."""
    known = {
        "axi-realm": {"managers": rng.randint(units, 32), "regions": rng.randint(1, 16), "pending": rng.randint(1, 9)},
        "qos400": {"granularity": rng.choice(["mode", "phase"]), "burstiness": rng.choice([1, 4])},
        "memguard": {
            "cores": rng.choice([units, 16]),
            "line": rng.choice(["32B", "64B"]),
            "write-backs": rng.choice(["0", "1/3", "1"]),
            "write-refills": rng.choice(["0", "1/7", "1"]),
            "granularity": rng.choice(["mode", "phase"]),
        },
        "resctrl": {"kind": rng.choice(["amd", "mpam", "intel"]), "others": rng.choice(["7", "4 5"])},
    }[device]
    kept = [f"{name}: {value}" for name, value in known.items() if rng.random() < 0.8]
    if device == "memguard":
        kept.append(f"period: {rng.choice([1000, 1500, 12345, 10**6])}us")
    if "kind: mpam" in kept:
        kept.append(f"width: {rng.randint(2, 16)}")
    return f"{device}: {{{', '.join(kept)}}}" if kept else ""


@pytest.mark.slow
@pytest.mark.parametrize("device", ["axi-realm", "qos400", "memguard", "resctrl"])
def test_random_platforms_pass_their_check_or_are_refused(tmp_path, device):
    exported = 0
    for seed in range(14):
        rng = random.Random(f"{device} {seed}")
        shape = replace(systems.random_shape(rng), units=rng.choice([1, 2, 3]), load=Fraction(1, rng.choice([2, 40])))
        model, schedule = systems.random_system(rng, shape)
        is_timed = device == "axi-realm"  # which has windows of whole cycles
        carried = shape.bus * (100_000_000 if is_timed else 33_333_333)
        path = tmp_path / "platform.yaml"
        units = "".join(
            f"  {unit.name}: {{manager: {n}, port: afifm{n}, core: {n}, group: g{n}}}\n"
            for n, unit in enumerate(model.units)
        )
        path.write_text(
            PLATFORM.format(
                clock="100MHz" if is_timed else rng.choice(["33333333Hz", "99999001Hz", "249997498Hz"]),
                bus=shape.bus,
                burst=shape.burst,
                window=shape.window * 10,
                guaranteed=carried // rng.choice([2, 8, 20]),
                capacity=carried,
                overshoot={"axi-realm": 1, "qos400": 4}.get(device, rng.randrange(2)) * shape.burst,
                units=units,
                settings=settings(rng, device, shape.units),
            )
        )
        try:
            files = RegulatorExporter().write(model, schedule, RegulatorOptions(platform=str(path), backend=device))
        except HalpipeError:
            continue
        exported += 1
        checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
        assert [str(d) for d in checked.diagnostics if d.is_error] == [], (seed, path.read_text())
    assert exported >= 3
