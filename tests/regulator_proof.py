"""Formal proof of the Verilog of a bundle, for all traffic and all time: k-induction by yosys and cvc5.

Each part of the regulator is proven on its own, in ``formal/*.sv``: the gate (a window never gets more than
its budget, or the one burst that was waiting; VALID is never withdrawn; a burst that fits passes), the player (windows
and tables in their order, from the tables and the requests alone), the unit (data never ahead of its address,
registers), the block around the units (windows as long as stated, orders to all in one cycle), the AXI4-Lite front,
and the DMA engine (ports that keep to AXI, and a buffer that never overflows).
The player is proven with tables of any content; with the exported images it is proven that these are tables.json.
What follows for the sums of all units is arithmetic: see `halpipe.deploy.regulator.arithmetic`.
"""

from __future__ import annotations

import re
import shutil
from dataclasses import field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.core.records import record
from halpipe.deploy.regulator.forms import header_lines, image_names

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from subprocess import CompletedProcess

    from halpipe.core.bundles import Bundle
    from halpipe.deploy.regulator.reading import Tables, Unit

FOLDER = Path(__file__).parent / "rtl" / "formal"
SECONDS = 6000
"""Of the clock, for each step: far more than any needs, also on a machine that does much else meanwhile."""

TOOLS = ("yosys", "yosys-abc", "yosys-smtbmc", "cvc5")

_UNIT_PORTS = (
    "m_arvalid", "m_arready", "m_awvalid", "m_awready", "m_wvalid", "m_wready",
)  # fmt: skip
_PLAYER_PORTS = (
    "tick", "go", "req_valid", "req_table", "entry_write", "header_write", "def_rd", "def_wr", "next_rd", "next_wr",
    "running", "pending", "pending_table",
)  # fmt: skip


@record
class Part:
    """A part to be proven: its Verilog, the wires of the properties with what they stand for inside, and the depth."""

    name: str
    sources: tuple[str, ...]
    wires: Mapping[str, tuple[str, ...]]
    depth: int
    fills: Mapping[str, str] = field(default_factory=dict)
    """What stands in its properties between @."""

    images: Mapping[str, str] = field(default_factory=dict)
    """Memory images that it reads, by the names that it knows them by: files of the bundle."""

    of: str = ""
    """The unit whose images they are."""

    searched: bool = False
    """Whether ABC searches for the invariant (property directed reachability) instead of k-induction."""

    memories: tuple[str, ...] = ()
    """Memories of the properties that stand for those of the same name inside: arrays of any content, at full size."""


def _gate(prefix: str, instance: str) -> dict[str, tuple[str, ...]]:
    ports = {
        "refill": "refill",
        "budget": "budget",
        "room": "room",
        "valid": "valid_i",
        "bytes": "bytes",
        "left": "left",
    }
    return {f"{prefix}_{name}": (f"dut.{instance}.{port}",) for name, port in ports.items()}


def _units(units: int) -> dict[str, tuple[str, ...]]:
    """Return the wires of the properties for the ports of so many units, the last one first."""
    names = {
        "u_tick": "tick",
        "u_go": "all_go",
        "u_req_valid": "all_req_valid",
        "u_req_table": "all_req_table",
        "u_holds": "holds",
        "u_foreign": "foreign",
        "u_refused": "refused",
        "u_running": "running",
        "u_upper": "plays_upper",
        "u_longest": "longest",
        "u_ar_long": "ar_long",
        "u_aw_long": "aw_long",
        "u_write": "reg_write",
        "u_addr": "reg_addr",
        "u_wdata": "reg_wdata",
        "u_rdata": "reg_rdata",
        **{f"u_{n}": f"s_{n}" for n in ("arvalid", "arready", "awvalid", "awready", "wvalid", "wready", "wlast")},
        **{f"u_{n}": n for n in (*_UNIT_PORTS, "arlen", "awlen")},
    }
    each = range(units - 1, -1, -1)
    return {name: tuple(f"dut.unit[{n}].regulator.{port}" for n in each) for name, port in names.items()}


