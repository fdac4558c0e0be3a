"""Variants: formulas of the standard, value sets of predefined variants, and what exists in one of them."""

from dataclasses import replace
from fractions import Fraction

import pytest
from arxml_case import (
    alarm,
    assembly,
    component,
    composition,
    configuration,
    container,
    counter,
    el,
    every,
    found,
    in_port,
    mapped,
    named,
    os_task,
    out_port,
    package,
    periods,
    read,
    ref,
    refusal,
    rte,
    runnable,
    write,
)
from lxml import etree
from test_arxml_onto import planned, project

from command_line import run_here
from halpipe.flow.onto import export_onto
from halpipe.importers.arxml import codes
from halpipe.importers.arxml.files import variants
from halpipe.importers.arxml.files.formulas import FormulaError, UnsetError, evaluate
from halpipe.importers.arxml.options import ArxmlImportOptions

KNOWN = {"/V/A": Fraction(2), "/V/B": Fraction(0), "/V/S": "left"}


def value(text):
    """The value of a formula in which {A} is a reference."""
    body = text.replace("&", "&amp;").replace("<", "&lt;").replace("{", "<R>/V/").replace("}", "</R>")
    return evaluate(etree.fromstring(f"<F>{body}</F>"), KNOWN.get)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 1),
        ("{A} == 2", 1),
        ("{A}==2 && !({A} < 1)", 1),
        ("{A} !=4&& {B} ==1", 0),
        ("{A}\n", 2),
        ("1 + 2 * 3 - 4 / 2", 5),
        ("(1 + 2) * 3 % 4", 1),
        ("-7 / 2", -3),
        ("-7 % 2", -1),
        ("1 << 4 >> 2 | 1 & 3 ^ 2", 7),
        ("~0 == -1", 1),
        ("0x10 + 0b11", 19),
        ("1.5 * 2", 3),
        ("1 < 2 == 1", 1),
        ("1 || {Unset} == 1", 1),
        ("0 && {Unset} == 1", 0),
        ("defined({A})", 1),
        ("defined({Unset})", 0),
        ("defined({Unset}) && {Unset} == 1", 0),
        ("!defined({Unset}) || {Unset} > 3", 1),
        ('{S} == "left"', 1),
        ('{S} != "left" || 0', 0),
        ("true && !false", 1),
    ],
)
def test_formulas_have_the_values_of_c(text, expected):
    assert value(text) == expected


@pytest.mark.parametrize(
    "text",
    ["1 +", "(1", "1)", "$", "1 2", "f(1)", "defined(1)", "1 / 0", "1.5 | 1", '"a" < 1', "1 << -1", "(" * 300 + "1"],
)
def test_what_is_no_formula_is_refused(text):
    with pytest.raises(FormulaError):
        value(text)


def test_a_constant_without_a_value_is_not_zero():
    with pytest.raises(UnsetError, match="/V/Unset"):
        value("{A} == 2 && {Unset} == 0")


# -------------------------------------------------------------------------------------------------------- projects


def constants(name, **values):
    entries = [
        el("SW-SYSTEMCONST-VALUE", ref("SW-SYSTEMCONST-REF", f"/V/{key}"), el("VALUE", str(each)))
        for key, each in values.items()
    ]
    return named("SW-SYSTEMCONSTANT-VALUE-SET", name, el("SW-SYSTEMCONSTANT-VALUES", *entries))


def criteria(name, **values):
    entries = [
        el("POST-BUILD-VARIANT-CRITERION-VALUE", ref("VARIANT-CRITERION-REF", f"/V/{key}"), el("VALUE", str(each)))
        for key, each in values.items()
    ]
    return named("POST-BUILD-VARIANT-CRITERION-VALUE-SET", name, el("POST-BUILD-VARIANT-CRITERION-VALUES", *entries))


def variant(name, *sets, includes=()):
    refs = [ref(f"{kind}-REF", f"/V/{each}") for kind, each in sets]
    inner = [ref("INCLUDED-VARIANT-REF", f"/V/{each}") for each in includes]
    return named("PREDEFINED-VARIANT", name, el("INCLUDED-VARIANT-REFS", *inner), el("REFS", *refs))


