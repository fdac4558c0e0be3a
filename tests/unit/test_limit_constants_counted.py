"""Limit constants of counts within a computation: lowered, then tried at the limit and one beyond."""

from unittest.mock import MagicMock

import pytest
from lowered_limits import ELEMENT, fake, named, patched, registry, try_both_sides

from halpipe.core.diagnostics import Findings
from halpipe.core.durations import Duration
from halpipe.core.files import YamlMap, parse_xml
from halpipe.models import Binding, Job, ModeSchedule, Schedule, Status
from halpipe.models.trace import Execution, Trace
from halpipe.pipeline.compare import CompareOptions, compare
from halpipe.pipeline.validate import validate
from support import job, model, schedule, task, version

LIMITS, lowered = registry()


# ------------------------------------------------------------------------------------------------ formats


@lowered("schemas:MAX_ELEMENTS", 5, "slow")
def elements_whose_places_are_named(count):
    root = parse_xml(b"<a>" + b"<b/>" * (count - 1) + b"</a>", "m.xml")
    return "slow" if named("schemas:_could_be_slow")(root) else ""


@lowered("schemas:MAX_STEPS", 5, "slow")
def siblings_passed_by(count):
    """One more sibling of each element that is passed by."""
    text = {5: b"<a><b><c/></b><b/></a>", 6: b"<a><b/><b/><b/></a>"}[count]
    return "slow" if named("schemas:_could_be_slow")(parse_xml(text, "m.xml")) else ""


@lowered("exporters.arxml.export:MOST_WRITTEN", 4, "2 tasks and 3 jobs")
def tasks_and_jobs_of_an_arxml(count):
    system = model(task("a", 10, version("v", 1)), task("b", 10, version("v", 1), offset=5))
    jobs = [job(system, "a", 0, 0, "u1"), *(job(system, "b", n, 5, "u1") for n in range(count - 3))]
    named("exporters.arxml.export:_refuse_too_large")(system, schedule(system, 10, *jobs))


@lowered("importers.amalthea.chains:_MOST_WAYS", 3, "more than 3 ways")
def ways_through_a_chain(count):
    item = fake(all=lambda tag: [fake(tag=tag)], get=lambda name: "")
    reader = fake(
        forest=fake(ref=lambda *_: None),
        _chain=lambda link: link,
        _ways=lambda chain: [1] * count,
        _joined=lambda way, then: way,
        _closed=lambda ends, way: "closed",
    )
    with patched("importers.amalthea.chains", _ITEM_TAGS=("items",)):
        return repr(named("importers.amalthea.chains:_Reader")._made(reader, item))


@lowered("importers.amalthea.versions:_MOST_STEPS", 3, "whole")
def steps_through_a_runnable(count):
    """Groups are entered, but for the one at the limit, and then counted as a whole."""
    walk = MagicMock()
    walk._left = named("importers.amalthea.versions:_MOST_STEPS")
    inner = [fake(kind=named("importers.amalthea.versions:_ACCESS"))]
    with patched("importers.amalthea.versions", GROUPS=("Group",), steps=lambda _: [], everything=lambda *_: inner):
        named("importers.amalthea.versions:_Walk").through(walk, [fake(kind="Group")] * count)
    return "whole" if walk._whole.call_count > 1 else ""


PART = '<part start="{0}ms" end="{0}.5ms" from="{1}ms" to="{2}ms"/>'