_AXIL = "halpipe_regulator_axil.v"
_ANSWERS = ("writes", "reads", "drops", "denies", "fails")
_TURNS = ("valid", "left", "id", "first", "end")
_DMA = ("halpipe_dma_channel.v", "halpipe_dma.v")
_ALL = ("halpipe_regulator_gate.v", "halpipe_regulator_player.v", "halpipe_regulator_unit.v", "halpipe_regulator.v")
PARTS = (
    Part("gate", _ALL[:1], {}, 2),
    Part(
        "player",
        _ALL[1:2],
        {
            "is_calm": ("dut.calm",),
            "place": ("dut.entry_now",),
            "length": ("dut.windows",),
            "follower": ("dut.successor",),
            "rd_now": ("dut.rd_now",),
            "wr_now": ("dut.wr_now",),
        },
        2,
        memories=("entries", "headers"),
    ),
    Part(
        "unit",
        _ALL[:3],
        {
            **{f"p_{port}": (f"dut.player.{port}",) for port in _PLAYER_PORTS},
            "p_index": ("dut.player.write_index",),
            "p_data": ("dut.player.write_data",),
            "p_table": ("dut.player.table_now",),
            "p_entry_table": ("dut.player.entry_table",),
            "p_window": ("dut.player.window_now",),
            **_gate("r", "read"),
            **_gate("w", "write"),
            "w_admit": ("dut.write.admit",),
            **{name: (f"dut.{name}",) for name in ("owed", "go_here", "held_rd", "held_wr", "long_rd", "long_wr")},
            **{name: (f"dut.{name}",) for name in ("rd_bytes", "wr_bytes", "rd_waits", "wr_waits")},
        },
        2,
    ),
    Part(
        "frame",
        _ALL[3:],
        {
            "counter": ("dut.cycle",),
            "length": ("dut.cycles",),
            "rest": ("dut.rest",),
            "extra": ("dut.extra",),
            "of": ("dut.of",),
            "number": ("dut.window",),
            "go": ("dut.go",),
            "armed": ("dut.armed",),
            "start": ("dut.start",),
            "locked": ("dut.locked",),
            "holder": ("dut.holder",),
        },
        2,
    ),
    Part("axil", (_AXIL,), {}, 2),
    Part("ports", (_AXIL, "halpipe_regulator_ports.v"), {"turn": ("dut.turn",)}, 2),
    Part(
        "dma_channel",
        _DMA[:1],
        {
            name: (f"dut.{name}",)
            for name in (
                "running",
                "shift",
                "skips",
                "fill",
                "flush",
                "from",
                "to",
                "to_read",
                "to_write",
                "due",
                "unanswered",
                "room",
                "in_flight",
                "filled",
                "read_burst",
                "write_burst",
                "head",
                "tail",
            )
        },
        2,
        searched=True,
    ),
    Part(
        "dma",
        _DMA,
        {f"{turn}_{name}": (f"dut.{turn}_{name}",) for turn in ("now", "next") for name in _TURNS}
        | {f"{d}_bursts": tuple(f"dut.channel[{n}].copies.{d}_burst" for n in (1, 0)) for d in ("read", "write")},
        2,
    ),
    Part("slice", ("halpipe_regulator_slice.v",), {"spare": ("dut.spare",), "kept": ("dut.kept",)}, 2),
    Part(
        "store",
        ("halpipe_regulator_store.v",),
        {name: (f"dut.{name}",) for name in ("head", "tail", "whole", "held", "huge")},
        2,
        memories=("beats",),
    ),
    Part(
        "refusal",
        ("halpipe_regulator_refusal.v",),
        {name: (f"dut.{name}",) for name in ("writes", "reads", "drops", "denies", "fails", "beats", "wid", "rid")},
        2,
    ),
    Part(
        "axi4",
        (*_ALL, _AXIL, *(f"halpipe_regulator_{name}.v" for name in ("ports", "slice", "store", "refusal", "axi4"))),
        {name: tuple(f"dut.manager[{n}].buffered.store.{name}" for n in (1, 0)) for name in ("head", "tail", "whole")}
        | {name: tuple(f"dut.manager[{n}].refusal.{name}" for n in (1, 0)) for name in _ANSWERS},
        2,
    ),
)


MOST_UNITS = 8
"""That are proven to be wired as one block; a block of more is proven with so many of them."""


def image_part(tables: Tables, unit: Unit) -> Part:
    """Return the proof that a unit's player plays, from its images, what tables.json says."""
    entries: list[str] = []
    heads: list[str] = []
    for table in tables.tables:
        own = table.entries[unit.name]
        for entry, end in zip(own, [*(e.window for e in own[1:]), table.windows], strict=True):
            words = f"32'd{entry.window}, 32'd{end}, 32'd{entry.read}, 32'd{entry.write}"
            entries.append(f"    24'd{len(entries)}: entry = {{8'd{table.index}, {words}}};")
        heads.append(f"    8'd{table.index}: head = {{8'd{table.successor}, 32'd{table.windows}}};")
    fills = {
        "depth": str(1 << len(entries).bit_length()),
        "tables": str(header_lines(tables)),
        "entries": "\n".join(entries),
        "heads": "\n".join(heads),
    }
    wires = {"place": "entry_now", "length": "windows", "follower": "successor", "rd_now": "rd_now", "wr_now": "wr_now"}
    inside = {wire: (f"dut.{name}",) for wire, name in wires.items()}
    images = dict(zip(("tab.memh", "hdr.memh"), image_names(unit), strict=True))
    return Part("image", _ALL[1:2], inside, 2, fills, images, unit.name)


class ProofError(Exception):
    """The Verilog lacks what a property names, or a tool did not end."""


@record
class Proof:
    """The properties of a part and those that fail, each with the reason."""

    part: str
    properties: int
    findings: tuple[str, ...]


def missing() -> str:
    """Return which tools are missing, empty if none is."""
    return ", ".join(tool for tool in TOOLS if shutil.which(tool) is None)


