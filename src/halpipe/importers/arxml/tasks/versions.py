"""Versions of tasks: one for each execution time that differs between the units a task may run on."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import about
from halpipe.core.durations import ZERO
from halpipe.core.records import record
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.meaning_codes import BUDGETS
from halpipe.importers.arxml.names import legal_name, listed, unique_name
from halpipe.importers.arxml.options import BUDGET
from halpipe.importers.arxml.system.execution_times import ANALYSED
from halpipe.importers.arxml.tasks.splitting import Splitter
from halpipe.models import WHOLE

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.core.diagnostics import Findings, Location
    from halpipe.core.durations import Duration
    from halpipe.importers.arxml.options import ArxmlImportOptions
    from halpipe.importers.arxml.system.values import ExecutionTime, Place, System
    from halpipe.importers.arxml.tasks.dataflow import Actor
    from halpipe.importers.arxml.tasks.grouping import Draft
    from halpipe.importers.arxml.tasks.platform import Platform
    from halpipe.models import Split

VERSION = "default"


@record
class Variant:
    """A version to be: its name, its WCET (None: unknown), its units, and the execution times that it comes from."""

    name: str
    wcet: Duration | None
    units: tuple[str, ...]
    times: tuple[ExecutionTime, ...] = ()
    split: Split = WHOLE


def make_variants(
    system: System, drafts: Sequence[Draft], platform: Platform, options: ArxmlImportOptions, findings: Findings
) -> dict[str, tuple[Variant, ...]]:
    """Return the versions of every task, by its name.

    The jobs of an OsTask that is preemptive may be interrupted between its runnables, and within long ones.
    """
    times: dict[str, dict[str | None, ExecutionTime]] = {}
    for time in system.execution_times:
        times.setdefault(time.runnable, {})[time.hardware] = time
    splitter = Splitter(options)
    variants = {draft.name: _variants(draft, platform, times, splitter) for draft in drafts}
    if options.wcet == BUDGET:
        variants |= _budgets(drafts, variants, splitter, findings)
    splitter.report(findings)
    _report_units(drafts, variants, platform, findings)
    return variants


def _budgets(
    drafts: Sequence[Draft], variants: dict[str, tuple[Variant, ...]], splitter: Splitter, findings: Findings
) -> dict[str, tuple[Variant, ...]]:
    """Return versions with the execution budget of the OsTask, for tasks of which no execution time is stated.

    It bounds each call of the OsTask, too, though several tasks of one OsTask are then longer than it together.
    """
    found: dict[str, tuple[Variant, ...]] = {}
    for draft in drafts:
        budget = draft.os_task.budget if draft.os_task else None
        (first, *_) = variants[draft.name]
        if budget is not None and first.wcet is None:
            split = splitter.split(draft, [budget])
            found[draft.name] = (Variant(VERSION, budget, first.units, split=split),)
    if found:
        message = f"the execution budgets of OsTasks are the WCETs of {len(found)} tasks: {listed(list(found))}"
        first_of = next(draft for draft in drafts if draft.name in found)
        findings.add(BUDGETS(message, at=first_of.place.at))
    return found


def used_times(variants: dict[str, tuple[Variant, ...]]) -> list[Place]:
    """Return the execution times that versions were made of."""
    return [time.place for found in variants.values() for variant in found for time in variant.times]


def report_kinds(variants: dict[str, tuple[Variant, ...]], at: Location, findings: Findings) -> None:
    """Report how many execution times are no analysed bounds."""
    places = dict.fromkeys(place for place in used_times(variants) if place.kind != ANALYSED)
    if places:
        kinds = sorted({place.kind for place in places})
        findings.add(codes.NOT_ANALYSED(f"{len(places)} execution times are of the kinds {', '.join(kinds)}", at=at))


def _variants(
    draft: Draft, platform: Platform, times: dict[str, dict[str | None, ExecutionTime]], splitter: Splitter
) -> tuple[Variant, ...]:
    units = platform.units_of(draft)
    runnables: dict[Actor, list[str]] = {}
    for member in draft.members:
        runnables.setdefault(member.work, []).append(member.name)
    groups: dict[tuple[Duration, Split], list[tuple[str, tuple[ExecutionTime, ...]]]] = {}
    for unit in units:
        found = [_time(times.get(path, {}), platform.hardware.get(unit)) for _, path in runnables]
        known = tuple(time for time in found if time is not None)
        pieces = [
            splitter.stated(draft, names) if time is None else time.time
            for time, names in zip(found, runnables.values(), strict=True)
        ]
        lengths = [piece for piece in pieces if piece is not None]
        if len(lengths) == len(pieces):
            key = (sum(lengths, ZERO), splitter.split(draft, lengths))
            groups.setdefault(key, []).append((unit, known))
    if not groups:
        return (Variant(VERSION, None, units, split=splitter.split(draft, ())),)
    taken: set[str] = set()
    return tuple(
        Variant(
            unique_name(_name(found[0][1]) if len(groups) > 1 else VERSION, taken),
            wcet,
            tuple(unit for unit, _ in found),
            tuple(dict.fromkeys(time for _, known in found for time in known)),
            split,
        )
        for (wcet, split), found in groups.items()
    )


def _time(times: dict[str | None, ExecutionTime], hardware: str | None) -> ExecutionTime | None:
    """Return the execution time on a hardware element; where the unit's is not known, the longest of all."""
    if hardware is None:
        return max(times.values(), key=lambda time: time.time, default=None)
    return times.get(hardware) or times.get(None)


def _name(times: tuple[ExecutionTime, ...]) -> str:
    hardware = next((time.hardware for time in times if time.hardware), None)
    return legal_name(hardware.rpartition("/")[2]) if hardware else VERSION


def _report_units(
    drafts: Sequence[Draft],
    variants: dict[str, tuple[Variant, ...]],
    platform: Platform,
    findings: Findings,
) -> None:
    for draft in drafts:
        kept = {unit for variant in variants[draft.name] for unit in variant.units}
        left = [unit for unit in platform.units_of(draft) if unit not in kept]
        if left:
            findings.add(
                codes.UNIT_WITHOUT_TIME(
                    f"does not run on {listed(left)}, for which no execution time is stated",
                    at=draft.place.at,
                    path=about(task=draft.name),
                )
            )
