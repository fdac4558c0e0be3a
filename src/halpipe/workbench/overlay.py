"""The edits of a workbench as an overlay: what differs from the model that was opened, for its next import."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, about, error
from halpipe.models.attributes import attributes, texts
from halpipe.workbench.edits import TASK_FIELDS, VERSION_FIELDS

if TYPE_CHECKING:
    from collections.abc import Iterable

    from halpipe.models import Chain, Precedence, Task, TaskModel, Version

NOT_STATABLE = error(
    "HAL0960",
    "Overlay cannot state an edit",
    "An overlay states values in place of those of the source; it cannot take an offset away, so that the first "
    "release is free again. Accesses, the tasks of modes, and elements that were added or removed are not written. "
    "Save the model instead, or undo the edit.",
)

SUFFIXES = (".yaml", ".yml")
"""Files with these names are overlays."""

Plain = dict[str, Any]


def overlay_of(opened: TaskModel, shown: TaskModel) -> bytes:
    """Return the overlay that makes of `opened`, as its source is imported, what is `shown`.

    Raise `HalpipeError` for what overlays have no words for, such as elements that were added or removed.
    """
    import yaml

    for kind in ("units", "tasks", "chains"):
        before, after = ([each.name for each in getattr(model, kind)] for model in (opened, shown))
        if before != after:
            raise HalpipeError(NOT_STATABLE(f"{kind} were added or removed", help="save the model as .xml"))
    if opened.modes != shown.modes:
        help = "save the model as .xml, or state the modes in an overlay by hand"
        raise HalpipeError(NOT_STATABLE("the tasks of a mode were changed", help=help))
    tasks = {
        new.name: stated for old, new in zip(opened.tasks, shown.tasks, strict=True) if (stated := _task(old, new))
    }
    chains = [_chain(new) for old, new in zip(opened.chains, shown.chains, strict=True) if old != new]
    document: Plain = {"halpipe-overlay": 1}
    document |= {"tasks": tasks} if tasks else {}
    document |= {"chains": chains} if chains else {}
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True).encode()


def _task(old: Task, new: Task) -> Plain:
    stated = _changed(old, new, TASK_FIELDS)
    if new.deadline is None and old.deadline is not None:  # then it is what overlays and models take for granted
        stated["deadline"] = str(new.distance or new.period)
    if new.offset is None and old.offset is not None:
        help = "save the model as .xml, or state an offset"
        raise HalpipeError(NOT_STATABLE("the offset was taken away", path=about(task=new.name), help=help))
    pairs = zip(old.versions, new.versions, strict=True)
    versions = {after.name: own for before, after in pairs if (own := _version(before, after))}
    return stated | ({"versions": versions} if versions else {})


def _version(old: Version, new: Version) -> Plain:
    stated = _changed(old, new, VERSION_FIELDS)
    if old.units != new.units:
        stated["units"] = list(new.units)
    if old.accesses != new.accesses:
        help = "save the model as .xml, or state the accesses in an overlay by hand"
        raise HalpipeError(NOT_STATABLE(f'an access of version "{new.name}" was changed', help=help))
    if old.precedences != new.precedences:
        stated["precedence"] = [_window(each) for each in new.precedences]
    return stated


def _window(window: Precedence) -> Plain:
    renamed = {"task": "from", "from": "after", "to": "until"}
    return {renamed.get(name, name): text for name, text in texts(window).items()}


def _chain(chain: Chain) -> Plain:
    return texts(chain) | {"tasks": list(chain.tasks)}


def _changed(old: Task | Version, new: Task | Version, fields: Iterable[str]) -> Plain:
    """Return those of some attributes that have another value now, as overlays have them."""
    found = {}
    for one in attributes(type(new)):
        before, after = getattr(old, one.field), getattr(new, one.field)
        if one.field in fields and before != after and after is not None:
            found[one.name] = one.codec.text(after)
    return found
