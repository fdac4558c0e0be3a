"""Traces in their three forms: what is read, exactly, and what is refused, with its line."""

import gzip
import json
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.core.durations import Duration
from halpipe.importers.traces import codes, jobs, numbers, read, read_traces
from halpipe.importers.traces.read import parse_traces
from halpipe.importers.traces.slices import events as events_of


def executions(text, file="t"):
    (trace,) = parse_traces(text.encode(), file).traces
    return trace.executions


def refusal(data):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(data if isinstance(data, bytes) else data.encode(), "t")
    found = [d for d in refused.value.diagnostics if d.is_error]
    assert all(d.help for d in found)
    return found


def told(text, code):
    return [found for found in parse_traces(text.encode(), "t").diagnostics if found.code == code.id]


# ------------------------------------------------------------------------------------------------ CSV


@pytest.mark.parametrize(("cell", "data"), [("0", False), ("1", True), ("", None)])
def test_a_table_says_whether_there_was_a_message(cell, data):
    (seen,) = executions(f"task,start,end,data\na,1,2,{cell}\n")
    assert seen.has_data is data


def test_a_flag_that_is_none_is_a_broken_row():
    assert [d.code for d in refusal("task,start,end,data\na,1,2,yes\n")] == [codes.BROKEN_ROW.id]


def test_every_column_of_a_table_is_read():
    (seen,) = executions("cycle,mode,task,job,units,start,end,busy\n3,race->slow,/a,2,c1 c2,10.5,20,9\n")
    assert (seen.cycle, seen.table, seen.task, seen.job, seen.units) == (3, "race->slow", "/a", 2, ("c1", "c2"))
    assert (seen.start, seen.end, seen.busy) == (Duration(Fraction(21, 2)), Duration(20), Duration(9))
    assert seen.at.line == 2


@pytest.mark.parametrize(("unit", "ns"), [("ns", 1), ("us", 10**3), ("ms", 10**6), ("s", 10**9)])
def test_the_name_of_a_time_column_states_its_unit(unit, ns):
    (seen,) = executions(f"start_{unit},task,end\n1/3,a,9000000000\n")
    assert (seen.start, seen.end) == (Duration(Fraction(ns, 3)), Duration(9 * 10**9))


@pytest.mark.parametrize("text", ["task;start [us];end (us)\nb;10,5;20\n", "task\tstart_us\tend_us\nb\t10.5\t20\n"])
def test_tables_of_spreadsheets(text):
    (seen,) = executions(text)
    assert (seen.task, seen.start.ns, seen.end.ns) == ("b", 10_500, 20_000)


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("task;start;end\nb;1,5;2,5\nb;1.500;2,5\n", [3]),
        ("task;start;end\nb;1.500,5;2\n", [2]),
        ('task,start,end\nb,"1,5",2\n', [2]),
    ],
)
def test_decimal_signs_that_may_mean_thousands_are_refused(text, lines):
    assert [d.at.line for d in refusal(text)] == lines


def test_rows_are_ordered_by_their_start_and_blank_lines_are_none():
    seen = executions("task,start,end,unit\nb,5,6,c\n\na,1,2,c\n")
    assert [(e.task, e.units, e.cycle, e.job, e.table) for e in seen] == [
        ("a", ("c",), None, None, ""),
        ("b", ("c",), None, None, ""),
    ]


def test_a_job_without_an_end_still_ran():
    text = "task,start,end\na,1,\n"
    assert executions(text)[0].end is None
    assert len(told(text, codes.UNFINISHED)) == 1


@pytest.mark.parametrize("row", ["a,1,5,2,5", "a,1,2,,x"])
@pytest.mark.parametrize("head", ["task,start,end", "time,a,b"])
def test_values_without_a_column_are_refused(head, row):
    """Of decimal commas in a table that is separated by commas, the first part would be the time."""
    row = row if head.startswith("task") else row.replace("a", "2").replace("5,2", "0,1")
    assert (codes.BROKEN_ROW.id, 3) in rejected(f"{head}\n{'a,1,2,' if head < 'time' else '1,0,0'}\n{row}\n")


def test_a_short_row_has_empty_cells():
    assert executions("task,start,end,job\na,1\n")[0].end is None


@pytest.mark.parametrize(
    "row", [",1,2", "a,,2", "a,x,2", "a,1,2e3", "a,5,1", "a,1,nan", "a,1/0,2", "a,1,2,1.5", "a,1,2,1,-1"]
)
def test_rows_that_cannot_be_read_are_all_named(row):
    found = refusal(f"task,start,end,job,busy\nb,1,2\n{row}\n{row}\n")
    assert [(d.code, d.at.line) for d in found] == [(codes.BROKEN_ROW.id, 3), (codes.BROKEN_ROW.id, 4)]


@pytest.mark.parametrize("busy", ["0", "4"])
def test_a_job_runs_for_any_time_from_0_on(busy):
    assert executions(f"task,start,end,busy\na,1,5,{busy}\n")[0].busy == Duration(int(busy))
    assert executions("task,start,end\na,5,5\n")[0].end == Duration(5)


@pytest.mark.parametrize("cells", ["0.0;1.0;0.0", "0,0;1,0;0,0", "0;1;0", "0;1.0;0.0"])
def test_states_are_0_and_1_in_any_notation(cells):
    rows = "".join(f"{at};{cell}\n" for at, cell in enumerate(cells.split(";")))
    (seen,) = executions(f"Time [us];A\n{rows}")
    assert (seen.start.ns, seen.end.ns) == (1000, 2000)


