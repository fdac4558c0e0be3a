"""Profiles: those that come with halpipe are sound, and a user's own is held to the same rules."""

from fractions import Fraction

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.exporters.riscv.codes import BAD_PROFILE, UNKNOWN_PROFILE
from halpipe.exporters.riscv.profile import FOLDER, names, read_profile

VCU118 = (FOLDER / "vcu118.yaml").read_text()


def refusal(folder, text):
    path = folder / "mine.yaml"
    path.write_text(text)
    with pytest.raises(HalpipeError) as caught:
        read_profile(str(path))
    return caught.value.diagnostics


@pytest.mark.parametrize("name", names())
def test_builtin_profiles_have_room_for_jobs(name):
    profile = read_profile(name)
    assert profile.code_room > 100 * 1024
    assert profile.data_room > 240 * 1024
    assert profile.tick * profile.timebase == Duration.parse("1s")


def test_the_papers_platform():
    """Section V: four cores, each with 120 KiB for instructions and 256 KiB for data."""
    profile = read_profile("vcu118")
    assert (profile.cores, profile.ispm.size, profile.dspm.size) == (4, 120 * 1024, 256 * 1024)
    assert profile.tick.fraction == Fraction(1000)


def test_a_profile_of_ones_own(tmp_path):
    path = tmp_path / "board.yaml"
    path.write_text(VCU118.replace("cores: 4", "cores: 2").replace("400MB/s", "100MB/s"))
    profile = read_profile(str(path))
    assert (profile.name, profile.cores, profile.dma.bandwidth) == ("board", 2, 100_000_000)


def test_bandwidths_by_memory_and_cycles_by_kind(tmp_path):
    each = "bandwidth: {ispm: 58MB/s, dspm: 105MB/s, main: 159MB/s}"
    text = VCU118.replace("bandwidth: 400MB/s, bus: 800MB/s", each) + "cpi: {jobs: 1.5, multiply: 11, load-byte: 3}\n"
    (tmp_path / "mine.yaml").write_text(text)
    profile = read_profile(str(tmp_path / "mine.yaml"))
    assert profile.dma.into == {"ispm": 58_000_000, "dspm": 105_000_000, "main": 159_000_000}
    assert (profile.dma.bandwidth, profile.dma.bus) == (58_000_000, 4 * 58_000_000)
    assert profile.cpi == profile.management_cpi == Fraction(3, 2)
    long, others = ("multiply", "multiply-word", "divide"), ("load", "taken", "mispredicted")
    assert profile.classes == dict.fromkeys(long, 11) | dict.fromkeys(others, Fraction(3, 2)) | {"load-byte": 3}


def test_unknown_profile_names_the_nearest():
    with pytest.raises(HalpipeError) as caught:
        read_profile("vcu119")
    [found] = caught.value.diagnostics
    assert found.code == UNKNOWN_PROFILE.id
    assert "vcu118" in found.help


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("halpipe-profile: 1", "halpipe-profile: 2", "no profile of version 1"),
        ("stride: 0x20000", "stride: 0x1000", "overlap"),
        ("base: 0x01820000", "base: 0x01820010", "multiples of 4 KiB"),
        ("size: 120KiB", "size: 4KiB", "no room beside the monitor"),
        ("stack: 8KiB", "stack: 256KiB", "no room beside stack"),
        ("base: 0x80000000", "base: 0xffffffffff", "multiples of 4 KiB"),
        ("clint: 0x02000000", "clint: 0x01040000", "dspm of core 1 and clint overlap"),
        ("clint: 0x02000000", "clint: 0x01830000", "ispm of core 1 and clint overlap"),
        ("clint: 0x02000000", "clint: 0x80000000", "main and clint overlap"),
        ("base: 0x03000000", "base: 0x80002000", "main and dma overlap"),
        ("base: 0x03000000", "base: 0x63fff000", "uart and dma overlap"),  # by its third channel
        ("base: 0x64000000", "base: 0x03000000", "uart and dma overlap"),
        ("base: 0x64000000", "base: 0x0200c000", "clint and uart overlap"),
        ("clint:", "finisher: 0x64000800\nclint:", "uart and finisher overlap"),
        ("base: 0x64000000", "base: 0xffffffffff", "uart ends beyond 2^40"),
        ("base: 0x01040000", "base: 0xc0000000", "dspm of core 1 is more than 2 GiB from ispm of core 1"),
        ("clint:", "scratchpad: {base: 0x0, size: 64KiB}\nclint:", "scratchpad is more than 2 GiB from the first page"),
    ],
)
def test_contradictions_are_told(tmp_path, old, new, said):
    found = refusal(tmp_path, VCU118.replace(old, new))
    assert {d.code for d in found} == {BAD_PROFILE.id}
    assert any(said in d.message for d in found)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("cores: 4", "cores: 0"),
        ("cores: 4", "cores: many"),
        ("clint: 0x02000000", "clint: here"),
        ("kind: pdma", "kind: magic"),
        ("bandwidth: 400MB/s", "bandwidth: 0B/s"),
        ("size: 64MiB", "size: 64"),
        ("setup: 2us", "setup: 2"),
        ("clint: 0x02000000\n", ""),
        ("cores: 4", "coers: 4"),
        ("bandwidth: 400MB/s", "bandwidth: {ispm: 58MB/s, dspm: 105MB/s}"),
        ("bandwidth: 400MB/s", "bandwidth: {itim: 58MB/s}"),
        ("cores: 4", "cpi: {multiply: 11}\ncores: 4"),
        ("size: 120KiB", 'size: 120KiB, lr-sc: "no"'),  # jobs do not write to their code
    ],
)
def test_unusable_values_have_a_line(tmp_path, old, new):
    assert old in VCU118
    found = refusal(tmp_path, VCU118.replace(old, new))
    assert all(d.at.line and d.help for d in found)


