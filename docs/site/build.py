"""Builder of the documentation site: ``make site``, or ``python docs/site/build.py FOLDER [VERSION]``.

The pages are those of docs/, as they are read in the repository; the site adds a table of contents, a search, and the
reference of the Python interface from its docstrings. Warnings are errors. Each version is a folder beside the others;
versions.json names them, the newest first, and index.html leads to the newest.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
HERE = Path(__file__).parent
PARTS = (("Learn", "tutorial"), ("Do", "how-to"), ("Understand", "explanation"), ("Look up", "reference"))
FURTHER = (
    *("README.md", "CHANGELOG.md", "tests/README.md"),
    *("examples/roboracer/README.md", "examples/roboracer/overlay.yaml", "examples/notebooks/first.ipynb"),
)
"""Files outside docs/ that pages link to."""
BEGIN_WITH = {"tutorial": ("first-model", "roboracer")}
"""Pages that stand before the others of their folder, which follow by their names."""


def build(site: Path, version: str) -> int:
    """Write a version into the folder of the site; return the exit code of sphinx."""
    if not re.fullmatch(r"[0-9A-Za-z][0-9A-Za-z.+-]*", version):
        sys.exit(f"{version!r} cannot be the name of a folder; give a version such as 0.1.0")
    target = site / version
    shutil.rmtree(target, ignore_errors=True)
    with tempfile.TemporaryDirectory() as made:
        source = Path(made)
        _gather(source)
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(source), str(target)]
        failed = subprocess.run(command, check=False, env=os.environ | {"SITE_VERSION": version}).returncode
    if not failed:
        _list_versions(site)
    return failed


def _list_versions(site: Path) -> None:
    """Write which versions are there, and a first page that leads to the newest."""
    built = sorted((path.parent.name for path in site.glob("*/index.html")), key=_order, reverse=True)
    (site / "versions.json").write_text(json.dumps(built) + "\n", encoding="utf-8")
    newest = (
        f'<!DOCTYPE html><meta http-equiv="refresh" content="0; url={built[0]}/index.html"><title>halpipe</title>\n'
    )
    (site / "index.html").write_text(newest, encoding="utf-8")


def _order(version: str) -> tuple[list[int], bool, str]:
    """Order versions by their numbers; one with a suffix, such as 1.0.0rc1, comes before the one without."""
    numbers = re.match(r"[0-9.]*", version)
    assert numbers is not None
    return [int(part) for part in numbers[0].split(".") if part], numbers[0] == version, version


def _gather(source: Path) -> None:
    for name in FURTHER:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    shutil.copytree(ROOT / "docs", source / "docs", ignore=shutil.ignore_patterns("site", "*.py", "__pycache__"))
    shutil.copy(HERE / "conf.py", source / "conf.py")
    shutil.copytree(HERE / "templates", source / "templates")
    (source / "index.md").write_text(_index(source), encoding="utf-8")


def _index(source: Path) -> str:
    """Return the first page with what Sphinx needs to know the order of all pages."""
    home = text = (source / "docs" / "index.md").read_text(encoding="utf-8")
    for part in (*(folder for _, folder in PARTS), "safety"):
        home = home.replace(f"]({part}/", f"](docs/{part}/")
    home = home.replace("](../", "](")
    (source / "docs" / "index.md").write_text(f"---\norphan: true\n---\n\n{text}", encoding="utf-8")
    trees = [
        _tree(title, "\n".join(f"docs/{folder}/{page}" for page in (*BEGIN_WITH.get(folder, ()), "*")))
        for title, folder in PARTS
    ]
    more = ("docs/safety/*", "README", "examples/roboracer/README", "tests/README", "CHANGELOG")
    return "\n\n".join((home, *trees, _tree("More", "\n".join(more))))


def _tree(title: str, pages: str) -> str:
    return f"```{{toctree}}\n:hidden:\n:glob:\n:caption: {title}\n\n{pages}\n```"


if __name__ == "__main__":
    from halpipe import __version__

    sys.exit(build(Path(sys.argv[1]), (*sys.argv[2:], __version__)[0]))
