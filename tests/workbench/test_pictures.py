"""Pictures of the README: what the browser shows today. HALPIPE_PICTURES=1 writes them anew."""

import io
import os
from pathlib import Path

import pytest

from halpipe.api import export, schedule
from halpipe.importers.native import parse_model
from halpipe.starters import first_model

pytest.importorskip("starlette", reason="the extra [serve]")
pytest.importorskip("selenium", reason="drives the browser")
pytest.importorskip("PIL", reason="the extra [plot]")

from PIL import Image
from selenium.webdriver.support.ui import WebDriverWait

pytestmark = pytest.mark.slow  # a browser starts

FOLDER = Path(__file__).parents[2] / "docs" / "pictures"
MOST = 150_000
GRID = (48, 30)


def shades(content):
    """Return a picture as a coarse grid of greys, in which fonts and versions of the browser do not show."""
    return list(Image.open(io.BytesIO(content)).convert("L").resize(GRID, Image.Resampling.BOX).tobytes())


def unlike(one, other):
    """Return the share of cells that differ by more than a tenth of the range."""
    return sum(abs(a - b) > 25 for a, b in zip(one, other, strict=True)) / len(one)


@pytest.fixture
def shown(browser):
    """Return what compares the window with a picture of the README, or writes it."""
    browser.set_window_size(1200, 887)

    def compare(name):
        png = browser.get_screenshot_as_png()
        if os.environ.get("HALPIPE_PICTURES"):
            FOLDER.mkdir(exist_ok=True)
            few_colours = Image.open(io.BytesIO(png)).convert("P", palette=Image.Palette.ADAPTIVE, colors=64)
            few_colours.save(FOLDER / name, "PNG", optimize=True)
        kept = (FOLDER / name).read_bytes()
        assert len(kept) < MOST
        assert unlike(shades(png), shades(kept)) < 0.1, f"{name} is old: run this test with HALPIPE_PICTURES=1"

    yield compare
    browser.set_window_size(1400, 900)


def test_the_picture_of_the_workbench(browser, serve, shown):
    browser.get(serve(first_model()["model.xml"]))
    WebDriverWait(browser, 300).until(lambda b: b.execute_script("return Boolean(state && state.valid)"))
    browser.execute_script("viewer.paint()")
    shown("workbench.png")


def test_the_picture_of_the_report(browser, tmp_path, shown):
    system = parse_model(first_model()["model.xml"], "model.xml")
    page = tmp_path / "report.html"
    page.write_bytes(export("report", system, schedule(system))[""])
    browser.get(page.as_uri())
    browser.execute_script("document.getElementById('mode-1').scrollIntoView()")
    shown("report.png")


def test_another_picture_is_not_taken_for_this_one():
    pages = [shades((FOLDER / name).read_bytes()) for name in ("workbench.png", "report.png")]
    assert unlike(*pages) >= 0.1
