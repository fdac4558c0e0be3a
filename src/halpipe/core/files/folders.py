"""Output folders: replaced as a whole, and only what halpipe itself wrote into them is ever removed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import shutil
from pathlib import PurePosixPath
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location, error
from halpipe.core.files.protection import refuse_inputs
from halpipe.core.files.reading import raise_it, read_own
from halpipe.core.files.writing import cannot_write, remove_output, sweep, sync_directory, temporary_beside
from halpipe.core.files.yaml import load_json
from halpipe.core.suggest import few

if TYPE_CHECKING:
    from collections.abc import Mapping

FOREIGN_FOLDER = error(
    "HAL0004",
    "Refusing to replace a folder that halpipe did not create",
    "A folder is written as a whole and replaces the one before. It may hold only what its manifest.json lists, and "
    "that must be a manifest of halpipe's. Anything else belongs to the user: nothing is written and nothing "
    "removed, so that a mistyped name, or notes kept in a bundle, destroy no work.",
)

MANIFEST = "manifest.json"
MANIFEST_KEY = "halpipe-bundle"
"""What a manifest states by which it is known as ours."""


def write_directory(path: str, contents: Mapping[str, bytes]) -> None:
    """Write a folder as a whole: readers see the old one or the new one, never a mixture.

    `contents` has names relative to the folder, with ``/``; one of them is the `MANIFEST`, by which a folder that
    may be replaced is known. Between two renames there is an instant without any; the next writer repairs that.
    """
    target = os.path.realpath(path)
    parent, base = os.path.split(target)
    former = os.path.join(parent, f".{base[:40]}.{hashlib.sha256(os.fsencode(base)).hexdigest()[:8]}.former")
    try:
        os.makedirs(parent, exist_ok=True)
        _mend(former, target)
        _refuse_foreign(target, path)
        refuse_inputs(*(os.path.join(inside, name) for inside, _, names in os.walk(target) for name in names))
        staged = _stage_directory(target, contents)
        try:
            _exchange(staged, target, former)
        finally:
            shutil.rmtree(staged, ignore_errors=True)
        sync_directory(parent)
    except (OSError, ValueError) as failure:
        raise cannot_write(path, failure) from None


def write_new_folder(path: str, contents: Mapping[str, bytes]) -> None:
    """Write a folder that was not there, or was empty; see `write_directory`."""
    try:
        is_free = not os.path.lexists(path) or (os.path.isdir(path) and not os.listdir(path))
    except OSError as failure:
        raise cannot_write(path, failure) from None
    if not is_free:
        raise _foreign(path, "is there already, and is not empty; nothing was written")
    write_directory(path, contents)


def make_folder(path: str) -> None:
    """Make a folder into which files are to be written one by one, if it is not there."""
    try:
        os.makedirs(path, exist_ok=True)
    except (OSError, ValueError) as failure:
        raise cannot_write(path, failure) from None


def _mend(former: str, target: str) -> None:
    """Finish what a killed run left: the folder before is put back, or removed where the new one is in place."""
    if not os.path.isdir(former):
        return
    _refuse_foreign(former, former)
    if os.path.lexists(target):
        _remove_listed(former)
    else:
        os.rename(former, target)


def _exchange(staged: str, target: str, former: str) -> None:
    """Put the folder `staged` where `target` is; where that fails, `target` is what it was."""
    if not os.path.isdir(target):
        os.rename(staged, target)
        return
    os.rename(target, former)
    try:
        os.rename(staged, target)
    except OSError:
        os.rename(former, target)
        raise
    _remove_listed(former)


def _refuse_foreign(target: str, path: str) -> None:
    """Stop if `target` holds anything that its manifest does not list, or is no folder."""
    if not os.path.lexists(target):
        return
    if not os.path.isdir(target):
        raise _foreign(path, "is no folder; it is not replaced")
    strangers = _strangers(target)
    if strangers:
        raise _foreign(path, f"holds what halpipe did not write there: {few(strangers)}; it is not replaced")


def _foreign(path: str, message: str) -> HalpipeError:
    help = "name a new folder, or move what is in this one elsewhere"
    return HalpipeError(FOREIGN_FOLDER(message, at=Location(path), help=help))


def _listed(folder: str) -> set[str]:
    """Return the names that a manifest of ours claims, its own among them; none where there is none."""
    manifest = os.path.join(folder, MANIFEST)
    if not os.path.isfile(manifest) or os.path.islink(manifest):
        return set()
    try:
        stated = load_json(read_own(manifest))
    except (HalpipeError, ValueError):
        return set()
    if not isinstance(stated, dict) or type(stated.get(MANIFEST_KEY)) is not int:
        return set()
    files = stated.get("files")
    return {MANIFEST, *files} if isinstance(files, dict) else set()


def _strangers(folder: str) -> list[str]:
    """Return, by name, what lies in a folder and is not listed in its manifest; a folder is named for all within."""
    listed = _listed(folder)
    rooms = {str(parent) for name in listed for parent in PurePosixPath(name).parents}
    found = []
    for inside, folders, names in os.walk(folder, onerror=raise_it):
        relative = PurePosixPath(os.path.relpath(inside, folder).replace(os.sep, "/"))
        links = [name for name in folders if os.path.islink(os.path.join(inside, name))]
        found += [str(relative / name) for name in (*names, *links) if str(relative / name) not in listed]
        foreign = [name for name in folders if name not in links and str(relative / name) not in rooms]
        found += [f"{relative / name}/" for name in foreign]
        folders[:] = [name for name in folders if name not in links and name not in foreign]
    return sorted(found)


def _remove_listed(folder: str) -> None:
    """Remove the files that the manifest lists, and what is empty then; the manifest goes last, so that one knows.

    Only what is found inside is removed, never what a manifest may name elsewhere. What is left belongs to the user.
    """
    listed = _listed(folder) - {MANIFEST}
    for inside, _, names in os.walk(folder, topdown=False):
        for name in names:
            path = os.path.join(inside, name)
            if os.path.relpath(path, folder).replace(os.sep, "/") in listed:
                remove_output(path)
        if inside != folder and not os.listdir(inside):
            _remove_empty(inside)
    if os.listdir(folder) in ([], [MANIFEST]):
        remove_output(os.path.join(folder, MANIFEST))
        _remove_empty(folder)


def _remove_empty(folder: str) -> None:
    """Remove a folder that is replaced already; if the system does not let us, the next run does it."""
    with contextlib.suppress(OSError):
        os.rmdir(folder)


def _stage_directory(target: str, contents: Mapping[str, bytes]) -> str:
    """Write `contents` into a synced temporary folder beside `target` and return its name."""
    sweep(*os.path.split(target))
    staged = temporary_beside(target)
    try:
        os.mkdir(staged)
        for name, content in contents.items():
            inside = os.path.join(staged, *name.split("/"))
            os.makedirs(os.path.dirname(inside), exist_ok=True)
            with open(inside, "xb") as stream:
                stream.write(content)
                stream.flush()
                if content.startswith(b"#!"):  # a program, which others start by its name
                    os.chmod(inside, os.stat(inside).st_mode | (os.stat(inside).st_mode & 0o444) >> 2)
                os.fsync(stream.fileno())
    except BaseException:
        shutil.rmtree(staged, ignore_errors=True)
        raise
    return staged
