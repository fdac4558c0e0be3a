"""What a job finds in a scratchpad that was not put there for it: reported as soon as it leaves the core."""

import pytest

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.codes import LEFTOVER

HEAD = "#include <stdint.h>\nuint64_t smooth[8], command;\n"


def found_in(target):
    return [d for d in DEPLOYMENT.check(target, CheckOptions(inject="none")).diagnostics if d.code == LEFTOVER.id]


def test_a_sound_bundle_depends_on_no_leftovers(sound):
    assert found_in(sound) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("body", "size"),
    [
        ("(void)command;", 8),  # never written: what the last owner of these bytes left
        ("*(volatile uint8_t *)&command = 1;", 7),
        ("volatile uint64_t fresh[4]; command = fresh[2];", 8),
        ("uint64_t *kept = (uint64_t *)((uintptr_t)&command + 65536); command = ++*kept;", 8),  # a state of its own
    ],
)
def test_bytes_without_a_value_that_leave_the_core(export, body, size):
    found = found_in(export(sources={"act.c": HEAD + f"void act(void) {{ {body} }}\n"}))
    assert found
    assert {d.code for d in found} == {LEFTOVER.id}
    assert all('task "act"' in d.path and f"{size} of 8 bytes" in d.message and '"command"' in d.message for d in found)


@pytest.mark.slow
def test_a_job_that_takes_what_an_earlier_job_left_reads_it_in_one_run_only(export):
    """sense leaves a word in its stack; act, on the same core, tells whether it is there."""
    sense = """#include <stdint.h>
uint64_t sample[8], state[4], track[8];
void sense(void) {
    volatile uint64_t kept[32];
    for (int i = 0; i < 32; i++) kept[i] = 0x5ec2e7;
    for (int i = 0; i < 8; i++) track[i] = sample[i];
}
"""
    act = "volatile uint64_t fresh[32]; command = 0; for (int i = 0; i < 32; i++) command |= fresh[i] == 0x5ec2e7;"
    found = found_in(export(sources={"sense.c": sense, "act.c": HEAD + f"void act(void) {{ {act} }}\n"}))
    assert {d.message.split(" that")[0] for d in found} == {"1 of 8 bytes"}
