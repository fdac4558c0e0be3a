"""Kills of commands at random moments: outputs are the old or the new ones, and the next run leaves nothing over.

Usage: kills.py [KILLS] [SEED]. Prints how many runs were killed before their end, and how many files were broken.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

MODEL = Path(__file__).parents[1] / "src" / "halpipe" / "selftest" / "systems" / "modes.xml"
COMMANDS = (
    "schedule model.xml -o s.xml -q",
    "export report model.xml kept.xml -o r.html -q",
    "export amalthea model.xml kept.xml -o a.amxmi -q",
    "generate -o g.xml --witness w.xml --tasks 5 -q",
    "export linux model.xml kept.xml -o bundle --busy 50 -q",
)


def command(words: str) -> list[str]:
    """Return how a command is run in a process of its own."""
    return [sys.executable, "-m", "halpipe", *words.split()]


def contents(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def is_whole(now: dict[str, bytes], states: list[dict[str, bytes]]) -> bool:
    """Whether every visible file, and every visible folder as a whole, is that of some state."""
    shown = {name: data for name, data in now.items() if not any(part.startswith(".") for part in Path(name).parts)}
    for top in {Path(name).parts[0] for name in shown}:
        part = {name: data for name, data in shown.items() if Path(name).parts[0] == top}
        if part not in [{n: d for n, d in state.items() if Path(n).parts[0] == top} for state in states]:
            return False
    return True


def main(kills: int = 2000, seed: int = 1) -> int:
    """Kill that many runs."""
    rng, broken, early = random.Random(seed), 0, 0
    with tempfile.TemporaryDirectory(prefix="halpipe-kills-") as place:
        folder = Path(place)
        (folder / "model.xml").write_bytes(MODEL.read_bytes())
        subprocess.run(command("schedule model.xml -o kept.xml -q"), cwd=folder, check=True)
        states, lasts = {}, {}
        for words in COMMANDS:
            before = contents(folder)
            begin = time.monotonic()
            subprocess.run(command(words), cwd=folder, check=True)
            lasts[words], after = time.monotonic() - begin, contents(folder)
            states[words] = [before, after]
        full = contents(folder)
        for number in range(kills):
            words = rng.choice(COMMANDS)
            process = subprocess.Popen(command(words), cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            time.sleep(rng.random() * lasts[words] * 1.1)
            process.send_signal(signal.SIGKILL)
            early += process.wait() != 0
            if not is_whole(contents(folder), [full, *states[words]]):
                broken += 1
                print(f"kill {number}: {words} left {sorted(contents(folder))}", flush=True)
        for words in COMMANDS:
            subprocess.run(command(words), cwd=folder, check=True)
        left = sorted(contents(folder).keys() - full.keys())
    print(f"{kills} runs, {early} killed before their end, {broken} broken, left over after the next runs: {left}")
    return 1 if broken or left else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
