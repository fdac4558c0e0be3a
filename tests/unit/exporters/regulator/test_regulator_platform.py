"""Platform files: every value read, every problem at its line, with the numbers and the nearest choice that works."""

import re
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest
from regulator_samples import PLATFORM, platform, platform_file

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.regulator.codes import NO_RESOURCE, NOT_A_PLATFORM, NUMBERS_CONTRADICT, SHARED_MANAGER
from halpipe.exporters.regulator.platform import parse_frequency, read_platform
from halpipe.models import Resource, ResourceKind
from support import model, ms

FOLDER = Path(__file__).parents[3] / "fixtures" / "regulator"
FIXTURES = sorted(FOLDER.glob("*.yaml"))
EXAMPLES = sorted((Path(__file__).parents[4] / "examples" / "platforms").glob("*.yaml"))


def marks(path):
    lines = enumerate(path.read_text().splitlines(), 1)
    return [(number, code) for number, line in lines for code in re.findall(r"HAL\d{4}", line.partition("#")[2])]


def refusal(path):
    with pytest.raises(HalpipeError) as refused:
        read_platform(str(path))
    return refused.value.diagnostics


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_every_problem_is_reported_at_its_line(path):
    assert sorted((d.at.line, d.code) for d in refusal(path)) == marks(path)


@pytest.mark.parametrize("path", FIXTURES, ids=lambda path: path.stem)
def test_every_problem_says_what_to_do(path):
    assert all(d.help and d.message and d.at.file == str(path) for d in refusal(path))


def test_every_code_of_a_platform_file_has_a_fixture():
    found = {code for path in FIXTURES for _, code in marks(path)}
    own = {NOT_A_PLATFORM.id, NUMBERS_CONTRADICT.id, SHARED_MANAGER.id}
    assert found == {"HAL0021", "HAL0022", "HAL0023", "HAL0024", *own}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_the_examples_are_platforms(path):
    found = read_platform(str(path))
    assert found.name == path.stem
    assert found.source == path.read_bytes()
    assert found.capacity > found.guaranteed
    assert len({unit.manager for unit in found.units.values()}) == len(found.units) > 1


def test_what_follows_from_the_numbers(tmp_path):
    found = platform(tmp_path, clock="300MHz", bus="128bit", window=1000, guaranteed="3.2GB/s", capacity="4GB/s")
    assert found.window.fraction == Fraction(10**4, 3)
    assert found.promise == Fraction(3_200_000_000 * 1000, 300_000_000)
    assert found.window_capacity == 13333
    assert (found.units["u2"].manager, found.units["u2"].port, found.units["u2"].core) == (2, "afifm3", 1)


def test_defaults(tmp_path):
    found = platform(tmp_path)
    assert (found.name, found.backend, found.unspecified) == ("platform", "table", "read")
    assert (found.capacity, found.overshoot) == (found.guaranteed, None)
    assert found.settings["table"]["depth"] == "1024"


def test_a_window_may_be_a_duration(tmp_path):
    assert platform(tmp_path, window="2ms").cycles == 2000
    found = platform(tmp_path, window="100.5us")  # of two windows one has a cycle more
    assert (found.cycles, found.extra, str(found.window)) == (100, Fraction(1, 2), "100.5us")
    assert (found.promise, found.window_capacity) == (Fraction(6_432, 10), 640)
    (refused,) = refusal(platform_file(tmp_path, window="0.5us"))
    assert "use at least 10 cycles (10us)" in refused.help


