"""The reader of CTF: events with times and values, whatever header and byte order; and all that can be wrong."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ctf_writer import MS, ROS, Trace, ros_trace
from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.importers.traces import codes, read_traces
from halpipe.importers.traces.ctf import CtfError, Damage, events, folders
from halpipe.importers.traces.ctf.decoding import Int
from halpipe.importers.traces.ctf.metadata import MAGIC, parse, text_of
from halpipe.importers.traces.ros2 import Key, read_ros_trace
from profiles import examples

HEAD = "/* CTF 1.8 */ trace { major = 1; minor = 8; byte_order = le; };"


def all_events(folder):
    damage = Damage()
    return list(events(folders(str(folder)), damage)), damage


def packed(text, order="<"):
    """Metadata in packets of 100 bytes of text, as LTTng writes it."""
    found = b""
    data = text.encode()
    for at in range(0, len(data), 100):
        piece = data[at : at + 100]
        sizes = (8 * (37 + len(piece)), 8 * (37 + len(piece) + 11))
        found += struct.pack(f"{order}I16sIII5B", MAGIC, bytes(16), 0, *sizes, 0, 0, 0, 1, 8) + piece + bytes(11)
    return found


@pytest.mark.parametrize("order", ["le", "be"])
@pytest.mark.parametrize("header", ["large", "small"])
@pytest.mark.parametrize("extended", [False, True])
def test_events_of_all_headers_and_orders(tmp_path, order, header, extended):
    trace = Trace(order, header)
    trace.declare("a:one", number="u64", text="str", small="u32")
    trace.declare("a:two")
    times = [5, 6, 1_000, 130_000_000, 134_217_729, 260_000_000]  # the 27 bits of a compact header roll over twice
    for index, time in enumerate(times):
        trace.add("a:one", time, cpu=index % 2, tid=index, number=2**63 + index, text="ä" * index, small=index)
    trace.add("a:two", 270_000_000, cpu=1)
    found, damage = all_events(trace.write(tmp_path / "t", extended=extended))
    assert [event.time - trace.offset for event in found] == [*times, 270_000_000]
    assert [event.fields for event in found[:-1]] == [
        {"number": 2**63 + i, "text": "ä" * i, "small": i} for i in range(len(times))
    ]
    assert found[3].context == {"vpid": 7, "vtid": 3}
    assert [event.cpu for event in found] == [0, 1, 0, 1, 0, 1, 1]
    assert damage == Damage()


def test_metadata_in_packets(tmp_path):
    trace = Trace()
    trace.declare("a:one", number="u64")
    trace.add("a:one", 5, number=3)
    folder = trace.write(tmp_path)
    (folder / "metadata").write_bytes(packed(trace.text))
    assert [event.fields for event in all_events(folder)[0]] == [{"number": 3}]
    assert text_of(packed(trace.text, ">")) == trace.text


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (packed("trace { };")[:45], "cut off"),
        (packed("trace { };")[:20], "cut off"),
        (b"\xff\xfe\x00", "no text"),
    ],
)
def test_metadata_that_is_none(data, said):
    with pytest.raises(CtfError, match=said):
        text_of(data)


@pytest.mark.parametrize(
    "text",
    [
        "env {",
        "nonsense",
        "event { name = ; };",
        "typealias integer { size = 8; } := a; typealias b := c;",
        "typealias integer { size = 8; align = 3; } := a;",
        "struct a { a x[99999999999]; };",
        "typealias " + "struct { " * 50 + "} " * 50 + ":= deep;",
        "@",
    ],
)
def test_declarations_that_are_none(text):
    with pytest.raises(CtfError):
        parse(f"{HEAD} {text}")


@pytest.mark.parametrize(
    ("sound", "damaged"),
    [
        ("freq = 1000000000", "freq = 1=0"),
        ("offset = 1000000", "offset = often"),
        ("stream_id = 0", "stream_id = 0=0"),
        ("uint32_t timestamp", "uint33_t timestamp"),
        ("packet.header := struct", "packet.header := 7; x := struct"),
    ],
)
def test_numbers_and_names_that_are_none(tmp_path, sound, damaged):
    folder = ros_trace(3).write(tmp_path)
    text = (folder / "metadata").read_text()
    assert sound in text
    (folder / "metadata").write_text(text.replace(sound, damaged))
    with pytest.raises(CtfError):
        list(events([str(folder)], Damage()))


@pytest.mark.parametrize(
    ("sound", "damaged"),
    [
        ("byte_order = le;", ""),
        ("major = 1", "major = 2"),
        ("size = 16", "size = 0"),
        ("size = 16", "size = 72"),
        ("size = 16; align = 8; signed = false", "size = 16; align = 8; signed = fxlse"),
        ("size = 16; align = 8; signed = false", "size = 16; align = 8; singed = false"),
        ("freq = 1000000000; offset", "freq = 1000000000; uint8_t"),
        ("uint64_t packet_size", "uint64_t 9"),
        ("0 ... 65534", "0 . . 65534"),
        ("compact = 0 ... 65534,", "com>act = 0 ... 65534,"),
        ("stream_id = 0;", "stream_id>= 0;"),
        ("uint32_t _vpid;", "uint32_t uint8_t;"),
        ("variant <id>", "variant <0>"),
        (
            "signed = false; } := uint64_t;",
            "signed = false; } := other_t; env { typealias integer { size = 64; } := uint64_t; };",
        ),
        (":= uint8_t;", ":= ;"),
        (":= uint16_t;", ":= uint8_t;"),
        ("struct small {", "struct large {"),
        ("  id = 0;", "  id = 0; id = 0;"),
        ("uint64_t timestamp_end;", "uint64_t timestamp_begin;"),
        ("integer { size = 27;", "integer { size = 27; map = clock.other.value;"),
        ("clock { name", 'clock { name = "monotonic"; }; clock { name'),
        ("event { name", 'event { name = "a:one"; id = 0; stream_id = 0; }; event { name'),
        ("stream {", "stream { id = 0; }; stream {"),
        ("trace {", "trace { major = 1; minor = 8; byte_order = le; }; trace {"),
    ],
)
def test_declarations_that_babeltrace2_refuses(tmp_path, sound, damaged):
    folder = ros_trace(3).write(tmp_path)
    text = (folder / "metadata").read_text()
    assert sound in text
    (folder / "metadata").write_text(text.replace(sound, damaged, 1))
    with pytest.raises(CtfError):
        list(events([str(folder)], Damage()))


@pytest.mark.parametrize("other", ["offset = 1;", "freq = 1000;", "offset_s = 1;"])
@pytest.mark.parametrize(("mapped", "is_read"), [(["monotonic"], True), (["monotonic", "other"], False), ([], False)])
def test_of_several_clocks_those_count_that_integers_map(tmp_path, other, mapped, is_read):
    trace = Trace(header="small")
    trace.declare("a:one")
    trace.add("a:one", 5)
    trace.text = trace.text.replace("clock {", f"clock {{ name = other; {other} }}; clock {{", 1)
    for bits, clock in zip((27, 32), mapped, strict=False):
        alias = f"integer {{ size = {bits};"
        trace.text = trace.text.replace(alias, f"{alias} map = clock.{clock}.value;")
    folder = str(trace.write(tmp_path / "t"))
    if is_read:
        assert [event.time - trace.offset for event in events([folder], Damage())] == [5]
        return
    with pytest.raises(CtfError, match="unlike frequencies or offsets"):
        list(events([folder], Damage()))


def test_streams_of_which_no_event_can_be_read(tmp_path):
    folder = ros_trace(3).write(tmp_path)
    text = (folder / "metadata").read_text()
    (folder / "metadata").write_text(text[: text.index("struct large")] + "stream { id = 0; }; event { name = e; };\n")
    with pytest.raises(HalpipeError) as raised:
        read_traces(str(folder))
    assert [found.code for found in raised.value.diagnostics] == [codes.NO_CTF.id]
    assert "an event has no bytes" in raised.value.diagnostics[0].message


@pytest.mark.parametrize("header", ["large", "small"])
def test_headers_whose_ids_select_nothing(tmp_path, header):
    trace = Trace(header=header)
    trace.text = trace.text.replace("compact = 0", "compact = 9")
    trace.declare("a:one")
    trace.add("a:one", 5)
    try:
        found, damage = all_events(trace.write(tmp_path))
    except CtfError:
        return
    assert (found, len(damage.broken)) == ([], 1)


@pytest.mark.parametrize("field", [2, 3])
def test_sizes_of_packets_that_are_no_whole_bytes(tmp_path, field):
    trace = Trace()
    trace.declare("a:one")
    trace.add("a:one", 5)
    stream = trace.write(tmp_path) / "channel_0"
    data = bytearray(stream.read_bytes())
    data[8 + 8 * field] += 1
    stream.write_bytes(bytes(data))
    assert ["sizes" in text for text in all_events(tmp_path)[1].broken] == [True]


def test_a_packet_without_a_size_ends_with_its_content(tmp_path):
    trace = Trace()
    trace.declare("a:one")
    trace.add("a:one", 5)
    text = (trace.write(tmp_path) / "metadata").read_text()
    (tmp_path / "metadata").write_text(text.replace("packet_size", "some_size"))
    found, damage = all_events(tmp_path)
    assert len(found) == 1
    assert ["no packet begins" in text for text in damage.broken] == [True]  # where its padding is


def test_metadata_of_another_version_is_none(tmp_path):
    folder = ros_trace(3).write(tmp_path)
    assert folders(str(folder)) == [str(folder)]
    (folder / "metadata").write_text("/* CTF 1.) */" + (folder / "metadata").read_text()[13:])
    assert folders(str(folder)) == []


def test_events_that_precede_those_of_the_packet_before(tmp_path):
    trace = Trace()
    trace.declare("a:one")
    for time in (5, 6):
        trace.add("a:one", time)
    folder = trace.write(tmp_path)
    text = (
        (folder / "metadata")
        .read_text()
        .replace("uint64_t timestamp_begin; uint64_t timestamp_end;", "uint64_t a; uint64_t b;")
    )
    (folder / "metadata").write_text(text)
    stream = folder / "channel_0"
    stream.write_bytes(stream.read_bytes() * 2)
    found, damage = all_events(folder)
    assert [event.time - trace.offset for event in found] == [5, 6]
    assert ["precedes" in text for text in damage.broken] == [True]


@examples(60)
@given(st.binary(max_size=200), st.integers(0, 4000))
def test_damaged_traces_are_read_as_far_as_they_go_or_refused(tmp_path_factory, junk, at):
    folder = ros_trace(3).write(tmp_path_factory.mktemp("t"))
    file = folder / ("channel_0" if at % 2 else "metadata")
    data = file.read_bytes()
    file.write_bytes(data[:at] + junk + data[at + len(junk) :])
    findings = Findings()
    try:
        read_ros_trace(str(folder), findings)
    except HalpipeError as failure:
        assert all(found.message for found in failure.diagnostics)  # noqa: PT017


def read(folder):
    findings = Findings()
    return read_ros_trace(str(folder), findings), findings.items


def test_what_a_trace_says(tmp_path):
    trace, said = read(ros_trace().write(tmp_path / "ust" / "uid"))
    source, sink = Key("/source", "timer", str(10 * MS), 0), Key("/sink", "timer", str(20 * MS), 0)
    keeper = Key("/sink", "subscription", "/a", 0)
    assert set(trace.callbacks) == {source, sink, keeper}
    assert [job.busy for job in trace.jobs[source]] == [MS + 1000 * k for k in range(20)]
    assert [job.busy for job in trace.jobs[sink]] == [3 * MS] * 10
    assert trace.publishers == {("/source", "/a"): {source: 20}, ("/sink", "/b"): {sink: 10}}
    assert trace.groups == {"/sink/callback_group_0": ("mutually_exclusive", [sink, keeper])}
    assert trace.executors == {"executor_0": ("multi_threaded_executor", ["/sink/callback_group_0"])}
    assert said == []


def test_time_on_the_cpu_is_net_of_preemption(tmp_path):
    trace, _ = read(ros_trace(switches=True).write(tmp_path))
    assert trace.has_switches
    assert {job.busy for job in trace.jobs[Key("/sink", "timer", str(20 * MS), 0)]} == {2 * MS}
    assert {job.end - job.start for job in trace.jobs[Key("/sink", "timer", str(20 * MS), 0)]} == {3 * MS}


def test_a_cut_off_trace_counts_up_to_the_cut(tmp_path):
    folder = ros_trace().write(tmp_path)
    whole, _ = read(folder)
    file = folder / "channel_0"
    file.write_bytes(file.read_bytes()[:-30])
    cut, said = read(folder)
    source = Key("/source", "timer", str(10 * MS), 0)
    assert len(cut.jobs[source]) == len(whole.jobs[source]) - 1
    (warning,) = said
    assert warning.code == codes.CUT_OFF.id
    assert "channel_0 from byte" in warning.message


def test_discarded_events_are_counted(tmp_path):
    _, said = read(ros_trace().write(tmp_path, discarded=3))
    assert [d.code for d in said] == [codes.LOST_EVENTS.id]
    assert "6 events" in said[0].message


def test_events_of_others_and_lone_ends_are_told(tmp_path):
    trace = ros_trace()
    trace.add("other:thing", 500 * MS, value=1)
    trace.add("ros2:callback_end", 501 * MS, callback=100)
    trace.add("ros2:callback_start", 502 * MS, callback=100, is_intra_process=0)
    _, said = read(trace.write(tmp_path))
    assert [d.code for d in said] == [codes.FOREIGN_EVENTS.id, codes.ODD_SEQUENCE.id]
    assert "other:thing" in said[0].message


def test_an_address_that_is_used_again_is_another_publisher(tmp_path):
    trace = ros_trace(2)
    trace.add("ros2:rcl_publisher_init", 300 * MS, publisher_handle=10, node_handle=2, topic_name="/new")
    trace.add("ros2:rcl_publish", 301 * MS, publisher_handle=10, message=0)
    found, _ = read(trace.write(tmp_path))
    assert found.publishers["/source", "/a"] == {Key("/source", "timer", str(10 * MS), 0): 2}
    assert found.publishers["/sink", "/new"] == {None: 1}


def test_a_file_called_metadata_alone_makes_no_trace(tmp_path):
    for content in ("", "name: something else\n"):
        (tmp_path / "metadata").write_text(content)
        assert folders(str(tmp_path)) == []
    (tmp_path / "metadata").write_bytes(packed("trace { };")[:20])
    assert folders(str(tmp_path)) == [str(tmp_path)]


def test_a_directory_without_a_trace_and_a_trace_without_callbacks(tmp_path):
    with pytest.raises(HalpipeError) as caught:
        read(tmp_path)
    assert [d.code for d in caught.value.diagnostics] == [codes.NO_CTF.id]
    trace = Trace()
    for name in ("ros2:rcl_node_init", "other:thing"):
        trace.declare(name, **ROS[name])
    trace.add("other:thing", 1, value=1)
    with pytest.raises(HalpipeError) as caught:
        read(trace.write(tmp_path / "t"))
    assert caught.value.diagnostics[-1].code == codes.NO_EXECUTIONS.id


def test_a_trace_of_callbacks_is_compared_under_the_names_of_tasks(tmp_path):
    (line,) = read_traces(str(ros_trace(4).write(tmp_path))).traces
    assert [e.task for e in line.executions[:3]] == ["/source", "/sink/callback_1", "/sink/callback_0"]
    assert line.executions[0].end - line.executions[0].start == line.executions[0].start.parse("1ms")


HEADERS = {
    "struct { uint64_t id; uint64_t timestamp; }": ("<QQ", 64),
    "struct { uint8_t id; uint16_t timestamp; }": ("<BH", 16),
    "struct { uint16_t id; CLOCK _at; }": ("<HI", 32),
    "struct { enum : uint8_t { one = 0, two = 1 } id; variant <id> { struct { uint16_t timestamp; } one; "
    "struct { uint64_t timestamp; } two; } v; }": ("<BH", 16),
}


@pytest.mark.parametrize("header", HEADERS)
def test_any_structure_is_a_header_of_events(tmp_path, header):
    """CTF 1.8, 6.1.1: the header of events is any structure; short time stamps count on from the one before."""
    layout, bits = HEADERS[header]
    trace = Trace()
    trace.declare("a:one", number="u64")
    clock = "integer { size = 32; align = 8; signed = false; map = clock.monotonic.value; }"
    trace.text = trace.text.replace("struct large;", header.replace("CLOCK", clock) + ";")
    trace.event = lambda time, id, data, extended: struct.pack(layout, id, time % 2**bits) + data
    times = [5, 60_000, 70_000, 70_001, 130_000]
    for time in times:
        trace.add("a:one", time, number=time)
    found, damage = all_events(trace.write(tmp_path))
    assert [event.time - trace.offset for event in found] == times
    assert [event.fields["number"] for event in found] == times
    assert damage == Damage()


def test_a_trace_without_headers_is_one_packet_of_one_class(tmp_path):
    text = """/* CTF 1.8 */ trace { major = 1; minor = 8; byte_order = le; };
