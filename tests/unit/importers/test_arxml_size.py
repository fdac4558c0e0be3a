"""A 20 MB extract is imported in half a gigabyte, and time grows with the size of an extract."""

import subprocess
import sys

import pytest
from arxml_case import assembly, component, composition, every, in_port, out_port, package, runnable, write

from growth import growth, half_way
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.options import ArxmlImportOptions

# The peak is read from /proc: getrusage would count that of the process which started this one, too.
_IMPORT = """
import re, sys
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.options import ArxmlImportOptions
imported = FORMAT.read([sys.argv[1]], ArxmlImportOptions())
peak = re.search(r"VmHWM:\\s*(\\d+) kB", open("/proc/self/status").read())[1]
print(len(imported.model.tasks), peak)
"""


def extract(tmp_path, components):
    """A chain of components with four runnables each, every one with data from the one before."""
    types = [
        component(
            f"C{index}",
            *(every(f"0.0{1 + number % 2}", f"E{number}", f"C{index}/R{number}") for number in range(4)),
            runnables=[runnable(f"R{n}", writes=[f"C{index}/out"], reads=[f"C{index}/in"]) for n in range(4)],
            ports=[out_port("out"), in_port("in")],
        )
        for index in range(components)
    ]
    links = [
        assembly(f"k{index}", f"Root/c{index} C{index}/out", f"Root/c{index + 1} C{index + 1}/in")
        for index in range(components - 1)
    ]
    uses = " ".join(f"c{index}:C{index}" for index in range(components))
    return write(tmp_path, package("T", *types, composition("Root", uses, *links)))


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no /proc")
def test_a_20_megabyte_extract_is_read_within_500_megabytes(tmp_path):
    path = extract(tmp_path, 5_500)
    assert path.stat().st_size > 20 * 2**20
    done = subprocess.run([sys.executable, "-c", _IMPORT, str(path)], capture_output=True, text=True, check=True)
    tasks, kilobytes = done.stdout.split()
    assert int(kilobytes) < 500 * 2**10
    assert int(tasks) == 22_000


@pytest.mark.slow
def test_the_time_of_an_import_grows_with_the_extract_and_not_with_its_square(tmp_path):
    def prepare(components):
        folder = tmp_path / str(components)
        folder.mkdir()
        path = extract(folder, components)
        return lambda: FORMAT.read([str(path)], ArxmlImportOptions())

    assert growth(prepare, 100, 2_000) < half_way(20)
