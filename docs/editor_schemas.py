"""Schemas for editors of the YAML files, made by the readers of halpipe themselves.

A reader is given an `Outline` in place of a file: it says that every key is there, and notes what the reader asks for.
So a schema has the keys that are read, and no others. What a key means is taken from the tables of the reference pages.
"""

from __future__ import annotations

import json
import re
import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.durations import Duration
from halpipe.core.files import YamlMap
from halpipe.core.settings import Fields, Words

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

REFERENCE = Path(__file__).parent / "reference"
PROJECT = Path(__file__).parents[1] / "pyproject.toml"
DIALECT = "http://json-schema.org/draft-07/schema#"
"""The one that the YAML language server reads."""

NUMBERS = ("0", "1", "8", "64", "4096", "100000", "0.5", "0x0")
NUMBER = {"type": ["string", "number"]}
DURATION = {"type": "string", "pattern": r"^\s*[0-9./]+\s*(ns|us|ms|s)\s*$"}


ANY_NAME = "name"


class Outline(Fields):
    """A mapping that has every key, and notes how each is read; `maps`: what may be a mapping is one."""

    def __init__(self, keys: tuple[str, ...], meanings: dict[str, str], *, maps: bool = False) -> None:
        super().__init__("", Findings(), YamlMap(0), "", ())
        self._maps = maps
        self._meanings = meanings
        self.needed: list[str] = []
        self.asked: dict[str, dict[str, Any]] = {}
        self.each: Outline | None = None
        self.named = False
        self.allow(keys)

    def schema(self) -> dict[str, Any]:
        """Return the schema of the mapping."""
        if self.each is not None:
            return {"type": "object", "additionalProperties": self.each.schema()}
        if self.named:
            return {"type": "object", "additionalProperties": self.asked.get(ANY_NAME, {})}
        if not self.asked:
            return {"type": "object"}
        found = {key: self._described(key, form) for key, form in self.asked.items()}
        made: dict[str, Any] = {"type": "object", "properties": found, "additionalProperties": False}
        return made | ({"required": sorted(set(self.needed))} if self.needed else {})

    def _described(self, key: str, form: dict[str, Any]) -> dict[str, Any]:
        meaning = self._meanings.get(key, "")
        stated = form.resolved() if isinstance(form, _Later) else form
        return ({"description": meaning} if meaning else {}) | stated

    # ---- what readers ask

    def allow(self, keys: tuple[str, ...], inside: Any = None) -> None:
        """Note keys that may be there, whatever their form."""
        if hasattr(self, "asked"):
            for key in keys:
                self.asked.setdefault(key, {})

    def __contains__(self, key: str) -> bool:
        return True

    def __iter__(self) -> Iterator[str]:
        self.named = True
        return iter((ANY_NAME,))

    def at(self, key: str = "") -> Location:
        """Return no place."""
        return Location()

    def is_mapping(self, key: str) -> bool:
        """Return whether the form at hand is a mapping."""
        return self._maps

    def require(self, *keys: str) -> bool:
        """Note that the keys are required."""
        self.needed += keys
        return True

    def get(self, key: str, read: Callable[[str], Any]) -> None:
        """Note how the text of a key is read."""
        self.asked[key] = form_of(read)

    def flag(self, key: str) -> None:
        """Note a value that is true or false."""
        self.asked[key] = {"type": "boolean"}

    def texts(self, key: str, read: Callable[[str], Any]) -> tuple[()]:
        """Note a text or a list of texts."""
        form = form_of(read)
        self.asked[key] = {"anyOf": [form, {"type": "array", "items": form}]}
        return ()

    def checked(self, key: str, read: Callable[[], Any], default: Any, *, line: int = 0) -> Any:
        """Return the default, whatever would be read."""
        return default

    def texts_of(self, key: str, read: Callable[[str], Any]) -> None:
        """Note a text or a list of texts."""
        self.texts(key, read)

    def section(self, key: str, keys: tuple[str, ...], path: str) -> Outline:
        """Note a mapping."""
        inner = Outline(keys, self._meanings, maps=self._maps)
        self.asked[key] = _Later(inner)
        return inner

    def entries(self, key: str, keys: tuple[str, ...], path: str) -> Iterator[tuple[str, Fields, Location]]:
        """Note a mapping of mappings."""
        outer = self.section(key, (), path)
        outer.each = Outline(keys, self._meanings, maps=self._maps)
        yield "name", outer.each, Location()

    def items(self, key: str, keys: tuple[str, ...], path: str) -> Iterator[Fields]:
        """Note a list of mappings."""
        inner = Outline(keys, self._meanings, maps=self._maps)
        self.asked[key] = _Later(inner, listed=True)
        yield inner


