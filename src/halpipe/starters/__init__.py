"""Starter folders of ``halpipe new``: files to read, change and schedule."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping

HERE = Path(__file__).parent

FIRST, TABLE = "first", "table"

EXAMPLES: Mapping[str, tuple[str, ...]] = {"roboracer": ("roboracer", "platforms")}
"""The examples by name, and the folders of examples/ that each needs; a wheel carries them in halpipe/examples."""

_SCHEMAS = (
    *("task-model-1.xsd", "schedule-1.xsd", "overlay-1.schema.json", "pipeline-1.schema.json"),
    *("platform-1.schema.json", "profile-1.schema.json"),
)


def first_model() -> dict[str, bytes]:
    """Return the files of a first model by relative name, with the schemas that editors read."""
    return _files(HERE / FIRST) | {
        f"schemas/{name}": (HERE.parent / "schemas" / name).read_bytes() for name in _SCHEMAS
    }


def first_table() -> dict[str, bytes]:
    """Return the files of a first system as tables by relative name."""
    return _files(HERE / TABLE)


def example(name: str) -> dict[str, bytes]:
    """Return the files of an example by relative name."""
    inside = HERE.parent / "examples"
    folder = inside if inside.is_dir() else HERE.parents[2] / "examples"  # a wheel has them, a checkout beside it
    return {f"{part}/{file}": text for part in EXAMPLES[name] for file, text in _files(folder / part).items()}


def _files(folder: Path) -> dict[str, bytes]:
    found = sorted(path for path in folder.rglob("*") if path.is_file() and not _is_made(path.relative_to(folder)))
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found}


def _is_made(path: Path) -> bool:
    return path.suffix == ".pyc" or path.parts[0] == "out"
