"""Shorthands for tests of the ROS importer."""

from pathlib import Path

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import Duration
from halpipe.importers.ros import FORMAT
from halpipe.importers.ros.options import RosImportOptions

FIXTURES = Path(__file__).parent / "ros_fixtures"


class Overlay:
    """Stands in for an overlay in use: what it drops and which sources it gives a period."""

    names_units = False

    def __init__(self, sources=None, drop=(), periods=None):
        self.sources = sources or {}
        self.periods = periods or {}
        self.drop = drop
        self.asked = []

    def drops(self, name):
        self.asked.append(name)
        return name in self.drop

    def source_period(self, topic):
        return Duration.parse(self.sources[topic]) if topic in self.sources else None

    def task_period(self, name):
        return Duration.parse(self.periods[name]) if name in self.periods else None


def read(*files, sources=None, drop=(), periods=None, strict=False, name=""):
    """Import fixtures (or absolute paths)."""
    paths = [str(FIXTURES / file) for file in files]
    options = RosImportOptions(overlay=Overlay(sources, drop, periods), strict=strict, name=name)
    return FORMAT.read(paths, options).completed()


def refusal(*files, **options):
    """Return the exception of an import that fails."""
    try:
        read(*files, **options)
    except HalpipeError as failure:
        return failure
    raise AssertionError("the import succeeded")


def write(folder, text, name="graph.dot"):
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def found(diagnostics, code):
    return [d for d in diagnostics if d.code == code.id]


def places(diagnostics, code):
    """Return (line, path) of every diagnostic of a code."""
    return [(d.at.line, d.path) for d in found(diagnostics, code)]


def periods(imported):
    return {task.name: str(task.period) for task in imported.model.tasks}


def predecessors(imported):
    return {task.name: [p.task for p in task.versions[0].precedences] for task in imported.model.tasks}


def reasons(imported, kind):
    return {e.name: e.reason for e in imported.coverage.ignored_elements if e.kind == kind}


def rows(imported):
    return {kind: counts for kind, *counts in imported.coverage.rows()}
