"""Limit constants that are too large to be reached in a test: lowered, then tried at the limit and one beyond."""

import io
import json
from contextlib import redirect_stdout, suppress
from fractions import Fraction
from importlib import import_module
from unittest.mock import MagicMock

import pytest
from lowered_limits import ELEMENT, fake, named, patched, registry, try_both_sides

from halpipe.core.diagnostics import Findings, HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.core.files import parse_xml, parse_yaml
from halpipe.core.settings import Fields
from support import job, model, task, version

LIMITS, lowered = registry()


# ------------------------------------------------------------------------------------------------ core, cli, schemas


@lowered("cli.show:MOST_JOBS", 3, "--jobs lists them")
def jobs_of_a_shown_mode(count):
    show = named("cli.show:_show_mode")
    system = model(task("a", "25ms", version("full", "5ms", "u1")))
    jobs = tuple(job(system, "a", 0, "0ms", "u1") for _ in range(count))
    mode = fake(name="m", jobs=jobs, hyperperiod=Duration(10**9), status="valid")
    mode.unit_loads = mode.resource_loads = mode.chains = ()
    mode.margin_words = ""
    with redirect_stdout(io.StringIO()) as printed:
        show(mode, {"a": "A"}, every=False)
    return printed.getvalue()


@lowered(
    "core.files.reading:_MAX_SHOWN_BYTES", 10, "none", was_input=lambda name: True, read_bytes=lambda name: b"a\nb"
)
def bytes_of_a_file_whose_lines_are_shown(count):
    lines = named("core.files.reading:SourceLines")()
    module = import_module("halpipe.core.files.reading")
    original = module.os.path.getsize
    module.os.path.getsize = lambda name: count
    try:
        return lines(Location("f.xml", 2)) or "none"
    finally:
        module.os.path.getsize = original


@lowered("core.files.reading:MOST_BESIDE", 3, "nothing")
def files_beside_one_that_is_missing(count):
    module = import_module("halpipe.core.files.reading")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.os, "listdir", lambda _: [*(f"a{number}" for number in range(count - 1)), "model.xml"])
        found = module._unreadable("modle.xml", FileNotFoundError())
    return "" if "model.xml" in found.help else "nothing"


def explained(count):
    """Return how many of so many wrong units are explained."""
    from halpipe.schemas import TASK_MODEL, _explain, namespace

    units = "\n".join('<unit name="u" wrong="1"/>' for _ in range(count))
    text = f'<task-model xmlns="{namespace(TASK_MODEL)}"><platform>\n{units}</platform></task-model>'
    return len(_explain(parse_xml(text.encode(), "m.xml"), TASK_MODEL))


@lowered("schemas:MAX_EXPLAINED", 2, "fewer")
def violations_that_are_explained(count):
    return "" if explained(count) >= count else "fewer"


@lowered("schemas:MAX_EXPLAINED_ELEMENTS", 4, "fewer")
def elements_of_a_document_that_is_explained(count):
    return "" if explained(count - 2) else "fewer"


@lowered("pipeline.compare:MOST_NAMES", 3, "at most 3 are read")
def names_of_tasks_in_a_recording(count):
    found = fake(names=["t"] * count, task=range(count), row=lambda _: fake(at=Location("t.csv", 2)))
    try:
        with patched("pipeline.compare", Executions=fake(of=lambda _: fake(copy=lambda: found))):
            named("pipeline.compare:_known")(fake(executions=()), fake(all_jobs=lambda: ()), None, None)
    except HalpipeError as error:
        return str(error)
    except AttributeError:
        return ""  # the executions are none


# ------------------------------------------------------------------------------------------------ importers


@lowered(
    "importers.amalthea.build:MOST_TASKS",
    3,
    "at most 3 are read",
    load=lambda paths, _: paths,
    read_embedded=lambda *_: None,
    Forest=lambda paths, _: fake(within=lambda *_: paths, roots=[fake(at=Location())]),
)
def tasks_of_an_amalthea_model(count):
    try:
        named("importers.amalthea.build:_model")(range(count), None, None, None)
    except HalpipeError as error:
        return str(error)
    except AttributeError:
        return ""  # the forest has no hardware


