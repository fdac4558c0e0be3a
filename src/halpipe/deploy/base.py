"""Base of all bundle checks: options, answer, and the entry point they are registered through."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Protocol

from halpipe.core.options import Form, option
from halpipe.core.quantities import whole
from halpipe.core.records import record
from halpipe.core.settings import Words

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class CheckOptions:
    """Options of the check of a bundle; a kind of bundles `takes` those that it uses."""

    engine: str = option("auto", "What plays the bundle; auto takes the best that is installed.", metavar="NAME")
    cycles: int = option(0, "Hyperperiods of every mode; 0: enough.", whole(0), metavar="N")
    seconds: int = option(0, "Play all modes about so many seconds together, instead of cycles.", whole(0), metavar="N")
    modelled: bool = option(False, "Let every job take its scheduled time, whatever it computes.", form=Form.SWITCH)
    inject: str = option(
        "some",
        "Jobs that fail on purpose in every way: those of the first mode, of all tables, or none.",
        Words("none", "some", "all"),
    )
    margin: bool = option(False, "Find out how many cycles an instruction may take.", form=Form.SWITCH)
    seed: int = option(1, "Same bundle, options and seed: same simulation.", whole(0), metavar="N")

    @property
    def execution(self) -> str:
        """Duration of jobs: ``real``, or ``modelled``."""
        return "modelled" if self.modelled else "real"

    def unused(self) -> tuple[str, ...]:
        """Return the fields that have no effect beside the others."""
        return ("seconds",) if self.cycles else ()


@record(kw_only=True)
class Target:
    """A bundle with the model and the schedule that it carries, read and verified."""

    bundle: Bundle
    model: TaskModel
    schedule: Schedule


@record(kw_only=True)
class Checked:
    """The answer: the bundle is sound if no finding is an error; `lines` tell people what was done and measured.

    `files` are further results by the name that the command line knows them by: ``trace``, and ``trace-2`` and so on
    where there were several runs.
    """

    diagnostics: tuple[Diagnostic, ...]
    lines: tuple[str, ...]
    files: Mapping[str, bytes] = field(default_factory=dict)


class Deployment(Protocol):
    """Protocol of the check of a kind of bundle; registered as entry point ``halpipe.deployments``.

    `takes` names the fields of the options that have an effect on this kind, `facts` what its manifests may state.
    """

    name: str
    summary: str
    engines: tuple[str, ...]
    takes: tuple[str, ...]
    facts: tuple[str, ...]

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Play the bundle and hold it against its schedule; raise `HalpipeError` if that cannot be done here."""
        ...