def prove(bundle: Bundle, tables: Tables, *names: str) -> Iterator[Proof]:
    """Yield the proof of every part of the bundle's Verilog and of its images, or of those that are named."""
    depth = min(max(tables.platform.table_depth, 2), 1 << 16)  # an index has 16 bits
    sizes = {"depth": str(1 << (depth - 1).bit_length()), "tables": str(header_lines(tables))}
    units = min(len(tables.units), MOST_UNITS)
    wired = {"frame": {"units": str(units)}, "player": sizes, "axi4": {"stage": "1"}}
    sized = (
        replace(
            part,
            fills=wired.get(part.name, {}),
            wires={**part.wires, **(_units(units) if part.name == "frame" else {})},
        )
        for part in PARTS
    )
    for part in (*sized, *(image_part(tables, unit) for unit in tables.units)):
        if names and part.name not in names:
            continue
        with scratch_folder() as folder:
            yield _prove(bundle, part, Path(folder))


def _prove(bundle: Bundle, part: Part, folder: Path) -> Proof:
    text = FOLDER.joinpath(f"{part.name}.sv").read_text("utf-8")
    for name, value in part.fills.items():
        text = text.replace(f"@{name}@", value)
    (folder / "properties.sv").write_text(text)
    for name, file in part.images.items():
        (folder / name).write_bytes(bundle.files.get(file, b""))
    for source in part.sources:
        kind = "dma" if source in _DMA else "rtl"
        (folder / source).write_bytes(bundle.files.get(f"table/{kind}/{source}", b""))
    (folder / "part.ys").write_text("\n".join(_script(part)) + "\n")
    done = _run(["yosys", "-q", "part.ys"], folder)
    if done.returncode:
        said = [line for line in (done.stdout + done.stderr).splitlines() if "ERROR" in line] or ["no message"]
        raise ProofError(f"yosys: {said[0][:300]}")
    found: dict[str, str] = {}
    if not part.searched or not _is_found(folder):  # a search needs no base of its own
        found = dict.fromkeys(_solve(folder, ["-t", str(part.depth + 1)]), "is broken")
        if not found:
            unproven = ["(undecided)"] if part.searched else _solve(folder, ["-i", "-t", str(part.depth)])
            found = dict.fromkeys(unproven, "cannot be shown")
    findings = tuple(f'{_title(part)}: property "{name}" {why} for some traffic' for name, why in found.items())
    properties = len(re.findall(r"\bassert \(", text))
    return Proof(_title(part), properties, findings)


def _title(part: Part) -> str:
    return f"{part.name} of {part.of}" if part.of else part.name


def _script(part: Part) -> Iterator[str]:
    """Yield the commands that make the problem: parts flattened, memories as registers, wires joined to the insides."""
    yield f"read_verilog -formal -sv {' '.join(part.sources)} properties.sv"
    if part.memories:
        yield from (f"hierarchy -top formal_{part.name}", "proc", "flatten", f"cd formal_{part.name}")
        yield "delete t:$meminit*"
        for name in part.memories:
            yield f'setparam -set MEMID "\\dut.{name}" t:$memrd* r:MEMID=*{name} %i'
            yield f"delete m:{name}"
        yield from ("opt_expr", "opt_clean", "opt_merge", "memory_collect")
    else:
        yield f"prep -top formal_{part.name} -flatten -nordff"
        yield from ("opt_mem", "memory_map", f"cd formal_{part.name}")
    for wire, inside in part.wires.items():
        for n, name in enumerate(inside):
            yield f"rename {name} {wire}__{n}"
        yield f"connect -set {wire} {','.join(f'{wire}__{n}' for n in range(len(inside)))}"
    yield from ("opt_clean", "async2sync", "dffunmap", "opt_clean", "write_smt2 -wires part.smt2")
    if part.searched:
        yield from (
            "opt -full",
            "techmap",
            "dfflegalize -cell $_DFF_P_ 01",
            "opt_clean",
            "abc -g AND -fast",
            "opt_clean",
        )
        yield "write_aiger -zinit part.aig"


def _solve(folder: Path, mode: list[str]) -> list[str]:
    """Return the properties that fail; all that is not decided fails as a whole."""
    done = _run(["yosys-smtbmc", "-s", "cvc5", "--noprogress", *mode, "part.smt2"], folder)
    said = done.stdout + done.stderr
    if done.returncode == 0 and "Status: PASSED" in said:
        return []
    return list(dict.fromkeys(re.findall(r"Assert failed in \w+: (\w+)", said))) or ["(undecided)"]


def _is_found(folder: Path) -> bool:
    """Search for an invariant that proves all properties; return whether there is one."""
    done = _run(["yosys-abc", "-c", f"read_aiger part.aig; fold; pdr -T {SECONDS}"], folder)
    return "Property proved." in done.stdout


def _run(command: list[str], folder: Path) -> CompletedProcess[str]:
    try:
        return run(command, folder, seconds=SECONDS)
    except TimeoutExpired:
        raise ProofError(f"{command[0]} took more than {SECONDS} s") from None
