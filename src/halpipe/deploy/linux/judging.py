"""Judgement of a Linux bundle: built, played through all modes and switches, and its recording compared."""

from __future__ import annotations

import csv
import io
import os
import shutil
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, Exit, HalpipeError
from halpipe.core.durations import ZERO, Duration
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.core.records import record
from halpipe.core.suggest import counted, few
from halpipe.deploy.base import Checked, CheckOptions, Target
from halpipe.deploy.linux import codes
from halpipe.deploy.regulator import with_tables
from halpipe.models.modes import tour
from halpipe.models.trace import Execution, Trace
from halpipe.pipeline.compare import CompareOptions, compare
from halpipe.pipeline.compare.codes import CHAIN_EXCEEDED, Kind
from halpipe.pipeline.compare.judging import Scope

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.models import Schedule, TaskModel
    from halpipe.pipeline.compare.chains import ChainRow


_COLUMNS = ("task", "job", "mode", "cycle", "start", "end", "units", "busy", "planned", "data")

MOST_CYCLES = 10_000_000
"""A year of cycles of 3 s."""

_ORDER = {
    Kind.UNKNOWN_TABLE: codes.FOREIGN_JOB,
    Kind.SEQUENCE: codes.FOREIGN_JOB,
    Kind.UNKNOWN_TASK: codes.FOREIGN_JOB,
    Kind.EXTRA: codes.FOREIGN_JOB,
    Kind.PLAN: codes.FOREIGN_JOB,
    Kind.MISSING: codes.MISSING_JOB,
    Kind.PAUSE: codes.MISSING_JOB,
    Kind.EARLY: codes.EARLY_JOB,
    Kind.ORDER: codes.WRONG_ORDER,
    Kind.NO_DATA: codes.NO_DATA,
    Kind.ENDLESS: codes.ENDLESS_JOB,
}
_TIMED = {
    **_ORDER,
    Kind.OVERLAP: codes.OVERLAP,
    Kind.EXCLUSION: codes.OVERLAP,
    Kind.LATE_END: codes.LATE_JOB,
}


@record
class Judgement:
    """Findings of a run; `start_errors` are the median, the 99th percentile and the maximum.

    `missing` and `disordered` count jobs that did not run, and that started out of order.
    """

    diagnostics: tuple[Diagnostic, ...]
    jobs: int
    missing: int
    disordered: int
    tables: int
    switches: int
    start_errors: tuple[Duration, ...]
    chains: tuple[ChainRow, ...]


def read_recording(data: bytes) -> list[Execution]:
    """Read what the dispatcher recorded, from the first instant on; raise `HalpipeError` for another form."""
    try:
        rows = list(csv.reader(io.StringIO(data.decode(), newline="")))
        if tuple(rows[0]) != _COLUMNS:
            raise ValueError("other columns")
        found = [_execution(row) for row in rows[1:]]
    except (ValueError, IndexError, csv.Error) as failure:
        text = f"the recording cannot be read: {failure}"
        raise HalpipeError(codes.NOT_RUN(text, help="export the bundle again")) from None
    if not found:
        raise HalpipeError(codes.NOT_RUN("nothing was recorded", help="let it run longer: --cycles"))
    return sorted(found, key=lambda e: (e.start.ns, e.task))


def _execution(row: Sequence[str]) -> Execution:
    if not 0 <= (cycle := int(row[3])) < MOST_CYCLES:
        raise ValueError(f"there is no cycle {cycle}")
    return Execution(
        task=row[0],
        job=int(row[1]),
        table=row[2],
        cycle=cycle,
        start=Duration(int(row[4])),
        end=Duration(int(row[5])) if row[5] else None,
        units=tuple(row[6].split()[:1]),  # the program of a gang runs on its first unit
        busy=Duration(int(row[7])) if row[7] else None,
        has_data=row[9] != "0",
        planned=Duration(int(row[8])),
    )


def judge(model: TaskModel, schedule: Schedule, recording: Sequence[Execution], *, is_timed: bool) -> Judgement:
    """Judge a recording; without `is_timed`, only whether every job ran once and in the order of its unit."""
    # A table or job whose instant is no whole number of nanoseconds begins at the nanosecond before it.
    instants = [mode.hyperperiod for mode in schedule.modes] + [table.length for table in schedule.transitions]
    instants += [job.start for job in schedule.all_jobs()]
    whole = all(instant.fraction.denominator == 1 for instant in instants)
    options = CompareOptions(origin=ZERO, tolerance=ZERO if whole else Duration(2))
    trace = Trace(name="", executions=tuple(recording))
    found = compare(schedule, trace, options, model, Scope(codes=_TIMED if is_timed else _ORDER, is_whole=True))
    # Starts are a little late, so that chains exceed their verified worst cases; what counts is the limit of the model.
    kept = (d for d in found.diagnostics if d.code != CHAIN_EXCEEDED.id or (is_timed and d.is_error))
    return Judgement(
        tuple(kept),
        len(recording),
        found.counts[Kind.MISSING],
        found.counts[Kind.ORDER],
        len(found.played),
        sum("->" in name for name in found.played.values()),
        found.starts or (ZERO, ZERO, ZERO),
        found.chains,
    )


FAULTS = 3
"""Exit status of a dispatcher that noticed a fault and kept the recording, which is judged like any other."""

_BUILD_SECONDS = 300
_SPARE_SECONDS = 30
_MOST_SWITCHES = 64
_STAY_SECONDS = 0.5
"""How long every mode is played where the user does not say."""


