"""Back-ends that limit rates and shares, not bytes in windows: QoS-400, MemGuard and resctrl."""

import json
import re
from fractions import Fraction
from math import ceil

import pytest
from regulator_samples import (
    DIGEST,
    PLATFORM,
    build,
    files,
    made,
    nearly_all,
    one_mode,
    platform,
    platform_file,
    two_units,
)

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.regulator import codes
from halpipe.exporters.regulator.frames import Row
from halpipe.exporters.regulator.platform import free_help, read_platform
from halpipe.exporters.regulator.rates import limit_of, over_limit, rate_of, segments
from halpipe.exporters.regulator.writing import backend, falls_first
from support import access, job, mode, model, task, version

# ------------------------------------------------------------------------------------------------------ QoS-400


PORTS = {0xFD747100: "afifm2", 0xFD74A100: "afifm3"}
RATES = {0x20: "write", 0x2C: "read"}


def rates_of(script):
    """The rates that a script writes: nanosecond, port, direction, steps."""
    found = []
    for at, address, value in re.findall(r"WRITE\((-?\d+), (0x\w+), (0x\w+)\)", script.decode()):
        offset = int(address, 16) & 0xFF
        found.append((int(at), PORTS[int(address, 16) & ~0xFF | 0x100], RATES[offset], int(value, 16) >> 20))
    return found


def steps(script):
    return {(port, direction): rate for _, port, direction, rate in rates_of(script)}