@pytest.mark.parametrize("between", ["", "\n", "s;\n", "\ns;\n\n", "\n\n\ns;on\n"])
def test_one_row_behind_the_head_of_signals_may_state_units(between):
    text = f"Time;A\n{between}0;0\n1;1\n2;0\n"
    assert [e.start.ns for e in executions(text)] == [10**9]
    assert rejected(text.replace("1;1", "s;1")) == [(codes.BROKEN_ROW.id, between.count("\n") + 3)]
    assert (codes.BROKEN_ROW.id, 3) in rejected("Time;A\ns;\ns;\n0;0\n1;1\n")


@pytest.mark.parametrize("name", ["task", "start", "end"])
def test_the_columns_of_a_table_may_be_in_any_order_and_quoted(name):
    names = ["task", "start", "end"]
    names.sort(key=lambda each: each != name)
    row = {"task": "a b", "start": "3", "end": "9"}
    text = ",".join(f'"{each}"' for each in names) + "\n" + ",".join(f'"{row[each]}"' for each in names) + "\n"
    (seen,) = executions(text)
    assert (seen.task, seen.start.ns, seen.end.ns) == ("a b", 3, 9)


# ------------------------------------------------------------------------------------------------ BTF


@pytest.mark.parametrize("first", ["preempt", "resume", "wait", "park", "run"])
def test_a_btf_job_that_began_before_the_recording_is_left_out(first):
    text = f"#version 2.2\n1,c,0,T,a,4,{first}\n2,c,0,T,a,4,resume\n3,c,0,T,a,4,terminate\n"
    text += "5,c,0,T,a,5,start\n6,c,0,T,a,5,terminate\n"
    assert [(e.start.ns, e.end.ns) for e in executions(text)] == [(5, 6)]
    assert [d.message for d in told(text, codes.ALREADY_RUNNING)] == ["1 job without a start"]
    assert not told(text, codes.ODD_SEQUENCE)


def test_a_btf_recording_may_begin_within_a_table():
    """The end of a job is the first event of its core, and another job starts before the first mark of a table."""
    text = "#version 2.2\n1,a,4,R,f,4,terminate\n1,c,0,T,a,4,terminate\n2,c,0,T,b,5,start\n3,c,0,T,b,5,terminate\n"
    text += "4,STI_TABLE_m,7,STI,STI_TABLE_m,7,trigger\n4,c,0,T,a,6,start\n6,c,0,T,a,6,terminate\n"
    assert [(e.start.ns, e.table, e.cycle) for e in executions(text)] == [(4, "m", 7)]
    found = [d.message for d in told(text, codes.ALREADY_RUNNING)]
    assert found == ["1 job without a start", "1 job before the first table"]
    assert not told(text, codes.ODD_SEQUENCE)


BTF = """#version 2.1.5
#timescale us
#creator a pencil
0,STI_TABLE_race,0,STI,STI_TABLE_race,0,trigger
0,STI_a,0,T,TASK_a,0,activate
1,Core_1,0,T,TASK_a,0,start
# a comment
2,Core_1,0,T,TASK_a,0,preempt
2,Core_1,0,T,TASK_b,7,start,with, a note
4,Core_1,0,T,TASK_b,7,terminate
4,Core_1,0,T,TASK_a,0,resume
7,Core_1,0,T,TASK_a,0,terminate
7,Core_1,0,SIG,x,0,write
"""


def test_btf_jobs_run_from_start_to_terminate_without_what_preempts_them():
    a, b = executions(BTF)
    assert (a.task, a.units, a.start, a.end, a.busy) == (
        "TASK_a",
        ("Core_1",),
        Duration(1000),
        Duration(7000),
        Duration(4000),
    )
    assert (b.task, b.start, b.end, b.busy) == ("TASK_b", Duration(2000), Duration(4000), Duration(2000))
    assert {(e.table, e.cycle) for e in (a, b)} == {("race", 0)}
    assert "1 of SIG" in told(BTF, codes.LEFT_OUT)[0].message


@pytest.mark.parametrize(("scale", "ps"), [("ps", 1), ("ns", 10**3), ("us", 10**6), ("ms", 10**9), ("s", 10**12)])
def test_btf_time_scales_are_exact(scale, ps):
    seen = executions(f"#timeScale {scale}\n3,Core_1,0,T,a,0,start\n5,Core_1,0,T,a,0,terminate\n")
    assert seen[0].start == Duration(Fraction(3 * ps, 1000))


def test_btf_events_that_contradict_each_other_are_left_out_and_told():
    text = "0,C,0,T,c,0,start\n1,C,0,T,a,0,terminate\n2,C,0,T,b,0,start\n3,C,0,T,b,0,start\n4,C,0,T,b,0,terminate\n"
    assert [e.task for e in executions(text)] == ["c", "b"]
    assert [d.at.line for d in told(text, codes.ODD_SEQUENCE)] == [2, 4]


def test_btf_without_an_end():
    text = "1,C,0,T,a,0,start\n"
    assert executions(text)[0].end is None
    assert len(told(text, codes.UNFINISHED)) == 1


@pytest.mark.parametrize("row", ["1,C,0,T,a", "x,C,0,T,a,0,start", "1.5x,C,0,T,a,0,start", "1,C,0,T,a,z,start"])
def test_btf_rows_that_cannot_be_read(row):
    found = refusal(f"#version 2.1.5\n1,C,0,T,a,0,start\n{row}\n")
    assert [(d.code, d.at.line) for d in found] == [(codes.BROKEN_ROW.id, 3)]


