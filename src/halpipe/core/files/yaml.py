"""Hostile YAML and JSON: read without objects, with depth and the expansion of aliases bounded."""

from __future__ import annotations

import json
from collections import Counter
from functools import cache
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import HalpipeError, Location, error

if TYPE_CHECKING:
    from collections.abc import Mapping

MAX_YAML_NODES = 500_000
MAX_YAML_DEPTH = 64

BROKEN_YAML = error(
    "HAL0020",
    "YAML is malformed",
    f"The file is not YAML, repeats a key, nests deeper than {MAX_YAML_DEPTH} levels, or has more than "
    f"{MAX_YAML_NODES} values once its aliases are expanded.",
)


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


class Number(str):
    """Digits of a number in JSON, where a text of digits is another value."""

    __slots__ = ()


def parse_json(data: bytes) -> Any:
    """Parse JSON into the values of `parse_yaml`, which have no lines here; raise ``ValueError`` if it is none."""
    return _listed(load_json(data, Number, parse_int=Number, parse_constant=Number, object_pairs_hook=_mapped))


def load_json(data: bytes | str, parse_float: Any = None, **hooks: Any) -> Any:
    """Return JSON as values of Python; raise ``ValueError`` if it is none, or repeats a key."""
    try:
        return json.loads(data, parse_float=parse_float, **{"object_pairs_hook": _unique, **hooks})
    except (ValueError, RecursionError) as failure:
        raise ValueError(f"is no JSON: {failure}") from None


def json_decoder(parse_float: Any) -> json.JSONDecoder:
    """Return a decoder for JSON that is read in parts; it raises ``ValueError`` for repeated keys."""
    return json.JSONDecoder(parse_float=parse_float, object_pairs_hook=_unique)


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the mapping of some pairs, of which JSON itself would keep the last one of a key."""
    mapping = dict(pairs)
    if len(mapping) < len(pairs):
        keys = Counter(key for key, _ in pairs)
        raise ValueError(f'the key "{keys.most_common()[0][0][:80]}" is repeated')
    return mapping


def is_shaped(value: object, shape: Mapping[str, type]) -> bool:
    """Return whether a value of JSON is a mapping with these keys and no others, each with a value of its type."""
    return isinstance(value, dict) and {key: type(inner) for key, inner in value.items()} == shape


def _mapped(pairs: list[tuple[str, Any]]) -> YamlMap:
    mapping = YamlMap(0)
    mapping.update((key, _listed(value)) for key, value in _unique(pairs).items())
    return mapping


def _listed(value: Any) -> Any:
    if not isinstance(value, list):
        return value
    items = YamlList(0)
    items.extend(map(_listed, value))
    items.lines = [0] * len(items)
    return items


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
        _refuse_tabs(data, name)
        if data.lstrip().startswith(b"<"):
            raise _broken_yaml(name, 1, "is XML, where YAML is expected") from None
        raise _broken_yaml(name, line, text or "malformed") from None
    except yaml.reader.ReaderError as failure:
        line = data.count(b"\n", 0, failure.position) + 1
        raise _broken_yaml(name, line, f"is not text: {failure.reason}") from None
    except (yaml.YAMLError, ValueError, OverflowError) as failure:
        raise _broken_yaml(name, 0, " ".join(str(failure).split())) from None
    return None if node is None else _YamlBuilder(name).build(node, 0)


def _refuse_tabs(data: bytes, name: str) -> None:
    """Blame a tab at the beginning of a line, which parsers report as one character among many."""
    for number, line in enumerate(data.splitlines(), 1):
        if b"\t" in line[: len(line) - len(line.lstrip())]:
            text, help = "a tab indents the line; YAML has spaces only", "indent the line with spaces"
            raise HalpipeError(BROKEN_YAML(text, at=Location(name, number), help=help))


_ADVICE = (
    ("nests", "repair the file"),
    ("control characters", "remove them; a workbook is imported by `halpipe import table FILE -o model.xml`"),
    ("is not text", "save it as UTF-8"),
    ("alias", 'quote names that begin with *, as in "*core": without quotes, * refers to a part of the file'),
    ("is XML", "name a YAML file; a model is read by `halpipe validate`, `halpipe schedule` and others"),
    ("expected ',' or", "close the bracket, or put a comma between its entries"),
    ("expected key", "begin the keys of one level in the same column"),
    ("mapping values", 'put one "key: value" in a line, and quote texts that contain ": "'),
    ("repeats the key", "remove one of the two"),
)
"""Advice by a part of the message; parsers name what they expect, not what to write."""


def _broken_yaml(name: str, line: int, text: str) -> HalpipeError:
    help = next((advice for sign, advice in _ADVICE if sign in text), "repair the file")
    return HalpipeError(BROKEN_YAML(text, at=Location(name, line), help=help))


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
