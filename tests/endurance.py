"""The worst inputs at 10 MB, each in a process of its own: at most 10 s of processor time and 1 GiB.

Prints a line for each and ends with 1 if one breaks the law. Usage: endurance.py [MB] [NAME ...]
Just below a limit of elements a file takes longest, so that sizes below 10 MB are worth a try, too.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from worst_inputs import BESIDE, WORST, as_bytes

SECONDS, MEBIBYTES = 10, 1024
PATIENCE = 60

MODEL = """<task-model xmlns="urn:halpipe:task-model:1" name="m"><platform><unit name="u"/></platform><tasks>
<task name="a" period="10ms"><version name="v" wcet="1ms"><units names="u"/></version></task>
</tasks><modes><mode name="a"><run task="a" versions="v"/></mode></modes></task-model>
"""


def run(folder: Path, *words: str) -> tuple[int, float, float]:
    """Return exit code, seconds of processor time and mebibytes of a command."""

    command = [sys.executable, "-m", "halpipe", *words]
    process = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    return process.returncode, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024


def main() -> int:
    """Try every reader."""
    size = int(float(sys.argv[1]) * 1e6) if len(sys.argv) > 1 else 10_000_000
    resource.setrlimit(resource.RLIMIT_CPU, (PATIENCE, PATIENCE))  # of each process alone
    broken = 0
    with tempfile.TemporaryDirectory(prefix="halpipe-endurance-") as place:
        folder = Path(place)
        (folder / "model.xml").write_text(MODEL)
        for name, text in BESIDE.items():
            (folder / name).write_text(text)
        if run(folder, "schedule", "model.xml", "-o", "s.xml", "-q")[0]:
            sys.exit("the schedule that inputs are held against was not made")
        for kind, (command, file, make) in WORST.items():
            if sys.argv[2:] and kind not in sys.argv[2:]:
                continue
            (folder / file).write_bytes(as_bytes(make(size)))
            code, seconds, memory = run(folder, *[file if word == "FILE" else word for word in command])
            (folder / file).unlink()
            lawful = code in (0, 1, 2) and seconds <= SECONDS and memory <= MEBIBYTES
            verdict = "ok" if lawful else "BREAKS THE LAW"
            broken += not lawful
            print(f"{kind:36} exit {code:3} {seconds:7.1f} s {memory:6.0f} MiB  {verdict}", flush=True)  # noqa: T201
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