@lowered("importers.native.schedule:MAX_PARTS", 3, "4 parts of one job")
def parts_of_a_job(count):
    parts = "".join(PART.format(number, number // 2, number // 2 + 1) for number in range(0, 2 * count, 2))
    text = f"""<schedule xmlns="urn:halpipe:schedule:1" model="m"><mode name="a" hyperperiod="99ms" status="valid">
    <job task="a" index="0" start="0ms" end="99ms" version="v" units="u">{parts}</job></mode></schedule>"""
    named("importers.native.schedule:parse_schedule")(text.encode(), "s.xml")


@lowered("importers.ros.caret:MAX_ELEMENTS", 3, "at most 3")
def entries_of_an_architecture(count):
    document = YamlMap(1)
    document.update(nodes=[{"node_name": "n", "callbacks": ["c"] * (count - 1)}])
    named("importers.ros.caret:_bound")(document, "g.yaml")


@lowered("importers.ros.dot:MAX_ELEMENTS", 3, "at most 3")
def vertices_of_a_graph(count):
    text = "digraph {" + " ".join(f"n{number};" for number in range(count)) + "}"
    named("importers.ros.dot:read_dot")(text, "g.dot", Findings())


@lowered("importers.ros.dataflow:_MOST_CUTS", 3, "at 1 more places")
def cuts_of_a_loop(count):
    cuts = {(Vertex(f"c{number}"), Vertex("d")): [] for number in range(count)}
    loop = fake(cuts=cuts, vertices=[Vertex("c", "callback")])
    with patched(
        "importers.ros.dataflow",
        _nodes=lambda *_: ["a", "b"],
        _ring=lambda *_: [],
        _place=lambda edge, _: edge[0].name,
        _shortened=lambda names, sign: sign.join(names),
    ):
        return named("importers.ros.dataflow:_report")(loop, fake(callbacks={"c": ELEMENT}), ()).message


class Vertex:
    """A vertex of a loop, which is a key of its cuts."""

    def __init__(self, name, kind="topic"):
        self.name, self.kind = name, kind


@lowered("importers.ros.structure:MOST_INSTANCES", 3, "more than 3 nodes")
def nodes_of_a_system(count):
    faults = []
    reader = MagicMock(malformed=lambda text, *_: faults.append(text))
    reader.entries.return_value = ()
    structure = MagicMock(instances=[], globals={})
    structure.catalogue.reader.return_value = reader
    with patched("importers.ros.structure", list_of=lambda *_: ()):
        for _ in range(count):
            named("importers.ros.structure:Structure")._enter(structure, fake(name="n", kind="node"), "/n", "", ())
    return " ".join(faults)


@lowered("importers.traces.tracedat:_MOST_CPUS", 3, "4 CPUs")
def cpus_of_a_recording(count):
    numbers = iter([0, 0, 0, count, *range(2 * count)])
    reader = MagicMock(_number=lambda size: next(numbers), _bytes=lambda size: b"flyrecord\0")
    with patched("importers.traces.tracedat", _refuse_clock=lambda *_: None, _unsigned=lambda *_: 0):
        found = named("importers.traces.tracedat:_Reader")._buffers(reader, "t.dat")
    assert len(found) == count


# ------------------------------------------------------------------------------------------------ targets


@lowered("exporters.regulator.tables:MAX_TABLES", 3, "4 modes and transitions need a table")
def tables_of_a_regulator(count):
    builder = fake(
        schedule=ELEMENT,
        model=fake(name="m", resources=()),
        resource="r",
        platform=fake(guaranteed=0),
        findings=Findings(),
    )
    named("exporters.regulator.tables:TableBuilder")._check_limits(builder, [None] * count)
    return " ".join(found.message for found in builder.findings.items)


@lowered("deploy.regulator.arithmetic:MAX_TABLES", 3, "4 tables, at most 3")
def tables_that_are_told_apart(count):
    tables = [fake(mode="m", is_transition=True)] * count
    checker = fake(tables=fake(tables=tables), _found=lambda code, text, *_: text)
    return " ".join(named("deploy.regulator.arithmetic:Arithmetic")._successors(checker))


@lowered("deploy.riscv.judge.check:MOST_CYCLES", 3, "works up to 3.0")
def cycles_of_an_instruction(count):
    """Found by halving: those of a target that is too slow beyond `count` cycles."""

    def simulate(target, tour, cpi):
        return fake(findings=[fake(is_error=True, code="c", path="p", message="m")] * (cpi >= count))

    with patched("deploy.riscv.judge.check", simulate=simulate, tours=lambda *_: [None]):
        first, *others = named("deploy.riscv.judge.check:margin_lines")(fake(schedule=None))
    assert first.startswith(f"works up to {'2.9' if count == 3 else '3.0'} cycles")
    assert bool(others) is (count == 3)
    return first


@lowered("deploy.riscv.judge.containment:MOST_SWITCHES", 3, "given up")
def switches_that_follow_from_each_other(count):
    """Rules that fire at other instants after each switch, `count` times."""
    seen = []

    def firings(*_):
        seen.append(1)
        return [fake(tick=min(len(seen), count - 1), rule=0)]

    action = named("deploy.riscv.judge.containment:HealthAction").SWITCH
    target = fake(model=fake(health=[fake(mode="m", action=action)]), schedule=None)
    with patched(
        "deploy.riscv.judge.containment",
        firings_of=firings,
        played_tables=lambda *_: [],
        events_of=lambda *_: [],
    ):
        named("deploy.riscv.judge.containment:course_of")(target, fake(tick=1), "m", [], 1, lambda played: ([], []))
    return "" if len(seen) == count else "given up"


# ------------------------------------------------------------------------------------------------ pipeline


@lowered("pipeline.jobs:MOST_SETS", 3, "u0")
def sets_of_common_units(count):
    """The second mode has no unit in common with the first, which is seen as long as all sets are carried."""
    first = [fake(units=[f"u{number}"], gang=1) for number in range(count)]
    return " ".join(sorted(map(str, named("pipeline.jobs:common_sets")([first, [fake(units=["v"], gang=1)]], 1))))


@lowered("pipeline.explain.sharing:MAX_ITEMS", 3, "fewer")
def tasks_that_share_units(count):
    one = fake(version=fake(gang=1))
    common = {"period": 10, "versions": [one], "task": fake(binding=Binding.JOB), "units": "u", "least": 1}
    tasks = {str(number): fake(name=str(number), **common) for number in range(count)}
    return "" if len([*named("pipeline.explain.sharing:_items")(fake(tasks=tasks))]) == count else "fewer"


@lowered("pipeline.explain.remedies:MOST_TICKS", 3, "None", expand=lambda *_: None, natural_tick=lambda _: Duration(10))
def ticks_of_a_remedy(count):
    changed = fake(mode=lambda name: None, tasks=[fake(period=Duration(10 * count - 1))])
    with patched("pipeline.solve.exactmodel", exact_tick=lambda _: Duration(10)):
        return str(named("pipeline.explain.remedies:Trials")._grid(fake(mode="m", jobs=1), changed))


@lowered("pipeline.explain.remedies:MAX_UNITS", 2, "several", _several_units=lambda *_: ["several"])
def units_that_are_added(count):
    trials = fake(schedule=lambda units: units if units >= count else None)
    changes = fake(more_units=lambda model, like, number: number)
    with patched("pipeline.explain.remedies", changes=changes, _kinds=lambda *_: {"u": "of type t"}):
        return " ".join(map(str, named("pipeline.explain.remedies:_units")(None, [], trials)))


@lowered("pipeline.explain.remedies:MAX_TASKS", 3, "together only")
def tasks_whose_offsets_are_moved_one_by_one(count):
    freed = []
    trials = fake(schedule=lambda names: freed.append([*names]))
    tasks = [fake(name=f"t{number}", offset=1, period=1) for number in range(count)]
    with patched("pipeline.explain.remedies", changes=fake(with_task=lambda model, names, offset: names)):
        assert [*named("pipeline.explain.remedies:_offsets")(None, tasks, trials)] == []
    return "" if len(freed) == count + 1 else "together only"


@lowered("pipeline.explain.meetings:MAX_SEEDS", 2, "()", _pairs=lambda *_: ())
def parts_from_which_a_meeting_grows(count):
    parts = [fake(length=10 - number, period=20, height=1, task="t") for number in range(count)]
    with patched("pipeline.explain.meetings", _grow=lambda first, *_: (first,) if first is parts[-1] else ()):
        return str(named("pipeline.explain.meetings:find_meeting")(parts, 0, None))


@lowered("pipeline.explain.meetings:MAX_HOLDERS", 3, "none", _crowd=lambda *_: 1)
def holders_of_units(count):
    """The group is found beside the holder that comes last."""
    tasks = {
        str(number): fake(period=1, units=frozenset("u"), sure_units=lambda: "u", core=number, name=str(number))
        for number in range(1, count + 1)
    }
    with patched(
        "pipeline.explain.meetings",
        _parts=lambda tasks, units, holder: (None, [holder]),
        meet_in_groups=lambda parts, _: (parts[0] and parts[0].core == 1) or None,
    ):
        return "" if list(named("pipeline.explain.meetings:crowds")(fake(tasks=tasks))) else "none"


@lowered("pipeline.compare.matching:_MOST_STRAYS", 1, "early")
def starts_before_the_zero(count):
    """Of 200 starts two may be strays, but for the limit."""
    job = Job(task="a", index=0, start=Duration(0), end=Duration(1), version="v", units=("u",))
    mode = ModeSchedule(name="m", hyperperiod=Duration(100), status=Status.VALID, jobs=(job,))
    starts = [100 * number - 10 * (number in range(50, 50 + count)) for number in range(200)]
    seen = tuple(Execution(task="a", start=Duration(at), end=Duration(at + 1)) for at in starts)
    plan = Schedule(model="m", model_sha256="", modes=(mode,))
    return "" if compare(plan, Trace(name="", executions=seen), CompareOptions()).origin == Duration(0) else "early"


@lowered("pipeline.generate.tiling:_MOST_ON_A_TASK", 3, "full")
def windows_of_a_generated_task(count):
    placer = MagicMock(_profiles=[], _on_unit=[1], _hyperperiod=1, windows=[[None] * (count - 1)])
    placer._task_at.return_value = 0
    placer._pieces.__getitem__.return_value = fake(period=1, start=0, length=1)
    placer._lengths.__getitem__.return_value = 1
    rng = MagicMock()
    rng.randrange.return_value = rng.choice.return_value = 1
    named("pipeline.generate.tiling:WindowPlacer")._place(placer, 1, rng)
    return "" if placer._pieces.__getitem__.called else "full"


@lowered("pipeline.validate.hyperperiod:MAX_JOBS", 3, "has 4 jobs, 3 are allowed")
def jobs_of_a_mode(count):
    tasks = [task("a", 1, version("v", "1us")), task("b", count - 1, version("v", "1us"))]
    return " ".join(found.message for found in validate(model(*tasks)))


@lowered("pipeline.validate.hyperperiod:MAX_TICKS", 4, "ticks or more")
def ticks_of_a_hyperperiod(count):
    """The limit itself is one too many."""
    return " ".join(found.message for found in validate(model(task("a", count - 1, version("v", 1)))))


def first_of(popular):
    """Return which of two rare periods comes first: one that fits the least popular of the others, or a shorter one."""
    primes = [Duration(value) for value in (3, 5, 7, 11, 13, 17, 19)[:popular]]
    counts = {period: 100 - 10 * number for number, period in enumerate(primes)}
    counts |= {Duration(23): 1, primes[-1] * 899: 1}
    order = named("pipeline.validate.hyperperiod:_by_fit")(counts)
    return next(period for period in order if counts[period] == 1)


@lowered("pipeline.validate.hyperperiod:_MAX_COMPARED", 3, "23ns")
def popular_periods_that_are_compared(count):
    return str(first_of(count))


@lowered("pipeline.validate.hyperperiod:_MAX_COMPARISONS", 15, "23ns")
def comparisons_of_periods(count):
    """Three popular periods of five are compared in 15 steps; four of six need 24."""
    return str(first_of({15: 3, 16: 4}[count]))


@lowered("pipeline.solve.edf.trials:MAX_PARTS", 3, "4 parts in a hyperperiod, 3 are allowed")
def parts_of_a_table(count):
    trials = fake(mode=fake(expansion=fake(mode=ELEMENT)))
    named("pipeline.solve.edf.trials:Trials")._refuse_crowds(trials, fake(part_count=count))


@lowered("pipeline.solve.edf.trials:MOST_CYCLES", 3, "False")
def hyperperiods_until_a_table_repeats(count):
    simulation = MagicMock()
    simulation.memory.lacks_room = False
    simulation.is_quiescent.return_value = False
    simulation.is_like_before.side_effect = lambda end, turn: turn == count
    simulator = fake(_mode=fake(hyperperiod=10))
    return str(named("pipeline.solve.edf.trials:Simulator")._close(simulator, simulation, 0))


# ------------------------------------------------------------------------------------------------ the table


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_of_a_count_is_passed_and_refused_at_its_edge(name, monkeypatch):
    try_both_sides(LIMITS, name, monkeypatch)
