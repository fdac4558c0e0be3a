"""resctrl: writer, loader and model against the arithmetic of Linux, kernel by kernel."""

import os
import random
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest

import regulator_bundles as bundles
import resctrl_kernel
from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.regulator import DEPLOYMENT, codes
from halpipe.deploy.regulator.memguard import Module
from halpipe.deploy.regulator.resctrl import FileSystem
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from halpipe.exporters.regulator import codes as export_codes
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.memguard.writer import _events as memguard_events
from halpipe.exporters.regulator.resctrl.writer import Steps
from profiles import volume
from resctrl_kernel import KERNELS, Kernel
from support import access, job, mode, model, schedule, task, version

PLATFORM = """halpipe-regulator: 1
resource: mem
clock: 1GHz
bus: 1024bit
burst: 128B
window: 1ms
guaranteed: {guaranteed}MB/s
capacity: {capacity}MB/s
peak: {peak}MB/s
backend: resctrl
units:
{units}resctrl: {{{settings}}}
"""
EIGHTH = 125_000_000


def system(bounds, kinds=("read",)):
    tasks = [
        task(f"t{n}", 20, version("v", 10, f"u{n}", access("mem", 0, 5, bound, kinds[n % len(kinds)])))
        for n, bound in enumerate(bounds)
    ]
    names = " ".join(f"u{n}" for n in range(len(bounds)))
    m = model(*tasks, units=names, resources="mem", modes=(mode("m", tasks),))
    return m, schedule(m, 20, *(job(m, f"t{n}", 0, 0, f"u{n}") for n in range(len(bounds))), mode_name="m")


def settings(kernel):
    if kernel.kind == "mpam":
        return f"kind: mpam, width: {kernel.width}"
    return f"kind: {kernel.kind}, min: {kernel.min}, step: {kernel.step}, max: {kernel.max}"


def export(folder, bounds, told, *, guaranteed=1000, capacity=1000, peak=1000, text=PLATFORM):
    path = folder / "p.yaml"
    units = "".join(f"  u{n}: {{manager: {n}, group: g{n}}}\n" for n in range(len(bounds)))
    path.write_text(
        text.format(guaranteed=guaranteed, capacity=capacity, peak=peak, units=units, settings=told), encoding="utf-8"
    )
    return RegulatorExporter().write(*system(bounds), RegulatorOptions(platform=str(path)))


def lines(files):
    script = files["resctrl/0-m.sh"].decode()
    return [line.split("'") for line in script.splitlines() if line.startswith("put ") and "'" in line]


def given(kernel, value, peak):
    numerator, denominator = kernel.share(kernel.stored(value))
    return Fraction(numerator * EIGHTH if kernel.kind == "amd" else numerator * peak, denominator)


@pytest.mark.slow
def test_many_platforms_grant_what_the_kernel_makes_of_their_values(tmp_path):
    """Each group is granted its promise by the least value that does, as the kernel stores and shows it."""
    rng = random.Random(39)
    for _ in range(volume(3000)):
        kernel = random_kernel(rng)
        peak, rate = rng.randrange(10**6, 10**11), rng.randrange(10**10)
        told = {"kind": kernel.kind, "domain": "0", "others": "", "width": str(kernel.width or 8), "levels": ""}
        stated = {"min": str(kernel.min), "step": str(kernel.step), "max": str(kernel.max)}
        told |= dict.fromkeys(stated, "") if rng.random() < 0.3 and kernel.kind == "mpam" else stated
        platform = type("P", (), {"settings": {"resctrl": told}, "peak": peak})()
        facts = type("F", (), {"settings": {"resctrl": told}, "peak": peak, "capacity": peak})()
        steps, files = Steps(platform), FileSystem(type("C", (), {"platform": facts})())
        accepted = [n for n in range(kernel.min, kernel.max + 1) if kernel.accepts(n) and (n or kernel.kind == "mpam")]
        enough = [n for n in accepted if given(kernel, n, peak) >= rate]
        if kernel.kind == "intel":
            enough = [n for n in enough if kernel.stored(n) <= kernel.max]
        value = steps.value_for(rate) if steps.values else None
        is_enough = value is not None and steps.given(value) >= rate
        assert is_enough == bool(enough), (kernel, peak, rate)
        if is_enough:
            least = min(given(kernel, n, peak) for n in enough)
            assert steps.given(value) == given(kernel, value, peak) == least, (kernel, peak, rate, value)
            assert kernel.shown(kernel.stored(value)) == steps.shown(value)
            assert files.write(".", f"0={value}", f"0={kernel.shown(kernel.stored(value))}") == ""
            assert files.rate(files.groups["."]["0"]) == least == files.rate(files.least_for(rate))


def random_kernel(rng):
    kind = rng.choice(["intel", "amd", "mpam"])
    if kind == "mpam":
        return Kernel.mpam(rng.randint(1, 16))
    if kind == "amd":
        return Kernel("amd", max=1 << rng.randint(4, 11))
    step = rng.choice([1, 2, 3, 5, 7, 10, 20])
    return Kernel("intel", min=step * rng.randint(1, 2), step=step)


