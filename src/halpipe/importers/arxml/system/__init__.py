"""Timing content of ARXML elements, as frozen values."""
