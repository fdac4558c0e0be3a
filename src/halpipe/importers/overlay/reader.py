"""Reader of overlay files: YAML to entries, one function per section, all problems of all files collected."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeVar

from halpipe.diagnostics import Findings, HalpipeError, Location
from halpipe.durations import ZERO, Duration
from halpipe.files import YamlMap, parse_yaml, read_bytes, refuse_more_than
from halpipe.importers.overlay import values
from halpipe.importers.overlay.codes import DUPLICATE, NOT_AN_OVERLAY
from halpipe.importers.overlay.entries import InterruptEntry, ModeEntry, Overlay, TaskEntry, VersionEntry, merge
from halpipe.importers.overlay.patterns import MAX_GLOBS, is_glob
from halpipe.models import (
    Access,
    AccessKind,
    Anchor,
    Binding,
    Chain,
    HealthAction,
    HealthEvent,
    HealthRule,
    Interrupt,
    Origin,
    Precedence,
    Resource,
    Source,
    Split,
    Transfer,
    Transition,
    Unit,
)
from halpipe.quantities import parse_bandwidth, parse_size
from halpipe.settings import BAD_VALUE, Fields, Stated, Words

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

T = TypeVar("T")
E = TypeVar("E", Unit, Resource)

FORMAT = "halpipe-overlay"
FORMAT_VERSION = "1"

_TOP = (FORMAT, "platform", "sources", "tasks", "precedence", "modes", "transitions", "chains", "health", "drop")
_PLATFORM = ("units", "resources", "interrupts")
_INTERRUPT = ("name", "distance", "wcet")
_SPLIT = ("split", "resume", "max-gaps", "min-part")
_VERSION = ("wcet", "units", "gang", *_SPLIT, "access", "precedence", "source")
_TASK = ("period", "slack", "offset", "deadline", "distance", "binding", "drop", *_VERSION, "versions")
_ACCESS = ("resource", "start", "end", "bound", "kind", "transfers")
_WINDOW = ("from", "after", "min", "max")
_ANCHORS = tuple(str(anchor) for anchor in Anchor)
_KINDS = tuple(str(kind) for kind in AccessKind)
_RULE = ("task", "on", "count", "cycles", "action", "mode")
_EVENTS = tuple(str(event) for event in HealthEvent)
_ACTIONS = tuple(str(action) for action in HealthAction)
_BINDINGS = tuple(str(binding) for binding in Binding)


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
            if version.units is not None:
                yield from (Stated(unit, version.units.at) for unit in version.units.value)
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
        line = getattr(document, "line", 0)
        findings.add(NOT_AN_OVERLAY(problem, at=Location(path, line), help=help))
        return Overlay()
    return _overlay(Fields(path, findings, document, "overlay", _TOP))


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
        units=_listed(platform, "units", ("name", "type", "interrupts"), _unit),
        resources=_listed(platform, "resources", ("name", "bandwidth"), _resource),
        interrupts=tuple(_interrupts(platform)) if platform is not None else (),
        sources=tuple(_sources(top)),
        tasks=tuple(_task(pattern, f, at) for pattern, f, at in top.entries("tasks", _TASK, "task")),
        precedence=_constraints(top),
        modes={name: _mode(name, f, at) for name, f, at in top.entries("modes", ("tasks", "versions"), "mode")},
        transitions=_transitions(top),
        chains=_chains(top),
        health=tuple(_rules(top)),
        drops=top.texts("drop", values.pattern),
    )


def _origin(f: Fields, path: str, at: Location | None = None) -> Origin:
    at = at or f.at()
    return Origin(at.file, at.line, path)


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
    stated = f.get("name", values.name)
    type = f.value("type", values.name, "")
    path = f.path if stated is None else f'platform unit "{stated.value}"'
    served: dict[str, Interrupt] = {}
    for inner in f.items("interrupts", _INTERRUPT, f"{path} interrupt"):
        interrupt = _interrupt(inner)
        if interrupt is not None:
            _keep_once(served, interrupt.name, interrupt, inner, f'{path} interrupt "{interrupt.name}"')
    if stated is None:
        return None
    interrupts = tuple(served.values())
    return Unit(name=stated.value, type=type, interrupts=interrupts, origin=_origin(f, path), at=f.at())


def _interrupt(f: Fields) -> Interrupt | None:
    name, distance, wcet = (
        f.get("name", values.name),
        f.get("distance", values.positive),
        f.get("wcet", values.positive),
    )
    if not f.require(*_INTERRUPT) or name is None or distance is None or wcet is None:
        return None
    path = f'interrupt "{name.value}"'
    return Interrupt(name=name.value, distance=distance.value, wcet=wcet.value, origin=_origin(f, path), at=f.at())


def _interrupts(platform: Fields) -> Iterable[InterruptEntry]:
    """Read interrupts that are stated apart from the list of units, each with the units that serve it."""
    for f in platform.items("interrupts", ("units", *_INTERRUPT), "platform interrupt"):
        units, interrupt = f.texts_of("units", values.pattern), _interrupt(f)
        if f.require("units") and units is not None and interrupt is not None:
            yield InterruptEntry(units=units, interrupt=interrupt)


def _resource(f: Fields) -> Resource | None:
    stated = f.get("name", values.name)
    bandwidth = f.value("bandwidth", parse_bandwidth, None)
    if stated is None:
        return None
    path = f'platform resource "{stated.value}"'
    return Resource(name=stated.value, bandwidth=bandwidth, origin=_origin(f, path), at=f.at())


def _sources(top: Fields) -> Iterable[tuple[Stated[str], Duration]]:
    for pattern, f, at in top.entries("sources", ("period",), "source"):
        period = f.get("period", values.positive) if f.require("period") else None
        if period is not None:
            yield Stated(pattern, at), period.value


# ------------------------------------------------------------------------------------------- tasks, versions


def _task(pattern: str, f: Fields, at: Location) -> TaskEntry:
    path = f'task "{pattern}" version'
    versions = {
        name: Stated(_version(v, name), v_at)
        for name, v, v_at in f.entries("versions", _VERSION, path)
        if _is_name(name, f, v_at)
    }
    return TaskEntry(
        pattern=pattern,
        at=at,
        period=f.get("period", values.positive),
        slack=f.get("slack", values.share),
        offset=f.get("offset", Duration.parse),
        deadline=f.get("deadline", values.positive),
        distance=f.get("distance", values.positive),
        binding=f.get("binding", _binding),
        drop=f.flag("drop"),
        common=_version(f, ""),
        versions=versions,
    )


def _is_name(text: str, f: Fields, at: Location) -> bool:
    try:
        values.name(text)
    except ValueError as failure:
        message, _, help = str(failure).partition("; ")
        f.complain(BAD_VALUE, message, line=at.line, help=help)
        return False
    return True


def _binding(text: str) -> Binding:
    return Binding(Words(*_BINDINGS)(text))


def _split(f: Fields) -> Stated[Split] | None:
    """Read ``split: [4ms, 9ms]``, ``split: anywhere`` or ``split: none``."""
    stated = f.texts_of("split", values.splitting)
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


def _version(f: Fields, name: str) -> VersionEntry:
    """Read what a version states; a task's entry may state the same for all its versions."""
    accesses = tuple(_access(a) for a in f.items("access", _ACCESS, f"{f.path} access"))
    windows = tuple(_window(w) for w in f.items("precedence", _WINDOW, f"{f.path} precedence"))
    return VersionEntry(
        wcet=f.get("wcet", values.positive),
        units=f.texts_of("units", values.pattern),
        gang=f.get("gang", values.count),
        split=_split(f),
        resume=f.get("resume", Duration.parse),
        max_gaps=f.get("max-gaps", values.number),
        min_part=f.get("min-part", values.positive),
        accesses=Stated(tuple(a for a in accesses if a), f.at("access")) if "access" in f else None,
        precedences=Stated(tuple(w for w in windows if w), f.at("precedence")) if "precedence" in f else None,
        source=_source(f),
    )


