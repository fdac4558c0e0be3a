"""Writers of the devices, each from the folder of its device."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, cast

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.suggest import did_you_mean
from halpipe.devices import DEVICES
from halpipe.exporters.regulator.codes import UNKNOWN_BACKEND

if TYPE_CHECKING:
    from halpipe.exporters.regulator.writing import Backend


def backend(name: str) -> Backend:
    """Return the back-end called `name`; raise `HalpipeError` if there is none."""
    if name not in DEVICES:
        help = did_you_mean(name, DEVICES, "the back-ends are " + ", ".join(DEVICES))
        raise HalpipeError(UNKNOWN_BACKEND(f'there is no back-end "{name}"', help=help))
    module = import_module(f"{__package__}.{DEVICES[name].folder}.writer")
    return cast("Backend", module.WRITER)
