"""RISC-V bundles: task images, the runtime of the management core, and all to load, rebuild and check them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from halpipe.core.extent import Extent
from halpipe.core.options import DRIVERS, SOURCES, Form, option, specific
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from halpipe.core.diagnostics import Diagnostic
    from halpipe.models import HealthRule, Schedule, TaskModel

DEFAULT_PROFILE = "vcu118"


TARGET: dict[str, Callable[[], Any]] = {
    "profile": lambda: option(
        DEFAULT_PROFILE,
        "Target: a profile's name, or a file: .yaml, .dts of Rocket, csr.json of LiteX.",
        is_path=lambda text: text.endswith((".yaml", ".yml", ".dts", ".json")),
    ),
    "toolchain": lambda: option("auto", "zig, gcc, or auto: zig where it is installed.", Words("auto", "zig", "gcc")),
    "sources": lambda: option("", SOURCES, metavar="FOLDER", is_path=True),
    "drivers": lambda: option("", DRIVERS, metavar="FILE", is_path=True),
}
"""Options of the target, stated once for the export and for the preparation of a model."""


@record(kw_only=True)
class RiscvOptions(ExportOptions):
    """Options of a bundle.

    - `profile` is a name, or a file that ends in ``.yaml``, ``.dts`` or ``.json``; `toolchain` is ``auto``, ``zig``
      or ``gcc``.
    - `sources` is the folder that source files are relative to (empty: that of the model file); nothing outside it
      is read. `regulator` is the platform of the regulators whose tables go with the programs (empty: none).
    - `drivers` states functions of the board that fill and empty buffers (empty: none).
    - `calibrate` has the runtime measure the target first, for `deploy calibrate`.
    - `inputs` is a folder with recorded contents of buffers, which a check plays (empty: none).
    """

    profile: str = TARGET["profile"]()
    toolchain: str = TARGET["toolchain"]()
    sources: str = TARGET["sources"]()
    regulator: str = option(
        "", "Regulators of the memory, YAML: their tables go into the bundle.", metavar="FILE", is_path=True
    )
    drivers: str = TARGET["drivers"]()
    calibrate: bool = option(
        False, "Measure transfers and instructions before the run, for deploy calibrate.", form=Form.SWITCH
    )
    inputs: str = option(
        "", "Recorded contents of buffers, BUFFER.bin for each: the check plays them.", metavar="FOLDER", is_path=True
    )


@record(kw_only=True)
class PrepareOptions:
    """Options of the preparation of a model; see `RiscvOptions`."""

    profile: str = TARGET["profile"]()
    toolchain: str = TARGET["toolchain"]()
    sources: str = TARGET["sources"]()
    drivers: str = TARGET["drivers"]()
    dummy: bool = option(False, "Make sources for versions that have none.", form=Form.SWITCH)

    @property
    def target(self) -> RiscvOptions:
        """The options of an export for the same target."""
        return RiscvOptions(**{name: getattr(self, name) for name in TARGET})


class RiscvExporter(Exporter):
    """Compiles the tasks of a schedule and writes them with a runtime that plays it, as a folder."""

    name = "riscv"
    summary = "bundle for a RISC-V multicore with scratchpads: images, runtime, tables, Makefile"
    help = "Compile the tasks and write the bundle that plays the schedule on RISC-V cores with scratchpads."
    extent = Extent(
        {
            "units": "application cores with scratchpads, in the model's order",
            "resources": "DMA channels, one for each resource whose phases move data",
            "versions": "an image for each unit that it is scheduled on",
            "accesses": "DMA transfers within their phases",
            "transfers": "between buffers in main memory and variables of the task",
            "modes": "tables of releases",
            "transitions": "switches on request, at the hyperperiod's end",
            "health": "counted by the runtime, which switches, restarts cores or stops",
            "sources": "compiled, and part of the bundle",
            "schedule": "every start is an instant of the timer",
            "tables": "tables of releases between those of the modes",
        },
        ("Instants must be multiples of the timer's tick; boundaries of phases are rounded inwards.",),
    )
    suffix = ""
    options = RiscvOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the bundle as a folder; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.riscv.bundle import build

        chosen = select(model, schedule, options.mode, self.name)
        if options.mode:  # the bundle is a system of its own, that knows no other mode
            rules = tuple(rule for rule in model.health if rule not in _left_out(model, options.mode))
            model = replace(model, modes=(model.mode(options.mode),), transitions=(), health=rules)
        return build(model, chosen, specific(RiscvOptions, options))

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: ExportOptions, contents: Mapping[str, bytes]
    ) -> Sequence[Diagnostic]:
        """Return what one member of a gang writes alone, rules left out, and what the report of the regulators says."""
        from halpipe.core.diagnostics import Location, about, version_of
        from halpipe.exporters.regulator.embedded import FOLDER
        from halpipe.exporters.regulator.report import findings_of
        from halpipe.exporters.riscv.codes import REGULATORS_LEFT_ALONE, RULE_LEFT_OUT
        from halpipe.exporters.riscv.phases import written_alone

        found = list(written_alone((version_of(t.name, v.name), v) for t in model.tasks for v in t.versions))
        for rule in _left_out(model, options.mode):
            message, path = f'its rule after {rule.event} switches to "{rule.mode}"', about(task=rule.task)
            found.append(RULE_LEFT_OUT(message, at=rule.at, path=path, help="export without --mode"))
        report = contents.get(f"{FOLDER}report.json")
        if report is None:
            return found
        if b"HP_REGULATORS" not in contents["runtime/platform.h"]:
            help = 'state "backend: table" and "table: {base: 0x...}", the address of their registers'
            at = Location(specific(RiscvOptions, options).regulator)
            found.append(REGULATORS_LEFT_ALONE("states no registers for the runtime", at=at, help=help))
        return found + findings_of(report)


def _left_out(model: TaskModel, mode: str) -> list[HealthRule]:
    """Return the health rules that switch to another mode than the one that is exported, if it is one."""
    return [rule for rule in model.health if mode and rule.mode not in ("", mode)]


FORMAT = RiscvExporter()
