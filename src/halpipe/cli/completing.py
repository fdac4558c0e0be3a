"""Shell completion of values: formats, codes, names of examples."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

import typer  # noqa: TC002 - typer reads the annotation

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


def words(known: Sequence[str]) -> Callable[[str], list[str]]:
    """Return the completion of one of some words, or of the last word of a list with commas."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [before + comma + word for word in known if word.startswith(last)]

    return complete


def examples(incomplete: str) -> list[str]:
    """Return the examples that begin so."""
    from halpipe.starters import EXAMPLES

    return [name for name in EXAMPLES if name.startswith(incomplete)]


def codes(incomplete: str) -> list[str]:
    """Return the codes that begin so; files are completed by the shell."""
    if not incomplete.upper().startswith("HAL"):
        return []
    from halpipe.core.diagnostics import REGISTER

    load_codes()
    return sorted(code for code in REGISTER if code.startswith(incomplete.upper()))


def load_codes() -> None:
    """Load every module that declares codes: those of the kernel and of the command line have none, and load slowly."""
    import importlib
    import pkgutil

    import halpipe

    for module in pkgutil.walk_packages(halpipe.__path__, "halpipe."):
        if not re.search(r"__main__|\.kernel\.|\.cli(\.|$)", module.name):
            importlib.import_module(module.name)


def modes(context: typer.Context, incomplete: str) -> list[str]:
    """Return the modes of the model or schedule that stands on the command line; none while it cannot be read."""
    for file in _files(context):
        found = [name for name in _modes_of(file) if name.startswith(incomplete)]
        if found:
            return found
    return []


def _files(context: typer.Context) -> Iterator[str]:
    """Yield the XML files on the line; while an option lacks its value, arguments are not yet told apart."""
    for value in (context.args, *context.params.values()):
        yield from (each for each in (value if isinstance(value, list | tuple) else [value]) if _is_xml(each))


def _is_xml(value: object) -> bool:
    return isinstance(value, str) and value.endswith(".xml")


def _modes_of(file: str) -> list[str]:
    from halpipe.core.diagnostics import HalpipeError
    from halpipe.core.files import parse_xml, read_bytes

    try:
        root = parse_xml(read_bytes(file), file)
    except HalpipeError:
        return []
    return list(dict.fromkeys(name for name in root.xpath("//*[local-name() = 'mode']/@name") if isinstance(name, str)))
