"""The generated reference pages on disk are those that the code makes now."""

import importlib.util
from pathlib import Path

import pytest

from halpipe.diagnostics import REGISTER, Exit

SCRIPT = Path(__file__).parents[2] / "docs" / "generate.py"


def load_script():
    spec = importlib.util.spec_from_file_location("generate_docs", SCRIPT)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    return script


@pytest.fixture(scope="module")
def pages():
    return load_script().pages()


@pytest.mark.parametrize("name", ["diagnostics.md", "checks.md", "exit-codes.md"])
def test_page_is_up_to_date(pages, name):
    on_disk = SCRIPT.parent / "reference" / name
    assert on_disk.exists(), "run make docs"
    assert on_disk.read_text(encoding="utf-8") == pages[name], f"docs/reference/{name} is out of date: run make docs"


def test_every_code_has_a_section(pages):
    headings = [line[4:] for line in pages["diagnostics.md"].splitlines() if line.startswith("### ")]
    assert headings == sorted(REGISTER)


def test_every_exit_code_has_a_row(pages):
    for code in Exit:
        assert f"\n| {int(code)} |" in pages["exit-codes.md"]


def test_every_range_of_codes_has_a_title(pages):
    assert "Further diagnostics" not in pages["diagnostics.md"]


def test_tags_are_not_taken_for_markup():
    assert load_script()._escaped("a <b> `<c>` <d>") == "a &lt;b> `<c>` &lt;d>"
