"""Import of ROS graphs: CARET architecture.yaml, rqt_graph and hand-written DOT, periods from rosbag2 recordings.

The steps, each in its own module: `sniff` tells files apart; `caret`, `dot` with `rqt`, and `rosbag` read them into
the common `graph`; `drops` leaves out what is no application; `periods` and `activation` give callbacks their
periods; `dataflow` cuts loops and derives precedence; `build` makes the task model.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from halpipe.importers.base import Imported, ImportOptions


class RosFormat:
    """The door of the ROS importer (entry point ``halpipe.importers``)."""

    name = "ros"
    summary = "ROS graphs: CARET architecture.yaml or rqt_graph DOT, with periods from rosbag2 metadata.yaml"

    def read(self, paths: Sequence[str], options: ImportOptions) -> Imported:
        """Read one graph and any number of recordings; raise `HalpipeError` when no task is in them."""
        from halpipe.importers.ros.build import import_graph

        return import_graph(paths, options)


FORMAT = RosFormat()
