"""Fixtures for every test."""

import gc
import os
import re
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


def pytest_sessionfinish(session):
    """Fail where a test was skipped for another reason than those in HALPIPE_MAY_SKIP, a regular expression."""
    permitted, reporter = (
        os.environ.get("HALPIPE_MAY_SKIP"),
        session.config.pluginmanager.get_plugin("terminalreporter"),
    )
    if permitted is None or reporter is None or hasattr(session.config, "workerinput"):
        return
    reasons = {
        str(report.longrepr[2]) for report in reporter.stats.get("skipped", ()) if isinstance(report.longrepr, tuple)
    }
    for reason in sorted(reason for reason in reasons if not re.search(permitted, reason)):
        reporter.write_line(f"FAILED: this machine must not skip tests ({reason})", red=True)
        session.exitstatus = 1


def pytest_collection_finish():
    """Keep the tests themselves out of the garbage collector's way, which else looks through them all every time."""
    gc.collect()
    gc.freeze()
