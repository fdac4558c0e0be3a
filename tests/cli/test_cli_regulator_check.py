"""``halpipe deploy check`` on regulator bundles: what a user types and sees."""

import json

import pytest

import regulator_bundles as bundles
from halpipe.cli import invoke
from halpipe.core.bundles import seal
from halpipe.core.files import write_directory


@pytest.fixture
def bundle(tmp_path):
    def write(change=None):
        files = bundles.export(tmp_path, *bundles.system())
        manifest = json.loads(files.pop("manifest.json"))
        files = bundles.changed(files, change) if change else files
        facts = {key: value for key, value in manifest.items() if key not in ("halpipe-bundle", "kind", "files")}
        write_directory(str(tmp_path / "cfg"), seal("regulator", files, facts))
        return str(tmp_path / "cfg")

    return write


def test_a_sound_bundle_passes(bundle, capsys):
    assert invoke(["deploy", "check", bundle(), "--engine", "arithmetic"]) == 0
    assert capsys.readouterr().out.startswith("arithmetic: exact; 3 tables of 3 units")


def test_a_wrong_bundle_fails_and_says_where(bundle, capsys):
    assert invoke(["deploy", "check", bundle(bundles.FAULTS["one burst more"])]) == 1
    shown = capsys.readouterr()
    assert "nothing executed: the tables are wrong" in shown.out
    assert (
        'tables.json: error[HAL1017] table "full", unit "u1", read: 5 bursts in window 20, promised are 4' in shown.err
    )


def test_an_engine_that_does_not_exist_is_a_usage_error(bundle, capsys):
    assert invoke(["deploy", "check", bundle(), "--engine", "verilater"]) == 2
    assert "did you mean" in capsys.readouterr().err
