"""Every relative link in the documentation leads to a file, and every anchor to a heading."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
OUTSIDE = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "tests" / "README.md"]
PAGES = sorted([*OUTSIDE, *(ROOT / "docs").rglob("*.md"), *(ROOT / "examples").rglob("README.md")])
LINK = re.compile(r"\]\((?!\w+:)([^)#\s]*)(?:#([\w-]+))?\)")


def anchors(page):
    headings = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    for target, anchor in LINK.findall(page.read_text(encoding="utf-8")):
        path = page.parent / target if target else page
        assert path.exists(), f"{page.name} links to {target}, which does not exist"
        assert not anchor or anchor in anchors(path), f"{page.name} links to {target}#{anchor}, which does not exist"


def test_every_page_is_reached_from_the_index():
    reached, ahead = set(), [ROOT / "docs" / "index.md"]
    while ahead:
        page = ahead.pop()
        if page in reached or page.suffix != ".md":
            continue
        reached.add(page)
        ahead += [(page.parent / target).resolve() for target, _ in LINK.findall(page.read_text()) if target]
    lost = {page for page in PAGES if (ROOT / "docs") in page.parents} - reached
    assert not lost, f"no way leads from docs/index.md to {sorted(p.name for p in lost)}"


def test_rules_that_the_code_cites_stand_on_the_page():
    """By number: *MODEL 8.2*."""
    page = (ROOT / "docs" / "explanation" / "model.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^\| (\d) \|", page, re.MULTILINE)) | set(
        re.findall(r"\b\d\.\d\b", page.rpartition("## ")[2])
    )
    sources = [path for kind in ("*.py", "*.h") for path in (ROOT / "src").rglob(kind)]
    cited = {
        number for path in sources for number in re.findall(r"MODEL (\d(?:\.\d)?)", path.read_text(encoding="utf-8"))
    }
    assert cited
    assert cited <= listed
