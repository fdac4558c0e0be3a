"""Base of all exporters: options, and the entry point they are registered through."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol

from halpipe.core.options import option
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.core.extent import Extent
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class ExportOptions:
    """Options of every format; a format with further ones has a subclass of this beside its exporter."""

    mode: str = option("", "This mode only; otherwise all.", metavar="NAME", completes="modes")

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others; stating one is refused."""
        return ()


@record(kw_only=True)
class TitledOptions(ExportOptions):
    """Options of a format that shows a title."""

    title: str = option("", "Title; otherwise the model's name.")


class Exporter(Protocol):
    """The door through which a target format goes out; registered as entry point ``halpipe.exporters``.

    An exporter decides nothing: it writes the schedule it is given, which the caller has verified. It is a pure
    function of its arguments, so the same schedule gives the same bytes. `suffix` is how its file names end, empty
    for a folder. `options` is the type of its options (`halpipe.core.options`). `shown` names the file of an export
    that the command line prints, too (empty: none). `help` is the sentence that the command line has for it.
    """

    name: str
    summary: str
    help: str
    extent: Extent
    suffix: str
    options: type[ExportOptions]
    shown: str

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the files to write by relative name; ``""`` is the main output, further files go beside it.

        Without ``""`` the files are a whole folder, sealed by `halpipe.core.bundles.seal`. Raise `HalpipeError` when
        `model` and `schedule` do not fit each other or `options` name what is not there.
        """
        ...

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return what the user should know of an export: what the target cannot do, what was rounded."""
        ...


class PlainExporter:
    """Base of most exporters."""

    help = ""
    options: type[ExportOptions] = ExportOptions
    shown = ""

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return nothing; see `Exporter`."""
        return ()
