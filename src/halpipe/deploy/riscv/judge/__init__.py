"""The verdict on a run of a bundle: plan against observation, and what follows from faults."""
