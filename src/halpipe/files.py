"""Everything that touches the file system: hostile input in, atomic output out.

Input is read within size limits; XML is parsed without DTD, entities or network, and YAML without objects,
with aliases bounded. Output goes to a temporary file beside its target, is synced, and then renamed over it,
so that a failed or killed run leaves the old file whole.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import secrets
import shutil
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.diagnostics import Diagnostic, HalpipeError, Location, error

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping

    from lxml import etree

STDIO = "-"
MAX_INPUT_BYTES = 256 * 2**20
MAX_YAML_NODES = 2_000_000
MAX_YAML_DEPTH = 64
MAX_SYNTAX_ERRORS = 20

CANNOT_READ = error(
    "HAL0001",
    "File cannot be read",
    "The file does not exist, is a directory, or the system refuses to read it.",
)
TOO_LARGE = error(
    "HAL0002",
    "File is too large",
    f"Input files may have up to {MAX_INPUT_BYTES // 2**20} MiB. Split the file, or import only the parts needed.",
)
CANNOT_WRITE = error(
    "HAL0003",
    "File cannot be written",
    "The system refused to write the output; whatever stood there before is untouched.",
)
FOREIGN_FOLDER = error(
    "HAL0004",
    "Folder is not halpipe's to replace",
    "A folder is written as a whole and replaces the one before. One that has files, but no manifest of halpipe's, "
    "is left alone, so that a mistyped name costs nobody their work.",
)
BROKEN_XML = error(
    "HAL0010",
    "XML is not well-formed",
    "The file is not XML, or ends too early, or nests deeper than 256 elements.",
)
HAS_DOCTYPE = error(
    "HAL0011",
    "XML has a DOCTYPE",
    "Document type declarations can read other files and expand without bound, and no format that halpipe "
    "reads needs one. Files with a DOCTYPE are refused.",
)
BROKEN_YAML = error(
    "HAL0020",
    "YAML is malformed",
    f"The file is not YAML, repeats a key, nests deeper than {MAX_YAML_DEPTH} levels, or has more than "
    f"{MAX_YAML_NODES} values once its aliases are expanded.",
)


# ------------------------------------------------------------------------------------------------ reading


def read_bytes(path: str | os.PathLike[str]) -> bytes:
    """Read a whole input file (``-`` is standard input), refusing what is too large or unreadable."""
    name = os.fspath(path)
    try:
        if name == STDIO:
            data: bytes = _standard(sys.stdin).read(MAX_INPUT_BYTES + 1)
        else:
            with open(name, "rb") as stream:
                data = stream.read(MAX_INPUT_BYTES + 1)
    except (OSError, ValueError) as failure:
        help = "name a file that exists and that you may read"
        raise HalpipeError(CANNOT_READ(_reason(failure), at=Location(name), help=help)) from None
    if len(data) > MAX_INPUT_BYTES:
        raise HalpipeError(
            TOO_LARGE(f"has more than {MAX_INPUT_BYTES // 2**20} MiB", at=Location(name), help="split the file")
        )
    return data


def _standard(stream: Any) -> Any:
    """Return the bytes side of a standard stream; Python has None for one that the shell closed."""
    if stream is None:
        raise OSError(errno.EBADF, os.strerror(errno.EBADF))
    return stream.buffer


def sha256(data: bytes) -> str:
    """Return the SHA-256 of `data` in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def parse_xml(data: bytes, name: str) -> etree._Element:
    """Parse hostile XML and return its root; raise `HalpipeError` with every syntax error and its line."""
    from lxml import etree

    _refuse_doctype(data, name)
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, dtd_validation=False, huge_tree=False
    )
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as failure:
        raise HalpipeError(*_syntax_errors(parser, failure, name)) from None
    docinfo: Any = root.getroottree().docinfo
    if docinfo.doctype:  # in an encoding that hid it from the look at the bytes
        raise _doctype(name, 1)
    return root


_PROLOG = re.compile(rb"(?:\xef\xbb\xbf)?(?:\s++|<\?.*?\?>|<!--.*?-->)*+", re.DOTALL)


def _refuse_doctype(data: bytes, name: str) -> None:
    """Refuse a DOCTYPE before any parser works on what it declares."""
    prolog = _PROLOG.match(data)
    end = prolog.end() if prolog else 0
    if data.startswith(b"<!DOCTYPE", end):
        raise _doctype(name, data.count(b"\n", 0, end) + 1)


