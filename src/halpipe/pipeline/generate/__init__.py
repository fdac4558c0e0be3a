"""Synthetic task sets that are schedulable by construction (paper, section VI-B).

A set is cut out of a schedule: every unit's hyperperiod is filled with tasks of one, two or three start times, then
access windows, precedence and alternative versions are put on what lies there, and everything is shortened to the
wanted utilisation. The schedule it was cut from is its witness.

Only whole numbers are drawn, and from ``random.Random`` alone: the same parameters and seed give the same set on every
machine. Where the paper's text leaves a choice open, ``(D)`` marks what was decided.
"""

from halpipe.pipeline.generate.parameters import SetParameters
from halpipe.pipeline.generate.system import Achieved, achieved, generate, generate_with_witness

__all__ = ["Achieved", "SetParameters", "achieved", "generate", "generate_with_witness"]
