"""Export to Linux: a bundle in C whose dispatcher starts every job at its instant, under SCHED_FIFO, on its CPU."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from halpipe.exporters.base import ExportOptions, specific
from halpipe.extent import Extent

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.models import Schedule, TaskModel
    from halpipe.settings import Fields

PRIORITY = 50


@dataclass(frozen=True, slots=True, kw_only=True)
class LinuxOptions(ExportOptions):
    """What may be chosen of a bundle.

    - `cpus`: the Linux CPU of each unit (None: in the order of the model); `priority` of SCHED_FIFO, 1 to 98, for the
      lowest thread.
    - `sources` is the folder that source files are relative to (empty: that of the model file); nothing outside it
      is read.
    - `busy`: versions without sources get a program that takes so many percent of their WCET; 0: they are errors.
    """

    cpus: Mapping[str, int] | None = None
    priority: int = PRIORITY
    sources: str = ""
    busy: int = 0


class LinuxExporter:
    """Writes the tables as C, with the dispatcher that plays them and all to build, install and check it."""

    name = "linux"
    summary = "bundle for Linux in C: dispatcher under SCHED_FIFO, tables, programs, systemd unit"
    extent = Extent(
        {
            "units": "CPUs, in the model's order or as stated",
            "versions": "a shared object each, loaded by the dispatcher",
            "split": "a function for each piece between split points; anywhere: by priorities",
            "transfers": "between buffers and variables of the program, at the start and the end of a job",
            "modes": "tables",
            "transitions": "switches on request, at the end of a table",
            "sources": "compiled by the bundle's Makefile",
            "schedule": "every start is an absolute instant of a clock",
            "parts": "held at split points until the next part; anywhere: preempted",
            "tables": "played between those of the modes",
        },
        (
            "Jobs start at whole nanoseconds.",
            "Bounds of access phases are not enforced; export the regulator format for that.",
            "The program of a gang runs on its first unit; the others are kept free for it.",
        ),
    )
    needs_schedule = True
    suffix = ""
    keys = ("cpus", "priority", "sources", "busy")

    def options(self, common: ExportOptions, fields: Fields, base: str) -> LinuxOptions:
        """Return the options that a pipeline file states; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.linux.options import busy_share, priority
        from halpipe.exporters.ros.options import cpu_number

        cpus = None
        if (section := fields.section("cpus", (), f"{fields.path} cpus")) is not None:
            found = {unit: section.get(unit, cpu_number) for unit in section}
            cpus = {unit: stated.value for unit, stated in found.items() if stated is not None}
        return LinuxOptions(
            title=common.title,
            mode=common.mode,
            cpus=cpus,
            priority=fields.value("priority", priority, PRIORITY),
            sources=fields.value("sources", lambda text: f"{base}/{text}", ""),
            busy=fields.value("busy", busy_share, 0),
        )

    def write(self, model: TaskModel, schedule: Schedule | None, options: ExportOptions) -> dict[str, bytes]:
        """Return the bundle as a folder; see `halpipe.exporters.base.Exporter`."""
        from halpipe.exporters.linux.bundle import build
        from halpipe.exporters.selection import select

        chosen = select(model, schedule, options.mode, self.name)
        if options.mode:  # the bundle is a system of its own, that knows no other mode
            model = model.alone(options.mode)
        return build(model, chosen, specific(LinuxOptions, options))


FORMAT = LinuxExporter()
