"""Faults put into a bundle that has been built: words of the program changed, and the bundle sealed again."""

import json
from io import BytesIO
from pathlib import Path

from elftools.elf.elffile import ELFFile

from halpipe.core.bundles import open_bundle, seal
from halpipe.core.files import write_directory
from halpipe.deploy.base import Target

COPY, DONE, RUN, STOP = 1, 2, 3, 4
OPERATION = 48  # bytes; see hp_operation in the runtime's halpipe.h


class Program:
    """bundle.elf as bytes that can be changed by address."""

    def __init__(self, target):
        self.data = bytearray(target.bundle.files["bundle.elf"])
        elf = ELFFile(BytesIO(bytes(self.data)))
        self.parts = [
            (s["p_paddr"], s["p_filesz"], s["p_offset"]) for s in elf.iter_segments() if s["p_type"] == "PT_LOAD"
        ]
        self.symbols = {
            s.name: (s["st_value"], s["st_size"]) for s in elf.get_section_by_name(".symtab").iter_symbols()
        }

    def _offset(self, address):
        return next(o + address - a for a, n, o in self.parts if a <= address < a + n)

    def get(self, address, size=8):
        at = self._offset(address)
        return int.from_bytes(self.data[at : at + size], "little")

    def put(self, address, value, size=8):
        at = self._offset(address)
        self.data[at : at + size] = value.to_bytes(size, "little")

    def flat(self):
        """The program as it lies in main memory."""
        base = min(address for address, _, _ in self.parts)
        content = bytearray(max(address + size for address, size, _ in self.parts) - base)
        for address, size, offset in self.parts:
            content[address - base : address - base + size] = self.data[offset : offset + size]
        return bytes(content)

    def operations(self, kind):
        """The addresses of all operations of a kind, in the order of programs."""
        programs = sorted(name for name in self.symbols if name.startswith("program_"))
        found = []
        for name in programs:
            base, size = self.symbols[name]
            found += [at for at in range(base, base + size, OPERATION) if self.get(at + 36, 1) == kind]
        return found


def resealed(target, path, files):
    """Return the target with some files replaced, and a manifest that says so."""
    manifest = json.loads(Path(target.bundle.path, "manifest.json").read_bytes())
    facts = {key: value for key, value in manifest.items() if key not in ("halpipe-bundle", "kind", "files")}
    write_directory(str(path), seal("riscv", {**target.bundle.files, **files}, facts))
    return Target(bundle=open_bundle(str(path)), model=target.model, schedule=target.schedule)


def tampered(target, path, change):
    """Return the target with a changed program; `change` gets the `Program`."""
    program = Program(target)
    change(program)
    return resealed(target, path, {"bundle.elf": bytes(program.data), "bundle.bin": program.flat()})