CONST, CRIT = "SW-SYSTEMCONSTANT-VALUE-SET", "POST-BUILD-VARIANT-CRITERION-VALUE-SET"
VARIANTS = package(
    "V",
    named("SW-SYSTEMCONST", "Platform"),
    named("POST-BUILD-VARIANT-CRITERION", "Side"),
    constants("Gen2", Platform=2),
    constants("Gen4", Platform=4),
    criteria("Left", Side=1),
    criteria("Right", Side=2),
    variant("Gen2Left", (CONST, "Gen2"), (CRIT, "Left")),
    variant("Gen4Right", (CONST, "Gen4"), (CRIT, "Right")),
    variant("Base", (CONST, "Gen2")),
    variant("Including", (CRIT, "Right"), includes=("Base", "Including")),
    variant("Both", (CONST, "Gen2"), (CONST, "Gen4")),
    named("EVALUATED-VARIANT-SET", "Released", el("X", ref("EVALUATED-VARIANT-REF", "/V/Gen2Left"))),
    named(
        "EVALUATED-VARIANT-SET", "Two", *(el("X", ref("EVALUATED-VARIANT-REF", f"/V/{v}")) for v in ("Base", "Both"))
    ),
)


def when(formula, label="L"):
    body = formula.replace("<", "&lt;").replace("&", "&amp;") if "<SYSC" not in formula else formula
    return el(
        "VARIATION-POINT", el("SHORT-LABEL", label), el("SW-SYSCOND", body, **{"binding-time": "PRE-COMPILE-TIME"})
    )


def platform(test):
    return f'<SYSC-REF DEST="SW-SYSTEMCONST">/V/Platform</SYSC-REF> {test}'


def side(number):
    inner = el("POST-BUILD-VARIANT-CONDITION", ref("MATCHING-CRITERION-REF", "/V/Side"), el("VALUE", str(number)))
    return el("VARIATION-POINT", el("SHORT-LABEL", "S"), el("POST-BUILD-VARIANT-CONDITIONS", inner))


PUMP = component(
    "Pump",
    every("0.01", "Tick", "Pump/Step", when(platform("== 2"), "two")),
    every("0.02", "Tick", "Pump/Step", when(platform("== 4"), "four")),
    runnables=[runnable("Step", writes=["Pump/out"])],
    ports=[out_port("out")],
)
FAN = component(
    "Fan", every("0.05", "Tick", "Fan/Blow"), runnables=[runnable("Blow", reads=["Fan/in"])], ports=[in_port("in")]
)
CAR = composition("Car", "p:Pump f:Fan", assembly("c", "Car/p Pump/out", "Car/f Fan/in")).replace(
    "<SHORT-NAME>f</SHORT-NAME>", "<SHORT-NAME>f</SHORT-NAME>" + side(1)
)
LINE = package("T", PUMP, FAN, CAR)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"variant": "Gen2Left"}, {"p/Step": "10ms", "f/Blow": "50ms"}),
        ({"variant": "/V/Gen4Right"}, {"p/Step": "20ms"}),
        ({"variant": "Released"}, {"p/Step": "10ms", "f/Blow": "50ms"}),
        ({"variant": "Including"}, {"p/Step": "10ms"}),
        ({"conditions": ("Platform=4", "Side=1")}, {"p/Step": "20ms", "f/Blow": "50ms"}),
        ({"variant": "Base", "conditions": ("/V/Side=0x1",)}, {"p/Step": "10ms", "f/Blow": "50ms"}),
    ],
)
def test_a_variant_has_what_its_conditions_let_exist(tmp_path, options, expected):
    imported = read(write(tmp_path, LINE, VARIANTS), **options)
    assert periods(imported) == expected
    assert not found(imported, codes.VARIANT)
    assert not found(imported, codes.DANGLING)
    gone = [e for e in imported.coverage.ignored_elements if e.reason == "not in the chosen variant"]
    assert {e.name for e in gone} >= ({"/T/Car/f"} if "f/Blow" not in expected else {"/T/Pump/B/Tick"})
    assert all(e.at.line for e in gone)


