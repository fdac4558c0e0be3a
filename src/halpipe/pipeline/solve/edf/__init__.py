"""Tables of preemptive jobs: earliest deadline first over segments, and a search over its inputs (MODEL 8.3)."""
