"""Proofs that a mode has no schedule, from necessary conditions: instant, exact, and checkable by hand (MODEL 6).

What validate checks is not repeated, except for loads, once more, when a version proves unusable.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import tasks_named
from halpipe.core.records import record
from halpipe.pipeline.explain.blocking import blockings
from halpipe.pipeline.explain.facts import mode_facts
from halpipe.pipeline.explain.groups_meet import crowds
from halpipe.pipeline.explain.packing import packings
from halpipe.pipeline.explain.relaxed import relaxed
from halpipe.pipeline.explain.sharing import Witness, prune, resources_met, units_met
from halpipe.pipeline.explain.windows import contradictions
from halpipe.pipeline.validate.context import Context
from halpipe.pipeline.validate.load import check_resources, check_units

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel
    from halpipe.pipeline.explain.facts import ModeFacts
    from halpipe.pipeline.validate.context import ActiveMode

__all__ = ["Hopeless", "Witness", "find_witnesses"]


@record
class Hopeless:
    """A mode without a schedule: the witnesses, and what they build upon."""

    mode: str
    notes: tuple[Diagnostic, ...]
    witnesses: tuple[Witness, ...]

    @property
    def diagnostics(self) -> tuple[Diagnostic, ...]:
        """All findings, the premises first."""
        return (*self.notes, *(found.diagnostic.concerning(tasks_named(found.tasks)) for found in self.witnesses))

    @property
    def tasks(self) -> tuple[str, ...]:
        """The tasks that the witnesses are about."""
        return tuple(dict.fromkeys(name for witness in self.witnesses for name in witness.tasks))


def find_witnesses(model: TaskModel, modes: Collection[str] = ()) -> tuple[Hopeless, ...]:
    """Return the modes (of those named, or all) of a validated model that certainly have no schedule, and why.

    Sound: what has a valid schedule is never called hopeless. Not complete: most conflicts need a search.
    """
    context = Context(relaxed(model))
    found = (_judge(context, mode) for mode in context.active if not modes or mode.mode.name in modes)
    return tuple(hopeless for hopeless in found if hopeless is not None)


def _judge(context: Context, mode: ActiveMode) -> Hopeless | None:
    if mode.hyperperiod is None:
        return None
    facts, notes, witnesses = prune(mode_facts(mode, context.units))
    witnesses += _loads(context.model, facts, bool(notes))
    witnesses += [*units_met(facts, context.model), *resources_met(facts), *contradictions(facts)]
    witnesses += blockings(facts, context.model)
    if not witnesses:
        witnesses += packings(facts)
    if not witnesses:
        witnesses += crowds(facts)
    return Hopeless(mode.mode.name, tuple(notes), tuple(witnesses)) if witnesses else None


def _loads(model: TaskModel, facts: ModeFacts, has_fewer_versions: bool) -> Iterator[Witness]:
    """Check the loads again with the versions that are left."""
    if not has_fewer_versions:
        return
    left = {name: tuple(v.version.name for v in task.versions) for name, task in facts.tasks.items()}
    runs = tuple(replace(run, versions=left.get(run.task, run.versions)) for run in facts.mode.mode.runs)
    reduced = Context(replace(model, modes=(replace(facts.mode.mode, runs=runs),)))
    for found in (*check_units(reduced), *check_resources(reduced)):
        yield Witness(found, ())
