"""Requirements with the tests about each and their results: every rule of verify and every check of validate.

A test is about a requirement if it names one of its codes, itself or by what it uses of its file.
"""

from __future__ import annotations

import ast
import re
from collections import Counter, defaultdict
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from halpipe.core.diagnostics import REGISTER, HalpipeError, Location, error
from halpipe.core.files import parse_xml, read_bytes, sha256
from halpipe.core.records import record

if TYPE_CHECKING:
    from collections.abc import Callable, Container, Iterator, Mapping, Sequence

PACKAGE = Path(__file__).parents[1]
ROOT = PACKAGE.parents[1]
TESTS = ROOT / "tests"
VERDICTS = ("failed", "passed", "skipped")
_CODE = re.compile(r"HAL\d{4}")

NO_RESULTS = error(
    "HAL0013",
    "File has no results of tests",
    "`--results` reads the JUnit XML of a run of the tests: `pytest --junitxml FILE`, with cases of the tests that "
    "this version has.",
)


@record
class Results:
    """Counts of the cases of each test by verdict and by the code in the name of the case, if it has one.

    `files` are the runs, each with its SHA-256 and its counts of all tests.
    """

    by_test: Mapping[str, Counter[tuple[str, str]]]
    files: Sequence[Mapping[str, Any]] = ()

    def counts(self, test: str, codes: Sequence[str]) -> dict[str, int]:
        """Return the counts by verdict, without cases about other codes."""
        found: Counter[str] = Counter()
        for (verdict, code), count in self.by_test.get(test, {}).items():
            found[verdict] += count if code in ("", *codes) else 0
        return {verdict: found[verdict] for verdict in VERDICTS if found[verdict]}


NO_RUN = Results({})


def read_results(paths: Sequence[str]) -> Results:
    """Read the JUnit XML of runs of the tests; a test of several cases counts each."""
    known = {_dotted(test): test for tests in _tests().values() for test in tests}
    by_test: dict[str, Counter[tuple[str, str]]] = defaultdict(Counter)
    files = []
    for path in paths:
        data = read_bytes(path)
        counts = Counter(dict.fromkeys(VERDICTS, 0))
        found = set()
        for case in parse_xml(data, path).iter("testcase"):
            marks = {child.tag for child in case}
            verdict = "failed" if marks & {"failure", "error"} else "skipped" if "skipped" in marks else "passed"
            counts[verdict] += 1
            name, _, parameters = case.get("name", "").partition("[")
            test = known.get(f"{case.get('classname')}.{name}")
            if test:
                found.add(test)
                by_test[test][verdict, next(iter(_CODE.findall(parameters)), "")] += 1
        if not found:
            help = "give the file that `pytest --junitxml FILE` of this checkout wrote"
            message = f"{counts.total()} cases, none of a test about a requirement"
            raise HalpipeError(NO_RESULTS(message, at=Location(path), help=help))
        files.append({"sha256": sha256(data), **counts})
    return Results(by_test, files)


def _dotted(test: str) -> str:
    """Return the name of a test as JUnit XML states it."""
    path, _, name = test.partition("::")
    return f"{path.removesuffix('.py').replace('/', '.')}.{name.replace('::', '.')}"


def requirements(results: Results) -> list[dict[str, Any]]:
    """Return every rule and check with its sentence, its tests and their results."""
    naming = _tests()
    found = []
    for id, text, module, codes in _stated():
        tests = sorted({test for code in codes for test in naming.get(code, ())})
        counts = {test: results.counts(test, codes) for test in tests}
        runs = [{"test": test, "result": _verdict(count), **count} for test, count in counts.items()]
        result = _verdict({verdict for count in counts.values() for verdict in count})
        found.append({"id": id, "text": text, "check": module, "codes": codes, "result": result, "tests": runs})
    return found


def _verdict(found: Container[str]) -> str:
    """Return the verdict on cases as a whole: one failure decides."""
    return next((verdict for verdict in VERDICTS if verdict in found), "not run")


def _stated() -> Iterator[tuple[str, str, str, list[str]]]:
    from halpipe.pipeline.validate import CHECKS
    from halpipe.pipeline.verify import RULES

    for rule in RULES:
        yield f"verify/{rule.name}", rule.sentence, str(rule.check.__module__), _codes_of(rule.check)
    for check in CHECKS:
        yield f"validate/{check.name}", check.sentence, str(check.run.__module__), [code.id for code in check.codes]


def _codes_of(check: Callable[..., object]) -> list[str]:
    """Return the codes that a rule of verify reports: the constants that its function reaches in its module."""
    from halpipe.pipeline.verify import codes

    source = PACKAGE.joinpath(*check.__module__.split(".")[1:]).with_suffix(".py").read_text(encoding="utf-8")
    words = _closures(source)[check.__name__]
    return sorted(code.id for name, code in vars(codes).items() if name in words and hasattr(code, "id"))


def _tests() -> dict[str, list[str]]:
    """Return the functions that test each code; none where the tests are not installed."""
    from halpipe.pipeline.validate import codes as validate
    from halpipe.pipeline.verify import codes as verify

    ids = {word: code.id for module in (validate, verify) for word, code in vars(module).items() if hasattr(code, "id")}
    fixtures = {
        folder.name: set(_CODE.findall(" ".join(path.name for path in folder.iterdir())))
        for folder in TESTS.glob("fixtures/*")
    }
    naming: dict[str, list[str]] = defaultdict(list)
    for path in sorted(TESTS.rglob("test_*.py")):
        functions = _closures(path.read_text(encoding="utf-8"))
        for name, words in functions.items():
            if not name.rpartition("::")[2].startswith("test_"):
                continue
            codes = {ids.get(word, word) for word in words} & REGISTER.keys()
            if "fixtures" in words:
                codes |= {code for folder in fixtures if f'"{folder}"' in words for code in fixtures[folder]}
            for code in codes:
                naming[code].append(f"{path.relative_to(TESTS.parent).as_posix()}::{name}")
    return naming


@cache
def _closures(source: str) -> dict[str, set[str]]:
    """Return the functions of a file, methods too, with the words in each and in what it uses of the file."""
    lines, own = source.splitlines(), {}
    functions = {}
    for node in ast.parse(source).body:
        names = {part.id for part in ast.walk(node) if isinstance(part, ast.Name) and isinstance(part.ctx, ast.Store)}
        words = _words(node, lines)
        if isinstance(node, ast.FunctionDef):
            names, functions[node.name] = {node.name}, words
        elif isinstance(node, ast.ClassDef):
            names = {node.name}
            methods = (part for part in node.body if isinstance(part, ast.FunctionDef))
            functions |= {f"{node.name}::{part.name}": _words(part, lines) for part in methods}
        own.update(dict.fromkeys(names, words))
    return {name: _reached(words, own) for name, words in functions.items()}


def _reached(words: set[str], own: dict[str, set[str]]) -> set[str]:
    reached: set[str] = set()
    waiting = set(words)
    while waiting:
        reached |= waiting
        waiting = {more for word in waiting for more in own.get(word, ())} - reached
    return reached


def _words(node: ast.stmt, lines: list[str]) -> set[str]:
    """Return the words in the text of a statement, and its strings of one word in quotes."""
    first = min([node.lineno, *(part.lineno for part in getattr(node, "decorator_list", ()))])
    text = "\n".join(lines[first - 1 : node.end_lineno])
    return {*re.findall(r"\w+", text), *re.findall(r'"\w+"', text)}
