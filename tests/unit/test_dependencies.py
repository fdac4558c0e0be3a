"""What halpipe needs is stated in one place; the oldest and the locked versions follow it."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
STATED = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def names_and_bounds(requirements):
    found = (re.match(r"([A-Za-z0-9_.-]+)(?:>=([0-9.]+))?", text) for text in requirements)
    return {m[1].lower(): m[2] for m in found}


def pinned(name):
    lines = (ROOT / "constraints" / name).read_text().splitlines()
    return dict(line.lower().split("==") for line in lines if line and not line.startswith("#"))


def as_numbers(version):
    return tuple(int(part) for part in re.findall(r"[0-9]+", version))


def test_the_oldest_versions_are_the_lower_bounds():
    bounds = names_and_bounds(STATED["dependencies"])
    assert {name: as_numbers(version)[:2] for name, version in pinned("lowest.txt").items()} == {
        name: as_numbers(version)[:2] for name, version in bounds.items()
    }


def test_the_locked_versions_are_allowed():
    locked = pinned("locked.txt")
    for requirements in (STATED["dependencies"], *STATED["optional-dependencies"].values()):
        for name, bound in names_and_bounds(requirements).items():
            if name == "hatchling":  # builds the package, in an environment of its own
                continue
            assert name in locked, f"make lock writes {name}"
            assert bound is None or as_numbers(locked[name]) >= as_numbers(bound)
