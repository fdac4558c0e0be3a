"""Golden files of the exporters. After a wanted change: HALPIPE_UPDATE_GOLDEN=1 pytest tests/unit/exporters."""

import os
from pathlib import Path

GOLDEN = Path(__file__).parents[2] / "golden" / "exporters"


def assert_golden(name, text):
    path = GOLDEN / name
    if os.environ.get("HALPIPE_UPDATE_GOLDEN"):
        path.write_text(text, "utf-8")
    assert text == path.read_text("utf-8"), f"{name} differs; if that is wanted, update it (see golden_file.py)"
