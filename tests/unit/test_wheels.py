"""A wheel has the libraries of its system and no others, its tags say so, and installing it compiles nothing.

`make wheels` puts wheels into a folder and names it in WHEELS; by itself this test makes one, for Linux.
"""

import os
import re
import struct
import subprocess
import sys
import zipfile
from email import message_from_bytes
from pathlib import Path

import pytest

from halpipe.selftest import evidence

ROOT = Path(__file__).parents[2]

# Of each target: the tags of its wheel, how its libraries end, and what says in a library for which machine it is.
ELF, MACHO, PE = "elf", "mach-o", "pe"
TARGETS = {
    "linux-x86_64": (["manylinux_2_17_x86_64", "musllinux_1_1_x86_64"], ".so", (ELF, 0x3E)),
    "linux-aarch64": (["manylinux_2_17_aarch64", "musllinux_1_1_aarch64"], ".so", (ELF, 0xB7)),
    "macos-x86_64": (["macosx_11_0_x86_64"], ".dylib", (MACHO, 0x01000007)),
    "macos-arm64": (["macosx_11_0_arm64"], ".dylib", (MACHO, 0x0100000C)),
    "windows-x86_64": (["win_amd64"], ".dll", (PE, 0x8664)),
}
LIBRARIES = (
    "halpipe/deploy/riscv/board/native/block",
    "halpipe/pipeline/solve/kernel/native/kernel",
    "halpipe/pipeline/solve/edf/native/edf",
)


def machine(data):
    """Return the format of a library and the number of the machine that it is for."""
    if data[:4] == b"\x7fELF":
        return ELF, struct.unpack_from("<H", data, 18)[0]
    if data[:4] == b"\xcf\xfa\xed\xfe":
        return MACHO, struct.unpack_from("<I", data, 4)[0]
    (header,) = struct.unpack_from("<I", data, 0x3C)
    assert data[:2] == b"MZ"
    assert data[header : header + 4] == b"PE\0\0"
    return PE, struct.unpack_from("<H", data, header + 4)[0]


@pytest.fixture(scope="module", params=TARGETS)
def wheel(request, tmp_path_factory):
    """The target and its wheel."""
    if "WHEELS" in os.environ:
        tag = ".".join(TARGETS[request.param][0])
        (found,) = Path(ROOT, os.environ["WHEELS"]).glob(f"halpipe-*-py3-none-{tag}.whl")
        return request.param, found
    if request.param != "linux-x86_64":
        pytest.skip("made and tested by `make wheels`")
    pytest.importorskip("hatchling", reason="halpipe[dev] is not installed")
    pytest.importorskip("ziglang", reason="halpipe[riscv] is not installed")
    folder = tmp_path_factory.mktemp("wheels")
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--no-build-isolation",
        "--no-deps",
        "--no-index",
        "-w",
        str(folder),
    ]
    done = subprocess.run(
        [*command, str(ROOT)],
        env={**os.environ, "HALPIPE_TARGET": request.param},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return request.param, next(folder.glob("*.whl"))


@pytest.mark.slow  # a wheel is made, for a second
def test_a_wheel_is_what_its_name_says(wheel):
    target, path = wheel
    tags, suffix, expected = TARGETS[target]
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        names = set(archive.namelist())
        libraries = {name for name in names if Path(name).suffix in (".so", ".dylib", ".dll", ".pyd", ".exe")}
        assert libraries == {place + suffix for place in LIBRARIES}
        for name in libraries:
            assert machine(archive.read(name)) == expected
        description = message_from_bytes(archive.read(one(names, "WHEEL")))
        metadata = message_from_bytes(archive.read(one(names, "METADATA")))
        record = archive.read(one(names, "RECORD")).decode()
    assert description.get_all("Tag") == [f"py3-none-{tag}" for tag in tags]
    assert description["Root-Is-Purelib"] == "false"
    assert path.name.removesuffix(".whl").split("-")[2:] == ["py3", "none", ".".join(tags)]
    assert {line.rsplit(",", 2)[0] for line in record.splitlines()} == names
    needs = {
        re.match(r"[\w-]+", need)[0].lower() for need in metadata.get_all("Requires-Dist") if "extra ==" not in need
    }
    assert not needs & {"numba", "llvmlite", "ziglang", "cffi", "hatchling"}
    assert {"halpipe/starters/first/model.xml", "halpipe/examples/roboracer/overlay.yaml"} <= names
    assert {"halpipe/schemas/pipeline-1.schema.json", "halpipe/schemas/task-model-1.xsd"} <= names
    safety = ("second_checker.py", evidence.WALK, evidence.FIGURES, *evidence.ARGUMENTS)
    assert {f"halpipe/selftest/{name}" for name in safety} <= names
    assert not any("/out/" in name or "__pycache__" in name for name in names)
    places = {name.split("/")[0] for name in names}
    assert places == {"halpipe", one(names, "WHEEL").split("/")[0]}


@pytest.mark.slow
def test_libraries_are_of_the_sources_beside_them_and_need_no_other_library(wheel, tmp_path):
    from halpipe.core.libraries import fingerprint

    target, path = wheel
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path)
    for place in LIBRARIES:
        library = tmp_path / (place + TARGETS[target][1])
        data = library.read_bytes()
        assert fingerprint(library.parent).encode() in data
        if target.startswith("linux"):
            assert needed(data) == []


def needed(data):
    """Return the offsets of the names of libraries that an ELF file asks for: its entries of type DT_NEEDED."""
    headers, size, count = *struct.unpack_from("<Q", data, 32), *struct.unpack_from("<HH", data, 54)
    for number in range(count):
        kind, _, offset, _, _, length = struct.unpack_from("<IIQQQQ", data, headers + number * size)
        if kind == 2:  # PT_DYNAMIC
            entries = (struct.unpack_from("<QQ", data, offset + place) for place in range(0, length, 16))
            return [value for tag, value in entries if tag == 1]
    raise AssertionError("is not linked dynamically")


def one(names, ending):
    (found,) = [name for name in names if name.endswith(f".dist-info/{ending}")]
    return found
