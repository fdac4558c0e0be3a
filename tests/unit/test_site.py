"""The documentation site builds, without a warning, and has every page."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.mark.slow  # Sphinx reads every page
@pytest.mark.skipif(not find_spec("sphinx") or not find_spec("furo"), reason="the extra [docs]")
def test_the_site_builds_without_a_warning_and_has_every_page(tmp_path):
    command = [sys.executable, str(ROOT / "docs" / "site" / "build.py"), str(tmp_path), "1.2"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
    pages = [page for page in (ROOT / "docs").rglob("*.md") if "site" not in page.parts]
    site = tmp_path / "1.2"
    made = [site / "docs" / page.relative_to(ROOT / "docs").with_suffix(".html") for page in pages]
    assert [page.name for page in made if not page.exists()] == []
    assert (site / "search.html").exists()
    beside = (site / "index.html").read_text(encoding="utf-8").partition("sidebar-tree")[2]
    lessons = [beside.index(f"tutorial/{page}.html") for page in ("first-model", "roboracer", "drive-roboracer")]
    assert lessons == sorted(lessons)


def test_the_first_page_leads_to_every_guide_explanation_and_reference():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    folders = ("tutorial", "how-to", "explanation", "reference")
    pages = [f"{folder}/{page.name}" for folder in folders for page in (ROOT / "docs" / folder).glob("*.md")]
    assert [page for page in pages if page not in index] == []
