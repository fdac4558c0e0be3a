"""Learning from recordings: what is learned is stated, and what is learned is read back by an import."""

from fractions import Fraction

import pytest

from halpipe.core.durations import ZERO, Duration
from halpipe.importers.overlay import read_overlays
from halpipe.models import Job, ModeSchedule, Schedule, Status
from halpipe.models.trace import Execution, Trace
from halpipe.pipeline.compare import compare
from halpipe.pipeline.compare.learning import LearnOptions, described, learn
from support import model, ms, task, version

SYSTEM = model(task("a", "10ms", version("v", "2ms", "c1")), task("b", "20ms", version("v", None, "c1")))


def job(name, index, start, end):
    return Job(task=name, index=index, start=ms(start), end=ms(end), version="v", units=("c1",))


JOBS = (job("a", 0, 0, 2), job("a", 1, 10, 12), job("b", 0, 5, 8))
TABLE = ModeSchedule(name="run", hyperperiod=ms(20), status=Status.VALID, jobs=JOBS)
PLAN = Schedule(model=SYSTEM.name, model_sha256="", modes=(TABLE,))


def run(*lengths, others=(), late=0):
    """A recording in which the jobs of "a" take the given times in turn, those of "b" 3 ms."""
    seen = []
    for cycle in range(-(-len(lengths) // 2)):
        for number, length in enumerate(lengths[2 * cycle : 2 * cycle + 2]):
            at = ms(20 * cycle + 10 * number) + Duration(late * (cycle % 2))
            seen.append(Execution(task="a", start=at, end=at + ms(length)))
        seen.append(Execution(task="b", start=ms(20 * cycle + 5), end=ms(20 * cycle + 8)))
    seen += [Execution(task=name, start=ms(at), end=ms(at) + ms(1)) for name, at in others]
    return tuple(sorted(seen, key=lambda execution: execution.start.ns))


def learned(seen, system=SYSTEM, **options):
    chosen = LearnOptions(mode="run", **{"origin": ZERO, **options})
    found = compare(PLAN, Trace(name="", executions=seen), chosen, None)
    return learn([found], chosen, system)


def wcets(found):
    return {each.task: (each.wcet, each.raises) for each in found.versions}


@pytest.mark.parametrize(
    ("quantile", "margin", "wcet"),
    [
        (1, 0, 4),
        (1, Fraction(1, 4), 5),
        (Fraction(3, 4), 0, 3),
        (Fraction(1, 2), 0, 2),
        (Fraction(1, 2) + Fraction(1, 1000), 0, 3),
    ],
)
def test_a_wcet_is_a_quantile_and_a_margin(quantile, margin, wcet):
    found = learned(run(1, 2, 3, 4), quantile=Fraction(quantile), margin=Fraction(margin))
    assert wcets(found)["a"][0] == ms(wcet)


def test_wcets_are_rounded_up_to_nanoseconds_and_never_lowered():
    seen = [Execution(task="a", start=ZERO, end=Duration(1_000_001))]
    found = learned(tuple(seen), margin=Fraction(1, 2))
    assert wcets(found)["a"] == (Duration(1_500_002), False)
    assert found.corrected(SYSTEM) == SYSTEM
    assert '# "v": {wcet: 1.500002ms}  # 1 job, longest 1.000001ms; the model states 2ms; few jobs' in found.overlay(
        "t"
    )


def test_what_is_more_or_not_stated_is_raised():
    found = learned(run(3, 3, 3, 3), margin=Fraction(0))
    assert wcets(found) == {"a": (ms(3), True), "b": (ms(3), True)}
    fixed = found.corrected(SYSTEM)
    assert [t.versions[0].wcet for t in fixed.tasks] == [ms(3), ms(3)]


def test_what_is_stated_already_is_not_raised():
    assert wcets(learned(run(2, 2, 2, 2), margin=Fraction(0)))["a"] == (ms(2), False)


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize(("jitter", "is_stated"), [(2_400_000, True), (2_500_000, True), (2_500_001, False)])
def test_starts_may_vary_by_a_quarter_of_the_period_that_is_stated(jitter, is_stated, late):
    """Every second one is late, from the first or from the second on."""
    starts = [ms(10 * number) + Duration(jitter * (number % 2 != late)) for number in range(1, 11)]
    seen = tuple(Execution(task="a", start=start, end=start + ms(1)) for start in starts)
    found = {each.task: each for each in learned(seen).periods}
    assert (("a" in found) and not found["a"].differs) == is_stated
    if is_stated:
        assert (found["a"].period, found["a"].offset, found["a"].jitter) == (ms(10), ZERO, Duration(jitter))


def test_the_period_that_is_stated_is_kept_though_the_clock_of_the_recorder_drifts():
    """A per cent fast, ten starts lie 900 us apart at last, which is less than a quarter of 10 ms."""
    seen = tuple(Execution(task="a", start=ms("10.1ms") * n, end=ms("10.1ms") * n + ms(1)) for n in range(10))
    [found] = learned(seen).periods
    assert (found.period, found.jitter, found.differs) == (ms(10), ms("900us"), False)


@pytest.mark.parametrize("origin", [0, 3])
def test_an_offset_is_that_of_the_earliest_start_in_its_period(origin):
    starts = [ms("31ms"), *(ms(30 + 10 * n) for n in range(1, 10))]
    seen = tuple(Execution(task="a", start=at, end=at + ms(1)) for at in starts)
    [found] = learned(seen, origin=ms(origin)).periods
    assert (found.period, found.offset, found.jitter) == (ms(10), ms(-origin % 10), ms(1))


@pytest.mark.parametrize(("jobs", "is_few"), [(29, True), (30, False)])
def test_a_wcet_of_fewer_than_thirty_jobs_has_a_warning(jobs, is_few):
    seen = tuple(Execution(task="a", start=ms(10 * n), end=ms(10 * n + 1)) for n in range(jobs))
    assert ("; few jobs" in learned(seen).overlay("t")) is is_few


def test_two_starts_have_a_distance():
    assert learned(run(2, 2, 2, 2, others=[("x", 1), ("x", 8)])).distances == {"x": ms(7)}


def test_a_job_without_an_end_teaches_no_time():
    seen = [Execution(task="a", start=ms(10 * number), end=None) for number in range(5)]
    found = learned(tuple(seen))
    assert found.versions == ()


def test_the_time_in_which_a_job_ran_counts_not_its_preemptions():
    seen = [Execution(task="a", start=ZERO, end=ms(9), busy=ms(3))]
    assert wcets(learned(tuple(seen), margin=Fraction(0)))["a"][0] == ms(3)


def test_periods_that_the_recording_confirms_are_comments():
    found = learned(run(2, 2, 2, 2, 2, 2, late=100_000))
    (a,) = (each for each in found.periods if each.task == "a")
    assert (a.period, a.offset, a.jitter, a.differs) == (ms(10), ZERO, Duration(100_000), False)
    assert "# runs every 10ms, from 0ms on; starts vary by 100us" in found.overlay("t")


def test_a_period_that_contradicts_the_model_is_learned():
    seen = tuple(Execution(task="a", start=ms(20 * number), end=ms(20 * number + 1)) for number in range(10))
    found = learned(seen)
    (a,) = found.periods
    assert (a.period, a.offset, a.differs) == (ms(20), ZERO, True)
    assert found.corrected(SYSTEM).task("a").period == ms(20)
    assert "period: 20ms  # starts vary by 0ms; the model states 10ms" in found.overlay("t")


@pytest.mark.parametrize(("seen", "lost", "is_found"), [(10, 1, True), (10, 2, False), (19, 1, True), (20, 2, True)])
def test_of_a_period_a_job_in_ten_may_be_missing(seen, lost, is_found):
    starts = [ms(10 * n) for n in range(seen + lost) if not 3 <= n < 3 + lost]
    found = learned(tuple(Execution(task="z", start=at, end=at + ms(1)) for at in starts)).periods
    assert [each.period for each in found] == [ms(10)] * is_found


def test_starts_without_a_pattern_have_no_period():
    seen = tuple(Execution(task="z", start=ms(at), end=ms(at + 1)) for at in (0, 3, 19, 22, 60, 61, 95))
    assert learned(seen).periods == ()


def test_a_task_of_no_schedule_is_a_comment_with_its_period():
    found = learned(run(2, 2, 2, 2, others=[("new", 7 + 50 * number) for number in range(5)]))
    text = found.overlay("t")
    assert '#  "new": {period: 50ms, offset: 7ms}' in text
    assert '\n  "new"' not in text


@pytest.mark.parametrize(
    ("starts", "period"),
    [
        ((7, 39, 71, 103), 32),
        ((0, 11, 19, 30, 41), 10),
        ((0, 33, 66, 100), 33),
        ((0, 21, 41, 63), 20),  # 3 ms: twice 1 ms and a twentieth of 20 ms
        ((0, 28, 57, 87), 30),
        ((0, 27, 57, 85), 28),  # with 30 ms they vary by 5 ms, which is more than twice 5/3 ms and 1.5 ms
        ((0, 31, 54, 83), 29),  # by 6 ms, less than a quarter of it
        ((0, 21, 49, 70), None),  # by 7 ms, more than a quarter of 21 ms
    ],
)
def test_a_round_period_may_not_explain_less_than_another(starts, period):
    found = learned(run(2, 2, 2, 2, others=[("new", at) for at in starts])).periods
    assert [each.period for each in found if not each.is_known] == ([] if period is None else [ms(period)])


def test_the_overlay_is_one(tmp_path):
    (tmp_path / "o.yaml").write_text(learned(run(3, 4, 3, 4)).overlay("a: recording\nof two lines"))
    entries = {entry.pattern: entry for entry in read_overlays([str(tmp_path / "o.yaml")]).tasks}
    assert {name: entry.versions["v"].value.stated["wcet"].value for name, entry in entries.items()} == {
        "a": Duration.parse("4.8ms"),
        "b": Duration.parse("3.6ms"),
    }


@pytest.mark.parametrize(
    ("quantile", "margin", "says"),
    [(1, 0, "the longest job and 0 % more"), (Fraction(9, 10), Fraction(1, 5), "90 % of the jobs and 20 % more")],
)
def test_the_rule_of_learned_times_is_stated_in_per_cent(quantile, margin, says):
    options = LearnOptions(quantile=Fraction(quantile), margin=Fraction(margin))
    assert described(options, "t.csv") == f"t.csv; a WCET covers {says}"


def test_an_overlay_without_entries_is_one_too(tmp_path):
    (tmp_path / "o.yaml").write_text(learned((Execution(task="a", start=ZERO, end=ms(1)),)).overlay("t"))
    assert read_overlays([str(tmp_path / "o.yaml")]).tasks == ()


def test_of_an_irregular_task_the_least_distance_of_starts_is_learned():
    found = learned(run(2, 2, 2, 2, 2, 2, others=[("x", at) for at in (1, 4, 30, 34, 59)] + [("once", 7)]))
    assert found.distances == {"x": ms(3)}
    text = found.overlay("run.csv")
    assert '#  "x": 3ms' in text.splitlines()
    assert "once" not in text


@pytest.mark.parametrize("order", [1, -1])
def test_of_several_recordings_the_least_distance_counts(order):
    chosen = LearnOptions(origin=ZERO, mode="run")
    seen = [
        run(2, 2, 2, 2, 2, 2, others=[("x", at) for at in starts]) for starts in ((1, 4, 30, 34, 59), (1, 3, 30, 59))
    ]
    found = [compare(PLAN, Trace(name="", executions=each), chosen, None) for each in seen[::order]]
    assert learn(found, chosen, SYSTEM).distances == {"x": ms(2)}
