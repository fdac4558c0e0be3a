"""The benchmark: what is measured is reproducible but for its times, and summed up as it says."""

import sys
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.durations import milliseconds
from halpipe.importers.native import read_schedule
from halpipe.pipeline.generate import SetParameters
from halpipe.pipeline.solve import exact
from halpipe.pipeline.solve.codes import NOT_FOUND
from search_benchmark import SUITES, Instance, Row, given_rows, measure, report
from search_benchmark.instance import VALID, _forward
from search_benchmark.render import duration_text, outputs
from search_benchmark.results import Ratio, Spread, instances
from table_iii import TABLE_III

SMALL = Instance(
    key="r / 1 / 5",
    parameters=SetParameters(tasks=8, units=2),
    seed=5,
    budget=2000,
    limit=0,
    exact_seconds=0,
    exact_workers=1,
)
HOPELESS = replace(SMALL, parameters=SetParameters(tasks=48, units=2, utilisation=Fraction(1)))


def test_a_solved_set_is_measured_the_same_way_twice():
    first, second = measure(SMALL), measure(SMALL)
    assert first["result"] == second["result"]
    assert first["result"]["outcome"] == "valid"
    assert first["result"]["moves"] > 0
    assert len(first["result"]["schedule_sha256"]) == 64
    assert 0 < first["timing"]["kernel_ns"] < first["timing"]["whole_ns"]
    assert not any("ns" in name for name in first["result"])


def test_the_kernel_is_left_as_it_was():
    def entries():
        modules = [module for name, module in sys.modules.items() if name.startswith("halpipe.pipeline.solve.kernel.")]
        return [vars(module)["anneal"] for module in modules if "anneal" in vars(module)]

    measure(SMALL)
    assert len(entries()) > 1
    assert set(entries()) == {import_module("halpipe.pipeline.solve.kernel.kernel").anneal}


def test_a_search_out_of_moves_is_not_found():
    result = measure(replace(HOPELESS, budget=20))["result"]
    assert result["outcome"] == "not-found"
    assert "schedule_sha256" not in result


def test_how_far_a_stopped_search_came_is_no_reproducible_result():
    record = measure(replace(HOPELESS, budget=10**9, limit=1))
    assert record["result"]["outcome"] == "stopped"
    assert "moves" not in record["result"]
    assert record["timing"]["moves"] > 0


def test_a_fault_is_recorded_and_does_not_stop_the_others(monkeypatch):
    def fail(*_):
        raise HalpipeError(NOT_FOUND("wrong", path="here"))

    measure(SMALL)  # so that warming up is done
    monkeypatch.setattr("search_benchmark.instance.schedule_model", fail)
    result = measure(SMALL)["result"]
    assert result["outcome"] == "fault"
    assert result["fault"] == "HAL0401 here: wrong"


def test_cp_sat_answers_on_the_same_set():
    pytest.importorskip("ortools", reason="the extra [exact] is not installed")
    tiny = replace(SMALL, parameters=SetParameters(tasks=4, units=2), exact_seconds=10)
    found = measure(tiny)["timing"]["exact"]
    assert found["answer"] == "feasible"
    assert found["ns"] > 0


def test_without_ortools_the_reason_is_recorded(monkeypatch):
    monkeypatch.setattr(exact, "is_installed", lambda: False)
    found = measure(replace(SMALL, exact_seconds=1))["timing"]["exact"]
    assert found == {"answer": "none", "reason": "OR-Tools is not installed"}


# ------------------------------------------------------------------------------------------------ suites


def test_the_suites_can_all_be_generated_and_their_rows_told_apart():
    for rows in SUITES.values():
        assert len({row.name for row in rows}) == len(rows)
        for row in rows:
            for cell in row.cells:
                if isinstance(cell, SetParameters):
                    cell.check()


EXAMPLE = Path(__file__).parents[1] / "fixtures" / "split"


def test_a_model_of_the_users_is_a_row_with_gaps_and_chains():
    [row] = given_rows([str(EXAMPLE / "model.xml")])
    [instance] = instances([row], [1], budget=100, limit=0)
    found = measure(instance)
    assert (row.name, found["result"]["outcome"]) == ("split", VALID)
    assert found["result"]["gaps_per_second"] > 0
    results = report("real", [row], {found["key"]: found}, ABOUT)
    table = outputs(results)["table.md"].decode()
    reaction, age, forward = found["result"]["chains"]["slow-to-detect"]
    assert f"| split | slow-to-detect | {reaction} | {age} | {forward} | – |" in table
    assert "gaps per second, median" in table


