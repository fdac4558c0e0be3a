"""The schemas themselves: both validators agree on values at the edges, and lines are exact."""

from functools import cache
from random import Random

import pytest
import xmlschema
from lxml import etree

from growth import growth, half_way
from halpipe import schemas
from halpipe.schemas import MAX_REPORTED, SCHEDULE, TASK_MODEL, _schema_bytes, check, line_of, namespace


@cache
def independent(kind):
    return xmlschema.XMLSchema10(_schema_bytes(kind).decode())


def document(kind, attribute, value):
    ns = namespace(kind)
    root = etree.Element(f"{{{ns}}}{kind}", {"name" if kind == TASK_MODEL else "model": "m"})
    if kind == SCHEDULE:
        etree.SubElement(
            root, f"{{{ns}}}mode", {"name": "a", "hyperperiod": "1ms", "status": "valid"} | {attribute: value}
        )
        return root
    for section in ("platform", "tasks", "modes"):
        etree.SubElement(root, f"{{{ns}}}{section}")
    etree.SubElement(root[1], f"{{{ns}}}task", {"name": "t"} | {attribute: value})
    return root


def in_tasks(lines):
    text = f'<task-model xmlns="{namespace(TASK_MODEL)}" name="m">\n<platform><unit name="u"/></platform>\n<tasks>\n'
    reader = etree.XMLParser(remove_comments=True)  # as that of halpipe is
    return etree.fromstring(f"{text}{lines}</tasks>\n<modes/></task-model>".encode(), reader)


BAD = '<task name="a" period="soon"/>\n'

DIGITS = "1" * 30

# (attribute, value, whether a task model takes it, whether a schedule takes it); None: has no such attribute
EDGES = [
    ("name", "az_AZ09./:~+@$%-", True, True),
    ("name", "x" * 1000, True, True),
    ("name", "x" * 1001, False, False),
    ("name", "", False, False),
    ("name", "ü", False, False),
    ("name", "a b", False, False),
    ("name", " a", False, False),
    ("name", "a\n", False, False),
    *((("name", f"a{c}", False, False)) for c in "*?[]{}()<>&'\"\\|;,!#=^`\u00a0"),
    ("period", f"{DIGITS}s", True, None),
    ("period", f"{DIGITS}1s", False, None),
    ("period", f"{DIGITS}.{DIGITS}s", True, None),
    ("period", f"1.{DIGITS}1s", False, None),
    ("period", f"{DIGITS}/{DIGITS}s", True, None),
    ("period", f"{DIGITS}1/{DIGITS}s", False, None),
    ("period", f"1/{'0' * 29}1s", True, None),
    ("period", "1/0s", False, None),
    ("period", "1/00s", False, None),
    ("period", "1m", False, None),
    ("period", "1 ms", True, None),
    ("period", "ms", False, None),
    ("period", ".5ms", False, None),
    ("slack", f"{DIGITS}1", False, None),
    ("slack", f"{DIGITS}", True, None),
    ("slack", "-1", False, None),
    ("slack", "1/3", True, None),
    ("hyperperiod", f"{DIGITS * 20}/{DIGITS}7ms", None, True),
    ("hyperperiod", "1" * 998 + "ms", None, True),
    ("hyperperiod", "1" * 999 + "ms", None, False),
    ("hyperperiod", "1/0ms", None, False),
    ("hyperperiod", "-1ms", None, False),
]


@pytest.mark.parametrize(
    ("kind", "attribute", "value", "accepted"),
    [
        (kind, attribute, value, accepted)
        for attribute, value, model, schedule in EDGES
        for kind, accepted in ((TASK_MODEL, model), (SCHEDULE, schedule))
        if accepted is not None
    ],
)
def test_two_validators_agree_on_the_edges(kind, attribute, value, accepted):
    """libxml2 miscounts digits in alternatives that begin alike, so the patterns must avoid them."""
    root = document(kind, attribute, value)
    assert (check(root, kind, "f.xml") == []) is accepted
    assert independent(kind).is_valid(root) is accepted


