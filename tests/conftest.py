"""Fixtures for every test."""

import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))

import profiles

profiles.register()


def pytest_configure(config):
    """Try fewer examples where the slow tests are left out; `--hypothesis-profile` has the last word."""
    if not config.getoption("--hypothesis-profile"):
        settings.load_profile("fast" if config.getoption("markexpr") == "not slow" else "full")