def test_btf_time_scale_that_is_none():
    assert [d.code for d in refusal("#timeScale fortnight\n1,C,0,T,a,0,start\n")] == [codes.BROKEN_ROW.id]


def test_a_btf_job_polls_parks_and_runs_on_elsewhere():
    """BTF 2.1.5, states of tasks: polling occupies the core, parking does not, poll_parking and run end a pause."""
    text = """#timeScale us
0,c1,0,T,A,0,start
10,c1,0,T,A,0,poll
20,c1,0,T,A,0,park
50,c2,0,T,A,0,poll_parking
60,c2,0,T,A,0,run
95,c2,0,T,A,0,terminate
100,c1,0,T,A,1,start
110,c1,0,T,A,1,poll
120,c1,0,T,A,1,run
125,c1,0,T,A,1,park
130,c1,0,T,A,1,release_parking
140,c1,0,T,A,1,resume
150,c1,0,T,A,1,terminate
"""
    first, second = executions(text)
    assert (first.units, first.busy.ns, first.start.ns, first.end.ns) == (("c1", "c2"), 65_000, 0, 95_000)
    assert [(a.ns, b.ns) for a, b in first.stretches] == [(0, 20_000), (50_000, 95_000)]
    assert (second.units, second.busy.ns) == (("c1",), 35_000)
    assert not told(text, codes.ODD_SEQUENCE)


def test_btf_runnables_are_jobs_where_no_task_is_recorded():
    """They are suspended and resumed; where tasks come later, those count alone."""
    rows = ["0,T,0,R,f,0,start", "2,T,0,R,f,0,suspend", "5,T,0,R,f,0,resume", "9,T,0,R,f,0,terminate"]
    (seen,) = executions("#timeScale ns\n" + "\n".join(rows) + "\n")
    assert (seen.task, seen.start.ns, seen.end.ns, seen.busy.ns) == ("f", 0, 9, 6)
    assert [(a.ns, b.ns) for a, b in seen.stretches] == [(0, 2), (5, 9)]
    later = ["3,C,0,T,t,0,start", "8,C,0,T,t,0,terminate"]
    text = "#timeScale ns\n" + "\n".join([*rows[:1], *later, *rows[1:]]) + "\n"
    assert [(e.task, e.busy.ns) for e in executions(text)] == [("t", 5)]


def test_btf_events_of_unknown_name_are_counted():
    text = "1,C,0,T,a,0,start\n2,C,0,T,a,0,levitate\n4,C,0,T,a,0,terminate\n"
    assert "1 of levitate" in told(text, codes.LEFT_OUT)[0].message


NUMERIC = """#timeScale us
#{types}
#-0 T
#-1 C
#-2 STI
#entityTable
#-0 A
#-1 c1
#-2 STI_TABLE_run
#entityTypeTable
#-T A
0,2,0,2,2,0,trigger
0,1,0,0,0,0,start
30,1,0,0,0,0,terminate
"""


@pytest.mark.parametrize("types", ["typeTable", "entityType"])
def test_btf_types_and_entities_by_their_numbers(types):
    (seen,) = executions(NUMERIC.replace("{types}", types))
    assert (seen.task, seen.units, seen.end.ns, seen.table) == ("A", ("c1",), 30_000, "run")


@pytest.mark.parametrize("lost", ["#-0 T\n", "#-0 A\n", "#-1 c1\n"])
def test_btf_numbers_without_a_table_are_broken_rows(lost):
    found = refusal(NUMERIC.replace("{types}", "typeTable").replace(lost, ""))
    assert {d.code for d in found} == {codes.BROKEN_ROW.id}


@pytest.mark.parametrize("counts", [(4, 5, 6, 7), (0, 0, 0, 1)])
def test_btf_tables_are_counted_together_or_each_by_itself(counts):
    names = ("m", "m->n", "n", "n")
    marks = [
        f"{n},S,0,STI,STI_TABLE_{name},{count},trigger"
        for n, (name, count) in enumerate(zip(names, counts, strict=True))
    ]
    jobs = [f"{n},C,0,T,a,{n},{event}" for n in range(4) for event in ("start", "terminate")]
    seen = executions("\n".join(["#timeScale s", *marks, *jobs]))
    assert [e.table for e in seen] == list(names)
    assert [e.cycle - seen[0].cycle for e in seen] == [0, 1, 2, 3]


# ------------------------------------------------------------------------------------------------ Trace Event Format


def test_slices_are_executions_and_threads_units():
    text = """{"traceEvents":[
    {"ph":"M","name":"process_name","pid":1,"tid":0,"args":{"name":"mode race"}},
    {"ph":"M","name":"thread_name","pid":1,"tid":4,"args":{"name":"core0"}},
    {"ph":"X","name":"a","pid":1,"tid":4,"ts":0.1,"dur":0.25,"args":{"job":2,"cycle":1,"table":"race"}},
    {"ph":"X","name":"a","pid":1,"tid":5,"ts":0.1,"dur":0.25,"args":{"job":2,"cycle":1,"table":"race"}},
    {"ph":"X","name":"b","pid":2,"tid":1,"ts":7,"dur":1},
    {"ph":"X","name":"c","pid":2,"tid":1,"ts":7,"dur":1,"args":{"ends":"after this trace"}},
    {"ph":"C","name":"bus","pid":1,"ts":1}]}"""
    first, second = parse_traces(text.encode(), "t").traces
    assert (first.name, second.name) == ("mode race", "2")
    (a,) = first.executions
    assert (a.task, a.units, a.job, a.cycle, a.table) == ("a", ("core0", "5"), 2, 1, "race")
    assert (a.start, a.end) == (Duration(100), Duration(350))
    assert [(e.task, e.start) for e in second.executions] == [("b", Duration(7000))]
    assert len(told(text, codes.LEFT_OUT)) == 1


