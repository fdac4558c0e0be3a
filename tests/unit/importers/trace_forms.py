"""One run in every form of trace that is read: a writer for each, made after the descriptions of the formats.

The run: A on one CPU from 1 to 3 us; B from 3 to 4 us, preempted by A from 4 to 5 us, and to the end at 6 us; ...
"""

from __future__ import annotations

import json
import struct

RUN = [
    # at (us), CPU, thread that leaves, whether it still wants to run, thread that enters
    (1, 0, "idle", True, "A"),
    (3, 0, "A", False, "B"),
    (4, 0, "B", True, "A"),
    (5, 0, "A", False, "B"),
    (6, 0, "B", False, "idle"),
    (6, 1, "idle", True, "C"),
    (9, 1, "C", False, "idle"),
]
PIDS = {"idle": 0, "A": 11, "B": 12, "C": 13}
COMM = {"idle": "swapper/0", "A": "A", "B": "B", "C": "C"}
JOBS = [
    ("A", 1000, 3000, 2000, ()),
    ("B", 3000, 6000, 2000, ((3000, 4000), (5000, 6000))),
    ("A", 4000, 5000, 1000, ()),
    ("C", 6000, 9000, 3000, ()),
]
"""Task, start, end, busy, and where it ran: what every form of the run comes to, in nanoseconds."""


def ftrace(*, is_short: bool = False) -> bytes:
    """Write the text of ftrace, or that of trace-cmd."""
    lines = ["# tracer: nop", "#", "# entries-in-buffer/entries-written: 7/7   #P:2", "#"]
    for at, cpu, left, goes_on, entered in RUN:
        state = "R" if goes_on else "S"
        head = f"{COMM[left]:>16}-{PIDS[left]:<7} [{cpu:03}]"
        if is_short:
            what = f"{COMM[left]}:{PIDS[left]} [120] {state} ==> {COMM[entered]}:{PIDS[entered]} [120]"
            lines.append(f"{head}     0.{at:06}: sched_switch:         {what}")
        else:
            what = f"prev_comm={COMM[left]} prev_pid={PIDS[left]} prev_prio=120 prev_state={state} "
            what += f"==> next_comm={COMM[entered]} next_pid={PIDS[entered]} next_prio=120"
            lines.append(f"{head} d..2.     0.{at:06}: sched_switch: {what}")
    return ("\n".join(lines) + "\n").encode()


# ------------------------------------------------------------------------------------------- protobuf


def varint(value: int) -> bytes:
    """Write a number in seven bits a byte, the lowest first."""
    found = bytearray()
    value &= 2**64 - 1
    while value > 0x7F:
        found.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*found, value])


def message(*fields: tuple[int, object]) -> bytes:
    """Write the fields of a message, each with its number."""
    found = b""
    for number, value in fields:
        if isinstance(value, int):
            found += varint(number << 3) + varint(value)
        else:
            data = value.encode() if isinstance(value, str) else bytes(value)  # type: ignore[call-overload]
            found += varint(number << 3 | 2) + varint(len(data)) + data
    return found


def trace(*packets: bytes) -> bytes:
    """Write a trace of packets."""
    return message(*((1, packet) for packet in packets))


def perfetto_slices() -> bytes:
    """Write a trace of slices on tracks, with interned names; tracks are the threads of one process."""
    process = message((60, message((1, 7), (3, message((1, 40), (6, "run"))))), (10, 1))
    packets = [process]
    for number, unit in enumerate(("c0", "c1"), 1):
        thread = message((1, 40), (2, 40 + number), (5, unit))
        packets.append(message((60, message((1, number), (5, 7), (4, thread))), (10, 1)))
    names = [message((1, number), (2, name)) for number, name in enumerate("ABC", 1)]
    packets.append(message((12, message(*((2, name) for name in names))), (13, 1), (10, 1)))
    for at, track, kind, name in [(1, 1, 1, 1), (3, 1, 2, 0), (6, 2, 1, 3), (9, 2, 2, 0), (4, 1, 1, 1), (5, 1, 2, 0)]:
        event = message((9, kind), (11, track), *(((10, name),) if kind == 1 else ()))
        packets.append(message((8, at * 1000), (11, event), (13, 2), (10, 1)))
    return trace(*packets)


