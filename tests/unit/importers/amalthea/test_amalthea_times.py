"""Execution times, branches, modes, memory phases and valid units: what becomes the versions of a task."""

import pytest
from amalthea_case import HARDWARE, call, found, read, reasons, refusal, runnable, task, ticks, wcets

from halpipe.importers.amalthea import codes
from halpipe.importers.overlay import OverlayUse, read_overlays
from halpipe.importers.overlay.codes import REPLACED

A, B = "A?type=ProcessingUnitDefinition", "B?type=ProcessingUnitDefinition"


def items(*parts):
    return '<items xsi:type="am:Ticks">' + "".join(parts) + "</items>"


def value(tag, kind, key="", **attributes):
    stated = "".join(f' {name}="{text}"' for name, text in attributes.items())
    inner = f'xsi:type="am:{kind}"{stated}'
    return f'<extended key="{key}"><value {inner}/></extended>' if key else f"<{tag} {inner}/>"


@pytest.mark.parametrize(
    ("kind", "attributes", "expected"),
    [
        ("DiscreteValueConstant", {"value": 7}, "70ns"),
        ("DiscreteValueStatistics", {"lowerBound": 2, "upperBound": 8, "average": "2.5"}, "80ns"),
        ("DiscreteValueBoundaries", {"lowerBound": 2, "upperBound": 8}, "80ns"),
        ("DiscreteValueGaussDistribution", {"lowerBound": 1, "upperBound": 9, "mean": "3.0"}, "90ns"),
        ("DiscreteValueUniformDistribution", {"lowerBound": 1, "upperBound": 1.2e1}, "120ns"),
    ],
)
def test_the_wcet_is_the_upper_bound(tmp_path, kind, attributes, expected):
    sw = task("T", items(value("default", kind, **attributes)))
    assert wcets(read(tmp_path, sw=sw))["T"]["A"] == expected


def test_a_histogram_counts_by_its_last_bar(tmp_path):
    bars = '<entries lowerBound="1" upperBound="4"/><entries lowerBound="5" upperBound="6"/>'
    sw = task("T", items(f'<default xsi:type="am:DiscreteValueHistogram">{bars}</default>'))
    assert wcets(read(tmp_path, sw=sw))["T"]["A"] == "60ns"


def test_each_kind_of_unit_makes_a_version_with_its_own_ticks_or_the_default(tmp_path):
    one = items(value("", "DiscreteValueConstant", A, value=6), value("default", "DiscreteValueConstant", value=4))
    assert wcets(read(tmp_path, sw=task("T", one, ticks(2)))) == {"T": {"A": "80ns", "B": "30ns"}}


def test_a_kind_of_unit_for_which_a_runnable_states_no_ticks_cannot_run_the_task(tmp_path):
    only_b = items(value("", "DiscreteValueConstant", B, value=6))
    imported = read(tmp_path, sw=task("T", only_b, ticks(2)))
    assert wcets(imported) == {"T": {"B": "40ns"}}
    assert imported.model.task("T").versions[0].units == ("b0",)


def test_times_without_an_upper_bound_and_no_times_at_all_leave_the_wcet_open(tmp_path):
    unbounded = items('<default xsi:type="am:DiscreteValueGaussDistribution" mean="3.0" sd="1.0"/>')
    imported = read(tmp_path, sw=task("T", ticks(3), unbounded) + task("U"))
    assert wcets(imported) == {"T": {"A": "None", "B": "None"}, "U": {"default": "None"}}
    assert len(found(imported.diagnostics, codes.NO_WCET)) == 1


def test_a_unit_without_a_frequency_gives_no_time(tmp_path):
    imported = read(tmp_path, sw=task("T", ticks(3)), hw=HARDWARE.replace('value="0.2" unit="GHz"', ""))
    assert wcets(imported) == {"T": {"A": "30ns", "B": "None"}}
    assert [d.message for d in found(imported.diagnostics, codes.NO_FREQUENCY)] == [
        "1 processing units have no frequency: b0"
    ]


