"""Readers of the values that only overlays have; they raise ``ValueError("what is wrong; what to do")``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from halpipe.importers.common.stated import positive

if TYPE_CHECKING:
    from halpipe.core.durations import Duration


def pattern(text: str) -> str:
    """Read a name or a glob of names."""
    if not text:
        raise ValueError("the pattern is empty; write a name or a glob such as /sensing/*")
    return text


def splitting(text: str) -> Duration | str:
    """Read a split point, or where else jobs may be split: ``anywhere`` or ``none``."""
    return text if text in ("anywhere", "none") else positive(text)
