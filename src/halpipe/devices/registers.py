"""Registers of devices: descriptions with access kinds, from which exporters write and checks model a device.

A description states what the maker documents, with its sources; it says nothing about budgets.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

from halpipe.core.files import parse_yaml
from halpipe.core.records import record

WORD = 32


@record
class Register:
    """A word of a register file: its number among those of its name, its fields of `width` bits, from `shift` on."""

    name: str
    number: int
    offset: int
    access: str
    width: int
    fields: int = 1
    shift: int = 0

    @property
    def mask(self) -> int:
        """The bits that the register has."""
        return (1 << self.width * self.fields) - 1 << self.shift


class RegisterFile:
    """The registers of a device that is built for some managers and regions, by offset and by name."""

    def __init__(self, device: str, managers: int, regions: int) -> None:
        self.managers, self.regions = managers, regions
        counts, document = {"m": managers, "mr": managers * regions, "": 1}, _document(device)
        self.words: dict[int, Register] = {}
        self._first: dict[str, Register] = {}
        for found in document["registers"]:
            name, width = found["name"], int(found.get("width", WORD))
            left, number = counts[found.get("count", "")], 0
            while left > 0:
                fields = min(left, WORD // width)
                word = Register(name, number, 4 * len(self.words), found["access"], width, fields)
                self._first.setdefault(name, word)
                self.words[word.offset] = word
                left, number = left - fields, number + 1
        top = 2 << (4 * len(self.words) - 1).bit_length()
        self.claim = Register(document["claim"]["name"], 0, top - 4, document["claim"]["access"], 3)
        self.words[self.claim.offset] = self.claim

    def offset(self, name: str, field: int = 0) -> int:
        """Return the offset of the word with a field, which is a manager, or a region of one."""
        first = self._first[name]
        return first.offset + 4 * (field // (WORD // first.width))

    def words_of(self, name: str) -> list[Register]:
        """Return the words of a name in order."""
        return [word for word in self.words.values() if word.name == name]


def port_registers(device: str) -> tuple[dict[str, int], dict[str, Register]]:
    """Return the ports of a device with their bases, and by name the registers that each port has from its base on."""
    document, registers = _document(device), {}
    for found in document["registers"]:
        shift, width = map(int, found["field"])
        offset = int(found["offset"], 16)
        registers[found["name"]] = Register(found["name"], 0, offset, found["access"], width, shift=shift)
    return {name: int(base, 16) for name, base in document["ports"].items()}, registers


@cache
def _document(device: str) -> Any:
    name = f"{device}.yaml"
    return parse_yaml(resources.files(__package__).joinpath(name).read_bytes(), name)
