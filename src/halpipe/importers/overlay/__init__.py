"""The overlay: a YAML file that adds to an import what its source format cannot say.

Public ARXML and ROS graphs state no WCETs, no memory phases and mostly no deadlines. An overlay states them, keyed by
the names of the imported elements or by globs of those names::

    overlay = read_overlays(["base.yaml", "board.yaml"])     # later files win
    use = OverlayUse(overlay)                                # one import
    use.drops("/rviz")                                       # asked by the importer while it reads
    use.source_period("/scan")
    model, diagnostics = use.apply(model, coverage)          # everything else, at the end
"""

from halpipe.importers.overlay.entries import Overlay
from halpipe.importers.overlay.reader import read_overlays
from halpipe.importers.overlay.use import OverlayUse

__all__ = ["Overlay", "OverlayUse", "read_overlays"]