@lowered(
    "importers.amalthea.modes:_MOST_MODES",
    6,
    "combinations",
    _system_labels=lambda forest: [forest.count],
    _literals=lambda forest, label: range(label),
    Names=MagicMock(),
)
def combinations_of_mode_labels(count):
    forest = MagicMock(count=count)
    with suppress(AttributeError):  # the literals are no items
        named("importers.amalthea.modes:read_modes")(forest)
    return " ".join(call.args[1] for call in forest.report_each.call_args_list)


@lowered(
    "importers.amalthea.stimuli:_MOST_OCCURRENCES",
    4,
    "none",
    _recurrence=lambda *_: Duration(1000),
)
def occurrences_of_a_burst(count):
    forest = fake(number=lambda *_: count, time=lambda _: None)
    return "" if named("importers.amalthea.stimuli:_burst")(forest, fake(one=lambda _: None)) else "none"


@lowered("importers.arxml.system.instances:MAX_INSTANCES", 5, "more than 5 component instances")
def instances_of_a_composition(count):
    named("importers.arxml.system.instances:_bounded")(iter(range(count)), fake(place=ELEMENT))


@lowered("importers.common.polling:_MOST_TRIES", 3, "not plain")
def divisors_tried_for_a_polling_period(count):
    hyperperiod = Duration(13 * 17)  # no part of it is plain before the 13th, of 17 ns
    first = 13 - count
    limit = hyperperiod / first
    found = named("importers.common.polling:polling_period")(limit * 5 / 4, [hyperperiod])
    return "" if found == Duration(17) else "not plain"


@lowered("importers.ros.dataflow:_MOST_LOOKS", 1, "cut")
def edges_looked_at(count):
    names = [f"n{number}" for number in range(count + 1)]
    left = named("importers.ros.dataflow:_undo")(
        [(names[0], name) for name in names[1:]], {name: [] for name in names}, lambda *_: False
    )
    return "cut" if left else ""


@lowered("importers.traces.ctf.metadata:_MOST_BYTES", 9, "more than 9")
def bytes_of_metadata(count):
    from halpipe.importers.traces.ctf.metadata import CtfError, text_of

    try:
        text_of(b" " * count)
    except CtfError as refused:
        raise ValueError(str(refused)) from None


@lowered("importers.traces.perfetto:MOST_TRACKS", 3, "at most 3 are read")
def tracks_with_slices(count):
    reader = named("importers.traces.perfetto:_Reader")("t.pftrace", Findings())
    for track in range(count):
        reader._event({9: [1], 11: [track]}, fake(names={}, track=0), 5)


@lowered("importers.traces.jobs:MOST_PROCESSES", 3, "at most 3 are read")
def processes_with_slices(count):
    events = [{"ph": "X", "ts": 1, "dur": 1, "pid": process, "name": "a"} for process in range(count)]
    named("importers.traces.slices:read")([json.dumps(events)], "t.json", Findings())


@lowered("importers.traces.read:MOST_COLUMNS", 3, "more than 3 columns")
def columns_of_a_recording(count):
    named("importers.traces.read:_reader")(",".join(("task", "start", "end", "more")[:count]), b"", "t.csv")


@lowered("importers.traces.read:_MOST_TEXT", 9, "too long a line")
def characters_of_a_line(count):
    list(named("importers.traces.read:_lines")(iter(["x" * count]), "t.csv", Findings()))


# ------------------------------------------------------------------------------------------------ targets


@lowered("deploy.linux.judging:_MOST_SWITCHES", 3, "incomplete")
def switches_of_a_run(count):
    modes = [fake(name=f"m{number}") for number in range(count)]
    ring = [fake(source=one.name, target=other.name) for one, other in zip(modes, modes[1:] + modes[:1], strict=True)]
    tour = named("deploy.linux.judging:_tour")(fake(modes=modes, transitions=ring))
    return "" if len(tour) == count else "incomplete"


@lowered("deploy.regulator.counters:MOST_WINDOWS", 7, "more than 7 windows")
def windows_of_a_row(count):
    table, unit = fake(name="m", index=0, successor=0, windows=1), fake(name="u")
    tables = fake(tables=[table], units=[unit], platform=fake(window_ns=1000))
    reader = named("deploy.regulator.counters:_Reader")(tables, "c.csv", "")
    findings = []
    list(reader.samples(f"unit,direction,bytes,start,end\nu,read,1,0,{count * 1000}\n", findings))
    return " ".join(found.message for found in findings)