stream { id = 0; };
event { name = "e"; id = 0; stream_id = 0; fields := struct { integer { size = 8; } n; } align(8); };"""
    (tmp_path / "metadata").write_text(text)
    (tmp_path / "s").write_bytes(b"\1\2\3")
    found, damage = all_events(tmp_path)
    assert [event.fields["n"] for event in found] == [1, 2, 3]
    assert damage == Damage()


@pytest.mark.parametrize(
    "before",
    [
        "typealias integer { size = 8; byte_order = le; } := little;",
        "/* byte_order = le */ // byte_order = le\n",
        'env { hostname = "byte_order = le; trace {"; };',
        "stream { event.header := struct { integer { size = 8; byte_order = le; } id; }; };",
    ],
)
def test_the_order_of_bytes_is_that_of_the_trace(tmp_path, before):
    """It holds for the types before the trace, too, and no other statement of an order, or quoted text, does."""
    own = "packet.header := struct { integer { size = 32; byte_order = le; } magic; };"
    text = f"/* CTF 1.8 */ typealias integer {{ size = 16; }} := short; {before}"
    text += f" trace {{ major = 1; minor = 8; {own} byte_order = be; }};"
    text += ' event { name = "e"; fields := struct { short n; }; };'
    (tmp_path / "metadata").write_text(text)
    (tmp_path / "s").write_bytes(b"\xc1\x1f\xfc\xc1" + b"\0" * ("event.header" in before) + b"\1\2")
    found, damage = all_events(tmp_path)
    assert ([event.fields["n"] for event in found], damage) == ([0x102], Damage())


def test_a_reference_of_several_names_is_no_field_beside_it(tmp_path):
    """The length would be that of another field of the same last name."""
    text = (
        HEAD
        + """ typealias integer { size = 8; } := u8;
