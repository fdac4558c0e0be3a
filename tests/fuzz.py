"""Random and damaged inputs of every reader: no traceback, no hang, nothing left over.

Usage: fuzz.py [--inputs 100000] [--seed 1] [--reader NAME]. Inputs are made from the seeds of each reader by changes of
bytes, of words and of lines, and by joining two; one that reaches lines of the package that were not reached before
joins the seeds of its reader (feedback of coverage, on a sample). Failures are printed, and written to fuzz-failures/.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import os
import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import halpipe
from command_line import run_here
from ctf_writer import ros_trace
from growth import TRIES, seconds
from worst_inputs import BESIDE, CALIBRATE, IMPORT, WORST, as_bytes

PACKAGE = str(Path(halpipe.__file__).parent)
SECONDS, MULTIPLE = 10.0, 2000
"""Processor time that an input may take; on slow machines, so many times what a command takes that reads little."""
LONGEST = 20_000
TRACE = "trace"
PROFILE = ["export", "riscv", "model.xml", "s.xml", "--profile", "FILE", "--sources", ".", "-o", "out"]
TRACED = 300
"""One in so many inputs is run with its lines noted: that takes several times as long."""

WORDS = [
    *(
        b"",
        b"0",
        b"-1",
        b"1/0",
        b"1e999",
        b"99999999999999999999999",
        b"\xff",
        b"\0",
        b"\xe2\x80\xae",
        b"\x1b[2J",
        b"%s%n",
    ),
    *(
        b"../../x",
        b"/etc/passwd",
        b"NaN",
        b"none",
        b"anywhere",
        b"&lt;",
        b"]]>",
        b"<!--",
        b"*a",
        b"&a",
        b"{",
        b"}",
        b'"',
    ),
    *(b"'", b"\n", b"10ms", b"1/3us", b"true", b"null", b"a b", b"a" * 300),
]


def seeds() -> dict[str, tuple[list[str], str, list[bytes]]]:
    """Return, by reader, the command, the name of its file, and first inputs: the small forms of the worst ones."""
    found: dict[str, tuple[list[str], str, list[bytes]]] = {}
    for kind, (command, file, make) in WORST.items():
        reader = f"{kind.partition(':')[0]} {command[0]}"
        _, _, inputs = found.setdefault(reader, (command, file, []))
        inputs.append(as_bytes(make(600))[:LONGEST])
    profiles = sorted(Path(PACKAGE, "profiles").glob("*.yaml"))
    found["profile export"] = (PROFILE, "profile.yaml", [path.read_bytes() for path in profiles])
    tresos = Path(__file__).with_name("fixtures") / "fuzz" / "os.xdm"
    found["xdm import"] = (IMPORT["arxml"], "os.xdm", [tresos.read_bytes()])
    trace = [TRACE if word == "FILE" else word for word in CALIBRATE]
    with tempfile.TemporaryDirectory() as folder:
        for path in sorted(ros_trace(3).write(Path(folder, TRACE)).iterdir()):
            found[f"ctf-{path.stem} import"] = (trace, f"{TRACE}/{path.name}", [path.read_bytes()])
    return found


def changed(rng: random.Random, inputs: list[bytes]) -> bytes:
    """Return an input made from others."""
    data = bytearray(rng.choice(inputs))
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(data) + 1)
        until = min(len(data), at + rng.choice((0, 1, 4, 30)))
        match rng.randrange(6):
            case 0:
                data[at:until] = rng.choice(WORDS)
            case 1:
                data[at:until] = bytes(rng.randrange(256) for _ in range(rng.randrange(4)))
            case 2:
                data[at:at] = data[at:until] * rng.randrange(1, 9)
            case 3:
                other = rng.choice(inputs)
                data[at:] = other[rng.randrange(len(other) + 1) :]
            case 4:
                lines = data.split(b"\n")
                lines[rng.randrange(len(lines))] = rng.choice(rng.choice(inputs).split(b"\n"))
                data = bytearray(b"\n".join(lines))
            case _:
                words = bytes(data).split(b'"')
                if len(words) > 3:
                    words[rng.randrange(1, len(words), 2)] = rng.choice(WORDS)
                    data = bytearray(b'"'.join(words))
    return bytes(data[:LONGEST])


class Lines:
    """The lines of the package that were reached."""

    def __init__(self) -> None:
        self.known: set[tuple[str, int]] = set()
        self.new = 0

    def trace(self, frame, event, _):
        """Note lines of the package only."""
        if not frame.f_code.co_filename.startswith(PACKAGE):
            return None
        if event == "line":
            place = (frame.f_code.co_filename, frame.f_lineno)
            if place not in self.known:
                self.known.add(place)
                self.new += 1
        return self.trace


def patience(place: Path) -> float:
    """Return the seconds of processor time after which an input counts as a hang, on this machine."""
    take = min(seconds(lambda: run_here(place, "validate", "model.xml")) for _ in range(TRIES))
    return max(SECONDS, MULTIPLE * take)


def tried(place: Path, command: list[str], file: str, data: bytes, most: float) -> str:
    """Run one input; return what is wrong with how it ended, else nothing. It may take `most` seconds."""
    (place / file).write_bytes(data)
    before = set(os.listdir(place))
    begin = time.process_time()
    try:
        run = run_here(place, *[file if word == "FILE" else word for word in command])
    except BaseException as failure:  # noqa: BLE001 whatever comes out is a finding
        return f"raised {failure!r}"
    spent = time.process_time() - begin
    left = {name for name in os.listdir(place) if name not in before} - {"out.xml", "out"}
    for name in ("out.xml",):
        (place / name).unlink(missing_ok=True)
    if run.returncode not in (0, 1, 2, 3, 4, 5):
        return f"exit code {run.returncode}: {run.stderr[-300:]}"
    if "Traceback" in run.stderr or "internal error" in run.stderr:
        return run.stderr[-300:]
    if any((ord(c) < 32 and c not in "\n\t") or 0x80 <= ord(c) < 0xA0 for c in run.stdout + run.stderr):
        return "a control character was printed"
    return f"took {spent:.1f} s" if spent > most else f"left {sorted(left)}" if left else ""


def main() -> int:
    """Try that many inputs."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--inputs", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--reader", default="")
    options = parser.parse_args()
    rng, lines, failures, counts = random.Random(options.seed), Lines(), Counter(), Counter()
    known = {name: value for name, value in seeds().items() if options.reader in name}
    with tempfile.TemporaryDirectory(prefix="halpipe-fuzz-") as folder:
        place = Path(folder)
        from endurance import MODEL

        (place / "model.xml").write_text(MODEL)
        for name, text in BESIDE.items():
            (place / name).write_text(text)
        if run_here(place, "schedule", "model.xml", "-o", "s.xml", "-q").returncode:
            sys.exit("the schedule that inputs are held against was not made")
        ros_trace(3).write(place / TRACE)
        kept = {path: path.read_bytes() for path in sorted(place.rglob("*")) if path.is_file()}
        names, most = sorted(known), patience(place)
        for number in range(options.inputs):
            name = names[number % len(names)]
            command, file, inputs = known[name]
            data = changed(rng, inputs)
            is_traced = rng.randrange(TRACED) == 0
            lines.new = 0
            if is_traced:
                sys.settrace(lines.trace)
            found = tried(place, command, file, data, math.inf if is_traced else most)
            sys.settrace(None)
            if is_traced and lines.new:
                inputs.append(data)
            counts[name] += 1
            if place / file in kept:
                (place / file).write_bytes(kept[place / file])
            if any(other.read_bytes() != text for other, text in kept.items()):
                found = "an input was changed"
            if found:
                failures[found[:80]] += 1
                if failures[found[:80]] <= 3:
                    Path("fuzz-failures").mkdir(exist_ok=True)
                    kept_as = Path("fuzz-failures", f"{hashlib.sha256(data).hexdigest()[:12]}-{Path(file).name}")
                    kept_as.write_bytes(data)
                    print(f"{name}: {found}: {kept_as}", flush=True)
            if (number + 1) % 5000 == 0:
                print(f"{number + 1} inputs, {sum(failures.values())} failures, {len(lines.known)} lines", flush=True)
    print(
        f"{sum(counts.values())} inputs of {len(names)} readers, {sum(failures.values())} failures, seed {options.seed}"
    )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
