"""halpipe checks itself: two checkers that share nothing judge the same faulty files, and evidence is made of it."""

from halpipe.selftest.run import Outcome, run

__all__ = ["Outcome", "run"]