@lowered(
    "deploy.riscv.judge.check:MOST_SAMPLES",
    5,
    "fewer",
    read_site=lambda _: None,
    recorded_inputs=lambda n, _: {"": "x" * n},
)
def recorded_inputs_that_are_played(count):
    played = named("deploy.riscv.judge.check:cycles_of")(fake(bundle=count), fake(cycles=0))
    return "" if played == count else "fewer"


@lowered("deploy.riscv.judge.tables:_MOST", 4, "fewer")
def rows_of_a_table(count):
    reader = fake(
        _releases={},
        _symbol=lambda name: 0,
        _at=lambda address, form: (0, 0, count, 0)[: len(form.unpack(bytes(form.size)))],
    )
    found = named("deploy.riscv.judge.tables:Tables").releases(reader, 0)
    return "" if len(found) == count else "fewer"


def platform(bus, burst):
    from halpipe.exporters.regulator.platform import _TOP, _Reader

    text = f"clock: 100MHz\nbus: {bus}B\nburst: {burst}B\n"
    text += "halpipe-regulator: 1\nwindow: 1ms\nguaranteed: 80MB/s\nunits: {u: {manager: 0}}"
    findings = Findings()
    _Reader(Fields("p.yaml", findings, parse_yaml(text.encode(), "p.yaml"), "platform", _TOP), "p.yaml", b"").platform()
    return " ".join(found.message for found in findings.items)


@lowered("exporters.regulator.platform:MAX_BEATS", 16, "more than an AXI burst")
def beats_of_a_burst(count):
    return platform(4, 4 * count)


@lowered("exporters.regulator.platform:MAX_BURST", 64, "more than an AXI burst")
def bytes_of_a_burst(count):
    return platform(1, count)


@lowered(
    "exporters.report.page:_MOST_REASONS",
    4,
    "1 other reasons",
    _read=lambda number: {
        "elements": [],
        "ignored": [{"reason": str(each)} for each in range(int(number))],
        "defaults": [],
    },
    _sources=lambda *_: [],
)
def reasons_of_a_report(count):
    found = named("exporters.report.page:build_account")(fake(), str(count))
    assert sum(times for _, times in found["reasons"]) == count
    return found["reasons"][-1][0]


# ------------------------------------------------------------------------------------------------ pipeline


@lowered("pipeline.explain.sharing:MAX_CLASSES", 4, "fewer")
def unit_sets_of_a_mode(count):
    sets = [frozenset(map(str, range(size))) for size in range(1, count + 1)]
    tasks = {str(units): fake(core=1, period=1, units=units) for units in sets}
    return "" if len(named("pipeline.explain.sharing:_classes")(fake(tasks=tasks))) == count else "fewer"


@lowered("pipeline.explain.windows:MAX_PAIRS", 3, "fewer")
def pairs_on_a_unit(count):
    tasks = {}
    for number in range(2 * count):  # a pair on each unit
        units = [f"u{number // 2}"]
        tasks[str(number)] = fake(name=str(number), core=1, period=10, late=0, sure_units=lambda units=units: units)
    found = named("pipeline.explain.windows:_apart")(fake(tasks=tasks), fake(trees=fake(root=lambda name: "")))
    return "" if len(list(found)) == count else "fewer"


@lowered("pipeline.explain.remedies:MAX_PIECES", 4, "fewer")
def pieces_of_a_task(count):
    one = task("a", "10ms", version("v", "1ms", "u"))
    return "" if named("pipeline.explain.remedies:_pieces")(None, one).most >= count - 1 else "fewer"


@lowered("pipeline.solve.edf.works:MAX_UNIT_SETS", 3, "fewer", service_of=lambda *_: (), interrupt_load=lambda _: 0)
def unit_sets_of_a_version(count):
    names = [f"u{number}" for number in range(count)]
    owner = fake(_windows=lambda _: (), units=None, unit_index=dict.fromkeys(names, 0), _way=lambda *way: way)
    kind = next(k for k in vars(import_module("halpipe.pipeline.solve.edf.works")).values() if hasattr(k, "_ways"))
    found = list(kind._ways(owner, fake(units=names, gang=1)))
    return "" if len(found) == count else "fewer"


