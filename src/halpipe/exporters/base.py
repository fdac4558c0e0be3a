"""What every exporter shares: its options and the door it is registered through."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeVar

if TYPE_CHECKING:
    from halpipe.extent import Extent
    from halpipe.models import Schedule, TaskModel
    from halpipe.settings import Fields

O = TypeVar("O", bound="ExportOptions")  # noqa: E741


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportOptions:
    """What the user may choose of every format: a `title`, and one `mode` where all would be written (empty: all).

    A format with choices of its own has a subclass of this beside its exporter.
    """

    title: str = ""
    mode: str = ""


def specific(kind: type[O], options: ExportOptions) -> O:
    """Return `options` as the options of one format, with its defaults where only the common ones are given."""
    return options if isinstance(options, kind) else kind(title=options.title, mode=options.mode)


class Exporter(Protocol):
    """The door through which a target format goes out; registered as entry point ``halpipe.exporters``.

    An exporter decides nothing: it writes the schedule it is given, which the caller has verified. It is a pure
    function of its arguments, so the same schedule gives the same bytes. `keys` are the settings that a pipeline
    file may have for it besides those of every format; `suffix` is how its file names end, empty for a folder.
    """

    name: str
    summary: str
    extent: Extent
    needs_schedule: bool
    suffix: str
    keys: tuple[str, ...]

    def options(self, common: ExportOptions, fields: Fields, base: str) -> ExportOptions:
        """Return the options that a pipeline file states; paths in it are relative to the folder `base`."""
        ...

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the files to write by relative name; ``""`` is the main output, further files go beside it.

        Without ``""`` the files are a whole folder, sealed by `halpipe.bundles.seal`. Raise `HalpipeError` when
        `model` and `schedule` do not fit each other or `options` name what is not there.
        """
        ...


class PlainExporter:
    """What an exporter inherits that has no options of its own."""

    keys: tuple[str, ...] = ()

    def options(self, common: ExportOptions, fields: Fields, base: str) -> ExportOptions:
        """Return the options that every format has; see `Exporter`."""
        return common