def test_forward_latency_goes_from_a_start_to_the_end_of_what_its_data_reach():
    """In the example, slow starts at 2.5 ms, and detect, which starts when it has ended, ends at 54 ms."""
    [mode] = read_schedule(str(EXAMPLE / "schedule.xml")).modes
    assert _forward(mode, ("slow", "detect")) == milliseconds(Fraction("51.5"))


def test_table3_holds_every_cell_of_the_table():
    cells = [cell for row in SUITES["table3"] for cell in row.cells]
    assert sorted(map(str, cells)) == sorted(str(cell) for experiment in TABLE_III for cell in experiment.cells)


def test_every_cell_gets_every_seed_and_the_first_go_to_cp_sat():
    rows = (Row(name="a", cells=(SMALL.parameters, HOPELESS.parameters)),)
    work = instances(rows, range(7, 10), budget=1, limit=1, exact_seconds=9, exact_seeds=2)
    assert [(item.key, item.exact_seconds) for item in work] == [
        ("a / 1 / 7", 9),
        ("a / 1 / 8", 9),
        ("a / 1 / 9", 0),
        ("a / 2 / 7", 9),
        ("a / 2 / 8", 9),
        ("a / 2 / 9", 0),
    ]


# ------------------------------------------------------------------------------------------------ results


@given(st.lists(st.integers(0, 10**6), min_size=1))
def test_a_spread_is_made_of_values_of_the_sample(values):
    spread = Spread.of(values)
    parts = [spread.least, spread.low, spread.median, spread.high, spread.greatest]
    assert parts == sorted(parts)
    assert set(parts) <= set(values)
    assert (spread.least, spread.greatest) == (min(values), max(values))
    assert 2 * sum(value < spread.median for value in values) <= len(values)
    assert 2 * sum(value > spread.median for value in values) <= len(values)


def test_nothing_has_no_spread():
    assert Spread.of([]) is None


def record(row, seed, outcome="valid", kernel=4_270_000, **timing):
    result = {"outcome": outcome, "moves": 10 * seed}
    return {
        "key": f"{row} / 1 / {seed}",
        "seed": seed,
        "result": result,
        "timing": {"kernel_ns": kernel, "whole_ns": 20 * kernel, **timing},
    }


ABOUT = {"command": "benchmarks/bench.py x", "seeds": "1..3", "machine": {"processors": 2}}
ROWS = (
    Row(name="easy", cells=(SetParameters(),), goal_kernel=milliseconds(5), paper_seconds=(460, 6816)),
    Row(name="hard & <high>", cells=(SetParameters(),), goal_kernel=milliseconds(1), goal_success=Fraction(1, 2)),
)
FEASIBLE, UNKNOWN = ({"exact": {"answer": answer, "ns": 2 * 10**9}} for answer in ("feasible", "unknown"))


def example(**change):
    records = [
        record("easy", 1, **FEASIBLE),
        record("easy", 2, kernel=3_000_000, **UNKNOWN),
        record("easy", 3, kernel=123_456_789, **change),
        record("hard & <high>", 1, kernel=2_000_000),
        record("hard & <high>", 2, outcome="not-found"),
        record("hard & <high>", 3, outcome="not-found"),
    ]
    return report("x", ROWS, {item["key"]: item for item in records}, ABOUT)


def test_a_row_counts_what_was_solved_and_only_its_times():
    easy, hard = example().rows
    assert (easy.solved, hard.solved) == (3, 1)
    assert easy.kernel_ns == Spread(3_000_000, 3_000_000, 4_270_000, 4_270_000, 123_456_789)
    assert hard.kernel_ns.greatest == 2_000_000
    assert (easy.exact_tried, easy.exact_solved, easy.exact_ns.median) == (2, 1, 2 * 10**9)
    assert (hard.exact_tried, hard.exact_ns) == (0, None)


def test_cp_sat_is_compared_set_by_set_with_the_whole_command():
    easy, hard = example().rows
    assert easy.ratios == (Ratio(23, is_bound=False), Ratio(33, is_bound=True))
    assert (easy.median_ratio, hard.median_ratio) == (Ratio(23, is_bound=False), None)
    more, _ = example(**UNKNOWN).rows
    assert more.ratios[0] == Ratio(0, is_bound=True)
    assert more.median_ratio == Ratio(23, is_bound=True)


def test_a_set_that_cp_sat_alone_solved_counts_against_the_search():
    alone = record("easy", 1, outcome="not-found", **FEASIBLE)
    neither = record("easy", 2, outcome="not-found", **UNKNOWN)
    (row,) = report("x", ROWS, {item["key"]: item for item in (alone, neither)}, ABOUT).rows
    assert row.ratios == (Ratio(0, is_bound=False),)


