"""Edits and pins: one statement about a model, and jobs that keep the place that a person gave them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.core.diagnostics import HalpipeError, error
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.models import Chain, Run, Task, TaskModel, Unit, Version

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.core.durations import Duration

T = TypeVar("T")

BAD_EDIT = error(
    "HAL0951",
    "Edit cannot be made",
    "An edit names an element of the model and one of its attributes, and gives a value that can stand there. The "
    "model stays as it was.",
)

TASK_FIELDS = ("period", "offset", "deadline", "slack", "binding")
VERSION_FIELDS = ("wcet", "units")
ROWS = {
    "window": (("min", "max"), "precedences", "task", "windows after task"),
    "access": (("start", "end", "bound"), "accesses", "resource", "accesses to"),
}
"""Attributes of the rows of a version, where the rows are, what they name, and the words for them."""
LIMITS = ("max_latency", "max_reaction", "max_age")
ATTRIBUTES = {"task": ("tasks", TASK_FIELDS), "chain": ("chains", ("tasks", *LIMITS))}
"""Where the elements of a kind are, and their attributes."""
OPTIONAL = ("offset", "deadline", *LIMITS)
"""Attributes that an empty text removes."""
NAMES = ("units", "tasks")
"""Attributes that are lists of names."""
ELEMENTS = ("task", "unit", "chain")
"""Elements that can be added and removed."""


@record
class Edit:
    """`kind` is task, version, window, access, chain or mode; `inner` is the name of a version.

    To add or remove an element, `kind` is add or remove, and `field` one of `ELEMENTS`; the value of one that is added
    is the period and WCET of a task, the type of a unit, or the tasks of a chain. Else the `name` is that of the task,
    chain or mode; a window is that of version `inner` after the task `after`, and an
    access is that of the version to the resource `after`.
    """

    kind: str
    name: str
    field: str
    value: str
    inner: str = ""
    after: str = ""

    @property
    def words(self) -> list[str]:
        """The value as names, between blanks or commas."""
        return self.value.replace(",", " ").split()

    @property
    def place(self) -> str:
        """The element in words, for messages and the history."""
        if self.kind in ("add", "remove"):
            return f'{self.kind} {self.field} "{self.name}"'
        version = f' version "{self.inner}"' if self.inner else ""
        kind = self.kind if self.kind in ("chain", "mode") else "task"
        return f'{kind} "{self.name}"{version} {self.field.replace("_", "-")}'


def edited(model: TaskModel, edit: Edit) -> TaskModel:
    """Return the model with the edit; raise `HalpipeError` that says what cannot stand there."""
    makers: dict[str, Callable[[TaskModel, Edit], TaskModel]] = {
        "task": _attribute,
        "version": _version,
        "window": _row,
        "access": _row,
        "chain": _attribute,
        "mode": _mode,
        "add": _added,
        "remove": _removed,
    }
    if edit.kind not in makers:
        raise _bad(edit, f'"{edit.kind}" is nothing that can be edited', f"it is one of {', '.join(makers)}")
    return makers[edit.kind](model, edit)


def _attribute(model: TaskModel, edit: Edit) -> TaskModel:
    """Return the model with an edited attribute of a task or chain."""
    rows, fields = ATTRIBUTES[edit.kind]
    _known(edit, edit.field, fields)
    elements = getattr(model, rows)
    element = _named(edit, elements, edit.name)
    for name in edit.words if edit.field == "tasks" else ():
        _named(edit, model.tasks, name)
    exchanged: Any = {rows: _exchanged(elements, element, _with(edit, element))}
    return replace(model, **exchanged)


def _version(model: TaskModel, edit: Edit) -> TaskModel:
    _known(edit, edit.field, VERSION_FIELDS)
    return _with_version(model, edit, lambda version: _with(edit, version))


def _with_version(model: TaskModel, edit: Edit, change: Callable[[Version], Version]) -> TaskModel:
    """Return the model with a change of the version that an edit names."""
    task = _named(edit, model.tasks, edit.name)
    version = _named(edit, task.versions, edit.inner)
    changed = replace(task, versions=_exchanged(task.versions, version, change(version)))
    return replace(model, tasks=_exchanged(model.tasks, task, changed))


def _row(model: TaskModel, edit: Edit) -> TaskModel:
    """Return the model with an edited window or access, of which the version has one that fits."""
    fields, rows, key, what = ROWS[edit.kind]
    _known(edit, edit.field, fields)

    def change(version: Version) -> Version:
        own = getattr(version, rows)
        found = [row for row in own if getattr(row, key) == edit.after]
        if len(found) != 1:
            help = "change the file" if found else "choose one of the model"
            raise _bad(edit, f'has {len(found) or "no"} {what} "{edit.after}"', help)
        exchanged: Any = {rows: _exchanged(own, found[0], _with(edit, found[0]))}
        return replace(version, **exchanged)

    return _with_version(model, edit, change)


def _mode(model: TaskModel, edit: Edit) -> TaskModel:
    """Return the model with other tasks in a mode; those that are new in it run in any of their versions."""
    _known(edit, edit.field, ("tasks",))
    mode = _named(edit, model.modes, edit.name)
    kept = {run.task: run for run in mode.runs}
    wanted = [_named(edit, model.tasks, name) for name in dict.fromkeys(edit.words)]
    if not wanted:
        raise _bad(edit, "has no task", "name the tasks that run in it")
    runs = [kept.get(t.name) or Run(task=t.name, versions=[v.name for v in t.versions]) for t in wanted]
    return replace(model, modes=_exchanged(model.modes, mode, replace(mode, runs=runs)))


def _with(edit: Edit, element: Any) -> Any:
    """Return the element with the new value, which its own type reads."""
    given: Any = tuple(edit.words) if edit.field in NAMES else edit.value.strip()
    if not given and edit.field in OPTIONAL:
        given = None
    return _made(edit, lambda: replace(element, **{edit.field: given}))


def _made(edit: Edit, make: Callable[[], T]) -> T:
    """Return what is made of an edit; raise `HalpipeError` where the value has not the form of its attribute."""
    try:
        return make()
    except (TypeError, ValueError) as wrong:
        message, _, help = str(wrong).partition("; ")
        raise _bad(edit, message.partition(": ")[2] or message, help or "correct the value") from None


def _added(model: TaskModel, edit: Edit) -> TaskModel:
    """Return the model with one more element; a task runs in every mode, and on every unit."""
    _known(edit, edit.field, ELEMENTS)
    if any(each.name == edit.name for each in getattr(model, f"{edit.field}s")):
        raise _bad(edit, "is there already", "choose another name")
    words = edit.words
    if edit.field == "unit":
        unit = _made(
            edit,
            lambda: Unit(name=edit.name, type=" ".join(words) or next((each.type for each in model.units), "core")),
        )
        return replace(model, units=(*model.units, unit))
    if edit.field == "chain":
        names = [_named(edit, model.tasks, name).name for name in words]
        return replace(model, chains=(*model.chains, _made(edit, lambda: Chain(name=edit.name, tasks=names))))
    if len(words) != 2:
        raise _bad(edit, "has no period and WCET", 'write both, such as "20ms 3ms"')
    version = _made(edit, lambda: Version(name="default", wcet=words[1], units=[unit.name for unit in model.units]))
    task = _made(edit, lambda: Task(name=edit.name, period=words[0], versions=[version]))
    run = Run(task=task.name, versions=[version.name])
    modes = tuple(replace(mode, runs=(*mode.runs, run)) for mode in model.modes)
    return replace(model, tasks=(*model.tasks, task), modes=modes)


def _removed(model: TaskModel, edit: Edit) -> TaskModel:
    """Return the model without an element; what else names it is for `validate` to report."""
    _known(edit, edit.field, ELEMENTS)
    kept = getattr(model, f"{edit.field}s")
    gone = _named(edit, kept, edit.name)
    rest: Any = {f"{edit.field}s": tuple(each for each in kept if each is not gone)}
    if edit.field == "task":
        runs = [tuple(run for run in mode.runs if run.task != gone.name) for mode in model.modes]
        rest["modes"] = tuple(replace(mode, runs=own) for mode, own in zip(model.modes, runs, strict=True))
    return replace(model, **rest)


def _exchanged(elements: tuple[Any, ...], old: Any, new: Any) -> tuple[Any, ...]:
    return tuple(new if element is old else element for element in elements)


def _known(edit: Edit, field: str, fields: Iterable[str]) -> None:
    if field not in fields:
        raise _bad(edit, f'has no "{field}" to edit', "it has: " + ", ".join(fields))


def _named(edit: Edit, elements: Iterable[Any], name: str) -> Any:
    known = {element.name: element for element in elements}
    if name not in known:
        raise _bad(edit, f'there is no "{name}"', did_you_mean(name, known, "choose one of the model"))
    return known[name]


def _bad(edit: Edit, message: str, help: str) -> HalpipeError:
    return HalpipeError(BAD_EDIT(message, path=edit.place, help=help))


@record
class Pin:
    """A job with its start and, where it was moved to another one, its unit."""

    mode: str
    task: str
    index: int
    start: Duration
    unit: str = ""
