"""Reader of overlay files: YAML to entries, one function per section, all problems of all files collected."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar, cast

from halpipe.core.diagnostics import Findings, HalpipeError, Location, about
from halpipe.core.durations import Duration
from halpipe.core.files import YamlMap, parse_yaml, read_bytes, refuse_more_than
from halpipe.core.options import positive_duration
from halpipe.core.settings import BAD_VALUE, Fields, Stated
from halpipe.importers.common.stated import complete_attributes, is_glob, keys_of, stated_attributes, word
from halpipe.importers.common.stated import name as name_text
from halpipe.importers.overlay.codes import DUPLICATE, NOT_AN_OVERLAY
from halpipe.importers.overlay.entries import (
    MAX_GLOBS,
    InterruptEntry,
    ModeEntry,
    Overlay,
    TaskEntry,
    VersionEntry,
    merge,
)
from halpipe.models import (
    Access,
    Chain,
    HealthRule,
    Interrupt,
    Mode,
    Origin,
    Precedence,
    Resource,
    Source,
    Split,
    Task,
    Transfer,
    Transition,
    Unit,
    Version,
)
from halpipe.models.attributes import attributes

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence


def pattern(text: str) -> str:
    """Read a name or a glob of names."""
    if not text:
        raise ValueError("the pattern is empty; write a name or a glob such as /sensing/*")
    return text


def splitting(text: str) -> Duration | str:
    """Read a split point, or where else jobs may be split: ``anywhere`` or ``none``."""
    return text if text in ("anywhere", "none") else positive_duration(text)


T = TypeVar("T")
E = TypeVar("E", Unit, Resource)

FORMAT = "halpipe-overlay"
FORMAT_VERSION = "1"

_TOP = (FORMAT, "platform", "sources", "tasks", "precedence", "modes", "transitions", "chains", "health", "drop")
_PLATFORM = ("units", "resources", "interrupts")


_INTERRUPT = keys_of(Interrupt)
_VERSION = (*keys_of(Version, "name"), "split", *keys_of(Split), "access", "precedence", "source")
_TASK = (*keys_of(Task, "name"), "drop", *_VERSION, "versions")
_ACCESS = (*keys_of(Access), "transfers")
_RENAMED = {"task": "from", "anchor": "after", "to": "until"}
_WINDOW = {one.field: _RENAMED.get(one.field, one.name) for one in attributes(Precedence)}
"""The keys of a precedence constraint by the fields that they are."""


def read_overlays(paths: Sequence[str]) -> Overlay:
    """Read overlay files, of which later ones win; raise `HalpipeError` with every problem of every file."""
    findings = Findings()
    overlays = [_read_file(path, findings) for path in paths]
    findings.stop_on_errors()
    merged = merge(overlays)
    globs = [stated for stated in _patterns(merged) if is_glob(stated.value)]
    if globs:
        refuse_more_than(MAX_GLOBS, len(globs), "patterns with * ? or [", globs[min(MAX_GLOBS, len(globs) - 1)].at)
    return merged


def _patterns(overlay: Overlay) -> Iterator[Stated[str]]:
    """Yield whatever may be a glob, with its place."""
    yield from (stated for stated, _ in overlay.sources)
    yield from overlay.drops
    for entry in overlay.tasks:
        yield Stated(entry.pattern, entry.at)
        for version in (entry.common, *(stated.value for stated in entry.versions.values())):
            units = version.stated.get("units")
            if units is not None:
                yield from (Stated(unit, units.at) for unit in units.value)
    for mode in overlay.modes.values():
        yield from mode.tasks
        yield from (pattern for pattern, _ in mode.versions)


def _read_file(path: str, findings: Findings) -> Overlay:
    try:
        document = parse_yaml(read_bytes(path), path)
    except HalpipeError as failure:
        findings.extend(failure.diagnostics)
        return Overlay()
    problem = _not_an_overlay(document)
    if problem:
        help = f'start the file with "{FORMAT}: {FORMAT_VERSION}"'
        if isinstance(document, YamlMap) and "halpipe-pipeline" in document:
            help = "this is a pipeline: `halpipe run FILE`"
        elif not isinstance(document, YamlMap):
            help = f"name a YAML file after --overlay, and the source before it; {help}"
        line = getattr(document, "line", 0)
        findings.add(NOT_AN_OVERLAY(problem, at=Location(path, line), help=help))
        return Overlay()
    return _overlay(Fields(path, findings, document, "overlay", _TOP, inside={"platform": _PLATFORM}))


def _not_an_overlay(document: Any) -> str:
    if not isinstance(document, YamlMap):
        return "the file is not a mapping"
    if FORMAT not in document:
        return f'the key "{FORMAT}" is missing'
    if document[FORMAT] != FORMAT_VERSION:
        return f'"{FORMAT}" is not {FORMAT_VERSION}, the version of the format that this release reads'
    return ""


def _overlay(top: Fields) -> Overlay:
    platform = top.section("platform", _PLATFORM, "platform")
    return Overlay(
        units=_listed(platform, "units", (*keys_of(Unit), "interrupts"), _unit),
        resources=_listed(platform, "resources", keys_of(Resource), _resource),
        interrupts=tuple(_interrupts(platform)) if platform is not None else (),
        sources=tuple(_sources(top)),
        tasks=tuple(_task(pattern, f, at) for pattern, f, at in top.entries("tasks", _TASK, "task")),
        precedence=_constraints(top),
        modes={
            name: _mode(name, f, at)
            for name, f, at in top.entries("modes", ("tasks", "versions", *keys_of(Mode, "name")), "mode")
        },
        transitions=_transitions(top),
        chains=_chains(top),
        health=tuple(_rules(top)),
        drops=top.texts("drop", pattern),
    )


def _origin(f: Fields, path: str) -> Origin:
    return Origin(f.at().file, f.at().line, str(path))


def _made(f: Fields, kind: type[T], path_of: Callable[[dict[str, Any]], str]) -> T | None:
    """Return the element of a kind that a mapping states; None where it is not complete."""
    stated, make = complete_attributes(f, kind), cast("Callable[..., T]", kind)
    return None if stated is None else make(**stated, origin=_origin(f, path_of(stated)), at=f.at())


# -------------------------------------------------------------------------------------- platform and sources


def _listed(
    platform: Fields | None, key: str, keys: tuple[str, ...], read: Callable[[Fields], E | None]
) -> Stated[tuple[E, ...]] | None:
    if platform is None or key not in platform:
        return None
    path = f"platform {key[:-1]}"
    found: dict[str, E] = {}
    for f in platform.items(key, keys, path):
        element = read(f) if f.require("name") else None
        if element is not None:
            _keep_once(found, element.name, element, f, f'{path} "{element.name}"')
    return Stated(tuple(found.values()), platform.at(key))


def _keep_once(found: dict[Any, T], key: Any, element: T, f: Fields, what: str) -> None:
    """Add an element under its name; report the second one of the same name."""
    if key in found:
        f.complain(DUPLICATE, f"{what} is stated twice", help="remove one of them")
    found[key] = element


def _unit(f: Fields) -> Unit | None:
    stated = stated_attributes(f, Unit)
    path = about("platform", unit=stated["name"].value) if "name" in stated else f.path
    served: dict[str, Interrupt] = {}
    for inner in f.items("interrupts", _INTERRUPT, f"{path} interrupt"):
        interrupt = _interrupt(inner)
        if interrupt is not None:
            _keep_once(served, interrupt.name, interrupt, inner, about(path, interrupt=interrupt.name))
    if "name" not in stated:
        return None
    own = {field: one.value for field, one in stated.items()}
    return Unit(**own, interrupts=tuple(served.values()), origin=_origin(f, path), at=f.at())


def _interrupt(f: Fields) -> Interrupt | None:
    return _made(f, Interrupt, lambda stated: about(interrupt=stated["name"]))


def _interrupts(platform: Fields) -> Iterable[InterruptEntry]:
    """Read interrupts that are stated apart from the list of units, each with the units that serve it."""
    for f in platform.items("interrupts", ("units", *_INTERRUPT), "platform interrupt"):
        units, interrupt = f.texts_of("units", pattern), _interrupt(f)
        if f.require("units") and units is not None and interrupt is not None:
            yield InterruptEntry(units=units, interrupt=interrupt)


def _resource(f: Fields) -> Resource | None:
    return _made(f, Resource, lambda stated: about("platform", resource=stated["name"]))


def _sources(top: Fields) -> Iterable[tuple[Stated[str], Duration]]:
    for pattern, f, at in top.entries("sources", ("period",), "source"):
        period = f.get("period", positive_duration) if f.require("period") else None
        if period is not None:
            yield Stated(pattern, at), period.value


# ------------------------------------------------------------------------------------------- tasks, versions


def _task(pattern: str, f: Fields, at: Location) -> TaskEntry:
    path = f'task "{pattern}" version'
    versions = {
        name: Stated(_version(v), v_at)
        for name, v, v_at in f.entries("versions", _VERSION, path)
        if _is_name(name, f, v_at)
    }
    return TaskEntry(
        pattern=pattern,
        at=at,
        stated=stated_attributes(f, Task, "name"),
        drop=f.flag("drop"),
        common=_version(f),
        versions=versions,
    )


def _is_name(text: str, f: Fields, at: Location) -> bool:
    try:
        name_text(text)
    except ValueError as failure:
        message, _, help = str(failure).partition("; ")
        f.complain(BAD_VALUE, message, line=at.line, help=help)
        return False
    return True


def _split(f: Fields) -> Stated[Split] | None:
    """Read ``split: [4ms, 9ms]``, ``split: anywhere`` or ``split: none``."""
    stated = f.texts_of("split", splitting)
    if stated is None:
        return None
    points = tuple(point for point in stated.value if isinstance(point, Duration))
    if len(points) < len(stated.value) != 1:
        help = "write a list of split points in ascending order, anywhere, or none"
        f.complain(BAD_VALUE, '"split" mixes split points with a word', "split", help=help)
    if any(later <= point for point, later in pairwise(points)):
        help = f"write [{', '.join(map(str, sorted(set(points))))}]"
        f.complain(BAD_VALUE, '"split" lists points that do not ascend', "split", help=help)
    return Stated(Split(points=points, anywhere=stated.value == ("anywhere",)), stated.at)


def _version(f: Fields) -> VersionEntry:
    """Read what a version states; a task's entry may state the same for all its versions."""
    accesses = tuple(_access(a) for a in f.items("access", _ACCESS, f"{f.path} access"))
    windows = tuple(_window(w) for w in f.items("precedence", tuple(_WINDOW.values()), f"{f.path} precedence"))
    return VersionEntry(
        stated={**stated_attributes(f, Version, "name", units=pattern), **stated_attributes(f, Split)},
        split=_split(f),
        accesses=Stated(tuple(a for a in accesses if a), f.at("access")) if "access" in f else None,
        precedences=Stated(tuple(w for w in windows if w), f.at("precedence")) if "precedence" in f else None,
        source=_source(f),
    )


