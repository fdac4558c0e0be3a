"""The RoboRacer example: its programs compiled for this computer, its schedule found by hand, its simulated world."""

import ctypes
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parents[2] / "examples" / "roboracer"), str(Path(__file__).parent)]

from roboracer_case import EXAMPLE, FIXTURES, by_hand  # noqa: E402

import halpipe  # noqa: E402


@pytest.fixture(scope="session")
def model():
    return halpipe.load(str(EXAMPLE / "model.xml"))


@pytest.fixture(scope="session")
def schedule(model):
    found = by_hand(model)
    assert halpipe.verify(model, found) == []
    return found


@pytest.fixture(scope="session")
def track():
    from track import circuit

    return circuit()


@pytest.fixture(scope="session")
def race(track):
    """The stations of the car's map, and the offsets of the race line there."""
    from track import Track, race_line

    coarse = Track(track.points[::8])
    return coarse, race_line(coarse)


@pytest.fixture(scope="session")
def compiler():
    if shutil.which("cc") is None and not _has_ziglang():
        pytest.skip("no C compiler: pip install ziglang")
    import host

    return host.compiler()


def _has_ziglang():
    try:
        import ziglang  # noqa: F401
    except ImportError:
        return False
    return True


@pytest.fixture(scope="session")
def programs(model, compiler, tmp_path_factory):
    pytest.importorskip("elftools", reason="pip install pyelftools")
    import host

    return host.programs(model, EXAMPLE, tmp_path_factory.mktemp("programs"))


@pytest.fixture(scope="session")
def probe(compiler, tmp_path_factory):
    library = tmp_path_factory.mktemp("probe") / "probe.so"
    files = [str(FIXTURES / "probe.c"), str(EXAMPLE / "tasks" / "tables.c")]
    subprocess.run([*compiler, "-std=c11", "-O1", "-shared", "-fPIC", "-o", str(library), *files], check=True)
    loaded = ctypes.CDLL(str(library))
    for function in (loaded.probe_direction, loaded.probe_square_root, loaded.probe_random):
        function.restype = ctypes.c_uint32
    loaded.probe_square_root.argtypes = [ctypes.c_uint64]
    return loaded
