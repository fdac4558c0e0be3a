"""A rule: what verify checks, in one sentence for the manual, and the procedure that checks it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Generic, TypeVar

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from halpipe.core.diagnostics import Diagnostic

Subject = TypeVar("Subject")


@record
class Rule(Generic[Subject]):
    """`check` yields one diagnostic for every violation it finds in its subject."""

    name: str
    sentence: str
    check: Callable[[Subject], Iterable[Diagnostic]]
