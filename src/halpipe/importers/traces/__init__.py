"""Reading of traces: what a simulation, a board or a Linux system recorded, for comparison with the schedule.

Each form has a module: `table` for CSV, `btf` for the Best Trace Format, `slices` for the Trace Event Format that
Perfetto and Chrome use, `perfetto` for its protobuf form, `ftrace` and `tracedat` for switches of the kernel, `mdf`,
`ctf` for directories. `jobs` is the model of events that they share. The form follows from the content of a file.
"""

from halpipe.importers.traces.read import Recording, read_traces

__all__ = ["Recording", "read_traces"]
