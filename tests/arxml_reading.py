"""Plain access to exported ARXML for tests, without a line of the importer: elements by path, special data, tables."""

from dataclasses import dataclass
from fractions import Fraction

from lxml import etree

from halpipe.exporters.arxml import FORMAT, ArxmlOptions

NS = "{http://autosar.org/schema/r4.0}"


def write(model, schedule=None, **options):
    """The root of an export."""
    return etree.fromstring(FORMAT.write(model, schedule, ArxmlOptions(**options))[""])


def q(path):
    """A relative path in the namespace of AUTOSAR."""
    return "/".join(step if step in (".", "*", "", "..") else NS + step for step in path.split("/"))


def name_of(element):
    return element.findtext(NS + "SHORT-NAME")


def by_path(root, path):
    """The element that the short names of `path` lead to; None if it is not there."""
    element = root
    for step in path.strip("/").split("/"):
        element = _inner(element, step)
        if element is None:
            return None
    return element


def _inner(element, name):
    for child in element:
        found = child if name_of(child) == name else _inner(child, name) if name_of(child) is None else None
        if found is not None:
            return found
    return None


def all_of(root, tag):
    """Short name to element, for all elements of a tag."""
    return {name_of(element): element for element in root.iter(NS + tag)}


def text(element, path):
    return element.findtext(q(path))


def texts(element, path):
    return [found.text for found in element.iterfind(q(path))]


def special(element, kind):
    """The special data of a kind as a list of (GID or class, text), inner groups as lists in place of texts."""
    for group in element.iterfind(q("ADMIN-DATA/SDGS/SDG")):
        if group.get("GID") == f"halpipe:{kind}":
            return _data(group)
    return None


def _data(group):
    return [(e.get("GID") or e.get("DEST"), _data(e) if e.tag == NS + "SDG" else e.text or "") for e in group]


def native(root):
    """The native model that an export holds, as XML."""
    (group,) = [g for g in root.iter(NS + "SDG") if g.get("GID") == "halpipe:model"]
    return etree.fromstring("".join(sd.text for sd in group.iterfind(NS + "SD") if sd.get("GID") == "xml"))


def names(root):
    """Element to its name in the native model, for runnables, implementations and units: they have the same order."""
    model = native(root)
    found = {}
    for tag, kind in (("RUNNABLE-ENTITY", "task"), ("SWC-IMPLEMENTATION", "version"), ("HW-ELEMENT", "unit")):
        found |= dict(zip(root.iter(NS + tag), (e.get("name") for e in model.iter(f"{{*}}{kind}")), strict=False))
    return found


def parameters(container):
    """Last step of the definition to value, of the parameters of a configuration container."""
    return {
        text(e, "DEFINITION-REF").rpartition("/")[2]: text(e, "VALUE")
        for e in container.iterfind(q("PARAMETER-VALUES/*"))
    }


def references(container):
    """(last step of the definition, target) of the references of a configuration container."""
    return [
        (text(e, "DEFINITION-REF").rpartition("/")[2], text(e, "VALUE-REF"))
        for e in container.iterfind(q("REFERENCE-VALUES/*"))
    ]


def target(container, name):
    (found,) = [path for key, path in references(container) if key == name]
    return found


def containers(root, kind):
    """Short name to container, for all containers of a definition."""
    found = root.iter(NS + "ECUC-CONTAINER-VALUE")
    return {name_of(c): c for c in found if text(c, "DEFINITION-REF").rpartition("/")[2] == kind}


@dataclass(frozen=True)
class OsTable:
    """A schedule table: what it is of, (ticks, OsTasks) at every expiry point, and (OsTask, event) by ticks."""

    name: str
    of: tuple
    duration: int
    repeating: bool
    autostart: tuple
    points: list
    counter: str
    following: list
    events: dict


def tables(root):
    """Every schedule table of an export by name."""
    return {name: _table(name, container) for name, container in containers(root, "OsScheduleTable").items()}


def _table(name, container):
    values, data = parameters(container), special(container, "table")
    points, start, events = [], (), {}
    for inner in container.iterfind(q("SUB-CONTAINERS/*")):
        if text(inner, "DEFINITION-REF").endswith("OsScheduleTableAutostart"):
            modes = [path.rpartition("/")[2] for key, path in references(inner) if key.endswith("AppModeRef")]
            start = (parameters(inner)["OsScheduleTableStartValue"], *modes)
            continue
        offset = int(parameters(inner)["OsScheduleTblExpPointOffset"])
        activated = []
        for action in inner.iterfind(q("SUB-CONTAINERS/*")):
            if text(action, "DEFINITION-REF").endswith("OsScheduleTableEventSetting"):
                names = [
                    target(action, f"OsScheduleTableSetEvent{what}Ref").rpartition("/")[2] for what in ("Task", "")
                ]
                events.setdefault(offset, []).append(tuple(names))
            else:
                activated.append(target(action, "OsScheduleTableActivateTaskRef").rpartition("/")[2])
        points.append((offset, activated))
    return OsTable(
        name=name,
        of=tuple(value for key, value in data if key in ("mode", "target")),
        duration=int(values["OsScheduleTableDuration"]),
        repeating=values["OsScheduleTableRepeating"] == "true",
        autostart=start,
        points=points,
        counter=target(container, "OsScheduleTableCounterRef").rpartition("/")[2],
        events=events,
        following=[tuple(value for _, value in inner) for key, inner in data if key == "halpipe:next"],
    )


def seconds_per_tick(root):
    """The tick of the only kind of counter that an export has."""
    (found,) = {parameters(counter)["OsSecondsPerTick"] for counter in containers(root, "OsCounter").values()}
    return Fraction(found)
