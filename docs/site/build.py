"""Builds the documentation site: ``make site``, or ``python docs/site/build.py FOLDER``.

The pages are those of docs/, as they are read in the repository; the site adds a table of contents, a search, and the
reference of the Python interface from its docstrings. Warnings are errors.
"""

from __future__ import annotations

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


def build(target: Path) -> int:
    """Write the site into a folder; return the exit code of sphinx."""
    with tempfile.TemporaryDirectory() as made:
        source = Path(made)
        _gather(source)
        command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", str(source), str(target)]
        return subprocess.run(command, check=False).returncode


def _gather(source: Path) -> None:
    for name in FURTHER:
        (source / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, source / name)
    shutil.copytree(ROOT / "docs", source / "docs", ignore=shutil.ignore_patterns("site", "*.py", "__pycache__"))
    shutil.copy(HERE / "conf.py", source / "conf.py")
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
    sys.exit(build(Path(sys.argv[1] if len(sys.argv) > 1 else "site")))
