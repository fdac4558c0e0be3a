"""A small imported model, and overlays written in tests or kept as fixtures with the expected codes in comments."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.common.base import Coverage
from halpipe.importers.overlay import OverlayUse, read_overlays
from support import after, chain, model, task, version

FIXTURES = Path(__file__).parent / "overlay_fixtures"
_MARK = re.compile(r"# ((?:HAL\d{4} ?)+)$")


def imported():
    """Four tasks as an importer leaves them: one guessed unit, a version "default", mostly without WCET."""
    tasks = (
        task("/sensing/lidar", "100ms", version("default", None, "core0")),
        task("/planning", "100ms", version("default", None, "core0", after("/sensing/lidar", 0, 100, "end"))),
        task(
            "/control",
            "50ms",
            version("default", 2, "core0", after("/planning", 0, 100), after("/debug/view", 0, 100)),
        ),
        task("/debug/view", "200ms", version("default", None, "core0")),
    )
    chains = (
        chain("drive", "/sensing/lidar /planning /control", reaction=400),
        chain("look", "/sensing/lidar /debug/view"),
    )
    return model(*tasks, units="core0", chains=chains)


def overlay(tmp_path, *texts):
    """Read overlays of which each text is the body of a file; later ones win."""
    paths = []
    for number, text in enumerate(texts):
        path = tmp_path / f"overlay{number}.yaml"
        path.write_text("halpipe-overlay: 1\n" + text)
        paths.append(str(path))
    return read_overlays(paths)


def apply(given, to=None):
    """Apply an overlay; return the model, the diagnostics and the account."""
    coverage = Coverage()
    result, diagnostics = OverlayUse(given).apply(to or imported(), coverage)
    return result, diagnostics, coverage


def applied(tmp_path, *texts, to=None):
    """Apply overlays that are expected to fit; return the model alone."""
    result, diagnostics, _ = apply(overlay(tmp_path, *texts), to)
    assert [d for d in diagnostics if d.is_error] == []
    return result


def marks(path):
    """Return the (line, code) pairs that a fixture announces in its comments."""
    lines = path.read_text().splitlines()
    return sorted(
        (number, code)
        for number, line in enumerate(lines, 1)
        if (match := _MARK.search(line))
        for code in match[1].split()
    )


def refusal(*paths):
    """Return the diagnostics with which reading fails; none if it succeeds."""
    try:
        read_overlays([str(path) for path in paths])
    except HalpipeError as failure:
        return failure.diagnostics
    return ()


def _bare_versions(owner):
    stripped = (
        replace(v, origin=None, precedences=tuple(replace(p, origin=None) for p in v.precedences))
        for v in owner.versions
    )
    return tuple(stripped)


def bare(system):
    """The model without origins and file."""
    return replace(
        system,
        name="",
        origin=None,
        units=tuple(replace(u, origin=None) for u in system.units),
        resources=tuple(replace(r, origin=None) for r in system.resources),
        tasks=tuple(replace(t, origin=None, versions=_bare_versions(t)) for t in system.tasks),
        chains=tuple(replace(c, origin=None) for c in system.chains),
        modes=tuple(replace(m, origin=None) for m in system.modes),
        transitions=tuple(replace(t, origin=None) for t in system.transitions),
        health=tuple(replace(r, origin=None) for r in system.health),
    )
