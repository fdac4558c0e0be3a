"""A reader of CTF 1.8, the Common Trace Format, as LTTng writes it for user space and kernel.

`metadata` reads the declarations, `decoding` compiles them, `streams` walks the packets.
"""

from halpipe.importers.traces.ctf.streams import METADATA, Damage, Event, events, folders
from halpipe.importers.traces.ctf.types import CtfError

__all__ = ["METADATA", "CtfError", "Damage", "Event", "events", "folders"]
