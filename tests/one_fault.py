"""Faults put into sources, one at a time."""


def with_fault(source, what, instead):
    """Return a source with one text replaced; raise `ValueError` unless it is there exactly once."""
    if source.count(what) != 1:
        raise ValueError(f"{source.count(what)} places for {what!r}")
    return source.replace(what, instead)
