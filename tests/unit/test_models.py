"""Elements of models and schedules: where they stand is no part of them, and what they say of themselves."""

import inspect
import sys
from array import array
from dataclasses import dataclass, field, fields, is_dataclass, replace
from fractions import Fraction
from types import SimpleNamespace

import numpy as np
import pytest

import halpipe.models
from halpipe.core.diagnostics import Exit, HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.models import (
    Anchor,
    Chain,
    HealthRule,
    Match,
    Mode,
    Part,
    Precedence,
    Resource,
    Run,
    Split,
    TaskModel,
    Transfer,
    Transition,
    Version,
)
from halpipe.models.attributes import children, held
from halpipe.models.modes import require_mode, require_names, tour
from halpipe.models.project import Call, Item, Project, Starter, Value
from halpipe.models.trace import NONE, BoundCallback, Execution, Executions, Trace, column, groups, plain
from regulator_bundles import switch
from support import job, mode, model, ms, schedule, task, version

AT = Location("m.xml", 3)
KINDS = [
    kind
    for module in (halpipe.models.system, halpipe.models.schedule, halpipe.models.trace)
    for _, kind in inspect.getmembers(module, is_dataclass)
    if isinstance(kind, type)
]


@pytest.mark.parametrize("kind", [kind for kind in KINDS if "at" in {field.name for field in fields(kind)}])
def test_where_an_element_stands_is_neither_compared_nor_shown(kind):
    hidden = [field for field in fields(kind) if field.name in ("at", "digest")]
    assert [field.name for field in hidden if field.compare or field.repr] == []


def test_models_from_two_files_may_be_equal():
    first = model(task("a", 10, version("v", 1)))
    second = replace(first, tasks=(replace(first.tasks[0], at=AT),), at=AT).read_from("0" * 64)
    assert first == second
    assert repr(first) == repr(second)
    assert (second.digest, second.at, replace(second, name="n").digest) == ("0" * 64, AT, "")


# ------------------------------------------------------------------------------------------------ elements


def test_what_an_element_does_not_state():
    """Files leave these out, and Python may."""
    assert (Chain(name="c", tasks=["a"]).weight, Version(name="v").gang) == (1, 1)
    rule = HealthRule(task="a", mode="m")
    assert (rule.count, rule.cycles) == (1, 1)
    split = Split()
    assert (split.is_allowed, split.resume, split.max_gaps) == (False, Duration(0), None)
    callback = BoundCallback("n", "timer")
    assert (callback.period, callback.order, callback.longest) == (0, 0, 0)
    assert Trace(name="t", executions=()).is_shared is False
    item = Item("/a/b", False, "d", "c", "", AT)
    assert (item.is_added, item.name) == (False, "b")
    assert Value("n", "t", AT).is_generated is False
    assert Call(mapping="m", event="e", is_bsw=False, os_task="o").has_period is True
    assert Starter(path="p", is_table=True, deeds=()).is_coded
    starter = Starter(path="p", is_table=True, deeds=(), autostart="/a")
    assert (starter.is_coded, starter.is_kept, starter.is_used, starter.cycle, starter.start) == (
        False,
        False,
        False,
        "0",
        "0",
    )
    assert not Starter(path="p", is_table=True, deeds=(), calls=("/a",)).is_coded


def test_a_split_grows_with_its_version():
    split = Split(points=["2ms", "4ms"], resume="1ms", min_part="3ms").scaled(Fraction(3, 2))
    assert (split.points, split.resume, split.min_part) == ((ms(3), ms(6)), ms(1), ms("4.5"))
    assert Split(anywhere=True).scaled(Fraction(2)).min_part is None


@pytest.mark.parametrize(
    ("stated", "words", "is_plain"),
    [
        ({}, "after the end of a", True),
        ({"anchor": Anchor.START}, "after the start of a", True),
        ({"to": Anchor.END}, "after the end of a, until the end", False),
        ({"match": Match.CYCLE}, "after the end of a of the same cycle", False),
        ({"anchor": Anchor.POINT, "point": "2ms"}, "after the instant 2ms of the execution of a", False),
    ],
)
def test_a_precedence_in_words(stated, words, is_plain):
    row = Precedence(task="a", **{"anchor": Anchor.END, "max": "5ms"} | stated)
    assert (row.words, row.is_plain) == (words, is_plain)


@pytest.mark.parametrize(
    ("change", "names"),
    [
        ({}, []),
        ({"anchor": Anchor.START}, []),
        ({"to": Anchor.END}, ['constraint of task "a" from end to end']),
        ({"anchor": Anchor.POINT, "point": "1ms"}, ['constraint of task "a" from point to start']),
        ({"match": Match.CYCLE}, ['constraint of task "a" on the same cycle']),
    ],
)
def test_requirements_beyond_windows_of_starts_are_named(change, names):
    row = Precedence(task="a", **{"anchor": Anchor.END, "max": "5ms"} | change)
    a = task("a", 10, replace(version("v", 1), precedences=(row,)))
    assert [name for name, _ in model(a).refinements()] == names


