"""Recorded inputs in a bundle: jobs are judged on them, by each engine, and what does not fit is refused."""

import shutil

import pytest
from tampering import resealed

from halpipe.core.diagnostics import HalpipeError
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.deploy.riscv.judge.qemu import EMULATOR
from halpipe.exporters.riscv.codes import BAD_INPUT

SLOW = """#include <stdint.h>
uint64_t sample[8], state[4], track[8];
void sense(void) {
    state[0]++;
    for (uint64_t i = 0; i < sample[0]; i++) __asm__ volatile("");
    for (int i = 0; i < 8; i++) track[i] = sample[i] + state[0];
}
"""


def samples(*firsts):
    return b"".join(first.to_bytes(8, "little") + bytes(range(56)) for first in firsts)


def check(target, **options):
    return DEPLOYMENT.check(target, CheckOptions(inject="none", **options))


@pytest.mark.slow
def test_a_job_that_is_slow_with_data_only(export):
    """The loop of the third sample needs 4 ms at two instructions a turn; the job has less than 2."""
    plain = check(export(sources={"sense.c": SLOW}))
    assert [d for d in plain.diagnostics if d.is_error] == []
    assert any("carries no recorded inputs" in line for line in plain.lines)
    target = export(sources={"sense.c": SLOW}, inputs={"sample.bin": samples(1, 2, 200_000)})

    def late(**options):
        found = [d for d in check(target, **options).diagnostics if d.code == codes.OVERRUN.id]
        return [d.message for d in found if d.path == '"full", job 0 of task "sense"']

    (message,) = late()  # as many hyperperiods of each mode as there are samples
    assert message.startswith("cycle 2:")
    assert late(cycles=2) == []


@pytest.mark.slow
def test_what_is_played_is_what_is_stated(export):
    target = export(sources={"sense.c": SLOW}, inputs={"sample.bin": samples(100, 3000)})
    lines = check(target).lines
    assert any(line.startswith("with recorded inputs of sample, executions fit up to") for line in lines)
    assert not any("empty" in line or "carries no" in line for line in lines)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which(EMULATOR) is None, reason="apt-get install qemu-system-misc")
@pytest.mark.parametrize("profile", ["fu540", "virt"])
def test_both_engines_compute_the_same_of_the_first_sample(export, profile):
    target = export(profile=profile, inputs={"sample.bin": samples(7, 8)})
    checked = DEPLOYMENT.check(target, CheckOptions(engine="qemu"))
    assert "all buffers hold at the end what they hold in the co-simulation" in checked.lines


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ({"sampel.bin": bytes(64)}, 'no buffer "sampel"'),
        ({"sample.dat": bytes(64)}, 'no buffer "sample.dat"'),
        ({"sample.bin": bytes(65)}, "has 65 bytes, its buffer 64"),
        ({"sample.bin": b""}, "has 0 bytes"),
        ({"state.bin": bytes(32)}, "written by a task"),
    ],
)
def test_what_does_not_fit(export, inputs, said):
    with pytest.raises(HalpipeError) as refused:
        export(inputs=inputs)
    assert [(d.code, said in d.message, bool(d.help)) for d in refused.value.diagnostics] == [
        (BAD_INPUT.id, True, True)
    ]


def test_a_bundle_with_other_inputs(export, tmp_path):
    target = export(inputs={"sample.bin": bytes(64)})
    for number, files in enumerate(({"inputs/sample.bin": bytes(63)}, {"inputs/nothing.bin": bytes(8)})):
        with pytest.raises(HalpipeError) as refused:
            check(resealed(target, tmp_path / str(number), files))
        assert refused.value.diagnostics[0].code == codes.BROKEN_TARGET.id
