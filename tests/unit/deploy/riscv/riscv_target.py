"""A description of a target with two cores, as a bundle has it, for tests to spoil."""

import copy
import json

from halpipe.core.bundles import Bundle

TARGET = {
    "halpipe-target": 2,
    "profile": "vcu118",
    "clock": 100_000_000,
    "timebase": 1_000_000,
    "main": {"base": "0x80000000", "size": 1 << 20},
    "stack": 8192,
    "entry": "0x80000000",
    "clint": {"base": "0x2000000"},
    "uart": {"kind": "sifive", "base": "0x64000000"},
    "dma": {
        "kind": "pdma",
        "base": "0x3000000",
        "stride": 4096,
        "channels": 4,
        "bandwidth": 400_000_000,
        "setup": "2us",
    },
    "finisher": "",
    "decision": 2,
    "margin": 2,
    "service": "1500ns",
    "cpi": "1",
    "latency": "0ns",
    "qemu": [],
    "units": [
        {
            "name": f"core{n}",
            "hart": n,
            "ispm": {"base": hex(0x01800000 + 0x20000 * n), "size": 0x1E000},
            "dspm": {"base": hex(0x01000000 + 0x40000 * n), "size": 0x40000},
            "monitor": hex(0x01800000 + 0x20000 * n),
            "mailbox": hex(0x01000000 + 0x40000 * n + 0x3FF00),
            "reserved": hex(0x01000000 + 0x40000 * n + 0x3F000),
        }
        for n in (1, 2)
    ],
    "resources": [{"name": "memory", "channel": 0}],
    "control": "0x80010000",
    "trace": {"base": "0x80020000", "capacity": 64, "record": 48},
    "faults": {"base": "0x80030000", "capacity": 8, "record": 64},
    "tables": [{"name": "all", "mode": 0, "length": 10_000, "releases": 1, "lateness": "3us"}],
    "buffers": [{"name": "scan", "address": "0x80040000", "size": 64}],
    "images": [
        {
            "task": "a",
            "version": "v",
            "unit": "core1",
            "file": "images/0.elf",
            "entries": ["0x1821000"],
            "load": [{"source": "0x80050000", "target": "0x1821000", "size": 64}],
            "bss": {"base": "0x1042000", "size": 0},
            "symbols": {"scan": {"address": "0x1042000", "size": 64}},
        }
    ],
}


def target():
    """A copy to spoil."""
    return copy.deepcopy(TARGET)


def bundle(value):
    """A bundle with this target.json (a value, or the bytes of the file)."""
    data = value if isinstance(value, bytes) else json.dumps(value).encode()
    return Bundle("bundle", "riscv", {}, {"target.json": data})
