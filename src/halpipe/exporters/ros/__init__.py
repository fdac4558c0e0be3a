"""Export to ROS 2 on Linux: one executor for each unit, callback groups, and timers that start every job on time."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.diagnostics import Diagnostic, about
from halpipe.core.extent import ASPECTS, Extent
from halpipe.core.options import CPUS, Form, cpu_number, option, positive_duration
from halpipe.core.quantities import whole
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.exporters.common.base import Exporter, ExportOptions

if TYPE_CHECKING:
    from collections.abc import Mapping

    from halpipe.core.durations import Duration
    from halpipe.models import Schedule, TaskModel
    from halpipe.models.trace import BoundCallback

PRIORITY = 80
HIGHEST_PRIORITY = 99
"""Linux knows real-time priorities from 1 to 99 (sched(7))."""
WITHOUT_GAPS = (
    "export the ament package (--package) or the linux format, whose threads are interrupted; or schedule without split"
)
WITHOUT_POINTS = "export the linux format, which holds programs at split points; or schedule without split"
WITH_HOLDS = "make the phase a task of its own, or export the linux format, which holds programs between functions"

OLDEST, NEWEST = MESSAGES = ("oldest", "newest")


@record(kw_only=True)
class RosOptions(ExportOptions):
    """`cpus`: the Linux CPU of each unit (None: in the order of the model); `priority` of SCHED_FIFO, 1 to 99.

    Units that `cpus` does not name get no affinity. With `package` an ament package is written
    instead of the YAML file; `bindings` has the callback of each task for it, and `messages` says which of the waiting
    messages a job of a subscription gets, one of `MESSAGES`.
    """

    cpus: Mapping[str, int] | None = option(None, CPUS, cpu_number, metavar="UNIT=CPU,...", form=Form.NAMES)
    priority: int = option(
        PRIORITY, "Priority of the executors, SCHED_FIFO.", whole(1, HIGHEST_PRIORITY, "priority"), metavar="1..99"
    )
    package: bool = option(False, "Write an ament package that plays the tables, as a folder.", form=Form.SWITCH)
    messages: str = option(
        NEWEST,
        "With --package: a job gets the newest waiting message and drops the others, or the oldest.",
        Words(*MESSAGES),
    )
    graphs: tuple[str, ...] = option(
        (),
        "With --package: graph or trace that says which callback each task is; repeatable.",
        name="graph",
        metavar="PATH",
        form=Form.LIST,
        is_path=True,
    )
    wait: Mapping[str, Duration] | None = option(
        None,
        "With --package: time for which a job waits for its message, at most; its WCET contains it.",
        positive_duration,
        metavar="TASK=TIME,...",
        form=Form.NAMES,
    )
    missing: Mapping[str, str] | None = option(
        None,
        "With --package: mode to go to when there is no message for a job.",
        metavar="TASK=MODE,...",
        form=Form.NAMES,
    )
    bindings: Mapping[str, BoundCallback] | None = None

    def unused(self) -> tuple[str, ...]:
        """Return the options without effect: only a package plays messages."""
        return () if self.package else ("messages", "graphs", "wait", "missing")


class RosExporter(Exporter):
    """Writes one YAML file from which a launcher makes executors, callback groups and timers."""

    name = "ros"
    summary = "ROS 2 on Linux (YAML): executors with core affinity, callback groups, timers with offsets"
    help = "Write executors, callback groups and timers (YAML) that realise a schedule with ROS 2 on Linux."
    extent = Extent(
        {
            **dict.fromkeys(ASPECTS, "in the native model"),
            "schedule": "timers with period and offset, in callback groups of the executor of their unit",
            "units": "an executor for each that has jobs",
            "health": "with --package: switches after one overrun or exception",
            "parts": "with --package: preempted by priorities",
            "tables": "with --package",
        },
        (
            "Jobs start at whole nanoseconds, and by time, also those of tasks without a period.",
            "The callback of a gang runs on one CPU; the others are only kept free for it.",
            "Jobs with gaps are refused; the package (--package) plays those that are interrupted anywhere.",
        ),
    )
    suffix = ".yaml"
    options = RosOptions

    def write(self, model: TaskModel, schedule: Schedule | None, options: RosOptions) -> dict[str, bytes]:
        """Return one document; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import refuse_early_phases, refuse_gaps, refuse_let, select
        from halpipe.exporters.ros.document import format_executors

        chosen = select(model, schedule, options.mode, self.name)
        refuse_let(model, chosen, "an executor")
        if options.mode:  # what is written is a system of its own, that knows no other mode
            model = model.alone(options.mode)
        if options.package:
            from halpipe.exporters.ros.packaging import build

            return build(model, chosen, options)
        refuse_gaps(model, chosen, "an executor interrupts no callback", WITHOUT_GAPS, WITHOUT_POINTS)
        refuse_early_phases(model, chosen, "an executor does not hold a callback until the phase begins", WITH_HOLDS)
        return {"": format_executors(model, chosen, options)}

    def remarks(
        self, model: TaskModel, schedule: Schedule | None, options: RosOptions, contents: Mapping[str, bytes]
    ) -> list[Diagnostic]:
        """Return what the target leaves open; see `halpipe.exporters.common.base.Exporter`."""
        from halpipe.exporters.common.selection import select
        from halpipe.exporters.ros.codes import UNREALISED

        played = select(model, schedule, options.mode, self.name)
        if options.package:
            from halpipe.exporters.ros.packaging import sentences as of_package
            from halpipe.exporters.ros.waits import wait_remarks

            sentences, more = of_package(model, played), wait_remarks(model, options)
        else:
            from halpipe.exporters.ros.document import sentences as of_document

            sentences, more = of_document(model, played, options), []
        path = about(model=model.name)
        return [*(UNREALISED(text, path=path, help=help) for text, help in sentences), *more]


FORMAT = RosExporter()