def test_variants_include_each_other_as_deep_as_they_are_stated(tmp_path):
    chain = [variant(f"V{n}", includes=(f"V{n + 1}", "V0")) for n in range(1200)]
    last = variant("V1200", (CONST, "Gen4"), (CRIT, "Right"))
    sides = [named("POST-BUILD-VARIANT-CRITERION", "Side"), criteria("Right", Side=2)]
    values = package("V", named("SW-SYSTEMCONST", "Platform"), constants("Gen4", Platform=4), *sides, *chain, last)
    assert periods(read(write(tmp_path, LINE, values), variant="V0")) == {"p/Step": "20ms"}


def test_without_a_choice_what_depends_on_one_is_named(tmp_path):
    imported = read(write(tmp_path, LINE, VARIANTS))
    told = found(imported, codes.VARIANT)
    assert "3 elements" in told[0].message
    assert "Tick, Tick, f" in told[0].message


@pytest.mark.parametrize(
    ("options", "code", "said"),
    [
        ({"variant": "Gen3Left"}, codes.UNKNOWN_VARIANT, "Gen2Left"),
        ({"variant": "Two"}, codes.UNKNOWN_VARIANT, "name one"),
        ({"variant": "Both"}, codes.TWO_VALUES, "take one"),
        ({"variant": "Gen2Left", "conditions": ("Platform=4",)}, codes.TWO_VALUES, "take one"),
        ({"conditions": ("Plattform=4",)}, codes.UNKNOWN_VARIANT, "Platform"),
        ({"conditions": ("Platform",)}, codes.UNKNOWN_VARIANT, "Platform"),
        ({"variant": "Base"}, codes.UNSET_CONSTANT, "--condition Side=VALUE"),
        ({"conditions": ("Side=1",)}, codes.UNSET_CONSTANT, "--condition Platform=VALUE"),
    ],
)
def test_what_cannot_be_decided_is_an_error(tmp_path, options, code, said):
    errors = [d for d in refusal(write(tmp_path, LINE, VARIANTS), **options).diagnostics if d.is_error]
    assert {d.code for d in errors} == {code.id}
    assert any(said in d.help for d in errors)


def test_two_that_exist_at_once_contradict_each_other(tmp_path):
    pump = component(
        "Pump",
        every("0.01", "Tick", "Pump/Step", when(platform("== 2"), "two")),
        every("0.02", "Tick", "Pump/Step", when(platform("&lt; 4"), "four")),
        runnables="Step",
    )
    errors = refusal(write(tmp_path, package("T", pump), VARIANTS), variant="Base").diagnostics
    assert codes.CONFLICT.id in {d.code for d in errors}


def test_values_of_constants_may_be_formulas_of_other_constants(tmp_path):
    def entry(name, value):
        return el("SW-SYSTEMCONST-VALUE", ref("SW-SYSTEMCONST-REF", f"/V/{name}"), el("VALUE", value))

    pump = LINE.replace(side(1), "")
    double = '<SYSC-REF DEST="SW-SYSTEMCONST">/V/{}</SYSC-REF> * 2'
    values = [entry("Platform", double.format("Half")), entry("Half", double.format("One")), entry("One", "1")]
    known = [named("SW-SYSTEMCONST", name) for name in ("Platform", "Half", "One")]
    stated = named(CONST, "S", el("SW-SYSTEMCONSTANT-VALUES", *values))
    path = write(tmp_path, pump, package("V", *known, stated, variant("X", (CONST, "S"))))
    assert periods(read(path, variant="X"))["p/Step"] == "20ms"
    path.write_text(path.read_text().replace("<VALUE>1</VALUE>", f"<VALUE>{double.format('Half')}</VALUE>"))
    assert codes.UNSET_CONSTANT.id in {d.code for d in refusal(path, variant="X").diagnostics}


@pytest.mark.parametrize(("more", "is_read"), [(0, True), (1, False)])
def test_values_of_constants_depend_on_each_other_in_a_limited_number_of_rounds(tmp_path, more, is_read):
    count = variants._MAX_ROUNDS + more
    texts = [f'<SYSC-REF DEST="SW-SYSTEMCONST">/V/C{n + 1}</SYSC-REF>' for n in range(count)]
    values = [
        el("SW-SYSTEMCONST-VALUE", ref("SW-SYSTEMCONST-REF", f"/V/C{n}"), el("VALUE", text))
        for n, text in enumerate([*texts, "1"])
    ]
    known = [named("SW-SYSTEMCONST", f"C{n}") for n in range(count + 1)]
    stated = named(CONST, "S", el("SW-SYSTEMCONSTANT-VALUES", *values))
    pump = component("Pump", every("0.01", "Tick", "Pump/Step", when(texts[0].replace("C1", "C0"))), runnables="Step")
    path = write(tmp_path, package("T", pump), package("V", *known, stated, variant("X", (CONST, "S"))))
    if is_read:
        assert periods(read(path, variant="X")) == {"Pump/Step": "10ms"}
    else:
        assert codes.UNSET_CONSTANT.id in {d.code for d in refusal(path, variant="X").diagnostics}


