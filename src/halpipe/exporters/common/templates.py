"""Templates of exports: files of a folder, filled strictly; only what is escaped differs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

    import jinja2


def environment(folder: Traversable, *, autoescape: bool = False) -> jinja2.Environment:
    """Return an environment for the templates of a folder; without `autoescape`, names were checked before."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FunctionLoader(lambda name: folder.joinpath(name).read_text("utf-8")),
        undefined=jinja2.StrictUndefined,
        autoescape=autoescape,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
