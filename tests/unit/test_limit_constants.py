"""Limit constants on both sides: what has as many as the limit passes, and one more is refused with the limit."""

import json
import re
from collections import Counter
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
from lxml import etree

import halpipe
from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.core.files import YamlMap, parse_xml, parse_yaml
from halpipe.core.quantities import parse_rational, quoted, whole
from halpipe.core.settings import BAD_VALUE, Fields
from halpipe.core.suggest import bounded_suggestions, nearest

TESTS = Path(__file__).parents[1]
LIMITS = {}


def limit(name, value, says="", *, step=1):
    """Register a trial of the constant `name`, which has this `value`; beyond it, the refusal contains `says`.

    Without words of its own the refusal states the limit.
    """

    def register(trial):
        LIMITS[name] = (value, value + step, says or str(value), trial)
        return trial

    return register


def refusal(trial, number):
    """Return how a trial with this number is refused, nothing where it passes."""
    try:
        return str(trial(number) or "")
    except HalpipeError as refused:
        return " ".join(f"{found.message}; {found.help}" for found in refused.diagnostics)
    except ValueError as refused:
        return str(refused) or type(refused).__name__


def named(path):
    module, _, name = path.partition(":")
    return getattr(import_module(f"halpipe.{module}"), name)


# ------------------------------------------------------------------------------------------------ core


@limit("core.quantities:_MAX_LENGTH", 1000)
def digits_of_a_number(count):
    parse_rational("1" * count)


@limit("core.quantities:_DIGITS", 20, "is too large")
def digits_of_a_whole_number(count):
    whole(0)("1" * count)


@limit("core.quantities:_SHOWN", 80, "...")
def shown_characters_of_a_value(count):
    return quoted("x" * count) if "..." in quoted("x" * count) else ""


@limit("core.suggest:LONGEST", 200, "none")
def characters_of_a_name_that_is_looked_for(count):
    return "" if nearest("a" * count, ["a" * count]) else "none"


@limit("core.suggest:COMPARISONS", 50_000, "none")
def names_that_one_command_compares(count):
    with bounded_suggestions():
        nearest("a", ["b"] * (count - 1))
        return "" if nearest("a", ["a"]) else "none"


@limit("core.suggest:_MOST_NAMES", 5, "1 more")
def names_in_a_message(count):
    return named("core.suggest:few")([f"n{number}" for number in range(count)]).partition(" and ")[1:][-1]


@limit("core.diagnostics:MOST_CHARACTERS", 2000, "...")
def characters_of_a_message(count):
    return named("core.diagnostics:shortened")("x" * count).strip("x")


@limit("core.settings:MAX_UNKNOWN", 1000, "1 more unknown keys")
def unknown_keys_of_a_mapping(count):
    findings, data = Findings(), YamlMap(1)
    data.update({f"k{number}": "" for number in range(count)})
    Fields("f.yaml", findings, data, "f", ("zz",))
    return " ".join(found.message for found in findings.items[1000:])


@limit("core.files.xml:_MAX_XML_DEPTH", 256)
def elements_within_each_other(count):
    parse_xml(b"<a>" * count + b"</a>" * count, "m.xml")


@limit("core.files.yaml:MAX_YAML_DEPTH", 64, "nests too deep")
def lists_within_each_other(count):
    parse_yaml(b"[" * count + b"x" + b"]" * count, "f.yaml")


@limit("schemas:MAX_ATTRIBUTES", 100, "not asked")
def attributes_of_a_wrong_element(count):
    from halpipe.schemas import TASK_MODEL, _explain, namespace

    attributes = " ".join(f'a{number}=""' for number in range(count))
    root = parse_xml(f'<task-model xmlns="{namespace(TASK_MODEL)}" {attributes}/>'.encode(), "m.xml")
    return "" if _explain(root, TASK_MODEL) else "not asked"


# ------------------------------------------------------------------------------------------------ importers


def formula(text):
    from halpipe.importers.arxml.files.formulas import evaluate

    element = etree.Element("F")
    element.text = text
    return evaluate(element, lambda *_: None)


@limit("importers.amalthea.entities:_MOST_COMBINATIONS", 20_000)
def combinations_of_activations_besides_one(count):
    forest = named("importers.amalthea.xmi:Forest")((), Findings())
    named("importers.amalthea.entities:combined")(forest, SimpleNamespace(at=Location(), path="e"), range(count + 1))


@limit("importers.arxml.files.formulas:_MAX_DEPTH", 40, "nested too deep")
def brackets_of_a_formula(count):
    formula("(" * (count - 1) + "1" + ")" * (count - 1))


@limit("importers.arxml.files.formulas:_MAX_SHIFT", 256, "shifts by 257")
def bits_of_a_shift(count):
    formula(f"1 << {count}")


