"""Linux resctrl as its sources have it, re-expressed for tests: ranges, rounding, and the files that a script sees.

fs/resctrl (bw_validate), arch/x86 (AMD: min 0, step 1), drivers/resctrl (MPAM: round and ceil of 100/2^w, nearest
band). Run as a program it stands for `cat` and `sed` on the files of /sys/fs/resctrl, plain files in a folder then.
"""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path


def round_closest(numerator, denominator):
    """The kernel's DIV_ROUND_CLOSEST of positive integers."""
    return (numerator + denominator // 2) // denominator


@dataclass(frozen=True)
class Kernel:
    """A kernel with bandwidth control: `kind`, bits of MPAM's control, and of x86 min, step and max."""

    kind: str
    width: int = 0
    min: int = 0
    step: int = 1
    max: int = 100

    @classmethod
    def mpam(cls, width):
        bands = 1 << width
        return cls("mpam", width, round_closest(100, bands), (100 + bands - 1) // bands)

    def accepts(self, value):
        return self.min <= value <= self.max

    def stored(self, value):
        """What is in force after a write: bw_validate rounds up, MPAM takes a band."""
        value = (value + self.step - 1) // self.step * self.step
        return self.band(value) if self.kind == "mpam" else value

    def band(self, percent):
        value = max(round_closest(percent << self.width, 100), 1) - 1
        return ((value << (16 - self.width)) & 0xFFFF) >> (16 - self.width)

    def shown(self, stored):
        return round_closest((stored + 1) * 100, 1 << self.width) if self.kind == "mpam" else stored

    def share(self, stored):
        """What is in force, as numerator and denominator of the peak; of AMD in eighths of a GB/s."""
        if self.kind == "mpam":
            return stored + 1, 1 << self.width
        return stored, 1 if self.kind == "amd" else 100


KERNELS = {
    "intel": Kernel("intel", min=10, step=10),
    "intel-5": Kernel("intel", min=5, step=5),
    "amd": Kernel("amd", max=2048),
    **{f"mpam-{width}": Kernel.mpam(width) for width in range(1, 17)},
}


def make_files(folder, kernel, domains=(0,), closids=16):
    """The folder of resctrl before anything was written."""
    (folder / "info/MB").mkdir(parents=True)
    (folder / "kernel.json").write_text(json.dumps(kernel.__dict__))
    for name, value in (("min_bandwidth", kernel.min), ("bandwidth_gran", kernel.step), ("num_closids", closids)):
        (folder / "info/MB" / name).write_text(f"{value}\n")
    whole = ";".join(f"{domain}={kernel.max}" for domain in domains)
    (folder / "schemata").write_text(f"MB:{whole}\n")


def values(folder, group):
    """What is in force in a group by domain; None where the line written last is refused."""
    kernel = Kernel(**json.loads((folder / "kernel.json").read_text()))
    written = (folder / group / "schemata").read_text().strip().removeprefix("MB:")
    pairs = [(int(domain), int(value)) for domain, value in (item.split("=") for item in written.split(";"))]
    if not all(kernel.accepts(value) for _, value in pairs):
        return None
    return {domain: kernel.stored(value) for domain, value in sorted(pairs)}


def main(name, arguments):
    folder = Path.cwd()
    file = arguments[-1] if arguments else ""
    if name == "cat" and file == "info/last_cmd_status":
        wrong = [path for path in folder.glob("**/schemata") if values(folder, path.parent) is None]
        sys.stdout.write("MB value out of range\n" if wrong else "ok\n")
    elif name == "sed" and file.endswith("/schemata"):
        kernel = Kernel(**json.loads((folder / "kernel.json").read_text()))
        found = values(folder, Path(file).parent)
        line = ";".join(f"{domain}={kernel.shown(stored):>4}" for domain, stored in found.items())
        text = f"    MB:{line}\n    L3:0=ffff\n"
        subprocess.run(["/bin/sed", *arguments[:-1]], input=text.encode(), check=True)
    else:
        os.execv(f"/bin/{name}", [name, *arguments])


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
