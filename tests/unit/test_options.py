"""Options, each stated once: a verb takes all of its own through every door, and no other."""

import inspect
import re
from fractions import Fraction
from itertools import permutations
from pathlib import Path
from types import SimpleNamespace

import pytest
import typer

import halpipe
from halpipe.cli.app import build
from halpipe.core.diagnostics import Exit, HalpipeError
from halpipe.core.options import Form, from_keywords, names_of, option, options_of, refuse_unused
from halpipe.core.records import record
from halpipe.core.settings import Words
from halpipe.deploy.base import CheckOptions
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.riscv import PrepareOptions
from halpipe.flow import formats
from halpipe.flow.formats import EXPORTERS, IMPORTERS, exporter, importer
from halpipe.flow.plan import read_plan
from halpipe.importers.common.base import ImportOptions
from halpipe.importers.native import parse_model
from halpipe.pipeline.compare.learning import LearnOptions
from halpipe.pipeline.explain.explanation import ExplainOptions
from halpipe.pipeline.generate import SetParameters, generate
from halpipe.pipeline.solve.schedule import SearchOptions
from halpipe.pipeline.whatif.sensitivity import SensitivityOptions
from halpipe.pipeline.whatif.size import SizeOptions
from halpipe.starters import first_model
from support import model, ms, task, version

SOURCE = Path(halpipe.__file__).parent
KINDS = {
    **{("import", name): importer(name).options for name in formats.formats(IMPORTERS)},
    **{("export", name): exporter(name).options for name in formats.formats(EXPORTERS)},
    ("schedule", ""): SearchOptions,
    ("explain", ""): ExplainOptions,
    ("compare", ""): LearnOptions,
    ("deploy", "check"): CheckOptions,
    ("deploy", "prepare"): PrepareOptions,
    ("size", ""): SizeOptions,
    ("sensitivity", ""): SensitivityOptions,
    ("generate", ""): SetParameters,
}
NAMES = sorted({name for kind in KINDS.values() for name in names_of(kind)})
OWN = {
    *("output", "report", "coverage", "trace", "bandwidth", "format", "quiet", "verbose", "help"),
    *("share", "workers", "resume", "model", "witness", "seed", "learn", "histogram"),
}
"""Options of commands that name further files, or say where results go and how they look, not what they are."""


def flags(verb, name):
    """The long options of a command."""
    app = build([verb])
    context = {}
    command = typer.main.get_command(app)
    inner = command.get_command(context, verb)
    if name:
        inner = inner.get_command(context, name)
    long = {flag for each in inner.params for flag in [*each.opts, *each.secondary_opts] if flag.startswith("--")}
    return {flag.removeprefix("--") for flag in long if not flag.startswith("--no-")}


def test_a_switch_is_off_unless_it_is_set():
    switches = [(key, each) for key, kind in KINDS.items() for each in options_of(kind) if each.form is Form.SWITCH]
    assert [each.name for _, each in switches if each.default is not False] == ["exact", "remedies"]  # of explain


@pytest.mark.parametrize(("verb", "name"), KINDS)
def test_a_command_has_the_options_of_its_kind_and_no_others(verb, name):
    known = set(names_of(KINDS[verb, name]))
    assert flags(verb, name) - (OWN - known) == known


def text_of(each):
    """A text that an option takes, other than its default where there is one."""
    if each.words:
        return next((word for word in each.words if word != each.default), each.words[0])
    for text in ("3", "3ms", "1/2", "a.xml"):
        try:
            each.read(text)
        except ValueError:
            continue
        return text
    raise AssertionError(each.name)


def stated(each):
    """The same in YAML."""
    forms = {Form.SWITCH: "true", Form.NAMES: f"{{core0: {text_of(each)}}}", Form.LIST: f"[{text_of(each)}]"}
    return forms.get(each.form, f'"{text_of(each)}"')


def plan_with(folder, verb, name, options):
    """Read a pipeline file with options of one step."""
    kind = KINDS[verb, name]
    needed = {each.name: stated(each) for each in options_of(kind) if each.required}
    keys = ", ".join(f"{key}: {value}" for key, value in (needed | options).items())
    lines = {
        "import": f"import: {{format: {name}, inputs: a, {keys}}}\nschedule: {{output: s.xml}}\n",
        "schedule": f"schedule: {{output: s.xml, {keys}}}\n",
        "export": f"schedule: {{output: s.xml}}\nexports: [{{format: {name}, output: o, {keys}}}]\n",
    }
    path = folder / "p.yaml"
    path.write_text("halpipe-pipeline: 1\nmodel: m.xml\n" + lines[verb])
    return read_plan(str(path))


