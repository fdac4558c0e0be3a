"""Helpers of the validation tests."""

from halpipe.pipeline.validate import validate
from support import model, task, version


def found(system, code):
    """The findings of one code."""
    return [d for d in validate(system) if d.code == code.id]


def the(system, code):
    """The only finding of one code."""
    (finding,) = found(system, code)
    return finding


def codes_of(system):
    return {d.code for d in validate(system)}


def alone(wcet="5ms", *parts, units="u1", gang=1, period="25ms", resources="", **of_task):
    """A model of one task "a" with one version "v"."""
    platform = " ".join(dict.fromkeys(units.split())) or "u1"
    owner = task("a", period, version("v", wcet, units, *parts, gang=gang), **of_task)
    return model(owner, units=platform, resources=resources)