def perfetto_switches(*, is_compact: bool = False) -> bytes:
    """Write a trace of ftrace events in bundles for each CPU, plain or in columns."""
    packets = []
    for cpu in (0, 1):
        found = [switch for switch in RUN if switch[1] == cpu]
        if not is_compact:
            events = []
            for at, _, left, goes_on, entered in found:
                switch = message((1, COMM[left]), (2, PIDS[left]), (4, 0x100 if goes_on else 1))
                switch += message((5, COMM[entered]), (6, PIDS[entered]))
                events.append(message((1, at * 1000), (2, PIDS[left]), (4, switch)))
            packets.append(message((1, message((1, cpu), *((2, event) for event in events)))))
            continue
        names = sorted({COMM[entered] for *_, entered in found})
        times = [at * 1000 for at, *_ in found]
        columns = {
            1: [after - before for before, after in zip([0, *times], times, strict=False)],
            2: [0x100 if goes_on else 1 for _, _, _, goes_on, _ in found],
            3: [PIDS[entered] for *_, entered in found],
            4: [120] * len(found),
            6: [names.index(COMM[entered]) for *_, entered in found],
        }
        packed = [(number, b"".join(map(varint, values))) for number, values in columns.items()]
        packets.append(message((1, message((1, cpu), (4, message(*((5, name) for name in names), *packed))))))
    return trace(*packets)


# ------------------------------------------------------------------------------------------ trace.dat

PAGE = 4096
HEADER_PAGE = (
    "\tfield: u64 timestamp;\toffset:0;\tsize:8;\tsigned:0;\n"
    "\tfield: local_t commit;\toffset:8;\tsize:8;\tsigned:1;\n"
    "\tfield: int overwrite;\toffset:8;\tsize:1;\tsigned:1;\n"
    "\tfield: char data;\toffset:16;\tsize:4080;\tsigned:1;\n"
)
HEADER_EVENT = (
    "# compressed entry header\n\ttype_len    :    5 bits\n\ttime_delta  :   27 bits\n\tarray       :   32 bits\n\n"
    "\tpadding     : type == 29\n\ttime_extend : type == 30\n\ttime_stamp : type == 31\n\tdata max type_len  == 28\n"
)
SWITCH = (
    "name: sched_switch\nID: 316\nformat:\n"
    "\tfield:unsigned short common_type;\toffset:0;\tsize:2;\tsigned:0;\n"
    "\tfield:unsigned char common_flags;\toffset:2;\tsize:1;\tsigned:0;\n"
    "\tfield:unsigned char common_preempt_count;\toffset:3;\tsize:1;\tsigned:0;\n"
    "\tfield:int common_pid;\toffset:4;\tsize:4;\tsigned:1;\n\n"
    "\tfield:char prev_comm[16];\toffset:8;\tsize:16;\tsigned:0;\n"
    "\tfield:pid_t prev_pid;\toffset:24;\tsize:4;\tsigned:1;\n"
    "\tfield:int prev_prio;\toffset:28;\tsize:4;\tsigned:1;\n"
    "\tfield:long prev_state;\toffset:32;\tsize:8;\tsigned:1;\n"
    "\tfield:char next_comm[16];\toffset:40;\tsize:16;\tsigned:0;\n"
    "\tfield:pid_t next_pid;\toffset:56;\tsize:4;\tsigned:1;\n"
    "\tfield:int next_prio;\toffset:60;\tsize:4;\tsigned:1;\n\n"
    'print fmt: "prev_pid=%d next_pid=%d", REC->prev_pid, REC->next_pid\n'
)
WAKE = (
    "name: sched_waking\nID: 318\nformat:\n"
    "\tfield:unsigned short common_type;\toffset:0;\tsize:2;\tsigned:0;\n"
    "\tfield:unsigned char common_flags;\toffset:2;\tsize:1;\tsigned:0;\n"
    "\tfield:unsigned char common_preempt_count;\toffset:3;\tsize:1;\tsigned:0;\n"
    "\tfield:int common_pid;\toffset:4;\tsize:4;\tsigned:1;\n\n"
    '\tfield:pid_t pid;\toffset:8;\tsize:4;\tsigned:1;\n\nprint fmt: "pid=%d", REC->pid\n'
)