def codes_of(folder, verb, name, options):
    """What is wrong with a pipeline file that has the options."""
    try:
        plan_with(folder, verb, name, options)
    except HalpipeError as refused:
        return {found.code for found in refused.diagnostics}
    return set()


def files_are_there(monkeypatch):
    from halpipe.flow import searching

    monkeypatch.setattr(searching, "_read", lambda name, file: file)


IN_FILES = [key for key in KINDS if key[0] in ("import", "schedule", "export")]


@pytest.mark.parametrize(("verb", "name"), IN_FILES)
def test_a_pipeline_file_has_the_options_of_its_kind_and_no_others(verb, name, tmp_path, monkeypatch):
    files_are_there(monkeypatch)
    known = names_of(KINDS[verb, name])
    for each in options_of(KINDS[verb, name]):
        # Some have no effect beside the defaults of others, which is refused.
        assert codes_of(tmp_path, verb, name, {each.name: stated(each)}) <= {"HAL0025"}
    for other in set(NAMES) - set(known) - ({"inputs"} if verb == "import" else set()):  # a key of the step itself
        assert "HAL0021" in codes_of(tmp_path, verb, name, {other: "1"})


def call(verb, name, options):
    """Call the function of Python, which goes no further than its options."""
    kind = KINDS[verb, name]
    return kind(**from_keywords(verb, kind, options))


@pytest.mark.parametrize(("verb", "name"), KINDS)
def test_python_has_the_options_of_its_kind_and_no_others(verb, name):
    kind = KINDS[verb, name]
    needed = {each.keywords[0]: text_of(each) for each in options_of(kind) if each.required}
    for each in options_of(kind):
        values = {Form.SWITCH: True, Form.NAMES: {"core0": text_of(each)}, Form.LIST: [text_of(each)]}
        for keyword in each.keywords:
            given = values.get(each.form, text_of(each))
            made = call(verb, name, needed | {keyword: given})
            assert getattr(made, each.attribute) != each.default or each.default is True
    known = {keyword for each in options_of(kind) for keyword in each.keywords}
    others = {each.keywords[0] for other in KINDS.values() for each in options_of(other)} - known
    functions = {"import": halpipe.import_model, "export": halpipe.export, "schedule": halpipe.schedule}
    functions |= {"explain": halpipe.explain, "compare": halpipe.compare, "deploy": halpipe.check}
    functions |= {"size": halpipe.size, "sensitivity": halpipe.sensitivity}
    system = model(task("a", 10, version("v", 3)))
    arguments = {"import": (name, "a"), "export": (name, system, None), "schedule": (system,), "explain": (system,)}
    arguments |= {"deploy": ("bundle",), "size": (system,), "sensitivity": (system, None)}
    for other in sorted(others) if verb in functions and name != "prepare" else ():
        if other in inspect.signature(functions[verb]).parameters:
            continue
        with pytest.raises(TypeError, match="has no option"):
            functions[verb](*arguments.get(verb, (None, "a")), **needed, **{other: "1"})


@pytest.mark.parametrize(("verb", "name"), KINDS)
def test_every_option_is_used_in_the_code_of_its_verb(verb, name):
    """Whatever is accepted is read somewhere: as an attribute, in the code of its format or verb."""
    places = {"import": f"importers/{name}", "explain": "pipeline/explain"}
    places |= {"export": "/".join(type(exporter(name)).__module__.split(".")[1:3])} if verb == "export" else {}
    places |= {"schedule": "pipeline", "compare": "pipeline/compare", "deploy": "deploy"}
    places |= {"size": "pipeline/whatif", "sensitivity": "pipeline/whatif", "generate": "pipeline/generate"}
    shared = ("flow", "cli", "exporters/common", *(("exporters/riscv",) if name == "prepare" else ()))
    files = [file for place in (places[verb], *shared) for file in (SOURCE / place).rglob("*.py")]
    text = "\n".join(file.read_text() for file in files)
    assert [each.name for each in options_of(KINDS[verb, name]) if not re.search(rf"\.{each.attribute}\b", text)] == []


@pytest.mark.parametrize("text", ["", " "])
@pytest.mark.parametrize(("verb", "name"), KINDS)
def test_an_empty_text_is_no_value_of_any_option(verb, name, text):
    for each in options_of(KINDS[verb, name]):
        if each.form is not Form.SWITCH:
            with pytest.raises(ValueError, match="empty"):
                each.from_value(text)