@limit("importers.arxml.files.words:_MAX_EXPONENT", 40, "none")
def exponent_of_an_arxml_number(count):
    read = named("importers.arxml.files.words:parse_double")
    return "" if read(f"1e{count}") == 10**count and read(f"1e-{count}") == Fraction(1, 10**count) else "none"


@limit("importers.common.names:_MAX_LENGTH", 1000, "cut")
def characters_of_an_amalthea_name(count):
    return "" if len(named("importers.common.names:legal")("a" * count)) == count else "cut"


@limit("importers.amalthea.xmi:_MAX_EXPONENT", 60, "none")
def exponent_of_an_amalthea_number(count):
    read = named("importers.amalthea.xmi:parse_number")
    return "" if read(f"1e{count}") == 10**count and read(f"1e-{count}") == Fraction(1, 10**count) else "none"


@limit("importers.ros.dot:_MAX_DEPTH", 100)
def blocks_within_each_other(count):
    named("importers.ros.dot:read_dot")("digraph {" + "{" * count + "a -> b" + "}" * count + "}", "g.dot", Findings())


@limit("importers.common.pieces:MOST_PIECES", 20_000)
def pieces_of_a_runnable(count):
    assert (
        len(named("importers.common.pieces:cuts")(Duration(1), Duration(0), Duration(count), "t", Location())) < count
    )


@limit("importers.traces.slices:_MAX_EXPONENT", 30, "none")
def exponent_of_an_instant(count):
    return "" if named("importers.traces.slices:instant_of")(f"1e{count}") is not None else "none"


@limit("importers.traces.ctf.metadata:_MOST_BITS", 64, "an integer of 65 bits")
def bits_of_an_integer(count):
    trace_of(f"typealias integer {{ size = {count}; align = 8; }} := n;")


@limit("importers.traces.ctf.metadata:MOST_LEVELS", 40)
def types_within_each_other(count):
    inner = "typealias integer { size = 8; } := n; event { name = e; fields := "
    trace_of(inner + "struct { " * (count - 1) + "n x; " + "} x; " * (count - 2) + "}; };")


@limit("importers.traces.ctf.metadata:MOST_FIELDS", 10_000)
def fields_of_a_type(count):
    inner = "".join(f"n x{number}; " for number in range(100))  # each type counts as one beside its fields
    outer = "".join(f"struct a x{number}; " for number in range(99)) + "n more; " * (count - 10_000)
    texts = f"struct a {{ {inner} }}; event {{ name = e; fields := struct {{ {outer} }}; }};"
    trace_of("typealias integer { size = 8; } := n; " + texts)


def trace_of(text):
    from halpipe.importers.traces.ctf.metadata import CtfError, parse

    try:
        parse("trace { major = 1; minor = 8; byte_order = le; };" + text)
    except CtfError as refused:
        raise ValueError(str(refused)) from None


# ------------------------------------------------------------------------------------------------ targets


@limit("exporters.regulator.windows:MAX_WINDOWS", 2**20)
def windows_of_a_table(count):
    mode = SimpleNamespace(name="m", hyperperiod=Duration(count * 1000), at=Location())
    platform = SimpleNamespace(window=Duration(1000), clock=10**9, cycles_text="1000 cycles")
    found = named("exporters.regulator.windows:check_windows")(SimpleNamespace(modes=[mode], transitions=[]), platform)
    return " ".join(each.message for each in found)


@limit("exporters.regulator.memguard.writer:MOST_PERIOD", 10**6, "no period for MemGuard")
def microseconds_of_a_period(count):
    platform = SimpleNamespace(settings={"memguard": {"period": str(count)}}, at=Location())
    return " ".join(found.message for found in named("exporters.regulator.memguard.writer:_check_period")(platform))


@limit("deploy.regulator.forms:MOST_HEADERS", 256, "no header is left")
def headers_of_a_unit(count):
    tables = [None] * (count - 1)
    lines = named("deploy.regulator.forms:header_lines")(SimpleNamespace(tables=tables))
    return "" if lines > len(tables) else "no header is left"


def written(use, **members):
    """Return what is wrong with the members of a JSON file when they are used."""
    findings = Findings()
    use(Fields.sealed(json.dumps(members).encode(), "f.json", findings, BAD_VALUE, "write it again"))
    return " ".join(found.message for found in findings.items if "lacks" not in found.message)


@limit("core.settings:MAX_NUMBER", 1 << 62)
def number_in_json(value):
    return written(lambda f: f.number("n"), n=value)


@limit("deploy.regulator.reading:MAX_WORD", 2**32 - 1)
def word_of_a_regulator(value):
    return written(lambda f: named("deploy.regulator.reading:_word")(f, "n"), n=value)


