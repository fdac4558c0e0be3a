"""Single values of the export's options, as the command line and pipeline files state them."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from halpipe.diagnostics import Findings
from halpipe.exporters.ros.codes import BAD_CPU
from halpipe.quantities import quoted
from halpipe.suggest import did_you_mean

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import TaskModel

_NUMBER = re.compile(r"[0-9]{1,4}")
HIGHEST_PRIORITY = 99
"""Linux knows real-time priorities from 1 to 99 (sched(7))."""


def cpu_number(text: str) -> int:
    """Read the number of a CPU."""
    if not _NUMBER.fullmatch(text.strip()):
        raise ValueError(f"{quoted(text)} is no CPU; write its number, as in /proc/cpuinfo")
    return int(text)


def priority(text: str) -> int:
    """Read a priority of SCHED_FIFO."""
    if not _NUMBER.fullmatch(text.strip()) or not 1 <= int(text) <= HIGHEST_PRIORITY:
        raise ValueError(f"{quoted(text)} is no priority; write a number from 1 to {HIGHEST_PRIORITY}")
    return int(text)


def cpus_of(text: str) -> dict[str, int]:
    """Read ``core1=2,core2=3``; raise ``ValueError`` that says what is wrong."""
    found: dict[str, int] = {}
    for part in text.split(","):
        unit, sign, number = part.strip().rpartition("=")
        if not sign or not unit.strip():
            raise ValueError(f"{quoted(part)} is no unit with its CPU; write core1=2,core2=3")
        if unit.strip() in found:
            raise ValueError(f"unit {quoted(unit.strip())} is named twice; name it once")
        found[unit.strip()] = cpu_number(number)
    return found


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
        path = f'unit "{unit}"'
        if unit not in names:
            help = did_you_mean(unit, names, "the units are " + ", ".join(names))
            findings.add(BAD_CPU(f'the model has no unit "{unit}"', path=path, help=help))
        elif first.setdefault(cpu, unit) != unit:
            text = f'CPU {cpu} is that of unit "{first[cpu]}" already'
            findings.add(BAD_CPU(text, path=path, help="give each unit a CPU of its own"))
    findings.stop_on_errors()
    return dict(stated)
