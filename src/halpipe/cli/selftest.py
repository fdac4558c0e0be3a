"""``halpipe selftest``."""

from __future__ import annotations

from typing import Annotated

import typer

from halpipe.cli import output
from halpipe.cli.parameters import Quiet, Seed
from halpipe.core.diagnostics import Exit

_SHOWN = 20


def selftest(
    mutants: Annotated[int, typer.Option(min=1, help="Faulty schedules that both checkers judge.")] = 300,
    seed: Seed = 1,
    evidence: Annotated[
        str, typer.Option(metavar="DIR", help="Write a folder for the argument of a tool's confidence.")
    ] = "",
    results: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE", help="JUnit XML of a run of the tests, for the evidence; repeatable."),
    ] = None,
    quiet: Quiet = False,
) -> int:
    """Have two independent checkers judge valid and faulty schedules, and count where they do not agree."""
    from halpipe.selftest import run

    output.choose(None, quiet=quiet, verbose=False)
    if results and not evidence:
        raise typer.BadParameter("results of tests are for the evidence; add --evidence", param_hint="--results")
    failed = 0
    if evidence:
        from halpipe.core.files import write_directory
        from halpipe.selftest.evidence import folder
        from halpipe.selftest.requirements import read_results

        found = read_results(results or ())
        outcome = run(mutants, seed)
        write_directory(evidence, folder(outcome, mutants, seed, found))
        failed = sum(int(file["failed"]) for file in found.files)
    else:
        outcome = run(mutants, seed)
    if failed:
        output.result(f"{failed} case{'s' * (failed > 1)} of the tests failed by the results given")
    for line in outcome.differing[:_SHOWN]:
        output.result(line)
    counts = f"{outcome.valid} valid, {outcome.broken} not valid"
    for rule in outcome.unseen:
        output.result(f'no schedule shows that rule "{rule}" of verify is at work')
    shown = len(outcome.alone) - len(outcome.unseen)
    output.result(f"{shown} of {len(outcome.alone)} rules of verify each refuse a schedule that no other one refuses")
    total = outcome.valid + outcome.broken
    output.result(f"{total} schedules, {counts}; the checkers disagree on {len(outcome.differing)}")
    return Exit.FINDINGS if outcome.differing or outcome.unseen or failed else Exit.OK
