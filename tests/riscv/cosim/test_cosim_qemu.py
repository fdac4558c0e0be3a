"""The same bundles under QEMU: sound ones are accepted, and a job that leaves its scratchpads is caught by its PMP."""

import re
import shutil

import pytest

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.judge.qemu import EMULATOR

pytestmark = [
    pytest.mark.skipif(shutil.which(EMULATOR) is None, reason="apt-get install qemu-system-misc"),
    pytest.mark.slow,
]
WILD = """#include <stdint.h>
uint64_t smooth[8], command;
void act(void) { *(volatile uint64_t *)0x%x = 7; }
"""


def check(target):
    return DEPLOYMENT.check(target, CheckOptions(engine="qemu"))


@pytest.mark.parametrize("profile", ["fu540", "mpfs", "virt"])
def test_a_sound_bundle(export, profile):
    checked = check(export(profile=profile))
    assert [d.code for d in checked.diagnostics] == [codes.NOT_JUDGED.id]
    assert "as scheduled" in checked.lines[-1]


def test_runs_are_the_same_every_time(export):
    target = export(profile="fu540")
    assert check(target) == check(target)


def test_a_job_that_writes_outside_its_scratchpad_is_reported_as_in_the_cosimulation(export):
    target = export(profile="fu540", sources={"act.c": WILD % 0x88000000})
    found = [d for d in check(target).diagnostics if d.code == codes.FAULT.id]
    simulated = DEPLOYMENT.check(target, CheckOptions(engine="cosim"))
    other = [d for d in simulated.diagnostics if d.code == codes.FAULT.id]
    assert "store to memory that is not its own (0x88000000)" in found[0].message
    where = [re.search(r"pc (0x[0-9a-f]+)", d.message)[1] for d in (found[0], other[0])]
    assert where[0] == where[1]


def test_jobs_that_compute_too_much_for_one_clock(export):
    target = export(profile="fu540", change=lambda text: text.replace("ROUNDS=400", "ROUNDS=100000"))
    assert codes.ENGINE_UNFIT.id in {d.code for d in check(target).diagnostics}