FREE = VCU118.replace("0x80000000, size: 64MiB", "0xc0000000, size: 64MiB").replace("clint: 0x02", "clint: 0x10")
MANY = FREE.replace("base: 0x01040000", "base: 0x20000000")
WATCHDOG = "clint: 0x02000000\nwatchdog: {{address: {}, value: {}, timeout: 1s}}"


@pytest.mark.parametrize(
    ("text", "old", "most", "beyond"),
    [
        (MANY, "cores: 4", "cores: 64", "cores: 65"),
        (VCU118, "clock: 100000000", "clock: 1000", "clock: 999"),
        (VCU118, "clock: 100000000", "clock: 100000000000", "clock: 100000000001"),
        (VCU118, "timebase: 1000000", "timebase: 1000", "timebase: 999"),
        (VCU118, "timebase: 1000000", "timebase: 1000000000", "timebase: 1000000001"),
        (VCU118, "channels: 4", "channels: 64", "channels: 65"),
        (VCU118, "size: 64MiB", "size: 16GiB", "size: 17GiB"),
        (VCU118, "cores: 4", "cores: 4\ncpi: 1000", "cores: 4\ncpi: 1001"),
        (VCU118, "cores: 4", "cores: 4\ncpi: 1", "cores: 4\ncpi: 0.5"),
        (VCU118, "stack: 8KiB", "stack: 16B", "stack: 8B"),
        (VCU118, "stack: 8KiB", "stack: 251888B", "stack: 252KiB"),  # of 256 KiB, 4 are for mailbox and monitor
        (VCU118, "size: 120KiB", "size: 8KiB", "size: 4KiB"),  # which the monitor has
        (VCU118, "base: 0x64000000", "base: 0xfffffff000", "base: 0xfffffff001"),
        (FREE, "base: 0x01040000", "base: 0x8177f000", "base: 0x81780000"),  # from the end of the last to its code
        (VCU118, "base: 0x80000000", "base: 0x80001000", "base: 0x80000800"),
        (VCU118, "clint: 0x02000000", "clint: 0x02010000", "clint: 0x02008000"),
        (VCU118, "clint: 0x02000000", WATCHDOG.format("0x70000ffc", "0xffffffff"), WATCHDOG.format("0x70000ffe", "0")),
        (VCU118, "clint: 0x02000000", WATCHDOG.format("0x70000000", "0"), WATCHDOG.format("0x70000000", "0x100000000")),
        (VCU118, "stride: 0x20000", "stride: 0x1e000", "stride: 0x1d000"),  # without a gap, and over each other
    ],
)
def test_the_last_value_that_can_be_and_the_first_that_cannot(tmp_path, text, old, most, beyond):
    assert old in text
    assert refusal(tmp_path, text.replace(old, beyond, 1))
    (tmp_path / "mine.yaml").write_text(text.replace(old, most, 1))
    assert read_profile(str(tmp_path / "mine.yaml")).name == "mine"


def test_what_is_too_far_says_where_it_may_begin(tmp_path):
    [found] = refusal(tmp_path, FREE.replace("base: 0x01040000", "base: 0x81780000"))
    place = "begin it from 0x0 to 0x8183f000"
    assert found.message == f"dspm of core 4 is more than 2 GiB from ispm of core 4, whose code names it; {place}"