class _Later(dict[str, Any]):
    """The schema of a mapping that its reader has not yet read to its end."""

    def __init__(self, outline: Outline, *, listed: bool = False) -> None:
        super().__init__()
        self._outline, self._listed = outline, listed

    def resolved(self) -> dict[str, Any]:
        """Return the schema, now that all is read."""
        made = self._outline.schema()
        return {"type": "array", "items": made} if self._listed else made


def form_of(read: Callable[[str], Any]) -> dict[str, Any]:
    """Return the form of the texts that a reader of single values takes."""
    if isinstance(read, Words):
        return {"enum": list(read.words)}
    if read == Duration.parse or _takes_durations(read):
        return DURATION
    return NUMBER if any(_takes(read, text) for text in NUMBERS) else {"type": "string"}


def _takes(read: Callable[[str], Any], text: str) -> bool:
    try:
        read(text)
    except (ValueError, TypeError, ZeroDivisionError):
        return False
    return True


def _takes_durations(read: Callable[[str], Any]) -> bool:
    return _takes(read, "1ms") and not _takes(read, "1") and not _takes(read, "word")


# ------------------------------------------------------------------------------------------------ the files


def texts() -> dict[str, str]:
    """Return the schemas of YAML files and of what commands print, as they are written, by the names of their files."""
    made = schemas() | printed()
    return {name: json.dumps(schema, indent=1, ensure_ascii=True) + "\n" for name, schema in made.items()}


def schemas() -> dict[str, dict[str, Any]]:
    """Return the schema of each kind of YAML file by the name of its file."""
    return {
        "overlay-1.schema.json": _overlay(),
        "platform-1.schema.json": _platform(),
        "pipeline-1.schema.json": _pipeline(),
        "profile-1.schema.json": _profile(),
        "drivers-1.schema.json": _drivers(),
    }


def _finished(title: str, key: str, outline: Outline) -> dict[str, Any]:
    outline.asked[key] = {"const": 1, "description": "Version of the format."}
    outline.needed.append(key)
    return {"$schema": DIALECT, "title": title, **outline.schema()}


def _overlay() -> dict[str, Any]:
    from halpipe.importers.overlay import reader

    outline = Outline((), meanings("overlay.md"))
    reader._overlay(outline)
    return _finished("halpipe overlay: what a source cannot say", reader.FORMAT, outline)


def _platform() -> dict[str, Any]:
    from halpipe.exporters.regulator import platform

    outline = Outline((), meanings("regulator-platform.md"))
    platform._Reader(outline, "platform.yaml", b"").platform()
    return _finished("halpipe platform of bandwidth regulators", "halpipe-regulator", outline)


def _profile() -> dict[str, Any]:
    from halpipe.exporters.riscv import profile

    forms = []
    for maps in (False, True):
        outline = Outline((), meanings("riscv-bundle.md"), maps=maps)
        profile._profile("profile", outline)
        forms.append(_finished("halpipe profile of a RISC-V target", "halpipe-profile", outline))
    return _either(*forms)