def _access(f: Fields) -> Access | None:
    transfers = tuple(_transfer(t) for t in f.items("transfers", keys_of(Transfer), f"{f.path} transfer"))
    found = complete_attributes(f, Access)
    if found is None:
        return None
    if found["start"] >= found["end"]:
        help = "an access phase must end after it starts"
        f.complain(BAD_VALUE, f"access from {found['start']} to {found['end']} is empty", "end", help=help)
    return Access(**found, transfers=tuple(t for t in transfers if t), at=f.at())


def _transfer(f: Fields) -> Transfer | None:
    found = complete_attributes(f, Transfer)
    return None if found is None else Transfer(**found, at=f.at())


def _source(f: Fields) -> Stated[Source] | None:
    inner = f.section("source", ("files", "entry", "defines"), f"{f.path} source")
    if inner is None:
        return None
    files, entry = inner.texts_of("files", word), inner.get("entry", word)
    defines = tuple(d.value for d in inner.texts("defines", word))
    if not inner.require("files", "entry") or files is None or entry is None:
        return None
    return Stated(Source(files=files.value, entry=entry.value, defines=defines, at=inner.at()), f.at("source"))


# ----------------------------------------------------------------------------------------------- constraints


def _window(f: Fields) -> Precedence | None:
    """Read ``{from: task, after: start, until: end, min: 0ms, max: 2ms}``: two instants and the time between them."""
    found = complete_attributes(f, Precedence, _WINDOW)
    if found is None:
        return None
    window = Precedence(**found, origin=_origin(f, f.path), at=f.at())
    if window.min > window.max:
        help = "max must not be below min"
        f.complain(BAD_VALUE, f"window from {window.min} to {window.max} is empty", "max", help=help)
    return window


