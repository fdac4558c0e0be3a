"""Verdicts of both checkers on schedules at the edge of each rule, and on mutants of valid systems, through files."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import parse_xml
from halpipe.core.files.scratch import scratch_folder
from halpipe.core.records import record
from halpipe.exporters.native import format_model, format_schedule
from halpipe.importers.native import parse_model, read_model, read_schedule
from halpipe.pipeline.checked import schedule_model
from halpipe.pipeline.generate import SetParameters, generate_with_witness
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.verify import RULES, broken_rules
from halpipe.pipeline.verify.preemption import PRIORITY_RULE
from halpipe.selftest import second
from halpipe.selftest.edges import edges
from halpipe.selftest.mutants import OPERATORS, SCHEDULE, scaled, with_tables

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from halpipe.models import Schedule, TaskModel

SYSTEMS = Path(__file__).with_name("systems")
GENERATED = 4
"""Systems that are made from the seed, besides those that are shipped."""

MUTANTS_OF_ONE = 50
"""Mutants of one system with one scale of its times."""


TABLES = Fraction(1, 2)
"""Of the systems with switches, those whose switches get a table."""


@dataclass(slots=True)
class Outcome:
    """Verdicts of the checkers; `differing` names the schedules on which they do not agree.

    `alone` counts for each rule of verify the schedules that no other rule refuses: without one, nothing would show
    that the rule is at work.
    """

    valid: int = 0
    broken: int = 0
    differing: list[str] = field(default_factory=list)
    by_fault: dict[str, list[int]] = field(default_factory=dict)
    alone: dict[str, int] = field(default_factory=lambda: {rule.name: 0 for rule in RULES if rule is not PRIORITY_RULE})

    @property
    def unseen(self) -> list[str]:
        """The rules of verify that no schedule has shown to be at work."""
        return [name for name, count in self.alone.items() if not count]

    def count(self, case: Case, broken: frozenset[str], by_second: bool) -> None:
        """Enter one schedule with the rules that verify finds broken."""
        by_verify = not broken
        if len(broken) == 1:
            self.alone.update({rule: self.alone[rule] + 1 for rule in broken if rule in self.alone})
        self.valid += by_verify
        self.broken += not by_verify
        row = self.by_fault.setdefault(case.faults, [0, 0])
        row[by_verify] += 1
        words = {True: "valid", False: "not valid"}
        if by_verify != by_second:
            text = f"verify {words[by_verify]}, second {words[by_second]}"
            self.differing.append(f"{case.name} ({case.faults}): {text}")
        elif case.broken not in (None, broken):
            self.differing.append(f"{case.name} ({case.faults}): verify finds broken: {', '.join(sorted(broken))}")


def systems(seed: int) -> Iterator[tuple[str, TaskModel, Schedule]]:
    """Yield the systems that are shipped, in dense schedules, which small faults break, and some that are generated."""
    for path in sorted(SYSTEMS.glob("*.xml")):
        model = parse_model(path.read_bytes(), path.name)
        yield path.stem, model, schedule_model(model, SearchOptions(seed=seed, optimise=()), lambda *_: True).schedule
    for number in range(GENERATED):
        parameters = SetParameters(
            tasks=6, units=4, unit_types=2, precedence=Fraction(1, 2), slack=Fraction(1, 4),
            fractional=True, gang=Fraction(1, 4), multi_version=Fraction(1, 2),
        )  # fmt: skip
        model, schedule = generate_with_witness(parameters, seed * 1000 + number)
        yield f"generated-{number}", model, schedule


@record
class Case:
    """A model and a schedule as files, the faults in them, and the rules that are broken, where that is known."""

    name: str
    faults: str
    model: bytes
    schedule: bytes
    broken: frozenset[str] | None = None
    by_second: bool = True


def cases(mutants: int, seed: int) -> Iterator[Case]:
    """Yield the edges of all rules and so many mutants, the same for the same seed."""
    from lxml import etree

    for edge in edges():
        for files, words, broken in zip(edge.pairs, ("kept", "broken"), ((), edge.rules), strict=False):
            yield Case("edge", f"{' and '.join(edge.rules)} {words}", *files, frozenset(broken), edge.by_second)
    known = [(name, format_model(model), format_schedule(schedule)) for name, model, schedule in systems(seed)]
    for number in range(mutants):
        if number % MUTANTS_OF_ONE == 0:
            name, *pair = _sound(known, seed, number // MUTANTS_OF_ONE)
        model, schedule = deepcopy(pair)
        rng = Random(f"{seed}/{number}")
        faults = [] if number % MUTANTS_OF_ONE == 0 else rng.choices(sorted(OPERATORS), k=rng.choice((1, 1, 1, 2)))
        for fault in faults:
            OPERATORS[fault](rng, model, schedule)
        texts = etree.tostring(model), etree.tostring(schedule)
        yield Case(f"{name} {number}", " and ".join(faults) or "none", *texts)


def run(mutants: int, seed: int) -> Outcome:
    """Judge the edges of all rules and that many mutants, twice each; the same seed gives the same mutants."""
    outcome = Outcome()
    with scratch_folder() as folder:
        model_file, schedule_file = Path(folder, "model.xml"), Path(folder, "schedule.xml")
        files = str(model_file), str(schedule_file)
        for case in cases(mutants, seed):
            for file, text in ((model_file, case.model), (schedule_file, case.schedule)):
                file.unlink(missing_ok=True)  # some file systems flush a file to its disk when it is overwritten
                file.write_bytes(text)
            outcome.count(case, _broken(*files), second.accepts(*files) if case.by_second else not case.broken)
    return outcome


def _sound(known: Sequence[tuple[str, bytes, bytes]], seed: int, group: int) -> tuple[str, Any, Any]:
    """Return a system by its name, with its model and schedule in times of another scale."""
    rng = Random(f"{seed}:{group}")
    name, *texts = known[group % len(known)]
    model, schedule = (parse_xml(text, name) for text in texts)
    schedule.attrib.pop("model-sha256", None)
    _without_costs(schedule)
    factor = Fraction(rng.randrange(1, 40), rng.randrange(1, 40))
    scaled(model, factor)
    scaled(schedule, factor)
    if rng.random() < TABLES:
        with_tables(schedule)
    return name, model, schedule


def _broken(model: str, schedule: str) -> frozenset[str]:
    try:
        return broken_rules(read_model(model), read_schedule(schedule))
    except HalpipeError:
        return frozenset(("reading",))


def _without_costs(schedule: object) -> None:
    """Remove the figures that the second checker does not judge."""
    for kind in ("cost", "unit-load", "resource-load"):
        for element in list(schedule.iter(SCHEDULE + kind)):  # type: ignore[attr-defined]
            element.getparent().remove(element)
    for mode in schedule.iter(SCHEDULE + "mode"):  # type: ignore[attr-defined]
        mode.attrib.pop("margin", None)
