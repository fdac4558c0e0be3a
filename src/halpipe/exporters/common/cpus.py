"""The Linux CPUs of the units of a model."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Findings, about
from halpipe.core.suggest import did_you_mean
from halpipe.exporters.common.codes import BAD_CPU

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import TaskModel


def placed(model: TaskModel, stated: Mapping[str, int] | None) -> dict[str, int]:
    """Return the CPU of each unit that has one: as stated, otherwise numbered in the order of the model.

    Raise `HalpipeError` for units that the model lacks and for CPUs used twice.
    """
    names = [unit.name for unit in model.units]
    if stated is None:
        return {name: number for number, name in enumerate(names)}
    findings = Findings()
    first: dict[int, str] = {}
    for unit, cpu in stated.items():
        path = about(unit=unit)
        if unit not in names:
            help = did_you_mean(unit, names, "the units are " + ", ".join(names))
            findings.add(BAD_CPU(f'the model has no unit "{unit}"', path=path, help=help))
        elif first.setdefault(cpu, unit) != unit:
            text = f'CPU {cpu} is that of unit "{first[cpu]}" already'
            findings.add(BAD_CPU(text, path=path, help="give each unit a CPU of its own"))
    findings.stop_on_errors()
    return dict(stated)
