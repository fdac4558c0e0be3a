"""Schedules at the edge of each rule: one keeps every rule, its twin, if any, breaks a single one by the least."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.files import parse_yaml, sha256
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Iterator

EDGES = Path(__file__).with_name("edges.yaml")


@record
class Edge:
    """A model and a schedule that keep every rule, and mostly a pair that breaks `rules` alone, nearly always one.

    `by_second` tells whether the second checker judges the rule.
    """

    rules: tuple[str, ...]
    pairs: tuple[tuple[bytes, bytes], ...]
    by_second: bool


@cache
def edges() -> tuple[Edge, ...]:
    """Return the edges of all rules."""
    return tuple(_edge(stated) for stated in parse_yaml(EDGES.read_bytes(), EDGES.name))


def _edge(stated: dict[str, Any]) -> Edge:
    pairs = tuple(_files(stated, values) for values in stated["values"])
    rules = stated["rule"]
    return Edge((rules,) if isinstance(rules, str) else tuple(rules), pairs, stated.get("second", True))


def _files(stated: dict[str, Any], values: list[str]) -> tuple[bytes, bytes]:
    """Return model and schedule, each ``{}`` of them replaced by the next of the values."""
    left = iter(values)

    def filled(text: str) -> str:
        return "".join(part + next(left) if more else part for part, more in _pieces(text))

    model = _model(stated, filled)
    return model, _schedule(stated, filled).replace(b"SHA256", sha256(model).encode())


PLATFORM = '<unit name="a"/><unit name="b"/><resource name="r"/><resource name="l" kind="lock"/>'


def _model(stated: dict[str, Any], filled: Any) -> bytes:
    runs = "".join(f'<run task="{name}" versions="v"/>' for name in "pqs" if f'name="{name}"' in stated["tasks"])
    limit = f' max-length="{stated["limit"]}ms"' if "limit" in stated else ""
    parts = {
        "platform": stated.get("platform", PLATFORM),
        "tasks": stated["tasks"],
        "chains": stated.get("chains", ""),
        "modes": stated.get("modes") or f'<mode name="m">{runs}</mode>',
        "transitions": f'<transition from="m" to="n"{limit}/>' if "length" in stated else "",
        "health": stated.get("health", ""),
    }
    inside = "".join(f"<{name}>{filled(content)}</{name}>" for name, content in parts.items() if content)
    return f'<task-model xmlns="urn:halpipe:task-model:1" name="m">{inside}</task-model>'.encode()


def _schedule(stated: dict[str, Any], filled: Any) -> bytes:
    cycle = int(stated.get("cycle", 10))
    usual = f'hyperperiod="{cycle}ms" status="valid"'

    def mode(name: str, content: str, head: str = usual) -> str:
        return f'<mode name="{name}" {head}>{content}</mode>'

    content = _jobs(stated["jobs"], filled) + filled(stated.get("figures", ""))
    inside = mode("m", content, filled(stated.get("head", usual)))
    if "length" in stated:
        length = filled(stated["length"])
        latency = filled(stated["latency"]) if "latency" in stated else str(cycle + int(stated["length"]))
        table = _jobs(stated.get("table", ()), filled)
        ends = f'length="{length}ms" worst-latency="{latency}ms" status="valid"'
        inside += mode("n", _jobs(stated["then"], filled))
        inside += f'<transition from="m" to="n" {ends}>{table}</transition>'
    inside += filled(stated.get("reaction", ""))
    model = filled(stated.get("model", 'model="m"'))
    return f'<schedule xmlns="urn:halpipe:schedule:1" {model}>{inside}</schedule>'.encode()


def _pieces(text: str) -> Iterator[tuple[str, bool]]:
    *parts, last = text.split("{}")
    yield from ((part, True) for part in parts)
    yield last, False


def _jobs(stated: list[str], filled: Any) -> str:
    """Return jobs from their short form: task, index, start, end, version, units, then parts with their execution."""
    made = []
    for text in map(filled, stated):
        if not text:
            continue
        job, *parts = text.split(" | ")
        task, index, start, end, version, *units = job.split()
        inside = ""
        for part in parts:
            begin, until, first, last = part.split()
            inside += f'<part start="{begin}ms" end="{until}ms" from="{first}ms" to="{last}ms"/>'
        where = f'start="{start}ms" end="{end}ms" version="{version}" units="{" ".join(units)}"'
        made.append(f'<job task="{task}" index="{index}" {where}>{inside}</job>')
    return "".join(made)
