"""Cache of built programs in the user's cache folder; every entry can be made again.

An entry is used only if no other user can have written it.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from pathlib import Path


def cache_folder(kind: str) -> Path | None:
    """Return the folder for things of a kind, None where the user's cache cannot hold one that only they can write."""
    return _find(kind)[0]


def why_no_cache(kind: str) -> str:
    """Return why nothing of a kind is kept for the next run, and what to do; empty where it is."""
    return _find(kind)[1]


def _find(kind: str) -> tuple[Path | None, str]:
    home = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(home):  # a relative one has no meaning, says its specification
        home = os.path.join(os.path.expanduser("~"), ".cache")
    if not os.path.isabs(home):
        return None, "there is no home folder; name a folder in XDG_CACHE_HOME"
    folder = Path(home, "halpipe", kind)
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        for place in (folder, folder.parent):
            if not _is_private(place):
                return None, f"others can write to {place}; take that from them: chmod go-w"
        if not os.access(folder, os.W_OK | os.X_OK):
            return None, f"{folder} cannot be written to; name another folder in XDG_CACHE_HOME"
    except OSError as failure:
        return None, f"{folder} cannot be made: {failure.strerror}; name another folder in XDG_CACHE_HOME"
    return folder, ""


def is_ours(path: Path) -> bool:
    """Return whether a kept file is there and only this user could have put it there."""
    try:
        return path.is_file() and not path.is_symlink() and _is_private(path)
    except OSError:
        return False


def keep(place: Path, content: bytes, *, executable: bool = False) -> bool:
    """Put a file into the cache in one step, since others may be doing the same; return whether it is there."""
    try:
        stream = tempfile.NamedTemporaryFile(dir=place.parent, delete=False)  # noqa: SIM115 - it is renamed
    except OSError:
        return False
    try:
        with stream:
            stream.write(content)
        os.chmod(stream.name, 0o700 if executable else 0o600)
        os.replace(stream.name, place)
    except OSError:
        with contextlib.suppress(OSError):
            os.unlink(stream.name)
        return False
    return True


def _is_private(path: Path) -> bool:
    """Return whether only the user can write to it; Windows keeps a user's folder from others by itself."""
    facts = path.lstat()
    if not hasattr(os, "getuid"):
        return True
    return facts.st_uid == os.getuid() and not facts.st_mode & 0o022
