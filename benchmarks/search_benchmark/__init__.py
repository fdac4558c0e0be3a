"""Benchmarks: the paper's Table III and harder sets, from generated set to a table and a plot.

What is computed (success, moves, the bytes of the schedule) depends on the suite, the seeds and the budget alone; what
is measured (seconds) stands apart from it everywhere, so that two runs can be compared byte by byte.
"""

from search_benchmark.instance import Instance, measure
from search_benchmark.results import Report, report
from search_benchmark.suites import SUITES, Row, given_rows

__all__ = ["SUITES", "Instance", "Report", "Row", "given_rows", "measure", "report"]