@pytest.mark.parametrize("blank", [0, 65_520, 65_533, 65_534, 65_535, 70_000])
@pytest.mark.parametrize(
    "body",
    [
        "<b/>\n<b/>\n",
        "<b>\n\n<b/>\n</b>\n<b>x\ny</b>\n",
        "<b\nx='1'\ny='2'/>\n\n\n<b/>\n",
        "<!--\n\n-->\n<b/>\n<?p\n?>\n<b/>\n",
        "<b>\n<!-- x\n -->\n<b/> <b/>\n</b>\n",
        "<b><b/>\n</b>\n",
        "<b><b><b/>\n<b/>\n\n</b>\n</b>\n<b/>",
    ],
)
def test_lines_are_exact_in_indented_files_of_any_length(blank, body):
    text = "<a>" + "\n" * blank + body + "</a>"
    expected, at = [], -1
    while (at := text.find("<b", at + 1)) >= 0:
        expected.append(text.count("\n", 0, text.index(">", at)) + 1)
    root = etree.fromstring(text)
    assert [line_of(element) for element in root.iter("b")] == expected


def test_an_element_that_was_not_read_has_no_line():
    assert line_of(etree.Element("a")) == 0


@pytest.mark.parametrize("blank", [65_528, 65_531])
def test_violations_have_their_lines_where_libxml2_stops_to_count(blank):
    """It says 65535 of all lines from that one on."""
    root = in_tasks("\n" * blank + BAD * 6)
    assert [d.at.line for d in check(root, TASK_MODEL, "m.xml")] == [blank + 4 + n for n in range(6)]


@pytest.mark.parametrize("blank", [0, 65_525, 70_000])
@pytest.mark.parametrize(
    "body",
    [
        BAD * 3,
        '<task\nname="a"\nperiod="soon"\n/>\n' * 3,
        '<task name="a"\nslack="1"/>\n' * 4 + BAD + '<task\nname="a"/>\n' + BAD * 2,
        '<task name="a"/><task name="b" period="soon"/>\n' * 3,
        '<task name="b" period="soon"/> <task name="a"/>\n<!-- a\nb -->\n' * 3,
        '<task\nname="a"><version name="v" wcet="1ms">\n\n</version></task>\n<task\nname="a"/>\n' + BAD,
    ],
)
def test_violations_of_large_documents_have_the_lines_of_others(blank, body, monkeypatch):
    """Large ones are checked while they are parsed, as a text in which the attributes of an element are in one line."""
    root = in_tasks("\n" * blank + body)
    small = check(root, TASK_MODEL, "m.xml")
    lines = [n for n, line in enumerate(body.splitlines(), blank + 4) if "soon" in line]
    if "\n/>" not in body:
        assert [d.at.line for d in small if "soon" in d.message] == lines
    monkeypatch.setattr(schemas, "MAX_STEPS", 0)
    assert [(d.at.line, d.message) for d in check(root, TASK_MODEL, "m.xml")] == [(d.at.line, d.message) for d in small]


@pytest.mark.parametrize(("wrong", "is_all"), [(1000, True), (1001, False)])
def test_of_more_than_a_thousand_violations_a_remark_says_that_there_are_more(wrong, is_all):
    found = check(in_tasks('<task name="a" nam="1"/>\n' * wrong), TASK_MODEL, "m.xml")
    assert [d.at.line for d in found[:MAX_REPORTED]] == list(range(4, 1004))
    assert ["in part" in d.message for d in found[MAX_REPORTED:]] == ([] if is_all else [True])


@pytest.mark.parametrize("seed", range(10))
def test_a_document_is_slow_where_places_take_more_steps_than_the_limit(seed, monkeypatch):
    """The place of an element is found by passing by the siblings before it, and before each element around it."""
    rng = Random(seed)
    elements = [etree.Element("a")]
    for _ in range(rng.randint(1, 30)):
        elements.append(etree.SubElement(rng.choice(elements), "a"))
    before = {e: 1 + len([*e.itersiblings(preceding=True)]) for e in elements[1:]}
    steps = sum(before[around] for e in elements[1:] for around in [e, *e.iterancestors()] if around in before)
    for most in range(steps + 1):
        monkeypatch.setattr(schemas, "MAX_STEPS", most)
        assert schemas._could_be_slow(elements[0]) is (most < steps)


