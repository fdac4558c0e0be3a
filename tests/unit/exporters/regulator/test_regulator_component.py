"""The IP-XACT component of a bundle, compared with the Verilog as yosys reads it, with PeakRDL and with the schemas."""

import json
import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from lxml import etree
from regulator_samples import files

import regulator_bundles as bundles

SPACE = {"x": "http://www.accellera.org/XMLSchema/IPXACT/1685-2014"}
SCHEMAS = os.environ.get("HALPIPE_IPXACT", "")


@pytest.fixture(scope="module")
def bundle(tmp_path_factory):
    return bundles.export(tmp_path_factory.mktemp("bundle"), *bundles.system("100ns"))


@pytest.fixture(scope="module")
def component(bundle):
    return etree.fromstring(bundle["table/component.xml"])


def text(element, path):
    return element.findtext("/".join(f"x:{name}" for name in path.split("/")), namespaces=SPACE) or ""


def value(expression, parameters):
    """An expression of SystemVerilog as far as the component has them."""
    return eval(re.sub(r"'h([0-9a-f]+)", r"0x\1", expression), {}, parameters)


def built(component):
    """Parameters with the values of the bundle."""
    found = component.findall("x:parameters/x:parameter", SPACE)
    return {text(p, "name"): int(text(p, "value")) for p in found if text(p, "name") != "IMAGES"}


@pytest.mark.skipif(shutil.which("yosys") is None, reason="yosys is not installed")
@pytest.mark.parametrize("changes", [{}, {"PORTS": 2, "ID": 7, "ADDR": 33, "BUFFER": 0}])
def test_ports_and_buses_are_those_of_the_verilog(bundle, component, tmp_path, changes):
    """Names, directions and widths are those that yosys reads, and each bit of a bus belongs to one interface."""
    parameters = built(component) | changes
    sources = component.findall("x:fileSets/x:fileSet[x:name='rtl']/x:file/x:name", SPACE)
    for name in (source.text for source in sources):
        (tmp_path / Path(name).name).write_bytes(bundle[f"table/{name}"])
    given = " ".join(f"-chparam {name} {number}" for name, number in parameters.items())
    listed = " ".join(Path(source.text).name for source in sources)
    script = f"read_verilog {listed}; hierarchy -check -top halpipe_regulator_axi4 {given}; proc; write_json read.json"
    subprocess.run(["yosys", "-q", "-p", script], cwd=tmp_path, check=True, timeout=300)
    modules = json.loads((tmp_path / "read.json").read_text())["modules"].values()
    (top,) = (module for module in modules if "top" in module["attributes"])
    read = {name: (port["direction"].removesuffix("put"), len(port["bits"])) for name, port in top["ports"].items()}
    stated = {}
    for port in component.findall("x:model/x:ports/x:port", SPACE):
        left = text(port, "wire/vectors/vector/left")
        stated[text(port, "name")] = (text(port, "wire/direction"), 1 + (value(left, parameters) if left else 0))
    assert stated == read
    mapped = []
    for bus in component.findall("x:busInterfaces/x:busInterface", SPACE):
        if value(text(bus, "isPresent") or "1", parameters):
            for port in bus.findall(".//x:physicalPort[x:partSelect]", SPACE):
                left, right = (value(text(port, f"partSelect/range/{end}"), parameters) for end in ("left", "right"))
                mapped += [(text(port, "name"), bit) for bit in range(right, left + 1)]
    on_buses = [
        (name, bit) for name, (_, bits) in read.items() if name[:2] in ("l_", "s_", "m_") for bit in range(bits)
    ]
    assert sorted(mapped) == sorted(on_buses)


def test_logical_names_are_those_of_the_ports_and_each_unit_is_named(component):
    buses = component.findall("x:busInterfaces/x:busInterface", SPACE)
    assert [text(bus, "name") for bus in buses] == ["l0", "l1", *(f"{side}{n}" for n in range(3) for side in "sm")]
    assert text(buses[4], "description") == "From the manager of unit u2."
    for bus in buses:
        for pair in bus.findall(".//x:portMap", SPACE):
            logical, physical = text(pair, "logicalPort/name"), text(pair, "physicalPort/name")
            assert (logical, physical) in {("ACLK", "clk"), ("ARESETn", "rst_n")} or logical == physical[2:].upper()


def test_files_are_there_and_the_buffer_holds_the_longest_burst(bundle, component, tmp_path):
    """A write above the buffer is refused, so that the unit for bursts of 128 beats is built with such a buffer."""
    names = [name.text for name in component.findall("x:fileSets/x:fileSet/x:file/x:name", SPACE)]
    assert {f"table/{name}" for name in names} <= set(bundle)
    assert {"unit2.tab.memh", "bw_tables.h", "linux/bw_regulator.c", "rtl/halpipe_regulator.sdc"} < set(names)
    wide = files(tmp_path, "table", burst="1KiB", capacity="8MB/s", guaranteed="2MB/s")["component.xml"]
    assert (built(component)["BUFFER"], built(etree.fromstring(wide))["BUFFER"]) == (16, 128)


def registers(block):
    """Fields with the properties of them and of their register, by the names of all that they are in."""
    found = {}
    for register in block.iter(f"{{{SPACE['x']}}}register"):
        group = register.getparent()
        above = [text(group, name) for name in ("name", "dim", "addressOffset", "range")] if "File" in group.tag else []
        for field in register.findall("x:field", SPACE):
            kinds = ("bitOffset", "bitWidth", "access", "volatile", "modifiedWriteValue", "description")
            facts = [text(field, name) for name in (*kinds, "resets/reset/value")]
            own = [text(register, name) for name in ("addressOffset", "description")]
            found[(*above, text(register, "name"), text(field, "name"))] = own + facts
    return found


@pytest.mark.skipif(shutil.which("peakrdl") is None, reason="pip install peakrdl peakrdl-ipxact")
@pytest.mark.parametrize(("top", "block"), [("halpipe_regulator_windows", "windows"), ("halpipe_regulator", "unit0")])
def test_the_registers_are_those_that_peakrdl_reads_from_systemrdl(bundle, component, tmp_path, top, block):
    (tmp_path / "regulator.rdl").write_bytes(bundle["table/regulator.rdl"])
    command = ["peakrdl", "ip-xact", "regulator.rdl", "--top", top, "-o", "made.xml"]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=300)
    made = registers(etree.parse(tmp_path / "made.xml").getroot())
    (own,) = component.findall(f".//x:addressBlock[x:name='{block}']", SPACE)
    assert made == registers(own)


@pytest.mark.skipif(not SCHEMAS, reason="schemas of IEEE 1685-2014, not part of the project: HALPIPE_IPXACT=FOLDER")
def test_the_component_is_valid_by_the_schemas(component):
    etree.XMLSchema(etree.parse(Path(SCHEMAS, "index.xsd"))).assertValid(component)
