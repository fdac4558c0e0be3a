"""The second checker, one file that shares nothing with halpipe, and the pages on safety: of a checkout or a wheel."""

from __future__ import annotations

import importlib.util
from functools import cache
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
NAME = "second_checker.py"


def path(name: str = NAME) -> Path:
    """Return the place of a file on safety: a wheel has it in this package, a checkout in its documentation."""
    inside = HERE / name
    return inside if inside.is_file() else HERE.parents[2] / "docs" / "safety" / name


@cache
def module() -> Any:
    """Load the file."""
    spec = importlib.util.spec_from_file_location("halpipe_second_checker", path())
    if spec is None or spec.loader is None:
        raise ImportError(f"no module in {path()}")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def accepts(model: str, schedule: str) -> bool:
    """Return whether the second checker finds the files valid."""
    checker = module()
    try:
        return not checker.judge(model, schedule)
    except checker.UnreadableError:
        return False
