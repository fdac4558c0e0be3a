"""What a refusal of a platform tells people to write is possible: written, the refusal is gone."""

import re
import tempfile
from pathlib import Path

from hypothesis import assume, given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions
from profiles import examples
from support import access, job, mode, model, schedule, task, version

UNITS = ("u1", "u2", "u3")
PORTS = ("afifm2", "afifm3", "afifm4")


def system(bounds):
    """Two units that read and write, of which one is gone in the second mode."""
    first, second, third = bounds
    a = task("a", 10, version("v", 6, "u1", access("mem", 0, 4, first, "read"), access("mem", 4, 6, third, "write")))
    b = task("b", 10, version("v", 5, "u2", access("mem", 0, 5, second, "read")))
    m = model(a, b, units=" ".join(UNITS), resources="mem", modes=(mode("all", [a, b]),))
    return m, schedule(m, 10, job(m, "a", 0, 0, "u1"), job(m, "b", 0, 4, "u2"), mode_name="all")


@st.composite
def platforms(draw):
    """A platform as a mapping; its numbers may contradict each other, and its back-end may not do."""
    backend = draw(st.sampled_from(["table", "axi-realm", "qos400", "memguard", "resctrl"]))
    rate = st.integers(1, 40).map(lambda n: f"{n * 400}kB/s")
    owners = st.lists(st.integers(0, 9), min_size=3, max_size=3)
    managers, cores = draw(owners), draw(owners)
    ports, groups = (
        draw(st.lists(st.sampled_from(known), min_size=3, max_size=3)) for known in (PORTS, ("g", "h", "i"))
    )
    return {
        "halpipe-regulator": "1",
        "clock": "1MHz",
        "bus": draw(st.sampled_from(["32bit", "64bit", "128bit"])),
        "burst": draw(st.sampled_from(["24B", "60B", "64B", "256B", "1KiB", "8KiB"])),
        "window": draw(st.sampled_from(["3", "7", "100", "300", "1000", "2500", "5000"])),
        "guaranteed": draw(rate),
        "capacity": draw(rate),
        "peak": draw(st.sampled_from(["16MB/s", "8MB/s", "400MB/s"])),
        "backend": backend,
        "units": {
            unit: {"manager": managers[n], "port": ports[n], "core": cores[n], "group": groups[n]}
            for n, unit in enumerate(UNITS)
        },
        "table": {"depth": draw(st.sampled_from(["2", "5", "1024"]))},
        "axi-realm": {
            "managers": draw(st.sampled_from(["1", "4", "8"])),
            "writes-per-window": draw(st.sampled_from(["1", "64"])),
        },
        "qos400": {"clock": draw(st.sampled_from(["1MHz", "20MHz", "533333333Hz"]))},
        "memguard": {
            "cores": draw(st.sampled_from(["0", "4", "10"])),
            "write-backs": draw(st.sampled_from(["0", "1"])),
            "write-refills": draw(st.sampled_from(["0", "1"])),
        },
        "resctrl": {
            "kind": draw(st.sampled_from(["intel", "amd", "mpam"])),
            "width": draw(st.sampled_from(["1", "4", "8"])),
        },
    }


def text(value):
    return "{" + ", ".join(f"{k}: {text(v)}" for k, v in value.items()) + "}" if isinstance(value, dict) else str(value)


def refusals(platform, bounds):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "platform.yaml")
        path.write_text("".join(f"{key}: {text(value)}\n" for key, value in platform.items()))
        try:
            RegulatorExporter().write(*system(bounds), RegulatorOptions(platform=str(path)))
        except HalpipeError as refused:
            return [d for d in refused.diagnostics if d.is_error]
    return []


def remedied(platform, finding):
    """The platform with the first figure of the finding's help in it; None if it names none."""
    nested = re.search(r'(?:state|set) "([a-z0-9-]+): \{([a-z-]+): ([^".}]+)\}"', finding.help)
    plain = re.search(r'(?:state|set) "([a-z-]+): ([^"{}]+)"', finding.help)
    named = re.search(r"(?:use|state) (?:at (?:least|most) )?([0-9][0-9./]*[A-Za-z/]*)", finding.help)
    if nested:
        key, inner, value = nested.groups()
        return {**platform, key: {**platform[key], inner: value}}
    if plain and plain[1] in platform:
        return {**platform, plain[1]: plain[2]}
    unit = re.search(r'unit "(\w+)"', finding.path)
    if plain and unit:
        units = platform["units"]
        return {**platform, "units": {**units, unit[1]: {**units[unit[1]], plain[1]: plain[2]}}}
    key = list(platform)[finding.at.line - 1] if finding.at.line else ""
    if named and isinstance(platform.get(key), str):
        return {**platform, key: named[1]}
    return None


def about(finding):
    """What a finding is about: its line is that of the key, and what is shared is its first word."""
    word = re.match("[a-z]+ ", finding.message)
    return finding.code, finding.path, finding.at.line, word and word[0]


@examples(150)
@given(platform=platforms(), bounds=st.tuples(*[st.sampled_from(["1/3", "1/4", "0.001", "1/2", "2/5"])] * 3))
def test_what_a_refusal_proposes_is_possible(platform, bounds):
    tried = 0
    for _ in range(8):
        found = refusals(platform, bounds)
        assert all(d.help for d in found)
        candidates = [(finding, remedied(platform, finding)) for finding in found]
        possible = [(finding, better) for finding, better in candidates if better not in (None, platform)]
        if not possible:
            break
        finding, better = possible[0]
        again = refusals(better, bounds)
        assert about(finding) not in map(about, again), (finding, platform, again)
        platform, tried = better, tried + 1
    assume(tried)  # what was not refused, or without a figure to write, is no example