def _access(f: Fields) -> Access | None:
    start, end = f.get("start", Duration.parse), f.get("end", values.positive)
    resource = f.get("resource", values.name)
    kind = f.get("kind", Words(*_KINDS))
    transfers = tuple(_transfer(t) for t in f.items("transfers", ("buffer", "symbol", "size"), f"{f.path} transfer"))
    if not f.require("resource", "start", "end") or resource is None or start is None or end is None:
        return None
    if start.value >= end.value:
        help = "an access phase must end after it starts"
        f.complain(BAD_VALUE, f"access from {start.value} to {end.value} is empty", "end", help=help)
    return Access(
        resource=resource.value,
        start=start.value,
        end=end.value,
        bound=f.value("bound", values.bound, Fraction(1)),
        kind=None if kind is None else AccessKind(kind.value),
        transfers=tuple(t for t in transfers if t),
        at=f.at(),
    )


def _transfer(f: Fields) -> Transfer | None:
    buffer, symbol, size = (
        f.get("buffer", values.name),
        f.get("symbol", values.name),
        f.get("size", parse_size),
    )
    if not f.require("buffer", "symbol", "size") or buffer is None or symbol is None or size is None:
        return None
    return Transfer(buffer=buffer.value, symbol=symbol.value, size=size.value, at=f.at())