def test_variants_are_read_with_relative_references(tmp_path):
    base = el("REFERENCE-BASE", el("SHORT-LABEL", "v"), ref("PACKAGE-REF", "/V"))
    relative = VARIANTS.replace("REF>/V/", 'REF BASE="v">')
    relative = relative.replace("<SHORT-NAME>V</SHORT-NAME>", f"<SHORT-NAME>V</SHORT-NAME><X>{base}</X>")
    assert periods(read(write(tmp_path, LINE, relative), variant="Including")) == {"p/Step": "10ms"}


def test_a_value_set_split_over_files_is_one(tmp_path):
    one = write(tmp_path, LINE, VARIANTS)
    two = write(tmp_path, package("V", constants("Gen2", Platform=4)), name="two.arxml")
    for paths in ((one, two), (two, one)):
        (told,) = [d for d in refusal(*paths, variant="Gen2Left").diagnostics if d.code == codes.TWO_VALUES.id]
        assert str(one) in told.message
        assert told.at.file == str(two)


@pytest.mark.parametrize("point", [el("SHORT-LABEL", "x"), el("BLUEPRINT-CONDITION", el("P", "maybe"))])
def test_a_variation_point_without_a_condition_is_no_variant(tmp_path, point):
    tick = every("0.01", "Tick", "Pump/Step", el("VARIATION-POINT", point))
    assert not found(read(write(tmp_path, package("T", component("Pump", tick, runnables="Step")))), codes.VARIANT)


def cycles(*conditions):
    """Two cycle times of an alarm, of which each variant has one."""
    name = "/Vendor/X/Os/OsAlarm/OsAlarmAutostart/OsAlarmCycleTime"
    return [
        el("ECUC-NUMERICAL-PARAM-VALUE", ref("DEFINITION-REF", name), el("VALUE", str(10 * number)), condition)
        for number, condition in enumerate(conditions, 1)
    ]


def starts(*conditions):
    """Two autostarts of an alarm, of which each variant has one."""
    kind, cycle = "Os/OsAlarm/OsAlarmAutostart", "OsAlarmCycleTime"
    found = (container(kind, f"s{n}", params={cycle: str(10 * n)}) for n in range(1, len(conditions) + 1))
    return "".join(s.replace("<D", f"{c}<D", 1) for s, c in zip(found, conditions, strict=True))


CYCLES = container("Os/OsAlarm/OsAlarmAutostart", "s").replace(
    "<PARAMETER-VALUES>", "<PARAMETER-VALUES>" + "".join(cycles(side(1), side(2)))
)


@pytest.mark.parametrize("start", [CYCLES, starts(side(1), side(2))], ids=["parameter", "container"])
def test_variants_side_by_side_in_the_configuration_are_named_and_chosen(tmp_path, start):
    action = alarm("Al", "77", activates="A")
    plain = container("Os/OsAlarm/OsAlarmAutostart", "s", params={"OsAlarmCycleTime": "77", "OsAlarmAlarmTime": "0"})
    assert plain in action
    path = write(
        tmp_path, package("E", configuration("Os", os_task("A"), counter(), action.replace(plain, start))), VARIANTS
    )
    imported = read(path)
    assert periods(imported) == {"A": "10ms"}
    told = found(imported, codes.VARIANT)
    assert [d.help for d in told] == [
        "choose --variant Gen2Left or Gen4Right or Base or Including or Both",
        "choose a variant; otherwise the first of the two counts",
    ]
    assert periods(read(path, conditions=("Side=2",))) == {"A": "20ms"}


