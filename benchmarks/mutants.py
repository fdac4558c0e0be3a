# ruff: noqa: E402 - the tests it takes its models from are found by the path
"""RISC-V bundles with a fault each, drawn from a seed and checked: ``python benchmarks/mutants.py --seed 1``.

Of 120 faults 84 are in the runtime: a comparison, operator, number or statement of a source is another, spread over all
files. The others are in the bundle: a bit of the program or of an image, a number in target.json, the profile, the
drivers, the schedule. A fault that changes no byte of any bundle is drawn again, and so is one that changes nothing at
all: the reasons are in equivalent_mutants.py; an image is the same if entry, segments and symbols are, a text if what
programs read of it is. What `deploy check` passes is shown to the tests of `minimal.c`, of LETs and of short rings, a
changed program to `make check` of its bundle. Prints what finds each, then the survivors; the last line is JSON.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path
from random import Random
from typing import TYPE_CHECKING, Any

TESTS = Path(__file__).parents[1] / "tests"
sys.path[:0] = [str(TESTS / "riscv" / "cosim"), str(TESTS / "riscv" / "export"), str(TESTS)]

import yaml
from tampering import Program, resealed
from test_cosim_calibration import OWN
from test_cosim_dump import TRAP, ring_faults, short_rings
from test_cosim_health import RULES
from test_cosim_let import let_bundle
from test_cosim_mutants import coinciding, two_channels
from test_riscv_minimal import faults_of

import conftest as case
from equivalent_mutants import RUNTIME
from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.files import write_directory
from halpipe.deploy.base import CheckOptions
from halpipe.deploy.riscv import DEPLOYMENT
from halpipe.deploy.riscv.board.elf import read_program
from halpipe.deploy.riscv.judge import check
from halpipe.deploy.riscv.run.sequence import tours
from halpipe.exporters.native import paired
from halpipe.exporters.riscv import RiscvOptions, bundle
from halpipe.flow import formats
from halpipe.importers.native import parse_model, parse_schedule
from halpipe.pipeline.health import with_reactions

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from halpipe.deploy.base import Target

OF_RUNTIME, OF_BUNDLE = 84, 36
DRIVERS = """halpipe-drivers: 1
sources: [board.c]
inputs:
  - {buffer: sample, function: sample_read, time: 20us}
outputs:
  - {buffer: command, function: command_write, time: 5us, task: act}
