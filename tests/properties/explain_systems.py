"""Small random systems that are often, but not always, impossible: strict periods, few units, narrow windows."""

from __future__ import annotations

from fractions import Fraction

from support import access, after, chain, model, task, version

UNITS = ("a", "b", "c")
PERIODS = ((4, 6, 12), (3, 6, 9, 18), (4, 8, 16), (5, 10, 20), (6, 6, 12), (8, 12))
SLACKS = (Fraction(0),) * 5 + (Fraction(1, 4), Fraction(1, 3))
BOUNDS = (Fraction(1), Fraction(1, 2), Fraction(2, 3), Fraction(1, 3))


def random_system(rng):
    """A validatable model of 2 to 5 tasks; `rng` is any `random.Random`."""
    periods = rng.choice(PERIODS)
    tasks = []
    for number in range(rng.randint(2, 5)):
        earlier = [t for t in tasks if t.period is not None]
        tasks.append(_task(rng, f"t{number}", rng.choice(periods), earlier))
    chains = ()
    if rng.random() < 0.2:
        names = " ".join(t.name for t in tasks[:2])
        chains = (chain("c", names, reaction=rng.randint(10, 40), age=rng.randint(8, 30)),)
    return model(*tasks, units=" ".join(UNITS), resources="mem", chains=chains)


def _task(rng, name, period, earlier):
    units = rng.sample(UNITS, rng.choice((1, 1, 2, 2, 3)))
    parts = [_window(rng, rng.choice(earlier), period)] if earlier and rng.random() < 0.4 else []
    versions = [_version(rng, f"v{k}", period, units, parts) for k in range(rng.choice((1, 1, 2)))]
    offset = rng.randrange(period) if rng.random() < 0.15 else None
    return task(name, period, *versions, slack=rng.choice(SLACKS), offset=offset)


def _version(rng, name, period, units, parts):
    wcet = rng.randint(1, max(1, period * 2 // 3))
    gang = 2 if len(units) > 1 and rng.random() < 0.15 else 1
    if rng.random() < 0.3:
        start = rng.randrange(wcet)
        parts = [*parts, access("mem", start, rng.randint(start + 1, wcet), rng.choice(BOUNDS))]
    return version(name, wcet, " ".join(rng.sample(units, rng.randint(gang, len(units)))), *parts, gang=gang)


def _window(rng, other, period):
    low = rng.randint(0, 4)
    width = rng.choice((0, 1, 2, period - 1, 2 * period))
    return after(other.name, low, low + width, rng.choice(("start", "end")))