@pytest.mark.parametrize(("verb", "name"), IN_FILES)
def test_an_empty_text_is_no_value_in_a_pipeline_file(verb, name, tmp_path):
    for each in options_of(KINDS[verb, name]):
        if each.form in (Form.TEXT, Form.LIST):
            empty = '""' if each.form is Form.TEXT else "[]"
            assert "HAL0023" in codes_of(tmp_path, verb, name, {each.name: empty})


@pytest.mark.parametrize(("verb", "name"), KINDS)
def test_a_text_that_is_written_as_it_is_has_one_line(verb, name):
    for each in options_of(KINDS[verb, name]):
        if each.form is Form.TEXT and not each.is_path("a"):
            with pytest.raises(ValueError, match="; "):
                each.from_value("a\nb")


# ---------------------------------------------------------------------------------------- each has an effect

VALUES = {"mode": "limp", "cpus": {"core1": 7}, "max_points": 1, "ecuc_prefix": "/Vendor/Defs", "busy": 60}
BESIDE = {"linux": {"busy": 50}}
"""Options without which a format writes nothing of the first model."""
NOT_HERE = {"arxml": {"onto", "ecu", "variant", "conditions"}, "linux": {"sources"}}
"""Options of a project, and of source files, neither of which the first model has."""
WRITTEN = ["amalthea", "arxml", "btf", "graph", "linux", "report", "ros", "trace"]


@pytest.fixture(scope="module")
def planned():
    system = parse_model(first_model()["model.xml"], "model.xml")
    return system, halpipe.schedule(system)


def outcome(name, planned, options):
    """The files, or why there are none."""
    try:
        return halpipe.export(name, *planned, **options)
    except HalpipeError as refused:
        return [found.message for found in refused.diagnostics]


@pytest.mark.parametrize("name", WRITTEN)
def test_every_option_of_an_export_changes_what_is_written(name, planned):
    base = BESIDE.get(name, {})
    plain = outcome(name, planned, base)
    assert isinstance(plain, dict), plain
    values = values_of(name, planned)
    assert [key for key, value in values.items() if outcome(name, planned, base | {key: value}) == plain] == []


@pytest.mark.parametrize("name", WRITTEN)
def test_no_option_of_an_export_is_idle_beside_another(name, planned):
    """It changes what is written, or is refused there."""
    base, values = BESIDE.get(name, {}), values_of(name, planned)
    alone = {key: outcome(name, planned, base | {key: value}) for key, value in values.items()}
    pairs = [pair for pair in permutations(values, 2) if isinstance(alone[pair[1]], dict)]
    both = {pair: outcome(name, planned, base | {key: values[key] for key in pair}) for pair in pairs}
    assert [pair for pair in pairs if both[pair] == alone[pair[1]]] == []


def values_of(name, planned):
    """A value of each option of a format, by its keyword."""
    found = {}
    for each in options_of(exporter(name).options):
        value = VALUES.get(each.attribute, True if each.form is Form.SWITCH else text_of(each))
        if each.form is Form.NAMES and each.attribute not in VALUES:
            value = {planned[0].tasks[0].name: value}
        if each.attribute not in NOT_HERE.get(name, ()):
            found[each.keywords[0]] = value
    return found


SET = {
    "tasks": 9,
    "units": 4,
    "unit_types": 1,
    "access_windows": 3,
    "resources": 3,
    "multi_version": Fraction(1, 2),
    "precedence": Fraction(1, 2),
    "utilisation": Fraction(2, 5),
    "hyperperiod": ms(60),
    "slack": Fraction(1, 10),
    "fractional": True,
    "resource_fill": Fraction(1, 5),
    "gang": Fraction(1, 4),
    "unlike_units": True,
    "periods": (ms(10), ms(20)),
}
"""A value of each option of a generated set, other than those of a small set."""


def generated(**options):
    """The model, or why there is none."""
    small = {"units": 6} if "periods" in options else {"units": 6, "tasks": 8}
    parameters = SetParameters(**(small | options))
    try:
        refuse_unused(parameters, "generate")
        return generate(parameters, 1)
    except HalpipeError as refused:
        return [found.message for found in refused.diagnostics]


def test_no_option_of_a_generated_set_is_idle_alone_or_beside_another():
    assert SET.keys() == {each.attribute for each in options_of(SetParameters)}
    alone = {key: generated(**{key: value}) for key, value in SET.items()}
    assert generated() not in alone.values()
    both = {pair: generated(**{key: SET[key] for key in pair}) for pair in permutations(SET, 2)}
    assert [pair for pair in both if both[pair] == alone[pair[1]]] == []