def _source(f: Fields) -> Stated[Source] | None:
    inner = f.section("source", ("files", "entry", "defines"), f"{f.path} source")
    if inner is None:
        return None
    files, entry = inner.texts_of("files", values.word), inner.get("entry", values.word)
    defines = tuple(d.value for d in inner.texts("defines", values.word))
    if not inner.require("files", "entry") or files is None or entry is None:
        return None
    return Stated(Source(files=files.value, entry=entry.value, defines=defines, at=inner.at()), f.at("source"))


# ----------------------------------------------------------------------------------------------- constraints


def _window(f: Fields) -> Precedence | None:
    """Read ``{from: task, after: start|end, min: 0ms, max: 2ms}``; the window counts from that instant of `from`."""
    task = f.get("from", values.name)
    anchor = f.value("after", Words(*_ANCHORS), Anchor.START)
    least, high = f.value("min", Duration.parse, ZERO), f.get("max", Duration.parse)
    if not f.require("from", "max") or task is None or high is None:
        return None
    if least > high.value:
        f.complain(
            BAD_VALUE,
            f"window from {least} to {high.value} is empty",
            "max",
            help="max must not be below min",
        )
    return Precedence(
        task=task.value,
        min=least,
        max=high.value,
        anchor=Anchor(anchor),
        origin=_origin(f, f.path),
        at=f.at(),
    )


def _constraints(top: Fields) -> dict[tuple[str, str], tuple[Precedence, ...]]:
    found: dict[tuple[str, str], tuple[Precedence, ...]] = {}
    for f in top.items("precedence", ("to", *_WINDOW), "precedence"):
        window, to = _window(f), f.get("to", values.name)
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
    tasks = f.texts("tasks", values.pattern)
    inner = f.section("versions", (), f"{f.path} versions")
    versions = [(Stated(p, inner.at(p)), inner.texts_of(p, values.name)) for p in inner] if inner is not None else []
    return ModeEntry(
        name=name,
        at=at,
        tasks=tasks,
        versions=tuple((pattern, listed.value) for pattern, listed in versions if listed is not None),
    )


def _transitions(top: Fields) -> dict[tuple[str, str], Transition]:
    found: dict[tuple[str, str], Transition] = {}
    for f in top.items("transitions", ("from", "to", "max-length"), "transition"):
        source, target = f.get("from", values.name), f.get("to", values.name)
        longest = f.value("max-length", Duration.parse, None)
        if not f.require("from", "to") or source is None or target is None:
            continue
        path = f'transition "{source.value}" to "{target.value}"'
        if source.value == target.value:
            f.complain(BAD_VALUE, f"{path} leads nowhere", "to", help="name two different modes")
            continue
        transition = Transition(
            source=source.value,
            target=target.value,
            max_length=longest,
            origin=_origin(f, path),
            at=f.at(),
        )
        _keep_once(found, (source.value, target.value), transition, f, path)
    return found


def _chains(top: Fields) -> dict[str, Chain]:
    found: dict[str, Chain] = {}
    for f in top.items("chains", ("name", "tasks", "max-reaction", "max-age"), "chain"):
        stated, tasks = f.get("name", values.name), f.texts_of("tasks", values.name)
        reaction, age = (
            f.value("max-reaction", values.positive, None),
            f.value("max-age", values.positive, None),
        )
        if not f.require("name", "tasks") or stated is None or tasks is None:
            continue
        path = f'chain "{stated.value}"'
        chain = Chain(
            name=stated.value,
            tasks=tasks.value,
            max_reaction=reaction,
            max_age=age,
            origin=_origin(f, path),
            at=f.at(),
        )
        _keep_once(found, chain.name, chain, f, path)
    return found


def _rules(top: Fields) -> Iterable[HealthRule]:
    """Read ``{task, on, count, cycles, action, mode}``: what the target does after overruns or faults of a task."""
    for f in top.items("health", _RULE, "health rule"):
        task, action = f.get("task", values.name), f.get("action", Words(*_ACTIONS))
        event = f.value("on", Words(*_EVENTS), HealthEvent.ANY)
        count, cycles = f.value("count", values.times, 1), f.value("cycles", values.times, 1)
        mode = f.value("mode", values.name, "")
        if not f.require("task", "action") or task is None or action is None:
            continue
        yield HealthRule(
            task=task.value,
            event=HealthEvent(event),
            count=count,
            cycles=cycles,
            action=HealthAction(action.value),
            mode=mode,
            origin=_origin(f, f'health rule of task "{task.value}"'),
            at=f.at(),
        )
