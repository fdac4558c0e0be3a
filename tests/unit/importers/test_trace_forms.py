"""Binary traces and texts of the kernel: the same run has the same jobs in each form, and damage has a code."""

import io
import re
import struct
import sys
import zlib
from collections import Counter
from itertools import pairwise

import pytest
import trace_forms as forms
from hypothesis import example, given
from hypothesis import strategies as st

import ctf_writer
from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.traces import codes, perfetto, read_traces
from halpipe.importers.traces.read import parse_traces

WRITERS = {
    "ftrace": forms.ftrace,
    "trace-cmd report": lambda: forms.ftrace(is_short=True),
    "trace.dat": forms.trace_dat,
    "trace.dat, big-endian": lambda: forms.trace_dat(order=">"),
    "perfetto": forms.perfetto_switches,
    "perfetto in columns": lambda: forms.perfetto_switches(is_compact=True),
    "btf": forms.btf,
    "trace.dat 7": forms.trace_dat_7,
    "trace.dat 7 packed": lambda: forms.trace_dat_7(zlib.compress, b"zlib"),
    "signals": forms.signals,
    "events": forms.events_json,
}


PACKED = forms.message((50, zlib.compress(forms.perfetto_slices())))


def test_compressed_packets_are_those_that_they_hold():
    (found,), (plain,) = (parse_traces(data, "t").traces for data in (forms.trace(PACKED), forms.perfetto_slices()))
    assert found.executions[:] == plain.executions[:]


@pytest.mark.parametrize(
    "packed", [zlib.compress(forms.trace(PACKED)), zlib.compress(forms.perfetto_slices())[:-9], b"x"]
)
def test_packets_compressed_twice_or_cut_off(packed):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(forms.trace(forms.message((50, packed))), "t")
    assert [d.code for d in refused.value.diagnostics] == [codes.UNKNOWN_TRACE.id]


def test_a_trace_dat_compressed_by_zstd():
    packer = pytest.importorskip("zstandard").ZstdCompressor()
    (found,) = parse_traces(forms.trace_dat_7(packer.compress, b"zstd"), "t").traces
    assert seen(found) == forms.JOBS
    with pytest.raises(HalpipeError, match="cannot be read"):
        parse_traces(forms.trace_dat_7(lambda data: b"junk" + data, b"zstd"), "t")


def test_a_trace_dat_compressed_by_zstd_without_its_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "zstandard", None)
    with pytest.raises(HalpipeError) as refused:
        parse_traces(forms.trace_dat_7(bytes, b"zstd"), "t")
    assert "halpipe[zstd]" in refused.value.diagnostics[0].help


def seen(found):
    """Return what the jobs of a line of time are, in nanoseconds."""
    return [
        (
            e.task.removeprefix("TASK_"),
            e.start.ns,
            None if e.end is None else e.end.ns,
            (e.end - e.start if e.busy is None else e.busy).ns,
            tuple((a.ns, b.ns) for a, b in e.stretches),
        )
        for e in found.executions
    ]


@pytest.mark.parametrize("form", WRITERS)
def test_the_same_run_has_the_same_jobs_in_each_form(form):
    recording = parse_traces(WRITERS[form](), "t")
    (found,) = recording.traces
    assert not [d.message for d in recording.diagnostics if d.code == codes.ALREADY_RUNNING.id]
    whole = [(task, start, end, end - start, ()) for task, start, end, *_ in forms.JOBS]
    assert seen(found) == (whole if form == "signals" else forms.JOBS)  # signals do not tell of preemptions


def notes_of(recording):
    return [d.message for d in recording.diagnostics if d.code == codes.ALREADY_RUNNING.id]


@pytest.mark.parametrize("form", ["ftrace", "trace-cmd report", "trace.dat", "perfetto"])
def test_a_job_that_began_before_the_recording_is_left_out(form, monkeypatch):
    monkeypatch.setattr(forms, "RUN", forms.RUN[2:])  # B is preempted by A, and its start was not recorded
    recording = parse_traces(WRITERS[form](), "t")
    assert seen(recording.traces[0]) == [("A", 4000, 5000, 1000, ()), ("C", 6000, 9000, 3000, ())]
    assert notes_of(recording) == ["1 job without a start"]


def test_threads_of_perf_converted_to_ctf(tmp_path):
    """``perf data convert --to-ctf`` has one stream, and CPUs in its events."""
    written = ctf_writer.Trace()
    numbers = dict.fromkeys(("perf_cpu", "prev_pid", "prev_state", "next_pid"), "u32")
    written.declare("sched:sched_switch", **numbers, next_comm="str")
    for at, cpu, left, goes_on, entered in sorted(forms.RUN):
        pids = {"prev_pid": forms.PIDS[left], "next_pid": forms.PIDS[entered], "prev_state": 0 if goes_on else 1}
        written.add("sched:sched_switch", at * 1000, cpu=0, perf_cpu=cpu, next_comm=forms.COMM[entered], **pids)
    (trace,) = read_traces(str(written.write(tmp_path))).traces
    begin = 1_000_000
    assert [(task, start - begin, end - begin, busy) for task, start, end, busy, _ in seen(trace)] == [
        job[:4] for job in forms.JOBS
    ]
    assert [e.units for e in trace.executions] == [("cpu0",), ("cpu0",), ("cpu0",), ("cpu1",)]


def test_a_trace_of_neither_nodes_nor_threads_is_refused_with_what_to_trace(tmp_path):
    written = ctf_writer.Trace()
    written.declare("thread_switched_in", thread_id="u32")
    written.add("thread_switched_in", 5, thread_id=7)
    with pytest.raises(HalpipeError) as refused:
        read_traces(str(written.write(tmp_path)))
    unused, last = refused.value.diagnostics
    assert "thread_switched_in" in unused.message
    assert (last.code, "sched_switch" in last.help) == (codes.NO_EXECUTIONS.id, True)


