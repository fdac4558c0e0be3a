"""The words of platforms and options: names of the back-ends and of the rules of rounding."""

BACKENDS = ("table", "axi-realm", "qos400", "memguard", "resctrl")

RULES = AUTO, WHOLE, CONTROLLED = "auto", "whole", "controlled"
"""Whole bursts for every phase; sums that are right whenever they can be; or whole bursts where they fit."""