def slices(*events):
    traces = parse_traces(json.dumps([{"pid": 1, "tid": 1, "name": "a", **event} for event in events]).encode(), "t")
    return [(e.task, e.start.ns, e.end and e.end.ns) for trace in traces.traces for e in trace.executions], traces


def test_slices_that_begin_and_end_are_nested_on_their_thread():
    found, _ = slices(
        {"ph": "B", "ts": 1},
        {"ph": "B", "ts": 2, "tid": 2, "name": "c"},
        {"ph": "B", "ts": 3, "name": "b"},
        {"ph": "E", "ts": 9, "tid": 2},
        {"ph": "E", "ts": 7},  # recorders write the events of a thread after one another
        {"ph": "E", "ts": 4, "name": "b"},
    )
    assert found == [("a", 1000, 7000), ("c", 2000, 9000), ("b", 3000, 4000)]


@pytest.mark.parametrize(("begin", "end"), ["be", "SF"])
def test_asynchronous_slices_are_paired_by_their_id(begin, end):
    found, _ = slices(
        {"ph": begin, "ts": 1, "id": 1},
        {"ph": begin, "ts": 2, "id": "0x2", "name": "b"},
        {"ph": end, "ts": 3, "id": 1},
        {"ph": end, "ts": 4, "id": "0x2", "tid": 7},
    )
    assert found == [("a", 1000, 3000), ("b", 2000, 4000)]


def test_slices_without_an_end_or_a_beginning():
    found, recording = slices({"ph": "E", "ts": 0}, {"ph": "B", "ts": 1}, {"ph": "i", "ts": 2}, {"ph": "C", "ts": 2})
    assert found == [("a", 1000, None)]
    assert [d.code for d in recording.diagnostics] == [codes.ODD_SEQUENCE.id, codes.UNFINISHED.id, codes.LEFT_OUT.id]
    assert "1 of phase C, 1 of phase i" in recording.diagnostics[-1].message


def test_a_slice_without_a_duration_ran_when_the_trace_ended():
    """Chrome writes such slices; the others are read beside them."""
    found, recording = slices({"ph": "X", "ts": 1, "dur": 2}, {"ph": "X", "ts": 9}, {"ph": "B", "ts": 4, "tid": 2})
    assert found == [("a", 1000, 3000), ("a", 4000, None), ("a", 9000, None)]
    (note,) = recording.diagnostics
    assert (note.code, note.message) == (codes.UNFINISHED.id, "2 slices without an end")


@pytest.mark.parametrize("broken", [{"ph": "B"}, {"ph": "E", "ts": "one"}, {"ph": "X", "ts": 1, "dur": -1}])
def test_slices_whose_times_cannot_be_read(broken):
    text = json.dumps([{"ph": "B", "ts": 0, "name": "a"}, {"name": "a", **broken}, {"ph": "E", "ts": 5}])
    assert codes.BROKEN_ROW.id in [d.code for d in refusal(text)]


LIST = '[{"ph":"X","name":"a","ts":1,"dur":2},\n{"ph":"X","name":"b","ts":3,"dur":2}'


@pytest.mark.parametrize("begin", ["", '{"otherData": {"a": [1]}, "traceEvents": '])
def test_a_list_of_events_may_lack_its_last_bracket(begin):
    for end in (",\n", "\n"):
        assert len(executions(begin + LIST + end)) == 2
        assert len(told(begin + LIST + end, codes.NO_END)) == 1


@pytest.mark.parametrize("size", [1, 2, 7, 30])
def test_a_document_is_read_in_pieces_of_any_size(size):
    text = '{"a": [1, {"b": "]"}], "n": 12, "traceEvents": ' + LIST + ', 3, {"ph": "C"}], "z": 1.5e1} \n'
    pieces = (text[at : at + size] for at in range(0, len(text), size))
    found = list(events_of(pieces, "t", Findings()))
    assert [(line, event["ph"]) for line, event in found] == [(1, "X"), (2, "X"), (2, "C")]


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("[1 2]", 1),
        ('{"traceEvents":\n[{"a"}]}', 2),
        (LIST + "]\n]", 3),
        ('{"a" 1}', 1),
        (LIST.replace('"ts":3', '"ts":3,"ts":4') + "]", 2),
        ('{"traceEvents": [],\n"traceEvents": ' + LIST + "]}", 2),
    ],
)
def test_a_document_that_is_no_json_is_refused_with_its_line(text, line):
    (found,) = refusal(text)
    assert (found.code, found.at.line) == (codes.UNKNOWN_TRACE.id, line)


def test_an_event_is_bounded(monkeypatch):
    monkeypatch.setattr("halpipe.importers.traces.slices.LARGEST_VALUE", 100)
    monkeypatch.setattr(read, "_CHUNK", 10)
    within = '[{"ph":"X","name":"a","ts":1,"dur":2,"args":{"text":"' + "x" * 30 + '"}}]'
    assert len(executions(within)) == 1
    assert "more than 100 characters" in refusal(within.replace("x", "xxxxxx"))[0].message


