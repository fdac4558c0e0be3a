"""Reader of CTF, the Common Trace Format, 1.8 and 2.

`metadata` reads the declarations of CTF 1.8 and `fragments` those of CTF 2, `decoding` compiles them, `streams` reads
the packets.
"""

from halpipe.importers.traces.ctf.decoding import CtfError
from halpipe.importers.traces.ctf.streams import METADATA, Damage, Event, events, folders

__all__ = ["METADATA", "CtfError", "Damage", "Event", "events", "folders"]
