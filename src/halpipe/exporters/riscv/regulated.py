"""Regulators of the memory in a bundle: the tables of a platform, for the schedule that the bundle plays."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

from halpipe.core.bundles import MODEL, SCHEDULE, seal
from halpipe.core.files import MANIFEST
from halpipe.exporters.regulator import RegulatorExporter, RegulatorOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import Schedule, TaskModel

FOLDER = "regulator/"
_OF_THE_SEAL = ("halpipe-bundle", "kind", "files")


def with_regulators(
    bundle: Mapping[str, bytes], model: TaskModel, schedule: Schedule, platform: str
) -> dict[str, bytes]:
    """Return the bundle with what the regulators of a platform load, sealed anew.

    Model and schedule are those of the bundle, whose hashes the tables state. Raise `HalpipeError` where the export of
    the regulators refuses.
    """
    tables = RegulatorExporter().write(model, schedule, RegulatorOptions(platform=platform))
    assert all(tables[name] == bundle[name] for name in (MODEL, SCHEDULE))
    stated = json.loads(bundle[MANIFEST])
    facts = {key: value for key, value in stated.items() if key not in _OF_THE_SEAL}
    own = {name: data for name, data in bundle.items() if name != MANIFEST}
    rest = {f"{FOLDER}{name}": data for name, data in tables.items() if name not in (MANIFEST, MODEL, SCHEDULE)}
    return seal("riscv", own | rest, facts | {"regulator": json.loads(tables[MANIFEST])["backend"]})