def test_other_events_of_ftrace_in_perfetto_are_counted():
    other = forms.message((1, forms.message((1, 0), (2, forms.message((1, 5), (2, 7), (3, b"")))))) * 2
    (found,) = parse_traces(WRITERS["perfetto"]() + forms.trace(other), "t").diagnostics
    assert (found.code, found.message) == (codes.LEFT_OUT.id, "events not used: 2 of other kinds of ftrace")


@pytest.mark.parametrize("form", [form for form in WRITERS if form not in ("btf", "events", "signals")])
def test_threads_of_a_computer_run_on_its_cpus(form):
    (found,) = parse_traces(WRITERS[form](), "t").traces
    assert found.is_shared
    assert [e.units for e in found.executions] == [("cpu0",), ("cpu0",), ("cpu0",), ("cpu1",)]


@pytest.mark.parametrize("preempted", [0, 256, 1024])
def test_threads_of_lttng_keep_their_job_while_they_are_preempted(preempted, tmp_path):
    """States of preempted threads: of Linux before 4.14 with and without preemption, and since."""
    written = ctf_writer.Trace()
    written.declare("sched_switch", prev_tid="u32", prev_state="u32", next_tid="u32", next_comm="str")
    for at, cpu, left, goes_on, entered in forms.RUN:
        tids = {"prev_tid": forms.PIDS[left], "next_tid": forms.PIDS[entered]}
        state = preempted if goes_on else 1
        written.add("sched_switch", at * 1000, cpu, prev_state=state, next_comm=forms.COMM[entered], **tids)
    written.write(tmp_path, discarded=3)
    recording = read_traces(str(tmp_path))
    begin = 1_000_000
    assert [(task, start - begin, end - begin, busy) for task, start, end, busy, _ in seen(recording.traces[0])] == [
        job[:4] for job in forms.JOBS
    ]
    assert [d.code for d in recording.diagnostics] == [codes.LOST_EVENTS.id]


def test_numbers_of_states_in_ftrace_are_those_of_the_kernel():
    text = forms.ftrace().replace(b"prev_state=S", b"prev_state=1")
    for preempted in (b"prev_state=0", b"prev_state=256", b"prev_state=R+"):
        (found,) = parse_traces(text.replace(b"prev_state=R", preempted), "t").traces
        assert seen(found) == forms.JOBS


def test_switches_that_are_not_in_the_order_of_time_are_refused():
    *head, last = forms.ftrace().splitlines(keepends=True)
    with pytest.raises(HalpipeError) as refused:
        parse_traces(b"".join((*head[:4], last, *head[4:])), "t")
    found = [d for d in refused.value.diagnostics if d.is_error]
    assert {d.code for d in found} == {codes.BROKEN_ROW.id}
    assert found[0].at.line == 6
    assert "sort the lines by time" in found[0].help


def test_slices_of_perfetto_are_those_of_the_json_form():
    (found,) = parse_traces(forms.perfetto_slices(), "t").traces
    assert found.name == "run"
    assert [(e.task, e.units, e.start.ns, e.end.ns) for e in found.executions] == [
        ("A", ("c0",), 1000, 3000),
        ("A", ("c0",), 4000, 5000),
        ("C", ("c1",), 6000, 9000),
    ]


def perfetto_jobs(*events, before=()):
    """Read events on the tracks c0 and c1 as task, start and end."""
    tracks = [forms.message((60, forms.message((1, n), (2, f"c{n}"))), (10, 1)) for n in (1, 2)]
    (found,) = parse_traces(forms.trace(*tracks, *before, *events), "t").traces
    return [(e.task, e.units, e.start.ns, e.end.ns) for e in found.executions]


def event(stamp, track, name="", clock=None):
    """Write the begin of a slice with a name, or the end of one."""
    what = forms.message((9, 1 if name else 2), (11, track), *([(23, name)] if name else []))
    return forms.message((8, stamp), (10, 1), (11, what), *([(58, clock)] if clock else []))


RUN = [(1000, 1, "A"), (3000, 1), (3000, 1, "B"), (4000, 1), (6000, 2, "C"), (9000, 2)]
SEEN = [("A", ("c1",), 1000, 3000), ("B", ("c1",), 3000, 4000), ("C", ("c2",), 6000, 9000)]


def test_packets_of_perfetto_need_no_order():
    written = [event(*each) for each in RUN]
    assert perfetto_jobs(*written) == perfetto_jobs(*reversed(written)) == SEEN