@limit("deploy.regulator.reading:MAX_WINDOWS", 2**22)
def windows_of_a_regulator(count):
    return written(lambda f: named("deploy.regulator.reading:_table")(f, [], 1), kind="mode", windows=count, entries={})


@limit("devices:MOST", 10**9 - 1)
def number_of_a_manager(number):
    named("exporters.regulator.platform:_INDEX")(str(number))


@limit("deploy.riscv.target:MAX_UNITS", 64)
def hart_of_a_unit(number):
    return written(named("deploy.riscv.target:_unit"), hart=number, ispm={}, dspm={})


@limit("deploy.riscv.board.block_hook:MAX_REGIONS", 136, "no room")
def memories_of_a_board(count):
    """Main memory, and two of each core: of a target with as many cores as there may be, all have room."""
    assert 1 + 2 * named("deploy.riscv.target:MAX_UNITS") <= 136
    try:
        named("deploy.riscv.board.block_hook:Page")().region[count - 1].base = 1
    except IndexError:
        return "no room"
    return ""


@limit("deploy.riscv.target:MAX_MEMORY", 1 << 31)
def bytes_of_an_area(size):
    return written(named("deploy.riscv.target:_area"), base="0x80000000", size=size)


@limit("deploy.linux.judging:MOST_CYCLES", 10_000_000, "there is no cycle 10000000")
def cycles_of_a_recording(count):
    named("deploy.linux.judging:_execution")(["t", "0", "m", str(count - 1), "0", "1", "u", "", "0", "0"])


@limit("pipeline.generate.parameters:_MOST_JOBS", 1_000_000, "give 1000001 jobs")
def jobs_of_a_generated_set(count):
    periods = (Duration(1000), Duration((count - 1) * 1000))
    named("pipeline.generate.parameters:SetParameters")(periods=periods).check()


@limit("pipeline.validate.structure:MOST", 255, "write numbers from 1 to 255")
def events_of_a_health_rule(count):
    from halpipe.models import HealthRule

    found = []
    for counts in ({"count": count}, {"count": count, "cycles": count}):
        rule = HealthRule(task="a", mode="m", **counts)
        context = SimpleNamespace(model=SimpleNamespace(health=(rule,)))
        found += named("pipeline.validate.structure:check_rules")(context)
    return " ".join(each.help for each in found)


@limit("pipeline.explain.meetings:MAX_STEPS", 4_000, "spent")
def steps_of_a_search_for_meetings(count):
    budget = named("pipeline.explain.meetings:Budget")()
    return "" if all(budget.spend() for _ in range(count)) else "spent"


# ------------------------------------------------------------------------------------------------ the table


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_is_passed_and_refused_at_its_edge(name):
    value, beyond, says, trial = LIMITS[name]
    assert named(name) == value
    assert refusal(trial, value) == ""
    assert says in refusal(trial, beyond)


ELEMENTS = {"task": 100_000, "mode": 500, "interrupt": 200, "access": 20_000}


@pytest.mark.parametrize("held", ELEMENTS)
def test_what_holds_what_is_passed_and_refused_at_its_edge(held):
    rows = {row[1]: row for row in named("importers.native.model:MOST")}
    assert {name: row[2] for name, row in rows.items()} == ELEMENTS
    space = "{urn:halpipe:task-model:1}"
    root = inner = etree.Element(f"{space}task-model")
    for step in rows[held][0].split("/"):
        inner = etree.SubElement(inner, step.replace("t:", space))
    for _ in range(ELEMENTS[held]):
        etree.SubElement(inner, space + held)
    bound = named("importers.native.model:_bound")
    bound(root, "m.xml")
    etree.SubElement(inner, space + held)
    assert f"at most {ELEMENTS[held]}" in refusal(lambda _: bound(root, "m.xml"), 0)


ELSEWHERE = {"exporters.arxml.tables:MOST_EVENTS": "unit/exporters/test_arxml_split.py"}
"""Limits that a test reaches without their names, and where."""


def test_no_limit_is_without_a_test():
    """One whose name other modules have, too, is tried where a table states its module."""
    stated = re.compile(r"^(_?(?:MOST|MAX)_?[A-Z_]*) *(?::[^=\n]*)?=", re.MULTILINE)
    tests = " ".join(path.read_text() for path in TESTS.rglob("*.py"))
    words, tried = set(re.findall(r"\w+", tests)), set(re.findall(r'"([\w.]+:\w+)"', tests))
    source = Path(halpipe.__file__).parent
    found = [(path, name) for path in source.rglob("*.py") for name in stated.findall(path.read_text())]
    count = Counter(name for _, name in found)
    untried = []
    for path, name in found:
        module = path.relative_to(source).with_suffix("").as_posix().replace("/", ".").removesuffix(".__init__")
        if f"{module}:{name}" not in tried and (count[name] > 1 or name not in words):
            untried.append(f"{module}:{name}")
    assert not untried
