"""Rows of spreadsheets: CSV of every dialect, and workbooks of Excel."""

from __future__ import annotations

import csv
import io
import re
import zipfile
from decimal import Decimal
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location, error
from halpipe.core.files import read_bytes
from halpipe.core.records import record
from halpipe.importers.common.inputs import reason

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

NO_TABLE = error(
    "HAL1480",
    "File is no spreadsheet",
    "Tables are CSV files in UTF-8, UTF-16 or Windows-1252, or workbooks of Excel (.xlsx).",
)
NO_READER = error(
    "HAL1481", "Workbooks cannot be read here", "The package openpyxl, which reads workbooks, is not installed."
)

_MERGED = re.compile(rb'<(?:\w+:)?mergeCell [^>]*?ref="([A-Z]{1,3}[0-9]{1,7}:[A-Z]{1,3}[0-9]{1,7})"')

MAX_ROWS = 50_000
MAX_COLUMNS = 200
MAX_UNPACKED = 512 * 2**20
"""Bytes of a workbook when unpacked, so that a small file cannot fill the memory."""


@record
class Sheet:
    """A table as texts: its title, its file, and its rows with their lines."""

    title: str
    file: str
    rows: tuple[tuple[int, tuple[str, ...]], ...]
    has_commas: bool = False  # as decimal signs: programs then write semicolons between cells
    is_hidden: bool = False
    merged: tuple[tuple[int, int, int, int], ...] = ()  # first column and row, and the last ones, from 1


def read_sheets(path: str) -> list[Sheet]:
    """Return the tables of a file: one of a CSV, those of a workbook."""
    data = read_bytes(path)
    if data.startswith(b"PK"):
        return _workbook(data, path)
    if data.startswith(b"\xd0\xcf\x11\xe0"):
        raise HalpipeError(NO_TABLE("is a workbook of Excel before 2007", at=Location(path), help="save it as .xlsx"))
    text = _text(data, path)
    separator = max(",;\t|", key="\n".join(text.splitlines()[:20]).count)
    try:
        reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator)
        rows = ((reader.line_num, tuple(cell.strip() for cell in cells)) for cells in reader)
        return [Sheet(PurePath(path).stem, path, _bounded(rows, path), has_commas=separator == ";")]
    except csv.Error as failure:
        raise HalpipeError(NO_TABLE(str(failure), at=Location(path), help="write plain CSV")) from None


def _text(data: bytes, path: str) -> str:
    is_wide = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    codings = ["utf-16"] if is_wide else ["utf-8-sig", "cp1252"]  # what Excel writes, by its version and language
    for coding in codings:
        try:
            text = data.decode(coding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    help = "save it as CSV (UTF-8), or as .xlsx"
    raise HalpipeError(NO_TABLE("is no text", at=Location(path), help=help))


def _bounded(rows: Iterable[tuple[int, tuple[str, ...]]], path: str) -> tuple[tuple[int, tuple[str, ...]], ...]:
    """Return the rows that are not empty, up to a number that takes no more than seconds."""
    found = []
    for line, cells in rows:
        if any(cells):
            found.append((line, cells))
        if len(found) > MAX_ROWS or len(cells) > MAX_COLUMNS:
            help = "name a table of tasks"
            message = f"has more than {MAX_ROWS} rows or {MAX_COLUMNS} columns"
            raise HalpipeError(NO_TABLE(message, at=Location(path, line), help=help))
    return tuple(found)


def _workbook(data: bytes, path: str) -> list[Sheet]:
    try:
        from openpyxl import load_workbook
        from openpyxl.utils import range_boundaries
    except ImportError:
        help = "pip install openpyxl, or save the sheets as CSV"
        raise HalpipeError(NO_READER("openpyxl is not installed", at=Location(path), help=help)) from None
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as package:
            _refuse_bombs(package, path)
            merged, has_formulas = {}, False
            for name in (name for name in package.namelist() if "/worksheets/sheet" in name):
                page = package.read(name)
                has_formulas |= b"<f" in page
                merged[name] = tuple(range_boundaries(found.decode()) for found in _MERGED.findall(page))
        books = [load_workbook(io.BytesIO(data), read_only=True, data_only=True)]
        if has_formulas:  # they have values only where the last program that saved them computed any
            books.append(load_workbook(io.BytesIO(data), read_only=True))
        sheets = zip(*(book.worksheets for book in books), strict=True)
        return [_sheet(parts, path, merged) for parts in sheets]
    except HalpipeError:
        raise
    except Exception as failure:  # noqa: BLE001  whatever the library makes of a broken file
        message = f"is no workbook: {reason(failure)}"
        raise HalpipeError(NO_TABLE(message, at=Location(path), help="save it anew as .xlsx")) from None


def _sheet(parts: Sequence[Any], path: str, merged: Mapping[str, tuple[tuple[int, int, int, int], ...]]) -> Sheet:
    first, rows = parts[0], _bounded(_cells(parts, path), path)
    ranges = merged.get(first._worksheet_path.lstrip("/"), ())  # noqa: SLF001  the library keeps no others
    return Sheet(first.title, path, rows, is_hidden=first.sheet_state != "visible", merged=ranges)


def _refuse_bombs(package: zipfile.ZipFile, path: str) -> None:
    """Refuse a workbook that is far larger than its file, or that declares entities."""
    size = sum(member.file_size for member in package.infolist())
    for member in package.infolist():
        if size > MAX_UNPACKED or (
            member.filename.endswith(".xml") and b"<!DOCTYPE" in package.open(member).read(4096)
        ):
            message = "has a document type" if size <= MAX_UNPACKED else f"has {size} bytes when unpacked"
            raise HalpipeError(NO_TABLE(message, at=Location(path), help="save it anew as .xlsx"))


def _cells(sheets: Sequence[Any], path: str) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Yield the rows of a sheet; of one with formulas, `sheets` are its values and its formulas."""
    rows = zip(*(sheet.iter_rows(values_only=True) for sheet in sheets), strict=True)
    for line, (values, *formulas) in enumerate(rows, start=1):
        for value, formula in zip(values, *formulas, strict=True) if formulas else ():
            if value is None and formula is not None:
                help = "open and save it with a spreadsheet program, which computes the value"
                message = f'sheet "{sheets[0].title}": formula {str(formula)[:40]} has no value'
                raise HalpipeError(NO_TABLE(message, at=Location(path, line), help=help))
        yield line, tuple(map(_shown, values))


def _shown(value: object) -> str:
    """Return a cell as text; a number exactly as its shortest decimal form, which is what a person typed."""
    if value is None:
        return ""
    if isinstance(value, float):
        text = format(Decimal(repr(value)), "f")
        return text.rstrip("0").rstrip(".") if "." in text else text
    return str(value).strip()
