"""The path of an element is made for findings: where nothing is found, their number does not grow with the model."""

import pytest

from halpipe import diagnostics
from halpipe.pipeline.validate import validate
from halpipe.pipeline.verify import verify
from support import job, model, schedule, task, version


@pytest.fixture
def paths(monkeypatch):
    made = []
    original = diagnostics.Path.__new__

    def counted(cls, text, subjects=()):
        made.append(text)
        return original(cls, text, subjects)

    monkeypatch.setattr(diagnostics.Path, "__new__", counted)
    return made


def system(count):
    names = [f"t{n}" for n in range(count)]
    tasks = [task(name, "100ms", version("v", "1ms")) for name in names]
    jobs = [job(name, 0, 2 * n, 2 * n + 1) for n, name in enumerate(names)]
    return model(*tasks), jobs


@pytest.mark.parametrize("checks", [lambda a, _: validate(a), verify], ids=["validate", "verify"])
def test_nothing_found_costs_no_paths(paths, checks):
    counts = []
    for size in (5, 40):
        given, jobs = system(size)
        made = schedule(given, all=jobs)
        paths.clear()
        assert [found for found in checks(given, made) if found.is_error] == []
        counts.append(len(paths))
    assert counts[0] == counts[1]
