"""How many examples hypothesis tries: all in the full suite, a part of them in the fast tier (see `conftest.py`)."""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

FULL, FAST = 100, 15
"""Examples of the two profiles; of their ratio is what `examples` takes."""

LEAST = 10
"""Examples that the fast tier leaves of any number."""


def volume(number):
    """Return how many systems a slow test draws: `number`, and some times as many with `make endurance`."""
    return number * int(os.environ.get("HALPIPE_VOLUME", "1"))


def in_turn(items, step=3):
    """Return each third of items that are all of one kind, or as many as `step` says; all in `make endurance`."""
    items = list(items)
    return items if volume(1) > 1 else items[::step]


def register():
    """Make the profiles known; neither looks at the clock, so that a busy machine changes nothing."""
    common = {"deadline": None, "derandomize": True, "suppress_health_check": [HealthCheck.too_slow]}
    settings.register_profile("full", max_examples=FULL, **common)
    settings.register_profile("fast", max_examples=FAST, **common)


def examples(number, *suppressed):
    """Return settings for so many examples in the full suite; `suppressed` are further health checks."""
    scaled = number * settings().max_examples // FULL
    checks = list(dict.fromkeys([HealthCheck.too_slow, *suppressed]))
    return settings(max_examples=max(scaled, min(number, LEAST)), suppress_health_check=checks)
