"""A watchdog of hart 0: written when each table begins, refused where it is too short, and seen where hart 0 stops."""

import pytest

from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT, codes
from halpipe.exporters.riscv.codes import BAD_PROFILE, WATCHDOG_SHORT
from halpipe.exporters.riscv.profile import FOLDER

KICK = "*(volatile uint32_t *)HP_WATCHDOG = HP_WATCHDOG_VALUE;"
PLAYED = "CONTROL->played = current.cycle;"


@pytest.fixture
def profile(tmp_path):
    def make(line="watchdog: {address: 0x30000010, value: 0xc51, timeout: 12ms}", name="vcu118"):
        text = FOLDER.joinpath(f"{name}.yaml").read_text()
        tmp_path.joinpath("own.yaml").write_text(text.replace("ispm:", f"{line}\nispm:", 1))
        return str(tmp_path / "own.yaml")

    return make


def errors(target, **options):
    checked = DEPLOYMENT.check(target, CheckOptions(cycles=1, inject="none", **options))
    return {d.code: d.message for d in checked.diagnostics if d.is_error}, checked.lines


@pytest.mark.slow
def test_it_is_written_in_time(export, profile):
    found, lines = errors(export(profile=profile()))
    assert found == {}
    assert "the watchdog resets the board 12ms after hart 0 has begun its last table" in lines


@pytest.mark.slow
@pytest.mark.parametrize(("what", "instead"), [(KICK, ";"), ("HP_WATCHDOG_VALUE;", "HP_WATCHDOG_VALUE + 1U;")])
def test_a_runtime_that_does_not_write_it_is_found(mutant, profile, what, instead):
    found, _ = errors(mutant("runtime.c", what, instead, profile=profile()))
    assert set(found) == {codes.WATCHDOG_RESETS.id}
    assert "is written 0 times in " in found[codes.WATCHDOG_RESETS.id]


@pytest.mark.slow
def test_a_runtime_that_writes_it_too_seldom_is_found(mutant, profile):
    found, _ = errors(
        mutant("runtime.c", KICK, f"if ((current.cycle < 1U) || (current.cycle > 2U)) {{ {KICK} }}", profile=profile())
    )
    assert ", and resets the board at " in found[codes.WATCHDOG_RESETS.id]


@pytest.mark.slow
def test_a_hart_0_that_stops_is_reset(mutant, profile):
    found, _ = errors(mutant("runtime.c", PLAYED, f"{PLAYED} __builtin_trap();", profile=profile()))
    assert "; the watchdog resets the board at 11." in found[codes.NOT_FINISHED.id]  # written 1 ms before the run


def test_a_time_out_shorter_than_a_table_is_refused(export, profile, refused):
    short = "watchdog: {address: 0x30000010, value: 1, timeout: 11ms}"
    found = refused(export, profile=profile(short))
    assert {d.code for d in found} == {WATCHDOG_SHORT.id}
    assert [d.message.split('"')[1] for d in found] == ["full", "calm"]
    assert all(d.help.startswith("set the time-out to at least 11.") for d in found)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("watchdog: {address: 0x30000012, value: 1, timeout: 1s}", "no word of 32 bits"),
        ("watchdog: {address: 0x30000010, value: 0x100000000, timeout: 1s}", "no word of 32 bits"),
        ("watchdog: {address: 0x02000010, value: 1, timeout: 1s}", "overlap"),
        ("coherence: none", "would miss what hart 0 has in its cache"),
    ],
)
def test_a_profile_that_cannot_be_right_is_refused(export, profile, refused, line, said):
    (found,) = refused(export, profile=profile(line))
    assert found.code == BAD_PROFILE.id
    assert said in found.message


@pytest.mark.slow
def test_without_an_engine_coherence_does_not_matter(export, profile):
    assert export(profile=profile("coherence: none", "virt")).bundle.files["profile.yaml"]