def test_units_of_one_type_at_two_frequencies_are_two_kinds(tmp_path):
    hw = HARDWARE.replace('name="a1" frequencyDomain="slow', 'name="a1" frequencyDomain="fast')
    imported = read(tmp_path, sw=task("T", ticks(4)), hw=hw)
    assert {v.name: (str(v.wcet), v.units) for v in imported.model.task("T").versions} == {
        "A": ("40ns", ("a0",)),
        "A~2": ("20ns", ("a1",)),
        "B": ("20ns", ("b0",)),
    }


def test_needs_are_divided_by_the_least_that_a_unit_gives_of_the_feature(tmp_path):
    need = '<items xsi:type="am:ExecutionNeed"><needs key="IPC"><value xsi:type="am:DiscreteValueConstant" value="30"/>'
    hw = HARDWARE.replace('name="A"/>', 'name="A" features="IPC/low?type=HwFeature IPC/high?type=HwFeature"/>')
    hw += '<featureCategories name="IPC"><features name="low" value="1.5"/><features name="high" value="3"/>'
    imported = read(tmp_path, sw=task("T", need + "</needs></items>"), hw=hw + "</featureCategories>")
    assert wcets(imported) == {"T": {"A": "200ns", "B": "150ns"}}


def test_calls_add_up_and_a_call_without_end_is_an_error(tmp_path):
    sw = task("T", call("R"), call("R")) + runnable("R", ticks(2), call("Q")) + runnable("Q", ticks(1))
    assert wcets(read(tmp_path, sw=sw))["T"]["A"] == "60ns"
    failure = refusal(read, tmp_path, sw=sw.replace(ticks(1), call("R")))
    assert ["R -> Q -> R" in d.message for d in found(failure.diagnostics, codes.RECURSION)] == [True]
    deep = "".join(runnable(f"R{i}", call(f"R{i + 1}")) for i in range(300)) + runnable("R300", ticks(1))
    failure = refusal(read, tmp_path, sw=task("T", call("R0")) + deep)
    assert len(found(failure.diagnostics, codes.RECURSION)) == 1


def test_a_loop_counts_once_and_says_so(tmp_path):
    loop = f'<items xsi:type="am:WhileLoop">{ticks(4)}</items>'
    imported = read(tmp_path, version="3.3.0", sw=task("T", loop))
    assert wcets(imported)["T"]["A"] == "40ns"
    assert len(found(imported.diagnostics, codes.LOOP)) == 1


def test_no_hardware_means_one_unit_for_all(tmp_path):
    imported = read(tmp_path, sw=task("T", ticks(4)), hw="")
    assert imported.model.task("T").versions[0].units == ("core0",)
    assert len(found(imported.diagnostics, codes.DEFAULT_UNIT)) == 1


def test_no_unit_is_assumed_where_the_overlay_names_units(tmp_path):
    (tmp_path / "o.yaml").write_text("halpipe-overlay: 1\nplatform: {units: [{name: big}]}\n")
    given = OverlayUse(read_overlays([str(tmp_path / "o.yaml")]))
    imported = read(tmp_path, sw=task("T", ticks(4)), hw="", overlay=given)
    assert not found(imported.diagnostics, codes.DEFAULT_UNIT)
    model, changes = given.apply(imported.model, imported.coverage)
    assert [unit.name for unit in model.units] == ["big"]
    assert not found(changes, REPLACED)


# ------------------------------------------------------------------------------------- branches and modes

MODES = '<modes xsi:type="am:EnumMode" name="M"><literals name="on"/><literals name="off"/></modes>'
LABEL = '<modeLabels name="state" mode="M?type=EnumMode" initialValue="on"/>'


def entry(literal, *steps, relation="EQUAL"):
    condition = f'<entries xsi:type="am:ModeValueCondition" label="state?type=ModeLabel" value="{literal}"'
    return f'<entries>{"".join(steps)}<condition>{condition} relation="{relation}"/></condition></entries>'


def switch(*entries, default=""):
    return f'<items xsi:type="am:Switch">{"".join(entries)}<defaultEntry>{default}</defaultEntry></items>'


