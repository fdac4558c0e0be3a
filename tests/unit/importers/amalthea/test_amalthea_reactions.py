"""Mapping of delay constraints: the model is valid exactly where each source, or each target, has its partner."""

import itertools
from dataclasses import replace

import pytest
from amalthea_case import PLAIN_STIMULI, call, found, read, refusal, runnable, stimulus, task, ticks, windows

from halpipe.core.durations import Duration
from halpipe.importers.amalthea import codes
from halpipe.models import Job, ModeSchedule, Schedule, Status
from halpipe.pipeline.verify import verify
from support import ms

SLOW = stimulus("p20", "PeriodicStimulus", '<recurrence value="20" unit="ms"/>')
EVENTS = "".join(
    f'<events xsi:type="am:ProcessEvent" name="{name}{type[0]}" eventType="{type}" entity="{name}?type=Task"/>'
    for name in "TUF"
    for type in ("start", "terminate")
)
RUNNABLES = runnable("R", ticks(100_000)) + runnable("Q", ticks(100_000))


def delay(mapping, source="Ts", target="Us", low=0, high=5):
    stated = f' mappingType="{mapping}"' if mapping else ""
    upper = f'<upper value="{high}" unit="ms"/>' if high is not None else ""
    return (
        f'<timingConstraints xsi:type="am:DelayConstraint" name="d"{stated} source="{source}?type=ProcessEvent" '
        f'target="{target}?type=ProcessEvent">{upper}<lower value="{low}" unit="ms"/></timingConstraints>'
    )


def given(tmp_path, constraints, periods=("p10", "p20"), **options):
    sw = task("T", call("R"), stimuli=f"{periods[0]}?type=PeriodicStimulus")
    sw += task("U", call("Q"), stimuli=f"{periods[1]}?type=PeriodicStimulus") + RUNNABLES
    return read(tmp_path, sw=sw, stimuli=PLAIN_STIMULI + SLOW, events=EVENTS, constraints=constraints, **options)


def verdict(model, starts, length):
    """Whether verify accepts a table in which each task starts at the given instants, each on a unit of its own."""
    units = dict(zip(("T", "U"), [unit.name for unit in model.units][:2], strict=True))
    jobs = []
    tasks = []
    for owner in model.tasks:
        versions = tuple(replace(v, units=(units[owner.name],)) for v in owner.versions[:1])
        tasks.append(replace(owner, versions=versions))
        for index, start in enumerate(starts[owner.name]):
            (version,) = versions
            end = ms(start) + version.wcet
            job = Job(task=owner.name, index=index, start=ms(start), end=end, version=version.name, units=version.units)
            jobs.append(job)
    runs = tuple(replace(run, versions=run.versions[:1]) for run in model.modes[0].runs)
    model = replace(model, tasks=tuple(tasks), modes=(replace(model.modes[0], runs=runs),))
    table = ModeSchedule(name=model.modes[0].name, hyperperiod=ms(length), status=Status.VALID, jobs=tuple(jobs))
    schedule = Schedule(model=model.name, model_sha256="", modes=(table,))
    return [d.message for d in verify(model, schedule) if d.is_error] == []


def each_source_has_a_target(starts, length, low, high):
    return all(
        any(low <= (target - source) + turn * length <= high for target in starts["U"] for turn in range(-2, 3))
        for source in starts["T"]
    )


@pytest.mark.parametrize(("low", "high"), [(0, 5), (2, 9), (0, 13), (9, 15), (17, 30)])
def test_reaction_gives_each_source_a_target_and_nothing_else(tmp_path, low, high):
    """Against the definition, for every placement in whole milliseconds of two sources and one target in 20 ms."""
    model = given(tmp_path, delay("Reaction", low=low, high=high)).model
    outcomes = set()
    for first, second, target in itertools.product(range(0, 9, 2), range(10, 19, 2), range(0, 19, 3)):
        starts = {"T": [first, second], "U": [target]}
        expected = each_source_has_a_target(starts, 20, low, high)
        assert verdict(model, starts, 20) is expected, starts
        outcomes.add(expected)
    assert outcomes == ({False} if high - low < 2 else {True, False}) or (low, high) == (0, 5)


def test_without_a_mapping_each_target_has_a_source(tmp_path):
    model = given(tmp_path, delay("")).model
    assert windows(given(tmp_path, delay("")), "U") == [("T", "start", "0ms", "5ms")]
    assert verdict(model, {"T": [0, 10], "U": [3]}, 20)
    assert not verdict(given(tmp_path, delay("Reaction")).model, {"T": [0, 10], "U": [3]}, 20)


def test_ends_are_instants_of_the_window_whatever_the_execution_times(tmp_path):
    """From the end of T to that of U within 5 ms; an overlay may change how long they take."""
    imported = given(tmp_path, delay("Reaction", "Tt", "Ut", high=5))
    assert windows(imported, "T") == [("U", "end", "15ms", "20ms")]
    [row] = imported.model.task("T").versions[0].precedences
    assert str(row.to) == "end"
    assert windows(imported, "U") == []


