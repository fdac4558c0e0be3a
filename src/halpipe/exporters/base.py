"""What every exporter shares: its options and the door it is registered through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from halpipe.models import Schedule, TaskModel


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What the user may choose: a `title`, and one `mode` where all would be written (empty: all).

    `cluster` is for the graph only: one box per mode instead of one graph of all tasks.
    """

    title: str = ""
    mode: str = ""
    cluster: bool = False


class Exporter(Protocol):
    """The door through which a target format goes out; registered as entry point ``halpipe.exporters``.

    An exporter decides nothing: it writes the schedule it is given, which the caller has verified. It is a pure
    function of its arguments, so the same schedule gives the same bytes.
    """

    name: str
    summary: str
    needs_schedule: bool
    suffix: str

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the files to write by relative name; ``""`` is the main output.

        Raise `HalpipeError` when `model` and `schedule` do not fit each other or `options` name what is not there.
        """
        ...
