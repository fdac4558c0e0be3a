"""CP-SAT is loaded without pandas, where that works."""

import sys
from importlib import util
from types import ModuleType, SimpleNamespace

import pytest

from halpipe.pipeline.solve import solver


class Loader:
    """Loads a module, and sees what of pandas is there."""

    def __init__(self, failure=None):
        self.failure, self.seen = failure, []

    def exec_module(self, module):
        pandas = sys.modules.get("pandas")
        self.seen.append(sorted(name for name in vars(pandas) if not name.startswith("_")) if pandas else None)
        if self.failure is not None:
            raise self.failure


@pytest.fixture
def loaded(monkeypatch):
    """Load with a loader, beside such a pandas, if any; return the module, or what was imported in its place."""

    def load(loader, pandas=None):
        monkeypatch.delitem(sys.modules, "pandas", raising=False)
        if pandas is not None:
            monkeypatch.setitem(sys.modules, "pandas", pandas)
        spec = None if loader is None else SimpleNamespace(loader=loader)
        again = util.spec_from_file_location("solver_again", solver.__file__)  # the first answer is kept
        fresh = util.module_from_spec(again)
        again.loader.exec_module(fresh)
        fresh.find_spec, fresh.module_from_spec = lambda name: spec, lambda spec: ModuleType("made")
        fresh.import_module = "imported {}".format
        found = fresh.solver_library()
        assert sys.modules.get("pandas") is pandas
        return found if isinstance(found, str) else found.__name__

    return load


PLAIN = "imported ortools.sat.python.cp_model"


def test_a_stand_in_takes_the_place_of_pandas_while_it_is_loaded(loaded):
    loader = Loader()
    assert loaded(loader) == "made"
    assert loader.seen == [["DataFrame", "Index", "Series"]]


def test_pandas_that_is_there_is_used(loaded):
    loader = Loader()
    assert loaded(loader, ModuleType("pandas")) == PLAIN
    assert loader.seen == []


@pytest.mark.parametrize("failure", [AttributeError(), ImportError(), TypeError()])
def test_a_version_that_does_more_with_pandas_is_imported(loaded, failure):
    assert loaded(Loader(failure)) == PLAIN


def test_what_is_not_found_is_imported_and_says_so(loaded):
    assert loaded(None) == PLAIN
