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


def tree_of(isa, clint, cores=1, uart=None):
    """Return the tree of cores without address translation, their CLINT, and a serial line where one is stated."""
    described = {"#address-cells": [1], "#size-cells": [0], "timebase-frequency": [10**7]}
    for hart in range(cores):
        interrupts = {"#interrupt-cells": [1], "interrupt-controller": [], "compatible": "riscv,cpu-intc"}
        core = {"device_type": "cpu", "reg": [hart], "status": "okay", "compatible": "riscv", "riscv,isa": isa}
        core |= {"riscv,pmpregions": [16], "riscv,pmpgranularity": [4]}
        described[f"cpu@{hart}"] = core | {"interrupt-controller": interrupts | {"phandle": [hart + 1]}}
    wired = [number for hart in range(cores) for number in (hart + 1, 3, hart + 1, 7)]
    timer = {"compatible": "riscv,clint0", "interrupts-extended": wired, "reg": [0, clint, 0, 0xC0000]}
    wide = {"#address-cells": [2], "#size-cells": [2]}
    soc = {**wide, "compatible": "simple-bus", "ranges": [], f"clint@{clint:x}": timer}
    if uart is not None:
        line = {"compatible": "ns16550a", "reg": [0, uart, 0, 0x100], "reg-shift": [0], "reg-io-width": [1]}
        soc[f"serial@{uart:x}"] = line | {"clock-frequency": [10**7], "interrupts": [1]}
        inputs = {"riscv,ndev": [31], "riscv,max-priority": [15], "reg": [0, 0xC000000, 0, 0x1000000]}
        soc["plic@c000000"] = {"compatible": "riscv,plic0", **inputs}
    return blob({**wide, "compatible": "bench", "model": "bench", "cpus": described, "soc": soc})
