"""Import of ROS graphs: CARET architecture.yaml, rqt_graph and hand-written DOT, Autoware System Design.

The steps, each in its own module: `sniff` tells files apart; `caret`, `dot`, `design` with `structure`, `traced` and
`rosbag` read them into the common `graph`; `coverage` leaves out what is no application; `activation` gives callbacks
their periods; `dataflow` cuts loops and derives precedence and chains; `build` makes the task model; `calibrate` fills
in WCETs. `build` also reads back the executor configurations that halpipe wrote.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.core.extent import Extent
from halpipe.core.options import specific
from halpipe.importers.ros.options import RosImportOptions

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.common.base import Imported, ImportOptions


class RosFormat:
    """The door of the ROS importer (entry point ``halpipe.importers``)."""

    name = "ros"
    summary = "ROS: CARET architecture.yaml, rqt_graph DOT, Autoware System Design; rosbag2 metadata.yaml for periods"
    extent = Extent(
        {
            "units": "compute units of a design",
            "resources": "mutually exclusive callback groups",
            "tasks": "timer and subscription callbacks, nodes of a DOT graph, processes of a design",
            "versions": "WCETs from measured durations (`--calibrate`)",
            "accesses": "of tasks in such groups: from start to end, wholly",
            "precedence": "topics, from publisher to reader",
            "chains": "named paths, without limits",
            "modes": "modes of a design",
            "origins": "file and line of node, callback or process",
            **dict.fromkeys(
                ("timing", "split", "binding", "interrupts", "transfers", "transitions", "health", "sources"),
                "native model of an executors file, which has the rest of a model, too",
            ),
        },
        (
            "Service callbacks and executors have no place in the model and are counted as ignored.",
            "No ROS graph states WCETs or memory phases, and only designs state modes; the overlay does.",
        ),
    )

    options = RosImportOptions

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read one graph and any number of recordings; raise `HalpipeError` when no task is in them."""
        from halpipe.importers.ros.build import import_graph

        return import_graph(paths, specific(RosImportOptions, options))


FORMAT = RosFormat()
