"""Calibrating bundles: what they measure is what the simulated board has, and the profile made of it is usable."""

import shutil
import struct
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, CoSimulation, codes
from halpipe.deploy.riscv.judge import qemu
from halpipe.deploy.riscv.judge.calibration import calibrate
from halpipe.deploy.riscv.judge.report import printed
from halpipe.deploy.riscv.run.recording import CALIBRATION, Dump
from halpipe.deploy.riscv.target import read_site
from halpipe.exporters.riscv.profile import FOLDER, read_profile

RATES = {"ispm": 60_000_000, "dspm": 110_000_000, "main": 160_000_000}
TIMES = {"load": 3, "load-byte": 6, "multiply": 12, "multiply-word": 9, "divide": 60, "taken": 3, "mispredicted": 6}
TEXT = FOLDER.joinpath("vcu118.yaml").read_text()
OWN = TEXT.replace("400MB/s, bus: 800MB/s", "{ispm: 60MB/s, dspm: 110MB/s, main: 160MB/s}, bus: 160MB/s").replace(
    "service: 6500ns",
    "cpi: {{jobs: 1.5, management: 2, {}}}\nservice: 13us".format(", ".join(f"{k}: {v}" for k, v in TIMES.items())),
)


@pytest.fixture(scope="module")
def measured(export, tmp_path_factory):
    """A bundle, and main memory after its run."""
    path = tmp_path_factory.mktemp("profile") / "own.yaml"
    path.write_text(OWN)
    target = export(profile=str(path), calibrate=True)
    run = CoSimulation(target, cycles=4).run()
    return target, run.memory.read(run.site.main.base, run.site.main.size)


@pytest.fixture(scope="module")
def profile(measured, tmp_path_factory):
    path = tmp_path_factory.mktemp("calibrated") / "mine.yaml"
    path.write_bytes(calibrate(*measured, "dump.bin")[0])
    return path


@pytest.mark.slow
def test_what_is_found_is_what_the_board_has(profile):
    found = read_profile(str(profile))
    for memory, rate in RATES.items():
        assert rate * Fraction(90, 100) < found.dma.into[memory] <= rate * Fraction(95, 100)
    assert Duration.parse("2us") < found.dma.setup < Duration.parse("9us")  # with the management core's own time
    assert Duration.parse("6us") < found.service < Duration.parse("8us")  # 3.2 us for the longest at one cycle
    assert found.classes.keys() == TIMES.keys()
    for cycles, stated in (*((found.classes[k], v) for k, v in TIMES.items()), (found.cpi, Fraction(3, 2))):
        assert stated <= cycles < stated * Fraction(102, 100)
    assert 2 <= found.management_cpi < Fraction(204, 100)
    assert found.clock == 10**8


@pytest.mark.slow
def test_a_bundle_for_the_new_profile_works(export, profile):
    checked = DEPLOYMENT.check(export(profile=str(profile)), CheckOptions())
    assert [d for d in checked.diagnostics if d.is_error] == []


@pytest.mark.slow
def test_a_calibrating_bundle_plays_its_schedule(measured):
    checked = DEPLOYMENT.check(measured[0], CheckOptions(inject="none"))
    assert [d for d in checked.diagnostics if d.is_error] == []


def test_what_is_printed_says_the_same(measured):
    target, memory = measured
    site = read_site(target.bundle)
    text = printed(Dump("dump.bin", memory, site.main.base), site, calibrates=True)
    assert calibrate(target, text.encode(), "dump.bin") == calibrate(target, memory, "dump.bin")


def test_a_set_up_below_the_clock_is_a_tick(measured):
    """Bandwidths are written lower than measured, which leaves large transfers less than no time before they flow."""
    target, memory = measured
    site = read_site(target.bundle)
    spoilt, at = bytearray(memory), site.control + CALIBRATION - site.main.base + 8
    for row in range(27):
        kind, size, _ = struct.unpack_from("<3Q", memory, at + 24 * row)
        assert kind <= 3
        struct.pack_into("<Q", spoilt, at + 24 * row + 16, size // 6)
    profile, _ = calibrate(target, bytes(spoilt), "dump.bin")
    assert b"setup: 1.1us" in profile


def refusal(target, memory):
    with pytest.raises(HalpipeError) as refused:
        calibrate(target, memory, "dump.bin")
    (found,) = refused.value.diagnostics
    return found.code, found.message


@pytest.mark.slow
def test_what_is_missing_or_failed_is_named(measured, sound, tmp_path):
    target, memory = measured
    site = read_site(target.bundle)
    at = site.control + CALIBRATION - site.main.base
    no_loops = memory[:at] + (9 * 3).to_bytes(8, "little") + memory[at + 8 :]
    assert refusal(target, no_loops) == (
        codes.NO_CALIBRATION.id,
        f"measurements of kind {', '.join(map(str, range(4, 13)))} are missing",
    )
    failed = memory[: at + 16] + bytes(8) + memory[at + 24 :]
    assert refusal(target, failed) == (codes.NO_CALIBRATION.id, "measurements of kind 1 failed")
    run = CoSimulation(sound, cycles=2).run()
    dump = tmp_path / "plain.bin"
    dump.write_bytes(run.memory.read(run.site.main.base, run.site.main.size))
    command = ["deploy", "calibrate", sound.bundle.path, str(dump), "-o", str(tmp_path / "mine.yaml")]
    done = subprocess.run([sys.executable, "-m", "halpipe", *command], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert codes.NO_CALIBRATION.id in done.stderr
    assert not (tmp_path / "mine.yaml").exists()


@pytest.mark.parametrize(("field", "size"), [(32, 4), (36, 4), (28, 4), (40, 1)])  # release, program, table, kind
def test_records_of_another_bundle(measured, field, size):
    target, memory = measured
    site = read_site(target.bundle)
    spoilt = bytearray(memory)
    for record in range(200):
        at = site.trace.base - site.main.base + record * site.trace.record
        if spoilt[at + 44]:  # not that of a table
            place = at + field if size > 1 else at + 44
            spoilt[place : place + size] = b"\x77" * size
    assert refusal(target, bytes(spoilt))[0] == codes.NO_RECORDING.id


@pytest.mark.slow
@pytest.mark.skipif(shutil.which(qemu.EMULATOR) is None, reason="apt-get install qemu-system-misc")
@pytest.mark.parametrize("name", ["fu540", "virt"])
def test_a_profile_from_qemu(export, tmp_path, monkeypatch, name):
    """Where transfers take no time, the clock bounds what is found; an instruction takes a nanosecond there."""
    target = export(profile=name, calibrate=True)
    kept = {}
    plain = qemu._read

    def read(file, site, said):
        kept["memory"] = Path(file).read_bytes()
        return plain(file, site, said)

    monkeypatch.setattr(qemu, "_read", read)
    checked = DEPLOYMENT.check(target, CheckOptions(engine="qemu"))
    assert [d for d in checked.diagnostics if d.is_error] == []
    path = tmp_path / "mine.yaml"
    path.write_bytes(calibrate(target, kept["memory"], "dump.bin")[0])
    found = read_profile(str(path))
    a_nanosecond = max(Fraction(found.clock, 10**9), Fraction(1))
    assert a_nanosecond <= found.cpi < a_nanosecond * Fraction(115, 100)
