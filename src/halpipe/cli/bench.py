"""``halpipe bench``."""

from __future__ import annotations

import platform
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from halpipe import __version__
from halpipe.cli import output, streams
from halpipe.cli.parameters import DiagnosticFormat, Quiet, Verbose
from halpipe.cli.processors import processor_count
from halpipe.core.diagnostics import Exit
from halpipe.core.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.bench import Report, Row
    from halpipe.bench.instance import Instance

JOURNAL = "journal.jsonl"


def bench(
    suite: Annotated[
        str, typer.Argument(metavar="SUITE", help="table3 (the paper's), hard, harder, real (as published), or tiny.")
    ],
    folder: Annotated[str, typer.Option("--output", "-o", metavar="FOLDER", help="Where table, plot and results go.")],
    row: Annotated[list[str] | None, typer.Option(help="Only rows whose names contain this; repeatable.")] = None,
    model: Annotated[
        list[str] | None, typer.Option(metavar="FILE", help="A row for this model as well, as imported; repeatable.")
    ] = None,
    seeds: Annotated[int, typer.Option(min=1, help="Sets of each cell.")] = 20,
    first_seed: Annotated[int, typer.Option(min=0, help="Seed of the first set.")] = 101,
    budget: Annotated[int, typer.Option(min=1, help="Moves per task before a search gives up.")] = 20_000,
    limit: Annotated[
        int, typer.Option(min=0, help="Seconds before a search is stopped (0: none); this depends on the machine.")
    ] = 120,
    jobs: Annotated[int, typer.Option(min=1, help="Processes; more than one disturb each other's times.")] = 1,
    workers: Annotated[int, typer.Option(min=1, help="Threads of each search; its result is the same.")] = 1,
    cluster: Annotated[str, typer.Option(metavar="ADDRESS", help="Run on this dask.distributed scheduler.")] = "",
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a run that was killed.")] = False,
    exact_seconds: Annotated[
        int,
        typer.Option(min=0, help="Give sets to CP-SAT, and PyJobShop if installed, for this long each."),
    ] = 0,
    exact_seeds: Annotated[int, typer.Option(min=1, help="How many sets of each cell CP-SAT gets.")] = 1,
    exact_workers: Annotated[int, typer.Option(min=1, help="Threads of CP-SAT.")] = 2,
    format: DiagnosticFormat = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> int:
    """Measure success and run time on generated task sets; write a table, a plot and every single result.

    Every finished set is kept in a journal, so that a killed run goes on with --resume.
    """
    from halpipe.bench.render import outputs
    from halpipe.bench.results import instances
    from halpipe.core.files import write_outputs

    output.choose(format, quiet=quiet, verbose=verbose)
    rows = _rows(suite, row or [], model or [])
    work = instances(
        rows, range(first_seed, first_seed + seeds), budget=budget, limit=limit, workers=workers,
        exact_seconds=exact_seconds, exact_seeds=exact_seeds, exact_workers=exact_workers,
    )  # fmt: skip
    about = {
        "command": "halpipe " + " ".join(sys.argv[1:]),
        "version": __version__,
        "seeds": f"{first_seed}..{first_seed + seeds - 1}",
        "budget": budget,
        "limit": f"{limit} s",
        "workers": workers,
        "exact": f"{exact_seconds} s, {exact_workers} threads" if exact_seconds else "not run",
        "pyjobshop": _version_of("pyjobshop") if exact_seconds else "not run",
        "machine": _machine(jobs, cluster),
    }
    _refuse_foreign(Path(folder))
    report = _measure(suite, rows, work, about, Path(folder), jobs, cluster, resume=resume)
    write_outputs({str(Path(folder, name)): content for name, content in outputs(report).items()})
    Path(folder, JOURNAL).unlink()
    return _summarise(report, folder)


def _refuse_foreign(folder: Path) -> None:
    """Stop before anything is measured if the results would replace what no benchmark wrote."""
    from halpipe.bench.render import NAMES, RESULTS
    from halpipe.core.files import refuse_foreign

    refuse_foreign(str(folder / RESULTS), lambda content: b'"results_sha256"' in content)
    for name in NAMES if not (folder / RESULTS).exists() else ():
        refuse_foreign(str(folder / name), lambda content: False)


def _rows(suite: str, wanted: Sequence[str], models: Sequence[str]) -> list[Row]:
    from halpipe.bench import SUITES, given_rows

    if suite not in SUITES:
        hint = did_you_mean(suite, sorted(SUITES), "there are: " + ", ".join(sorted(SUITES)))
        raise typer.BadParameter(f'no suite "{suite}"; {hint}', param_hint="SUITE")
    known = (*SUITES[suite], *given_rows(models))
    rows = [row for row in known if not wanted or any(part in row.name for part in wanted)]
    if not rows:
        names = "; ".join(row.name for row in known)
        raise typer.BadParameter(f"no row of {suite} has that in its name; the rows are: {names}", param_hint="--row")
    return rows


def _machine(jobs: int, cluster: str) -> dict[str, Any]:
    """Say on what the times were measured; without names that identify the machine."""
    return {
        "processor": _processor(),
        "processors": processor_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "executor": "dask.distributed" if cluster else f"{jobs} process{'es' if jobs > 1 else ''}",
    }


def _version_of(package: str) -> str:
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(package)
    except PackageNotFoundError:
        return f"not installed: pip install {package}"


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return platform.processor()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")


def _measure(
    suite: str,
    rows: Sequence[Row],
    work: Sequence[Instance],
    about: dict[str, Any],
    folder: Path,
    jobs: int,
    cluster: str,
    *,
    resume: bool,
) -> Report:
    """Measure what the journal does not hold yet, and sum up."""
    from halpipe.bench import measure, report
    from halpipe.pipeline.solve.run import Journal, map_tasks

    options = {name: about[name] for name in ("version", "seeds", "budget", "limit", "exact")}
    header = {"suite": suite, "rows": [row.name for row in rows], **options}
    with Journal(str(folder / JOURNAL), header, resume=resume) as journal:
        output.report(journal.warnings)
        known = {instance.key for instance in work}
        done = {record["key"]: record for record in journal.records if record.get("key") in known}
        waiting = [instance for instance in work if instance.key not in done]
        if done:
            output.inform(f"{len(done)} of {len(work)} sets are finished already")
        begin = time.monotonic()
        for count, (_, record) in enumerate(map_tasks(measure, waiting, jobs=jobs, cluster=cluster), 1):
            journal.add(record)
            done[record["key"]] = record
            _show(record, count, len(waiting), time.monotonic() - begin)
    ordered = {instance.key: done[instance.key] for instance in work}
    return report(suite, rows, ordered, about)


def _show(record: dict[str, Any], count: int, total: int, seconds: float) -> None:
    left = seconds / count * (total - count)
    if streams.is_terminal(sys.stderr) or output.Settings.verbose:
        output.inform(f"{count}/{total} {record['key']}: {record['result']['outcome']} ({left:.0f} s to go)")


def _summarise(report: Report, folder: str) -> int:
    from halpipe.bench.render import duration_text

    for row in report.rows:
        median = "no times" if row.kernel_ns is None else f"kernel {duration_text(row.kernel_ns.median)}"
        output.inform(f"{row.row.name}: {row.solved} of {len(row.records)} solved, {median}")
    output.inform(f"{folder}: table.md, plot.svg, index.html, results.json; results {report.results_sha256[:16]}")
    for fault in report.faults:
        output.say(f"fault: {fault}")
    return Exit.FINDINGS if report.faults else Exit.OK
