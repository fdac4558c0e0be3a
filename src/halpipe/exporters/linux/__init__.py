"""Export to Linux: a bundle in C whose dispatcher starts every job at its instant, under SCHED_FIFO, on its CPU."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.extent import Extent
from halpipe.core.options import CPUS, SOURCES, Form, cpu_number, option
from halpipe.core.quantities import whole
from halpipe.core.records import record
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import Schedule, TaskModel

PRIORITY = 50
HIGHEST_PRIORITY = 98
"""The conductor has a priority above those of all levels of tasks, and 99 is the highest (sched(7))."""


@record(kw_only=True)
class LinuxOptions(ExportOptions):
    """Options of a bundle.

    - `cpus`: the Linux CPU of each unit (None: in the order of the model); `priority` of SCHED_FIFO, 1 to 98, for the
      lowest thread.
    - `sources` is the folder that source files are relative to (empty: that of the model file); nothing outside it
      is read.
    - `busy`: versions without sources get a program that takes so many percent of their WCET; 0: they are errors.
    - `regulator` is the platform of the regulators that the dispatcher starts and switches (empty: none).
    """

    cpus: Mapping[str, int] | None = option(None, CPUS, cpu_number, metavar="UNIT=CPU,...", form=Form.NAMES)
    priority: int = option(
        PRIORITY, "SCHED_FIFO priority of the lowest thread.", whole(1, HIGHEST_PRIORITY, "priority"), metavar="1..98"
    )
    sources: str = option("", SOURCES, metavar="FOLDER", is_path=True)
    busy: int = option(
        0,
        "Percent of its WCET that a version without sources takes; 0: refuse.",
        whole(0, 100, "percentage"),
        metavar="PERCENT",
    )
    regulator: str = option(
        "", "Regulators of the memory, YAML: the dispatcher drives them.", metavar="FILE", is_path=True
    )


class LinuxExporter(Exporter):
    """Writes the tables as C, with the dispatcher that plays them and all to build, install and check it."""

    name = "linux"
    summary = "bundle for Linux in C: dispatcher under SCHED_FIFO, tables, programs, systemd unit"
    help = "Write the bundle that plays the schedule on Linux: dispatcher, tables and programs in C, systemd unit."
    extent = Extent(
        {
            "units": "CPUs, in the model's order or as stated",
            "timing": "data of a LET are copied at the release and at release + LET",
            "versions": "a shared object each, loaded by the dispatcher",
            "split": "a function for each piece between split points; anywhere: by priorities",
            "transfers": "between buffers and variables of the program, at the start and the end of a job",
            "modes": "tables",
            "transitions": "switches on request, at the end of a table",
            "health": "switches after one overrun; other rules are reported",
            "sources": "compiled by the bundle's Makefile",
            "schedule": "every start is an absolute instant of a clock",
            "parts": "held at split points until the next part; anywhere: preempted",
            "tables": "played between those of the modes",
        },
        (
            "Jobs start at whole nanoseconds.",
            "Bounds of access phases are enforced by regulators alone: --regulator, or the regulator format.",
            "The program of a gang runs on its first unit; the others are kept free for it.",
        ),
    )
    suffix = ""
    options = LinuxOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: LinuxOptions) -> dict[str, bytes]:
        """Return the bundle as a folder; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.linux.bundle import build

        chosen = select(model, schedule, options.mode, self.name)
        if options.mode:  # the bundle is a system of its own, that knows no other mode
            model = model.alone(options.mode)
        return build(model, chosen, options)

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: LinuxOptions, contents: Mapping[str, bytes]
    ) -> list[Diagnostic]:
        """Return what the target leaves open, and what the report of the regulators says."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.linux.bundle import sentences
        from halpipe.exporters.linux.codes import UNREALISED
        from halpipe.exporters.regulator.embedded import FOLDER
        from halpipe.exporters.regulator.report import findings_of

        played, path = select(model, schedule, options.mode, self.name), about(model=model.name)
        found = sentences(model, played, options)
        report = contents.get(f"{FOLDER}report.json")
        regulated = [] if report is None else findings_of(report)
        return [UNREALISED(text, path=path, help=help) for text, help in found] + regulated


FORMAT = LinuxExporter()
