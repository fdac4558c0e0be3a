"""Plan placeholder."""