@pytest.mark.parametrize("unit", [1, 500])
def test_stamps_of_the_tracing_sdk_count_from_the_one_before(unit):
    """Clock 64 of a writer: its zero is that of the snapshot, 500 ns on the clock of the system."""
    own = forms.message((1, 64), (2, 7), (3, 1), (4, unit))
    snapshot = forms.message((6, forms.message((1, own), (1, forms.message((1, 6), (2, 500))))), (10, 1))
    instants = [500, *(at for at, *_ in RUN)]
    deltas = [(after - before) // unit for before, after in pairwise(instants)]
    written = [event(delta, *rest, clock=64) for delta, (_, *rest) in zip(deltas, RUN, strict=True)]
    assert perfetto_jobs(*written, before=[snapshot]) == SEEN
    with pytest.raises(HalpipeError) as refused:
        perfetto_jobs(*written)
    assert "6 of events without an instant, or on a clock" in refused.value.diagnostics[0].message


def test_builtin_clocks_of_perfetto_differ_by_what_the_system_slept():
    """C is stamped by the monotonic clock, which was 2000 ns behind the time since boot at the snapshot."""
    clocks = (forms.message((1, number), (2, stamp)) for number, stamp in ((3, 500), (6, 2500)))
    snapshot = forms.message((6, forms.message(*((1, clock) for clock in clocks))), (10, 1))
    written = [*(event(*each) for each in RUN[:4]), *(event(at - 2000, *rest, clock=3) for at, *rest in RUN[4:])]
    assert perfetto_jobs(*written, before=[snapshot]) == SEEN


def test_numbers_that_perfetto_does_not_write_are_0():
    """A track, a name, a process and the stamp of a clock have the number 0, which messages omit."""
    track = forms.message((60, forms.message((2, "c0"))), (10, 1))
    name = forms.message((12, forms.message((2, forms.message((2, "A"))))), (13, 1), (10, 1))
    own = forms.message((1, 64), (2, 3), (3, 1))
    snapshot = forms.message((6, forms.message((1, own), (1, forms.message((1, 6))))), (10, 1))
    begin = forms.message((8, 5), (11, forms.message((9, 1), (11, 0), (10, 0))), (10, 1), (58, 64))
    end = forms.message((8, 4), (11, forms.message((9, 2), (11, 0))), (10, 1), (58, 64))
    (found,) = parse_traces(forms.trace(track, name, snapshot, begin, end), "t").traces
    assert [(e.task, e.units, e.start.ns, e.end.ns) for e in found.executions] == [("A", ("c0",), 5, 9)]


def test_perfetto_forgets_interned_names_when_the_writer_starts_again():
    name = forms.message((12, forms.message((2, forms.message((1, 1), (2, "A"))))), (13, 1), (10, 1))
    begin = forms.message((8, 5), (11, forms.message((9, 1), (11, 1), (10, 1))), (10, 1))
    cleared = forms.message((13, 1), (10, 1))
    end = forms.message((8, 9), (11, forms.message((9, 2), (11, 1))), (10, 1))
    (found,) = parse_traces(forms.trace(name, begin, end), "t").traces
    assert [e.task for e in found.executions] == ["A"]
    (found,) = parse_traces(forms.trace(name, cleared, begin, end), "t").traces
    assert [e.task for e in found.executions] == ["(no name)"]


def test_a_thread_that_a_trace_begins_in_has_no_job():
    text = forms.ftrace().replace(b"# tracer: nop\n", b"").split(b"\n")
    rest = b"# tracer: nop\n" + b"\n".join(line for line in text if b" 0.000001:" not in line)
    (found,) = parse_traces(rest, "t").traces
    assert [row[0] for row in seen(found)] == ["B", "A", "C"]


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (forms.ftrace() + b"CPU:1 [LOST 12 EVENTS]\n", "12 events"),
        (forms.trace_dat(missed=1), "2 events"),
        (forms.trace(forms.message((42, 1))) + forms.perfetto_slices(), "packets"),
    ],
)
def test_lost_events_are_reported(data, said):
    found = [d for d in parse_traces(data, "t").diagnostics if d.code == codes.LOST_EVENTS.id]
    assert [said in d.message for d in found] == [True]


@pytest.mark.parametrize(
    ("data", "code", "said"),
    [
        (forms.trace_dat(version=b"8"), codes.UNKNOWN_TRACE, "version 8"),
        (forms.trace_dat(version=b"7"), codes.UNKNOWN_TRACE, "trace.dat"),
        (forms.trace_dat_7(algorithm=b"lz4"), codes.UNKNOWN_TRACE, "lz4"),
        (forms.trace_dat_7(clock=b"counter"), codes.UNKNOWN_TRACE, "counter"),
        (forms.trace_dat_7(instance=b"other"), codes.UNKNOWN_TRACE, "trace.dat"),
        (forms.trace_dat_7(lambda data: zlib.compress(data)[:-9], b"zlib"), codes.UNKNOWN_TRACE, "size"),
        (forms.trace_dat(clock="local [counter]"), codes.UNKNOWN_TRACE, "counter"),
        (forms.trace_dat()[:500], codes.UNKNOWN_TRACE, "trace.dat"),
        (forms.perfetto_slices()[:20], codes.UNKNOWN_TRACE, "cut off"),
        (b"# tracer: nop\n  A-1 [000] d..2. 12345: sched_switch: x\n", codes.BROKEN_ROW, "time"),
        (b"MDF     4.10    damaged", codes.UNKNOWN_TRACE, "MDF"),
    ],
)
def test_damage_and_unread_variants_have_a_code(data, code, said):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(data, "t")
    found = [d for d in refused.value.diagnostics if d.is_error]
    assert [d.code for d in found] == [code.id]
    assert said in found[0].message
    assert found[0].help


@pytest.mark.parametrize(("data", "jobs"), [(forms.trace_dat()[:8300], 4), (forms.perfetto_slices()[:-3], 3)])
def test_what_stands_before_the_cut_counts(data, jobs):
    found = parse_traces(data, "t")
    assert [d.code for d in found.diagnostics if d.severity.value == "warning"] == [codes.CUT_OFF.id]
    assert sum(len(trace.executions) for trace in found.traces) == jobs


SEEDS = [WRITERS[form]() for form in ("trace.dat", "trace.dat 7 packed", "perfetto", "perfetto in columns", "ftrace")]


