"""Reader of the schedule XML (schema schedule-1.xsd)."""

from __future__ import annotations

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import parse_xml, read_bytes, refuse_more_than
from halpipe.importers.native.binding import Binder
from halpipe.models import Schedule
from halpipe.schemas import SCHEDULE, check, line_of, namespace

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
    bind = Binder(file, namespace(SCHEDULE))
    schedule: Schedule = bind.element(Schedule, root)
    bind.findings.stop_on_errors()
    return schedule