def test_registers_of_devices_keep_whole_pages(tmp_path):
    for address, said in (("0x63fffffc", []), ("0x64000ffc", ["uart and watchdog overlap"])):
        text = VCU118.replace("clint: 0x02000000", WATCHDOG.format(address, "1"))
        if said:
            assert [d.message for d in refusal(tmp_path, text)] == said
        else:
            (tmp_path / "mine.yaml").write_text(text)
            assert read_profile(str(tmp_path / "mine.yaml")).watchdog.value == 1


def test_patience_is_four_operations_for_each_core():
    profile = read_profile("vcu118")
    assert (profile.cores, str(profile.service), profile.patience) == (4, "6.5us", 104)


def test_all_faults_at_once(tmp_path):
    found = refusal(tmp_path, VCU118.replace("cores: 4", "cores: 0").replace("kind: pdma", "kind: magic"))
    assert len(found) == 2


LEAST = """halpipe-profile: 1
cores: 2
clock: 50000000
timebase: 1000000
main: {base: 0x80000000, size: 64MiB}
ispm: {base: 0x01820000, stride: 0x20000, size: 120KiB}
dspm: {base: 0x01040000, stride: 0x40000, size: 256KiB}
service: 5us
clint: 0x02000000
uart: {kind: sifive, base: 0x64000000}
dma: {kind: copy, bandwidth: 10MB/s, setup: 1us}
"""


def read(folder, text):
    (folder / "mine.yaml").write_text(text)
    return read_profile(str(folder / "mine.yaml"))


def test_what_a_profile_does_not_state(tmp_path):
    profile = read(tmp_path, LEAST)
    assert (profile.summary, profile.qemu, profile.finisher, profile.latency) == ("", (), 0, Duration(0))
    assert (profile.scratchpad, profile.watchdog, profile.is_coherent) == (None, None, True)
    assert profile.stack == 8 * 1024
    assert {profile.cpi, profile.management_cpi, *profile.classes.values()} == {1}
    assert (profile.dspm.has_reservations, profile.ispm.has_reservations) == (True, True)
    assert (profile.dma.channels, profile.dma.bus, profile.dma.bandwidth) == (1, 10_000_000, 10_000_000)
    assert profile.dma.base == 0
    engine = LEAST.replace("kind: copy", "kind: pdma, base: 0x3000000, channels: 3")
    assert (read(tmp_path, engine).dma.stride, read(tmp_path, engine).dma.bus) == (4096, 30_000_000)


@pytest.mark.parametrize("key", [line.partition(":")[0] for line in LEAST.splitlines()[1:]])
def test_what_a_profile_has_to_state(tmp_path, key):
    text = "".join(f"{line}\n" for line in LEAST.splitlines() if not line.startswith(f"{key}:"))
    found = refusal(tmp_path, text)
    assert [d.message for d in found] == [f'lacks the key "{key}"']


@pytest.mark.parametrize("key", ["base", "stride", "size", "kind", "bandwidth", "setup"])
def test_what_each_part_of_a_profile_has_to_state(tmp_path, key):
    for part in ("main", "ispm", "dspm", "uart", "dma"):
        line = next(line for line in LEAST.splitlines() if line.startswith(part))
        stated = [each for each in line[line.index("{") + 1 : -1].split(", ") if not each.startswith(f"{key}:")]
        broken = f"{part}: {{{', '.join(stated)}}}"
        if broken != line:
            assert [d.message for d in refusal(tmp_path, LEAST.replace(line, broken))] == [f'lacks the key "{key}"']


def test_an_engine_states_its_registers_and_a_watchdog_all_of_it(tmp_path):
    assert [d.message for d in refusal(tmp_path, LEAST.replace("copy", "pdma"))] == ['lacks the key "base"']
    (found,) = refusal(tmp_path, LEAST + "watchdog: {address: 0x70000000, value: 1}\n")
    assert found.message == 'lacks the key "timeout"'
    dog = read(tmp_path, LEAST + "watchdog: {address: 0x70000000, value: 3, timeout: 2s}\n").watchdog
    assert (dog.address, dog.value, str(dog.timeout)) == (0x70000000, 3, "2s")


def test_a_cache_that_the_engine_does_not_see_needs_one_that_copies(tmp_path):
    assert not read(tmp_path, LEAST + "coherence: none\n").is_coherent
    engine = LEAST.replace("kind: copy", "kind: pdma, base: 0x3000000")
    (found,) = refusal(tmp_path, engine + "coherence: none\n")
    assert "the DMA engine would miss what hart 0 has in its cache" in found.message
    assert read(tmp_path, engine + "coherence: front-bus\n").is_coherent


def test_a_profile_of_another_version_is_refused_at_its_first_line(tmp_path):
    for text in ("# a remark\nhalpipe-profile: 2\n", "- a list\n"):
        (found,) = refusal(tmp_path, text)
        assert (found.message, found.at.line) == ("is no profile of version 1", 1)
