"""A rule: what verify checks, in one sentence for the manual, and the procedure that checks it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.diagnostics import Diagnostic

Subject = TypeVar("Subject")


@dataclass(frozen=True, slots=True)
class Rule(Generic[Subject]):
    """`check` yields one diagnostic for every violation it finds in its subject."""

    name: str
    sentence: str
    check: Callable[[Subject], Iterable[Diagnostic]]