def test_edges_let_and_events_of_chains_are_named():
    a = replace(task("a", 10, version("v", 1)), let=ms(5), at=AT)
    plain_chain, timed = Chain(name="c", tasks=["a"], max_age="5ms"), Chain(name="d", tasks=["a"], max_latency="5ms")
    closed = Mode(name="m", edge="closed", runs=[Run(task="a", versions=["v"])])
    system = replace(model(a), chains=(plain_chain, timed), modes=(closed,))
    assert list(system.refinements()) == [
        ('closed edge of mode "m"', Location()),
        ('logical execution time of task "a"', AT),
        ('events or latency of chain "d"', Location()),
    ]


def test_all_pairs_of_modes_may_be_switched_where_none_is_listed():
    a = task("a", 10, version("v", 1))
    three = model(a, modes=[mode(name, [a]) for name in "xyz"])
    pairs = [(t.source, t.target) for t in three.allowed_transitions()]
    assert pairs == [("x", "y"), ("x", "z"), ("y", "x"), ("y", "z"), ("z", "x"), ("z", "y")]
    listed = replace(three, transitions=(Transition(source="z", target="x"),))
    assert list(listed.allowed_transitions()) == list(listed.transitions)
    alone = listed.alone("z", "x")
    assert ([m.name for m in alone.modes], alone.transitions) == (["x", "z"], ())


def test_a_task_runs_in_the_modes_that_are_named_else_in_all():
    system = TaskModel(name="m").add_task("a", wcet="1ms", units="u", modes=["x", "y"])
    both = system.add_task("b", wcet="1ms", units="u")
    assert {m.name: [run.task for run in m.runs] for m in both.modes} == {"x": ["a", "b"], "y": ["a", "b"]}
    one = both.add_task("c", wcet="1ms", units="u", modes=["y"])
    assert {m.name: len(m.runs) for m in one.modes} == {"x": 2, "y": 3}


def test_names_that_there_are_not_are_refused_with_those_that_there_are():
    system = model(task("a", 10, version("v", 1)), task("bb", 10, version("v", 1)))
    with pytest.raises(KeyError, match='there is no "c"; there are a, bb'):
        system.task("c")
    require_names(["a"], ["a", "bb"], "task")
    with pytest.raises(HalpipeError) as refused:
        require_names(["a", "b", "zz"], ["a", "bb"], "task")
    assert refused.value.exit is Exit.USAGE
    assert [(d.message, d.help) for d in refused.value.diagnostics] == [
        ('the model has no task "b"', 'did you mean "bb"?'),
        ('the model has no task "zz"', "the model has: a, bb"),
    ]
    require_mode("all", system.modes)
    with pytest.raises(HalpipeError) as refused:
        require_mode("zzz", system.modes)
    assert refused.value.exit is Exit.USAGE
    assert refused.value.diagnostics[0].help == "the modes are all"


def test_a_tour_takes_the_nearest_switch_that_was_not_taken():
    tables = [switch(*pair, 1, 1, ()) for pair in ("ab", "bc", "ca", "ac", "de")]
    untaken = {(t.source, t.target): None for t in tables}
    assert "".join(tour("a", tables, untaken)) == "bcac"
    assert list(untaken) == [("d", "e")]
    assert list(tour("a", tables, untaken)) == []


def test_a_tour_leads_over_switches_that_were_taken_to_one_that_was_not():
    tables = [switch(*pair, 1, 1, ()) for pair in ("ab", "ba", "bc", "cb", "cd")]
    assert "".join(tour("a", tables, {(t.source, t.target): None for t in tables})) == "babcbcd"


# ------------------------------------------------------------------------------------------------ values given


def test_a_size_may_be_a_text_and_no_other_number_may():
    assert Transfer(buffer="b", symbol="s", size="1KiB").size == 1024
    assert Resource(name="r", bandwidth="1GB/s").bandwidth == 10**9
    with pytest.raises(TypeError, match="give a whole number"):
        Version(name="v", gang="1")
    with pytest.raises(TypeError, match="True is a bool"):
        Version(name="v", gang=True)