def runs(imported):
    return {m.name: {r.task: r.versions for r in m.runs} for m in imported.model.modes}


def test_of_branches_that_chance_chooses_the_longest_counts(tmp_path):
    branches = f"<entries>{ticks(9)}</entries><entries>{ticks(4)}</entries>"
    imported = read(tmp_path, sw=task("T", f'<items xsi:type="am:ProbabilitySwitch">{branches}</items>', ticks(1)))
    assert wcets(imported)["T"]["A"] == "100ns"
    assert len(found(imported.diagnostics, codes.BRANCHES)) == 1


def test_a_label_that_something_sets_is_data(tmp_path):
    sets = '<items xsi:type="am:ModeLabelAccess" data="state?type=ModeLabel" access="set" value="off"/>'
    sw = task("T", switch(entry("on", ticks(9)), entry("off", ticks(4))), sets) + MODES + LABEL
    imported = read(tmp_path, sw=sw)
    assert (wcets(imported)["T"]["A"], list(runs(imported))) == ("90ns", ["default"])
    assert reasons(imported, "ModeLabel")["state"] == "is data of the tasks, not a mode of the system"


def test_a_label_that_nothing_sets_makes_modes_each_with_its_own_versions(tmp_path):
    sw = task("T", switch(entry("on", ticks(9)), default=ticks(4))) + MODES + LABEL
    imported = read(tmp_path, sw=sw)
    assert wcets(imported)["T"] == {"A:on": "90ns", "A:off": "40ns", "B:on": "45ns", "B:off": "20ns"}
    assert runs(imported) == {"on": {"T": ("A:on", "B:on")}, "off": {"T": ("A:off", "B:off")}}


def test_other_relations_and_several_conditions(tmp_path):
    sw = task("T", switch(entry("on", ticks(9), relation="NOT_EQUAL"), default=ticks(4))) + MODES + LABEL
    assert wcets(read(tmp_path, sw=sw))["T"]["A:on"] == "40ns"
    compared = '<entries xsi:type="am:ModeValueCondition" label="state?type=ModeLabel" value="{}"/>'
    never = f'<entries xsi:type="am:ConditionConjunction">{compared.format("on")}{compared.format("off")}</entries>'
    both = f"<entries>{ticks(9)}<condition>{never}</condition></entries>"
    imported = read(tmp_path, sw=task("T", switch(both, default=ticks(4))) + MODES + LABEL)
    assert wcets(imported)["T"]["A"] == "40ns"


def test_a_task_that_does_nothing_in_a_mode_does_not_run_in_it(tmp_path):
    sw = task("T", switch(entry("on", ticks(9)))) + task("U", ticks(1)) + MODES + LABEL
    assert {mode: list(tasks) for mode, tasks in runs(read(tmp_path, sw=sw)).items()} == {
        "on": ["T", "U"],
        "off": ["U"],
    }


def test_a_stimulus_that_is_active_in_a_mode_only_starts_its_task_there_only(tmp_path):
    condition = entry("off").removeprefix("<entries><condition>").removesuffix("</condition></entries>")
    stimuli = '<stimuli xsi:type="am:PeriodicStimulus" name="p10"><recurrence value="10" unit="ms"/></stimuli>'
    stimuli += f"""<stimuli xsi:type="am:PeriodicStimulus" name="s"><executionCondition>{condition}</executionCondition>
      <recurrence value="5" unit="ms"/></stimuli>"""
    sw = task("T", ticks(9)) + task("U", ticks(1), stimuli="s?type=PeriodicStimulus") + MODES + LABEL
    imported = read(tmp_path, sw=sw, stimuli=stimuli)
    assert {mode: list(tasks) for mode, tasks in runs(imported).items()} == {"on": ["T"], "off": ["T", "U"]}


def test_modes_that_make_no_difference_are_one(tmp_path):
    sw = task("T", switch(entry("on", ticks(9)), default=ticks(9))) + MODES + LABEL
    assert list(runs(read(tmp_path, sw=sw))) == ["default"]


