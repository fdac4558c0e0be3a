"""Fills WCETs from measured durations: an exact order statistic of the samples, and a margin on top.

The quantile q of n samples is the smallest of them that at least q * n samples do not exceed: the one at rank
ceil(q * n), without interpolation; 1 is the maximum. It is an observation, not a bound: what was not measured may take
longer, which is what the margin is for.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Location, Severity, about
from halpipe.core.durations import Duration
from halpipe.core.files import read_bytes
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean
from halpipe.importers.ros import codes
from halpipe.importers.ros.feedback import few
from halpipe.importers.ros.sources.measured import Measurements, read_measured
from halpipe.importers.ros.traced import measure
from halpipe.importers.traces.ctf import folders
from halpipe.importers.traces.ros2 import read_ros_trace
from halpipe.models import Origin

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from fractions import Fraction

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.common.base import Coverage
    from halpipe.importers.ros.options import RosImportOptions
    from halpipe.importers.ros.sources.graph import Callback
    from halpipe.importers.ros.sources.measured import Sample
    from halpipe.importers.traces.ros2 import RosTrace
    from halpipe.models import Task, TaskModel

FEWEST_SAMPLES = 10
"""With fewer executions than this, even the maximum says little."""


@record
class Estimate:
    """What the samples of a task give: the WCET, the sample that decided it, and the words that say how."""

    wcet: Duration
    sample: Sample
    words: str
    count: int


def calibrate(
    model: TaskModel,
    tasks_of: Mapping[str, str],
    callbacks: Sequence[Callback],
    trace: RosTrace | None,
    options: RosImportOptions,
    findings: Findings,
    coverage: Coverage,
) -> TaskModel:
    """Return `model` with the WCETs that the files of `options.calibrate`, and the trace of the import, give.

    `tasks_of` has the task of every name that the files may use for it. Rows that cannot be read are errors.
    """
    if not options.calibrate and trace is None:
        return model
    measured = Measurements()
    if trace is not None:
        measure(trace, callbacks, measured, findings)
    for file in options.calibrate:
        if folders(file):
            measure(read_ros_trace(file, findings), callbacks, measured, findings)
        else:
            read_measured(read_bytes(file), file, measured, findings)
    findings.stop_on_errors()
    aliases = {**tasks_of, **{task.name: task.name for task in model.tasks}}
    first = trace.file if trace is not None else options.calibrate[0]
    samples = _by_task(measured, aliases, first, findings, coverage)
    tasks = tuple(_calibrated(task, samples.get(task.name, []), options, findings) for task in model.tasks)
    _report_unmeasured(model, samples, first, findings)
    return replace(model, tasks=tasks)


def estimate(samples: Sequence[Sample], quantile: Fraction, margin: Fraction) -> Estimate:
    """Return the WCET from at least one sample, rounded up to whole nanoseconds where a margin makes fractions."""
    rank = max(1, math.ceil(quantile * len(samples)))
    sample = sorted(samples, key=lambda found: found.ns)[rank - 1]
    how = "maximum" if quantile == 1 else f"quantile {format_rational(quantile)}"
    words = f"{how} of {len(samples)} sample{'s' if len(samples) > 1 else ''}"
    if margin:
        words += f", {Duration(sample.ns)}, with a margin of {format_rational(margin)} of it"
    return Estimate(Duration(math.ceil(sample.ns * (1 + margin))), sample, words, len(samples))


def _by_task(
    measured: Measurements, aliases: Mapping[str, str], file: str, findings: Findings, coverage: Coverage
) -> dict[str, list[Sample]]:
    samples: dict[str, list[Sample]] = {}
    strangers = []
    for callback, found in measured.samples.items():
        if callback in aliases:
            coverage.mapped("measured_callback")
            samples.setdefault(aliases[callback], []).extend(found)
        else:
            strangers.append(callback)
            coverage.ignored("measured_callback", callback, "no task has this name", found[0].at)
    if strangers:
        text = f"{len(strangers)} measured callbacks are no tasks: {few(strangers)}"
        help = did_you_mean(strangers[0], sorted(aliases), "use the names of callbacks or tasks")
        at = measured.samples[strangers[0]][0].at
        findings.add(codes.MEASURED_STRANGER(text, at=at, help=help))
    return samples


def _calibrated(task: Task, samples: Sequence[Sample], options: RosImportOptions, findings: Findings) -> Task:
    if not samples:
        return task
    path = about(task=task.name)
    found = estimate(samples, options.quantile, options.margin)
    at = found.sample.at
    several = len(task.versions) > 1 and any(version.wcet is not None for version in task.versions)
    if several or not found.wcet:
        reason = "it has several versions with WCETs" if several else "every sample that counts is zero"
        text, help = f"its measurements are not used: {reason}", "state its WCETs in an overlay"
        findings.add(codes.UNMEASURED(text, at=at, path=path, help=help))
        return task
    _report_few(found, options.quantile, path, findings)
    findings.add(codes.CALIBRATED(f"WCET {found.wcet}: {found.words}", at=at, path=path))
    origin = Origin(at.file, at.line, found.words)
    return replace(task, versions=tuple(replace(v, wcet=found.wcet, origin=origin) for v in task.versions))


def _report_few(found: Estimate, quantile: Fraction, path: str, findings: Findings) -> None:
    needed = FEWEST_SAMPLES if quantile == 1 else max(FEWEST_SAMPLES, math.ceil(1 / (1 - quantile)))
    if found.count < needed:
        effect = "" if quantile == 1 or math.ceil(quantile * found.count) < found.count else ", so it is the maximum"
        text = f"{found.words}: fewer than {needed}{effect}"
        help = "measure longer, or add a --margin"
        findings.add(codes.FEW_SAMPLES(text, at=found.sample.at, path=path, help=help))


def _report_unmeasured(model: TaskModel, samples: Mapping[str, object], file: str, findings: Findings) -> None:
    left = [t.name for t in model.tasks if t.name not in samples and any(v.wcet is None for v in t.versions)]
    if left:
        text = f"{len(left)} tasks have no measurement and no WCET: {few(left)}"
        help = "record them too, or state their WCETs in an overlay"
        findings.add(codes.UNMEASURED(text, at=Location(file), help=help, severity=Severity.NOTE))