def test_lists_become_tuples_and_tuples_stay():
    units = ("u", "w")
    assert Version(name="v", units=units).units is units
    assert Version(name="v", units=["u", "w"]).units == units
    assert Version(name="v", units=iter(units)).units == units
    split = Split(points=("1ms", Duration.parse("2ms")))
    assert split.points == (ms(1), ms(2))
    for wrong in ("u", b"u", 5):
        with pytest.raises(TypeError, match=r"Version.units: .*; give a list, of which each is a text"):
            Version(name="v", units=wrong)
    with pytest.raises(TypeError, match=r"Version.units: in the list, 3 is a int"):
        Version(name="v", units=("u", 3))


def test_one_field_of_the_wrong_type_is_found_beside_others_that_are_right():
    a = model(task("a", 10, version("v", 1))).tasks[0]
    for _ in range(2):
        with pytest.raises(TypeError, match=r"Task.period"):
            replace(a, period=5)
        assert replace(a, period="7ms").period == ms(7)


# ------------------------------------------------------------------------------------------------ schedules


def test_a_job_occupies_its_units_in_its_parts():
    system = model(task("a", 10, version("v", 3)))
    whole = job(system, "a", 0, 2, "u1")
    assert whole.occupations() == ((ms(2), ms(5)),)
    parts = (
        Part(start=ms(2), end=ms(3), executed_from=ms(0), executed_to=ms(1)),
        Part(start=ms(6), end=ms(8), executed_from=ms(1), executed_to=ms(3)),
    )
    assert replace(whole, end=ms(8), parts=parts).occupations() == ((ms(2), ms(3)), (ms(6), ms(8)))


@pytest.mark.parametrize(
    ("margin", "bound", "words"),
    [
        (None, None, ""),
        ("1/4", "1/4", "25 %, the best possible"),
        ("1/4", "1/3", "25 %, at most 33.4 % is possible"),
        ("1/4", None, "25 %"),
        ("0", "1/3", "none found, at most 33.4 % is possible"),
    ],
)
def test_a_margin_in_words(margin, bound, words):
    system = model(task("a", 10, version("v", 3)))
    (table,) = schedule(system, 10, job(system, "a", 0, 0, "u1")).modes
    stated = {
        name: None if value is None else Fraction(value)
        for name, value in (("margin", margin), ("margin_bound", bound))
    }
    assert replace(table, **stated).margin_words == words


def test_the_jobs_of_modes_come_before_those_of_switches():
    system = model(task("a", 10, version("v", 3)))
    plan = schedule(system, 10, job(system, "a", 0, 0, "u1"))
    plan = replace(plan, transitions=(replace(switch("all", "all", 1, 1, ()), jobs=(job(system, "a", 0, 5, "u1"),)),))
    assert [each.start for each in plan.all_jobs()] == [ms(0), ms(5)]
    assert plan.alone(plan.modes).transitions == ()


class Axes:
    """Axes of a drawing, which note what is drawn."""

    def __init__(self, **stated):
        self.stated, self.bars, self.limits = stated, [], ()

    def broken_barh(self, spans, height, **style):
        self.bars += [(*span, height, style["color"], style["label"]) for span in spans]

    def get_legend_handles_labels(self):
        return [1, 2], ["a", "b"]

    def legend(self, *handles, **_):
        self.stated["legend"] = [list(each) for each in handles]

    def set(self, **facts):
        self.stated |= facts

    def set_xlim(self, *limits):
        self.limits = limits


def test_a_drawing_has_a_line_for_each_unit_and_a_colour_for_each_task(monkeypatch):
    pyplot = SimpleNamespace(subplots=lambda **stated: (None, Axes(**stated)))
    monkeypatch.setitem(sys.modules, "matplotlib", SimpleNamespace(pyplot=pyplot))
    monkeypatch.setitem(sys.modules, "matplotlib.pyplot", pyplot)
    system = model(task("a", 10, version("v", 3, "u1 u2", gang=2)), task("b", 10, version("v", 2, "u2")), units="u1 u2")
    first = schedule(system, 10, job(system, "a", 0, 0, "u1 u2"), job(system, "b", 0, 5, "u2"), mode_name="x")
    second = schedule(system, 20, job(system, "b", 0, 1, "u2"), mode_name="y")
    plan = replace(first, modes=(*first.modes, *second.modes))
    axes = plan.plot()
    low, high = (-0.4, 0.8), (0.6, 0.8)
    assert sorted(axes.bars) == [(0.0, 3.0, low, "C0", "a"), (0.0, 3.0, high, "C0", "a"), (5.0, 2.0, low, "C1", "b")]
    assert axes.stated["figsize"] == (10, 2)
    assert (list(axes.stated["yticks"]), axes.stated["yticklabels"], axes.stated["title"]) == (
        [0, 1],
        ["u2", "u1"],
        "x",
    )
    assert axes.stated["legend"] == [[1, 2], ["a", "b"]]
    assert axes.limits == (0, 10)
    other = plan.plot("y")
    assert (other.bars, other.stated["title"], other.limits) == ([(1.0, 2.0, low, "C0", "b")], "y", (0, 20))


