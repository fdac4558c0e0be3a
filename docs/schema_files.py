"""Writes what the XML schemas say of attributes from the one statement of each, the field of its class.

The rest of a schema, which elements there are and what else a type has, is written by hand.
"""

from __future__ import annotations

import re
from pathlib import Path

import halpipe
from halpipe.models import (
    Access,
    Chain,
    ChainLatency,
    CostTerms,
    HealthRule,
    Interrupt,
    Job,
    Mode,
    ModeSchedule,
    Origin,
    Part,
    Precedence,
    Reaction,
    Resource,
    ResourceLoad,
    Run,
    Schedule,
    Source,
    Split,
    Task,
    TaskModel,
    Transfer,
    Transition,
    TransitionTable,
    Unit,
    UnitLoad,
    Version,
)
from halpipe.models.attributes import Attribute, Codec, attributes

XS = "{http://www.w3.org/2001/XMLSchema}"


ELEMENTS: dict[str, list[tuple[str, type, str]]] = {
    "task-model": [
        ("origin", Origin, ""),
        ("interrupt", Interrupt, ""),
        ("unit", Unit, ""),
        ("resource", Resource, ""),
        ("unit-set", Version, "units"),
        ("transfer", Transfer, ""),
        ("access", Access, ""),
        ("precedence", Precedence, ""),
        ("source", Source, ""),
        ("version", Version, ""),
        ("version", Split, ""),
        ("task", Task, ""),
        ("chain", Chain, ""),
        ("run", Run, ""),
        ("mode", Mode, ""),
        ("transition", Transition, ""),
        ("rule", HealthRule, ""),
        ("task-model", TaskModel, ""),
    ],
    "schedule": [
        ("part", Part, ""),
        ("job", Job, ""),
        ("cost", CostTerms, ""),
        ("unit-load", UnitLoad, ""),
        ("resource-load", ResourceLoad, ""),
        ("chain", ChainLatency, ""),
        ("mode", ModeSchedule, ""),
        ("transition", TransitionTable, ""),
        ("reaction", Reaction, ""),
        ("schedule", Schedule, ""),
    ],
}
"""The types of the schemas with the classes that state their attributes, and the child that has them, if one does."""


def schema_file(kind: str) -> tuple[Path, str]:
    """Return the schema of an artefact with the attributes and the words that the classes state now."""
    path = Path(halpipe.__file__).parent / "schemas" / f"{kind}-1.xsd"
    lines = path.read_text(encoding="utf-8").splitlines()
    for type, model, child in ELEMENTS[kind]:
        stated = attributes(model, child)
        for codec in (one.codec for one in stated if one.codec.words):
            lines = _with_words(lines, codec)
        lines = _with_attributes(lines, type, {one.name: one for one in stated})
    return path, "\n".join(lines) + "\n"


def _with_attributes(lines: list[str], type: str, stated: dict[str, Attribute]) -> list[str]:
    """Replace the attributes of a type that are stated, with their remarks, where the first of them stands."""
    first = next(n for n, line in enumerate(lines) if re.match(rf'  <xs:\w+ name="{type}">$', line))
    last = next(n for n, line in enumerate(lines[first:], first) if re.match(r"  </", line))
    indent = "    " if "complexType" in lines[first] else "      "
    kept: list[str] = []
    for line in lines[first:last]:
        name = re.match(rf'{indent}<xs:attribute name="([\w-]+)"', line)
        if name is None or name[1] not in stated:
            kept.append(line)
            continue
        if kept[-1].strip().startswith("<!--"):
            kept.pop()
        if line.strip() and name[1] == next(iter(stated)):
            kept += [indent + made for one in stated.values() for made in _schema_attribute(one)]
    return [*lines[:first], *kept, *lines[last:]]


def _schema_attribute(one: Attribute) -> list[str]:
    text = "" if one.is_required or one.is_common or one.default is None else one.codec.text(one.default)
    use = ' use="required"' if one.is_required else f' default="{text}"' if text else ""
    remark = [f"<!-- {one.meaning} -->"] if one.meaning else []
    return [*remark, f'<xs:attribute name="{one.name}" type="{one.codec.schema}"{use}/>']


def _with_words(lines: list[str], codec: Codec) -> list[str]:
    """Replace the simple type of an enumeration, or add it before the first complex type."""
    members = {} if codec.words is None else codec.words.__members__
    words = "".join(f'<xs:enumeration value="{word.value}"/>' for word in members.values())
    made = [
        f'  <xs:simpleType name="{codec.schema}">',
        f'    <xs:restriction base="xs:token">{words}</xs:restriction>',
        "  </xs:simpleType>",
    ]
    if made[0] not in lines:
        before = next(n for n, line in enumerate(lines) if line.startswith("  <xs:complexType"))
        return [*lines[: before - 1], *made, *lines[before - 1 :]]
    first = lines.index(made[0])
    return [*lines[:first], *made, *lines[lines.index(made[-1], first) + 1 :]]
