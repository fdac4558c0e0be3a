"""Models that halpipe itself wrote as ARXML, read back exactly."""
