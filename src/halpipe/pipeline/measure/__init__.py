"""Exact measures of a placement, independent of the search: cost, latencies, loads."""