def test_more_combinations_of_modes_than_can_be_meant_are_data(tmp_path):
    labels = "".join(f'<modeLabels name="state{i}" mode="M?type=EnumMode"/>' for i in range(7))
    switches = "".join(switch(entry("on", ticks(9))).replace("state?", f"state{i}?") for i in range(7))
    imported = read(tmp_path, sw=task("T", switches) + MODES + labels)
    assert list(runs(imported)) == ["default"]
    assert ["128 combinations" in d.message for d in found(imported.diagnostics, codes.TOO_MANY_MODES)] == [True]


# ----------------------------------------------------------------------------------------------- memory

MEMORY = (
    """<definitions xsi:type="am:MemoryDefinition" name="D"><dataRate value="1" unit="GBPerSecond"/></definitions>"""
)
LABELS = (
    '<labels name="in"><size value="4" unit="kB"/></labels><labels name="out"><size value="16" unit="bit"/></labels>'
)
MAPPED = "".join(
    f'<memoryMapping abstractElement="{name}?type=Label" memory="ram?type=Memory"/>' for name in ("in", "out")
)


def access(label, kind):
    return f'<items xsi:type="am:LabelAccess" data="{label}?type=Label" access="{kind}"/>'


def memory(*, width=64, latency=8, definition=MEMORY):
    """HARDWARE with a memory, and with a port and a path to it from a0 only."""
    path = f"""><ports name="p" bitWidth="{width}"/><accessElements destination="ram?type=Memory">
      <readLatency xsi:type="am:DiscreteValueConstant" value="{latency}"/>
      <writeLatency xsi:type="am:DiscreteValueConstant" value="{latency}"/></accessElements></modules>"""
    a0 = 'name="a0" frequencyDomain="slow?type=FrequencyDomain" definition="A?type=ProcessingUnitDefinition"'
    ram = '<modules xsi:type="am:Memory" name="ram" definition="D?type=MemoryDefinition"/></structures>'
    return definition + HARDWARE.replace(f"{a0}/>", a0 + path).replace("</structures>", ram)


READ_WRITE = (access("in", "read"), ticks(100_000), access("out", "write"))


def phases(version):
    return [(str(a.kind), str(a.start), str(a.end), str(a.bound)) for a in version.accesses]


def test_accesses_become_phases_at_both_ends_of_a_job(tmp_path):
    sw = task("T", *READ_WRITE) + LABELS
    imported = read(tmp_path, sw=sw, hw=memory(), mapping=MAPPED)
    here, elsewhere, _ = imported.model.task("T").versions
    # 4000 B are 500 accesses of 8 B, 2 B are one; 8 cycles at 100 MHz each, so 8 B per 80 ns are 0.1 of 1 GB/s.
    assert (here.units, str(here.wcet)) == (("a0",), "1ms")
    assert phases(here) == [("read", "0ms", "40us", "1/10"), ("write", "999.92us", "1ms", "1/10")]
    assert [(t.buffer, t.symbol, t.size) for a in here.accesses for t in a.transfers] == [
        ("in", "in", 4000),
        ("out", "out", 2),
    ]
    assert (elsewhere.units, elsewhere.accesses) == (("a1",), ())
    assert [(r.name, r.bandwidth) for r in imported.model.resources] == [("ram", 10**9)]


def test_accesses_can_be_added_or_left_out(tmp_path):
    sw = task("T", *READ_WRITE) + LABELS
    added = read(tmp_path, sw=sw, hw=memory(), mapping=MAPPED, memory="added").model.task("T").versions[0]
    assert (str(added.wcet), len(added.accesses)) == ("1.04008ms", 2)
    plain = read(tmp_path, sw=sw, hw=memory(), mapping=MAPPED, memory="none").model
    assert (str(plain.task("T").versions[0].wcet), plain.resources) == ("1ms", ())