def test_rates_are_rounded_up_and_never_zero(tmp_path):
    written = files(tmp_path, "qos400")
    rate = Fraction(6_400_000 * 4096, 64 * 10**6)  # steps of a bound of 1
    assert steps(written["0-fast.txt"]) == {
        ("afifm2", "read"): -(-rate // 4), ("afifm2", "write"): 1, ("afifm3", "read"): 1, ("afifm3", "write"): 1,
    }  # fmt: skip
    assert steps(written["1-slow.txt"])["afifm3", "read"] == -(-rate * 3 // 10)


def test_a_rate_beyond_twelve_bits_is_refused(tmp_path):
    found = made(tmp_path, "qos400", qos400="{clock: 25kHz}")[1]
    errors = [d for d in found if d.is_error]
    assert {d.code for d in errors} == {codes.RATE_DOES_NOT_FIT.id}
    assert errors[0].message == "read rate 1.6MB/s is more than the 1.599609MB/s that the register holds"


def test_rates_that_do_not_all_fit_rounded_up_are_reported(tmp_path):
    # A step is 156250 B/s; the rates are 21.82 and 17.86 steps, and two ports that only have the lowest: 40 fit.
    rates = {"capacity": "6.4MB/s", "guaranteed": "6.2MB/s"}
    found = made(tmp_path, "qos400", nearly_all, qos400="{clock: 10MHz}", **rates)[1]
    assert [(d.code, d.path) for d in found] == [(codes.RATE_DOES_NOT_FIT.id, 'mode "all"')]
    assert "comes to 6.5625MB/s, there is room for 6.144MB/s" in found[0].message  # a transfer of each is kept
    capacity = found[0].help.split('"capacity: ')[1].split('"')[0]
    assert made(tmp_path, "qos400", nearly_all, qos400="{clock: 10MHz}", **rates | {"capacity": capacity})[1] == []


def test_one_rate_for_a_mode_needs_the_largest_bounds_of_all_units_to_fit(tmp_path):
    found = made(tmp_path, "qos400", two_units, capacity="8MB/s")[1]
    (peak,) = [d for d in found if d.is_error]
    assert peak.code == codes.RATE_DOES_NOT_FIT.id
    assert "u1 read 1.609375MB/s for 1.6MB/s" in peak.message
    assert "u2 write 3.203125MB/s for 3.2MB/s" in peak.message
    assert "granularity: phase" in peak.help


PHASED = {"qos400": "{clock: 2MHz, granularity: phase}", "capacity": "16MB/s", "bus": "512bit"}


def test_phases_change_the_rates_when_the_bounds_change(tmp_path):
    written = files(tmp_path, "qos400", two_units, **PHASED)
    found = [rates_of(script) for name, script in written.items() if name[0].isdigit()]
    read2 = [(at, rate) for several in found for at, port, d, rate in several if (port, d) == ("afifm3", "read")]
    full = -(-6_400_000 * 4096 // (64 * 2 * 10**6))
    assert read2 == [(-1, 1), (-1, full), (10**6, 1)][-len(read2) :]


def test_rates_fall_before_others_rise(tmp_path):
    now, falls = {}, {}
    for name, script in files(tmp_path, "qos400", two_units, **PHASED).items():
        for at, port, direction, rate in rates_of(script) if name[0].isdigit() else ():
            if (port, direction) in now:
                falls.setdefault(at, []).append(rate < now[port, direction])
            now[port, direction] = rate
    assert any(len(set(order)) == 2 for order in falls.values())
    assert all(order == sorted(order, reverse=True) for order in falls.values())


def test_ports_must_be_those_of_the_chip(tmp_path):
    for port, expected in (("afifm2", []), ("afifm7", [codes.NO_MANAGER.id]), ("", [codes.NO_MANAGER.id])):
        text = PLATFORM.replace("port: afifm2, ", f"port: {port}, " if port else "")
        found = made(tmp_path, "qos400", text=text)[1]
        assert [d.code for d in found if d.is_error] == expected
    assert "afifm0" in found[0].help


# ---------------------------------------------------------------------------------------------- MemGuard, resctrl


def limits(script):
    """The lines that a script leaves behind, for reads and for writes."""
    return dict(re.findall(r"^put (\w+)_limit '([0-9 ]+)'$", script.decode(), re.MULTILINE))


@pytest.mark.parametrize("refills", ["0", "1/3", "1"])
@pytest.mark.parametrize("backs", ["0", "0.5", "1"])
def test_memguard_counts_lines_with_what_they_write_back_and_refill(tmp_path, backs, refills):
    """A writer without lines to refill would stop at its first line: refills are counted as reads."""
    told = f"{{line: 60B, write-backs: {backs}, write-refills: {refills}}}"
    script = files(tmp_path, "memguard", memguard=told)["1-slow.sh"]
    lines = {"read": ceil(Fraction(3, 10) * 6400 / 60), "write": ceil(Fraction(1, 10) * 6400 / 60)}
    read = lines["read"] + ceil(Fraction(refills) * lines["write"])
    write = lines["write"] + ceil(Fraction(backs) * lines["read"])
    assert limits(script) == {"read": f"1 {read}", "write": f"1 {write}"}


def test_memguard_gives_every_core_of_the_machine_a_limit(tmp_path):
    script = files(tmp_path, "memguard", memguard="{cores: 4}")
    assert limits(script["0-fast.sh"]) == {"read": "25 1 1 1", "write": "25 1 1 1"}
    assert '"$(nproc --all)" = 4' in script["setup.sh"].decode()
    found = made(tmp_path, "memguard", memguard="{cores: 1}")[1]
    assert [(d.code, d.path) for d in found] == [(codes.NO_MANAGER.id, 'unit "u2"')]


def test_memguard_with_all_write_backs_may_not_fit_and_names_the_ratio(tmp_path):
    (found, *_) = made(tmp_path, "memguard", bus="64bit", capacity="6.4MB/s", guaranteed="6.4MB/s", sample=nearly_all)[
        1
    ]
    assert (found.code, "write-backs" in found.help) == (codes.RATE_DOES_NOT_FIT.id, True)


def test_memguard_takes_no_period_that_stalls_its_cores(tmp_path):
    found = made(tmp_path, "memguard", window="100us", capacity="16MB/s")[1]
    assert [d.code for d in found] == [codes.RATE_DOES_NOT_FIT.id]
    assert "period: 1000us" in found[0].help
    script = files(tmp_path, "memguard", window="100us", memguard="{period: 2ms}")
    assert "g_period_us=2000" in script["setup.sh"].decode()
    assert limits(script["0-fast.sh"])["read"] == "50 1"  # 1.6 MB/s are 50 lines in 2 ms


def test_memguard_takes_no_period_by_which_it_divides_by_zero(tmp_path):
    """The module computes (int)(period x 2^20) as a divisor, which is 0 for multiples of 4096 us."""
    for period, expected in ((4096, 1), (8192, 1), (4095, 0), (2048, 0), (5000, 0)):
        found = [d for d in made(tmp_path, "memguard", memguard=f"{{period: {period}us}}")[1] if d.is_error]
        assert [d.code for d in found] == [codes.RATE_DOES_NOT_FIT.id] * expected
        assert (period * 1024 * 1024) % 2**32 or expected
        assert not expected or f"period: {period - 1}us" in found[0].help


def test_memguard_wants_a_number_for_every_core(tmp_path):
    for number, expected in (
        (1, []),
        (0, [codes.SHARED_MANAGER.id]),
        (3, [codes.NO_MANAGER.id]),
        (None, [codes.NO_MANAGER.id]),
    ):
        text = PLATFORM.replace("core: 1", f"core: {number}" if number is not None else "core: 1").replace(
            "core: 1, " if number is None else "\0", ""
        )
        assert [d.code for d in made(tmp_path, "memguard", text=text)[1] if d.is_error] == expected


def test_memguard_counts_whole_microseconds(tmp_path):
    found = made(tmp_path, "memguard", clock="3MHz", window="1000")[1]
    assert [d.code for d in found if d.is_error] == [codes.RATE_DOES_NOT_FIT.id]
    assert "period: 1000us" in found[-1].help


@pytest.mark.parametrize("name", ["memguard", "resctrl"])
def test_one_limit_per_mode_needs_the_largest_bounds_to_fit(tmp_path, name):
    found = [d for d in made(tmp_path, name, two_units, capacity="8MB/s")[1] if d.is_error]
    assert {d.code for d in found} == {codes.RATE_DOES_NOT_FIT.id}


def shares(tmp_path, setting, **changes):
    tables, found = made(tmp_path, "resctrl", resctrl=setting, **changes)
    return json.loads(json.dumps(backend("resctrl").facts(tables)))["shares"], found


def test_resctrl_takes_the_least_step_that_keeps_the_promise(tmp_path):
    found, warnings = shares(tmp_path, "{kind: intel, min: 10, step: 10}", capacity="6.4MB/s")
    assert found["slow"] == {"u1": 10, "u2": 40}
    assert found["fast"]["u1"] == 30  # for 25 per cent
    assert [d.code for d in warnings] == [codes.APPROXIMATE.id]


def test_resctrl_with_three_groups_and_the_rest_fits_by_the_next_step(tmp_path):
    """300, 250 and 200 of 1200 MB/s: 30, 30 and 20 per cent, and 10 for all that is in no group."""
    rates = {"u1": 300, "u2": 250, "u3": 200}
    tasks = [task(u, 10, version("v", 5, u, access("mem", 0, 5, Fraction(r, 1200), "read"))) for u, r in rates.items()]
    system = model(*tasks, units="u1 u2 u3", resources="mem", modes=[mode("m", tasks)])
    schedule = one_mode(system, 10, *(job(system, u, 0, 0, u) for u in rates))
    text = PLATFORM + "  u3: {manager: 3, group: three}\n"
    changes = {"clock": "1GHz", "guaranteed": "1200MB/s", "window": "1ms"}
    tables, _ = build(tmp_path, system, schedule, backend_name="resctrl", text=text, **changes)
    found = backend("resctrl").check(tables)
    assert [(d.code, d.path) for d in found] == [
        (codes.APPROXIMATE.id, "platform resctrl"),
        (codes.COARSE_RATE.id, 'mode "m" unit "u2"'),  # 360 for 250
    ]
    assert backend("resctrl").facts(tables)["shares"] == {"m": {"u1": 30, "u2": 30, "u3": 20}}
    script = backend("resctrl").write(tables, DIGEST)["0-m.sh"].decode()
    assert "put . 'MB:0=10'" in script


def test_resctrl_limits_the_other_domains_to_the_least(tmp_path):
    script = files(tmp_path, "resctrl", resctrl="{domain: 1, others: 0 2}")["0-fast.sh"].decode()
    assert "put one 'MB:0=10;1=10;2=10' 'MB:0=10;1=10;2=10'" in script
    assert "put . 'MB:0=10;1=10;2=10'" in script
    found = made(tmp_path, "resctrl", resctrl="{domain: 1, others: 0 1}")[1]
    assert [d.code for d in found if d.is_error] == [codes.RATE_DOES_NOT_FIT.id]


@pytest.mark.parametrize(
    ("name", "old", "new", "free"),
    [
        ("qos400", "port: afifm3", "port: afifm2", "port: afifm0"),
        ("resctrl", "group: two", "group: one", "group: one-2"),
        ("memguard", "core: 1", "core: 0", "core: 1"),
    ],
)
def test_two_units_cannot_share_what_is_written_for_both(tmp_path, name, old, new, free):
    found = made(tmp_path, name, text=PLATFORM.replace(old, new))[1]
    (shared,) = (d for d in found if d.is_error)
    assert (shared.code, shared.path) == (codes.SHARED_MANAGER.id, 'unit "u2"')
    assert shared.help.startswith(f'state "{free}", which is free, or ')
    better = PLATFORM.replace(old, free)
    assert [d for d in made(tmp_path, name, text=better)[1] if d.is_error] == []


def test_what_is_free_is_another_for_each(tmp_path):
    taken = {3, 5}
    named = [re.search(r"core: (\d)", free_help("core", taken, range(6))) for _ in range(5)]
    assert [match and match[1] for match in named] == ["0", "1", "2", "4", None]
    assert free_help("core", taken, range(6)) == "model what shares a core as one unit; no core is free"
    units = "  u1: {manager: 1}\n  u2: {manager: 1}\n  u3: {manager: 1}\n"
    text = re.sub(r"(?s)units:\n.*", f"units:\n{units}", PLATFORM)
    for managers, expected in ((8, ["manager: 0", "manager: 2"]), (2, ["manager: 0", ""])):
        path = platform_file(tmp_path, text=f"{text}backend: axi-realm\naxi-realm: {{managers: {managers}}}\n")
        with pytest.raises(HalpipeError) as refused:
            read_platform(str(path))
        found = [re.search(r'"(.*)", which is free', d.help) for d in refused.value.diagnostics]
        assert [match[1] if match else "" for match in found] == expected


def test_rate_back_ends_are_not_refused_for_windows_that_they_do_not_have(tmp_path):
    """Half a burst per window that no budget can hold is no matter for one rate per unit."""
    changes = {"guaranteed": "6.42MB/s", "capacity": "6.43MB/s", "burst": "3312B", "bus": "128bit"}
    with pytest.raises(HalpipeError):
        build(tmp_path, *nearly_all(), backend_name="table", **changes)
    assert build(tmp_path, *nearly_all(), backend_name="memguard", **changes)[0].tables[0].rounding == "whole"


def test_resctrl_on_amd_counts_eighths_of_a_gigabyte(tmp_path):
    a = task("a", 10, version("v", 5, "u1", access("mem", 0, 5, "0.25", "read")))
    system = model(a, units="u1 u2", resources="mem", modes=[mode("m", [a])])
    schedule = one_mode(system, 10, job(system, "a", 0, 0, "u1"))
    changes = {"clock": "1GHz", "guaranteed": "4.3GB/s", "capacity": None, "resctrl": "{kind: amd}"}
    tables, _ = build(tmp_path, system, schedule, backend_name="resctrl", **changes)
    assert backend("resctrl").facts(tables)["shares"] == {"m": {"u1": 9, "u2": 1}}  # 1.075 GB/s are 8.6 eighths


def test_resctrl_needs_groups(tmp_path):
    text = PLATFORM.replace(", group: two", "")
    found = made(tmp_path, "resctrl", text=text)[1]
    assert [(d.code, d.path) for d in found if d.is_error] == [(codes.NO_MANAGER.id, 'unit "u2"')]


def test_platform_settings_are_kept_with_their_defaults(tmp_path):
    assert platform(tmp_path, resctrl="{min: 5}").settings["resctrl"] == {
        "kind": "intel", "domain": "0", "others": "", "min": "5", "step": "", "max": "", "width": "8",
        "levels": "",
    }  # fmt: skip


def test_settings_fall_to_what_all_before_have_and_rise_then():
    before = [{"a": 5, "b": 1}, {"a": 2, "b": 4}]
    assert falls_first(before, {"a": 3, "b": 1}) == [("a", 2), ("b", 1), ("a", 3)]
    assert falls_first([], {"a": 3}) == [("a", 3)]
    assert falls_first([{"a": 1}], {"a": 3}) == [("a", 3)]  # nothing is above it that has to fall


def test_phases_are_no_remedy_of_qos400_where_one_of_them_is_too_much(tmp_path):
    """A step is 1.5625 MB/s: two rates of a fifth of the capacity fit, those of `nearly_all` do not."""
    rates = {"capacity": "6.4MB/s", "guaranteed": "6.2MB/s"}
    found = [d for d in made(tmp_path, "qos400", nearly_all, qos400="{clock: 10MHz}", **rates)[1] if d.is_error]
    assert found
    assert not [d for d in found if "granularity: phase" in d.help]
    assert "u1 write 156.25kB/s" not in found[0].message
    assert "u1 write 0.15625MB/s for 0MB/s" in found[0].message


@pytest.mark.parametrize("most", [None, 15_000_000, 20_000_000])
def test_a_capacity_is_named_up_to_what_the_bus_carries_and_the_device_gives(tmp_path, most):
    """A bus of 16 bytes at 1 MHz carries 16 MB/s."""
    tables, _ = build(tmp_path, *nearly_all(), bus="128bit")
    (table,), room = tables.tables, limit_of(tables)
    due = min(16_000_000, most or 16_000_000) - tables.platform.capacity
    for more, is_named in ((0, True), (Fraction(1, 2), False)):
        given = {"u1": room, "u2": due + more}
        (found,) = over_limit(tables, table, given, dict.fromkeys(given, Fraction(0)), "do so", most=most)
        assert ("capacity: " in found.help) == is_named
    assert over_limit(tables, table, {"u1": room}, {}, "do so") == []


@pytest.mark.parametrize(("guaranteed", "is_held"), [(4 * (2**31 - 1), True), (4 * 2**31, False)])
def test_memguard_holds_events_of_31_bits(tmp_path, guaranteed, is_held):
    """One core reads a quarter of what is guaranteed, in bytes and in a second; the other does nothing."""
    t = task("t", "10s", version("v", "5s", "u1", access("mem", 0, "5s", "0.25", "read")))
    system = model(t, units="u1 u2", resources="mem")
    schedule = one_mode(system, "10s", job(system, "t", 0, 0, "u1"))
    changes = {"clock": "1GHz", "bus": "128bit", "window": "100ms", "capacity": "16GB/s"}
    for granularity in ("mode", "phase"):  # of which the second half of the hyperperiod needs nothing
        settings = f"{{line: 1B, period: 1000000us, write-refills: 0, write-backs: 0, granularity: {granularity}}}"
        changes |= {"memguard": settings, "guaranteed": f"{guaranteed}B/s"}
        tables, _ = build(tmp_path, system, schedule, backend_name="memguard", **changes)
        assert bool(backend("memguard").check(tables)) != is_held


def test_units_without_a_core_are_all_that_is_said_of_cores_that_no_unit_has(tmp_path):
    text = PLATFORM.replace("core: 0, ", "").replace("core: 1, ", "")
    for settings in ("{}", "{cores: 1}"):
        found = made(tmp_path, "memguard", text=text, memguard=settings)[1]
        assert [(d.code, d.path) for d in found] == [(codes.NO_MANAGER.id, f'unit "{unit}"') for unit in ("u1", "u2")]


@pytest.mark.parametrize(
    ("start", "expected"),
    [
        (3, [(0, None), (3, "1/4"), (7, None)]),
        (6, [(0, None), (6, "1/4")]),  # up to the end
        (0, [(0, "1/4"), (4, None)]),
        (8, [(0, "1/4"), (2, None), (8, "1/4")]),
    ],
)
def test_stretches_of_constant_bounds_cover_a_table(tmp_path, start, expected):
    t = task("t", 10, version("v", 4, "u1", access("mem", 0, 4, "0.25", "read")))
    system = model(t, units="u1", resources="mem")
    tables, _ = build(tmp_path, system, one_mode(system, 10, job(system, "t", 0, start, "u1")))
    row, window = Row("u1", "read"), tables.grid.window
    assert [(s.begin, s.bounds) for s in segments(tables.tables[0].frame)] == [
        (begin * window, {row: Fraction(bound)} if bound else {}) for begin, bound in expected
    ]


def test_phases_are_a_remedy_of_qos400_up_to_all_that_there_is_room_for(tmp_path):
    """Rates are steps of 15625 B/s: of `two_units` the largest sum of one phase, and of all."""
    tables, _ = made(tmp_path, "qos400", two_units, qos400="{clock: 1MHz}", capacity="16MB/s", bus="128bit")
    sums = [sum(rate_of(tables, bound) for bound in s.bounds.values()) for s in segments(tables.tables[0].frame)]
    idle = 4 - min(len(s.bounds) for s in segments(tables.tables[0].frame) if sum(s.bounds.values()) == 1)
    assert max(sums) == 6_400_000
    most = -(-max(sums) // 15625) * 15625 + idle * 15625 + tables.reserve * 1000
    for capacity, is_one in ((most, True), (most - 1, False)):
        rates = {"qos400": "{clock: 1MHz}", "bus": "128bit", "capacity": f"{capacity}B/s"}
        (found,) = [d for d in made(tmp_path, "qos400", two_units, **rates)[1] if d.is_error]
        assert ("granularity: phase" in found.help) == is_one