def _constraints(top: Fields) -> dict[tuple[str, str], tuple[Precedence, ...]]:
    found: dict[tuple[str, str], tuple[Precedence, ...]] = {}
    for f in top.items("precedence", ("to", *_WINDOW.values()), "precedence"):
        window, to = _window(f), f.get("to", name_text)
        if not f.require("to") or window is None or to is None:
            continue
        if window.task == to.value:
            f.complain(BAD_VALUE, f'task "{to.value}" cannot precede itself', "to", help="name two different tasks")
            continue
        pair = (window.task, to.value)
        found[pair] = (*found.get(pair, ()), window)
    return found


# --------------------------------------------------------------------------------- modes, transitions, chains


def _mode(name: str, f: Fields, at: Location) -> ModeEntry:
    _is_name(name, f, at)
    f.require("tasks")
    tasks = f.texts("tasks", pattern)
    inner = f.section("versions", (), f"{f.path} versions")
    versions = [(Stated(p, inner.at(p)), inner.texts_of(p, name_text)) for p in inner] if inner is not None else []
    return ModeEntry(
        name=name,
        at=at,
        tasks=tasks,
        stated={field: one.value for field, one in stated_attributes(f, Mode, "name").items()},
        versions=tuple((pattern, listed.value) for pattern, listed in versions if listed is not None),
    )