def test_the_same_slices_by_writers_with_other_habits():
    named = {"ph": "M", "name": "thread_name", "tid": 1, "args": {"name": "cpu0"}}
    whole = [{"ph": "X", "name": n, "tid": 1, "ts": t, "dur": 2} for n, t in (("a", 1), ("b", 3), ("c", 5))]
    marks = [
        {"ph": p, "name": e["name"], "tid": 1, "ts": e["ts"] + at} for e in whole for p, at in (("B", 0), ("E", 2))
    ]
    texts = [{**e, "tid": "1", **{key: str(e[key]) for key in ("ts", "dur") if key in e}} for e in whole]
    written = [[named, *whole], [*whole, named], [named, *marks], [named, *reversed(marks)], [named, *texts]]
    # begins before ends of the same instant, which only the names tell apart
    written.append([named, *sorted(marks, key=lambda event: (event["ts"], event["ph"]))])
    for events in written:
        found = [(e.task, e.units, e.start.ns, e.end.ns) for e in executions(json.dumps(events))]
        assert found == [("a", ("cpu0",), 1000, 3000), ("b", ("cpu0",), 3000, 5000), ("c", ("cpu0",), 5000, 7000)]


@pytest.mark.parametrize(("end", "is_odd"), [("a", False), ("", False), ("b", True)])
def test_an_end_of_a_name_that_none_has_is_reported(end, is_odd):
    """Chrome takes it for the end of the last slice, Perfetto for none."""
    events = [{"ph": phase, "tid": 1, "ts": at, "name": name} for phase, at, name in (("B", 1, "a"), ("E", 3, end))]
    recording = parse_traces(json.dumps(events).encode(), "t")
    assert [(e.task, e.start.ns, e.end.ns) for e in recording.traces[0].executions] == [("a", 1000, 3000)]
    found = [d.message for d in recording.diagnostics]
    assert found == (["a slice ends by another name than the one that runs"] if is_odd else [])


@pytest.mark.parametrize("value", ['"1 us"', "true", "null", "1e99999999", "NaN", "[1]"])
def test_times_that_are_no_numbers(value):
    found = refusal(f'[{{"ph":"X","name":"a","ts":{value},"dur":1}}]')
    assert [d.code for d in found] == [codes.BROKEN_ROW.id]


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r", "\n\n"])
def test_tables_have_the_line_ends_of_any_system(end):
    text = end.join(["", "task,start,end", "a,1,2", "b,3,4", ""])
    assert [(e.task, e.start.ns, e.end.ns) for e in parse_traces(text.encode(), "t").traces[0].executions] == [
        ("a", 1, 2),
        ("b", 3, 4),
    ]


def test_equal_rows_of_a_table_are_two_jobs():
    (trace,) = parse_traces(b"task,start,end\na,1,2\na,1,2\n", "t").traces
    assert len(trace.executions) == 2


@pytest.mark.parametrize(
    "text", ["task,start,end," + "c" * 200_000 + "\na,1,2\n", "task,start,end\na,1," + "2" * 200_000]
)
def test_cells_that_the_library_refuses_are_told(text):
    assert codes.BROKEN_ROW.id in [d.code for d in refusal(text)]


# ------------------------------------------------------------------------------------------------ all


@pytest.mark.parametrize("data", ["", "hello", "<xml/>", "{", '{"a":1}', "[" * 100_000, b"\xff\xfe", "a,b\n1,2\n"])
def test_what_is_no_trace(data):
    assert [d.code for d in refusal(data)] == [codes.UNKNOWN_TRACE.id]


@pytest.mark.parametrize(
    ("data", "name"),
    [
        (b"\x17\x08Dtracing6\0", "trace.dat"),
        (b"MDF     4.10    ", "MDF"),
        (b"\n\x18\x12\x02\x08\0\x40\1", "protobuf"),
        (b"\xc1\x1f\xfc\xc1\0\0", "CTF"),
    ],
)
def test_traces_that_cannot_be_read_are_called_by_their_names(data, name):
    (found,) = refusal(data)
    assert found.code == codes.UNKNOWN_TRACE.id
    assert name in found.message


@pytest.mark.parametrize("text", ["task,start,end\n", "#version 2\n", "[]", '{"traceEvents":[{}]}'])
def test_a_trace_in_which_nothing_ran(text):
    assert refusal(text)[-1].code == codes.NO_EXECUTIONS.id


def test_a_trace_is_read_from_its_file(tmp_path):
    (tmp_path / "t.csv").write_text("task,start,end\na,1,2\n")
    assert read_traces(str(tmp_path / "t.csv")).traces[0].executions[0].at.file == str(tmp_path / "t.csv")


LINES = [*BTF.split("\n"), "{", "task,start,end", "a,1,2"]


@given(st.one_of(st.text(max_size=200), st.lists(st.sampled_from(LINES))))
def test_whatever_the_text_it_is_read_or_refused_with_a_code(text):
    text = text if isinstance(text, str) else "\n".join(text)
    try:
        parse_traces(text.encode("utf-8", "surrogatepass"), "t")
    except HalpipeError:
        return  # with codes; anything else would escape


CARET_RECORDS = (
    "index,/n/callback_0/callback_start_timestamp,/n/callback_0/callback_end_timestamp,"
    "/m/callback_1/callback_start_timestamp,/m/callback_1/callback_end_timestamp\n"
)


def test_records_of_caret_are_executions_each_once():
    text = CARET_RECORDS + "0,1000.0,1500,2000,2600\n1,1000,1500,3000,\n2,nan,nan,,\n"
    found = executions(text)
    assert [(e.task, str(e.start), None if e.end is None else str(e.end)) for e in found] == [
        ("/n/callback_0", "1us", "1.5us"),
        ("/m/callback_1", "2us", "2.6us"),
        ("/m/callback_1", "3us", None),
    ]


def test_cells_of_records_without_a_start_are_counted():
    (found,) = told(CARET_RECORDS + "0,1000.0,1500,2000,2600\n1,1000,1500,nan,\n2,nan,nan,,\n", codes.LEFT_OUT)
    assert found.message.startswith("3 cells")