@lowered("pipeline.solve.exactchains:_MOST", 9, "too large")
def keys_of_jobs(count):
    from halpipe.pipeline.solve import exactchains

    kind = next(k for k in vars(exactchains).values() if hasattr(k, "_chosen"))
    try:
        kind._chosen(MagicMock(_far=1), [], [], [], True, count - 1)
    except exactchains.TooLarge:
        return "too large"


@lowered("pipeline.solve.exactunits:MAX_SPLITS", 3, "some are left out")
def splits_of_a_gang(count):
    from halpipe.pipeline.solve import exactunits

    groups = [[f"u{number}"] for number in range(count)]
    splits = exactunits._splits(fake(units=[name for (name,) in groups], gang=1), groups)
    return "some are left out" if len(splits) > exactunits.MAX_SPLITS else ""


@lowered("pipeline.solve.groups:MOST_NAMED", 2, "and 1 more")
def names_of_a_group(count):
    return named("pipeline.solve.groups:_list")("task", [str(number) for number in range(count)])


@lowered("pipeline.stable:MOST_PUT_BACK", 3, "fewer")
def tasks_that_are_put_back(count):
    module = import_module("halpipe.pipeline.stable")
    source = next(
        f for f in vars(module).values() if "MOST_PUT_BACK" in getattr(getattr(f, "__code__", None), "co_names", ())
    )
    tried = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_moved_tasks", lambda *_: {str(number): 1 for number in range(count)})
        patch.setattr(module, "_without", lambda earlier, names: names)
        patch.setattr(module, "_better", lambda earlier, found, kept, solve: tried.append(kept) or found)
        source(*[fake(schedule=None)] * source.__code__.co_argcount)
    return "" if len(tried) == count else "fewer"


@lowered("pipeline.validate.context:_MAX_COMPARISONS", 6, "none")
def names_that_are_compared(count):
    known = ["abc"] * count
    found = named("pipeline.validate.context:Context")._near(fake(_suggested={}, _compared=0), "task", "abd", known)
    return "" if found else "none"


@lowered("pipeline.validate.context:_MAX_BITS", 5, "none")
def bits_of_a_hyperperiod(count):
    periods = [Duration(1), Duration(2 ** (count - 1))]
    tasks = {str(p): fake(task=fake(period=p), is_periodic=True) for p in periods}
    found = named("pipeline.validate.context:ActiveMode").hyperperiod.func(fake(tasks=tasks))
    return "" if found == periods[1] else "none"


@lowered("pipeline.validate.hyperperiod:MAX_DEMANDS", 20, "demands multiply")
def jobs_on_demand(count):
    mode = fake(tasks={"a": fake(is_periodic=True), "b": fake(is_periodic=False)}, mode=ELEMENT, path="")
    found = named("pipeline.validate.hyperperiod:_many_demands")(mode, {"a": 1, "b": count})
    return " ".join(each.message for each in found)


@lowered("pipeline.validate.hyperperiod:_MAX_MISFIT", 7, "guilty")
def misfit_of_a_period(count):
    periods = {"a": count, "b": count + 1}
    tasks = {name: fake(task=fake(period=Duration(p), distance=None), is_periodic=True) for name, p in periods.items()}
    mode = fake(tasks=tasks, order=list(tasks), named={"a": {}, "b": {}})
    return "guilty" if named("pipeline.validate.hyperperiod:_find_cause")(mode).guilty else ""


@lowered("pipeline.validate.hyperperiod:_MAX_SNAPPED", 2, "make the periods multiples")
def guilty_periods_that_are_cured(count):
    base = Duration(10**7)
    guilty = tuple(base + Duration(number) for number in range(1, count + 1))
    periods = (base, *guilty)
    cause = named("pipeline.validate.hyperperiod:_Cause")(
        guilty, base, 1, dict.fromkeys(periods, 1), {each: ["a"] for each in periods}, {}
    )
    return cause.cure()


@lowered("pipeline.validate.load:_MAX_CLASSES", 3, "alone")
def classes_of_a_mode(count):
    classes = {frozenset(map(str, range(size))): [size] for size in range(1, count + 1)}
    needs = named("pipeline.validate.load:_needs_within")
    found = needs(classes, max(classes, key=len), False)
    assert len(needs(classes, max(classes, key=len), True)) == count  # all units: whatever the number of classes
    return "" if len(found) == count else "alone"


WORK_OF_STEPS = {3: 57, 4: 58}
"""Work whose length beside these interrupts is found in so many steps, counted by hand."""