# ------------------------------------------------------------------------------------------- without effect


@pytest.mark.parametrize(
    ("options", "idle"),
    [
        (exporter("arxml").options(ecu="Body"), "ecu"),
        (exporter("arxml").options(onto="p", mode="m"), "mode"),
        (exporter("arxml").options(part="system", tick=ms(1)), "tick"),
        (exporter("ros").options(messages="oldest"), "messages"),
        (exporter("ros").options(graphs=("a.yaml",)), "graph"),
        (SearchOptions(engine="exact", budget=2), "budget"),
        (SizeOptions(units="cpu", bandwidth="dram"), "bandwidth"),
        (SizeOptions(units="cpu", wcet_factor=True), "wcet-factor"),
        (SizeOptions(bandwidth="dram", wcet_factor=True), "wcet-factor"),
        (SizeOptions(units="cpu", step=Fraction(1, 7)), "step"),
        (SizeOptions(units="cpu", mode="m", switches=True), "switches"),
        (SetParameters(periods=(ms(5),), tasks=3), "tasks"),
        (SetParameters(periods=(ms(5),), hyperperiod=ms(60)), "hyperperiod"),
        (SetParameters(resource_fill=Fraction(0), access_windows=5), "access-windows"),
        (SetParameters(access_windows=0, fractional=True), "fractional"),
        (SetParameters(resource_fill=Fraction(0), fractional=True), "fractional"),
    ],
)
def test_what_has_no_effect_beside_the_others_is_refused(options, idle):
    with pytest.raises(HalpipeError) as refused:
        refuse_unused(options, "verb")
    (found,) = refused.value.diagnostics
    assert (found.code, refused.value.exit) == ("HAL0025", Exit.USAGE)
    assert f'"{idle}"' in found.message


@pytest.mark.parametrize(
    ("kind", "options", "idle"),
    [
        ("linux", CheckOptions(seed=2), "seed"),
        ("linux", CheckOptions(inject="all"), "inject"),
        ("riscv", CheckOptions(seed=2), "seed"),
        ("regulator", CheckOptions(modelled=True), "modelled"),
        ("regulator", CheckOptions(cycles=1, seconds=2), "seconds"),
        ("linux", CheckOptions(seconds=2), ""),
        ("riscv", CheckOptions(modelled=True, inject="all"), ""),
        ("regulator", CheckOptions(seed=2), ""),
    ],
)
def test_a_bundle_has_the_options_of_its_kind(kind, options, idle, monkeypatch):
    class PlayedError(Exception):
        pass

    def play(target, options):
        raise PlayedError

    target = SimpleNamespace(bundle=SimpleNamespace(kind=kind), schedule=SimpleNamespace(modes=()))
    checker = formats.deployment(kind)
    monkeypatch.setattr(type(checker), "check", lambda self, target, options: play(target, options))
    monkeypatch.setattr(formats, "open_target", lambda path: target)
    monkeypatch.setattr(formats, "_cycles", lambda schedule, seconds: 1)
    with pytest.raises(HalpipeError if idle else PlayedError) as ended:
        formats.check_bundle("bundle", options)
    assert f'"{idle}"' in str(ended.value) or not idle


@pytest.mark.parametrize(
    "options",
    [
        exporter("arxml").options(onto="p", ecu="Body"),
        exporter("arxml").options(tick=ms(1)),
        exporter("ros").options(package=True, messages="oldest", graphs=("a",)),
        ExportOptions(mode="m"),
        ImportOptions(name="n"),
        SearchOptions(engine="exact"),
        SizeOptions(units="cpu", switches=True),
        SizeOptions(bandwidth="dram", step=Fraction(1, 7)),
        SizeOptions(wcet_factor=True, mode="m"),
        SetParameters(periods=(ms(5),)),
    ],
)
def test_what_has_an_effect_is_taken(options):
    refuse_unused(options, "verb")


# ------------------------------------------------------------------------------------------------- plug-ins


@record(kw_only=True)
class PluginOptions(ImportOptions):
    dialect: str = option("old", "Which dialect.", Words("old", "new"))


def test_an_importer_of_others_brings_its_own_options(monkeypatch, tmp_path):
    class Plugin:
        name, summary, options = "plugin", "a plug-in", PluginOptions

    monkeypatch.setattr(formats, "registered", lambda group, name: Plugin)
    monkeypatch.setitem(KINDS, ("import", "plugin"), PluginOptions)
    plan = plan_with(tmp_path, "import", "plugin", {"dialect": "new"})
    assert plan.imports.options.dialect == "new"
    with pytest.raises(TypeError, match="has no option 'ecu'"):
        halpipe.import_model("plugin", "a", ecu="Body")


