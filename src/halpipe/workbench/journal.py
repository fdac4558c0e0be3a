"""Journal of unsaved edits beside the model, so that a killed server or a closed page loses none."""

from __future__ import annotations

import contextlib
import json
import os
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, error
from halpipe.core.durations import Duration
from halpipe.core.files import is_shaped, load_json, read_own, write_output
from halpipe.exporters.native import format_model
from halpipe.importers.native import parse_model
from halpipe.workbench.edits import Pin

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.models import TaskModel

FOREIGN_EDITS = error(
    "HAL0961",
    "Journal of edits does not fit the model",
    "The workbench keeps unsaved edits in a file beside the model, with the hash of the model that they change. A "
    "journal of another state of the model, or a damaged one, is neither used nor overwritten.",
)

EDITS_LOST = error(
    "HAL1541",
    "Edits of the workbench are lost",
    "The server has ended, and the folder of the model took no journal of the edits that are not saved. The page warns "
    "of that from the first such edit on.",
)

SUFFIX = ".edits"


class Journal:
    """File of the edits that the model's own file does not have; `fault` says why none can be written."""

    def __init__(self, path: str) -> None:
        self.path = f"{path}{SUFFIX}"
        self.fault = ""

    def read(self, base: str) -> tuple[TaskModel, tuple[Pin, ...]] | None:
        """Return the edited model and its pins, None without a journal.

        Raise `HalpipeError` where the journal is damaged, or changes another file than that with the hash `base`.
        """
        if not os.path.lexists(self.path):
            return None
        try:
            stated = load_json(read_own(self.path))
            is_journal = is_shaped(stated, {"base": str, "pins": list, "model": str})
            if not is_journal or any([*map(type, pin)] != [str, str, int, str, str] for pin in stated["pins"]):
                raise ValueError("other members than those of a journal")
            model = parse_model(stated["model"].encode(), self.path)
            pins = tuple(
                Pin(mode, task, index, Duration.parse(at), unit) for mode, task, index, at, unit in stated["pins"]
            )
            fault = "" if stated["base"] == base else "belongs to another state of the model"
        except (ValueError, TypeError, AttributeError, HalpipeError):
            fault = "is damaged"
        if fault:
            help = f"rename {os.path.basename(self.path)} to open the model without these edits"
            raise HalpipeError(FOREIGN_EDITS(f"{self.path} {fault}", path=self.path, help=help))
        return model, pins

    def write(self, base: str, model: TaskModel, pins: Sequence[Pin]) -> None:
        """Replace the journal; a folder that takes no file leaves `fault`, and the edits in memory only."""
        rows = [[pin.mode, pin.task, pin.index, str(pin.start), pin.unit] for pin in pins]
        stated = {"base": base, "pins": rows, "model": format_model(model).decode()}
        try:
            write_output(self.path, json.dumps(stated).encode())
            self.fault = ""
        except HalpipeError as refused:
            self.fault = refused.diagnostics[0].message

    def remove(self) -> None:
        """Remove the journal: the file of the model has everything."""
        self.fault = ""
        with contextlib.suppress(OSError):
            os.unlink(self.path)