@lowered("pipeline.verify.ticks:MAX_EFFORT", 3, "none", FEW_STEPS=0)
def steps_of_a_check(count):
    service = named("pipeline.verify.ticks:Service")([(10, 5), (7, 2)])
    return "none" if service.length(WORK_OF_STEPS[count]) is None else ""


@lowered("pipeline.verify.ticks:MAX_STEPS", 3, "none", FEW_STEPS=10)
def steps_of_a_length(count):
    service = named("pipeline.verify.ticks:Service")([(10, 5), (7, 2)])
    return "none" if service.length(WORK_OF_STEPS[count]) is None else ""


@lowered("pipeline.parts:MAX_STEPS", 3, "no length is found")
def steps_of_a_reserved_length(count):
    named("pipeline.parts:reserved_length")({3: 1, 4: 2}[count], [(10, 5), (7, 2)])


# ------------------------------------------------------------------------- names that stand in several modules


@lowered("exporters.report.axis:MAX_TICKS", 4, "coarser")
def ticks_of_an_axis(count):
    return "" if named("exporters.report.axis:_coarse_step")(Duration(count)) == 1 else "coarser"


@lowered("exporters.trace.events:MAX_CYCLES", 3, "left out", unroll=MagicMock(), Window=MagicMock())
def cycles_of_a_drawn_mode(count):
    """The cycles that a constraint reaches back, and its own."""
    writer = MagicMock(left_out=0)
    with patched("exporters.trace.events", links=lambda *_: [fake(cycles=count - 1)]):
        named("exporters.trace.events:_TraceWriter").mode(writer, MagicMock())
    return "left out" if writer.left_out else ""


@lowered("importers.amalthea.chains:_MOST_LEVELS", 3, "more than 3 chains")
def levels_of_chains(level):
    forest = named("importers.amalthea.xmi:Forest")((), Findings())
    reader = fake(forest=forest, _open=set(range(level)), _known={}, _made=lambda item: [])
    named("importers.amalthea.chains:_Reader")._ways(reader, MagicMock(at=Location(), path="c"))


@lowered("importers.amalthea.chains:_MOST_EVENTS", 3, "more than 3 ways and events")
def events_along_chains(count):
    forest = named("importers.amalthea.xmi:Forest")((), Findings())
    reader = fake(forest=forest, _open=set(), _known={}, _made=lambda item: [fake(events=range(count - 1))])
    named("importers.amalthea.chains:_Reader")._ways(reader, MagicMock(at=Location(), path="c"))


@lowered("importers.amalthea.graph:_MOST_LEVELS", 3, "more than 3 calls", steps=lambda runnable: ())
def levels_of_calls(depth):
    made = named("importers.amalthea.graph:Evaluator")
    forest = named("importers.amalthea.xmi:Forest")((), Findings())
    reader = MagicMock(_known={}, _calling={}, _depth=depth, _forest=forest)
    reader._stop = lambda item: made._stop(reader, item)
    runnable = MagicMock(at=Location(), path="r")
    runnable.name = "r"
    made._call(reader, runnable, MagicMock(), MagicMock())


@lowered("importers.amalthea.stimuli:_MOST_LEVELS", 3, "more than 3 calls")
def levels_of_triggers(count):
    forest = named("importers.amalthea.xmi:Forest")((), Findings())
    triggers = MagicMock(_calling=set(range(count)), _forest=forest)
    conditions = fake(allows=lambda _: False)
    named("importers.amalthea.stimuli:Triggers")._call(triggers, None, MagicMock(at=Location(), path="r"), conditions)


@lowered("importers.amalthea.stimuli:MOST", 3, "too much")
def occurrences_of_one_runnable(count):
    triggers = fake(_step=lambda step, _: [step], is_too_much=False)
    found = named("importers.amalthea.stimuli:Triggers")._steps(triggers, range(count), None)
    assert len(found) == min(count, 3)
    return "too much" if triggers.is_too_much else ""


