"""Reasons of damaged files: texts of readers and libraries are kept, those of Python's own exceptions are not."""

import struct
import zipfile
import zlib

import pytest

from halpipe.importers.common.inputs import reason


@pytest.mark.parametrize("failure", [ValueError("row 3 has no end"), zipfile.BadZipFile("row 3 has no end\nmore")])
def test_the_first_line_of_a_reader_or_library_is_kept(failure):
    assert reason(failure) == "row 3 has no end"


@pytest.mark.parametrize(
    ("raised", "given"),
    [
        (len, 5),
        (bytes.decode, b"\xff"),
        (bytes.decode, 5),
        ([].__getitem__, 3),
        ({}.__getitem__, "x"),
        (struct.Struct("<Q").unpack, b""),
        (zlib.decompress, b"x"),
        (struct.Struct("<Q").pack, -1),
        (int.to_bytes, 1 << 9),
        ((1).__lshift__, 1 << 99),
    ],
)
def test_words_of_python_are_replaced(raised, given):
    with pytest.raises(Exception) as failure:  # noqa: PT011 whatever Python raises
        raised(given)
    said = reason(failure.value)
    assert said
    assert str(failure.value) not in said