@pytest.mark.parametrize(
    ("changes", "numbers", "remedy"),
    [
        ({"burst": "60B"}, "60 bytes are not whole beats of 8 bytes", "use 56B or 64B"),
        ({"burst": "4B"}, "4 bytes are not whole beats of 8 bytes", "use 8B"),
        ({"burst": "2056B"}, "2056B are more than an AXI burst may have", "use at most 2KiB"),
        ({"bus": "256bit", "burst": "8KiB"}, "8KiB are more than an AXI burst may have", "use at most 4KiB"),
        ({"guaranteed": "9MB/s"}, "9MB/s are more than the bus carries: 8 bytes x 1000000 Hz = 8MB/s", "at most 8MB/s"),
        ({"capacity": "6MB/s"}, "6MB/s are less than the 6.4MB/s guaranteed", "at least 6.4MB/s"),
        ({"window": "0"}, "0ms is no cycle, or too fine a part of one", "at least 10 cycles (10us)"),
        ({"window": "9"}, "9 cycles carry 57 bytes, less than one burst of 64", "at least 10 cycles (10us)"),
    ],
)
def test_contradictions_come_with_the_numbers_and_the_nearest_choice(tmp_path, changes, numbers, remedy):
    found = [d for d in refusal(platform_file(tmp_path, **changes)) if d.code == NUMBERS_CONTRADICT.id]
    assert any(numbers in d.message and remedy in d.help for d in found), found


@pytest.mark.parametrize(
    ("window", "guaranteed", "bytes"),
    [(2**32 - 1, "0.5MB/s", 2**31 - 1), (671088639, "6.4MB/s", 2**32 - 7)],  # the last that each register holds
)
def test_cycles_and_bytes_of_a_window_are_words_of_32_bits(tmp_path, window, guaranteed, bytes):
    found = platform(tmp_path, window=window, guaranteed=guaranteed)
    assert (found.cycles, found.window_capacity) == (window, bytes)
    (refused,) = refusal(platform_file(tmp_path, window=window + 1, guaranteed=guaranteed))
    assert (refused.code, refused.path) == (NUMBERS_CONTRADICT.id, "platform")
    assert refused.message == "cycles and bytes of a window must fit into 32 bits"


@pytest.mark.parametrize("period", ["0us", "1.5us"])
def test_a_period_of_memguard_is_whole_microseconds(tmp_path, period):
    (found,) = refusal(platform_file(tmp_path, memguard=f"{{period: {period}}}"))
    assert "is not whole microseconds above zero" in found.message


def test_parts_of_cycles_have_a_denominator_of_32_bits(tmp_path):
    """As the register of the unit that counts them."""
    finest = 2**32 - 1
    assert platform(tmp_path, window=f"{100 * finest + 1}/{finest}us").extra == Fraction(1, finest)
    (found,) = refusal(platform_file(tmp_path, window=f"{100 * 2**32 + 1}/{2**32}us"))
    assert "too fine a part of one" in found.message
    assert found.help == "use at least 100 cycles (100us)"
    (found,) = refusal(platform_file(tmp_path, window=f"{100 * 2**32 + 3 * 2**30 + 1}/{2**32}us"))
    assert found.help == "use at least 101 cycles (101us)"


def test_a_window_of_too_many_digits_is_no_shorter_one(tmp_path):
    (found,) = refusal(platform_file(tmp_path, window="1" + "0" * 20))
    assert "is too large" in found.message


@pytest.mark.parametrize("base", ["0xa0000002", "a0000000"])
def test_registers_have_an_address_of_words(tmp_path, base):
    (found,) = refusal(platform_file(tmp_path, table={"base": base}))
    assert f"'{base}' is no address" in found.message
    assert platform(tmp_path, table={"base": "0xA0000004"}).base == 0xA0000004
    assert platform(tmp_path, table={"base": "0xA0000004"}, backend="axi-realm").base == 0  # a runtime leaves it alone
    assert platform(tmp_path).base == 0


@pytest.mark.parametrize("burst", ["56B", "8B", "64B", "2048B"])
def test_bursts_of_whole_beats_up_to_the_limit_are_taken(tmp_path, burst):
    assert platform(tmp_path, burst=burst).burst > 0


def test_the_nearest_window_that_carries_a_burst_is_taken(tmp_path):
    assert platform(tmp_path, window=10).window_capacity == 64


def test_frequencies_are_exact():
    assert parse_frequency("533.333333MHz") == 533333333
    for text in ("1.5Hz", "0MHz", "5GHz", "MHz", "1e6Hz", "250"):
        with pytest.raises(ValueError, match="; "):
            parse_frequency(text)


