"""One run of a bundle: its plan, its engine (co-simulation or QEMU), faults put into it, and the record of it."""
