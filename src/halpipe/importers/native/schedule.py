"""Reader of the schedule XML (schema schedule-1.xsd)."""

from __future__ import annotations

from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.diagnostics import HalpipeError
from halpipe.durations import ZERO
from halpipe.files import parse_xml, read_bytes
from halpipe.importers.native.binding import Binder
from halpipe.models import (
    ChainLatency,
    CostTerms,
    Job,
    ModeSchedule,
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
        return Schedule(
            model=self.text(root, "model"),
            model_sha256=self.text(root, "model-sha256").strip(),
            generator=self.text(root, "generator"),
            solver=self.text(root, "solver"),
            seed=None if root.get("seed") is None else self.integer(root, "seed"),
            tick=self.optional_duration(root, "tick"),
            modes=tuple(self.mode(e) for e in self.children(root, "mode")),
            transitions=tuple(self.transition(e) for e in self.children(root, "transition")),
            at=self.at(root),
        )

    def mode(self, e: etree._Element) -> ModeSchedule:
        cost = self.child(e, "cost")
        return ModeSchedule(
            name=self.text(e, "name"),
            hyperperiod=self.duration(e, "hyperperiod", ZERO),
            status=Status(self.text(e, "status").strip()),
            jobs=tuple(self.job(j) for j in self.children(e, "job")),
            cost=None if cost is None else self.cost(cost),
            unit_loads=tuple(self.unit_load(u) for u in self.children(e, "unit-load")),
            resource_loads=tuple(self.resource_load(r) for r in self.children(e, "resource-load")),
            chains=tuple(self.chain(c) for c in self.children(e, "chain")),
            at=self.at(e),
        )

    def job(self, e: etree._Element) -> Job:
        return Job(
            task=self.text(e, "task"),
            index=self.integer(e, "index"),
            start=self.duration(e, "start", ZERO),
            end=self.duration(e, "end", ZERO),
            version=self.text(e, "version"),
            units=self.names(e, "units"),
            at=self.at(e),
        )

    def cost(self, e: etree._Element) -> CostTerms:
        return CostTerms(
            total=self.rational(e, "total", NONE),
            overlap=self.rational(e, "overlap", NONE),
            access=self.rational(e, "access", NONE),
            precedence=self.rational(e, "precedence", NONE),
            unit=self.rational(e, "unit", NONE),
            occupancy=self.rational(e, "occupancy", NONE),
            timeliness=self.rational(e, "timeliness", NONE),
        )

    def unit_load(self, e: etree._Element) -> UnitLoad:
        busy, share = self.duration(e, "busy", ZERO), self.rational(e, "share", NONE)
        return UnitLoad(unit=self.text(e, "unit"), busy=busy, share=share)

    def resource_load(self, e: etree._Element) -> ResourceLoad:
        peak, mean = self.rational(e, "peak", NONE), self.rational(e, "mean", NONE)
        return ResourceLoad(resource=self.text(e, "resource"), peak=peak, mean=mean)

    def chain(self, e: etree._Element) -> ChainLatency:
        reaction, age = self.optional_duration(e, "reaction"), self.optional_duration(e, "age")
        return ChainLatency(name=self.text(e, "name"), reaction=reaction, age=age)

    def transition(self, e: etree._Element) -> TransitionTable:
        return TransitionTable(
            source=self.text(e, "from"),
            target=self.text(e, "to"),
            length=self.duration(e, "length", ZERO),
            worst_latency=self.duration(e, "worst-latency", ZERO),
            status=Status(self.text(e, "status").strip()),
            jobs=tuple(self.job(j) for j in self.children(e, "job")),
            at=self.at(e),
        )