@pytest.mark.parametrize("steps", [2, 3, 8, 9])
@pytest.mark.parametrize("elements", [2, 3])
def test_a_document_of_more_elements_than_are_remembered_is_slow(elements, steps, monkeypatch):
    """Three elements, of which the places take three steps; they are counted where the square of three is too much."""
    monkeypatch.setattr(schemas, "MAX_ELEMENTS", elements)
    monkeypatch.setattr(schemas, "MAX_STEPS", steps)
    assert schemas._could_be_slow(etree.fromstring("<a><b><c/></b></a>")) is (elements < 3 or steps < 3)


def test_a_violation_in_a_document_with_prefixes_has_a_line_near_it_where_libxml2_stops_to_count():
    head = f'<h:task-model xmlns:h="{namespace(TASK_MODEL)}" name="m"><h:platform><h:unit name="u"/></h:platform>'
    text = f'{head}<h:tasks>%s<h:task name="a" period="soon"/>\n</h:tasks><h:modes/></h:task-model>'
    [found] = check(etree.fromstring(text % ("\n" * 70_000)), TASK_MODEL, "m.xml")
    assert 70_001 <= found.at.line <= 70_002


def test_what_a_large_document_lacks_is_reported_at_the_start_tag(monkeypatch):
    """A large document is checked while it is parsed, where what an element lacks is found at its end tag only."""
    monkeypatch.setattr(schemas, "MAX_ELEMENTS", 3)
    tasks = '<task name="a"><version name="v" wcet="1ms"><units names="u"/></version></task>\n' * 70_000
    head = f'\n<task-model xmlns="{namespace(TASK_MODEL)}" name="m">\n<platform><unit name="u"/></platform>\n<tasks>\n'
    bad = '<task name="b">\n<version wcet="1ms">\n</version>\n</task>\n'
    found = check(etree.fromstring(f"{head}{tasks}{bad}</tasks></task-model>".encode()), TASK_MODEL, "m.xml")
    lines = {d.at.line: d.message for d in found}
    assert lines.keys() == {2, 70_006}
    assert "Missing child" in lines[2]


# ------------------------------------------------------------------------------------------------ cost


