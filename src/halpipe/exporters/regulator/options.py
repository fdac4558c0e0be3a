"""Single values of the export's options, as pipeline files state them."""

from __future__ import annotations

from pathlib import PurePath

from halpipe.exporters.regulator.platform import BACKENDS
from halpipe.exporters.regulator.rounding import CONTROLLED, WHOLE
from halpipe.exporters.regulator.tables import AUTO
from halpipe.quantities import quoted
from halpipe.suggest import did_you_mean

RULES = (AUTO, WHOLE, CONTROLLED)


def platform_path(base: str, text: str) -> str:
    """Return the platform file, relative to the folder of the pipeline."""
    if not text:
        raise ValueError("the file name is empty; name a platform file")
    return str(PurePath(base) / text)


def backend_name(text: str) -> str:
    """Read the name of a back-end."""
    return _word(text, BACKENDS)


def rounding_rule(text: str) -> str:
    """Read the name of a rule of rounding."""
    return _word(text, RULES)


def _word(text: str, words: tuple[str, ...]) -> str:
    if text not in words:
        raise ValueError(f"{quoted(text)} is not known; {did_you_mean(text, words, 'use ' + ', '.join(words))}")
    return text