def test_accesses_longer_than_the_stated_time_raise_it(tmp_path):
    sw = task("T", access("in", "read"), ticks(10)) + LABELS
    imported = read(tmp_path, sw=sw, hw=memory(), mapping=MAPPED)
    assert str(imported.model.task("T").versions[0].wcet) == "40us"
    assert len(found(imported.diagnostics, codes.TOO_LONG_ACCESSES)) == 1


def test_a_cache_line_counts_more_than_a_port_and_a_rate_more_than_both(tmp_path):
    line = '<definitions xsi:type="am:CacheDefinition" name="L"><lineSize value="32" unit="B"/></definitions>'
    cached = memory().replace("<accessEl", '<caches name="c" definition="L?type=CacheDefinition"/><accessEl')
    sw = task("T", *READ_WRITE) + LABELS
    imported = read(tmp_path, sw=sw, hw=line + cached, mapping=MAPPED)
    assert phases(imported.model.task("T").versions[0])[0] == ("read", "0ms", "10us", "2/5")
    rated = memory().replace('value="8"/></acc', 'value="8"/><dataRate value="500" unit="MBPerSecond"/></acc')
    imported = read(tmp_path, sw=sw, hw=rated, mapping=MAPPED)
    assert phases(imported.model.task("T").versions[0])[0] == ("read", "0ms", "8.08us", "1/2")


def test_an_unknown_peak_means_the_whole_memory(tmp_path):
    unknown = '<definitions xsi:type="am:MemoryDefinition" name="D"/>'
    imported = read(tmp_path, sw=task("T", *READ_WRITE) + LABELS, hw=memory(definition=unknown), mapping=MAPPED)
    assert {bound for _, _, _, bound in phases(imported.model.task("T").versions[0])} == {"1"}
    assert len(found(imported.diagnostics, codes.DEFAULT_BOUND)) == 1


def test_labels_in_no_memory_make_no_phase_and_are_accounted_for(tmp_path):
    imported = read(tmp_path, sw=task("T", *READ_WRITE) + LABELS, hw=memory())
    assert imported.model.resources == ()
    assert reasons(imported, "Label") == {"in": "is mapped to no memory", "out": "is mapped to no memory"}


# ---------------------------------------------------------------------------------------------- mapping

SCHEDULER = '<operatingSystems><taskSchedulers name="s"/><taskSchedulers name="inner">'
SCHEDULER += '<parentAssociation parent="s?type=TaskScheduler"/></taskSchedulers></operatingSystems>'
RESPONSIBLE = (
    '<schedulerAllocation scheduler="s?type=TaskScheduler" '
    'responsibility="a0?type=ProcessingUnit a1?type=ProcessingUnit"/>'
)


def allocation(affinity="", scheduler="s", name="T"):
    units = " ".join(f"{unit}?type=ProcessingUnit" for unit in affinity.split())
    bound = f' affinity="{units}"' if units else ""
    return f'<taskAllocation task="{name}?type=Task" scheduler="{scheduler}?type=TaskScheduler"{bound}/>'


def units(imported, name="T"):
    return {v.name: v.units for v in imported.model.task(name).versions}


@pytest.mark.parametrize(
    ("allocated", "expected"),
    [
        (allocation(), {"A": ("a0", "a1")}),
        (allocation("a1"), {"A": ("a1",)}),
        (allocation("a1 b0"), {"A": ("a1",)}),
        (allocation(scheduler="inner"), {"A": ("a0", "a1")}),
        (allocation("b0", scheduler="none"), {"B": ("b0",)}),
        ("", {"A": ("a0", "a1"), "B": ("b0",)}),
    ],
)
def test_affinities_and_schedulers_bind_tasks_to_units(tmp_path, allocated, expected):
    imported = read(tmp_path, sw=task("T", ticks(4)), os=SCHEDULER, mapping=RESPONSIBLE + allocated)
    assert units(imported) == expected
    assert len(found(imported.diagnostics, codes.UNMAPPED)) == (not allocated)
    free = read(tmp_path, sw=task("T", ticks(4)), os=SCHEDULER, mapping=RESPONSIBLE + allocated, bind="free")
    assert units(free) == {"A": ("a0", "a1"), "B": ("b0",)}