def _doctype(name: str, line: int) -> HalpipeError:
    help = "remove the <!DOCTYPE ...> declaration"
    return HalpipeError(HAS_DOCTYPE("declares a DOCTYPE", at=Location(name, line), help=help))


_ADVICE_TO_PROGRAMMERS = re.compile(r",? (?:use|try|see) xml\w+(?: option)?\.?$", re.IGNORECASE)


def _syntax_errors(parser: Any, failure: Exception, name: str) -> list[Diagnostic]:
    entries = [(entry.line, entry.message) for entry in parser.error_log if entry.level_name in ("ERROR", "FATAL")]
    unique = list(dict.fromkeys(entries))[:MAX_SYNTAX_ERRORS] or [(getattr(failure, "lineno", 0) or 0, str(failure))]
    return [
        BROKEN_XML(_ADVICE_TO_PROGRAMMERS.sub("", message.strip()), at=Location(name, line), help="repair the file")
        for line, message in unique
    ]


class YamlMap(dict[str, Any]):
    """A YAML mapping with the line it starts on and the line of every key."""

    def __init__(self, line: int) -> None:
        super().__init__()
        self.line = line
        self.lines: dict[str, int] = {}

    def line_of(self, key: str) -> int:
        """Return the line of `key`, or of the mapping when the key is absent."""
        return self.lines.get(key, self.line)


class YamlList(list[Any]):
    """A YAML sequence with the line it starts on and the line of every item."""

    def __init__(self, line: int) -> None:
        super().__init__()
        self.line = line
        self.lines: list[int] = []


def parse_yaml(data: bytes, name: str) -> Any:
    """Parse YAML into `YamlMap`, `YamlList`, ``bool``, ``None`` and text.

    Numbers stay text, exactly as written, because the readers need exact values: ``0.35`` must not become a
    binary float on its way. Raise `HalpipeError` with the line of what is wrong.
    """
    import yaml

    try:
        node = yaml.compose(data, Loader=_bounded_loader())
    except yaml.MarkedYAMLError as failure:
        mark = failure.problem_mark or failure.context_mark
        line = mark.line + 1 if mark else 0
        text = " ".join(part for part in (failure.context, failure.problem) if part)
        raise _broken_yaml(name, line, text or "malformed") from None
    except yaml.reader.ReaderError as failure:
        line = data.count(b"\n", 0, failure.position) + 1
        raise _broken_yaml(name, line, f"is not text: {failure.reason}") from None
    except (yaml.YAMLError, ValueError) as failure:
        raise _broken_yaml(name, 0, " ".join(str(failure).split())) from None
    return None if node is None else _YamlBuilder(name).build(node, 0)


def _broken_yaml(name: str, line: int, text: str) -> HalpipeError:
    return HalpipeError(BROKEN_YAML(text, at=Location(name, line), help="repair the file"))


@cache
def _bounded_loader() -> Any:
    """Return a loader that stops at the bounds while it composes: libyaml's own recursion has none and crashes."""
    import yaml

    base: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)

    class Bounded(base):  # type: ignore[misc]
        depth = nodes = 0

        def descend_resolver(self, parent: Any, index: Any) -> None:
            self.depth += 1
            self.nodes += 1
            if self.depth > MAX_YAML_DEPTH + 1 or self.nodes > MAX_YAML_NODES:
                raise yaml.MarkedYAMLError(problem=_UNBOUNDED, problem_mark=parent and parent.start_mark)
            super().descend_resolver(parent, index)

        def ascend_resolver(self) -> None:
            self.depth -= 1
            super().ascend_resolver()

    return Bounded


_UNBOUNDED = "nests too deep or has too many values"


