"""The back-ends: one file for each kind of regulator, all written from one table object."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.regulator.backends.axi_realm import AxiRealm
from halpipe.exporters.regulator.backends.memguard import MemGuard
from halpipe.exporters.regulator.backends.qos400 import Qos400
from halpipe.exporters.regulator.backends.resctrl import Resctrl
from halpipe.exporters.regulator.backends.table import TableUnit
from halpipe.exporters.regulator.codes import UNKNOWN_BACKEND

if TYPE_CHECKING:
    from halpipe.exporters.regulator.backends.base import Backend

REGISTER: dict[str, Backend] = {b.name: b for b in (TableUnit(), AxiRealm(), Qos400(), MemGuard(), Resctrl())}


def backend(name: str) -> Backend:
    """Return the back-end called `name`; raise `HalpipeError` if there is none."""
    if name not in REGISTER:
        help = did_you_mean(name, REGISTER, "the back-ends are " + ", ".join(REGISTER))
        raise HalpipeError(UNKNOWN_BACKEND(f'there is no back-end "{name}"', help=help))
    return REGISTER[name]