@example(SEEDS[2], [(0.07421875, 0)], 0.0)  # bytes in the place of a number
@given(
    st.sampled_from(SEEDS), st.lists(st.tuples(st.floats(0, 0.999), st.integers(0, 255)), max_size=4), st.floats(0, 1)
)
def test_damaged_traces_are_read_or_refused_with_a_code(seed, changes, length):
    data = bytearray(seed)
    for place, value in changes:
        data[int(place * len(data))] = value
    try:
        parse_traces(bytes(data[: int(length * len(data)) or len(data)]), "t")
    except HalpipeError:
        return  # with codes; anything else would escape


@pytest.mark.parametrize(
    ("packet", "due"),
    [
        (forms.message((60, 5)), "a number stands where a text or a message is due"),
        (forms.message((50, 5)), "a number stands where a text or a message is due"),
        (
            forms.message((1, forms.message((4, forms.message((1, b"\1"), (2, b""), (3, b""), (6, b"")))))),
            "unlike lengths",
        ),
        (b"\x40\x80", "a number is cut off"),
    ],
)
def test_damage_of_perfetto_names_the_packet_its_byte_and_what_is_due(packet, due):
    sound = forms.perfetto_slices()
    count = sum(1 for _ in perfetto._packets(io.BytesIO(sound)))
    found = parse_traces(sound + forms.trace(packet) + sound, "t")
    (said,) = (d.message for d in found.diagnostics if d.code == codes.CUT_OFF.id)
    assert said.startswith(f"packet {count + 1}, from byte {len(sound)} on, cannot be read: ")
    assert said.endswith(f"; what comes after packet {count} is not used")
    assert due in said


PYTHON = re.compile(r"object|argument|index|unpack|subscript|NoneType|codec|literal|attribute|zip\(|Error|^'|: '\w+'$")
"""Words of Python's exceptions, which say nothing to those who have the file."""