class _YamlBuilder:
    """Turns composed YAML nodes into values with lines, within bounds on depth and on alias expansion."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._count = 0

    def build(self, node: Any, depth: int) -> Any:
        line = node.start_mark.line + 1
        self._count += 1
        if depth > MAX_YAML_DEPTH or self._count > MAX_YAML_NODES:
            raise _broken_yaml(self._name, line, _UNBOUNDED)
        kind = node.id
        if kind == "scalar":
            return self._scalar(node)
        if kind == "sequence":
            items = YamlList(line)
            for child in node.value:
                items.append(self.build(child, depth + 1))
                items.lines.append(child.start_mark.line + 1)
            return items
        return self._mapping(node, line, depth)

    def _mapping(self, node: Any, line: int, depth: int) -> YamlMap:
        mapping = YamlMap(line)
        for key_node, value_node in node.value:
            key_line = key_node.start_mark.line + 1
            if key_node.id != "scalar":
                raise _broken_yaml(self._name, key_line, "has a key that is not plain text")
            key = key_node.value
            if key in mapping:
                raise _broken_yaml(self._name, key_line, f'repeats the key "{key}"')
            mapping[key] = self.build(value_node, depth + 1)
            mapping.lines[key] = key_line
        return mapping

    def _scalar(self, node: Any) -> Any:
        if node.tag == "tag:yaml.org,2002:null":
            return None
        if node.tag == "tag:yaml.org,2002:bool":
            return node.value.lower() in ("true", "yes", "on", "y")
        return node.value


@dataclass(slots=True)
class SourceLines:
    """Gives the text of a line of an input file, for messages; empty where it cannot be had."""

    _cache: dict[str, list[bytes]]

    def __init__(self) -> None:
        self._cache = {}

    def __call__(self, at: Location) -> str:
        """Return the line that `at` points to, without its indentation and at most 160 characters of it."""
        if not at.line or at.file in ("", STDIO):
            return ""
        if at.file not in self._cache:
            try:
                self._cache[at.file] = read_bytes(at.file).splitlines()
            except HalpipeError:
                self._cache[at.file] = []
        lines = self._cache[at.file]
        if at.line > len(lines):
            return ""
        return lines[at.line - 1].decode("utf-8", "replace").strip()[:160]


def find_inputs(paths: Iterable[str], suffixes: tuple[str, ...]) -> Iterator[str]:
    """Yield files as given, and for every directory its files with one of `suffixes`, recursively, in name order."""
    for path in paths:
        if path != STDIO and os.path.isdir(path):
            found = (p for p in Path(path).rglob("*") if p.suffix.lower() in suffixes and p.is_file())
            yield from sorted(str(p) for p in found)
        else:
            yield path


# ------------------------------------------------------------------------------------------------ writing


def write_output(path: str | os.PathLike[str], data: bytes | str) -> None:
    """Write one output atomically, or to standard output for ``-``."""
    name = os.fspath(path)
    content = data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data
    if name != STDIO:
        write_outputs({name: content})
        return
    try:
        stream = _standard(sys.stdout)
        stream.write(content)
        stream.flush()
    except BrokenPipeError:  # whoever read it has enough; the command line ends quietly
        raise
    except OSError as failure:
        raise _cannot_write(STDIO, failure) from None


def write_outputs(contents: Mapping[str, bytes]) -> None:
    """Write several files so that, up to the renames at the end, either none of them changes or all are ready."""
    staged: list[tuple[str, str]] = []
    target = ""
    try:
        for target, content in contents.items():
            if target.startswith("/dev/") or (os.path.exists(target) and not os.path.isfile(target)):
                _write_through(target, content)
            else:
                staged.append(_stage(os.path.realpath(target), content))
        while staged:
            temporary, target = staged[0]
            os.replace(temporary, target)
            staged.pop(0)
            _sync_directory(os.path.dirname(target))
    except (OSError, ValueError) as failure:
        raise _cannot_write(target, failure) from None
    finally:
        for temporary, _ in staged:
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def write_directory(path: str, contents: Mapping[str, bytes]) -> None:
    """Write a folder as a whole: readers see the old one or the new one, never a mixture.

    `contents` has names relative to the folder, with ``/``; one of them is the `MANIFEST`, by which a folder that
    may be replaced is known. Between two renames there is an instant without any; the next writer mends that.
    """
    target = os.path.realpath(path)
    parent, base = os.path.split(target)
    former = os.path.join(parent, f"{_prefix(base)}former")
    try:
        os.makedirs(parent, exist_ok=True)
        if os.path.isdir(former) and not os.path.exists(target):
            os.rename(former, target)
        _refuse_foreign(target, path)
        staged = _stage_directory(target, contents)
        try:
            _exchange(staged, target, former)
        finally:
            shutil.rmtree(staged, ignore_errors=True)
        _sync_directory(parent)
    except (OSError, ValueError) as failure:
        raise _cannot_write(path, failure) from None


MANIFEST = "manifest.json"


def _exchange(staged: str, target: str, former: str) -> None:
    """Put the folder `staged` where `target` is; where that fails, `target` is what it was."""
    shutil.rmtree(former, ignore_errors=True)
    if not os.path.isdir(target):
        os.rename(staged, target)
        return
    os.rename(target, former)
    try:
        os.rename(staged, target)
    except OSError:
        os.rename(former, target)
        raise
    shutil.rmtree(former, ignore_errors=True)


def _refuse_foreign(target: str, path: str) -> None:
    """Stop if `target` is something else than a folder of halpipe's or an empty one."""
    if not os.path.lexists(target):
        return
    if os.path.isdir(target) and (not os.listdir(target) or os.path.isfile(os.path.join(target, MANIFEST))):
        return
    what = f"is a folder without {MANIFEST}" if os.path.isdir(target) else "is no folder"
    help = "name a new folder, or remove this one yourself"
    raise HalpipeError(FOREIGN_FOLDER(f"{what}; it is not replaced", at=Location(path), help=help))


