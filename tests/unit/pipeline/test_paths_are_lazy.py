"""The path of an element is made for findings: where nothing is found, their number does not grow with the model."""

import pytest

from halpipe.core.diagnostics import Path
from halpipe.pipeline.validate import CHECKS
from halpipe.pipeline.validate.context import Context
from halpipe.pipeline.verify import verify
from support import job, model, schedule, task, version


@pytest.fixture
def paths(monkeypatch):
    made = []
    original = Path.__new__

    def counted(cls, text, subjects=()):
        made.append(text)
        return original(cls, text, subjects)

    monkeypatch.setattr(Path, "__new__", counted)
    return made


def system(count):
    found = model(*(task(f"t{n}", "100ms", version("v", "1ms")) for n in range(count)))
    return found, schedule(found, "100ms", *(job(found, f"t{n}", 0, 2 * n, "u1") for n in range(count)))


NAMES = {"names", "unique-names", "lists"}


def check_names(given, _):
    context = Context(given)
    chosen = [check for check in CHECKS if check.name in NAMES or check.name.endswith("-references")]
    assert len(chosen) == 8
    return [found for check in chosen for found in check.run(context)]


@pytest.mark.parametrize("check", [check_names, verify])
def test_what_finds_nothing_makes_no_paths(paths, check):
    counts = []
    for given, made in (system(5), system(40)):
        paths.clear()
        assert [found for found in check(given, made) if found.is_error] == []
        counts.append(len(paths))
    assert counts[0] == counts[1]
