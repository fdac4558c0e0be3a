"""Rules version and unit: what a job runs, and where (MODEL 3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.pipeline.verify import codes
from halpipe.pipeline.verify.rules import Rule

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import Version
    from halpipe.pipeline.verify.tables import ModeTable, Placed, Switch


def check_version(table: ModeTable) -> Iterator[Diagnostic]:
    """Check lambda of every job of a mode."""
    return _versions(table.jobs, table)


def check_version_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check lambda of every job of a transition table, against the mode to come."""
    return _versions(switch.jobs, switch)


def _versions(jobs: Iterable[Placed], table: ModeTable | Switch) -> Iterator[Diagnostic]:
    for placed in jobs:
        if placed.version is None:
            available = ", ".join(f'"{name}"' for name in placed.active.versions) or "none"
            text = f'uses version "{placed.job.version}", which is not available'
            help = f"available versions: {available}"
            yield codes.WRONG_VERSION(text, at=placed.job.at, path=table.path(placed), help=help)


def check_unit(table: ModeTable) -> Iterator[Diagnostic]:
    """Check phi of every job of a mode."""
    return _units(table.jobs, table, {unit.name for unit in table.model.units})


def check_unit_on_line(switch: Switch) -> Iterator[Diagnostic]:
    """Check phi of every job of a transition table."""
    return _units(switch.jobs, switch, {unit.name for unit in switch.target.model.units})


def _units(jobs: Iterable[Placed], table: ModeTable | Switch, platform: set[str]) -> Iterator[Diagnostic]:
    valid: dict[int, set[str]] = {}
    for placed in jobs:
        version = placed.version
        if version is None:
            continue
        units = valid.setdefault(id(version), platform.intersection(version.units))
        if len(placed.job.units) != version.gang or len(set(placed.job.units) & units) != version.gang:
            text = _unit_fault(placed.job.units, version, units, platform)
            help = "valid units: " + (", ".join(u for u in version.units if u in platform) or "none")
            yield codes.WRONG_UNIT(text, at=placed.job.at, path=table.path(placed), help=help)


def _unit_fault(given: tuple[str, ...], version: Version, valid: set[str], platform: set[str]) -> str:
    """Say everything that is wrong with the units of a job."""
    faults = []
    distinct = list(dict.fromkeys(given))
    if len(distinct) != len(given):
        faults.append("names a unit more than once")
    if len(distinct) != version.gang:
        faults.append(f'has {len(distinct)} units where version "{version.name}" occupies {version.gang}')
    for unit in distinct:
        if unit not in platform:
            faults.append(f'is on unit "{unit}", which does not exist')
        elif unit not in valid:
            faults.append(f'is on unit "{unit}", which is not valid for version "{version.name}"')
    return "; ".join(faults)


VERSION = Rule("version", "Every job uses a version of its task that is available in the mode.", check_version)
UNIT = Rule(
    "unit",
    "Every job occupies exactly as many distinct units as the gang size of its version, all valid for the version.",
    check_unit,
)