def test_elements_within_others_have_the_tag_that_is_stated_or_the_name_of_their_class():
    @dataclass
    class Holder:
        rules: tuple = field(default=(), metadata=held(HealthRule))
        one: object = field(default=None, metadata=held(HealthRule, "own", section="all"))

    assert [(c.field, c.tag, c.kind, c.section, c.is_single) for c in children(Holder)] == [
        ("rules", "health-rule", HealthRule, "", False),
        ("one", "own", HealthRule, "all", True),
    ]


# ------------------------------------------------------------------------------------------------ recordings

LARGE = 2**61


@pytest.mark.parametrize("value", [LARGE - 1, 1 - LARGE, 0])
def test_instants_below_the_limit_are_numbers_of_64_bits(value):
    for values in ([value], array("q", [value])):
        assert column(values).dtype == np.int64
    assert column(array("q", [NONE, 1])).dtype == np.int64


@pytest.mark.parametrize("value", [LARGE, -LARGE])
def test_instants_at_the_limit_are_exact_numbers(value):
    for values in ([value], array("q", [value])):
        found = column(values)
        assert found.dtype == object
        assert plain(found[0]) * 8 == value * 8
    assert column([Fraction(1, 3)])[0] == Fraction(1, 3)


@pytest.mark.parametrize("largest", [3, 2**15 - 1, 2**15, 2**16 + 1])
def test_numbers_of_a_column_are_grouped_with_their_places(largest):
    found = {number: places.tolist() for number, places in groups(np.array([largest, 0, 2, 0, largest]))}
    assert found == {0: [1, 3], 2: [2], largest: [0, 4]}
    assert list(groups(np.array([], dtype=np.int64))) == []


def execution(name, start, end, **stated):
    return Execution(task=name, start=ms(start), end=ms(end), **stated)


def test_executions_are_read_back_from_their_columns():
    seen = [
        execution("b", 4, 6, units=("u",), busy=ms(1), table="m", cycle=2, job=0, has_data=False, planned=ms(3)),
        execution("a", 1, None, stretches=((ms(1), ms(2)),)),
        execution("b", Duration(Fraction(1, 3)), 2, units=("u", "w"), at=Location("t", 9)),
    ]
    found = Executions.of(seen)
    assert list(found) == [seen[2], seen[1], seen[0]]
    assert found[0].at.line == 9
    assert found[1:] == [seen[1], seen[0]]
    assert Executions.of(found) is found


def test_recordings_are_joined_with_their_own_names():
    first = Executions.of([execution("a", 5, 6)])
    paused = ((ms(1), ms(2)),), ((ms(3), ms("3.5")), (ms("3.7"), ms(4)))
    second = Executions.of(
        [execution("b", 3, 4, units=("w",), stretches=paused[1]), execution("a", 1, 2, stretches=paused[0])]
    )
    first.extend(second)
    first.sort()
    assert [(e.task, e.units, e.start) for e in first] == [("a", (), ms(1)), ("b", ("w",), ms(3)), ("a", (), ms(5))]
    assert [e.stretches for e in first] == [*paused, ()]
    first.extend(Executions.of([execution("a", Duration(Fraction(1, 3)), 1)]))
    first.sort()
    assert first[0].start == Duration(Fraction(1, 3))
    first.extend(second)
    first.sort()
    assert len(first) == 6


def test_a_copy_has_names_of_its_own():
    first = Executions.of([execution("a", 5, 6)])
    other = first.copy()
    other.detach()
    other.rename({0: "z"})
    other.run_on(0, ("w",))
    assert ([(e.task, e.units) for e in first], [(e.task, e.units) for e in other]) == ([("a", ())], [("z", ("w",))])


# ------------------------------------------------------------------------------------------------ projects


def test_the_os_tasks_of_a_task_are_those_of_its_events_or_its_own():
    calls = [
        Call(mapping=f"m{n}", event="e", is_bsw=False, os_task=path) for n, path in enumerate(("/x", "", "/x", "/y"))
    ]
    own = Call(mapping="", event="", is_bsw=False, os_task="/z")
    project = Project(
        schema="", os_module="", items={"/x": Item("/x", True, "", "", "", AT)}, packages={},
        calls={"a": tuple(calls)}, left_out=(), alone={"b": own}, tasks={}, counters=(), starters=(),
        applications={}, app_mode="", references={},
    )  # fmt: skip
    assert [project.os_tasks(name) for name in "abc"] == [["/x", "/y"], ["/z"], []]
    assert (project.place("/x"), project.place("/none")) == (AT, Location())