@pytest.mark.parametrize("seed", SEEDS)
def test_no_words_of_python_stand_in_what_is_said_of_damage(seed):
    said = Counter()
    for place in range(0, len(seed), len(seed) // 400 + 1):
        for value in (0, 1, 5, 0x7F, 0xFF, seed[place] ^ 2):
            data = bytearray(seed)
            data[place] = value
            try:
                said.update(each.message for each in parse_traces(bytes(data), "t").diagnostics)
            except HalpipeError as refused:
                said.update(each.message for each in refused.diagnostics)
    assert [message for message in said if PYTHON.search(message)] == []
    assert len(said) > 3


def test_buffers_behind_the_end_of_the_file_are_refused():
    data = bytearray(forms.trace_dat())
    data[data.index(b"flyrecord\0") + 17] = 0x7F  # the highest byte of the place of the first buffer
    with pytest.raises(HalpipeError, match="behind its end"):
        parse_traces(bytes(data), "t")


def test_measurement_files_have_tables_of_jobs_and_states_of_tasks(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    numpy = pytest.importorskip("numpy")
    with asammdf.MDF(version="4.10") as file:
        stamps = numpy.array([0, 1e-6, 3e-6, 4e-6, 5e-6])
        states = numpy.array([0, 1, 0, 1, 0], dtype="uint8")
        file.append([asammdf.Signal(states, stamps, name="A")])
        states = numpy.array([1, 1, 0, 1, 0], dtype="uint8")  # it runs when the recording begins
        file.append([asammdf.Signal(states, stamps, name="B")])
        file.append([asammdf.Signal(numpy.array([1, 1, 5, 9, 2], dtype="uint8"), stamps, name="speed")])
        names = numpy.array([b"C", b"C"])
        begins, ends = (numpy.array(times, dtype="uint64") for times in ([6000, 20000], [9000, 21000]))
        columns = [("task", names), ("start", begins), ("end", ends)]
        file.append([asammdf.Signal(c, numpy.arange(2.0), name=n, encoding="utf-8") for n, c in columns])
        file.save(tmp_path / "t.mf4")
    recording = parse_traces((tmp_path / "t.mf4").read_bytes(), "t")
    rows, states = recording.traces
    assert seen(states) == [
        ("A", 1000, 3000, 2000, ()),
        ("A", 4000, 5000, 1000, ()),
        ("B", 4000, 5000, 1000, ()),
    ]
    assert notes_of(recording) == ["1 job without a start"]
    assert seen(rows) == [("C", 6000, 9000, 3000, ()), ("C", 20000, 21000, 1000, ())]


@pytest.mark.parametrize(("unit", "scale"), [("s", 1e-9), ("\xb5s", 1e-3), ("ms", 1e-6), ("", 1)])
def test_channels_of_instants_are_in_their_unit(unit, scale, tmp_path):
    asammdf = pytest.importorskip("asammdf")
    numpy = pytest.importorskip("numpy")
    with asammdf.MDF(version="4.10") as file:
        stamps = numpy.arange(2.0)
        columns = [asammdf.Signal(numpy.array([b"C", b"D"]), stamps, name="task", encoding="utf-8")]
        for name, times in (("start", [6000, 20000]), ("end", [9000, 21000])):
            columns.append(asammdf.Signal(numpy.array(times) * scale, stamps, name=name, unit=unit))
        file.append(columns)
        file.append([asammdf.Signal(numpy.array([0.5, 1.5]), stamps, name="speed")])
        file.save(tmp_path / "t.mf4")
    recording = parse_traces((tmp_path / "t.mf4").read_bytes(), "t")
    assert seen(recording.traces[0]) == [("C", 6000, 9000, 3000, ()), ("D", 20000, 21000, 1000, ())]
    assert [d.message for d in recording.diagnostics] == ["not 0 or 1 only: 1 signal: speed"]


@pytest.mark.parametrize(
    "broken", ["Time [s];A\n0,1;0\nx1;1\n", "Time [s];A\n0,1;1\n0.2;0\n", "sep=;\nTime [s];A\nx1;1\n"]
)
def test_rows_of_signals_that_cannot_be_read_are_named(broken):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(broken.encode(), "t")
    assert [(d.code, d.at.line) for d in refused.value.diagnostics if d.is_error] == [(codes.BROKEN_ROW.id, 3)]


def test_signals_that_are_no_states_are_left_out():
    found = parse_traces(b"time_us,A,speed\n0,0,1\n1,1,1\n2,1,7\n3,0,0\n", "t")
    assert seen(found.traces[0]) == [("A", 1000, 3000, 2000, ())]
    assert any("speed" in d.message for d in found.diagnostics if d.code == codes.LEFT_OUT.id)
    assert not notes_of(found)  # what it is at first is no job


def test_a_signal_that_is_1_at_first_runs_since_an_unknown_instant():
    found = parse_traces(b"time_us,A,B\n1,1,\n2,1,1\n3,0,1\n4,1,0\n5,0,1\n6,,\n7,0,0\n", "t")
    assert seen(found.traces[0]) == [("A", 4000, 5000, 1000, ()), ("B", 5000, 7000, 2000, ())]
    assert notes_of(found) == ["2 jobs without a start"]


def test_rows_of_signals_may_be_short():
    """What a row leaves out is as in the row before, and is compared with what stood last in its column."""
    (found,) = parse_traces(b"time_us,A,B\n1,0,0\n2,1\n3,1,1\n4,0\n5,0,0\n", "t").traces
    assert seen(found) == [("A", 2000, 4000, 2000, ()), ("B", 3000, 5000, 2000, ())]


# ------------------------------------------------------------------------------------------ trace.dat


def ring_page(order, *events, stamp=0):
    """Write a page of the kernel's ring buffer of events by their bits: type, delta, further word, data."""

    def word(value):
        return value.to_bytes(4, "little" if order == "<" else "big")

    written = b""
    for kind, delta, *rest in events:
        written += word(kind | delta << 5 if order == "<" else kind << 27 | delta)
        written += b"".join(word(each) if isinstance(each, int) else each for each in rest)
    head = stamp.to_bytes(8, "little" if order == "<" else "big") + word(len(written)) + bytes(4)
    head = head if order == "<" else stamp.to_bytes(8, "big") + bytes(4) + word(len(written))
    return (head + written).ljust(forms.PAGE, b"\0")


def ring_switch(order, left, entered, state=1):
    """Write the data of a switch: 64 bytes, by the format of `forms.SWITCH`."""
    return struct.pack(f"{order}HBBi16siiq16sii", 316, 0, 0, left, b"x", left, 120, state, b"T", entered, 120)


@pytest.mark.parametrize("order", ["<", ">"])
def test_records_of_the_ring_buffer_are_those_of_the_kernel(order):
    """``include/linux/ring_buffer.h``: padding, time extends, absolute stamps and long records between the events.

    The task T runs from 1000 to 2000 ns each time; what is between the switches only moves the clock.
    """

    def run(first, *between):
        on, off = ring_switch(order, 0, 5), ring_switch(order, 5, 0)
        page = ring_page(order, *first, (16, 0, on), *between, (16, 0, off), stamp=100)
        (found,) = parse_traces(forms.trace_dat(order=order, pages=(page, ring_page(order))), "t").traces
        ((task, start, end, *_),) = seen(found)
        assert task == "T"
        return start, end

    other = struct.pack(f"{order}HBBi", 7, 0, 0, 0)
    on_at = [(30, 900, 0)]  # a time extend: 27 bits, and 32 above them
    assert run(on_at, (30, 1000, 0)) == (1000, 2000)
    assert run(on_at, (30, 5, 3)) == (1000, 1005 + (3 << 27))
    assert run(on_at, (31, 2000, 0)) == (1000, 2000)  # an absolute stamp
    assert run(on_at, (31, 1, 2)) == (1000, 1 + (2 << 27))
    assert run([(31, 1000, 0)], (29, 1000, 8, bytes(4))) == (1000, 2000)  # a discarded event of 8 bytes
    assert run(on_at, (2, 600, other), (29, 400, 4)) == (1000, 2000)
    assert run(on_at, (0, 1000, 4 + 8, other)) == (1000, 2000)  # the length in the word after the head
    assert run(on_at, (0, 1000, 4 + 6, other)) == (1000, 2000)  # is rounded up to whole words
    assert run(on_at, (1, 1000, other[:4])) == (1000, 2000)


def test_an_absolute_stamp_keeps_the_upper_bits_of_its_page():
    """The kernel has 59 bits in the record; the 5 above them are those of the page."""
    high = 3 << 59
    on, off = ((16, delta, ring_switch("<", *pair)) for delta, pair in ((0, (0, 5)), (7, (5, 0))))
    page = ring_page("<", (31, 1000, 0), on, off, stamp=high + 2**59 - 1)
    (found,) = parse_traces(forms.trace_dat(pages=(page, ring_page("<"))), "t").traces
    assert [(start, end) for _, start, end, *_ in seen(found)] == [(high + 1000, high + 1007)]


def test_nothing_behind_the_last_record_of_a_page_is_read():
    on, off = ring_switch("<", 0, 5), ring_switch("<", 5, 0)
    for last in ([(29, 0)], []):
        page = bytearray(ring_page("<", (16, 1000, on), (16, 1000, off), *last))
        rest = ring_page("<", (16, 1000, on), (16, 1000, off))[16:]
        begin = 16 + 2 * 68 + 4 * len(last)
        page[begin:] = rest[: len(page) - begin]
        if last:  # padding ends a page, whatever length it states
            page[8:12] = (len(page) - 16).to_bytes(4, "little")
        (found,) = parse_traces(forms.trace_dat(pages=(bytes(page), ring_page("<"))), "t").traces
        assert [(start, end) for _, start, end, *_ in seen(found)] == [(1000, 2000)]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("state", [0, 0x100, 1, 2, 0x80])
def test_a_thread_that_is_runnable_is_preempted_and_any_other_waits(order, state):
    """Bits of ``prev_state``: any of the lowest eight is a reason to wait, and 0x100 is a preemption."""
    pairs = [(0, 5, 1), (5, 6, state), (6, 5, 1), (5, 0, 1)]
    page = ring_page(order, *((16, 1000, ring_switch(order, *pair)) for pair in pairs))
    (found,) = parse_traces(forms.trace_dat(order=order, pages=(page, ring_page(order))), "t").traces
    spans = [(start, end) for _, start, end, *_ in seen(found)]
    assert spans == (
        [(1000, 4000), (2000, 3000)] if state in (0, 0x100) else [(1000, 2000), (2000, 3000), (3000, 4000)]
    )


@pytest.mark.parametrize(
    ("place", "value", "said"),
    [
        (lambda data: 14, (255).to_bytes(4, "little"), "its pages have 255 bytes"),
        (lambda data: data.index(b"flyrecord\0") + 18, (2**20).to_bytes(8, "little"), "larger than the file"),
        (lambda data: data.index(b"flyrecord\0") + 10, (2**40).to_bytes(8, "little"), "behind its end"),
        (lambda data: data.index(b"name: sched_switch"), b"name: sched_swatch", "no events sched:sched_switch"),
        (lambda data: data.index(b"flyrecord"), b"latency  ", "no buffers of CPUs"),
        (lambda data: data.index(b"header_page"), b"header_pige", "header_page is not where it should be"),
        (lambda data: data.index(b"header_event"), b"header_evint", "header_event is not where it should be"),
        (lambda data: data.index(b"sched\0"), b"x" * 1002, "a name has no end"),
    ],
)
def test_damage_of_a_trace_dat_is_named(place, value, said):
    data = bytearray(forms.trace_dat())
    at = place(data)
    data[at : at + len(value)] = value
    (found,) = [d for d in refused_by(bytes(data)) if d.is_error]
    assert said in found.message


def refused_by(data):
    with pytest.raises(HalpipeError) as refused:
        parse_traces(data, "t")
    return refused.value.diagnostics


@pytest.mark.parametrize("clock", ["counter", "uptime", "x86-tsc", "perf"])
def test_clocks_that_count_no_nanoseconds_are_refused(clock):
    for data in (forms.trace_dat(clock=f"local [{clock}]"), forms.trace_dat_7(clock=clock.encode())):
        (found,) = refused_by(data)
        assert (found.message, found.at.line) == (f"its clock {clock} does not count nanoseconds", 1)
    assert parse_traces(forms.trace_dat(clock=f"[local] {clock}"), "t").traces


def test_a_cpu_without_events_has_an_empty_buffer():
    """It stands at the end of the file, in version 7 without a number of chunks."""
    data = bytearray(forms.trace_dat())
    places = data.index(b"flyrecord\0") + 10
    data[places + 16 : places + 32] = (len(data) - forms.PAGE).to_bytes(8, "little") + bytes(8)
    packed = bytearray(forms.trace_dat_7(zlib.compress, b"zlib", cpus=1))
    for written in (bytes(data[: -forms.PAGE]), bytes(packed)):
        recording = parse_traces(written, "t")
        assert seen(recording.traces[0]) == forms.JOBS[:3]  # C runs on the other one
        assert not [d for d in recording.diagnostics if d.code == codes.CUT_OFF.id]


def test_a_trace_dat_is_as_large_as_its_buffers():
    data = forms.trace_dat()
    assert len(data) % forms.PAGE == 0
    (found,) = parse_traces(data, "t").traces
    assert seen(found) == forms.JOBS
    assert not [d for d in parse_traces(data, "t").diagnostics if d.code == codes.CUT_OFF.id]


# ------------------------------------------------------------------------------------------- protobuf


@pytest.mark.parametrize("clock", [1, 2, 3, 4, 5, 6])
def test_every_builtin_clock_of_perfetto_counts_nanoseconds(clock):
    """``BuiltinClock``: realtime, its coarse one, monotonic, its coarse and its raw one, and the time since boot."""
    behind = 0 if clock == 6 else 700
    written = [event(at - behind, *rest, clock=clock) for at, *rest in RUN]
    for boot in (2500, 700):  # at the snapshot, a clock may stand at 0, which is not written
        stamps = {clock: boot - behind, 6: boot}
        stated = ([(1, number), *([(2, stamp)] if stamp else [])] for number, stamp in stamps.items())
        snapshot = forms.message(*((1, forms.message(*fields)) for fields in stated))
        assert perfetto_jobs(*written, before=[forms.message((6, snapshot), (10, 1))]) == SEEN
    assert perfetto_jobs(*(event(at, *rest, clock=clock) for at, *rest in RUN)) == SEEN  # none says how they differ


def test_stamps_of_a_clock_of_a_writer_may_count_from_its_zero():
    own = forms.message((1, 64), (2, 7), (4, 500))
    snapshot = forms.message((6, forms.message((1, own), (1, forms.message((1, 6), (2, 500))))), (10, 1))
    written = [event(7 + (at - 500) // 500, *rest, clock=64) for at, *rest in RUN]
    assert perfetto_jobs(*written, before=[snapshot]) == SEEN


def test_defaults_of_a_writer_hold_for_its_packets_alone():
    """``TracePacketDefaults``: the clock of stamps (58), and the track of events (11) in those of events (11)."""
    own = forms.message((1, 64), (2, 0))
    snapshot = (6, forms.message((1, own), (1, forms.message((1, 6), (2, 500)))))
    defaults = (59, forms.message((58, 64), (11, forms.message((11, 2)))))
    begin, end = forms.message((9, 1), (23, "A")), forms.message((9, 2))
    written = [
        forms.message(snapshot, defaults, (10, 1)),
        forms.message((8, 500), (11, begin), (10, 1)),
        forms.message((8, 700), (11, end), (10, 1)),
        forms.message((8, 700), (11, forms.message((9, 1), (11, 1), (23, "B"))), (10, 2)),  # another writer
        forms.message((8, 900), (11, forms.message((9, 2), (11, 1))), (10, 2)),
    ]
    assert sorted(perfetto_jobs(*written)) == [("A", ("c2",), 1000, 1200), ("B", ("c1",), 700, 900)]


@pytest.mark.parametrize("cleared", [(13, 1), (41, 1), (13, 3)])
def test_a_writer_clears_its_names_by_a_flag_or_a_field(cleared):
    name = forms.message((12, forms.message((2, forms.message((1, 1), (2, "A"))))), (10, 1))
    begin = forms.message((8, 5), (11, forms.message((9, 1), (11, 1), (10, 1))), (10, 1))
    end = forms.message((8, 9), (11, forms.message((9, 2), (11, 1))), (10, 1))
    for between, task in ((forms.message(cleared, (10, 1)), "(no name)"), (forms.message((13, 2), (10, 1)), "A")):
        (found,) = parse_traces(forms.trace(name, between, begin, end), "t").traces
        assert [e.task for e in found.executions] == [task]
    other = forms.message(cleared, (10, 2))  # of another writer
    (found,) = parse_traces(forms.trace(name, other, begin, end), "t").traces
    assert [e.task for e in found.executions] == ["A"]


def test_a_track_is_in_the_process_of_the_nearest_parent_that_has_one():
    """The line of time of a process has its name, or its number; tracks without one are a line of their own."""
    process = forms.message((3, forms.message((1, 40), (6, "run"))))
    tracks = {1: process, 2: forms.message((5, 1)), 3: forms.message((5, 2)), 4: b"", 5: forms.message((5, 9)), 6: b""}
    tracks |= {7: forms.message((5, 8)), 8: forms.message((5, 7)), 9: forms.message((3, forms.message((1, 41))))}
    written = [forms.message((60, forms.message((1, n)) + track), (10, 1)) for n, track in tracks.items()]
    for at, track in enumerate((1, 2, 3, 4, 5, 6, 7, 8, 9, 10)):
        written += [event(10 * at, track, "A"), event(10 * at + 5, track)]
    found = parse_traces(forms.trace(*written), "t").traces
    lines = {trace.name: [e.start.ns // 10 for e in trace.executions] for trace in found}
    assert lines == {"run": [0, 1, 2], "0": [3, 5, 6, 7, 9], "41": [4, 8]}


def test_a_track_has_the_name_that_it_states_or_that_of_its_thread():
    thread = forms.message((1, 40), (2, 43), (5, "worker"))
    unnamed = forms.message((1, 40), (2, 43))
    found = {
        "t": forms.message((2, "t"), (4, thread)),
        "static": forms.message((10, "static"), (4, thread)),
        "worker": forms.message((4, thread)),
        "43": forms.message((4, unnamed)),
        "5": b"",
    }
    written = [forms.message((60, forms.message((1, n)) + track), (10, 1)) for n, track in enumerate(found.values(), 1)]
    for track in range(1, 6):
        written += [event(10 * track, track, f"T{track}"), event(10 * track + 5, track)]
    (line,) = parse_traces(forms.trace(*written), "t").traces
    assert [e.units for e in line.executions] == [(unit,) for unit in found]


def bundle(cpu, *switches, lost=None):
    """Write switches of a CPU: instant, name and thread that enters, thread that leaves, its state."""
    events = []
    for at, name, entered, left, state in switches:
        fields = [(2, left), (4, state), (5, name), (6, entered)]
        switch = forms.message(*((number, value) for number, value in fields if value))  # 0 is not written
        events.append(forms.message((1, at), (4, switch)))
    stated = [(1, cpu)] if cpu else []
    return forms.message((1, forms.message(*stated, *((2, e) for e in events), *([(3, lost)] if lost else []))))


def test_threads_without_a_name_have_that_of_the_process_tree_or_their_number():
    thread = forms.message((1, 5), (2, "tree"))
    tree = forms.message((2, forms.message((2, thread), (2, forms.message((1, 7), (2, "seven"))))), (10, 1))
    switches = bundle(0, (10, "", 5, 0, 0), (20, "", 6, 5, 1), (30, "own", 7, 6, 1), (40, "", 0, 7, 1))
    for packets in ((tree, switches), (switches, tree)):
        (found,) = parse_traces(forms.trace(*packets), "t").traces
        assert [row[:3] for row in seen(found)] == [("tree", 10, 20), ("6", 20, 30), ("own", 30, 40)]
        assert {e.units for e in found.executions} == {("cpu0",)}


@pytest.mark.parametrize("state", [0, 0x100, 1, 2, 2**64 - 1])
def test_states_of_threads_in_perfetto_are_those_of_the_kernel(state):
    switches = bundle(1, (10, "A", 5, 0, 0), (20, "B", 6, 5, state), (30, "A", 5, 6, 1), (40, "", 0, 5, 1))
    (found,) = parse_traces(forms.trace(switches), "t").traces
    spans = [row[:3] for row in seen(found)]
    whole = [("A", 10, 40), ("B", 20, 30)]
    assert spans == (whole if state in (0, 0x100) else [("A", 10, 20), ("B", 20, 30), ("A", 30, 40)])


@pytest.mark.parametrize("lost", [None, 1])
def test_a_bundle_states_that_events_were_lost(lost):
    switches = bundle(0, (10, "A", 5, 0, 0), (20, "", 0, 5, 1), lost=lost)
    found = [d.code for d in parse_traces(forms.trace(switches), "t").diagnostics]
    assert found == ([codes.LOST_EVENTS.id] if lost else [])


@pytest.mark.parametrize("lengths", [(2, 1, 2, 2), (2, 2, 1, 2), (2, 2, 2, 3), (1, 2, 2, 2)])
def test_columns_of_switches_have_one_length(lengths):
    numbers = zip((1, 2, 3, 6), lengths, strict=True)
    columns = forms.message((5, "A"), *((number, bytes(length)) for number, length in numbers))
    (found,) = refused_by(forms.trace(forms.message((1, forms.message((4, columns))))))
    assert f"columns of switches have unlike lengths, {min(lengths)} to {max(lengths)}" in found.message


@pytest.mark.parametrize("form", ["perfetto", "perfetto in columns"])
@pytest.mark.parametrize("size", [20, 33, 64, 100])
def test_packets_are_read_in_pieces_of_any_size(form, size, monkeypatch):
    """Switches are followed in parts of the same size."""
    monkeypatch.setattr(perfetto, "_CHUNK", size)
    (found,) = parse_traces(WRITERS[form](), "t").traces
    assert seen(found) == forms.JOBS


@pytest.mark.parametrize("size", [0, 1, 126, 127, 128, 129, 300])
def test_packets_have_any_size(size):
    """The length of a packet and the number of its field are varints of one byte or more."""
    packets = [forms.message((8, 1000), (99, bytes(size))), *(event(*each) for each in RUN)]
    assert perfetto_jobs(*packets) == SEEN
    assert parse_traces(forms.trace(forms.message((99, bytes(size))), event(1, 1, "A"), event(2, 1)), "t").traces


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        (b"\x0d\1\2\3", "a field is longer than its message"),
        (b"\x09\1\2\3\4\5\6\7", "a field is longer than its message"),
        (b"\x0a\2a", "a field is longer than its message"),
        (b"\x0b", "a field has the wire type 3"),
        (b"\x08" + b"\xff" * 10, "a number has more than 64 bits"),
    ],
)
def test_messages_that_are_none(fields, said):
    with pytest.raises(ValueError, match=said):
        perfetto.fields_of(fields)


def test_values_of_messages_by_their_wire_type():
    """Varint, fixed64, bytes and fixed32, by the encoding of protocol buffers; numbers have 64 bits."""
    data = b"\x08\x96\1\x11" + (2**63 + 5).to_bytes(8, "little") + b"\x1a\2ab\x25" + (2**31).to_bytes(4, "little")
    assert perfetto.fields_of(data) == {1: [150], 2: [2**63 + 5], 3: [b"ab"], 4: [2**31]}
    assert perfetto.fields_of(b"\x08" + b"\xff" * 9 + b"\1\x08\0") == {1: [2**64 - 1, 0]}
    assert perfetto.fields_of(b"\xf8\7\x7f") == {127: [127]}


def test_packets_that_differ_in_their_instant_alone_are_decoded_once(monkeypatch):
    """Decoding takes most of the time of a large trace."""
    decoded = []
    monkeypatch.setattr(perfetto, "fields_of", lambda data, of=perfetto.fields_of: decoded.append(data) or of(data))
    written = [event(10 * at + 5 * end, 1, "" if end else "A") for at in range(50) for end in (0, 1)]
    assert len(perfetto_jobs(*written)) == 50
    assert len(decoded) < 20


def test_what_comes_between_equal_packets_counts():
    """A name, a default or a clock that changes makes equal bytes another event."""
    begin = forms.message((9, 1), (11, 1), (10, 1))
    written = []
    for at, name in enumerate("ABA"):
        interned = forms.message((12, forms.message((2, forms.message((1, 1), (2, name))))), (10, 1))
        written += [interned, forms.message((8, 10 * at), (10, 1), (11, begin)), event(10 * at + 5, 1)]
    assert [job[0] for job in perfetto_jobs(*written)] == ["A", "B", "A"]
    two = forms.message((8, 40), (10, 1), (11, begin), (11, forms.message((9, 1), (11, 2), (23, "C"))))
    ends = [event(at, track) for track in (1, 2) for at in (45, 55)]
    again = forms.message((8, 50), (10, 1), (11, begin), (11, forms.message((9, 1), (11, 2), (23, "C"))))
    assert len(perfetto_jobs(*written, two, again, *ends)) == 7


def test_events_without_a_track_are_those_of_track_0():
    """``track_uuid`` is 0 where neither the event nor the defaults of its writer state one."""
    track = forms.message((60, forms.message((2, "c0"))), (10, 1))
    begin, end = forms.message((9, 1), (23, "A")), forms.message((9, 2))
    packets = [forms.message((8, at), (11, what), (10, 1)) for at, what in ((5, begin), (9, end))]
    (found,) = parse_traces(forms.trace(track, *packets), "t").traces
    assert [(e.task, e.units, e.start.ns, e.end.ns) for e in found.executions] == [("A", ("c0",), 5, 9)]