WORST = {
    "attributes": lambda n: in_tasks("<task " + " ".join(f'a{i}="1"' for i in range(n)) + "/>"),
    "elements": lambda n: in_tasks("<zz/>" * n),
    "values": lambda n: in_tasks(BAD * n),
    "nested": lambda n: in_tasks(('<task name="a">' + '<version wcet="x"/>' * 40 + "</task>\n") * (n // 40)),
    "at the end": lambda n: in_tasks('<task name="a"/>\n' * n + BAD * (n // 4)),
}


@pytest.mark.parametrize("kind", WORST)
def test_many_violations_are_told_in_time_that_grows_with_the_document(monkeypatch, kind):
    def prepare(size):
        root = WORST[kind](size)
        return lambda: check(root, TASK_MODEL, "m.xml")

    monkeypatch.setattr(schemas, "MAX_STEPS", 100_000)
    assert growth(prepare, 1_000, 8_000) < half_way(8)
    found = check(WORST[kind](4_000), TASK_MODEL, "m.xml")
    assert 1 <= len(found) <= MAX_REPORTED + 2
    assert all(len(d.message) < 500 for d in found)


def test_violations_far_down_have_their_lines(monkeypatch):
    monkeypatch.setattr(schemas, "MAX_STEPS", 3_000_000)
    good = '<task name="a"/>\n' * 1_000
    root = in_tasks("\n" * 69_000 + good + BAD * 5 + good)
    assert [d.at.line for d in check(root, TASK_MODEL, "m.xml")] == list(range(70_004, 70_009))
    many = in_tasks("\n" * 69_000 + good + BAD * 2000 + good)
    found = check(many, TASK_MODEL, "m.xml")
    assert [d.at.line for d in found[:-1]] == list(range(70_004, 70_104))
    assert "in part" in found[-1].message


def test_a_long_document_without_fault_is_accepted(monkeypatch):
    monkeypatch.setattr(schemas, "MAX_STEPS", 100_000)
    assert check(in_tasks('<task name="a"/>\n' * 3_000), TASK_MODEL, "m.xml") == []


@pytest.mark.parametrize("value", ["x" * 64_000, "x' \"" * 16_000, "'" * 64_000, '"x ' * 20_000])
def test_long_values_do_not_hide_the_message(value):
    for attribute in ("period", "name"):
        (found,) = check(document(TASK_MODEL, attribute, value), TASK_MODEL, "m.xml")
        assert attribute in found.message
        assert len(found.message) < 500
        assert len(found.help) < 500


def test_the_form_of_the_items_of_a_list_is_told_in_words():
    root = document(TASK_MODEL, "name", "t")
    etree.SubElement(root[1][0], f"{{{namespace(TASK_MODEL)}}}version", {"name": "v", "split": "4ms somewhere"})
    said = """the value 'somewhere' is not "none", "anywhere", or split points in order, such as 4ms 9ms"""
    assert [found.message for found in check(root, TASK_MODEL, "m.xml") if found.message.endswith(said)]
    assert not any("pattern" in found.message for found in check(root, TASK_MODEL, "m.xml"))


@pytest.mark.parametrize("damage", ["no modes", "stray element at the end", "stray text", "attribute of the last one"])
def test_a_violation_at_the_end_of_a_large_document_is_found(damage, monkeypatch):
    from halpipe.exporters.native import format_model
    from halpipe.pipeline.generate import SetParameters, generate

    monkeypatch.setattr(schemas, "MAX_STEPS", 0)  # every document is looked at as the large ones are
    root = etree.fromstring(format_model(generate(SetParameters(tasks=12), 1)))
    assert schemas.check(root, schemas.TASK_MODEL, "m.xml") == []
    if damage == "no modes":
        root.remove(root[-1])
    elif damage == "stray element at the end":
        etree.SubElement(root, f"{{{schemas.namespace(schemas.TASK_MODEL)}}}stray")
    elif damage == "stray text":
        root[-1].tail = "stray"
    else:
        root[-1][-1].set("stray", "1")
    assert schemas.check(root, schemas.TASK_MODEL, "m.xml")


def test_many_violations_on_one_line_are_not_remembered(monkeypatch):
    """The first piece has enough of them; the parser is not given the rest."""
    monkeypatch.setattr(schemas, "MAX_STEPS", 0)
    monkeypatch.setattr(schemas, "_FED_BYTES", 1000)
    root = in_tasks(BAD.strip() * 10_000)
    fed = []
    original = schemas._pieces
    monkeypatch.setattr(schemas, "_pieces", lambda lines: (fed.append(piece) or piece for piece in original(lines)))
    assert check(root, TASK_MODEL, "m.xml")
    assert sum(len(piece) for _, piece in fed) < 20_000


# ------------------------------------------------------------------------------------------------ words


@pytest.mark.parametrize("blank", [0, 3])
def test_what_the_root_of_a_large_document_has_is_in_its_line(monkeypatch, blank):
    """Whatever stands before it in the file: it is the first line of what is checked."""
    monkeypatch.setattr(schemas, "MAX_STEPS", 0)
    text = (
        "\n" * blank + f'<task-model xmlns="{namespace(TASK_MODEL)}" name="m" nam="n">\n<platform/>\n<tasks/>\n<modes/>'
    )
    found = check(etree.fromstring(f"{text}<x/></task-model>"), TASK_MODEL, "m.xml")
    assert [d.at.line for d in found] == [blank + 1, blank + 4]
    found = check(etree.fromstring(f"{text}\n<x\n/></task-model>"), TASK_MODEL, "m.xml")
    assert [d.at.line for d in found] == [blank + 1, blank + 6]


def test_a_reason_is_given_where_one_thing_is_wrong_in_a_line():
    bad = '<task name="a" binding="firm"/>'
    alone = check(in_tasks(f"{bad}\n\n{bad}\n"), TASK_MODEL, "m.xml")
    assert [(d.at.line, bool(d.help)) for d in alone] == [(4, True), (6, True)]
    together = check(in_tasks(bad + bad), TASK_MODEL, "m.xml")
    assert [(d.at.line, d.help) for d in together] == [(4, "")]  # the same of both


@pytest.mark.parametrize(
    ("length", "shown"),
    [(400, None), (401, 400 - 150), (1600, 400 - 150), (1601, 400 - 150)],
)
def test_a_long_message_keeps_its_beginning_and_its_end(length, shown):
    text = "".join(chr(ord("a") + n % 26) for n in range(length))
    assert schemas._shortened(text) == (text if shown is None else f"{text[:shown]}...{text[-150:]}")


def test_of_a_long_value_60_characters_are_kept():
    for quote in "'\"":
        value = "x" * 61 + "y" * 58
        assert schemas._shortened(f"is {quote}{value}{quote}.") == f"is {quote}{value}{quote}."
        assert schemas._shortened(f"is {quote}{value}y{quote}.") == f"is {quote}{'x' * 60}...{quote}."
    behind = "a" * 1500 + "'" + "b" * 300 + "' is wrong"
    assert schemas._shortened(behind).endswith("'" + "b" * 60 + "...' is wrong")


def said(value, form):
    """What is made of the message about a value that should have a form."""
    (pattern,) = (pattern for pattern, words in schemas._forms(TASK_MODEL).items() if words.startswith(form))
    message = f"[facet 'pattern'] The value '{value}' is not accepted by the pattern '{pattern}'."
    return schemas._plain(message, TASK_MODEL).partition(f"the value '{value}' is not ")[2].partition("; ")[2]


def test_values_of_other_habits_are_written_as_they_must_be():
    names = next(words for words in schemas._forms(TASK_MODEL).values() if "name" in words)
    hint = "blanks alone separate names: "
    assert said("a,b;c", names) == f'{hint}"a b c"'
    assert said("a->b", names) == f'{hint}"a b"'
    assert said(",", names) == f'{hint}"a b"'
    assert said("1,5ms", "a duration") == "write 1.5ms, with a decimal point"
    assert said("1,5,2ms", "a duration") == said("1,5 m", "a duration") == ""
    assert (said("", names), said("a,b!c", names), said("a!", names)) == ("", "", "")


@pytest.mark.parametrize(
    ("namespace", "tag", "kind", "help"),
    [
        (
            "http://autosar.org/schema/r4.0",
            "AUTOSAR",
            TASK_MODEL,
            "make a model of it first: halpipe import arxml FILE -o model.xml",
        ),
        (
            "http://app4mc.eclipse.org/amalthea/3.0",
            "Amalthea",
            SCHEDULE,
            "make a model of it first: halpipe import amalthea FILE -o model.xml",
        ),
        (
            namespace(SCHEDULE),
            SCHEDULE,
            TASK_MODEL,
            "this is a schedule, where a model is expected; commands take MODEL first, then SCHEDULE",
        ),
        (
            namespace(TASK_MODEL),
            TASK_MODEL,
            SCHEDULE,
            "this is a model, where a schedule is expected; commands take MODEL first, then SCHEDULE",
        ),
        ("", TASK_MODEL, TASK_MODEL, 'expected <task-model xmlns="urn:halpipe:task-model:1">'),
        ("urn:x", "y", SCHEDULE, 'expected <schedule xmlns="urn:halpipe:schedule:1">'),
    ],
)
def test_a_document_of_another_kind_has_a_remedy(namespace, tag, kind, help):
    root = etree.Element(f"{{{namespace}}}{tag}" if namespace else tag)
    [found] = check(root, kind, "m.xml")
    where = f'the namespace "{namespace}"' if namespace else "no namespace"
    assert (found.code, found.help) == (schemas.WRONG_ROOT.id, help)
    assert found.message == f'has the root element "{tag}" in {where}'


@pytest.mark.parametrize(
    ("attribute", "help"),
    [
        ("binding", '"binding" belongs to <task> or <tasks>'),
        ("perriod", 'did you mean "period"?'),
        ("wcet", '"wcet" belongs to <interrupt> or <version>'),
        ("qqqqqq", "remove it"),
    ],
)
def test_an_attribute_that_is_not_allowed_has_a_remedy(attribute, help):
    root = document(TASK_MODEL, "name", "t")
    root[2].set(attribute, "1ms")
    assert [d.help for d in check(root, TASK_MODEL, "m.xml") if "not allowed" in d.message] == [help]
