"""Drive the RoboRacer stack on this computer in real time, with a Linux bundle: `python drive_linux.py --help`.

The dispatcher plays the tables; the world is another process. They meet in the file that holds the buffers: every 25 ms
the world takes the command and puts a new scan there. Modes are asked for through the dispatcher's control pipe.
"""

from __future__ import annotations

import argparse
import mmap
import os
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

from drive import HERE, a_drive, written
from report import summary

import halpipe
from halpipe.core.diagnostics import render_text
from halpipe.deploy.linux.judging import judge, read_recording
from halpipe.flow.formats import open_target

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from drive import Drive

    from halpipe.deploy.base import Target

HEAD = struct.Struct("=II")
"""Before each buffer: a counter that is odd while it is written, and the size."""

SECOND = 10**9
MOST_SECONDS = 150


class Buffers:
    """The buffers of a running dispatcher, by name; copies are whole."""

    def __init__(self, file: Path, sizes: dict[str, int]) -> None:
        with file.open("r+b") as stream:
            self.memory = mmap.mmap(stream.fileno(), 0)
        self.places = {}
        at = 0
        for name, size in sizes.items():
            self.places[name] = at, size
            at += (HEAD.size + size + 63) // 64 * 64

    def read(self, name: str) -> bytes:
        """Return a buffer as some job left it."""
        at, size = self.places[name]
        while True:
            before, _ = HEAD.unpack_from(self.memory, at)
            data = self.memory[at + HEAD.size : at + HEAD.size + size]
            if not before & 1 and HEAD.unpack_from(self.memory, at)[0] == before:
                return data

    def write(self, name: str, data: bytes) -> None:
        """Put data where the next job finds it."""
        at, _size = self.places[name]
        (count, _) = HEAD.unpack_from(self.memory, at)
        struct.pack_into("=I", self.memory, at, count + 1)
        self.memory[at + HEAD.size : at + HEAD.size + len(data)] = data
        struct.pack_into("=I", self.memory, at, count + 2)


def sizes_of(target: Target) -> dict[str, int]:
    """The buffers in the dispatcher's order, by name."""
    sizes: dict[str, int] = {}
    for task in target.model.tasks:
        for version in task.versions:
            for transfer in (t for access in version.accesses for t in access.transfers):
                sizes[transfer.buffer] = max(transfer.size, sizes.get(transfer.buffer, 0))
    return dict(sorted(sizes.items()))


def moments(origin: int, cycle: int) -> Iterator[int]:
    """Yield the time since `origin` at the beginning of every cycle, when it comes."""
    number = 0
    while True:
        due = origin + number * cycle
        time.sleep(max(0, due - time.monotonic_ns()) / SECOND)
        yield due - origin
        number += 1


def run(drive: Drive, target: Target, folder: Path, degrade: str) -> tuple[bytes, str]:
    """Build the bundle in `folder`, drive until the car stands, and return the recording and what was said."""
    for name, content in target.bundle.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    subprocess.run(["make", "-s"], cwd=folder, check=True)
    memory, control, record = (folder / name for name in ("buffers", "control", "run.csv"))
    os.mkfifo(control)
    origin = (time.monotonic_ns() // SECOND + 2) * SECOND
    command = [str(folder / "build/dispatcher"), "--memory", str(memory), "--control", str(control)]
    command += ["--record", str(record), "--origin", str(origin), "--seconds", str(MOST_SECONDS)]
    command += ["--degrade", degrade] if degrade else []
    command += ["--overrun", "log"]  # a computer with other work is late now and then, which must not end the race
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        while not memory.exists() and process.poll() is None:
            time.sleep(0.01)
        time.sleep(0.1)
        if process.poll() is None:
            meet(drive, target, Buffers(memory, sizes_of(target)), control, origin)
        said, _ = process.communicate(timeout=30)
    return record.read_bytes() if record.exists() else b"", said


def meet(drive: Drive, target: Target, buffers: Buffers, control: Path, origin: int) -> None:
    """Let world and stack meet every cycle until the car stands."""
    asked = target.schedule.modes[0].name
    cycle = int(target.schedule.modes[0].hyperperiod.fraction)
    with control.open("w", buffering=1) as pipe:
        for now in moments(origin, cycle):
            mode = drive.cycle(now, buffers.read, buffers.write)
            if mode is not None and mode != asked:
                asked = mode
                pipe.write(f"mode {mode}\n")
            if drive.finished or now > MOST_SECONDS * SECOND:
                pipe.write("stop\n")
                return


def main(arguments: Sequence[str] | None = None) -> int:
    """Drive, write what happened, and return 0 if all went well."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundle", metavar="BUNDLE", help="folder that `halpipe export linux` wrote")
    parser.add_argument("-o", "--output", type=Path, default=HERE / "out" / "drive-linux", help="folder for results")
    parser.add_argument("--degrade", default="", help="go on without fifo, memory, cpus, or all of these rights")
    parser.add_argument("--race-laps", type=int, default=1, help="against the opponent (default 1)")
    parser.add_argument("--trial-laps", type=int, default=1, help="alone (default 1)")
    parser.add_argument("--seed", type=int, default=1, help="of all noise (default 1)")
    chosen = parser.parse_args(arguments)
    drive = a_drive(chosen.seed, chosen.race_laps, chosen.trial_laps)
    try:
        target = open_target(chosen.bundle)
        with tempfile.TemporaryDirectory() as folder:
            recording, said = run(drive, target, Path(folder), chosen.degrade)
        sys.stdout.write(said)
        if not recording:
            return 1
        judgement = judge(target.model, target.schedule, read_recording(recording), is_timed=False)
    except halpipe.HalpipeError as error:
        sys.stderr.write("\n".join(map(render_text, error.diagnostics)) + "\n")
        return 1
    found = judgement.diagnostics
    lines = [
        f"{judgement.jobs} jobs in {judgement.tables} tables, {judgement.switches} switches",
        *map(render_text, found),
    ]
    sys.stdout.write("\n".join(lines) + "\n" + summary(drive))
    chosen.output.mkdir(parents=True, exist_ok=True)
    for name, text in {**written(drive), "run.csv": recording.decode()}.items():
        (chosen.output / name).write_text(text, encoding="utf-8")
        sys.stdout.write(f"{chosen.output / name}: written\n")
    return 0 if drive.succeeded and not any(d.is_error for d in found) else 1


if __name__ == "__main__":
    sys.exit(main())
