"""Smallest or slowest platform: fewest units, lowest bandwidth, largest common WCET factor."""

from __future__ import annotations

import math
from contextlib import suppress
from fractions import Fraction
from typing import TYPE_CHECKING

from halpipe.core.durations import ZERO, Duration
from halpipe.core.options import Form, option, positive_duration, refuse_unused
from halpipe.core.records import record
from halpipe.core.suggest import few
from halpipe.models.modes import require_mode, require_names
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.measure.objectives import Objective
from halpipe.pipeline.solve.optimise import lower_bound
from halpipe.pipeline.solve.schedule import OnProgress, SearchOptions
from halpipe.pipeline.validate.context import ActiveMode, ActiveTask, Context, place
from halpipe.pipeline.whatif import codes
from halpipe.pipeline.whatif.trial import (
    BUDGET,
    WINDOWS,
    Changed,
    Search,
    TimeUpError,
    TrialOptions,
    bracket,
    check_otherwise,
    peak_bound,
    time_limit,
    with_bandwidth,
    with_factor,
    with_units,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import TaskModel
    from halpipe.pipeline.whatif.trial import Bracket

STEP = Fraction(1, 100)
"""Grid of shares and factors, unless the user asks for another."""


@record(kw_only=True)
class SizeOptions(TrialOptions):
    """Question to answer: one of `units` (a type), `bandwidth` (a resource) and `wcet_factor`; see `question_of`."""

    units: str = option("", "Ask for the fewest units of this type.", metavar="TYPE")
    bandwidth: str = option("", "Ask for the lowest share of the bandwidth of this resource.", metavar="RESOURCE")
    wcet_factor: bool = option(False, "Ask by how much all WCETs can grow.", form=Form.SWITCH)
    mode: str = option("", "This mode only; otherwise the size is enough for each.", metavar="NAME", completes="modes")
    switches: bool = option(False, "Require the tables for the switches that the model lists, too.", form=Form.SWITCH)
    tick: Duration | None = option(
        None,
        "Grid of the start times.",
        positive_duration,
        metavar="TIME",
        takes=(Duration,),
        otherwise="the largest that loses nothing",
    )

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others."""
        idle = ("bandwidth", "wcet_factor", "step") if self.units else ("wcet_factor",) if self.bandwidth else ()
        return (*idle, *(("switches",) if self.mode else ()))


@record(kw_only=True)
class Question:
    """A value in question: the smallest that is enough, or with `largest` the largest that is not too much.

    Values are multiples of `step`, from `hardest` to `easiest` times it. `at` gives the model at a value, and `relaxed`
    one that has a schedule whenever any reading of the value has. `now` is the value of the model as it is.
    """

    what: str
    hardest: int
    easiest: int
    step: Fraction
    now: Fraction
    at: Callable[[Fraction], Changed]
    relaxed: Callable[[Fraction], Changed]
    ignored: frozenset[str] = frozenset()
    likely: int = 0
    """How many steps easier than the hardest value the first without a proof is, if the load of units decides."""
    warnings: tuple[Diagnostic, ...] = ()

    @property
    def largest(self) -> bool:
        """Whether larger values are harder."""
        return self.hardest > self.easiest

    def value(self, steps: int) -> Fraction:
        """Return the value `steps` easier than the hardest."""
        return self.step * (self.hardest - steps if self.largest else self.hardest + steps)


@record(kw_only=True)
class Answer:
    """The value `found`, beside the `bound` that is proven: no value beyond it has a schedule.

    `witness` proves the bound, `failed` lists the values that were tried without success, `found` is None where there
    were no others, and `bound` is None where it is proven that no value is enough.
    """

    question: Question
    found: Fraction | None
    bound: Fraction | None
    witness: tuple[Diagnostic, ...]
    failed: tuple[Fraction, ...]
    is_cut: bool
    """Whether time ended it: more of the values may be impossible, and others have a schedule."""


def ask(question: Question, search: Search, *, is_timed: bool = False) -> Answer:
    """Find the best value with a schedule that verifies, and the bound that is proven.

    What the model has now is tried first if time may end the search.
    """
    last, known = abs(question.easiest - question.hardest), None
    now = question.now / question.step
    with suppress(TimeUpError):
        if is_timed and now.denominator == 1 and search.finds(question.at(question.now)):
            known = abs(now.numerator - question.hardest)
    result: Bracket = bracket(
        last,
        lambda steps: search.proves(question.relaxed(question.value(steps)), question.ignored),
        lambda steps: search.finds(question.at(question.value(steps))),
        known=known,
        likely=question.likely,
    )
    return Answer(
        question=question,
        found=None if result.found is None else question.value(result.found),
        bound=None if result.possible is None else question.value(result.possible),
        witness=result.witness,
        failed=tuple(map(question.value, result.failed)),
        is_cut=result.is_cut,
    )


def complaint(answer: Answer) -> Diagnostic | None:
    """Return what there is to say when no value was found; None when one was."""
    question = answer.question
    if answer.bound is None:
        help = "see what the witness says is necessary; `halpipe explain` says more"
        return codes.IMPOSSIBLE("no value is enough", path=question.what, help=help)
    if answer.found is None:
        limit = "--time-limit" if answer.is_cut else "--budget"
        help = f"raise {limit}, try another --seed, or ask `halpipe explain`"
        return codes.NONE_FOUND(f"{len(answer.failed)} values tried without success", path=question.what, help=help)
    return None


# ------------------------------------------------------------------------------------------------ questions


def of_modes(model: TaskModel, mode: str) -> TaskModel:
    """Return the model with one of its modes only, or with all where `mode` is empty; refuse other faults."""
    if mode:
        model = model.alone(mode)
    check_otherwise(model)
    return model


def fewest_units(model: TaskModel, type: str) -> Question:
    """Ask for the fewest units of a type; there must be one."""
    own = [unit for unit in model.units if unit.type == type]
    names = {unit.name for unit in own}
    users = {frozenset(names & set(v.units)) for task in model.tasks for v in task.versions} - {frozenset()}
    warnings: tuple[Diagnostic, ...] = ()
    if users - {frozenset(names)}:
        text = f"not every version that may use one of {few(sorted(names))} may use all of them"
        warnings = (codes.UNLIKE_UNITS(text, at=place(own[0]), path=f'units of type "{type}"'),)
    return Question(
        what=f'units of type "{type}"',
        hardest=0,
        easiest=max(len(own), *(math.ceil(_most_at_once(mode, _gang)) for mode in Context(model).active)),
        step=Fraction(1),
        now=Fraction(len(own)),
        at=lambda count: with_units(model, type, int(count)),
        relaxed=lambda count: with_units(model, type, int(count), alike=True),
        warnings=warnings,
    )


def lowest_bandwidth(model: TaskModel, resource: str, step: Fraction = STEP) -> Question:
    """Ask for the lowest share of the bandwidth of a resource; above 1 it is more than there is now."""

    def peak(active: ActiveTask) -> Fraction:
        return max(Fraction(peak_bound(version, resource)) for version in active.versions)

    most = max(Fraction(1), *(_most_at_once(mode, peak) for mode in Context(model).active))

    def at(share: Fraction) -> Changed:
        return with_bandwidth(model, resource, share)

    return Question(
        what=f'bandwidth of resource "{resource}"',
        hardest=1,
        easiest=math.ceil(most / step),
        step=step,
        now=Fraction(1),
        at=at,
        relaxed=at,
    )


def largest_factor(model: TaskModel, step: Fraction = STEP) -> Question:
    """Ask for the largest factor of all WCETs, with their access phases."""

    def at(factor: Fraction) -> Changed:
        return with_factor(model, factor)

    hyperperiod = max((mode.hyperperiod or ZERO for mode in Context(model).active), default=ZERO)
    limits = ((time_limit(task) or hyperperiod) / v.wcet for task in model.tasks for v in task.versions if v.wcet)
    hardest = math.floor(max(limits) / step) + 1
    margins = (lower_bound(Objective.MARGIN, model, expand(model, mode)) for mode in model.modes)
    largest = min((1 - margin for margin in margins if margin is not None), default=Fraction(0))
    return Question(
        what="common factor of all WCETs",
        hardest=hardest,
        easiest=1,
        step=step,
        now=Fraction(1),
        at=at,
        relaxed=at,
        ignored=WINDOWS,
        likely=max(0, hardest - math.floor(largest / step)),
    )


def _gang(active: ActiveTask) -> Fraction:
    return Fraction(max(version.gang for version in active.versions))


def _most_at_once(mode: ActiveMode, need: Callable[[ActiveTask], Fraction]) -> Fraction:
    """Return what the jobs of a mode can need at one instant at most: a job runs between release and deadline."""
    counts = mode.most_jobs
    total = Fraction(0)
    for name, active in mode.tasks.items():
        period, limit = active.task.period, time_limit(active.task)
        jobs = counts[name]
        if period and limit is not None:
            lasts = limit + period if active.task.distance is not None else limit  # from the poll before
            jobs = min(jobs, math.ceil(lasts / period))
        total += jobs * need(active)
    return total


def question_of(model: TaskModel, options: SizeOptions) -> Question:
    """Return the question that is asked of a model; by how much WCETs can grow where nothing else is.

    Raise `HalpipeError` for options that have no effect, and names that the model does not have.
    """
    refuse_unused(options, "size")
    if options.mode:
        require_mode(options.mode, model.modes)
    asked = of_modes(model, options.mode)
    types = dict.fromkeys(unit.type for unit in model.units if unit.type)
    require_names(filter(None, [options.units]), types, "unit of type")
    require_names(filter(None, [options.bandwidth]), (r.name for r in model.resources), "resource")
    if options.units:
        return fewest_units(asked, options.units)
    if options.bandwidth:
        return lowest_bandwidth(asked, options.bandwidth, options.step)
    return largest_factor(asked, options.step)


def answer_of(
    question: Question, options: SizeOptions, on_progress: OnProgress, go_on: Callable[[], bool] = lambda: True
) -> Answer:
    """Answer a question by searches with these options, with what is known when `on_progress` and `go_on` end them."""
    chosen = SearchOptions(seed=options.seed, budget=options.budget or BUDGET, tick=options.tick, optimise=())
    search = Search(chosen, on_progress, go_on, options.switches)
    return ask(question, search, is_timed=options.time_limit is not None)