def trace_dat(
    *,
    order: str = "<",
    missed: int = 0,
    version: bytes = b"6",
    clock: str = "[local] global",
    pages: tuple[bytes, bytes] | None = None,
) -> bytes:
    """Write a trace.dat of version 6, with the run or other `pages` of its two CPUs; big-endian with `order` ``>``."""

    def number(value: int, size: int) -> bytes:
        return value.to_bytes(size, "little" if order == "<" else "big")

    def sized(text: str, size: int = 8) -> bytes:
        return number(len(text), size) + text.encode()

    data = b"\x17\x08\x44tracing" + version + b"\0" + (b"\0" if order == "<" else b"\1") + b"\x08" + number(PAGE, 4)
    data += b"header_page\0" + sized(HEADER_PAGE) + b"header_event\0" + sized(HEADER_EVENT)
    data += number(0, 4) + number(1, 4) + b"sched\0" + number(2, 4) + sized(SWITCH) + sized(WAKE)
    data += sized("", 4) + sized("", 4) + sized("11 A\n12 B\n13 C\n") + number(2, 4)
    data += b"options  \0" + number(4, 2) + sized(clock, 4) + number(0, 2)
    data += b"flyrecord\0"
    begin = -(-(len(data) + 2 * 16 + 8 + len(clock)) // PAGE) * PAGE
    for cpu in (0, 1):
        data += number(begin + cpu * PAGE, 8) + number(PAGE, 8)
    data += sized(clock)
    data = data.ljust(begin, b"\0")
    for cpu in (0, 1):
        data += pages[cpu] if pages else _page([switch for switch in RUN if switch[1] == cpu], order, number, missed)
    return data


def trace_dat_7(
    pack=None, algorithm: bytes = b"none", clock: bytes = b"local", instance: bytes = b"", cpus: int = 2
) -> bytes:
    """Write a trace.dat of version 7, its sections and pages compressed by `pack`, of which so many CPUs have some."""

    def number(value: int, size: int) -> bytes:
        return value.to_bytes(size, "little")

    def sized(text: str) -> bytes:
        return number(len(text), 8) + text.encode()

    def chunk(content: bytes) -> bytes:
        packed = pack(content)
        return number(len(packed), 4) + number(len(content), 4) + packed

    data = b"\x17\x08\x44tracing7\0\0\x08" + number(PAGE, 4) + algorithm + b"\0001\0"
    place, data = len(data), data + bytes(8)

    def section(id: int, content: bytes, *, is_packed: bool) -> int:
        nonlocal data
        at, content = len(data), chunk(content) if is_packed else content
        data += number(id, 2) + number(is_packed, 2) + number(0, 4) + number(len(content), 8) + content
        return at

    def options(*found: tuple[int, bytes]) -> int:
        texts = (number(id, 2) + number(len(value), 4) + value for id, value in found)
        return section(0, b"".join(texts), is_packed=bool(pack))

    head = section(
        16, b"header_page\0" + sized(HEADER_PAGE) + b"header_event\0" + sized(HEADER_EVENT), is_packed=bool(pack)
    )
    events = number(1, 4) + b"sched\0" + number(2, 4) + sized(SWITCH) + sized(WAKE)
    formats = section(18, events, is_packed=bool(pack))
    buffer, places = section(3, b"", is_packed=False), b""
    data = data[: buffer + 2] + number(bool(pack), 2) + data[buffer + 4 :]
    for cpu in (0, 1):
        page = _page([switch for switch in RUN if switch[1] == cpu], "<", number, 0)
        stored = (number(1, 4) + chunk(page) if pack else page) if cpu < cpus else b""
        places += number(cpu, 4) + number(len(data), 8) + number(len(stored), 8)
        data += stored
    about = number(buffer, 8) + instance + b"\0" + clock + b"\0" + number(PAGE, 4) + number(2, 4) + places
    last = options((3, about), (0, bytes(8)))
    first = options((16, number(head, 8)), (18, number(formats, 8)), (0, number(last, 8)))
    return data[:place] + number(first, 8) + data[place + 8 :]


def _page(found, order, number, missed):
    """Write one page: the first event after a time extend, the second in the long form, others in the short one."""

    def head(kind: int, delta: int) -> bytes:
        return number(kind | delta << 5 if order == "<" else kind << 27 | delta, 4)

    events, now = b"", 500
    for index, (at, _, left, goes_on, entered) in enumerate(found):
        fields = struct.pack(
            f"{order}HBBi16siiq16sii",
            *(316, 0, 0, PIDS[left], COMM[left].encode(), PIDS[left], 120, 0x100 if goes_on else 1),
            *(COMM[entered].encode(), PIDS[entered], 120),
        )
        delta = at * 1000 - now
        if index == 0:
            events += head(30, delta) + number(0, 4) + head(len(fields) // 4, 0) + fields
        elif index == 1:
            events += head(0, delta) + number(len(fields) + 4, 4) + fields
        else:
            events += head(len(fields) // 4, delta) + fields
        now = at * 1000
    woken = struct.pack(f"{order}HBBii", 318, 0, 0, 0, 11)
    events += head(len(woken) // 4, 0) + woken + head(29, 0)
    page = number(500, 8) + number(len(events) | missed << 31, 8) + events
    return page.ljust(PAGE, b"\0")


# ------------------------------------------------------------------------------------------ other texts


def btf() -> bytes:
    """Write the run in the Best Trace Format."""
    lines, count, running = ["#version 2.2.1", "#timeScale us"], dict.fromkeys("ABC", -1), set()
    for at, cpu, left, goes_on, entered in RUN:
        if left != "idle":
            event = "preempt" if goes_on else "terminate"
            lines.append(f"{at},Core_{cpu},0,T,TASK_{left},{count[left]},{event}")
            running -= set() if goes_on else {left}
        if entered != "idle":
            event = "resume" if entered in running else "start"
            count[entered] += entered not in running
            running.add(entered)
            lines.append(f"{at},Core_{cpu},0,T,TASK_{entered},{count[entered]},{event}")
    return "\n".join(lines).encode()


def events_json() -> bytes:
    """Write the jobs as slices of parts in the Trace Event Format."""
    events = []
    for number, (task, start, end, _, stretches) in enumerate(JOBS):
        for a, b in stretches or ((start, end),):
            arguments = {"job": number, "part": 0} if stretches else {}
            slice = {"ph": "X", "name": task, "pid": 1, "tid": 1, "ts": a / 1000, "dur": (b - a) / 1000}
            events.append(slice | {"args": arguments})
    return json.dumps(events).encode()


def signals() -> bytes:
    """Write the states of the tasks over time, as spreadsheets of measurement tools do; a preemption is a 1, too."""
    rows = ["Time [s];A;B;C;speed", "s;;;;km/h"]
    for us in range(11):
        states = [any(start <= 1000 * us < end for task, start, end, *_ in JOBS if task == name) for name in "ABC"]
        rows.append(f"0,{us:06};" + ";".join(str(int(state)) for state in states) + f";{us},5")
    return ("\n".join(rows) + "\n").encode("utf-8-sig")
