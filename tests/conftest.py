"""Fixtures for every test."""

import gc
import sys
from pathlib import Path

from hypothesis import settings

sys.path.insert(0, str(Path(__file__).parent))

sys.path.insert(0, str(Path(__file__).parents[1]))

import build_native

import profiles

profiles.register()


def pytest_configure(config):
    """Try fewer examples where the slow tests are left out; `--hypothesis-profile` has the last word."""
    if not config.getoption("--hypothesis-profile"):
        settings.load_profile("fast" if config.getoption("markexpr") == "not slow" else "full")
    if not hasattr(config, "workerinput") and build_native.is_stale():  # in a working copy whose C sources have changed
        build_native.in_place()


def pytest_collection_finish():
    """Keep the tests themselves out of the garbage collector's way, which else looks through them all every time."""
    gc.collect()
    gc.freeze()
