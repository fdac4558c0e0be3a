"""Target description of a bundle: ``target.json``, which says where everything lies."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from halpipe.core.quantities import format_rational
from halpipe.exporters.riscv.cores import FAULT_RECORD, FAULT_RECORDS, TRACE_RECORD, TRACE_RECORDS, Core, MainMemory
from halpipe.exporters.riscv.phases import COPIES
from halpipe.exporters.riscv.render import DECISION, margin

if TYPE_CHECKING:
    from halpipe.exporters.riscv.bundle import Plan, Site
    from halpipe.exporters.riscv.copies import Copies
    from halpipe.exporters.riscv.images import Image
    from halpipe.exporters.riscv.operations import Table
    from halpipe.exporters.riscv.profile import Profile, Region, Watchdog

VERSION = 2


def target_json(site: Site, toolchain: str, plan: Plan) -> bytes:
    """Return the memory map, the clocks, and the place of everything; see docs/reference/riscv-bundle.md."""
    profile, memory, copies = site.profile, site.memory, site.copies
    resources = ((name, channel) for name, channel in site.channels.items() if name)
    return _json(
        {
            "halpipe-target": VERSION,
            "profile": profile.name,
            "toolchain": toolchain,
            **_board(profile),
            "stack": profile.stack,
            "entry": hex(memory.base),
            "units": [_unit(core) for core in site.cores.values()],
            "resources": [{"name": name, "channel": channel} for name, channel in resources],
            "control": hex(memory.control),
            "trace": {"base": hex(memory.trace), "capacity": TRACE_RECORDS, "record": TRACE_RECORD},
            "faults": {"base": hex(memory.faults), "capacity": FAULT_RECORDS, "record": FAULT_RECORD},
            "tables": [{**_table(t), "lateness": str(plan.backlog.tables[i])} for i, t in enumerate(plan.tables)],
            "buffers": [{"name": name, "address": hex(r.base), "size": r.size} for name, r in memory.buffers.items()],
            "images": [_image(image) for image in plan.images],
            **({"copies": _copies(copies, site.channels[COPIES], memory)} if copies.turns else {}),
        }
    )


def _copies(copies: Copies, channel: int, memory: MainMemory) -> dict[str, Any]:
    turns = [
        {
            "task": turn.task,
            "kind": str(turn.kind),
            "after": turn.after,
            "length": turn.length,
            "buffers": [
                {"name": name, "address": hex(region.base), "size": region.size}
                for (task, kind, name), region in memory.shadows.items()
                if (task, kind) == (turn.task, turn.kind)
            ],
        }
        for turn in copies.turns
    ]
    return {"channel": channel, "turns": turns}


def _board(profile: Profile) -> dict[str, Any]:
    dma = profile.dma
    return {
        "clock": profile.clock,
        "timebase": profile.timebase,
        "main": _region(profile.main),
        **({"scratchpad": _region(profile.scratchpad)} if profile.scratchpad else {}),
        **({"watchdog": _watchdog(profile.watchdog)} if profile.watchdog else {}),
        "clint": {"base": hex(profile.clint)},
        "uart": {"kind": profile.uart_kind, "base": hex(profile.uart)},
        "dma": {
            "kind": dma.kind,
            "base": hex(dma.base),
            "stride": dma.stride,
            "channels": dma.channels,
            "bandwidth": dma.into if len({*dma.into.values()}) > 1 else dma.bandwidth,
            "bus": dma.bus,
            "setup": str(dma.setup),
        },
        "service": str(profile.service),
        "cpi": _cpi(profile),
        "latency": str(profile.latency),
        "finisher": hex(profile.finisher) if profile.finisher else "",
        "qemu": list(profile.qemu),
        "decision": DECISION,
        "margin": margin(profile),
    }


def _cpi(profile: Profile) -> Any:
    each = {"jobs": profile.cpi, "management": profile.management_cpi} | profile.classes
    if len({*each.values()}) == 1:
        return format_rational(profile.cpi)
    return {name: format_rational(cycles) for name, cycles in each.items()}


def _unit(core: Core) -> dict[str, Any]:
    return {
        "name": core.unit,
        "hart": core.hart,
        "ispm": _region(core.ispm),
        "dspm": _region(core.dspm),
        "monitor": hex(core.ispm.base),
        "mailbox": hex(core.mailbox),
        "reserved": hex(core.job_end),
    }


def _watchdog(dog: Watchdog) -> dict[str, Any]:
    return {"address": hex(dog.address), "value": hex(dog.value), "timeout": str(dog.timeout)}


def _region(region: Region) -> dict[str, Any]:
    return {"base": hex(region.base), "size": region.size}


def _table(table: Table) -> dict[str, Any]:
    ends = {"mode": table.origin} if table.is_mode else {"from": table.origin, "to": table.target}
    return {"name": table.name, **ends, "length": table.length}


def _image(image: Image) -> dict[str, Any]:
    begin, size = image.bss
    return {
        "task": image.part.task,
        "version": image.part.version.name,
        "unit": image.core.unit,
        "file": image.file,
        "entries": [hex(entry) for entry in image.entries],
        "load": [{"source": hex(s.source), "target": hex(s.target), "size": s.size} for s in image.elf.segments],
        "bss": {"base": hex(begin), "size": size},
        "symbols": {
            name: {"address": hex(image.elf.symbols[name].address), "size": image.elf.symbols[name].size}
            for name in image.part.symbols
        },
    }


def _json(value: Any) -> bytes:
    return (json.dumps(value, indent=1, ensure_ascii=True) + "\n").encode()
