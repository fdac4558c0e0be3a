"""Profiles from descriptions that hardware generators write: device trees of Rocket systems, csr.json of LiteX.

Neither has the times of the target. Those of ``rocket-rtl`` stand in their place, to be measured by `deploy calibrate`.
"""

from __future__ import annotations

import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import parse_json
from halpipe.exporters.riscv.codes import BAD_HARDWARE

if TYPE_CHECKING:
    from collections.abc import Sequence

SUFFIXES = (".dts", ".json")

_TOKEN = re.compile(
    r'(?:\w+:\s*)*(?P<node>[\w,.+-]+(?:@[\w,]+)?|/)\s*\{|(?P<key>[\w,.#+-]+)\s*(?:=\s*(?P<value>(?:"[^"]*"|[^;"{}])*))?;|\}'
)
_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
_LINE = 64
_CODE, _DATA = 0x1E000, 0x40000
_LITEX_ROOM = 32 << 20

_TEXT = """# Made from {file}. Times and bandwidths are assumptions: measure them with export riscv --calibrate.
halpipe-profile: 1
summary: made from {file}
cores: {cores}
clock: {clock}
timebase: {timebase}
main: {{base: {main[0]:#x}, size: {main[1]}B}}
ispm: {{base: {ispm[0]:#x}, stride: {ispm[1]:#x}, size: {ispm[2]}B}}
dspm: {{base: {dspm[0]:#x}, stride: {dspm[1]:#x}, size: {dspm[2]}B, lr-sc: "{reserves}"}}
service: {service}
cpi: {{jobs: 1, load: 2, load-byte: 3, {cycles}}}
clint: {clint:#x}
uart: {{kind: {uart[0]}, base: {uart[1]:#x}}}
dma: {dma}
"""
_COPY = "{kind: copy, channels: 4, bandwidth: 5MB/s, setup: 100us}"
_BIG = "management: 5, multiply: 8, multiply-word: 6, divide: 50, mispredicted: 4"
_SMALL = "management: 8, multiply: 66, multiply-word: 34, divide: 68, taken: 4"  # predicts nothing
_RATES = "bandwidth: {ispm: 55MB/s, dspm: 100MB/s, main: 150MB/s}, setup: 18us"


def profile_of(content: bytes, file: str) -> bytes:
    """Return the text of a profile; raise `HalpipeError` where the description lacks what a profile needs."""
    text = content.decode("utf-8", "replace")
    try:
        facts = _of_litex(parse_json(content)) if file.endswith(".json") else _of_tree(_nodes(text))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as failure:
        message = f"no profile can be made of it: {failure}"
        help = "name the .dts that Rocket's generator writes or the csr.json of LiteX, or write a profile in YAML"
        raise HalpipeError(BAD_HARDWARE(message, at=Location(file), help=help)) from None
    return _TEXT.format(file=file.rpartition("/")[2].encode("ascii", "replace").decode(), **facts).encode()


def _of_litex(described: Any) -> dict[str, Any]:
    """Return the facts of a LiteX system with Rocket: scratchpads lie in main memory, 32 MiB from its beginning."""
    constants, memories = described["constants"], described["memories"]
    cores, clock = int(constants["config_cpu_count"]) - 1, int(constants["config_clock_frequency"])
    base, size = (int(memories["main_ram"][key]) for key in ("base", "size"))
    if cores < 1 or size < _LITEX_ROOM + cores * (_CODE + _DATA):
        raise ValueError("it has one core only, or less main memory than the scratchpads of all cores need")
    return {
        "cores": cores,
        "clock": clock,
        "timebase": clock // 100,  # LitexConfig's real-time clock
        "main": (base, _LITEX_ROOM),
        "dspm": (base + _LITEX_ROOM, _DATA, _DATA),
        "ispm": (base + _LITEX_ROOM + cores * _DATA, _CODE, _CODE),
        "reserves": "yes",
        "service": "60us",
        "cycles": _SMALL,
        "clint": int(memories["clint"]["base"]),
        "uart": ("litex", int(described["csr_bases"]["uart"])),
        "dma": _COPY,
    }


_Node = dict[str, str]


def _nodes(text: str) -> list[_Node]:
    """Return the properties of every node of a device tree, in order."""
    found: list[_Node] = []
    inside: list[_Node] = []
    for token in _TOKEN.finditer(_COMMENT.sub(" ", text)):
        if token["node"]:
            inside.append({"compatible": ""})
            found.append(inside[-1])
        elif token["key"] and inside:
            inside[-1][token["key"]] = token["value"] or ""
        elif not token["key"]:
            inside.pop()
    return found


def _of_tree(nodes: Sequence[_Node]) -> dict[str, Any]:
    cores = [node for node in nodes if node.get("device_type", "").strip() == '"cpu"']
    data, code = _scratchpads(nodes, "sifive,dtim0"), _scratchpads(nodes, "sifive,itim0")
    if not data or len(data) != len(code) or len(data) >= len(cores):
        counts = f"{len(cores)} harts, {len(code)} ITIMs and {len(data)} DTIMs"
        raise ValueError(f"it has {counts}: each hart has both, but for hart 0")
    way = max(_number(core, "i-cache-sets") for core in cores) * _LINE  # of the ITIM, one stays a cache
    uart = _first(nodes, "compatible", r"sifive,uart|ns16550")
    kind = "ns16550x4" if _number(uart, "reg-shift") == 2 else "ns16550"
    kind = "sifive" if "sifive" in uart["compatible"] else kind
    engine = [node for node in nodes if "pdma" in node["compatible"]]
    return {
        "cores": len(data),
        "clock": max(_number(node, "clock-frequency") for node in nodes),
        "timebase": max(_number(node, "timebase-frequency") for node in nodes),
        "main": _area(_first(nodes, "device_type", '"memory"')),
        "ispm": (code[0][0], _stride(code), code[0][1] - way),
        "dspm": (data[0][0], _stride(data), data[0][1]),
        "reserves": "no",
        "service": "16us",
        "cycles": _BIG,
        "clint": _area(_first(nodes, "compatible", "clint"))[0],
        "uart": (kind, _area(uart)[0]),
        "dma": f"{{kind: pdma, base: {_area(engine[0])[0]:#x}, channels: 4, {_RATES}}}" if engine else _COPY,
    }


def _first(nodes: Sequence[_Node], key: str, pattern: str) -> _Node:
    for node in nodes:
        if re.search(pattern, node.get(key, "")):
            return node
    raise ValueError(f"it has no node with {key} {pattern}")


def _scratchpads(nodes: Sequence[_Node], kind: str) -> list[tuple[int, int]]:
    return sorted(_area(node) for node in nodes if kind in node["compatible"])


def _stride(areas: Sequence[tuple[int, int]]) -> int:
    strides = {later[0] - earlier[0] for earlier, later in pairwise(areas)} or {areas[0][1]}
    if len(strides) > 1 or len({size for _, size in areas}) > 1:
        raise ValueError("its scratchpads differ in size or distance")
    return strides.pop()


def _area(node: _Node) -> tuple[int, int]:
    cells = [int(cell, 0) for cell in re.findall(r"0x[0-9a-fA-F]+|\d+", node["reg"])]
    half = len(cells) // 2 if len(cells) in (2, 4) else 0
    if not half:
        raise ValueError(f"a region has {len(cells)} cells")
    base, size = (sum(cell << 32 * i for i, cell in enumerate(reversed(part))) for part in (cells[:half], cells[half:]))
    return base, size


def _number(node: _Node, key: str) -> int:
    return int(node[key].strip("<> \n\t"), 0) if key in node else 0
