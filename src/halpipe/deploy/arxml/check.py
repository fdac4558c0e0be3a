"""Comparison of what the OS of a merged project does with the schedule of its first mode."""

from __future__ import annotations

from collections import Counter
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.bundles import CHANGED_FILE
from halpipe.core.diagnostics import Findings, Location, error, named
from halpipe.core.durations import seconds
from halpipe.core.files import parse_xml, read_bytes, sha256
from halpipe.deploy.arxml.player import Os
from halpipe.deploy.base import Checked

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from lxml import etree

    from halpipe.deploy.arxml.player import Act
    from halpipe.deploy.base import Target
    from halpipe.models import ModeSchedule

OTHERWISE = error(
    "HAL1434",
    "Merged project does not do what the schedule states",
    "The alarms and schedule tables of the project, with the delta and the changed files, are played for three "
    "hyperperiods of the first mode, which begin with the first table of the schedule. In the third, each OsTask of "
    "the schedule is activated, or gets an event, at the starts of its jobs and at no other instant.",
)
_SHOWN = 6


def check(target: Target) -> Checked:
    """Play the project of an export, and compare each OsTask with its jobs."""
    findings = Findings()
    roots = list(_roots(target, findings))
    findings.stop_on_errors()
    facts = target.bundle.fields(findings)
    tables, coded = ([each.value for each in facts.texts(name, str)] for name in ("tables", "code"))
    tasks = {
        task: {path: [event.value for event in run.texts(path, str)] for path in run}
        for task, run, _ in facts.entries("tasks")
    }
    findings.stop_on_errors()
    os, mode = Os(roots, tables), target.schedule.modes[0]
    length = mode.hyperperiod.in_unit("s")
    begin = min(map(os.begin, tables), default=Fraction(0))  # all begin together, or jobs are at other instants
    acts = [act._replace(time=act.time - begin) for act in os.play(3 * length + begin, dict.fromkeys(coded, begin))]
    acts = [act for act in acts if act.time >= 2 * length]
    at = Location(target.bundle.path)
    for task, message in sorted(_differences(os, acts, mode, tasks)):
        help = "export the schedule again, and remove what else starts the OsTask"
        findings.add(OTHERWISE(message, at=at, path=named("OsTask", task), help=help))
    return Checked(diagnostics=tuple(findings.items), lines=tuple(_lines(acts, length)))


def _roots(target: Target, findings: Findings) -> Iterator[etree._Element]:
    """Yield the files of the project as they will be: changed ones in place of those that they replace, the delta."""
    bundle = target.bundle
    replaced, project = {}, {}
    for name, stated, _ in bundle.fields(findings).entries("project", ("sha256", "changed")):
        project[name] = stated.text("sha256"), stated.text("changed")
        if project[name][1] not in ("", *bundle.files):
            stated.complain(CHANGED_FILE, f'"changed": "{project[name][1]}" is no file of the bundle', "changed")
    findings.stop_on_errors()
    for name, (digest, changed) in project.items():
        if changed:
            replaced[name] = bundle.files[changed]
            continue
        content = read_bytes(name)
        if sha256(content) != digest:
            message = "is not the file of the project that the schedule was put onto"
            findings.add(CHANGED_FILE(message, at=Location(name), help="export the schedule onto the project again"))
        replaced[name] = content
    for name, content in bundle.files.items():
        if name.endswith(".arxml") and not name.startswith("changed/"):
            replaced[f"{bundle.path}/{name}"] = content
    for name, content in replaced.items():
        yield parse_xml(content, name, long_texts=True)


def _differences(
    os: Os, acts: list[Act], mode: ModeSchedule, tasks: Mapping[str, Mapping[str, list[str]]]
) -> Iterator[tuple[str, str]]:
    """Yield each OsTask of the schedule that something else, or nothing, starts, and when."""
    length = mode.hyperperiod.in_unit("s")
    needed: dict[str, set[Fraction]] = {}
    events: dict[str, set[str]] = {}
    for job in mode.jobs:
        for task, set_events in tasks.get(job.task, {}).items():
            events.setdefault(task, {""}).update(set_events)
            needed.setdefault(task, set()).add(job.start.in_unit("s") % length)
    done: dict[tuple[str, str], Counter[Fraction]] = {}
    for act in acts:
        if act.event in events.get(act.task, ()):  # another event wakes what the model left out, beside the schedule
            done.setdefault((act.task, act.event), Counter())[act.time % length] += 1
    for (task, event), times in done.items():
        what = f"gets {event}" if event else "is activated"
        for time, count in times.items():
            if count > 1:
                yield task, f"{what} {count} times at {seconds(time)}"
            if time not in needed[task]:
                yield task, f"{what} at {seconds(time)}, where no job of it starts"
        if os.is_extended(task) and not event:
            yield task, "waits for events, but is activated"
    for task, times_of in needed.items():
        seen = {time for (other, _), times in done.items() if other == task for time in times}
        for time in sorted(times_of - seen):
            yield task, f"is not started at {seconds(time)}, where a job of it starts"


def _lines(acts: list[Act], length: Fraction) -> Iterator[str]:
    """Yield what happens to each OsTask in one hyperperiod, in the order of the first instants."""
    yield f"{len(acts)} actions on {len({act.task for act in acts})} OsTasks in {seconds(length)}"
    found: dict[tuple[str, str, str], list[Fraction]] = {}
    for act in acts:
        found.setdefault((act.task, act.event, act.by), []).append(act.time % length)
    for (task, event, by), times in sorted(found.items(), key=lambda item: (min(item[1]), item[0])):
        times.sort()
        shown = ", ".join(str(seconds(time)) for time in times[:_SHOWN])
        more = f" and {len(times) - _SHOWN} more" if len(times) > _SHOWN else ""
        what = f"{event} set" if event else "activated"
        count = "once" if len(times) == 1 else f"{len(times)} times"
        yield f"{task}: {what} {count} by {by}: {shown}{more}"
