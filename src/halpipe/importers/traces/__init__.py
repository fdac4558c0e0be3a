"""Reading of traces: what a simulation, a board or a Linux system recorded, for comparison with the schedule.

Each form has a module: `table` for CSV, `btf` for the Best Trace Format, `events` for the Trace Event Format that
Perfetto and Chrome use. Which one a file is, its content tells, not its name.
"""

from halpipe.importers.traces.read import Recording, read_traces

__all__ = ["Recording", "read_traces"]
