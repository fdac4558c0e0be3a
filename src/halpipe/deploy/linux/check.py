"""Builds a bundle in a folder of its own, runs it through all modes and switches, and has the recording judged."""

from __future__ import annotations

import os
import shutil
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.programs import TimeoutExpired, run
from halpipe.deploy.base import Checked
from halpipe.deploy.linux import codes
from halpipe.deploy.linux.judging import Judgement, judge, read_recording

if TYPE_CHECKING:
    from halpipe.deploy.base import CheckOptions, Target
    from halpipe.models import Schedule

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
        recording, said, lines = _run(target, options, built)
    degraded = [line.removeprefix("dispatcher: degraded: ") for line in said if "degraded: " in line]
    judgement = judge(target.model, target.schedule, read_recording(recording), is_timed=not degraded)
    found = list(judgement.diagnostics)
    if degraded:
        help = "run the check as root, or with CAP_SYS_NICE and CAP_IPC_LOCK, on a machine with a CPU for each unit"
        found.insert(0, codes.NOT_REAL_TIME("; ".join(degraded), at=target.bundle.at("manifest.json"), help=help))
    return Checked(
        diagnostics=tuple(found), lines=(*lines, *_lines(judgement, bool(degraded))), files={"trace": recording}
    )


def _lines(judgement: Judgement, is_degraded: bool) -> list[str]:
    p50, p99, most = (f"{float(value.in_unit('us')):.1f}us" for value in judgement.start_errors)
    what = "order and completeness judged" if is_degraded else "order, completeness and ends judged"
    return [
        f"{judgement.jobs} jobs in {judgement.tables} tables, {judgement.switches} switches: {what}",
        f"{judgement.missing} jobs missing, {judgement.disordered} out of order",
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


def _run(target: Target, options: CheckOptions, built: Path) -> tuple[bytes, list[str], list[str]]:
    """Return what was recorded, and the lines of standard error and output."""
    schedule = target.schedule
    longest = max(float(mode.hyperperiod.fraction) / 1e9 for mode in schedule.modes)
    tour = _tour(schedule)
    stay = max(_stay(options, len(tour) + 1, longest), 2 * longest)
    total = stay * (len(tour) + 1) + (longest if tour else 0)
    command = [str(built / "dispatcher"), "--record", str(built / "run.csv"), "--degrade", "all"]
    command += ["--seconds", f"{total:.6f}"]
    for index, mode in enumerate(tour, 1):  # at ever other phases of the tables
        command += ["--switch", f"{index * (stay + longest / (len(tour) + 1)):.6f}={mode}"]
    at = target.bundle.at("manifest.json")
    help = "run build/dispatcher by hand to see what happens"
    try:
        ran = run(command, built, seconds=total + _SPARE_SECONDS)
    except TimeoutExpired:
        text = f"it did not end {_SPARE_SECONDS} s after the {total:.1f} s that it was to run"
        raise HalpipeError(codes.NOT_RUN(text, at=at, help=help)) from None
    said = ran.stderr.splitlines()
    if ran.returncode or not (built / "run.csv").is_file():
        last = said[-1][:300] if said else "it says nothing"
        raise HalpipeError(codes.NOT_RUN(f"exit code {ran.returncode}: {last}", at=at, help=help))
    return (built / "run.csv").read_bytes(), said, ran.stdout.splitlines()[1:]


def _stay(options: CheckOptions, stays: int, longest: float) -> float:
    """Return for how many seconds every mode of a tour is played."""
    if options.seconds:
        return float(options.seconds) / stays
    return options.cycles * longest if options.cycles else max(_STAY_SECONDS, 3 * longest)


def _tour(schedule: Schedule) -> list[str]:
    """Return the modes to ask for, one after the other, so that every switch is taken that can be reached."""
    ways = [(table.source, table.target) for table in schedule.transitions]
    here, left = schedule.modes[0].name, set(ways)
    tour: list[str] = []
    while left and len(tour) < _MOST_SWITCHES:
        path = _path(here, left, ways)
        if path is None:
            break
        for step in path[:-1]:
            left.discard((here, step))
            tour.append(step)
            here = step
        left.discard((here, path[-1]))
        tour.append(path[-1])
        here = path[-1]
    return tour[:_MOST_SWITCHES]


def _path(here: str, left: set[tuple[str, str]], ways: list[tuple[str, str]]) -> list[str] | None:
    """Return the shortest way from a mode that ends with a switch of `left`."""
    rest: deque[tuple[str, list[str]]] = deque([(here, [])])
    seen = {here}
    while rest:
        mode, path = rest.popleft()
        for source, end in ways:
            if source == mode and (source, end) in left:
                return [*path, end]
        for source, end in ways:
            if source == mode and end not in seen:
                seen.add(end)
                rest.append((end, [*path, end]))
    return None