def test_an_event_mapped_to_another_os_task_in_each_variant_is_named_and_chosen(tmp_path):
    mappings = [
        mapped("Fan/B/Tick", task, "1").replace("</SHORT-NAME>", "</SHORT-NAME>" + side(number), 1)
        for number, task in enumerate("AB", 1)
    ]
    ecu = package("E", configuration("Os", os_task("A"), os_task("B")), configuration("Rte", rte(*mappings)))
    path = write(tmp_path, package("T", FAN), ecu, VARIANTS)
    told = found(read(path), codes.VARIANT)
    assert any(d.message.startswith('RteMappedToTaskRef is "/E/Os/B" here, but "/E/Os/A" at') for d in told)
    assert "B" in found(read(path, conditions=("Side=1",)), codes.NOT_SCHEDULED)[0].message


def test_a_bad_formula_is_named_with_its_line(tmp_path):
    pump = component("Pump", every("0.01", "Tick", "Pump/Step", when(platform("=! 2"))), runnables="Step")
    path = write(tmp_path, package("T", pump), VARIANTS)
    (told,) = [d for d in refusal(path, variant="Base").diagnostics if d.code == codes.BAD_FORMULA.id]
    assert (
        told.at.line
        == path.read_text().splitlines().index(next(x for x in path.read_text().splitlines() if "=!" in x)) + 1
    )


def test_mappings_and_formulas_of_the_configuration_are_evaluated(tmp_path):
    pump = component("Pump", every("0.01", "A", "Pump/A"), every("0.01", "B", "Pump/B"), runnables="A B")
    formula = (
        '<VALUE BINDING-TIME="PRE-COMPILE-TIME"><SYSC-REF DEST="SW-SYSTEMCONST">/V/Platform</SYSC-REF> * 10</VALUE>'
    )
    mappings = [mapped("Pump/B/A", "Main", "POSITION"), mapped("Pump/B/B", "Main", "30")]
    mappings[0] = mappings[0].replace("<VALUE>POSITION</VALUE>", formula)
    ecu = package("E", configuration("Os", os_task("Main")), configuration("Rte", rte(*mappings)))
    path = write(tmp_path, package("T", pump), ecu, VARIANTS)

    def order(variant):
        model = read(path, variant=variant).model
        return [(p.task, t.name) for t in model.tasks for p in t.versions[0].precedences]

    assert order("Gen2Left") == [("Pump/A", "Pump/B")]
    assert order("Gen4Right") == [("Pump/B", "Pump/A")]


def test_only_the_chosen_variant_of_a_container_is_taken_out_of_a_project(tmp_path):
    """Two autostarts of one alarm, of which each variant has one; both stand in one file."""
    path = project(tmp_path, more=[container("Os/OsAppMode", "OSDEFAULTAPPMODE")])
    before, start, rest = path.read_text().partition("<ECUC-CONTAINER-VALUE><SHORT-NAME>s</SHORT-NAME>")
    inner, end, rest = rest.partition("</ECUC-CONTAINER-VALUE>")
    starts = [f"\n{start}{inner}{when(platform(f'== {number}'), str(number))}{end}" for number in (2, 4)]
    path.write_text(before + "".join(starts) + rest)
    write(tmp_path, VARIANTS, name="variants.arxml")
    model = read(tmp_path, variant="Gen4Right").model
    model = replace(model, tasks=tuple(replace(t, versions=(replace(t.versions[0], wcet="1ms"),)) for t in model.tasks))
    onto = export_onto(model, planned(model, 0, 2), str(tmp_path), ArxmlImportOptions(variant="Gen4Right"))
    changed = onto.files["changed/system.arxml"].decode()
    assert (starts[0] in changed, starts[1].strip() in changed) == (True, False)
    (told,) = [d for d in onto.findings if d.code == codes.ONE_VARIANT.id]
    assert "/E/Os/Al/s" in told.message


def test_the_command_takes_variants_and_conditions(tmp_path):
    write(tmp_path, LINE, VARIANTS)
    base = ["import", "arxml", "system.arxml", "-o", "m.xml"]
    assert run_here(tmp_path, *base, "--variant", "Gen2Left").returncode == 0
    assert run_here(tmp_path, *base, "--condition", "Platform=2", "--condition", "Side=1").returncode == 0
    done = run_here(tmp_path, *base, "--variant", "Gen9")
    assert (done.returncode, "HAL0585" in done.stderr) == (1, True)