@lowered("importers.arxml.tasks.requirements:_MOST_STEPS", 3, "none")
def events_along_a_chain_of_arxml(count):
    segments = {str(n): fake(stimulus="s", response="r", segments=()) for n in range((count - 2) // 2)}
    chain = fake(stimulus="s", response="r", segments=tuple(segments))
    steps = named("importers.arxml.tasks.requirements:_Finder")._steps(fake(_chains=segments), chain)
    return "" if steps else "none"


@lowered("importers.arxml.system.instances:_MAX_DEPTH", 3, "more than 2 compositions")
def compositions_within_each_other(count):
    composition = fake(prototypes=[fake(place=ELEMENT, type="t")], place=ELEMENT)
    unfold = named("importers.arxml.system.instances:_unfold")
    assert list(unfold(composition, ("c",) * count, {}, {"t": ELEMENT}))


@lowered(
    "pipeline.explain.conflict:MAX_JOBS",
    3,
    "UNKNOWN",
    has_whole_jobs=lambda _: True,
    is_installed=lambda: True,
    is_small=lambda _: True,
    replace=lambda *_, **__: None,
    solve_expansion=lambda *_, **__: fake(status="searched"),
)
def jobs_of_a_mode_whose_conflict_is_sought(count):
    with patched("pipeline.explain.conflict", expand=lambda *_: fake(job_count=count, tasks=())):
        found = named("pipeline.explain.conflict:find_conflict")(fake(chains=()), fake(edge=None), bool)
        return repr(found).upper()


@lowered("pipeline.explain.meetings:MAX_UNITS", 3, "none", meet_in_groups=lambda *_: 1, _crowd=lambda *_: 1)
def units_of_a_simultaneous_demand(count):
    units = frozenset(map(str, range(count)))
    facts = fake(tasks={"a": fake(period=1, units=units, sure_units=lambda: (), core=0, name="a")})
    with patched("pipeline.explain.meetings", _parts=lambda *_: (None, [1])):
        return "" if list(named("pipeline.explain.meetings:crowds")(facts)) else "none"


@lowered("pipeline.solve.exact:MAX_JOBS", 3, "large")
def jobs_of_the_exact_engine(count):
    with patched("pipeline.solve.exactmodel", exact_tick=lambda _: Duration(1)):
        small = named("pipeline.solve.exact:is_small")(fake(job_count=count, hyperperiod=Duration(1)))
    return "" if small else "large"


@lowered("pipeline.solve.exact:MAX_TICKS", 3, "large")
def ticks_of_the_exact_engine(count):
    with patched("pipeline.solve.exactmodel", exact_tick=lambda _: Duration(1)):
        small = named("pipeline.solve.exact:is_small")(fake(job_count=1, hyperperiod=Duration(count)))
    return "" if small else "large"


def expansion_of(denominator):
    access = fake(resource="r", bound=Fraction(1, denominator))
    return fake(tasks=[fake(versions=[fake(accesses=[access])])])


@lowered("pipeline.solve.exactmodel:MAX_QUANTA", 3, "TooLarge")
def quanta_of_the_exact_engine(count):
    module = import_module("halpipe.pipeline.solve.exactmodel")
    access = expansion_of(count).tasks[0].versions[0].accesses[0]
    access.start = access.end = 0
    program = MagicMock(tasks={"a": [fake(versions=[(fake(accesses=[access]), None)])]})
    program.ticks.return_value = 0
    program.round_the_circle.return_value = []
    try:
        module.Program.state_resources(program)
    except module.TooLarge:
        return "TooLarge"
    return ""


@lowered("pipeline.solve.exactmodel:MAX_PARTS", 3, "TooLarge", solver_library=MagicMock())
def parts_of_the_exact_engine(count):
    module = import_module("halpipe.pipeline.solve.exactmodel")
    program = module.Program(MagicMock(hyperperiod=Duration(1)), MagicMock(), Duration(1))
    try:
        for _ in range(count):
            program.spend()
    except module.TooLarge:
        return "TooLarge"
    return ""


@lowered("pipeline.solve.limits:MOST_UNLIMITED", 3, "HAL0417")
def jobs_of_a_search_whose_end_is_open(count):
    system = model(*(task(f"t{number}", "25ms", version("v", "1ms", "u1")) for number in range(count)))
    try:
        named("pipeline.solve.limits:refuse_endless")(system)
    except HalpipeError as failure:
        return failure.diagnostics[0].code
    return ""


@lowered("pipeline.solve.one_mode:MOST_PARTS", 3, "coarser", Placement=MagicMock(), natural_tick=lambda _: Duration(12))
def parts_of_a_tick_for_margins(count):
    """The bound of a margin in so many parts is met; of more, the grid has no more than the limit."""
    bound, ticks = Fraction(1, count), []
    stated = {"tick": None, "options": fake(window=None), "expansion": fake(tasks=[1], job_count=1)}
    mode = MagicMock(**stated, spare=1, most_margin=bound)
    mode._stated.side_effect = lambda tick, *_, **__: ticks.append(tick) or fake(arrays=None)
    mode.widened = lambda begin, *_: begin(Fraction(1), 0, None)
    search = patched("pipeline.solve.kernel.search", Search=MagicMock())
    with patched("pipeline.solve.kernel.widen", reserved=MagicMock()), search:
        named("pipeline.solve.one_mode:_WholeJobs").raised(mode, (), 0)
    return "" if ticks == [Duration(12) / count] else "coarser"


@lowered("deploy.riscv.board.block_hook:MAX_WATCHED", 3, "fewer")
def addresses_at_which_a_core_stops(count):
    hart = fake(_page=fake(watched=[0] * count))
    named("deploy.riscv.board.hart:Hart").watch(hart, range(count))
    return "" if hart._page.watching == count else "fewer"


@lowered("pipeline.generate.tiling:_MOST_OF_A_KIND", 1, "fewer")
def bands_of_one_kind(count):
    """As many triples leave no column empty either."""
    structures = named("pipeline.generate.tiling:_structures").__wrapped__((0, 6, 0), alone=False)
    return "" if (0, 0, 0, count, 0, 0) in structures else "fewer"


@lowered("workbench.picture:MOST", 3, "fewer", formats=lambda _: (), scene=lambda *_, **__: {})
def deviations_that_the_page_lists(count):
    state = MagicMock(findings=[])
    session = MagicMock(shown=state, answered=MagicMock(seconds=None), past=(), future=())
    session.beside.return_value = fake(name="b", found=[*range(count)])
    return "" if len(named("workbench.picture:picture")(session)["beside"]["found"]) == count else "fewer"


@lowered("pipeline.solve.lanes:MAX_QUANTA", 3, "capped")
def quanta_of_a_resource(count):
    [found] = named("pipeline.solve.lanes:quanta_of")(expansion_of(count), ["r"]).values()
    return "" if found == count else "capped"


@lowered("pipeline.stable:MOST_NAMED", 3, "and 1 more", is_same=lambda *_: False, _jobs_of=lambda *_: {})
def tasks_that_move(count):
    jobs = [fake(task=f"t{number}") for number in range(count)]
    found = fake(modes=[fake(name="m", jobs=jobs)])
    return named("pipeline.stable:_told")(None, found, {}, {})[0].message


@lowered("pipeline.transitions.change:MOST_CYCLES", 3, "fewer")
def cycles_before_a_switch(count):
    found = named("pipeline.transitions.change:_Instants")._cycles(
        fake(_cycle=1, _first=None, _last=None), [0], 0, count - 1
    )
    return "" if len(found) == count else "fewer"


@lowered("pipeline.validate.accesses:MAX_BITS", 5, "more than 5 bits")
def bits_of_a_common_denominator(count):
    access = fake(resource="r", bound=Fraction(1, 2**count - 1), at=Location(), origin=None)
    context = fake(accesses_of_versions=[(None, None, access)])
    found = named("pipeline.validate.accesses:check_denominators")(context)
    return " ".join(each.message for each in found)


@lowered("pipeline.verify.tables:MAX_BITS", 5, "none")
def bits_of_the_scale_of_verify(count):
    return "" if named("pipeline.verify.tables:common_denominator")([2 ** (count - 1)]) else "none"


@lowered("pipeline.validate.precedence:MAX_CYCLES", 3, "fewer", _cycle=lambda *_: "found")
def cycles_that_are_reported(count):
    graph = {f"{side}{number}": [f"{'ba'[side == 'b']}{number}"] for number in range(count) for side in "ab"}
    return "" if len([*named("pipeline.validate.precedence:_cycles")(None, "", graph, None)]) == count else "fewer"


# ------------------------------------------------------------------------------------------------ the table


@pytest.mark.parametrize("name", LIMITS)
def test_a_lowered_limit_is_passed_and_refused_at_its_edge(name, monkeypatch):
    try_both_sides(LIMITS, name, monkeypatch)
