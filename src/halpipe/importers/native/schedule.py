"""Reader of the schedule XML (schema schedule-1.xsd)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import parse_xml, read_bytes, refuse_more_than
from halpipe.importers.native.binding import Binder, only
from halpipe.models import (
    ChainLatency,
    CostTerms,
    Job,
    ModeSchedule,
    Part,
    Reaction,
    ResourceLoad,
    Schedule,
    TransitionTable,
    UnitLoad,
)
from halpipe.schemas import SCHEDULE, check, line_of, namespace

if TYPE_CHECKING:
    from lxml import etree

MAX_PARTS = 20_000
"""Parts of one job: no table needs as many."""


def read_schedule(path: str) -> Schedule:
    """Read a schedule file (``-``: standard input); raise `HalpipeError` with everything wrong in its form.

    Whether the schedule is valid is not judged here: see `halpipe.pipeline.verify`.
    """
    return parse_schedule(read_bytes(path), path)


def parse_schedule(data: bytes, file: str) -> Schedule:
    """Read a schedule from the bytes of `file`."""
    root = parse_xml(data, file)
    violations = check(root, SCHEDULE, file)
    if violations:
        raise HalpipeError(*violations)
    for job in root.xpath(f"//t:job[count(t:part) > {MAX_PARTS}]", namespaces={"t": namespace(SCHEDULE)}):
        refuse_more_than(MAX_PARTS, len(job), "parts of one job", Location(file, line_of(job)))
    bind = _ScheduleBinder(file, namespace(SCHEDULE))
    schedule = bind.schedule(root)
    bind.findings.stop_on_errors()
    return schedule


class _ScheduleBinder(Binder):
    """One method per element type, in the order of the schema."""

    def schedule(self, root: etree._Element) -> Schedule:
        parts = self.children(root)
        return Schedule(
            **self.values(Schedule, root),
            modes=tuple(map(self.mode, parts.get("mode", ()))),
            transitions=tuple(map(self.transition, parts.get("transition", ()))),
            reactions=tuple(Reaction(**self.values(Reaction, e), at=self.at(e)) for e in parts.get("reaction", ())),
            at=self.at(root),
        )

    def mode(self, e: etree._Element) -> ModeSchedule:
        parts = self.children(e)
        cost = only(parts, "cost")
        return ModeSchedule(
            **self.values(ModeSchedule, e),
            jobs=tuple(map(self.job, parts.get("job", ()))),
            cost=None if cost is None else CostTerms(**self.values(CostTerms, cost)),
            unit_loads=tuple(UnitLoad(**self.values(UnitLoad, load)) for load in parts.get("unit-load", ())),
            resource_loads=tuple(
                ResourceLoad(**self.values(ResourceLoad, load)) for load in parts.get("resource-load", ())
            ),
            chains=tuple(ChainLatency(**self.values(ChainLatency, chain)) for chain in parts.get("chain", ())),
            at=self.at(e),
        )

    def job(self, e: etree._Element) -> Job:
        parts = tuple(map(self.part, self.children(e).get("part", ())))
        return Job(**self.values(Job, e), parts=parts, at=self.at(e))

    def part(self, e: etree._Element) -> Part:
        return Part(**self.values(Part, e), at=self.at(e))

    def transition(self, e: etree._Element) -> TransitionTable:
        jobs = tuple(map(self.job, self.children(e).get("job", ())))
        return TransitionTable(**self.values(TransitionTable, e), jobs=jobs, at=self.at(e))
