"""Golden files. After a wanted change: HALPIPE_UPDATE_GOLDEN=1 pytest with the files of the tests, then review them."""

import os
from pathlib import Path

GOLDEN = Path(__file__).parent / "golden"


def assert_golden(name, text, folder="exporters"):
    path = GOLDEN / folder / name
    if os.environ.get("HALPIPE_UPDATE_GOLDEN"):
        path.write_text(text, "utf-8")
    assert text == path.read_text("utf-8"), f"{name} differs; if that is wanted, update it (see golden_file.py)"
