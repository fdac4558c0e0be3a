"""Late transfers in the bundle of the tests, by up to a hyperperiod: ``python benchmarks/late_transfers.py``.

One transfer in every fourth table of a run is late, each time another one or by another time. Runs are compared with
what has to follow: the job is recorded, so are those that wait for its channel or unit, and nothing else changes.
Prints the findings, of which there have to be none; the last line is JSON with the counts.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path

from halpipe.deploy.riscv.judge import check, containment
from halpipe.exporters.riscv import bundle
from mutants import OWN, build

PROFILES = ("vcu118", "fu540", "mpfs", OWN)
SEVERAL = 5
"""Runs of a mode with a profile, one after the other."""


def main() -> int:
    """Delay transfers until there are enough; return 1 if anything is found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--delays", type=int, default=1000)
    chosen = parser.parse_args()
    begin, delays, held, turn, found = time.process_time(), 0, 0, 0, []
    with tempfile.TemporaryDirectory() as name:
        targets = [build(Path(name) / str(i), bundle.RUNTIME, each) for i, each in enumerate(PROFILES)]
        while delays < chosen.delays:
            for target in targets:
                for tour in containment.sweeps(target.schedule)[:2]:
                    injected = containment.Injected()
                    check.delay(target, tour, 4 * check.DELAYS, injected, turns=range(turn, turn + SEVERAL))
                    errors = [d for d in injected.findings if d.is_error]
                    delays, held, found = delays + injected.delays, held + injected.held, found + errors
                    for each in errors:
                        print(f"{each.code} {each.path}: {each.message}")
            turn += SEVERAL
            print(f"{delays} late, {held} wait, {len(found)} findings", flush=True)
    counts = {"late": delays, "wait": held, "runs": turn * len(PROFILES) * 2, "findings": len(found)}
    print(json.dumps(counts | {"seconds": int(time.process_time() - begin)}))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
