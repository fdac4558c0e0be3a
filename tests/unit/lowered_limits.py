"""Trials of limits that are too large to be reached: lowered, then at the limit and one beyond."""

from contextlib import contextmanager
from importlib import import_module
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError, Location

ELEMENT = SimpleNamespace(at=Location(), path="e", name="e")


def registry():
    """Return an empty table of trials, and the decorator that adds one."""
    limits = {}

    def lowered(name, value, says, **others):
        """Register a trial of the constant `name`, set to `value`; beyond it, its answer contains `says`.

        `others` are set in the same module.
        """

        def register(trial):
            assert name not in limits
            limits[name] = (value, says, others, trial)
            return trial

        return register

    return limits, lowered


def named(path):
    module, _, name = path.partition(":")
    return getattr(import_module(f"halpipe.{module}"), name)


def fake(**members):
    return SimpleNamespace(**members)


@contextmanager
def patched(module, **members):
    """Set members of a module until the end of a block."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in members.items():
            patch.setattr(import_module(f"halpipe.{module}"), name, value)
        yield


def try_both_sides(limits, name, monkeypatch):
    value, says, others, trial = limits[name]
    module, _, constant = name.partition(":")
    module = import_module(f"halpipe.{module}")
    if not hasattr(module, constant):
        pytest.skip(f"{name} is gone; remove its trial")  # one that was only renamed counts as untried
    assert getattr(module, constant) > value
    for other, instead in {constant: value, **others}.items():
        monkeypatch.setattr(module, other, instead)
    answers = []
    for number in (value, value + 1):
        try:
            answers.append(str(trial(number) or ""))
        except HalpipeError as refused:
            answers.append(" ".join(found.message for found in refused.diagnostics))
        except ValueError as refused:
            answers.append(str(refused))
    assert says not in answers[0]
    assert says in answers[1]