# ----------------------------------------------------------------------------------------- values of Python


@pytest.mark.parametrize(
    "options",
    [
        {"engine": "zz"},
        {"budget": -5},
        {"budget": True},
        {"seed": 1.5},
        {"time_limit": float("nan")},
        {"time_limit": -1},
        {"tick": "0ms"},
        {"optimise": "zz"},
        {"optimise": ["chains", "chains"]},
        {"modes": ["zz"]},
        {"near": 3.5},
        {"near": model(task("b", 10, version("v", 3)))},
        {"near": ""},
        {"workers": 0},
        {"workers": 1.5},
        {"workers": True},
    ],
)
def test_values_that_an_option_cannot_have_are_refused_as_such(options):
    with pytest.raises(HalpipeError) as refused:
        halpipe.schedule(model(task("a", 10, version("v", 3))), **options)
    assert refused.value.exit in (Exit.USAGE, Exit.FINDINGS)
    assert all(found.help for found in refused.value.diagnostics)


@pytest.mark.parametrize("tick", ["0ms", "-1ms", "", 5, True])
def test_a_tick_that_is_none_is_refused_by_validate(tick):
    with pytest.raises(HalpipeError) as refused:
        halpipe.validate(model(task("a", 10, version("v", 3))), tick)
    assert [found.code for found in refused.value.diagnostics] == ["HAL0023"]


@pytest.mark.parametrize(
    ("options", "code"),
    [({"units": "zz"}, "HAL1411"), ({"bandwidth": "zz"}, "HAL1411"), ({"mode": "zz"}, "HAL0802")],
)
def test_a_size_is_asked_of_what_the_model_has(options, code):
    with pytest.raises(HalpipeError) as refused:
        halpipe.size(model(task("a", 10, version("v", 3))), **options)
    assert ([found.code for found in refused.value.diagnostics], refused.value.exit) == ([code], Exit.USAGE)


def test_a_sensitivity_is_that_of_tasks_of_the_model():
    system = model(task("a", 10, version("v", 3)))
    schedule = halpipe.schedule(system)
    with pytest.raises(HalpipeError, match='no task "zz"'):
        halpipe.sensitivity(system, schedule, tasks=["a", "zz"])
    assert [row.task for row in halpipe.sensitivity(system, schedule, tasks=["a"])] == ["a"]


def test_several_wrong_values_are_reported_together():
    with pytest.raises(HalpipeError) as refused:
        halpipe.schedule(model(task("a", 10, version("v", 3))), engine="zz", budget=0)
    assert len(refused.value.diagnostics) == 2


class Number:
    """An integer of another library: it is no int, but prints as one."""

    def __str__(self):
        return "7"


@pytest.mark.parametrize("seed", [7, "7", Number()])
def test_values_may_be_of_other_types_that_read_as_theirs(seed):
    assert halpipe.schedule(model(task("a", 10, version("v", 3))), seed=seed).seed == 7


@pytest.mark.parametrize("limit", [30, 30.0, "30s", "30", "30000ms"])
def test_a_time_limit_has_a_unit_or_counts_seconds(limit):
    (read,) = from_keywords("schedule", SearchOptions, {"time_limit": limit}).values()
    assert read == ms(30000)


@pytest.mark.parametrize("value", [True, b"drive", {"drive": 1}, ["drive"], ("drive",), {"drive"}])
def test_what_stands_for_no_text_is_refused(value):
    with pytest.raises(HalpipeError, match=r"mode: .* is a "):
        from_keywords("explain", ExplainOptions, {"mode": value})


@pytest.mark.parametrize("named", ["chains", "chains,jitter", ["chains", "jitter"]])
def test_objectives_are_a_list_or_a_text(named):
    (read,) = from_keywords("schedule", SearchOptions, {"optimise": named}).values()
    assert read[0].value == "chains"


def test_both_spellings_of_a_list_are_one_too_many():
    with pytest.raises(TypeError, match="give one"):
        from_keywords("schedule", SearchOptions, {"mode": "a", "modes": ["b"]})


def test_what_is_required_must_be_given():
    with pytest.raises(TypeError, match="requires the option 'platform'"):
        halpipe.export("regulator", model(task("a", 10, version("v", 3))))
