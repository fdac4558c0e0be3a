"""The words of platforms and options: names of the back-ends and of the rules of rounding."""

from halpipe.devices import DEVICES

BACKENDS = tuple(DEVICES)

RULES = AUTO, WHOLE, CONTROLLED = "auto", "whole", "controlled"
"""Whole bursts for every phase; sums that are right whenever they can be; or whole bursts where they fit."""
