"""The stage that checks bundles: it verifies the schedule that a bundle carries before its kind is played."""

import pytest

from halpipe.core.bundles import seal
from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import write_directory
from halpipe.deploy.base import Checked, CheckOptions
from halpipe.exporters.native import paired
from halpipe.flow import formats
from halpipe.flow.formats import UNKNOWN_FORMAT, check_bundle
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline import checked
from support import model, task, version


class Listener:
    """A kind of bundle that takes down what it is asked to check."""

    name = "listener"
    summary = "takes down what it is asked"
    engines = ("auto",)
    takes = ("seed", "cycles", "seconds")
    facts = ("heard",)

    def check(self, target, options):
        self.heard = (target, options)
        return Checked(diagnostics=(), lines=("heard",))


@pytest.fixture
def system():
    return model(task("a", "10ms", version("v", "1ms", "u1")))


@pytest.fixture
def bundle(tmp_path, system):
    tables = checked.schedule_model(system, stages_options(), lambda *_: True).schedule
    path = tmp_path / "bundle"
    write_directory(str(path), seal("listener", paired(system, tables), {}))
    return path


def stages_options():
    from halpipe.pipeline.solve.schedule import SearchOptions

    return SearchOptions(seed=1)


def test_the_kind_is_asked_with_the_model_and_schedule_of_the_bundle(bundle, monkeypatch):
    listener = Listener()
    monkeypatch.setattr(formats, "deployment", lambda kind: {"listener": listener}[kind])
    options = CheckOptions(seed=7)
    assert check_bundle(str(bundle), options).lines == ("heard",)
    target, heard = listener.heard
    assert heard == options
    assert target.model == parse_model((bundle / "model.xml").read_bytes(), "m")
    assert target.schedule == parse_schedule((bundle / "schedule.xml").read_bytes(), "s")


def test_a_schedule_that_does_not_verify_is_not_played(tmp_path, system, monkeypatch):
    monkeypatch.setattr(formats, "deployment", lambda kind: Listener())
    other = model(task("a", "10ms", version("v", "2ms", "u1")))
    tables = checked.schedule_model(system, stages_options(), lambda *_: True).schedule
    write_directory(str(tmp_path / "b"), seal("listener", paired(other, tables), {}))
    with pytest.raises(HalpipeError) as refused:
        check_bundle(str(tmp_path / "b"), CheckOptions())
    assert any(d.code.startswith("HAL03") for d in refused.value.diagnostics)


def test_a_manifest_that_states_more_than_its_kind_is_refused(tmp_path, bundle, monkeypatch):
    monkeypatch.setattr(formats, "deployment", lambda kind: Listener())
    pair = {name: (bundle / name).read_bytes() for name in ("model.xml", "schedule.xml")}
    write_directory(str(bundle), seal("listener", pair, {"heard": [1], "herd": 1}))
    with pytest.raises(HalpipeError) as refused:
        check_bundle(str(bundle), CheckOptions())
    assert [(d.code, d.message) for d in refused.value.diagnostics] == [("HAL1001", 'has an unknown key "herd"')]


def test_an_unknown_kind_is_refused(bundle):
    with pytest.raises(HalpipeError) as refused:
        check_bundle(str(bundle), CheckOptions())
    assert [d.code for d in refused.value.diagnostics] == [UNKNOWN_FORMAT.id]
