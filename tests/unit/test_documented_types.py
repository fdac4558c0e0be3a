"""Static types of the documented Python: mypy --strict, and pyright where it is installed, accept every block.

The slow tests take the pages; `test_python_page.py` runs the main one in the fast tier.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow  # mypy reads the types of the package

ROOT = Path(__file__).parents[2]
BLOCK = re.compile(r"^```(?:python|py)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted((ROOT / "examples").rglob("*.md"))]
NOTEBOOKS = sorted((ROOT / "examples").rglob("*.ipynb"))
# Beside this Python, which need not be the one on the PATH.
PYRIGHT = shutil.which("basedpyright", path=os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
HEAD = "from halpipe.models import Access, Mode, Run, Split, Task, Version\n"
WRONG = {
    'Task(name="t", period=5)': "a number without a unit",
    'Version(name="v", units="core0")': "a text for a list of names",
    'Access(resource="r", start="0ms", end="1ms", bound=0.5)': "a float, which is not exact",
    'Mode(name="m", runs=[Version(name="v")])': "items of another class",
    'Run(versions=["v"])': "a field without default left out",
    "Split(points=[1])": "a number as a split point",
}


def programs():
    """Return the Python of each page as one program, by the name of the page."""
    found = {page.relative_to(ROOT): BLOCK.findall(page.read_text(encoding="utf-8")) for page in PAGES}
    for page in NOTEBOOKS:
        cells = json.loads(page.read_text(encoding="utf-8"))["cells"]
        found[page.relative_to(ROOT)] = ["".join(each["source"]) for each in cells if each["cell_type"] == "code"]
    return {str(page): "\n".join(blocks) for page, blocks in found.items() if blocks}


def errors(command, folder, sources):
    """Write the sources, and return the errors that a type checker reports for them."""
    for name, text in sources.items():
        (folder / (re.sub(r"\W", "_", name) + ".py")).write_text(text + "\n", encoding="utf-8")
    environment = os.environ | {"MYPYPATH": str(ROOT / "src")}
    run = subprocess.run([*command, "."], cwd=folder, env=environment, capture_output=True, text=True, check=False)
    assert run.returncode in (0, 1), run.stdout + run.stderr
    return [line for line in run.stdout.splitlines() if "error:" in line or "- error" in line]


@pytest.fixture
def mypy(tmp_path):
    pytest.importorskip("mypy", reason="the extra [dev]")
    return [sys.executable, "-m", "mypy", "--strict", "--ignore-missing-imports", "--config-file=", "--no-pretty"]


@pytest.fixture
def pyright(tmp_path):
    if PYRIGHT is None:
        pytest.skip("pip install basedpyright")
    settings = {"extraPaths": [str(ROOT / "src")], "typeCheckingMode": "standard"}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(settings), encoding="utf-8")
    return [PYRIGHT, "--pythonpath", sys.executable]


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_documented_python_type_checks(checker, request, tmp_path):
    sources = programs()
    assert {"docs/how-to/use-from-python.md", "docs/how-to/check-riscv.md"} <= set(sources)
    assert errors(request.getfixturevalue(checker), tmp_path, sources) == []


@pytest.mark.parametrize("checker", ["mypy", "pyright"])
def test_wrong_values_are_still_errors(checker, request, tmp_path):
    sources = {f"wrong{place}": HEAD + line for place, line in enumerate(WRONG)}
    found = errors(request.getfixturevalue(checker), tmp_path, sources)
    for place, why in enumerate(WRONG.values()):
        assert any(f"wrong{place}.py" in line for line in found), why
