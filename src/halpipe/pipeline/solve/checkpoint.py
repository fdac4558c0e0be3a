"""Searches that can be continued: the kernel's state in a file, so that a resumed run gives the same bytes.

The file holds one state per search (attempt, mode, stage) and the fingerprint of what was asked. Modes that were
finished are restored as finished, and so are the steps in which a valid schedule was improved. The budget is not part
of the fingerprint: raising it is a reason to resume. Nor is the number of threads.
"""

from __future__ import annotations

import hashlib
import io
import sys
from array import array
from threading import Lock
from typing import TYPE_CHECKING

from halpipe.core.diagnostics import HalpipeError, Location, error
from halpipe.core.files import read_own, refuse_foreign, remove_output, write_outputs
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from halpipe.models import TaskModel
    from halpipe.pipeline.solve.integers import Ints
    from halpipe.pipeline.solve.kernel.kernel import State
    from halpipe.pipeline.solve.schedule import SearchOptions

NO_CHECKPOINT = error(
    "HAL0413",
    "Search cannot be resumed",
    "The checkpoint is missing or damaged, or belongs to another model, seed, mode selection or version of halpipe. "
    "Search again without --resume.",
)

SAVED = (
    "start", "option", "phase", "step", "edges", "guide", "owner", "owners", "owner_at", "hot", "hot_at", "hint",
    "best_start", "best_option", "register", "random",
)  # fmt: skip
"""The arrays of a state; the others are scratch."""

IDENTITY = "halpipe-identity"
"""Names the member of the file that says what the search was asked."""

NOTED = "outcome"
"""Marks what is saved of a stage that is over; no array of a state is called so."""

SECONDS = 5
"""A search that runs on is saved this often."""


def fingerprint(model: TaskModel, options: SearchOptions, version: str) -> str:
    """Return what a checkpoint belongs to: everything that decides the outcome, but for the budget."""
    shipped = "" if options.shipped is None and options.near is None else repr((options.shipped, options.near))
    parts = (
        version, model.digest, options.seed, options.tick, options.modes, options.target, shipped,
        options.grid, options.optimise,
    )  # fmt: skip
    return hashlib.sha256(repr([str(part) for part in parts]).encode()).hexdigest()


class Checkpoint:
    """Keeps the states of one run in `path`, for any number of threads; `now` is a clock in seconds."""

    def __init__(self, path: str, identity: str, now: Callable[[], float]) -> None:
        self._path = path
        self._identity = identity
        self.now = now
        self.began = self._last = now()
        self.kept_at: dict[str, float] = {}
        self.is_written = False
        self.arrays: dict[str, Ints] = {}
        self.lock = Lock()

    def claim(self) -> None:
        """Stop if a file of the user's has the name of the checkpoint, which is removed in the end."""
        refuse_foreign(self._path, lambda data: data.startswith(b"PK") and IDENTITY.encode() in data)

    def load(self) -> None:
        """Read the states of the run to be continued; raise `HalpipeError` if they are not of this run."""
        try:
            identity, found = _unpacked(read_own(self._path, most=None))  # of any size: it has to be read again
        except (ValueError, OSError, KeyError, EOFError, NotImplementedError):
            raise self.refusal("is damaged") from None
        if identity != self._identity:
            raise self.refusal("belongs to another model or other options")
        self.arrays, self.is_written = found, True

    def stage(self, key: str) -> Kept:
        """Return the part that has one search."""
        return Kept(self, key)

    def write(self) -> None:
        """Write all that is known."""
        with self.lock:
            self._write()

    def write_if_due(self, moment: float) -> None:
        """Write, with the lock held, what was changed since the last time, if that was long ago."""
        if moment - self._last >= SECONDS:
            self._write()

    def _write(self) -> None:
        write_outputs({self._path: _packed(self._identity, self.arrays)})
        self._last, self.is_written = self.now(), True

    def remove(self) -> None:
        """Remove the file: the search is over."""
        remove_output(self._path)

    def refusal(self, what: str) -> HalpipeError:
        """Return the error of a file that does not belong to this run."""
        return HalpipeError(NO_CHECKPOINT(what, at=Location(self._path), help="search again without --resume"))


@record
class Kept:
    """The part of a checkpoint that has one search, or one stage of it."""

    whole: Checkpoint
    key: str

    def stage(self, name: str) -> Kept:
        """Return the part of one stage of the search."""
        return Kept(self.whole, f"{self.key}/{name}")

    def restore(self, state: State) -> bool:
        """Fill a fresh state with what was saved for it, if anything was; return whether it was."""
        for name in SAVED:
            kept = getattr(state, name)
            saved = self.whole.arrays.get(f"{self.key}/{name}")
            if saved is None:
                return False
            if len(saved) != len(kept):
                raise self.whole.refusal("does not fit the model")
            kept[:] = saved
        return True

    def keep(self, state: State, *, now: bool) -> None:
        """Save a state when it is time, or `now`; runs of a few seconds are not worth it, they start anew."""
        whole = self.whole
        with whole.lock:
            moment = whole.now()
            is_due = moment - whole.kept_at.get(self.key, whole.began) >= SECONDS
            if not is_due and not (now and whole.is_written):
                return
            whole.arrays.update({f"{self.key}/{name}": getattr(state, name)[:] for name in SAVED})
            whole.kept_at[self.key] = moment
            whole.write_if_due(moment)

    def note(self, facts: Mapping[str, Ints]) -> None:
        """Save the outcome of a finished stage in place of its state."""
        with self.whole.lock:
            for name in SAVED:
                self.whole.arrays.pop(f"{self.key}/{name}", None)
            self.whole.arrays.update({f"{self.key}/{NOTED}/{name}": values[:] for name, values in facts.items()})
            self.whole.write_if_due(self.whole.now())

    def noted(self) -> dict[str, Ints] | None:
        """Return the outcome of a stage that was finished before; None where there is none."""
        prefix = f"{self.key}/{NOTED}/"
        with self.whole.lock:
            found = {name: values for name, values in self.whole.arrays.items() if name.startswith(prefix)}
        return {name.removeprefix(prefix): values for name, values in found.items()} or None


def _packed(identity: str, arrays: Mapping[str, Ints]) -> bytes:
    """Return a zip file with an array in each member, as words of 64 bits, the least byte first."""
    import zipfile

    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        file.writestr(zipfile.ZipInfo(IDENTITY), identity)
        for name, values in arrays.items():
            file.writestr(zipfile.ZipInfo(name), _least_byte_first(values).tobytes())
    return stream.getvalue()


def _unpacked(data: bytes) -> tuple[str, dict[str, Ints]]:
    """Return what was packed; raise `ValueError`, `KeyError` or `OSError` for anything else."""
    import zipfile

    arrays = {}
    try:
        file = zipfile.ZipFile(io.BytesIO(data))
        members = file.infolist()
        if any(member.compress_type != zipfile.ZIP_STORED for member in members):
            raise ValueError("compressed")  # we compress nothing, and what others did might expand without bound
        content = {member.filename: file.read(member) for member in members}
    except zipfile.BadZipFile as failure:
        raise ValueError(str(failure)) from None
    identity = content.pop(IDENTITY).decode()
    for name, words in content.items():
        values = array("Q" if name.endswith("/random") else "q")
        values.frombytes(words)
        arrays[name] = _least_byte_first(values)
    return identity, arrays


def _least_byte_first(values: Ints) -> Ints:
    """Return words as they are in a file, or those of a file as they are in memory."""
    turned = values[:]
    if sys.byteorder == "big":
        turned.byteswap()
    return turned
