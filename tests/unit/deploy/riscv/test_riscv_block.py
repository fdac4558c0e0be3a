"""The struct that the emulator's callbacks in C and Python share has the same fields, in the same places."""

import ctypes
import re
from pathlib import Path

from halpipe.deploy.riscv.board import block_hook

SOURCE = (Path(block_hook.__file__).parent / "native" / "block.c").read_text()


def declared():
    """(name, bytes) of the fields that the source declares."""
    sizes = dict(re.findall(r"(\w+) = (\d+)", re.search(r"enum \{(.*?)\};", SOURCE)[1]))
    body = re.search(r"typedef struct \{\n(.*?)\n\} Page;", SOURCE, re.DOTALL)[1]
    found = []
    for line in re.sub(r"/\*.*?\*/", "", body, flags=re.DOTALL).split("\n"):
        name, count = re.search(r"(?:\(\*(\w+)\)|\b(\w+)(?:\[(\w+)\])?;\s*$)", line.strip()).group(1, 3)
        name = name or re.search(r"(\w+)(?:\[\w+\])?;\s*$", line.strip())[1]
        inner = re.search(r"struct \{(.*)\}", line)
        width = 8 * inner[1].count(",") + 8 if inner and "uint32_t" not in inner[1] else 16 if inner else 8
        found.append((name, width * int(sizes.get(count, count or 1))))
    return found


def test_both_sides_have_the_same_fields():
    page = block_hook.Page
    assert [(name, getattr(page, name).size) for name, _ in page._fields_] == declared()
    assert ctypes.sizeof(page) <= block_hook.HEADER


def test_the_inner_structs_are_the_same():
    inner = {m[2]: re.findall(r"\w+(?=[,;])", m[1]) for m in re.finditer(r"struct \{(.*?)\} (\w+)\[", SOURCE)}
    assert inner == {
        "region": [name for name, _ in block_hook.Region._fields_],
        "known": [name for name, _ in block_hook.Known._fields_],
        "branch": [name for name, _ in block_hook.Branch._fields_],
    }