def check(target: Target, options: CheckOptions) -> Checked:
    """Build, run and judge a bundle; raise `HalpipeError` if that cannot be done here."""
    if options.engine not in ("auto", "native"):
        text = f'there is no engine "{options.engine}" for Linux bundles'
        raise HalpipeError(codes.NOT_RUN(text, help="use native, or auto"), exit=Exit.USAGE)
    with scratch_folder() as folder:
        built = _build(target, Path(folder))
        status, recording, said, lines = _run(target, options, built)
    words = [line.removeprefix("dispatcher: ") for line in said]
    degraded = [word.removeprefix("degraded: ") for word in words if word.startswith("degraded: ")]
    judgement = judge(target.model, target.schedule, read_recording(recording), is_timed=not degraded)
    found = list(judgement.diagnostics)
    if degraded:
        help = "run the check as root, or with CAP_SYS_NICE and CAP_IPC_LOCK, on a machine with a CPU for each unit"
        found.insert(0, codes.NOT_REAL_TIME("; ".join(degraded), at=target.bundle.at("manifest.json"), help=help))
    if status == FAULTS:  # the cause is said beside its consequences, which a busy machine has of its own
        noticed = [word for word in words if not word.startswith("degraded: ")]
        text = few(noticed, quote="") or "jobs were late or left out"
        help = "raise the WCET of the tasks that are named, or give the machine real-time rights"
        found.append(codes.FAULTS_NOTICED(text, at=target.bundle.at("manifest.json"), help=help))
    lines += _lines(judgement, bool(degraded))
    return with_tables(target, Checked(diagnostics=tuple(found), lines=tuple(lines), files={"trace": recording}))


def _lines(judgement: Judgement, is_degraded: bool) -> list[str]:
    p50, p99, most = (f"{float(value.in_unit('us')):.1f}us" for value in judgement.start_errors)
    what = "order and completeness judged" if is_degraded else "order, completeness and ends judged"
    switches = f"{judgement.switches} switch{'' if judgement.switches == 1 else 'es'}"
    return [
        f"{counted(judgement.jobs, 'job')} in {counted(judgement.tables, 'table')}, {switches}: {what}",
        f"{counted(judgement.missing, 'job')} missing, {judgement.disordered} out of order",
        f"start error: p50 {p50}, p99 {p99}, max {most}",
        *(
            f'chain "{row.chain}": {row.figure} {row.worst} at most, {row.verified} verified; {row.count} measured'
            for row in judgement.chains
            if row.worst is not None
        ),
    ]


def _build(target: Target, folder: Path) -> Path:
    """Return the folder with the built bundle."""
    at = target.bundle.at("Makefile")
    compiler = os.environ.get("CC", "cc")
    lacking = [name for name in ("make", compiler.split()[0]) if shutil.which(name) is None]
    if lacking:
        help = "install them (Debian: apt-get install build-essential), or set CC"
        raise HalpipeError(codes.NO_COMPILER(f"not found: {', '.join(lacking)}", at=at, help=help))
    for name, content in target.bundle.files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)
    help = "correct the sources, or the entry and definitions of the version, and export again"
    try:
        made = run(["make", f"CC={compiler}"], folder, seconds=_BUILD_SECONDS)
    except TimeoutExpired:
        raise HalpipeError(codes.NOT_BUILT(f"make took more than {_BUILD_SECONDS} s", at=at, help=help)) from None
    if made.returncode:
        lines = [line for line in made.stderr.splitlines() if "error" in line.lower()] or made.stderr.splitlines()
        raise HalpipeError(*(codes.NOT_BUILT(line.strip()[:300], at=at, help=help) for line in lines[:5] or ["make"]))
    return folder / "build"


def _run(target: Target, options: CheckOptions, built: Path) -> tuple[int, bytes, list[str], list[str]]:
    """Return the exit status, the recording, and the lines of standard error and output."""
    schedule = target.schedule
    longest = max(float(mode.hyperperiod.fraction) / 1e9 for mode in schedule.modes)
    asked = _tour(schedule)
    stay = max(_stay(options, len(asked) + 1, longest), 2 * longest)
    total = stay * (len(asked) + 1) + (longest if asked else 0)
    command = [str(built / "dispatcher"), "--record", str(built / "run.csv"), "--degrade", "all"]
    command += ["--seconds", f"{total:.6f}"]
    for index, mode in enumerate(asked, 1):  # at ever other phases of the tables
        command += ["--switch", f"{index * (stay + longest / (len(asked) + 1)):.6f}={mode}"]
    at = target.bundle.at("manifest.json")
    help = "run build/dispatcher by hand to see what happens"
    try:
        ran = run(command, built, seconds=total + _SPARE_SECONDS)
    except TimeoutExpired:
        text = f"it did not end {_SPARE_SECONDS} s after the {total:.1f} s that it was to run"
        raise HalpipeError(codes.NOT_RUN(text, at=at, help=help)) from None
    said = ran.stderr.splitlines()
    if ran.returncode not in (0, FAULTS) or not (built / "run.csv").is_file():
        last = said[-1][:300] if said else "it says nothing"
        raise HalpipeError(codes.NOT_RUN(f"exit code {ran.returncode}: {last}", at=at, help=help))
    return ran.returncode, (built / "run.csv").read_bytes(), said, ran.stdout.splitlines()[1:]


def _stay(options: CheckOptions, stays: int, longest: float) -> float:
    """Return for how many seconds every mode of a tour is played."""
    if options.seconds:
        return float(options.seconds) / stays
    return options.cycles * longest if options.cycles else max(_STAY_SECONDS, 3 * longest)


def _tour(schedule: Schedule) -> list[str]:
    """Return the modes to ask for, one after the other, so that every switch is taken that can be reached."""
    switches = dict.fromkeys((table.source, table.target) for table in schedule.transitions)
    return list(islice(tour(schedule.modes[0].name, schedule.transitions, switches), _MOST_SWITCHES))
