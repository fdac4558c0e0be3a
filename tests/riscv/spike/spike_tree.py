"""A device tree for Spike as a blob: without one it needs the program dtc."""

import struct


def blob(nodes):
    """Return nested nodes as a flattened device tree; texts and lists of 32-bit numbers are properties."""
    names: dict[str, int] = {}
    body = b"".join(_node("", nodes, names)) + struct.pack(">I", 9)
    texts = b"".join(name.encode() + b"\0" for name in names)
    front = 56  # header, and an empty list of reserved memory
    sizes = (front + len(body) + len(texts), front, front + len(body), 40, 17, 16, 0, len(texts), len(body))
    return struct.pack(">10I", 0xD00DFEED, *sizes) + bytes(16) + body + texts


def _node(name, content, names):
    yield struct.pack(">I", 1) + _padded(name.encode() + b"\0")
    for key, value in content.items():
        if not isinstance(value, dict):
            raw = value.encode() + b"\0" if isinstance(value, str) else struct.pack(f">{len(value)}I", *value)
            place = names.setdefault(key, sum(len(other) + 1 for other in names))
            yield struct.pack(">III", 3, len(raw), place) + _padded(raw)
    for key, value in content.items():
        if isinstance(value, dict):
            yield from _node(key, value, names)
    yield struct.pack(">I", 2)


def _padded(raw):
    return raw + bytes(-len(raw) % 4)


def tree_of(isa, clint):
    """Return the tree of one core without address translation, and its CLINT."""
    interrupts = {"#interrupt-cells": [1], "interrupt-controller": [], "compatible": "riscv,cpu-intc", "phandle": [1]}
    core = {"device_type": "cpu", "reg": [0], "status": "okay", "compatible": "riscv", "riscv,isa": isa}
    core |= {"riscv,pmpregions": [16], "riscv,pmpgranularity": [4], "interrupt-controller": interrupts}
    timer = {"compatible": "riscv,clint0", "interrupts-extended": [1, 3, 1, 7], "reg": [0, clint, 0, 0xC0000]}
    wide = {"#address-cells": [2], "#size-cells": [2]}
    cores = {"#address-cells": [1], "#size-cells": [0], "timebase-frequency": [10**7], "cpu@0": core}
    soc = {**wide, "compatible": "simple-bus", "ranges": [], f"clint@{clint:x}": timer}
    return blob({**wide, "compatible": "bench", "model": "bench", "cpus": cores, "soc": soc})
