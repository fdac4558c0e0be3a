"""Functions that compilers call without being asked, compiled for this machine and compared with Python."""

import ctypes
import subprocess
import sys
from importlib.util import find_spec
from random import Random

import pytest

from halpipe.exporters.riscv.bundle import RUNTIME

pytestmark = pytest.mark.skipif(find_spec("ziglang") is None, reason="pip install ziglang")
COUNTS = {"__clzdi2": lambda v: 64 - v.bit_length(), "__popcountdi2": int.bit_count}
COUNTS["__ctzdi2"] = lambda v: (v & -v).bit_length() - 1 if v else 64
SPACE, AREA = 64, 24


def faults_of(source):
    """Return the functions of a source that differ from Python's, in random calls."""
    built = source.with_suffix(".so")
    command = [sys.executable, "-m", "ziglang", "cc", "-shared", "-nostdlib", "-fno-builtin", "-O1", str(source)]
    subprocess.run([*command, "-o", str(built)], check=True, capture_output=True)
    library, rng, found = ctypes.CDLL(str(built)), Random(1), set()
    for _ in range(300):
        content = bytes(rng.choice(b"\0\1\x7f\x80\xff") for _ in range(SPACE))
        at, other, size, value = rng.randrange(AREA), rng.randrange(AREA), rng.randrange(AREA), rng.randrange(-300, 300)
        moved = content[other : other + size]
        for name, part in (("memmove", moved), ("memcpy", moved), ("memset", bytes([value & 255]) * size)):
            if name == "memcpy" and abs(at - other) < size:
                continue
            after = ctypes.create_string_buffer(content, SPACE)
            base = ctypes.addressof(after)
            second = ctypes.c_int(value) if name == "memset" else ctypes.c_void_p(base + other)
            function = library[name]
            function.restype = ctypes.c_void_p
            back = function(ctypes.c_void_p(base + at), second, ctypes.c_size_t(size))
            if back != base + at or after.raw != content[:at] + part + content[at + size :]:
                found.add(name)
        left, right = content[at : at + size], bytes(rng.choice([b, b, b, b, b, b ^ 128]) for b in moved)
        sign = library["memcmp"](left, right, ctypes.c_size_t(size))
        if (sign > 0, sign < 0) != (left > right, left < right):
            found.add("memcmp")
        word = rng.choice([0, 1, 1 << 63, rng.getrandbits(64), 1 << rng.randrange(64), rng.getrandbits(20)])
        found |= {name for name, count in COUNTS.items() if library[name](ctypes.c_uint64(word)) != count(word)}
    return found


def test_every_function_does_what_its_name_says(tmp_path):
    copy = tmp_path / "minimal.c"
    copy.write_bytes(RUNTIME.joinpath("minimal.c").read_bytes())
    assert faults_of(copy) == set()


def test_a_fault_is_found(tmp_path):
    copy = tmp_path / "minimal.c"
    text = RUNTIME.joinpath("minimal.c").read_text()
    assert "(result == 0)" in text
    copy.write_text(text.replace("(result == 0)", "(result != 0)"))
    assert faults_of(copy) == {"memcmp"}
