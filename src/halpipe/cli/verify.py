"""``halpipe verify``."""

from __future__ import annotations

from halpipe.cli import output
from halpipe.cli.parameters import DiagnosticFormat, ModelFile, Quiet, ScheduleFile, Verbose
from halpipe.diagnostics import Exit


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
    output.report(found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        jobs = sum(len(mode.jobs) for mode in tables.modes)
        output.result(f"{schedule}: valid; {len(tables.modes)} modes, {jobs} jobs, no violation")
    return Exit.OK
