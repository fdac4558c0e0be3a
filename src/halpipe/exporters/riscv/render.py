"""Texts made from templates: linker scripts, tables, Makefile, README; and the health rules in the words of C."""

from __future__ import annotations

import shlex
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.records import record
from halpipe.exporters.common.templates import environment
from halpipe.exporters.riscv.cores import FAULT_RECORDS, LINE, TRACE_RECORDS, Core, MainMemory
from halpipe.exporters.riscv.phases import functions_of
from halpipe.exporters.riscv.profile import MONITOR, Profile
from halpipe.models import HealthAction, HealthEvent, Schedule, TaskModel

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.exporters.riscv.bundle import Plan, Site
    from halpipe.exporters.riscv.images import Part
    from halpipe.exporters.riscv.toolchain import Workshop

_OVERRUN, _FAULT = ("FLAG_LATE", "FLAG_OVERRUN"), ("FLAG_FAULT", "FLAG_STUCK", "FLAG_ERROR")
_FLAGS = {HealthEvent.OVERRUN: _OVERRUN, HealthEvent.FAULT: _FAULT, HealthEvent.ANY: (*_OVERRUN, *_FAULT)}


@record
class Health:
    """The rules of a model, each as its task and a row in C, and how many events they count together."""

    rules: tuple[tuple[str, str], ...]
    events: int

    def of(self, task: str) -> tuple[str, str]:
        """Return the index of the first rule of a task and their number, as in C."""
        own = [i for i, (name, _) in enumerate(self.rules) if name == task]
        return f"{own[0] if own else 0}U", f"{len(own)}U"


def health_of(model: TaskModel, schedule: Schedule) -> Health:
    """Return the rules in the order of their tasks; the one that stands first in the model goes before the others."""
    modes = {mode.name: i for i, mode in enumerate(schedule.modes)}
    found: list[tuple[str, str]] = []
    events = 0
    for priority, rule in sorted(enumerate(model.health), key=lambda entry: entry[1].task):
        mode = f"{modes[rule.mode]}U" if rule.action is HealthAction.SWITCH else "HP_NO_TABLE"
        row = f"{events}U, {mode}, {priority}U, {' | '.join(_FLAGS[rule.event])}, {rule.count}U, {rule.cycles}U"
        found.append((rule.task, f"{row}, HEALTH_{rule.action.name}"))
        events += rule.count
    return Health(tuple(found), events)


FOLDER = Path(__file__).with_name("templates")

DECISION = 2
"""Ticks before the end of a hyperperiod at which the runtime reads a mode request."""


def margin(profile: Profile) -> int:
    """Return the ticks by which a modelled execution ends before its deadline: at least 2 us."""
    return -(-2 * profile.timebase // 1_000_000)


@dataclass(slots=True)
class Renderer:
    """Fills the templates for one target."""

    profile: Profile
    environment: Any = field(init=False)

    def __post_init__(self) -> None:
        self.environment = environment(FOLDER)
        self.environment.trim_blocks = False
        self.environment.filters["hex"] = hex
        self.environment.globals["profile"] = self.profile

    def fill(self, template: str, **values: Any) -> str:
        """Return a template filled with values; all know the profile."""
        text: str = self.environment.get_template(template).render(**values)
        return text

    def image_script(self, part: Part, core: Core, at: int, place: tuple[int, int] = (0, 0)) -> str:
        """Return the linker script of an image that is stored at address `at`; `place`: how far behind others."""
        return self.fill(
            "image.ld",
            part=part,
            core=core,
            at=at,
            functions=list(functions_of(part.version)),
            symbols=list(part.symbols),
            code=core.ispm.base + MONITOR + place[0],
            data=core.dspm.base + self.profile.stack + place[1],
        )

    def platform(self, site: Site, slots: int, modes: int) -> str:
        """Return the header with the constants of the target."""
        return self.fill(
            "platform.h",
            cores=list(site.cores.values()),
            slots=slots,
            modes=modes,
            memory=site.memory,
            health=site.health,
            drivers=site.drivers.functions,
            regulators=site.platform,
            calibrate=site.calibrates,
            decision=DECISION,
            margin=margin(self.profile),
            trace=TRACE_RECORDS,
            faults=FAULT_RECORDS,
        )

    def tables(self, model: str, site: Site, plan: Plan, monitors: Sequence[tuple[Core, tuple[int, int]]]) -> str:
        """Return the operation tables as C; `monitors` are (address in main memory, bytes) for each core."""
        modes = [table for table in plan.tables if table.is_mode]
        switches = [[-1] * len(modes) for _ in modes]
        for index, table in enumerate(plan.tables):
            if not table.is_mode:
                switches[table.origin][table.target] = index
        names = {core.index: core.unit for core, _ in monitors}
        return self.fill(
            "tables.c",
            model=model,
            tick=self.profile.tick,
            programs=plan.programs,
            tables=plan.tables,
            switches=switches,
            monitors=monitors,
            health=site.health,
            drivers=site.drivers.functions,
            units=lambda program: " ".join(names[u] for u in program.units),
        )

    def board(self, memory: MainMemory) -> dict[str, str]:
        """Return texts that bring a bundle onto a board, and the tiles of a Rocket system where the profile is one."""
        rings = {"control": 8 * 18, "trace": TRACE_RECORDS, "faults": FAULT_RECORDS}
        values: dict[str, Any] = {"memory": memory, **rings}
        names = ["openocd.cfg", "run.gdb", "boot.json"]
        code, data = self.profile.ispm.size // LINE, self.profile.dspm.size // LINE
        sets = {ways: Fraction(code, ways - 1) for ways in (2, 4, 8, 16, 32)}  # one way stays a cache
        ways = next((ways for ways, n in sets.items() if n.denominator == n.numerator.bit_count() == 1), 0)
        if ways and data.bit_count() == 1 and not self.profile.dspm.has_reservations:  # as a DTIM
            names.append("Rocket.scala")
            values |= {"dtim_sets": data, "itim_sets": sets[ways], "itim_ways": ways}
        return {f"board/{name}": self.fill(f"board/{name}", **values) for name in names}

    def makefile(self, shop: Workshop) -> str:
        """Return the Makefile that repeats the recipe."""
        return self.fill(
            "Makefile",
            toolchain=shop.toolchain,
            flags=" ".join(shop.toolchain.flags),
            link_flags=" ".join(shop.toolchain.link_flags),
            compiles=shop.compiles,
            links=shop.links,
            defines=lambda step: " ".join(shlex.quote(f"-D{d}").replace("$", "$$") for d in step.defines),
        )
