"""Base of all exporters: options, and the entry point they are registered through."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any

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


class Exporter(ABC):
    """Base of the exporters, which are registered as entry points ``halpipe.exporters``.

    An exporter decides nothing: it writes the schedule it is given, which the caller has verified. It is a pure
    function of its arguments, so the same schedule gives the same bytes. `suffix` is how its file names end, empty
    for a folder. `options` is the type of its options (`halpipe.core.options`), of which it gets a value. `shown`
    names the file of an export that the command line prints, too (empty: none). `help` is the sentence that the
    command line has for it.
    """

    name: str
    summary: str
    help = ""
    extent: Extent
    suffix: str
    options: type[ExportOptions] = ExportOptions
    shown = ""

    @abstractmethod
    def write(self, model: TaskModel, schedule: Schedule | None, options: Any) -> dict[str, bytes]:
        """Return the files to write by relative name; ``""`` is the main output, further files go beside it.

        Without ``""`` the files are a whole folder, sealed by `halpipe.core.bundles.seal`. Raise `HalpipeError` when
        `model` and `schedule` do not fit each other or `options` name what is not there.
        """

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: Any, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return what the user should know of an export: what the target cannot do, what was rounded."""
        return ()