def test_a_record_that_ends_before_it_starts_is_named():
    assert [d.at.line for d in refusal(CARET_RECORDS + "0,9,1,,\n") if d.code == codes.BROKEN_ROW.id] == [2]


def test_the_long_form_of_calibrate_is_a_trace_where_it_has_instants():
    (found,) = executions("callback_name,callback_start_timestamp,callback_end_timestamp\n/n/a,5,9\n")
    assert (found.task, found.start.ns) == ("/n/a", 5)
    assert "starts and ends" in refusal("callback,duration_ns\n/n/a,5\n")[0].help


def test_a_text_that_begins_with_a_number_sign_is_no_trace_for_that():
    with pytest.raises(HalpipeError) as failure:
        parse_traces(b"# A title\n\nWords, and more words.\n", "t")
    assert [found.code for found in failure.value.diagnostics] == [codes.UNKNOWN_TRACE.id]
    for head in (b"# A remark\n", b"#version 2.2.0\n", b"# A remark\n\n"):
        assert parse_traces(head + b"0,c,0,T,t,0,start\n9,c,0,T,t,0,terminate\n", "t").traces[0].executions


def test_texts_in_utf_16_and_files_of_gzip():
    text = "task,start,end\nä,1,2\n"
    for data in (text.encode("utf-16"), gzip.compress(text.encode()), gzip.compress(text.encode("utf-16"))):
        (trace,) = parse_traces(data, "t").traces
        assert [(seen.task, seen.start.ns) for seen in trace.executions] == [("ä", 1)]


@pytest.mark.parametrize("damage", [slice(None, -12), slice(None, 15), slice(2, None)])
def test_files_of_gzip_that_are_damaged(damage):
    packed = gzip.compress(b"task,start,end\n" + b"".join(b"a,%d,%d\n" % (n, n + 1) for n in range(999)))
    assert (
        refusal(packed[damage] if damage.start is None else b"\x1f\x8b" + packed[4:])[0].code == codes.UNKNOWN_TRACE.id
    )


@pytest.mark.parametrize(
    "text", ["task,start,end\na,1,2", "1,Core_a,0,T,TASK_a,0,start\n5,Core_a,0,T,TASK_a,0,terminate"]
)
def test_a_text_that_ends_within_a_line_may_be_cut_off(text):
    assert [found.at.line for found in told(text, codes.NO_END)] == [2]
    assert told(text + "\n", codes.NO_END) == []


def test_marks_of_one_instant_are_in_the_order_of_their_cycles():
    marks = ["0,STI_TABLE_b,1,STI,STI_TABLE_b,1,trigger", "0,STI_TABLE_a,0,STI,STI_TABLE_a,0,trigger"]
    job = ["2,Core_a,0,T,TASK_a,0,start", "3,Core_a,0,T,TASK_a,0,terminate"]
    (seen,) = executions("\n".join([*marks, *job]) + "\n")
    assert (seen.table, seen.cycle) == ("b", 1)


@pytest.mark.parametrize("text", ["[Log]\nstart of the run\n", "{a: 1}", '{"events": []}', '{"traceEvents": {}}'])
def test_a_text_that_only_begins_like_json_is_not_to_be_recorded_again(text, tmp_path):
    (tmp_path / "t.json").write_text(text)
    with pytest.raises(HalpipeError) as refused:
        read_traces(str(tmp_path / "t.json"))
    *_, found = refused.value.diagnostics
    assert found.code == "HAL1120"
    assert "in the Trace Event Format" in found.help


def two_processes(second, *, tables=False):
    """Slices A and another one of two processes at 1 and 4 us, on threads of equal name."""
    args = {"table": "run", "played": 0, "job": 0} if tables else {}
    events = [{"ph": "M", "name": "thread_name", "pid": p, "tid": 1, "args": {"name": "c0"}} for p in (1, 2)]
    for process, name, at in ((1, "A", 1), (2, second, 4)):
        events.append({"ph": "X", "name": name, "pid": process, "tid": 1, "ts": at, "dur": 2, "args": args})
    return parse_traces(json.dumps(events).encode(), "t").traces


def test_processes_without_a_task_in_common_are_one_line_of_time():
    (found,) = two_processes("B")
    assert [(e.task, e.units, e.start.ns) for e in found.executions] == [("A", ("c0",), 1000), ("B", ("c0",), 4000)]
    assert len(two_processes("A")) == 2  # two computers that run the same
    assert len(two_processes("B", tables=True)) == 2  # pictures of halpipe begin at 0 each


def test_contradictions_of_one_kind_are_reported_once():
    lost = "".join(f"{n},Core_u,0,T,TASK_a,{n},terminate\n" for n in range(10, 110))
    whole = "#version 2.1.5\n0,Core_u,0,T,TASK_b,0,start\n5,Core_u,0,T,TASK_b,0,terminate\n"
    found = parse_traces((whole + lost).encode(), "t")
    odd = [d for d in found.diagnostics if d.code == codes.ODD_SEQUENCE.id]
    assert [(d.message, d.at.line) for d in odd] == [("terminate without start; 100 times, this is the first", 4)]


def test_contradictions_are_counted_from_the_second_on():
    for count, shown in ((1, ""), (2, "; 2 times, this is the first")):
        lost = "".join(f"{n},C,0,T,b,{n},terminate\n" for n in range(10, 10 + count))
        (found,) = told("#version 2.1.5\n0,C,0,T,a,0,start\n5,C,0,T,a,0,terminate\n" + lost, codes.ODD_SEQUENCE)
        assert found.message == "terminate without start" + shown