def test_an_affinity_outside_of_the_scheduler_yields_to_it(tmp_path):
    imported = read(tmp_path, sw=task("T", ticks(4)), os=SCHEDULER, mapping=RESPONSIBLE + allocation("b0"))
    assert units(imported) == {"A": ("a0", "a1")}
    assert [d.path for d in found(imported.diagnostics, codes.AFFINITY)] == ['Task "T"']


def test_a_task_bound_to_units_for_which_it_states_no_time(tmp_path):
    only_b = items(value("", "DiscreteValueConstant", B, value=6))
    imported = read(tmp_path, sw=task("T", only_b), os=SCHEDULER, mapping=RESPONSIBLE + allocation("a0"))
    assert units(imported) == {"default": ("a0",)}
    assert len(found(imported.diagnostics, codes.IMPOSSIBLE_UNIT)) == 1


def test_runnables_bind_the_task_that_calls_them(tmp_path):
    bound = '<runnableAllocation scheduler="s?type=TaskScheduler" entity="R?type=Runnable"/>'
    sw = task("T", call("R")) + runnable("R", ticks(4))
    assert units(read(tmp_path, sw=sw, os=SCHEDULER, mapping=RESPONSIBLE + bound)) == {"A": ("a0", "a1")}


@pytest.mark.parametrize(
    ("kind", "group", "expected"),
    [
        ("ProcessPairingConstraint", "group", {"A": ("a1",)}),
        ("ProcessSeparationConstraint", "groups", {"A": ("a0",), "B": ("b0",)}),
    ],
)
def test_pairing_and_separation_with_target_units(tmp_path, kind, group, expected):
    constraint = f"""<affinityConstraints xsi:type="am:{kind}" name="c">
      <{group} xsi:type="am:ProcessEntityGroup" processes="T?type=Task"/>
      <target xsi:type="am:TargetCore" cores="a1?type=ProcessingUnit"/></affinityConstraints>"""
    assert units(read(tmp_path, sw=task("T", ticks(4)), constraints=constraint)) == expected
    without = constraint.replace("<target", "<other").replace(' cores="a1?type=ProcessingUnit"', "")
    imported = read(tmp_path, sw=task("T", ticks(4)), constraints=without)
    assert len(found(imported.diagnostics, codes.NOT_IMPORTED)) == 1


def test_a_pairing_that_contradicts_the_allocation_warns(tmp_path):
    constraint = """<affinityConstraints xsi:type="am:ProcessPairingConstraint" name="c">
      <group xsi:type="am:ProcessEntityGroup" processes="T?type=Task"/>
      <target xsi:type="am:TargetCore" cores="b0?type=ProcessingUnit"/></affinityConstraints>"""
    mapping = RESPONSIBLE + allocation()
    imported = read(tmp_path, sw=task("T", ticks(4)), os=SCHEDULER, mapping=mapping, constraints=constraint)
    assert units(imported) == {"A": ("a0", "a1")}
    assert [d.path for d in found(imported.diagnostics, codes.AFFINITY)] == ['Task "T"']


def test_runnables_on_different_units_leave_their_task_free_and_warn(tmp_path):
    bound = "".join(
        f'<runnableAllocation scheduler="{scheduler}?type=TaskScheduler" entity="{name}?type=Runnable"/>'
        for scheduler, name in (("s", "R"), ("t", "Q"))
    )
    mapping = (
        RESPONSIBLE + '<schedulerAllocation scheduler="t?type=TaskScheduler" responsibility="b0?type=ProcessingUnit"/>'
    )
    system = SCHEDULER.replace("</operatingSystems>", '<taskSchedulers name="t"/></operatingSystems>')
    sw = task("T", call("R"), call("Q")) + runnable("R", ticks(4)) + runnable("Q", ticks(4))
    imported = read(tmp_path, sw=sw, os=system, mapping=mapping + bound)
    assert units(imported) == {"A": ("a0", "a1"), "B": ("b0",)}
    assert [d.path for d in found(imported.diagnostics, codes.AFFINITY)] == ['Task "T"']
