"""Tables of split jobs: earliest deadline first over parts, and a search over what it is told (MODEL 8.3)."""