def _either(plain: dict[str, Any], mapped: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of what may be a single value or a mapping, wherever the two differ."""
    if plain == mapped:
        return plain
    if "properties" in plain and "properties" in mapped:
        pairs = ((key, form, mapped["properties"][key]) for key, form in plain["properties"].items())
        return plain | {"properties": {key: _either(*forms) for key, *forms in pairs}}
    described = {key: text for key, text in plain.items() if key == "description"}
    forms = ({key: each[key] for key in each if key != "description"} for each in (plain, mapped))
    return described | {"anyOf": list(forms)}


def _drivers() -> dict[str, Any]:
    from halpipe.exporters.riscv import drivers

    outline = Outline((), meanings("riscv-bundle.md"))
    drivers._drivers(outline)
    return _finished("halpipe drivers of sensors and actuators", "halpipe-drivers", outline)


def _pipeline() -> dict[str, Any]:
    from halpipe.flow.formats import EXPORTERS, IMPORTERS
    from halpipe.pipeline.solve.schedule import SearchOptions

    keys = ("import", "model", "schedule", "exports")
    outline = Outline(keys, meanings("pipeline.md"))
    outline.needed += ["model", "schedule"]
    outline.get("model", str)
    made = _finished("halpipe pipeline: sources, stages and exports", "halpipe-pipeline", outline)
    sources = [_step(name, each.options, ("format", "inputs")) for name, each in _formats(IMPORTERS)]
    exports = [_step(name, each.options, ("format", "output")) for name, each in _formats(EXPORTERS)]
    made["properties"]["import"] |= {"oneOf": sources}
    made["properties"]["schedule"] |= _step("", SearchOptions, ("output",))
    made["properties"]["exports"] |= {"type": "array", "items": {"oneOf": exports}}
    return made


def _formats(group: str) -> Iterator[tuple[str, Any]]:
    """Yield the formats that come with halpipe by name: where a wheel is made, none is installed."""
    points = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]["entry-points"][group]
    for name in sorted(points):
        yield name, EntryPoint(name, points[name], group).load()


def _step(format: str, kind: type, required: tuple[str, ...]) -> dict[str, Any]:
    """Return the schema of a step: what every one has, and the options of its kind."""
    from halpipe.core.options import Form, from_fields, options_of

    step = Outline((), {each.name: each.help for each in options_of(kind)})
    from_fields(kind, step, "")
    for each in options_of(kind):
        form = {"enum": list(each.words)} if each.words else form_of(each.read)
        if each.form is Form.NAMES:
            step.asked[each.name] = {"type": "object", "additionalProperties": form}
        elif each.form is Form.LIST:
            step.asked[each.name] = {"anyOf": [form, {"type": "array", "items": form}]}
        elif each.form is Form.TEXT:
            step.asked[each.name] = form
    for key in required:
        step.asked[key] = NUMBER
    if "inputs" in required:
        step.texts("inputs", str)
    if format:
        step.asked["format"] = {"const": format}
    step.needed += required
    return step.schema()


def meanings(page: str) -> dict[str, str]:
    """Return what a reference page says of each key that only one row of its tables has."""
    found: dict[str, list[str]] = {}
    for row in re.findall(
        r"^\| ((?:`[\w-]+`(?:, )?)+) \|(.*)\|$", (REFERENCE / page).read_text(encoding="utf-8"), re.M
    ):
        cells = [cell.strip() for cell in row[1].split(" | ")]
        for key in re.findall(r"`([\w-]+)`", row[0]):
            said = "; ".join(cell for cell in cells if cell)
            found.setdefault(key, []).append(re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", said))
    return {key: said[0] for key, said in found.items() if len(said) == 1}


# ------------------------------------------------------------------------------------------------ what is printed

EXACT = {"type": ["string", "number", "null"], "description": "exact: a decimal, or n/d where no decimal ends"}
TEXT, COUNT = {"type": "string"}, {"type": "integer", "minimum": 0}

COLUMNS: dict[str, dict[str, Any]] = {
    "table": TEXT | {"description": "mode, or a->b for the switch from mode a to mode b"},
    "task": TEXT,
    "job": COUNT | {"description": "number of the job in the table, from 0 on"},
    "version": TEXT,
    "units": TEXT | {"description": "names with spaces between them"},
    "part": COUNT | {"description": "number of the part, from 0 on; jobs without gaps have one"},
    "start_ms": EXACT,
    "end_ms": EXACT,
    "kind": {"enum": ["unit", "resource"]},
    "name": TEXT,
    "busy_ms": EXACT,
    "share": EXACT,
    "peak": EXACT,
    "chain": TEXT,
    "reaction_ms": EXACT,
    "age_ms": EXACT,
    "latency_ms": EXACT,
    "source": TEXT,
    "target": TEXT,
    "length_ms": EXACT,
    "worst_latency_ms": EXACT,
    "jobs": COUNT,
    "status": {"enum": ["valid", "not-found"]},
}


def printed() -> dict[str, dict[str, Any]]:
    """Return the schemas of what commands print as JSON."""
    return {
        "show-1.schema.json": _show(),
        "doctor-1.schema.json": _doctor(),
        "findings-1.schema.json": _findings(),
    }


def _object(properties: dict[str, Any]) -> dict[str, Any]:
    required = sorted(properties)
    return {"type": "object", "properties": properties, "required": required, "additionalProperties": False}


def _show() -> dict[str, Any]:
    from halpipe.exporters.common import rows

    tables = {
        "jobs": rows.JOB_COLUMNS,
        "loads": rows.LOAD_COLUMNS,
        "latencies": rows.LATENCY_COLUMNS,
        "switches": rows.SWITCH_COLUMNS,
    }
    listed = {
        name: {"type": "array", "items": _object({c: COLUMNS[c] for c in columns})} for name, columns in tables.items()
    }
    figures = {"hyperperiod_ms": EXACT, "margin": EXACT, "margin_bound": EXACT, "margin_words": TEXT}
    mode = _object({"name": TEXT, "status": COLUMNS["status"], **figures})
    whole = {"halpipe-show": {"const": 1}, "model": TEXT, "modes": {"type": "array", "items": mode}, **listed}
    return {"$schema": DIALECT, "title": "halpipe show --format json", **_object(whole)}


def _doctor() -> dict[str, Any]:
    names = {"type": "array", "items": TEXT}
    whole = {
        "halpipe": TEXT,
        "python": TEXT,
        "system": TEXT,
        "packages": {"type": "object", "additionalProperties": {"type": ["string", "null"]}},
        "programs": {"type": "object", "additionalProperties": {"type": "boolean"}},
        "importers": names,
        "exporters": names,
        "bundles": names,
    }
    return {"$schema": DIALECT, "title": "halpipe doctor --format json", **_object(whole)}


def _findings() -> dict[str, Any]:
    from halpipe.core.diagnostics import Severity

    line = {"type": "integer", "minimum": 0, "description": "0: the file as a whole."}
    place = {"file": TEXT, "line": line}
    subject = _object({"kind": {**TEXT, "description": "Such as task, unit or mode."}, "name": TEXT})
    finding = _object(
        {
            "code": {"type": "string", "pattern": "^HAL[0-9]{4}$"},
            "severity": {"enum": [str(severity) for severity in Severity]},
            **place,
            "path": {**TEXT, "description": "The element, in words."},
            "message": TEXT,
            "help": TEXT,
            "subjects": {"type": "array", "items": subject, "description": "The elements that the finding is about."},
            "places": {"type": "array", "items": _object(place), "description": "Where else to look."},
        }
    )
    fix = _object({**place, "old": TEXT, "new": TEXT})
    finding["properties"]["fix"] = {**fix, "description": "Change that removes the fault: at the line, old becomes new"}
    return {"$schema": DIALECT, "title": "Findings, with --format json", "type": "array", "items": finding}