def test_a_goal_is_met_by_success_and_median_together():
    easy, hard = example().rows
    assert easy.meets_goal
    assert not hard.meets_goal
    assert not replace(easy, solved=2).meets_goal
    assert not replace(easy, kernel_ns=replace(easy.kernel_ns, median=5_000_001)).meets_goal
    assert replace(easy, kernel_ns=replace(easy.kernel_ns, median=5_000_000)).meets_goal


def test_the_hash_of_the_results_is_about_results_and_not_about_times():
    plain = example().results_sha256
    assert example(whole_ns=1).results_sha256 == plain
    changed = example()
    changed.rows[0].records[0]["result"]["moves"] += 1
    assert changed.results_sha256 != plain


def test_faults_are_named():
    broken = record("easy", 1, outcome="fault")
    broken["result"]["fault"] = "HAL0403 too large"
    assert report("x", ROWS, {broken["key"]: broken}, ABOUT).faults == ["easy / 1 / 1: HAL0403 too large"]


# ------------------------------------------------------------------------------------------------ rendering


@pytest.mark.parametrize(
    ("nanoseconds", "text"),
    [
        (0, "0ns"),
        (999, "999ns"),
        (1_000, "1.00us"),
        (4_270_000, "4.27ms"),
        (12_345_678, "12.3ms"),
        (987_654_321, "988ms"),
        (1_000_000_000, "1.00s"),
        (6_816_000_000_000, "6816s"),
    ],
)
def test_measured_times_have_three_digits(nanoseconds, text):
    assert duration_text(nanoseconds) == text


def test_the_table_says_what_the_rows_are():
    lines = outputs(example())["table.md"].decode().splitlines()
    table = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines if line.startswith("|")]
    assert table[0] == [
        *("sets", "instances", "success", "moves, median", "kernel, median", "kernel, worst", "whole, median"),
        *("whole, worst", "paper (Table III)", "goal", "met", "CP-SAT solved", "CP-SAT, median"),
        *("CP-SAT : whole, median", "CP-SAT : whole, least"),
    ]
    assert table[2] == [
        *("easy", "3", "100 %", "20", "4.27ms", "123ms", "85.4ms", "2.47s", "460..6816 s"),
        *("100 %, 5ms", "yes", "1 of 2", "2.00s", "23", "23"),
    ]
    assert table[3] == [
        *("hard & <high>", "3", "33.3 %", "10", "2.00ms", "2.00ms", "40.0ms", "40.0ms", "–"),
        *("50 %, 1ms", "no", "–", "–", "–", "–"),
    ]
    assert "- command: benchmarks/bench.py x" in lines
    assert "- processors: 2" in lines


def test_the_plot_is_whole_and_shows_every_sample():
    root = ElementTree.fromstring(outputs(example())["plot.svg"])
    space = {"s": "http://www.w3.org/2000/svg"}
    texts = [text.text for text in root.iterfind(".//s:text", space)]
    assert "hard & <high>" in texts
    titles = [title.text for title in root.iterfind(".//s:g/s:title", space)]
    assert titles == [
        "kernel: 3.00ms to 123ms, median 4.27ms",
        "whole command: 60.0ms to 2.47s, median 85.4ms",
        "CP-SAT: 2.00s to 2.00s, median 2.00s",
        "kernel: 2.00ms to 2.00ms, median 2.00ms",
        "whole command: 40.0ms to 40.0ms, median 40.0ms",
    ]
    width = float(root.get("width"))
    assert all(0 <= float(line.get("x1")) <= width for line in root.iterfind(".//s:line", space))


def test_a_longer_time_lies_further_right():
    root = ElementTree.fromstring(outputs(example())["plot.svg"])
    boxes = root.findall(".//{http://www.w3.org/2000/svg}g/{http://www.w3.org/2000/svg}rect[@height='8']")
    kernel, whole, cp_sat = (float(box.get("x")) for box in boxes[:3])
    assert kernel < whole < cp_sat


def test_the_page_escapes_names_and_holds_the_plot():
    page = outputs(example())["index.html"].decode()
    assert "<td>hard &amp; &lt;high&gt;</td>" in page
    assert page.count("<svg") == 1


def test_a_report_without_anything_solved_is_shown():
    nothing = record("easy", 1, outcome="not-found")
    shown = outputs(report("x", ROWS, {nothing["key"]: nothing}, ABOUT))
    assert "| easy | 1 | 0 % | – |" in shown["table.md"].decode()
    ElementTree.fromstring(shown["plot.svg"])
