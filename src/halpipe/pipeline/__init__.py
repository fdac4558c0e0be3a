"""Stages between reading and writing: validation, scheduling, verification."""
