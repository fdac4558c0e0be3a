"""Versions of the documentation site: each in a folder, the newest first, and no name that leaves the site."""

import importlib.util
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def builder(monkeypatch):
    spec = importlib.util.spec_from_file_location("site_builder", ROOT / "docs/site/build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def pages(command, **_):
    """Stand in for Sphinx: write the first page of the version."""
    target = Path(command[-1])
    target.mkdir(parents=True)
    (target / "index.html").write_text("page", encoding="utf-8")

    class Ended:
        returncode = 0

    return Ended


def test_each_version_is_beside_the_others_the_newest_first(builder, monkeypatch, tmp_path):
    monkeypatch.setattr(builder.subprocess, "run", pages)
    for version in ("0.9.0", "0.10.0", "0.10.0rc1", "0.9.0"):
        assert builder.build(tmp_path, version) == 0
    assert json.loads((tmp_path / "versions.json").read_text()) == ["0.10.0", "0.10.0rc1", "0.9.0"]
    assert "url=0.10.0/index.html" in (tmp_path / "index.html").read_text()


@pytest.mark.parametrize("version", ["", "..", "a/b", "/tmp", ".hidden"])
def test_no_version_leaves_the_folder_of_the_site(builder, tmp_path, version):
    with pytest.raises(SystemExit, match="cannot be the name of a folder"):
        builder.build(tmp_path, version)
    assert not list(tmp_path.iterdir())


def test_a_failed_build_changes_no_list(builder, monkeypatch, tmp_path):
    class Failed:
        returncode = 2

    monkeypatch.setattr(builder.subprocess, "run", lambda *_, **__: Failed)
    assert builder.build(tmp_path, "1.0") == 2
    assert not (tmp_path / "versions.json").exists()


def test_the_choice_is_on_every_page():
    conf = (ROOT / "docs/site/conf.py").read_text(encoding="utf-8")
    assert '"versions.html"' in conf
    assert 'root + "versions.json"' in (ROOT / "docs/site/templates/versions.html").read_text(encoding="utf-8")
