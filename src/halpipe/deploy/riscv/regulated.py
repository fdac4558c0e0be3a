"""The regulators of a bundle: their tables are checked against the schedule that the programs play."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from halpipe.bundles import MODEL, SCHEDULE, Bundle
from halpipe.deploy.base import CheckOptions, Target
from halpipe.deploy.regulator import ARITHMETIC
from halpipe.deploy.regulator import DEPLOYMENT as REGULATORS
from halpipe.diagnostics import sort_diagnostics

if TYPE_CHECKING:
    from halpipe.deploy.base import Checked

FOLDER = "regulator/"


def with_tables(target: Target, checked: Checked) -> Checked:
    """Return the check of the programs with that of the tables, where the bundle has any."""
    bundle = target.bundle
    files = {name.removeprefix(FOLDER): data for name, data in bundle.files.items() if name.startswith(FOLDER)}
    if not files:
        return checked
    files |= {name: bundle.files[name] for name in (MODEL, SCHEDULE)}
    own = Bundle(f"{bundle.path}/{FOLDER.rstrip('/')}", REGULATORS.name, {}, files)
    tables = REGULATORS.check(replace(target, bundle=own), CheckOptions(engine=ARITHMETIC))
    lines = (*checked.lines, *(f"regulators: {line}" for line in tables.lines))
    return replace(
        checked, diagnostics=tuple(sort_diagnostics([*checked.diagnostics, *tables.diagnostics])), lines=lines
    )