"""
BOARD = "#include <stdint.h>\n" + "".join(
    f"void {name}(void *data, uint64_t size) {{ (void)data; (void)size; }}\n"
    for name in ("sample_read", "command_write")
)
BUNDLES: dict[str, dict[str, Any]] = {
    "plain": {"profile": "fu540"},
    "drivers": {"profile": "vcu118", "drivers": DRIVERS},
    "copies": {"profile": "virt"},
    "calibrating": {"profile": OWN, "calibrate": True},
}
ONLY = {"calibrate.c": ("calibrating",), "loops.S": ("calibrating",)}


def build(
    folder: Path,
    runtime: Path,
    profile: str,
    drivers: str = "",
    calibrate: bool = False,
    sources: dict[str, str] | None = None,
) -> Target:
    """Export the model of the tests, with health rules and a runtime."""
    folder.mkdir()
    for name in case.SOURCES:
        folder.joinpath(name).write_text((sources or {}).get(name) or case.HERE.joinpath(name).read_text())
    text = case.HERE.joinpath("model.xml").read_text().replace("  </transitions>\n</task-model>", RULES)
    text = two_channels(coinciding(text) if profile == "fu540" else text)  # the others are too slow for it
    if profile == "virt":
        text = text.replace(' bandwidth="400MB/s"', "")
    system = parse_model(text.encode(), str(folder / "model.xml"))
    pair = paired(system, with_reactions(system, case.tables_of(system)))
    model = parse_model(pair["model.xml"], str(folder / "model.xml"))
    schedule = parse_schedule(pair["schedule.xml"], str(folder / "schedule.xml"))
    if "\n" in profile:
        folder.joinpath("own.yaml").write_text(profile)
        profile = str(folder / "own.yaml")
    options = RiscvOptions(profile=profile, toolchain="gcc", sources=str(folder), calibrate=calibrate)
    if drivers:
        folder.joinpath("drivers.yaml").write_text(drivers)
        folder.joinpath("board.c").write_text(BOARD)
        options = replace(options, drivers=str(folder / "drivers.yaml"))
    sound, bundle.RUNTIME = bundle.RUNTIME, runtime
    try:
        write_directory(str(folder / "out"), formats.export("riscv", model, schedule, options))
    finally:
        bundle.RUNTIME = sound
    return formats.open_target(str(folder / "out"))


def found_in(target: Target) -> list[str]:
    """Return the codes of the errors that the check finds, in its first run or in all of it."""
    try:
        first = [
            *check.static_findings(target),
            *check.simulate(target, tours(target.schedule, check.CYCLES)[0]).findings,
        ]
        found = first if any(d.is_error for d in first) else DEPLOYMENT.check(target, CheckOptions()).diagnostics
        return sorted({d.code for d in found if d.is_error})
    except HalpipeError as failure:
        return sorted({d.code for d in failure.diagnostics})


# ------------------------------------------------------------------------------------------------ the runtime

SWAPS = {"==": "!=", "!=": "==", "<": "<=", "<=": "<", ">": ">=", ">=": ">", "+": "-", "-": "+", "&": "|", "|": "&"}
SWAPS |= {"&&": "||", "||": "&&", "<<": ">>", ">>": "<<", "++": "--", "*": "+", "%": "+", "^": "&"}
OPERATOR = re.compile(r"(?<= )(==|!=|<=|>=|<<|>>|&&|\|\||<|>|\+|-|&|\||\*|%|\^)(?= )|\+\+")
NUMBER = re.compile(r"(?<![\w.])(0x[0-9a-f]+|\d+)(?=U?L?\b)")
IN_C = re.compile(r"(?s)/\*.*?\*/|(?m:^#(?!define)[^\n]*$)|(?m:^_Static_assert[^;]*;)")
IN_ASSEMBLER = re.compile(r"(?m)#.*$|^\s*\..*$")


def faults_in(name: str, text: str) -> list[tuple[int, int, str]]:
    """Return all single faults of a source: begin and end of what is replaced, and by what."""
    is_assembler = name.endswith(".S")
    hidden = [m.span() for m in (IN_ASSEMBLER if is_assembler else IN_C).finditer(text)]
    found = [(m.start(), m.end(), _other(m[0])) for m in NUMBER.finditer(text)]
    if is_assembler:
        found += [
            (m.start(1), m.end(1), "nop") for m in re.finditer(r"(?m)^(?:\w+:)? +([a-z][^#\n\\]*[^#\n\\ ])", text)
        ]
    else:
        found += [(m.start(), m.end(), SWAPS[m[0]]) for m in OPERATOR.finditer(text)]
        found += [
            (m.start(1), m.end(1), ";")
            for m in re.finditer(r"(?m)^ +([\w>*(-]+(?: [^\s{};]*=|\+\+|\()[^;{}]*;)$", text)
        ]
    return sorted(f for f in found if not any(low <= f[0] < high for low, high in hidden))


def _other(number: str) -> str:
    value = int(number, 0) + 1
    return hex(value) if number.startswith("0x") else str(value)


def runtime_faults(random: Random) -> Iterator[tuple[str, str, str]]:
    """Yield file, name and text of sources with a fault, without end: files in turn, each as often as it is long."""
    texts = {p.name: p.read_text() for p in sorted(bundle.RUNTIME.iterdir()) if p.suffix in (".c", ".S", ".h")}
    faults = {name: random.sample(each := faults_in(name, text), len(each)) for name, text in texts.items()}
    left = {name: len(each) for name, each in faults.items() if each}
    total = dict(left)
    while any(left.values()):
        name = max(left, key=lambda n: (left[n] / total[n], n))
        left[name] -= 1
        low, high, instead = faults[name][left[name]]
        text = texts[name]
        title = title_of(name, text, low, high, instead)
        if title not in RUNTIME:
            yield name, title, text[:low] + instead + text[high:]


def title_of(name: str, text: str, low: int, high: int, instead: str) -> str:
    """Return file, fault and line of text; of several equal faults in a line the later ones are numbered."""
    begin, end = text.rfind("\n", 0, low) + 1, text.find("\n", low)
    old = " ".join(text[low:high].split())
    nth = sum(
        begin <= a < low and (" ".join(text[a:b].split()), new) == (old, instead) for a, b, new in faults_in(name, text)
    )
    return f"{name}: {old} -> {instead} in {text[begin:end].strip()}" + f" ({nth + 1})" * bool(nth)


def check_runtime(name: str, text: str, folder: Path, sound: dict[str, Target]) -> list[str] | None:
    """Return what is found with a changed source; None if no bundle is another, or none can be built."""
    runtime = folder / "runtime"
    shutil.copytree(bundle.RUNTIME, runtime)
    runtime.joinpath(name).write_text(text)
    is_other = False
    for each in ONLY.get(name, tuple(BUNDLES)):
        try:
            target = build(folder / each, runtime, **BUNDLES[each])
        except HalpipeError:
            return None
        if target.bundle.files["bundle.elf"] == sound[each].bundle.files["bundle.elf"]:
            continue
        is_other = True
        found = found_in(target)
        if found:
            return found
    return apart(name, runtime, folder) if is_other else None


def apart(name: str, runtime: Path, folder: Path) -> list[str]:
    """Return the tests that find what the check has not found."""
    if name == "minimal.c":
        return ["tests/riscv/export/test_riscv_minimal.py"] * bool(faults_of(runtime / name))
    sound, bundle.RUNTIME = bundle.RUNTIME, runtime
    try:
        if name == "runtime.c" and found_in(let_bundle(folder / "let", toolchain="gcc")):
            return ["tests/riscv/cosim/test_cosim_let.py"]
        with short_rings():
            short = build(folder / "short", runtime, "vcu118", sources={"act.c": TRAP})
        return ["tests/riscv/cosim/test_cosim_dump.py"] * bool(ring_faults(short))
    finally:
        bundle.RUNTIME = sound


# ------------------------------------------------------------------------------------------------ the bundle


def _bit(random: Random, target: Target) -> tuple[str, dict[str, bytes]]:
    """Change a bit of a symbol of the program, in both of its files."""
    program = Program(target)
    stored = [(base, base + size) for base, size, _ in program.parts]
    symbols = {n: s for n, s in program.symbols.items() if s[1] and any(a <= s[0] < b for a, b in stored)}
    name = random.choice(sorted(symbols))
    at, bit = symbols[name][0] + random.randrange(symbols[name][1]), random.randrange(8)
    program.put(at, program.get(at, 1) ^ 1 << bit, 1)
    return f"bit {bit} of byte {at - symbols[name][0]} of {name}", {
        "bundle.elf": bytes(program.data),
        "bundle.bin": program.flat(),
    }


def _flip(random: Random, target: Target, pattern: str) -> tuple[str, dict[str, bytes]]:
    """Change a bit of a file that is not zero, so that it is another program."""
    name = random.choice(sorted(n for n in target.bundle.files if re.fullmatch(pattern, n)))
    sound = target.bundle.files[name]
    while True:
        data = bytearray(sound)
        at = random.choice([i for i, byte in enumerate(data) if byte])
        data[at] ^= 1 << random.randrange(8)
        if _program(data) != _program(sound):
            return f"byte {at} of {name}", {name: bytes(data)}


def _program(data: bytes) -> object:
    try:
        return read_program(bytes(data), Location(""))
    except HalpipeError:
        return bytes(data)


def _text(random: Random, target: Target, name: str, pattern: str) -> tuple[str, dict[str, bytes]]:
    """Change a number in a text."""
    text = target.bundle.files[name].decode()
    places = [m.span(1) for m in re.finditer(pattern, text)]
    low, high = random.choice(places)
    number = text[low:high]
    value = int(number, 16 if number.startswith("0x") else 10) + random.choice([1, 8, 4096])
    other = hex(value) if number.startswith("0x") else str(value)
    changed = text[:low] + other + text[high:]
    if _meaning(name, changed) == _meaning(name, text):
        return _text(random, target, name, pattern)
    line = text.count("\n", 0, low)
    return f"{name}:{line + 1}: {text.splitlines()[line].strip()[:80]}: {other}", {name: changed.encode()}


def _meaning(name: str, text: str) -> object:
    """Return what programs read of a text, without what is for people: comments and names of tools."""
    if name.endswith(".xml"):
        return text
    read = json.loads(text) if name.endswith(".json") else yaml.safe_load(text)
    return {key: value for key, value in read.items() if key not in ("summary", "toolchain")}


NUMBERS = r"(?<![\w.])(0x[0-9a-f]+|\d+)"
CONTENTS: tuple[tuple[str, Callable[[Random, Target], tuple[str, dict[str, bytes]]]], ...] = (
    ("drivers", _bit),
    ("plain", _bit),
    ("copies", _bit),
    ("plain", partial(_text, name="target.json", pattern=NUMBERS)),
    ("drivers", partial(_text, name="target.json", pattern=NUMBERS)),
    ("plain", partial(_flip, pattern=r"images/.*\.elf|bundle\.bin")),
    ("calibrating", partial(_text, name="profile.yaml", pattern=NUMBERS)),
    ("drivers", partial(_text, name="schedule.xml", pattern=r'(?:start|end|hyperperiod|length)="(\d+)')),
    ("plain", partial(_text, name="model.xml", pattern=r'(?:wcet|size|start|count|cycles)="(\d+)')),
)


def bundle_faults(random: Random, sound: dict[str, Target]) -> Iterator[tuple[str, str, dict[str, bytes]]]:
    """Yield the bundle, a name and the changed files of faults, of each kind in turn."""
    while True:
        for each, change in CONTENTS:
            title, files = change(random, sound[each])
            yield each, f"{each}: {title}", files


def check_bundle(target: Target, files: dict[str, bytes], folder: Path) -> list[str]:
    """Return what is found in a bundle with changed files, and a manifest that names these."""
    try:
        resealed(target, folder, files)
        found = found_in(formats.open_target(str(folder)))
        is_program = any(name.endswith((".elf", ".bin")) for name in files)
        return found or ["make check of the bundle"] * (is_program and not _rebuilds(folder))
    except HalpipeError as refused:
        return sorted({d.code for d in refused.diagnostics})


def _rebuilds(folder: Path) -> bool:
    """Whether a bundle is what its own sources and Makefile make."""
    return subprocess.run(["make", "check"], cwd=folder, capture_output=True, check=False).returncode == 0


def main() -> int:
    """Check every mutant; return 1 if a sound bundle is found faulty."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--share", default="0/1", help="of the mutants: K/N takes every N-th from the K-th on")
    parser.add_argument("--after", type=int, default=0, help="leave out so many of the drawn faults of the runtime")
    parser.add_argument("--only", default="", help="a part of the name: check these alone")
    chosen = parser.parse_args()
    check.SPARE_CALLS = 100_000  # a loop over devices has no end anyway
    first, step = map(int, chosen.share.split("/"))
    begin, caught, same = time.process_time(), dict[str, list[str]](), 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sound = {each: build(folder / each, bundle.RUNTIME, **facts) for each, facts in BUNDLES.items()}
        for each, target in sound.items():
            if found_in(target):
                print(f"the sound bundle {each}: {found_in(target)}")
                return 1
        beside = folder / "beside"
        beside.mkdir()
        if apart("runtime.c", bundle.RUNTIME, beside) or not all(_rebuilds(folder / each / "out") for each in sound):
            print("a test finds the sound bundle, or it is another than its sources make")
            return 1

        def note(title: str, checked: Callable[[Path], list[str] | None]) -> bool:
            """Check one mutant, unless it is of another share; return whether it counts."""
            at = folder / "mutant"
            at.mkdir()
            found = checked(at)
            shutil.rmtree(at)
            if found is not None:
                caught[title] = found
                print(title, *(found or ["-"]), sep="; ", flush=True)
            return found is not None

        runtime, contents = runtime_faults(Random(chosen.seed)), bundle_faults(Random(chosen.seed), sound)
        number = 0
        wanted = len(range(first, OF_RUNTIME, step))
        while len(caught) + chosen.after // step < wanted:
            file, title, text = next(runtime)
            if number % step == first and number >= chosen.after and chosen.only in title:
                same += not note(title, lambda at, file=file, text=text: check_runtime(file, text, at, sound))
            number += 1
        for number, (each, title, files) in zip(range(OF_BUNDLE), contents, strict=False):
            if number % step == first and chosen.only in title:
                note(title, lambda at, each=each, files=files: check_bundle(sound[each], files, at / "b"))
    survivors = [title for title, by in caught.items() if not by]
    print("survivors:", *survivors, sep="\n  ")
    by_others = sum(bool(by) and not all(code.startswith("HAL") for code in by) for by in caught.values())
    counts = {"mutants": len(caught), "caught": len(caught) - len(survivors), "of them by tests apart": by_others}
    counts["no other program"] = same
    print(json.dumps({**counts, "seconds": int(time.process_time() - begin)}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
