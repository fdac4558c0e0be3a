"""halpipe: from vehicle software models to verified time-triggered schedules and what hardware loads."""

__version__ = "0.1.0"
