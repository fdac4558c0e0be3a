"""Registers of devices: descriptions with access kinds, from which exporters write and checks model a device.

A description states what the maker documents, with its sources; it says nothing about budgets.
"""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from halpipe.core.files import parse_yaml
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

WORD = 32


@record
class Register:
    """A word of a register file: its `name`, number among words of that name, fields of `width` bits, `access`."""

    name: str
    number: int
    offset: int
    access: str
    width: int
    fields: int

    @property
    def is_readable(self) -> bool:
        """Whether a read returns what the register holds."""
        return self.access != "wo"

    @property
    def is_writable(self) -> bool:
        """Whether a write changes the register."""
        return self.access != "ro"

    @property
    def mask(self) -> int:
        """The bits that the register has."""
        return (1 << self.width * self.fields) - 1


class RegisterFile:
    """The registers of a device that is built for some managers and regions, by offset and by name."""

    def __init__(self, device: str, managers: int, regions: int) -> None:
        counts = {"m": managers, "mr": managers * regions, "": 1}
        claim, registers = _description(device)
        self.words: dict[int, Register] = {}
        self._first: dict[str, Register] = {}
        for name, access, count, width in registers:
            left, number = counts[count], 0
            while left > 0:
                fields = min(left, WORD // width)
                word = Register(name, number, 4 * len(self.words), access, width, fields)
                self._first.setdefault(name, word)
                self.words[word.offset] = word
                left, number = left - fields, number + 1
        top = 2 << (4 * len(self.words) - 1).bit_length()
        self.claim = Register(*claim[:1], 0, top - 4, claim[1], 3, 1)
        self.words[self.claim.offset] = self.claim

    def offset(self, name: str, field: int = 0) -> int:
        """Return the offset of the word with a field, which is a manager, or a region of one."""
        first = self._first[name]
        return first.offset + 4 * (field // (WORD // first.width))

    def words_of(self, name: str) -> list[Register]:
        """Return the words of a name in order."""
        return [word for word in self.words.values() if word.name == name]


@record
class PortRegister:
    """A register that every port of a device has, at `offset` from its base; its field is `width` bits from `shift`."""

    name: str
    offset: int
    access: str
    shift: int
    width: int

    def encode(self, value: int) -> int:
        """Return the word that holds a value."""
        return value << self.shift

    def decode(self, word: int) -> int | None:
        """Return the value of a word; None if the word has bits that the register lacks."""
        value = word >> self.shift
        return value if self.encode(value) == word and 0 <= value < 1 << self.width else None


@record
class PortRegisters:
    """Ports of a device with their bases, and the registers that each has, by name."""

    ports: Mapping[str, int]
    registers: Mapping[str, PortRegister]


@cache
def port_registers(device: str) -> PortRegisters:
    """Return the description of a device whose ports have the same registers."""
    document = _document(device)
    registers = (
        PortRegister(r["name"], int(r["offset"], 16), r["access"], *map(int, r["field"])) for r in document["registers"]
    )
    ports = {name: int(base, 16) for name, base in document["ports"].items()}
    return PortRegisters(ports, {register.name: register for register in registers})


@cache
def _description(device: str) -> tuple[tuple[str, str], tuple[tuple[str, str, str, int], ...]]:
    document = _document(device)
    claim, registers = document["claim"], document["registers"]
    return (claim["name"], claim["access"]), tuple(
        (r["name"], r["access"], r.get("count", ""), int(r.get("width", WORD))) for r in registers
    )


def _document(device: str) -> Any:
    name = f"{device}.yaml"
    return parse_yaml(resources.files(__package__).joinpath(name).read_bytes(), name)