@pytest.mark.parametrize(("start", "expected"), [(4, True), (5, False)])
def test_a_window_to_an_end_that_is_shorter_than_the_job_is_no_window_to_its_start(tmp_path, start, expected):
    """U takes 1 ms and ends 0.5 ms after the start of T at the latest: it starts before T."""
    model = given(tmp_path, delay("", target="Ut").replace('value="5"', 'value="0.5"'), ("p10", "p10")).model
    assert verdict(model, {"T": ["4.6ms"], "U": [start]}, 10) is expected


def test_a_narrow_window_between_equal_periods_pairs_by_itself(tmp_path):
    """Two starts of U are at least its 1 ms apart, so within 0.5 ms of a source there is only one."""
    narrow = delay("OneToOne", low=0, high=0)
    imported = given(tmp_path, narrow, ("p10", "p10"))
    assert windows(imported, "U") == [("T", "start", "0ms", "0ms")]
    assert found(imported.diagnostics, codes.REACTION) == []


@pytest.mark.parametrize(("mapping", "is_known"), [("", True), ("_undefined_", True), ("reaction", False)])
def test_an_unknown_mapping_is_told_and_gives_each_target_a_source(tmp_path, mapping, is_known):
    imported = given(tmp_path, delay(mapping), ("p10", "p10"))
    assert windows(imported, "U") == [("T", "start", "0ms", "5ms")]
    told = found(imported.diagnostics, codes.REACTION)
    assert [mapping in d.message and "is unknown" in d.message for d in told] == ([] if is_known else [True])


def test_no_cycle_is_closed_where_the_source_already_comes_after_the_target(tmp_path):
    other = delay("", "Us", "Ts", high=9)
    imported = given(tmp_path, other + delay("OneToOne", low=0, high=0), ("p10", "p10"))
    assert windows(imported, "U") == []
    assert windows(imported, "T") == [("U", "start", "0ms", "9ms"), ("U", "start", "10ms", "10ms")]


def test_wide_windows_of_unique_mappings_are_told(tmp_path):
    imported = given(tmp_path, delay("OneToOne", high=5), ("p10", "p10"))
    assert windows(imported, "T") == [("U", "start", "5ms", "10ms")]
    assert len(found(imported.diagnostics, codes.REACTION)) == 1
    assert found(given(tmp_path, delay("Reaction"), ("p10", "p10")).diagnostics, codes.REACTION) == []


@pytest.mark.parametrize(("mapping", "periods"), [("OneToOne", ("p10", "p20")), ("OneToOne", ("p20", "p10"))])
def test_pairs_need_equal_periods(tmp_path, mapping, periods):
    (error,) = found(refusal(given, tmp_path, delay(mapping), periods).diagnostics, codes.NO_PARTNERS)
    assert "10ms" in error.message
    assert "20ms" in error.message


def test_unique_targets_may_be_more_than_sources_but_not_fewer(tmp_path):
    assert found(refusal(given, tmp_path, delay("UniqueReaction"), ("p10", "p20")).diagnostics, codes.NO_PARTNERS)
    assert not found(given(tmp_path, delay("UniqueReaction"), ("p20", "p10")).diagnostics, codes.NO_PARTNERS)


def test_an_overlay_may_change_the_periods_before(tmp_path):
    from halpipe.importers.amalthea import FORMAT, AmaltheaImportOptions

    class Overlay:
        names_units = False

        def drops(self, name):
            return False

        def source_period(self, name):
            return None

        task_period = task_wcet = work_wcet = states_interrupt = source_period

    given(tmp_path, delay("Reaction"))
    imported = FORMAT.read([str(tmp_path / "model.amxmi")], AmaltheaImportOptions(overlay=Overlay()))
    tasks = tuple(replace(t, period=Duration.parse("70ms")) if t.name == "U" else t for t in imported.model.tasks)
    done = replace(imported, model=replace(imported.model, tasks=tasks)).completed()
    assert windows(done, "T") == [("U", "start", "65ms", "70ms")]


def test_where_the_other_direction_is_stated_too_it_is_told(tmp_path):
    both = delay("") + delay("Reaction", high=9)
    imported = given(tmp_path, both)
    assert windows(imported, "U") == [("T", "start", "0ms", "5ms"), ("T", "start", "0ms", "9ms")]
    (warning,) = found(imported.diagnostics, codes.REACTION)
    assert "each target gets a source" in warning.message


def test_a_reaction_without_an_upper_limit_asks_for_nothing(tmp_path):
    imported = given(tmp_path, delay("Reaction", high=None))
    assert windows(imported, "T") == windows(imported, "U") == []
