"""Gangs that compute at the same time: under QEMU they share one clock, and begin late by what the others compute."""

import shutil

import pytest

pytest.importorskip("unicorn", reason="needs the simulator: pip install ziglang pyelftools unicorn")

from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.judge.qemu import EMULATOR
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow.formats import export, open_target
from riscv_models import deployed, on_disk, single

HEAVY = """#include <stdint.h>
uint32_t numbers[16], scaled[16];
void scale(unsigned rank, unsigned ranks) {
    volatile uint32_t sum = 0;
    for (uint32_t i = 0; i < 20000; i++) sum += i;
    for (int i = 0; i < 16; i++) scaled[i] = numbers[i] + sum + 10 * rank + ranks;
}
"""

pytestmark = [
    pytest.mark.slow,  # the records of such runs are judged in test_riscv_qemu.py
    pytest.mark.skipif(shutil.which(EMULATOR) is None, reason="apt-get install qemu-system-misc"),
]


def exported(folder, profile):
    system, tables = single(deployed(units="u1 u2", gang=2), units="u1 u2")
    model, schedule = on_disk(folder, system, tables, scale_c=HEAVY)
    write_directory(str(folder / "b"), export("riscv", model, schedule, RiscvOptions(profile=profile)))
    return open_target(str(folder / "b"))


def test_a_gang_that_computes_is_sound_under_both_engines(tmp_path):
    target = exported(tmp_path, "fu540")
    assert DEPLOYMENT.check(target, CheckOptions()).diagnostics == ()
    checked = DEPLOYMENT.check(target, CheckOptions(engine="qemu"))
    assert {d.code for d in checked.diagnostics} == {codes.NOT_JUDGED.id}
    assert any("later than that by no more than other cores computed" in line for line in checked.lines)


def test_data_is_not_compared_with_that_of_jobs_that_fail(tmp_path):
    """At the 100 MHz of virt the gang overruns; QEMU's clock is ten times as fast."""
    target = exported(tmp_path, "virt")
    assert codes.OVERRUN.id in {d.code for d in DEPLOYMENT.check(target, CheckOptions()).diagnostics}
    found = DEPLOYMENT.check(target, CheckOptions(engine="qemu")).diagnostics
    assert {d.code for d in found} == {codes.NOT_JUDGED.id}
    assert any("was not compared" in d.message for d in found)