stream { packet.context := struct { u8 n; }; };
event { name = "e"; fields := struct { u8 n; u8 s[stream.packet.context.n]; }; };"""
    )
    (tmp_path / "metadata").write_text(text)
    (tmp_path / "s").write_bytes(b"\1\2abc")
    found, damage = all_events(tmp_path)
    assert found == []
    assert 'the length "stream.packet.context.n" of a sequence is not stated' in damage.broken[0]


def test_events_without_bytes_end_the_stream(tmp_path):
    text = HEAD + " stream { id = 0; }; event { name = e; id = 0; stream_id = 0; };"
    (tmp_path / "metadata").write_text(text)
    (tmp_path / "s").write_bytes(b"abc")
    found, damage = all_events(tmp_path)
    assert found == []
    assert "no bytes" in damage.broken[0]


UUID = "".join(f"{n:02x}" for n in range(16))
CONTEXT = 24
"""Bytes of the header of the packets below: magic, UUID, stream."""


def damaged(tmp_path, change, tracer=""):
    """Two packets of two events each, of which `change` gets the headers as lists of numbers, and the times."""
    trace = Trace()
    trace.declare("a:one")
    trace.text = trace.text.replace("uint32_t magic;", "uint32_t magic; uint8_t uuid[16];")
    trace.text = trace.text.replace("byte_order", f'uuid = "{UUID}"; byte_order')
    trace.text = trace.text.replace("events_discarded;", "events_discarded; uint64_t packet_seq_num;")
    second = trace.text[trace.text.index("stream {") : trace.text.index("event {")].replace("id = 0", "id = 1")
    trace.text += second + tracer
    packets = []
    for number, times in enumerate(([10, 20], [30, 40])):
        packets.append(
            {"uuid": bytes(range(16)), "stream": 0, "begin": times[0], "end": times[1], "lost": 3, "seq": 7 + number}
            | {"times": times, "content": None, "size": None}
        )
    change(packets)
    data = b""
    for packet in packets:
        body = b"".join(struct.pack("<HIQII", 65535, 0, time, 7, 8) for time in packet["times"])
        size = CONTEXT + 52 + len(body)
        content = 8 * size if packet["content"] is None else packet["content"]
        total = 8 * size if packet["size"] is None else packet["size"]
        data += struct.pack("<I16sI", 0xC1FC1FC1, packet["uuid"], packet["stream"])
        data += struct.pack(
            "<QQQQQQI", packet["begin"], packet["end"], content, total, packet["lost"], packet["seq"], 0
        )
        data += body
    (tmp_path / "metadata").write_text(trace.text)
    (tmp_path / "s").write_bytes(data)
    found, damage = all_events(tmp_path)
    return [event.time - trace.offset for event in found], damage


def put(number, **values):
    return lambda packets: packets[number].update(values)


@pytest.mark.parametrize(
    ("change", "left", "said"),
    [
        (put(1, uuid=bytes(16)), 2, "another trace"),
        (put(1, stream=1), 2, "another stream"),
        (put(1, stream=2), 2, "not declared"),
        (put(0, begin=30), 0, "ends before it begins"),
        (put(1, begin=19), 2, "begins before the end"),
        (put(0, begin=11), 0, "precedes its packet"),
        (put(0, times=[20, 10]), 1, "the event before it"),
        (put(0, end=19), 1, "follows the end"),
        (put(1, lost=2), 4, "discarded events decreases"),
        (put(0, content=8), 0, "contradict"),
        (put(0, content=2**30), 0, "contradict"),
        (put(1, size=2**30), 2, "cut off"),
        (put(0, size=0, content=0), 0, "contradict"),
    ],
)
def test_damage_that_babeltrace2_reports(tmp_path, change, left, said):
    times, damage = damaged(tmp_path, change)
    assert times == [10, 20, 30, 40][:left] or len(times) == left
    (broken,) = damage.broken
    assert said in broken


def test_the_damaged_trace_is_sound_without_the_damage(tmp_path):
    times, damage = damaged(tmp_path, lambda packets: None)
    assert (times, damage) == ([10, 20, 30, 40], Damage(discarded=3))


def test_packets_that_are_missing_are_counted(tmp_path):
    _, damage = damaged(tmp_path, put(1, seq=11))
    assert (damage.packets, damage.broken) == (3, [])


@pytest.mark.parametrize(("minor", "broken"), [(10, 0), (11, 1)])
def test_events_after_the_end_of_a_packet_as_old_tracers_wrote_them(tmp_path, minor, broken):
    tracer = f'env {{ tracer_name = "lttng-ust"; tracer_major = 2; tracer_minor = {minor}; }};'
    _, damage = damaged(tmp_path, put(0, end=19), tracer)
    assert len(damage.broken) == broken


@pytest.mark.parametrize("kind", ["struct", "variant"])
def test_types_that_double_with_each_level_are_refused(kind):
    text = f"{HEAD}\n{kind} s0 {{ integer {{ size = 8; }} a; }};\n"
    tag = "" if kind == "struct" else "<t>"
    for level in range(1, 39):
        text += f"{kind} s{level} {{ {kind} s{level - 1} {tag} a; {kind} s{level - 1} {tag} b[2]; }};\n"
    with pytest.raises(CtfError, match="more than 10000 fields"):
        parse(text)


@pytest.mark.parametrize("tag", ["<>", "<other>", "<id,>", "<.id>", "<id.>", "<3>"])
def test_a_variant_names_a_field_beside_it(tag, tmp_path):
    """babeltrace2 refuses these; the header of LTTng was recognised by its choices alone."""
    folder = Trace("le", "small").write(tmp_path)
    metadata = folder / "metadata"
    text = metadata.read_text()
    assert text.count("variant <id>") == 2
    metadata.write_text(text.replace("variant <id>", f"variant {tag}"))
    with pytest.raises(CtfError):
        all_events(folder)


@pytest.mark.parametrize("clock", ["freq = 0;", "freq = -1;"])
def test_a_clock_has_a_frequency(clock):
    with pytest.raises(CtfError, match="frequency"):
        parse(f"{HEAD} clock {{ name = c; {clock} }};")


@pytest.mark.parametrize("map", ["0.c.value", "clock.c", "clock.c.name", "clock"])
def test_integers_map_the_value_of_a_clock(map):
    with pytest.raises(CtfError, match="maps an integer"):
        parse(f"{HEAD} clock {{ name = c; }}; typealias integer {{ size = 8; map = {map}; }} := t;")


@pytest.mark.parametrize("header", ["large", "small"])
@pytest.mark.parametrize("name", ["timestamp;", "uint32_t id;", "stream_id;"])
def test_numbers_of_headers_have_a_meaning(name, header, tmp_path):
    """A field whose name is damaged would be skipped, and ids or times be those of other events."""
    metadata = Trace("le", header).write(tmp_path) / "metadata"
    text = metadata.read_text()
    assert name in text
    metadata.write_text(text.replace(name, name.rpartition(" ")[0] + " other;"))
    with pytest.raises(CtfError, match='"other"'):
        all_events(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "clock {{ name {}",
        "struct a {{ integer {{ size = 8; }} {0}; integer {{ size = 8; }} {0}; }};",
        "typealias integer {{ size = 8; map = clock.{}.value; }} := t;",
        "stream {{ event.header := struct {{ integer {{ size = 8; align = 8; }} {}; }}; }};",
    ],
)
def test_damaged_names_are_shown_up_to_their_40th_character(text):
    with pytest.raises(CtfError) as refused:
        parse(f"{HEAD} {text.format('n' * 60)}")
    assert "n" * 40 in str(refused.value)
    assert "n" * 41 not in str(refused.value)


def test_the_longest_array_is_read():
    parse(f"{HEAD} struct a {{ integer {{ size = 8; }} x[16777216]; }};")
    with pytest.raises(CtfError, match="16777217 elements"):
        parse(f"{HEAD} struct a {{ integer {{ size = 8; }} x[16777217]; }};")


def test_a_variant_keeps_the_tag_that_it_was_declared_with():
    types = []
    for use in ("v", "v <other>"):
        text = f"{HEAD} struct s {{ variant v <other> {{ string a; }} one; variant {use} two; }};"
        (found,) = parse(f"{text} event {{ name = e; id = 0; fields := struct s; }};").events
        types.append(dict(found["fields"].fields)["two"])
    assert types[0] == types[1]
    assert types[0].tag == "other"


@pytest.mark.parametrize(
    ("stated", "found"),
    [
        ("size = 1;", Int(1, 1, False, "<")),
        ("size = 8;", Int(8, 8, False, "<")),
        ("size = 12;", Int(12, 1, False, "<")),
        ("size = 64; align = 65536; signed = true;", Int(64, 2**16, True, "<")),
        ("size = 16; signed = 1; byte_order = be;", Int(16, 8, True, ">")),
        ("size = 16; signed = TRUE; byte_order = network;", Int(16, 8, True, ">")),
        ("size = 8; signed = false; encoding = UTF8;", Int(8, 8, False, "<", text=True)),
        ("size = 8; signed = 0; encoding = ascii;", Int(8, 8, False, "<", text=True)),
        ("size = 8; encoding = none;", Int(8, 8, False, "<")),
        ("size = 8; map = clock.c.value;", Int(8, 8, False, "<", is_time=True)),
    ],
)
def test_attributes_of_integers(stated, found):
    """CTF 1.8, 4.1.5: by default unsigned, in the byte order of the trace, by bytes where the size is one of bytes."""
    text = f"struct s {{ integer {{ {stated} }} x; }}; event {{ name = e; id = 0; fields := struct s; }};"
    (event,) = parse(f"{HEAD} clock {{ name = c; }}; {text}").events
    assert dict(event["fields"].fields)["x"] == found


@pytest.mark.parametrize("align", [0, -8, 24, 2**17])
def test_an_alignment_is_a_power_of_two(align):
    with pytest.raises(CtfError, match=f"alignment of {align} bits"):
        parse(f"{HEAD} typealias integer {{ size = 8; align = {align}; }} := t;")


def test_labels_without_a_number_count_on_from_the_one_before():
    """CTF 1.8, 4.1.8: the first label is 0, every other one more than the last number of the label before."""
    text = 'enum e : integer { size = 8; } { a, b = 5, "c", d = 7 ... 9, e, };'
    (event,) = parse(f"{HEAD} struct s {{ {text[:-1]} x; }}; event {{ name = e; id = 0; fields := struct s; }};").events
    ranges = dict(event["fields"].fields)["x"].ranges
    assert ranges == ((0, 0, "a"), (5, 5, "b"), (6, 6, "c"), (7, 9, "d"), (10, 10, "e"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("clock { name = c; freq = 0; };", "has a clock without a frequency"),
        ("clock { name = c; };\nclock { name = c; };", "declares a second clock"),
        ("struct a { \n9 x; };", 'uses the type "9"'),
        ("struct a { string 9; };", "has '9' for a name"),
        ("struct a { string x };", "has '}' for ';'"),
        ("clock { name = c; nome = d; };", 'has the attribute "nome" of a clock'),
        ("clock { name c; };", "has 'c' for a sign of equality"),
        ("struct a { integer { size = 65; } x; };", "has an integer of 65 bits"),
        ("struct a { integer { size = 8; signed = maybe; } x; };", "has 'maybe' for true or false"),
        ("struct a { integer { size = 8; map = clock.c; } x; };", "maps an integer to no value of a clock"),
        ("typealias string := t; struct a { string t; };", 'has the type "t" for a name'),
        ("struct a { string x; string x; };", 'has the field "x" twice'),
        ("struct a { string x[-1]; };", "has an array of -1 elements"),
        ("#", "has '#'"),
        ("#" * 21, f"has {'#' * 20!r}"),
    ],
)
def test_faults_of_declarations_are_named_with_their_line(text, said):
    for lines in (0, 7):
        with pytest.raises(CtfError) as refused:
            parse(HEAD + "\n" * (lines + 1) + text)
        assert str(refused.value).startswith(f"line {lines + 2 + text.count(chr(10))} of the metadata {said}")


def test_a_stream_without_an_id_is_that_of_events_without_one():
    """CTF 1.8, 7.3: ids may be omitted where there is one stream, and one event in it."""
    found = parse(f"{HEAD} stream {{ }}; event {{ name = e; }};")
    assert ([*found.streams], found.events) == ([0], [{"name": "e"}])
    with pytest.raises(CtfError, match="declares a second stream"):
        parse(f"{HEAD} stream {{ }}; stream {{ id = 0; }};")
    with pytest.raises(CtfError, match="declares a second event"):
        parse(f"{HEAD} event {{ name = e; }}; event {{ name = f; id = 0; stream_id = 0; }};")


def test_callback_groups_of_a_node_are_numbered(tmp_path):
    """What is said last of a callback holds: here, that the subscription is in a group of its own."""
    trace = ros_trace(2)
    trace.add(
        "ros2_caret:add_callback_group", 15, executor_addr=50, callback_group_addr=61, group_type_name="reentrant"
    )
    trace.add("ros2_caret:callback_group_add_subscription", 16, callback_group_addr=61, subscription_handle=30)
    found = read_ros_trace(str(trace.write(tmp_path)), Findings())
    groups = {name: (kind, [key.kind for key in keys]) for name, (kind, keys) in found.groups.items()}
    assert groups == {
        "/sink/callback_group_0": ("mutually_exclusive", ["timer"]),
        "/sink/callback_group_1": ("reentrant", ["subscription"]),
    }
    assert found.executors == {"executor_0": ("multi_threaded_executor", [*groups])}
