"""``halpipe validate``, ``verify`` and ``explain``: findings in models and schedules."""

from __future__ import annotations

import os
import re
from collections import defaultdict
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated

import typer

from halpipe.cli import output
from halpipe.cli.options import ModelFile, ScheduleFile, codes, load_codes, takes
from halpipe.core.diagnostics import REGISTER, Diagnostic, Exit, sort_diagnostics
from halpipe.core.options import Values, refuse_unused
from halpipe.core.suggest import counted, did_you_mean, few

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.pipeline.explain.explanation import Explanation


@takes("halpipe.pipeline.checked:ValidateOptions")
def validate(model: ModelFile, options: Values) -> int:
    """Check a task model: form, names, windows, loads, hyperperiods. Every finding is listed, with its line."""
    from halpipe.importers.native import read_what_is_well_formed
    from halpipe.pipeline.checked import validate_model

    system, malformed = read_what_is_well_formed(model)
    found = sort_diagnostics([*malformed, *validate_model(system, options["tick"])])
    output.report(found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        elements = {"task": system.tasks, "unit": system.units, "resource": system.resources, "mode": system.modes}
        output.result(f"{model}: valid; {', '.join(counted(len(found), kind) for kind, found in elements.items())}")
    return Exit.OK


_CODES = "HAL03"
"""The beginning of the codes of verify, and of no others."""
NAMED = 3
"""Further findings of a task that are named; --verbose shows all of them."""


@takes()
def verify(model: ModelFile, schedule: ScheduleFile) -> int:
    """Check a schedule, from any tool, against its model: every violation with job, rule, amount and instant."""
    from halpipe.importers.native import read_model, read_schedule
    from halpipe.pipeline.checked import verify_schedule

    system, tables = read_model(model), read_schedule(schedule)
    found = verify_schedule(system, tables)
    output.report(gathered(found) if output.is_brief() else found, as_result=True)
    if any(d.is_error for d in found):
        return Exit.FINDINGS
    if output.is_text():
        jobs = sum(len(mode.jobs) for mode in tables.modes)
        output.result(f"{schedule}: valid; {counted(len(tables.modes), 'mode')}, {counted(jobs, 'job')}, no violation")
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
    named = few((each.path for each in rest), NAMED, quote="")
    return replace(first, message=f"{first.message}; {len(rest)} more like it: {named}")


@takes("halpipe.pipeline.explain.explanation:ExplainOptions", shows_all=True)
def explain(
    subject: Annotated[
        str,
        typer.Argument(metavar="MODEL|CODE", help="Task model XML, or a code such as HAL0231.", autocompletion=codes),
    ],
    options: Values,
) -> int:
    """Say why a model has no schedule, with a proof where there is one, and what would help; or explain a code.

    Exit code 4 means proven infeasible; 3, that no schedule was found; 0, that there is one.
    """
    from halpipe.pipeline.explain.explanation import ExplainOptions

    if (code := re.fullmatch(r"(?i)(?:HAL)?(\d{1,4})", subject)) and not os.path.exists(subject):
        refuse_unused(ExplainOptions(**options), "explain of a code", options)
        return _explain_code(f"HAL{int(code[1]):04}")
    from halpipe.cli.searching import Stop
    from halpipe.flow.searching import explain_options
    from halpipe.importers.native import read_model
    from halpipe.pipeline.explain.explanation import explain as explain_model
    from halpipe.pipeline.solve.limits import refuse_endless

    chosen = explain_options(options)
    model = read_model(subject)
    if chosen.time_limit is None:
        refuse_endless(model, [chosen.mode] if chosen.mode else ())
    stop = Stop("stopping; what was found so far follows", chosen.time_limit)
    with stop.listening():
        explanation = explain_model(model, chosen, stop.clock())
    output.report(explanation.diagnostics, as_result=True)
    if output.is_text():
        _summarise(explanation)
    return Exit.INTERRUPTED if stop.pressed else explanation.exit


def _summarise(explanation: Explanation) -> None:
    for name, verdict in explanation.verdicts:
        output.result(f"mode {name}: {verdict}")
    for source, target in explanation.switches:
        output.result(f"switch from {source} to {target}: no table found")


def _explain_code(id: str) -> int:
    """Print the page of a diagnostic code."""
    load_codes()
    code = REGISTER.get(id)
    if code is None:
        raise typer.BadParameter(f"there is no code {id}; {did_you_mean(id, REGISTER, 'see the reference')}")
    output.text(f"{code.id} ({code.severity}): {code.title}\n\n{_wrapped(code.explanation)}".rstrip())
    return Exit.OK


def _wrapped(text: str) -> str:
    """Return a paragraph in lines that the terminal need not break within words."""
    import shutil
    import textwrap

    return textwrap.fill(text, min(100, shutil.get_terminal_size().columns), break_on_hyphens=False)