def test_a_counter_that_wraps_is_reported():
    """Of BTF, in which events stand in the order of time; those of another core may come later."""
    text = "#version 2.1.5\n4294967290,Core_u,0,T,TASK_a,0,start\n4294967295,Core_u,0,T,TASK_a,0,terminate\n"
    other = "9,Core_v,0,T,TASK_b,0,start\n12,Core_v,0,T,TASK_b,0,terminate\n"
    again = "3,Core_u,0,T,TASK_a,1,start\n7,Core_u,0,T,TASK_a,1,terminate\n"
    assert parse_traces((text + other).encode(), "t").diagnostics == ()
    (found,) = parse_traces((text + other + again).encode(), "t").diagnostics
    assert (found.code, found.at.line) == (codes.ODD_SEQUENCE.id, 6)
    assert "wrap" in found.help


def test_a_text_in_another_encoding_has_advice_that_helps():
    with pytest.raises(HalpipeError) as refused:
        parse_traces("task,start,end\nM\xfcll,1,2\n".encode("latin-1"), "t")
    assert refused.value.diagnostics[0].help == "unpack it, or save it as UTF-8"


def test_a_folder_without_a_trace_is_told_from_a_file(tmp_path):
    with pytest.raises(HalpipeError) as refused:
        read_traces(str(tmp_path))
    assert [d.code for d in refused.value.diagnostics] == [codes.NO_CTF.id]


def test_the_separator_that_a_spreadsheet_states_is_no_header():
    (found,) = parse_traces(b"sep=;\ntask;start;end\na;1;2\n", "t").traces
    assert [(e.task, e.start.ns, e.at.line) for e in found.executions] == [("a", 1, 3)]


@pytest.mark.parametrize(
    "header", ["task,start,start_us,end", "task,name,start,end", "task,start,end,end", "task,start,end,unit,core"]
)
def test_two_columns_of_one_meaning_are_refused(header):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(f"{header}\na,1,2,3,4\n".encode(), "t")
    assert "two columns have one meaning" in [d.message for d in refused.value.diagnostics]


@pytest.mark.parametrize("names", [("cycle",), ("job",), ("cycle", "job")])
def test_numbers_without_the_mode_that_they_count_in_are_reported(names):
    def found(header):
        rows = f"{header}\na,1,2{',0' * (header.count(',') - 2)}\n"
        return [(d.code, d.message, d.at.line) for d in parse_traces(rows.encode(), "t").diagnostics]

    header = ",".join(("task,start,end", *names))
    assert found(header) == [(codes.NO_MODE.id, f"{' and '.join(names)} without mode", 1)]
    assert found(f"{header},mode") == []


def rejected(text):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(text.encode(), "t")
    return [(d.code, d.at.line) for d in refused.value.diagnostics]


def test_numbers_beyond_every_counter_are_broken_rows():
    for count in ("9" * 20, "9" * 5000):
        mark = f"STI_TABLE_m,{count}"
        text = f"#version 2.1.5\n0,{mark},STI,{mark},trigger\n1,C,0,T,a,0,start\n3,C,0,T,a,0,terminate\n"
        assert rejected(text) == [(codes.BROKEN_ROW.id, 2)]
    event = {"name": "a", "ph": "X", "pid": 1, "tid": 1, "ts": 0, "dur": 5, "args": {"cycle": 2**70, "job": 0}}
    assert rejected(json.dumps([event])) == [(codes.BROKEN_ROW.id, 1)]


def test_events_that_differ_in_what_is_no_key_are_read_like_the_first():
    """Where an event goes is kept for the next one of its phase, process, thread and name."""
    first = {"name": "a", "ph": "X", "pid": 1, "tid": 1, "ts": 0, "dur": 5}
    assert rejected(json.dumps([first, {**first, "dur": None}])) == [(codes.BROKEN_ROW.id, 1)]
    assert rejected(json.dumps([first, {**first, "ts": 9, "dur": -1}])) == [(codes.BROKEN_ROW.id, 1)]
    assert rejected(json.dumps([first, {**first, "name": ["a"]}])) == [(codes.BROKEN_ROW.id, 1)]
    (line,) = parse_traces(json.dumps([first, {**first, "tid": 2, "ts": 9}]).encode(), "t").traces
    assert [each.units for each in line.executions] == [("1",), ("2",)]


@pytest.mark.parametrize("by_name", [False, True])
def test_many_slices_are_paired_as_few_are(by_name):
    """Columns pair what nests, and search by name where an end is not of the last begin."""
    stack = [("B", "outer", 0), ("B", "inner", 1), ("E", "inner", 2), ("E", "outer", 4)]
    odd = [("B", "outer", 0), ("B", "inner", 1), ("E", "outer", 2), ("E", "inner", 4)]
    events = [
        {"name": name, "ph": phase, "pid": 1, "tid": 1, "ts": 10 * turn + at}
        for turn in range(100)
        for phase, name, at in (odd if by_name and turn == 50 else stack)
    ]
    (many,) = parse_traces(json.dumps(events).encode(), "t").traces
    few = [
        each
        for at in range(0, 400, 4)
        for each in parse_traces(json.dumps(events[at : at + 4]).encode(), "t").traces[0].executions
    ]
    assert [*many.executions] == few