def _transitions(top: Fields) -> dict[tuple[str, str], Transition]:
    found: dict[tuple[str, str], Transition] = {}
    for f in top.items("transitions", keys_of(Transition), "transition"):
        made = _made(f, Transition, lambda stated: about(transition=(stated["source"], stated["target"])))
        if made is None:
            continue
        path = about(transition=(made.source, made.target))
        if made.source == made.target:
            f.complain(BAD_VALUE, f"{path} leads nowhere", "to", help="name two different modes")
        else:
            _keep_once(found, (made.source, made.target), made, f, path)
    return found


def _chains(top: Fields) -> dict[str, Chain]:
    found: dict[str, Chain] = {}
    for f in top.items("chains", keys_of(Chain), "chain"):
        made = _made(f, Chain, lambda stated: about(chain=stated["name"]))
        if made is not None:
            _keep_once(found, made.name, made, f, about(chain=made.name))
    return found


def _rules(top: Fields) -> Iterator[HealthRule]:
    """Read ``{task, on, count, cycles, action, mode}``: what the target does after overruns or faults of a task."""
    for f in top.items("health", keys_of(HealthRule), "health rule"):
        made = _made(f, HealthRule, lambda stated: about(health_rule_of_task=stated["task"]))
        if made is not None:
            yield made
