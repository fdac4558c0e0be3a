"""The choice of versions on the documentation site: its template in two folders beside each other, in a browser."""

import functools
import http.server
import json
import threading
from pathlib import Path

import pytest

pytest.importorskip("selenium", reason="drives the browser")
pytest.importorskip("jinja2", reason="renders the template, as Sphinx does")

import jinja2
from selenium.webdriver.support.ui import Select, WebDriverWait

pytestmark = pytest.mark.slow  # a browser starts; test_site_versions.py looks at the folders

TEMPLATE = Path(__file__).parents[2] / "docs/site/templates/versions.html"
VERSIONS = ["0.2.0", "0.1.0"]


@pytest.fixture
def address(tmp_path):
    template = jinja2.Template(TEMPLATE.read_text(encoding="utf-8"))
    for version in VERSIONS:
        for page, root in (("index.html", ""), ("docs/how-to/page.html", "../../")):
            path = tmp_path / version / page
            path.parent.mkdir(parents=True, exist_ok=True)
            text = template.render(version=version, pathto=lambda *_, root=root: root)
            path.write_text(f"<!DOCTYPE html><meta charset=utf-8><title>{version}</title>{text}", encoding="utf-8")
    (tmp_path / "versions.json").write_text(json.dumps(VERSIONS))
    handler = functools.partial(http.server.SimpleHTTPRequestHandler, directory=tmp_path)

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def choice(browser):
    return Select(browser.find_element("id", "versions"))


@pytest.mark.parametrize("page", ["index.html", "docs/how-to/page.html"])
def test_the_choice_lists_the_versions_and_leads_to_the_other(browser, address, page):
    browser.get(f"{address}/0.2.0/{page}")
    WebDriverWait(browser, 300).until(lambda b: [o.text for o in choice(b).options] == VERSIONS)
    assert choice(browser).first_selected_option.text == "0.2.0"
    choice(browser).select_by_visible_text("0.1.0")
    WebDriverWait(browser, 300).until(lambda b: b.title == "0.1.0")
    assert browser.current_url == f"{address}/0.1.0/index.html"
    WebDriverWait(browser, 300).until(lambda b: choice(b).first_selected_option.text == "0.1.0")
