"""Modes of the model from mode declaration groups, by the events that are disabled in their modes.

AUTOSAR states in which modes an event does *not* occur. With one group of which modes disable events, every mode of
it becomes an execution mode without the tasks disabled there. Modes of several groups may be active in any mix: then
there is a mode ``default`` with all tasks, and one mode ``group.mode`` for every mode of every such group, in which
only that group switches tasks off. Function groups of the Adaptive Platform state in which of their modes a process
does run; they are mode groups like the others. A mode in which nothing runs needs no schedule and is left out.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import named
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.names import legal_name, unique_name
from halpipe.models import Mode, Run, Transition

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from halpipe.core.diagnostics import Findings
    from halpipe.importers.arxml.coverage import Ledger
    from halpipe.importers.arxml.system.values import ModeGroup, Place, System
    from halpipe.importers.arxml.tasks.grouping import Draft

DEFAULT_MODE = "default"


def make_modes(
    system: System,
    drafts: Sequence[Draft],
    versions: Mapping[str, tuple[str, ...]],
    ledger: Ledger,
    findings: Findings,
) -> tuple[tuple[Mode, ...], tuple[Transition, ...]]:
    """Return the modes and the transitions between them; no transition means that every pair may be switched.

    `versions` are the names of the versions of every task.
    """
    disabled = frozenset(path for draft in drafts for path in draft.disabled_in)
    groups = [group for group in system.mode_groups if any(mode.path in disabled for mode in group.modes)]
    names = _mode_names(groups)
    modes = [] if len(groups) == 1 else [Mode(name=DEFAULT_MODE, runs=_runs(drafts, "", versions))]
    for group in groups:
        ledger.mapped(group.place, *group.modes, *group.parts)
        for mode in group.modes:
            runs = _runs(drafts, mode.path, versions)
            if runs:
                modes.append(Mode(name=names[mode.path], runs=runs, origin=mode.origin))
            else:
                del names[mode.path]
                _report_empty(group, mode, findings)
    if len(groups) > 1:
        findings.add(
            codes.SEVERAL_GROUPS(
                f"{len(groups)} mode groups switch tasks off: {', '.join(g.place.path for g in groups)}",
                at=groups[0].place.at,
                help="name the modes that occur together in the overlay (modes)",
            )
        )
    if not any(group.transitions for group in groups):
        return tuple(modes), ()
    transitions = [t for group in groups for t in _transitions(group, names, ledger)]
    if len(groups) > 1:
        transitions += _through_default(list(names.values()))
    return tuple(modes), tuple(transitions)


def _mode_names(groups: Sequence[ModeGroup]) -> dict[str, str]:
    taken = {DEFAULT_MODE} if len(groups) > 1 else set()
    return {
        mode.path: unique_name(legal_name(f"{group.place.name}.{mode.name}" if len(groups) > 1 else mode.name), taken)
        for group in groups
        for mode in group.modes
    }


def _runs(drafts: Sequence[Draft], mode: str, versions: Mapping[str, tuple[str, ...]]) -> tuple[Run, ...]:
    return tuple(
        Run(task=draft.name, versions=versions[draft.name]) for draft in drafts if mode not in draft.disabled_in
    )


def _report_empty(group: ModeGroup, mode: Place, findings: Findings) -> None:
    findings.add(
        codes.EMPTY_MODE(
            f'no task runs in mode "{mode.name}"', at=mode.at, path=named(group.place.kind, group.place.path)
        )
    )


def _transitions(group: ModeGroup, names: dict[str, str], ledger: Ledger) -> Iterator[Transition]:
    """Yield the transitions that a group states, or every pair of its modes if it states none."""
    for place, exited, entered in group.transitions:
        if exited in names and entered in names and exited != entered:
            ledger.mapped(place)
            yield Transition(source=names[exited], target=names[entered], origin=place.origin)
    if not group.transitions:
        for source in group.modes:
            for target in group.modes:
                if source != target and source.path in names and target.path in names:
                    yield Transition(source=names[source.path], target=names[target.path], origin=group.place.origin)


def _through_default(names: list[str]) -> Iterator[Transition]:
    for name in names:
        yield Transition(source=DEFAULT_MODE, target=name)
        yield Transition(source=name, target=DEFAULT_MODE)