def test_the_resource_may_be_left_to_a_model_that_has_one(tmp_path):
    one, two = model(resources="mem"), model(resources="mem bus")
    assert platform(tmp_path, resource=None).regulated(one) == "mem"
    spin = Resource(name="spin", kind=ResourceKind.LOCK)
    assert platform(tmp_path, resource=None).regulated(replace(one, resources=(*one.resources, spin))) == "mem"
    assert platform(tmp_path, resource="bus").regulated(two) == "bus"
    for wrong, system in ((None, two), (None, model()), ("mme", one)):
        with pytest.raises(HalpipeError) as refused:
            platform(tmp_path, resource=wrong).regulated(system)
        (found,) = refused.value.diagnostics
        assert found.code == NO_RESOURCE.id
        assert found.help
    assert 'did you mean "mem"?' in found.help


def test_an_absent_platform(tmp_path):
    assert [d.code for d in refusal(tmp_path / "absent.yaml")] == ["HAL0001"]


def test_the_window_is_exact_where_its_length_is_no_decimal(tmp_path):
    assert platform(tmp_path, clock="3MHz", window=1000).window == ms("1/3ms")


def test_the_sample_is_what_its_comment_says(tmp_path):
    found = platform(tmp_path, PLATFORM)
    assert (found.window, found.promise) == (ms(1), 6400)


@pytest.mark.parametrize("manager", [0, 1])
def test_two_units_with_the_first_manager_share_it_as_those_with_another_do(tmp_path, manager):
    text = PLATFORM.replace("manager: 0,", f"manager: {manager},").replace("manager: 2,", f"manager: {manager},")
    (found,) = refusal(platform_file(tmp_path, text))
    assert (found.code, found.path) == (SHARED_MANAGER.id, 'unit "u2"')
    assert found.help.startswith(f'state "manager: {1 - manager}", which is free')


@pytest.mark.parametrize(
    ("key", "text"), [("clock", "x"), ("bus", "x"), ("burst", "x"), ("guaranteed", "x"), ("window", "x")]
)
def test_a_number_that_does_not_read_is_all_that_is_said_of_it(tmp_path, key, text):
    """What the others are to it is not known."""
    (found,) = refusal(platform_file(tmp_path, **{key: text}))
    assert (found.code, found.message.partition(":")[0]) == ("HAL0023", f'"{key}"')


@pytest.mark.parametrize("levels", ["10=4GB/s 10=5GB/s", "20=4GB/s 10=5GB/s", "10=5GB/s 20=4GB/s"])
def test_measured_levels_ascend_with_their_rates(tmp_path, levels):
    (found,) = refusal(platform_file(tmp_path, resctrl=f'{{levels: "{levels}"}}'))
    assert "does not ascend" in found.message
    assert platform(tmp_path, resctrl="{levels: '10=4GB/s  20=4GB/s'}").settings["resctrl"]["levels"] == (
        "10=4GB/s 20=4GB/s"
    )


@pytest.mark.parametrize(
    ("section", "key", "first", "last", "beyond"),
    [
        ("memguard", "write-backs", "0", "1", ("-1/10", "1.1", "2")),
        ("memguard", "period", "1us", "1s", ("0us", "1/2us")),
        ("", "bus", "8bit", "1024bit", ("4bit", "2048bit", "24bit", "3B", "129B")),
    ],
)
def test_the_first_and_the_last_value_of_a_setting(tmp_path, section, key, first, last, beyond):
    def stated(value):
        changes = {section: f"{{{key}: {value}}}"} if section else {key: value}
        return platform_file(tmp_path, **{"burst": "128B", "window": "1000", "guaranteed": "1MB/s"} | changes)

    for value in (first, last):
        assert read_platform(stated(value))
    for value in beyond:
        (found,) = refusal(stated(value))
        assert (found.code, found.message.partition(":")[0]) == ("HAL0023", f'"{key}"')


@pytest.mark.parametrize(("timebase", "ticks"), [(10**6, 1001), (10**7, 10010), (1998, 1), (1999, 2)])
def test_the_first_table_begins_a_window_and_a_cycle_after_the_start(tmp_path, timebase, ticks):
    """Of 1001 microseconds, in whole ticks."""
    assert platform(tmp_path).lead(timebase) == ticks
