"""Reader of the schedule XML (schema schedule-1.xsd)."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.durations import ZERO
from halpipe.files import parse_xml, read_bytes
from halpipe.importers.native.binding import Binder, duration, only, rational
from halpipe.models import (
    ChainLatency,
    CostTerms,
    HealthAction,
    HealthEvent,
    Job,
    ModeSchedule,
    Part,
    Reaction,
    ResourceLoad,
    Schedule,
    Status,
    TransitionTable,
    UnitLoad,
)
from halpipe.schemas import SCHEDULE, check, namespace

if TYPE_CHECKING:
    from lxml import etree

NONE = Fraction(0)


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
    bind = _ScheduleBinder(file, namespace(SCHEDULE))
    schedule = bind.schedule(root)
    bind.findings.stop_on_errors()
    return schedule


class _ScheduleBinder(Binder):
    """One method per element type, in the order of the schema."""

    def schedule(self, root: etree._Element) -> Schedule:
        parts = self.children(root)
        return Schedule(
            model=root.get("model", ""),
            model_sha256=root.get("model-sha256", "").strip(),
            generator=root.get("generator", ""),
            solver=root.get("solver", ""),
            seed=self.read(root, "seed", int, None),
            tick=self.read(root, "tick", duration, None),
            modes=tuple(map(self.mode, parts.get("mode", ()))),
            transitions=tuple(map(self.transition, parts.get("transition", ()))),
            reactions=tuple(map(self.reaction, parts.get("reaction", ()))),
            at=self.at(root),
        )

    def mode(self, e: etree._Element) -> ModeSchedule:
        parts = self.children(e)
        cost = only(parts, "cost")
        return ModeSchedule(
            name=e.get("name", ""),
            hyperperiod=self.read(e, "hyperperiod", duration, ZERO),
            status=Status(e.get("status", "").strip()),
            jobs=tuple(map(self.job, parts.get("job", ()))),
            cost=None if cost is None else self.cost(cost),
            unit_loads=tuple(map(self.unit_load, parts.get("unit-load", ()))),
            resource_loads=tuple(map(self.resource_load, parts.get("resource-load", ()))),
            chains=tuple(map(self.chain, parts.get("chain", ()))),
            at=self.at(e),
        )

    def job(self, e: etree._Element) -> Job:
        return Job(
            task=e.get("task", ""),
            index=self.read(e, "index", int, 0),
            start=self.read(e, "start", duration, ZERO),
            end=self.read(e, "end", duration, ZERO),
            version=e.get("version", ""),
            units=self.names(e, "units"),
            parts=tuple(map(self.part, self.children(e).get("part", ()))),
            at=self.at(e),
        )

    def part(self, e: etree._Element) -> Part:
        return Part(
            start=self.read(e, "start", duration, ZERO),
            end=self.read(e, "end", duration, ZERO),
            executed_from=self.read(e, "from", duration, ZERO),
            executed_to=self.read(e, "to", duration, ZERO),
            at=self.at(e),
        )

    def cost(self, e: etree._Element) -> CostTerms:
        return CostTerms(
            total=self.read(e, "total", rational, NONE),
            overlap=self.read(e, "overlap", rational, NONE),
            access=self.read(e, "access", rational, NONE),
            precedence=self.read(e, "precedence", rational, NONE),
            unit=self.read(e, "unit", rational, NONE),
            occupancy=self.read(e, "occupancy", rational, NONE),
            timeliness=self.read(e, "timeliness", rational, NONE),
        )

    def unit_load(self, e: etree._Element) -> UnitLoad:
        busy, share = self.read(e, "busy", duration, ZERO), self.read(e, "share", rational, NONE)
        return UnitLoad(unit=e.get("unit", ""), busy=busy, share=share)

    def resource_load(self, e: etree._Element) -> ResourceLoad:
        peak, mean = self.read(e, "peak", rational, NONE), self.read(e, "mean", rational, NONE)
        return ResourceLoad(resource=e.get("resource", ""), peak=peak, mean=mean)

    def chain(self, e: etree._Element) -> ChainLatency:
        reaction, age = self.read(e, "reaction", duration, None), self.read(e, "age", duration, None)
        return ChainLatency(name=e.get("name", ""), reaction=reaction, age=age)

    def transition(self, e: etree._Element) -> TransitionTable:
        return TransitionTable(
            source=e.get("from", ""),
            target=e.get("to", ""),
            length=self.read(e, "length", duration, ZERO),
            worst_latency=self.read(e, "worst-latency", duration, ZERO),
            status=Status(e.get("status", "").strip()),
            jobs=tuple(map(self.job, self.children(e).get("job", ()))),
            at=self.at(e),
        )

    def reaction(self, e: etree._Element) -> Reaction:
        return Reaction(
            mode=e.get("mode", ""),
            task=e.get("task", ""),
            event=HealthEvent(e.get("on", "").strip()),
            count=self.read(e, "count", int, 1),
            cycles=self.read(e, "cycles", int, 1),
            action=HealthAction(e.get("action", "").strip()),
            target=e.get("to", ""),
            within=self.read(e, "within", duration, None),
            at=self.at(e),
        )
