"""Result of an overlay: replaced values, defaults, names without a match."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from halpipe.core.diagnostics import Findings, Location
from halpipe.core.quantities import format_rational
from halpipe.core.records import record
from halpipe.core.suggest import did_you_mean, few
from halpipe.importers.common.stated import is_glob
from halpipe.importers.overlay.codes import (
    MATCHES_NOTHING,
    NAMES_DROPPED,
    OVERRIDDEN,
    REMOVED,
    REPLACED,
    UNKNOWN_NAME,
)
from halpipe.importers.overlay.entries import expand
from halpipe.models import Access, Interrupt, Precedence, Source, Split

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable

    from halpipe.core.settings import Stated
    from halpipe.importers.common.base import Coverage

T = TypeVar("T")
E = TypeVar("E")

# Near names cost about 20 us per known name; in a model of thousands of tasks not every typing error gets them.
SUGGESTION_BUDGET = 50_000


@record
class Ranks(Generic[E]):
    """The entries for one element, the one that wins first; those of ``*`` only give defaults."""

    firm_entries: tuple[E, ...]
    default_entries: tuple[E, ...]

    def firm(self, read: Callable[[E], Stated[T] | None]) -> Stated[T] | None:
        """Return what overrules the source, if anything does."""
        return next((found for found in map(read, self.firm_entries) if found is not None), None)

    def default(self, read: Callable[[E], Stated[T] | None]) -> Stated[T] | None:
        """Return what fills the gap where the source states nothing."""
        return next((found for found in map(read, self.default_entries) if found is not None), None)


@dataclass(slots=True)
class Changes:
    """Collects the coverage report of one application of an overlay."""

    coverage: Coverage
    tasks: frozenset[str] = frozenset()
    dropped: Collection[str] = ()
    findings: Findings = field(default_factory=Findings)
    _compared: int = 0
    _reported: set[tuple[Location, str]] = field(default_factory=set)

    def pick(self, path: str, what: str, old: T, unset: T, ranks: Ranks[E], read: Callable[[E], Stated[T] | None]) -> T:
        """Return the value that holds: stated by a firm entry, else by the source, else by a default entry."""
        stated = ranks.firm(read)
        if stated is not None:
            if old != unset:
                self.overridden(path, what, old, stated.value, stated.at)
            return stated.value
        stated = ranks.default(read) if old == unset else None
        if stated is None:
            return old
        self.coverage.defaulted(path, what, show(stated.value), stated.at)
        return stated.value

    def overridden(self, path: str, what: str, old: object, new: object, at: Location) -> None:
        """Report that the overlay replaces a value of the source, unless both say the same."""
        if bare(old) != bare(new):
            self.findings.report(OVERRIDDEN, f"{what}: {show(new)} replaces {show(old)} of the source", at, path)

    def replaced(self, what: str, old: Collection[Any], new: Iterable[Any], names: Iterable[str], at: Location) -> None:
        """Report that the overlay replaces imported elements of some names, unless both are the same."""
        if old and bare(tuple(old)) != bare(tuple(new)):
            self.findings.report(REPLACED, f"the overlay's replace those of the source: {show(tuple(names))}", at, what)

    def removed(self, message: str, at: Location, path: str) -> None:
        """Report that an imported element went because something it refers to went."""
        self.findings.report(REMOVED, message, at, path)

    def unknown(self, kind: str, name: str, known: Iterable[str], at: Location, path: str, otherwise: str) -> None:
        """Report a reference to nothing, once per place."""
        if (at, name) not in self._reported:
            self._reported.add((at, name))
            help = self.suggest(name, known, otherwise)
            self.findings.report(UNKNOWN_NAME, f'there is no {kind} "{name}"', at, path, help)

    def knows_task(self, name: str, at: Location, path: str) -> bool:
        """Return whether the model has the task; report where it does not."""
        if name in self.tasks:
            return True
        if name in self.dropped:
            if (at, name) not in self._reported:
                self._reported.add((at, name))
                help = "remove it here, or do not drop it"
                self.findings.report(NAMES_DROPPED, f'task "{name}" is dropped by the overlay', at, path, help)
        else:
            self.unknown("task", name, sorted(self.tasks), at, path, "the source has no task that resembles it")
        return False

    def matching_units(self, pattern: str, units: Collection[str], at: Location, path: str) -> list[str]:
        """Return the units that a name or a glob matches; report one that matches none."""
        matching = expand(pattern, units)
        otherwise = f"the units are: {show(tuple(units))}"
        if not matching and is_glob(pattern):
            self.findings.report(MATCHES_NOTHING, f'units "{pattern}" match no unit', at, path, otherwise)
        elif not matching:
            self.unknown("unit", pattern, units, at, path, otherwise)
        return matching

    def suggest(self, name: str, known: Iterable[str], otherwise: str) -> str:
        """Return the nearest known names as a question, within a budget of comparisons."""
        pool = list(known)
        self._compared += len(pool)
        return did_you_mean(name, pool, otherwise) if self._compared <= SUGGESTION_BUDGET else otherwise


def bare(value: Any) -> Any:
    """Return a value without its origins, to compare what an overlay and a source say."""
    if isinstance(value, tuple):
        return tuple(bare(item) for item in value)
    return replace(value, origin=None) if hasattr(value, "origin") else value


def show(value: Any) -> str:
    """Print a value of the model for a message."""
    if isinstance(value, tuple):
        return few(map(show, value), 6, quote="") or "none"
    if isinstance(value, Fraction):
        return format_rational(value)
    if isinstance(value, Access):
        return f'{value.start} to {value.end} on "{value.resource}"'
    if isinstance(value, Precedence):
        return f"{value.min} to {value.max} " + value.words.replace(f"of {value.task}", f'of "{value.task}"', 1)
    if isinstance(value, Split):
        return "anywhere" if value.anywhere else show(value.points)
    if isinstance(value, Interrupt):
        return f"{value.wcet} every {value.distance}"
    return f"{value.entry}()" if isinstance(value, Source) else str(value)
