"""WCETs from measurements: every form of table gives the same samples, and the statistic is exact."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from ros_case import FIXTURES, Overlay, found, write

from halpipe.core.diagnostics import Findings, HalpipeError, Location, Severity
from halpipe.core.durations import Duration
from halpipe.core.samples import quantile_of
from halpipe.importers.ros import FORMAT, codes
from halpipe.importers.ros.calibrate import Measurements, Sample, estimate, read_measured
from halpipe.importers.ros.options import RosImportOptions
from halpipe.importers.traces.codes import LEFT_OUT

GRAPH = str(FIXTURES / "calibrated.dot")
LONG = "callback,duration_us\n/driver,1000\n/filter,2500.5\n/driver,1200\n"
CARET_FRAME = """\
,/driver,/driver,/filter,/filter
,callback_start_timestamp [ns],latency [ms],callback_start_timestamp [ns],latency [ms]
0,1654000000000000000,1.0,1654000000000000000,2.5004999999999997
1,1654000000025000000,1.2,,
"""
CARET_RECORDS = """\
,/driver/callback_start_timestamp,/driver/callback_end_timestamp,/filter/callback_start_timestamp,/filter/callback_end_timestamp
0,1000,1001000,0,2500500.0
1,2000,1202000,nan,nan
"""
TRACE = """\
cycle,mode,task,job,units,start,end
0,m,/driver,0,u,5,1000005
0,m,/filter,0,u,0,2500500
1,m,/driver,0,u,0,1200000
"""
PANDAS = """\
Node,timestamp,duration
/driver,2022-01-01,0 days 00:00:00.001000
/filter,2022-01-01,0 days 00:00:00.002500500
/driver,2022-01-01,00:00:00.0012
"""
GERMAN = "callback;duration [us]\n/driver;1000\n/filter;2500,5\n/driver;1200,0\n"
WITH_UNITS = "name,Execution time\n/driver,1ms\n/filter,2.5005 ms\n/driver,1200us\n"


def samples(text):
    measured, findings = Measurements(), Findings()
    read_measured(text.encode(), "t.csv", measured, findings)
    return {name: [s.ns for s in found] for name, found in measured.samples.items()}, findings.items


@pytest.mark.parametrize("text", [LONG, CARET_FRAME, CARET_RECORDS, TRACE, PANDAS, WITH_UNITS, GERMAN, "\ufeff" + LONG])
def test_every_form_gives_the_same_samples(text):
    found, findings = samples(text)
    assert {name: sorted(times) for name, times in found.items()} == {
        "/driver": [1_000_000, 1_200_000],
        "/filter": [2_500_500],
    }
    assert [d.code for d in findings] == ([LEFT_OUT.id] if text is CARET_RECORDS else [])


@pytest.mark.parametrize(
    ("header", "nanoseconds"),
    [
        ("duration", 3),
        ("duration_ns", 3),
        ("latency [ms]", 3_000_000),
        ("Duration (us)", 3000),
        ("elapsed_s", 3 * 10**9),
    ],
)
def test_the_header_names_the_unit(header, nanoseconds):
    assert samples(f"callback,{header}\na,3\n")[0] == {"a": [nanoseconds]}


@pytest.mark.parametrize(
    ("text", "seconds"),
    [("1 days 02:03:04.5", "93784.5"), ("00:01:00", "60"), ("01:00:00", "3600"), ("2 days 00:00:00", "172800")],
)
def test_a_time_of_pandas_has_days_hours_minutes_and_seconds(text, seconds):
    assert samples(f"callback,duration\na,{text}\n")[0] == {"a": [int(Fraction(seconds) * 10**9)]}


@pytest.mark.parametrize(
    ("text", "nanoseconds"),
    [("0.4", 0), ("0.5", 1), ("1.5", 2), ("2.4999", 2), ("25e-1", 3), ("-0.4", 0), ("1234567.5", 1234568), ("3.", 3)],
)
def test_times_are_rounded_to_the_nearest_nanosecond(text, nanoseconds):
    assert samples(f"callback,duration\na,{text}\n")[0] == {"a": [nanoseconds]}


@pytest.mark.parametrize(
    "text",
    ["", "\n\n", "timestamp,duration\n1,2\n", "callback\na\n", "callback,start\na,1\n", "x,y\n1,2\n", "\x00", '"open'],
)
def test_what_is_no_table_of_durations(text):
    with pytest.raises(HalpipeError) as caught:
        samples(text)
    assert [d.code for d in caught.value.diagnostics if d.is_error] == [codes.NO_MEASUREMENTS.id]


def test_bytes_that_are_no_text():
    with pytest.raises(HalpipeError) as caught:
        read_measured(b"callback,duration\n\xff,1\n", "t.csv", Measurements(), Findings())
    (found,) = caught.value.diagnostics
    assert (found.code, found.at.line) == (codes.NO_MEASUREMENTS.id, 2)


def test_every_broken_row_is_named():
    text = "callback,duration\na,1\na,x\n,2\na,\na,-1\na,1e500\na,0:00:99:1\n\na,2\n"
    values, findings = samples(text)
    assert values == {"a": [1, 2]}
    assert {d.code for d in findings} == {codes.BAD_SAMPLE.id}
    assert [d.at.line for d in findings] == [3, 4, 5, 6, 7, 8]


def test_a_decimal_comma_in_a_table_separated_by_commas_is_no_duration():
    (found,) = samples("callback,duration_ms\na,2,5\n")[1]
    assert (found.message, found.at.line, found.is_error) == ("3 values, and 2 columns", 2, True)


def test_an_execution_without_an_end_is_no_sample():
    assert samples("task,start,end\na,1,\na,2,5\n")[0] == {"a": [3]}


def test_a_row_that_ends_before_it_starts():
    with pytest.raises(HalpipeError, match="before it starts"):
        samples("task,start,end\na,5,2\n")


def test_the_time_on_the_processor_counts_where_a_recording_has_it():
    """What the dispatcher records, and BTF, of which a table of durations knows nothing."""
    assert samples("task,start,end,busy\na,0,9,4\n")[0] == {"a": [4]}
    btf = "#version 2.1.3\n#creator x\n#timeScale ns\n5,core,0,T,a,0,start\n12,core,0,T,a,0,terminate\n"
    assert samples(btf)[0] == {"a": [7]}


# --------------------------------------------------------------------------------------------------- statistic


def of(*values, quantile="1", margin="0"):
    return estimate([Sample(v, Location("t.csv", v)) for v in values], Fraction(quantile), Fraction(margin))


def test_the_maximum_and_its_place():
    assert (str(of(3, 9, 4).wcet), of(3, 9, 4).sample.at.line) == ("9ns", 9)


@pytest.mark.parametrize(
    ("quantile", "rank"), [("0.001", 1), ("0.1", 1), ("0.11", 2), ("0.9", 9), ("0.91", 10), ("1", 10)]
)
def test_a_quantile_is_a_sample_not_an_interpolation(quantile, rank):
    assert of(*range(10, 0, -1), quantile=quantile).wcet == Duration(rank)


def test_a_margin_is_rounded_up():
    assert str(of(10, margin="0.25").wcet) == "13ns"
    assert of(10, margin="0.25").words == "maximum of 1 sample, 10ns, with a margin of 0.25 of it"


@given(st.lists(st.integers(0, 10**9), min_size=1, max_size=50), st.fractions(0, 1).filter(bool))
def test_a_quantile_is_the_smallest_that_enough_samples_do_not_exceed(values, quantile):
    chosen = int(of(*values, quantile=quantile).wcet.fraction)

    def share(limit):
        return Fraction(sum(v <= limit for v in values), len(values))

    assert share(chosen) >= quantile
    assert all(share(value) < quantile for value in values if value < chosen)


@pytest.mark.parametrize("text", ["0", "1.1", "-1", "x", "2"])
def test_what_is_no_quantile(text):
    with pytest.raises(ValueError, match=";"):
        quantile_of(text)


# ------------------------------------------------------------------------------------------------------ import


def calibrated(tmp_path, text, **options):
    path = write(tmp_path, text, "t.csv")
    return FORMAT.read([GRAPH], RosImportOptions(overlay=Overlay({"/scan": "25ms"}), calibrate=(str(path),), **options))


def wcets(imported):
    return {t.name: str(t.versions[0].wcet) if t.versions[0].wcet else None for t in imported.model.tasks}


def test_tasks_get_their_wcets_and_their_origin(tmp_path):
    imported = calibrated(tmp_path, LONG, margin=Fraction(1, 2))
    assert wcets(imported) == {"/driver": "1.8ms", "/filter": "3.75075ms", "/planner": None}
    origin = imported.model.task("/driver").versions[0].origin
    assert (origin.line, origin.path) == (4, "maximum of 2 samples, 1.2ms, with a margin of 0.5 of it")
    notes = found(imported.diagnostics, codes.CALIBRATED)
    assert {d.path: d.message.split(":")[0] for d in notes} == {
        'task "/driver"': "WCET 1.8ms",
        'task "/filter"': "WCET 3.75075ms",
    }


def test_unmeasured_tasks_and_unknown_callbacks_are_named(tmp_path):
    imported = calibrated(tmp_path, LONG + "/drivr,7\n")
    (missing,) = found(imported.diagnostics, codes.UNMEASURED)
    assert ('"/planner"' in missing.message, missing.severity) == (True, Severity.NOTE)
    (stranger,) = found(imported.diagnostics, codes.MEASURED_STRANGER)
    assert stranger.at.line == 5
    assert '"/driver"' in stranger.help
    assert ["measured_callback", 3, 2, 1] in [list(row) for row in imported.coverage.rows()]


@pytest.mark.parametrize(("count", "quantile", "few"), [(9, "1", 1), (10, "1", 0), (99, "0.99", 1), (100, "0.99", 0)])
def test_few_samples_are_said(tmp_path, count, quantile, few):
    imported = calibrated(tmp_path, "callback,duration\n" + "/driver,5\n" * count, quantile=Fraction(quantile))
    assert len(found(imported.diagnostics, codes.FEW_SAMPLES)) == few


def test_zero_is_no_wcet(tmp_path):
    imported = calibrated(tmp_path, "callback,duration\n/driver,0\n")
    assert wcets(imported)["/driver"] is None
    assert any(d.severity is Severity.WARNING for d in found(imported.diagnostics, codes.UNMEASURED))


def test_several_files_count_together(tmp_path):
    first, second = write(tmp_path, LONG, "a.csv"), write(tmp_path, "callback,duration_ms\n/driver,9\n", "b.csv")
    options = RosImportOptions(overlay=Overlay({"/scan": "25ms"}), calibrate=(str(first), str(second)))
    driver = FORMAT.read([GRAPH], options).model.task("/driver").versions[0]
    assert (str(driver.wcet), driver.origin.file) == ("9ms", str(second))


def test_broken_rows_stop_the_import(tmp_path):
    with pytest.raises(HalpipeError) as caught:
        calibrated(tmp_path, "callback,duration\n/driver,x\n/driver,y\n")
    assert [d.at.line for d in caught.value.diagnostics if d.is_error] == [2, 3]


def test_a_callback_may_be_named_as_its_graph_does():
    """In CARET's files, the callback has a name besides that of its node, which becomes the task."""
    path = FIXTURES / "calibrated.csv"
    options = RosImportOptions(overlay=Overlay({"/gps": "100ms"}), calibrate=(str(path),))
    imported = FORMAT.read([str(FIXTURES / "stack.yaml")], options)
    assert str(imported.model.task("/camera").versions[0].wcet) == "4ms"
    assert str(imported.model.task("/fusion/callback_1").versions[0].wcet) == "12ms"
