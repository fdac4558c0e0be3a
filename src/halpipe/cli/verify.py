"""``halpipe verify``."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, ScheduleFile, Verbose
from halpipe.core.diagnostics import Exit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Diagnostic

_CODES = "HAL03"
"""The beginning of the codes of verify, and of no others."""
NAMED = 3
"""Further findings of a task that are named; --verbose shows all of them."""


def verify(
    model: ModelFile,
    schedule: ScheduleFile,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Check a schedule, from any tool, against its model: every violation with job, rule, amount and instant."""
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.checked import verify_schedule

    output.choose(format, quiet=quiet, verbose=verbose)
    system, tables = read_model(model), read_schedule(schedule)
    found = verify_schedule(system, tables)
    output.report(gathered(found) if output.is_brief() else found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        jobs = sum(len(mode.jobs) for mode in tables.modes)
        output.result(f"{schedule}: valid; {len(tables.modes)} modes, {jobs} jobs, no violation")
    return Exit.OK


def gathered(found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Gather findings for people: one for all jobs of a task that break one rule, and one for all figures.

    Figures come last where something else is wrong, too: they follow from it. Findings of other origin stay.
    """
    if not any(each.code.startswith(_CODES) for each in found):
        return list(found)
    from halpipe.pipeline.verify.codes import WRONG_FIGURE

    figures = [each for each in found if each.code == WRONG_FIGURE.id]
    others = [each for each in found if each.code != WRONG_FIGURE.id]
    groups: dict[tuple[str, str], list[Diagnostic]] = defaultdict(list)
    for number, each in enumerate(others):
        tasks = [subject.name for subject in each.subjects if subject.kind == "task"]
        task = tasks[0] if tasks and each.code.startswith(_CODES) else f"{number}"
        groups[each.code, task].append(each)
    shown = [_as_one(group) for group in groups.values()]
    if figures and any(each.is_error for each in others):
        help = "fix the violations of the jobs first: loads, latencies and cost follow from them"
        return [*shown, replace(_as_one(figures), help=help)]
    return [*shown, *figures]


def _as_one(group: Sequence[Diagnostic]) -> Diagnostic:
    """Return the first of several findings, with the number and some paths of the others."""
    first, *rest = group
    if not rest:
        return first
    named = ", ".join(each.path for each in rest[:NAMED]) + (" ..." if len(rest) > NAMED else "")
    return replace(first, message=f"{first.message}; {len(rest)} more like it: {named}")