STUB = """#!/bin/sh
exec {python} -S -E {program} {name} "$@"
"""


def load(folder, script, kernel, **changes):
    """Run an exported script on the files of a kernel; return its exit code, what it said, and the groups."""
    files = folder / "resctrl"
    resctrl_kernel.make_files(files, kernel, **changes)
    for name in ("cat", "sed"):
        stub = folder / name
        stub.write_text(STUB.format(python=sys.executable, program=resctrl_kernel.__file__, name=name))
        stub.chmod(0o755)
    (folder / "run.sh").write_text(script.decode().replace("cd /sys/fs/resctrl", f"cd {files}"))
    done = subprocess.run(
        ["sh", str(folder / "run.sh")],
        env={"PATH": f"{folder}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    groups = sorted(path.name for path in files.iterdir() if path.is_dir() and path.name != "info")
    return done.returncode, done.stderr, {group: files / group for group in groups}


posix = pytest.mark.skipif(os.name != "posix", reason="there is no sh")


@posix
@pytest.mark.parametrize(
    "name", [n if n in ("amd", "mpam-4") else pytest.param(n, marks=pytest.mark.slow) for n in KERNELS]
)
def test_scripts_load_on_every_kind_of_kernel(tmp_path, name):
    kernel = KERNELS[name]
    rates = {"guaranteed": 8000, "capacity": 100000, "peak": 100000} if kernel.kind == "amd" else {}
    if kernel.width in (1, 2, 3):  # a part for everything else and one for each group
        rates = {"guaranteed": 100}
    bounds = ["0.21", "0.17"] if kernel.width != 1 else ["0.3"]
    files = export(tmp_path, bounds, settings(kernel), **rates)
    code, said, groups = load(tmp_path, files["resctrl/0-m.sh"], kernel)
    assert (code, said) == (0, "")
    peak = rates.get("peak", 1000) * 10**6
    total = 0
    for group, share in zip((".", "g0", "g1"), ("0", *bounds), strict=False):
        (stored,) = resctrl_kernel.values(tmp_path / "resctrl", group).values()
        numerator, denominator = kernel.share(stored)
        granted = Fraction(numerator * EIGHTH if kernel.kind == "amd" else numerator * peak, denominator)
        assert granted >= Fraction(share) * rates.get("guaranteed", 1000) * 10**6
        total += granted
    assert total <= rates.get("capacity", 1000) * 10**6
    assert list(groups) == [f"g{n}" for n in range(len(bounds))]
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
    assert checked.diagnostics == ()


@posix
@pytest.mark.parametrize(
    ("changes", "kernel", "said"),
    [
        ({}, Kernel("amd", max=2048, min=10), "min_bandwidth is 10, the platform file says 0"),
        ({}, Kernel("amd", max=2048, step=2), "bandwidth_gran is 2, the platform file says 1"),
        ({"domains": (0, 1)}, KERNELS["amd"], "domains is 0;1, the platform file says 0"),
        ({"closids": 2}, KERNELS["amd"], "num_closids is 2, needed are 3"),
    ],
)
def test_other_kernels_are_refused_with_figures_before_anything_is_written(tmp_path, changes, kernel, said):
    rates = {"guaranteed": 8000, "capacity": 100000, "peak": 100000}
    files = export(tmp_path, ["0.21", "0.17"], settings(KERNELS["amd"]), **rates)
    code, told, groups = load(tmp_path, files["resctrl/0-m.sh"], kernel, **changes)
    assert (code, groups) == (1, {})
    assert said in told


@posix
def test_values_that_the_kernel_stores_otherwise_are_found_at_the_write(tmp_path):
    """A script for a step of 4 on a kernel that rounds to 4, too, but has another band: what is shown differs."""
    files = export(tmp_path, ["0.21", "0.17"], "kind: mpam, width: 5")
    code, told, _ = load(tmp_path, files["resctrl/0-m.sh"], Kernel("mpam", 6, 3, 4))
    assert code == 1
    assert "became MB:0=" in told


def test_sums_are_taken_after_the_kernel_has_rounded(tmp_path):
    """15 groups of 7 per cent: each gets 3 of 32 parts, 45 in all."""
    with pytest.raises(HalpipeError) as refused:
        export(tmp_path, ["0.07"] * 14, "kind: mpam, width: 5, min: 3, step: 4")
    (found,) = [d for d in refused.value.diagnostics if d.is_error]
    assert found.code == export_codes.RATE_DOES_NOT_FIT.id
    assert "comes to 1343.75MB/s" in found.message  # 14 of 3 parts, and one for everything else


def test_a_percentage_that_wraps_in_the_field_of_mpam_is_not_written():
    """With 4 bits, 99 and 100 per cent become 105, 17 parts of 16, which is a field of 0: the least."""
    kernel = Kernel.mpam(4)
    assert (kernel.stored(100), kernel.stored(98)) == (0, 15)
    told = {"kind": "mpam", "width": "4", "min": "", "step": "", "max": "", "levels": ""}
    assert Steps(type("P", (), {"settings": {"resctrl": told}, "peak": 16})()).values[-1] == 98


def test_measured_levels_are_what_a_percentage_grants(tmp_path):
    levels = "levels: 10=400MB/s 20=450MB/s 30=800MB/s"
    files = export(tmp_path, ["0.42"], f"kind: intel, {levels}", capacity=1300, peak=1300)
    assert [words[1] for words in lines(files)] == ["MB:0=10", "MB:0=20"]
    checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
    assert checked.diagnostics == ()
    assert "approximately" not in checked.lines[1]
    for wrong in ("levels: 10=2GB/s 20=1GB/s", "levels: 12=1GB/s", "levels: 10=1GB/s 10=2GB/s", "levels: ten"):
        with pytest.raises(HalpipeError):
            export(tmp_path, ["0.42"], f"kind: intel, {wrong}")
    with pytest.raises(HalpipeError):
        export(tmp_path, ["0.42"], f"kind: amd, {levels}")


def test_shares_of_what_was_not_measured_are_called_approximate(tmp_path):
    from halpipe.exporters.regulator.report import findings_of

    unstated = PLATFORM.replace("peak: {peak}MB/s\n", "")
    for told, text, said in (
        ("kind: intel", PLATFORM, "approximately: percentages of MBA were not measured"),
        ("kind: mpam", unstated, "if the component's maximum is the capacity"),
        ("kind: mpam", PLATFORM, ""),
    ):
        files = export(tmp_path, ["0.21"], told, text=text)
        found = {d.code for d in findings_of(files["report.json"])}
        assert (export_codes.APPROXIMATE.id in found) == bool(said)
        checked = DEPLOYMENT.check(bundles.target(files), CheckOptions())
        assert said in checked.lines[1]
        assert checked.diagnostics == ()


def test_a_peak_below_the_capacity_is_refused(tmp_path):
    with pytest.raises(HalpipeError) as refused:
        export(tmp_path, ["0.21"], "kind: mpam", peak=900)
    (found,) = refused.value.diagnostics
    assert (found.code, found.help) == (export_codes.NUMBERS_CONTRADICT.id, "state at least 1GB/s")


def test_the_model_reads_back_as_the_kernel_shows(tmp_path):
    files = export(tmp_path, ["0.21"], "kind: mpam, width: 5")
    name = "resctrl/0-m.sh"
    text = files[name].decode()
    line = next(line for line in text.splitlines() if line.startswith("put g0"))
    assert line == "put g0 'MB:0=24' 'MB:0=25'"
    changed = {**files, name: text.replace(line, "put g0 'MB:0=24' 'MB:0=24'").encode()}
    found = DEPLOYMENT.check(bundles.target(changed), CheckOptions()).diagnostics
    assert {d.code for d in found} == {codes.DEVICE_REFUSES.id}
    assert Path(found[0].at.file).name == "0-m.sh"


@pytest.mark.slow
def test_many_platforms_grant_what_memguard_counts(tmp_path):
    """Limits are events of a cache line per period; one direction brings lines of the other, and 0 is not taken."""
    rng = random.Random(39)
    for _ in range(volume(3000)):
        period, line = rng.choice([1000, 1500, 4095, 12345, rng.randrange(1000, 10**6)]), rng.choice([32, 64, 128])
        refills, backs = (Fraction(rng.randrange(5), rng.randrange(4, 9)) for _ in range(2))
        guaranteed, bounds = rng.randrange(10**6, 10**11), [Fraction(rng.randrange(101), 100) for _ in range(2)]
        told = {"period": str(period), "line": f"{line}B", "write-refills": str(refills), "write-backs": str(backs)}
        told |= {"cores": "1", "granularity": "mode"}
        port = type("U", (), {"core": 0})()
        platform = type("P", (), {"settings": {"memguard": told}, "guaranteed": guaranteed, "units": {"u": port}})()
        unit = type("N", (), {"name": "u"})()
        tables = type("T", (), {"platform": platform, "units": (unit,)})()
        highest = {Row("u", d): bound for d, bound in zip(("read", "write"), bounds, strict=True) if bound}
        # of the module: lines that rates take in a period, and the counters that count them
        lines = [-(-bound * guaranteed * period // (10**6 * line)) for bound in bounds]
        counted = [lines[0] + -(-refills * lines[1] // 1), lines[1] + -(-backs * lines[0] // 1)]
        for direction, events in zip(("read", "write"), counted, strict=True):
            assert memguard_events(tables, highest, direction) == [max(1, events)]
        facts = type(
            "F", (), {"settings": {"memguard": {**told, "period": f"{period}us"}}, "units": {"u": {"core": "0"}}}
        )
        facts.number = lambda self, *names: 1
        module = Module(type("C", (), {"platform": facts(), "tables": tables})())
        assert module.events(bounds[0] * guaranteed) == lines[0]
        assert module.rate(lines[0]) * period == lines[0] * line * 10**6