def _stage_directory(target: str, contents: Mapping[str, bytes]) -> str:
    """Write `contents` into a synced temporary folder beside `target` and return its name."""
    parent, base = os.path.split(target)
    _sweep(parent, base)
    staged = os.path.join(parent, f"{_prefix(base)}{os.getpid()}-{secrets.token_hex(4)}{_SUFFIX}")
    try:
        os.mkdir(staged)
        for name, content in contents.items():
            inside = os.path.join(staged, *name.split("/"))
            os.makedirs(os.path.dirname(inside), exist_ok=True)
            with open(inside, "xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
    except BaseException:
        shutil.rmtree(staged, ignore_errors=True)
        raise
    return staged


def _cannot_write(target: str, failure: Exception) -> HalpipeError:
    help = "choose a place that exists, has room and that you may write to"
    return HalpipeError(CANNOT_WRITE(_reason(failure), at=Location(target), help=help))


def _write_through(target: str, content: bytes) -> None:
    """Write to a device or pipe, which cannot be renamed over."""
    with open(target, "wb") as stream:
        stream.write(content)


def _stage(target: str, content: bytes) -> tuple[str, str]:
    """Write `content` to a synced temporary file beside `target` and return both names."""
    directory, base = os.path.split(target)
    os.makedirs(directory, exist_ok=True)
    _sweep(directory, base)
    temporary = os.path.join(directory, f"{_prefix(base)}{os.getpid()}-{secrets.token_hex(4)}{_SUFFIX}")
    mode = os.stat(target).st_mode & 0o777 if os.path.exists(target) else None
    descriptor = os.open(temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666)
    try:
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            stream.flush()
            if mode is not None:
                os.fchmod(stream.fileno(), mode)
            os.fsync(stream.fileno())
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise
    return temporary, target


def _sweep(directory: str, base: str) -> None:
    """Remove temporary files that a killed run left for the same target."""
    prefix = _prefix(base)
    for entry in os.listdir(directory):
        if entry.startswith(prefix) and entry.endswith(_SUFFIX):
            owner = entry[len(prefix) : -len(_SUFFIX)].partition("-")[0]
            if owner.isdecimal() and not _is_alive(int(owner)):
                left = os.path.join(directory, entry)
                if os.path.isdir(left):
                    shutil.rmtree(left, ignore_errors=True)
                    continue
                with contextlib.suppress(OSError):
                    os.unlink(left)


_SUFFIX = ".halpipe-tmp"


def _prefix(base: str) -> str:
    """Return how the temporary files of a target begin; 50 characters are at most 200 of a name's 255 bytes."""
    return f".{base[:50]}."


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _sync_directory(directory: str) -> None:
    with contextlib.suppress(OSError):
        descriptor = os.open(directory or ".", os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _reason(failure: Exception) -> str:
    return (failure.strerror if isinstance(failure, OSError) else None) or str(failure)


def remove_output(path: str) -> None:
    """Remove a file that is no longer of use, if it is there and the system lets us."""
    with contextlib.suppress(OSError):
        os.unlink(path)
