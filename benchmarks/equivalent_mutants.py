"""Mutants of verify that change no verdict and no text, each with the reason: see mutation_score.py."""

EQUIVALENT: dict[str, str] = {}
