"""Base of all bundle checks: options, answer, and the entry point they are registered through."""

from __future__ import annotations

from dataclasses import field
from typing import TYPE_CHECKING, Protocol

from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.bundles import Bundle
    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Schedule, TaskModel


@record(kw_only=True)
class CheckOptions:
    """What the user may choose: the `engine` that plays the bundle, the `seed` of what it draws, and how long.

    `cycles` is the number of hyperperiods of every mode, 0 for what the engine thinks enough; `seconds` says how long
    all modes are played together, where that is real time, and 0 leaves it to `cycles`. `execution` is ``real``,
    or ``modelled``: every job lasts as long as its schedule says, whatever it computes. `inject` says into how many
    jobs faults are put on purpose: ``none``, ``some`` or ``all``. `margin` asks how much slower the cores may be.
    """

    engine: str = "auto"
    seed: int = 1
    cycles: int = 0
    seconds: int = 0
    execution: str = "real"
    inject: str = "some"
    margin: bool = False


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
    """The door through which a kind of bundle is checked; registered as entry point ``halpipe.deployments``."""

    name: str
    summary: str
    engines: tuple[str, ...]

    def check(self, target: Target, options: CheckOptions) -> Checked:
        """Play the bundle and hold it against its schedule; raise `HalpipeError` if that cannot be done here."""
        ...