def test_the_parts_of_a_job_on_all_of_its_units_are_one_job():
    """The slices of a job in the schedule's own picture: one for each part and unit, in any order."""
    parts = [(part, unit) for part in ((8, 3), (1, 2), (5, 2)) for unit in (1, 2)]
    args = {"table": "run", "cycle": 4, "job": 7, "part": 0}
    events = [
        {"ph": "X", "name": "a", "pid": 1, "tid": unit, "ts": at, "dur": length, "args": args}
        for (at, length), unit in parts
    ]
    (seen,) = executions(json.dumps(events))
    assert [(a.ns, b.ns) for a, b in seen.stretches] == [(1000, 3000), (5000, 7000), (8000, 11000)]
    assert (seen.start.ns, seen.end.ns, seen.busy.ns, seen.units) == (1000, 11000, 7000, ("1", "2"))
    assert (seen.table, seen.cycle, seen.job) == ("run", 4, 7)


def test_a_cycle_has_at_most_18_digits():
    event = {"name": "a", "ph": "X", "pid": 1, "tid": 1, "ts": 0, "dur": 5}
    for cycle in (10**18, -(10**18)):
        (seen,) = executions(json.dumps([{**event, "args": {"cycle": cycle, "job": 0}}]))
        assert seen.cycle == cycle
        beyond = cycle + (1 if cycle > 0 else -1)
        assert rejected(json.dumps([{**event, "args": {"cycle": beyond}}])) == [(codes.BROKEN_ROW.id, 1)]


def test_well_nested_slices_are_paired_by_columns_alone(monkeypatch):
    """Pairing by name takes a step of Python for each event, which a recording of millions does not bear."""
    monkeypatch.setattr(jobs.Marks, "_by_name", None)
    names = "abc"
    events = [
        {"name": name, "ph": phase, "pid": 1, "tid": 1, "ts": 10 * turn + at}
        for turn in range(30)
        for phase, name, at in [("B", n, i) for i, n in enumerate(names)]
        + [("E", n, 9 - i) for i, n in enumerate(names)]
    ]
    events.append({"name": "open", "ph": "B", "pid": 1, "tid": 1, "ts": 400})
    for order in (1, -1):
        (line,) = parse_traces(json.dumps(events[::order]).encode(), "t").traces
        found = sorted((e.start.ns, e.task, e.end and e.end.ns) for e in line.executions)
        due = [
            (1000 * (10 * turn + i), n, 1000 * (10 * turn + 9 - i)) for turn in range(30) for i, n in enumerate(names)
        ]
        assert found == [*due, (400_000, "open", None)]


@pytest.mark.parametrize(
    ("data", "line", "said"),
    [
        ("a" * 61, 1, f"it begins with {'a' * 60!r} ..."),
        ("a" * 60, 1, f"it begins with {'a' * 60!r}"),
        (b"task,start,end\na,1,2\nb,3,4\n\xff", 4, "line 4 is no text in UTF-8"),
        ("task,start,end\na,1,2\nb".encode("utf-16") + b"\0\xd8\n\0", 3, "line 3 is no text in UTF-8"),
        (f"task,start,end\n{'x' * 50},{'y' * 50},2\n", 2, f"{'y' * 40!r} is no time"),
        (f"task,start,end,cycle\na,1,2,{'y' * 50}\n", 2, f"{'y' * 40!r} is no whole number"),
        (f"task,start,end,data\na,1,2,{'y' * 50}\n", 2, f"data is {'y' * 20!r}, neither 0 nor 1"),
        (f"task;start;end\na;1,5;2\na;2.{'0' * 50};3\n", 3, f"{'2.' + '0' * 38!r} has another decimal sign"),
        ("task,start,end,busy\na,1,2,-3\n", 2, "runs for -3"),
        ("task,start,end\na,3,2\n", 2, "ends at 2, before it starts"),
        ("task,start,end\na,1/0,2\n", 2, "'1/0' is no time"),
        ("<halpipe-schedule/>", 1, "this is XML"),
        ("callback,duration_ns\n/n/a,5\n", 1, "it has durations, but no starts and ends"),
        ("", 1, "it is empty"),
    ],
)
def test_what_cannot_be_read_is_shown_with_its_line_and_its_beginning(data, line, said):
    (found,) = refusal(data)
    assert found.message.startswith(said)
    assert found.at.line == line
    assert ("..." in found.message) == said.endswith("...")


@pytest.mark.parametrize("text", ["1", "0.5", "12345678901234567890.123456789", "1/3", "-2", "-2.5", "0.0001"])
def test_instants_are_exact_in_any_notation(text):
    assert numbers.instant(text, 1000) == Fraction(text) * 1000


@pytest.mark.parametrize(
    "text", ["", ".5", "5.", "1e3", "+1", "1_0", "\u0663", "1/0", "1.5/2", "0x1", "1" * 31, "1." + "1" * 16]
)
def test_instants_in_other_notations_are_refused(text):
    with pytest.raises(ValueError, match="is no time"):
        numbers.instant(text, 1)


@pytest.mark.parametrize("count", [1, 100])
def test_slices_without_a_length_are_some_where_the_text_is_in_order(count):
    """A begin and its end at one instant stay in their order there; of a text that is not, ends come first."""
    marks = [("B", 1), ("E", 1), ("B", 1), ("E", 2)]
    events = [
        {"ph": phase, "name": "a", "pid": 1, "tid": 1, "ts": 10 * turn + at}
        for turn in range(count)
        for phase, at in marks
    ]
    recording = parse_traces(json.dumps(events).encode(), "t")
    spans = [(e.start.ns // 1000 % 10, e.end.ns // 1000 % 10) for e in recording.traces[0].executions]
    assert spans == [(1, 1), (1, 2)] * count
    assert recording.diagnostics == ()
