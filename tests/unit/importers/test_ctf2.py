"""Metadata of CTF 2: the same streams give the same events as with that of CTF 1.8."""

import json
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ctf_writer import Trace, ros_trace
from halpipe.core.diagnostics import Findings
from halpipe.importers.traces.ctf import CtfError, Damage, events, folders
from halpipe.importers.traces.ctf.decoding import Array, Float, Int, String, Struct, decoder
from halpipe.importers.traces.ctf.fragments import parse_fragments
from halpipe.importers.traces.ros2 import read_ros_trace
from profiles import examples


def fragments_of(trace):
    """What CTF2-SPEC-2.0 declares for the streams that `ctf_writer` writes."""
    order = "little-endian" if trace.mark == "<" else "big-endian"

    def number(size, align=8, *roles):
        kind = "fixed-length-unsigned-integer"
        stated = {"type": kind, "length": size, "alignment": align, "byte-order": order}
        return stated | ({"roles": list(roles)} if roles else {})

    def structure(align=1, **members):
        classes = [{"name": name, "field-class": stated} for name, stated in members.items()]
        return {"type": "structure", "minimum-alignment": align, "member-classes": classes}

    clock = "default-clock-timestamp"
    bits, last, low = (16, 65535, number(32, 8, clock)) if trace.header == "large" else (5, 31, number(27, 1, clock))
    long = structure(id=number(32, 8, "event-record-class-id"), timestamp=number(64, 8, clock))
    choice = {
        "type": "variant",
        "selector-field-location": {"origin": "event-record-header", "path": ["id"]},
        "options": [
            {"name": "compact", "field-class": structure(timestamp=low), "selector-field-ranges": [[0, last - 1]]},
            {"name": "extended", "field-class": long, "selector-field-ranges": [[last, last]]},
        ],
    }
    of_packet = structure(
        begin=number(64, 8, clock),
        end=number(64, 8, "packet-end-default-clock-timestamp"),
        content=number(64, 8, "packet-content-length"),
        total=number(64, 8, "packet-total-length"),
        lost=number(64, 8, "discarded-event-record-counter-snapshot"),
        cpu_id=number(32),
    )
    types = {"u64": "u64", "u32": number(32), "str": {"type": "null-terminated-string"}}
    return [
        {"type": "preamble", "version": 2},
        {"type": "field-class-alias", "name": "u64", "field-class": number(64)},
        {
            "type": "clock-class",
            "id": "monotonic",
            "frequency": 10**9,
            "offset-from-origin": {"seconds": 0, "cycles": trace.offset},
        },
        {
            "type": "trace-class",
            "environment": {"tracer_name": "lttng-ust", "tracer_major": 2, "tracer_minor": 15},
            "packet-header-field-class": structure(
                first=number(32, 8, "packet-magic-number"), second=number(32, 8, "data-stream-class-id")
            ),
        },
        {
            "type": "data-stream-class",
            "id": 0,
            "default-clock-class-id": "monotonic",
            "packet-context-field-class": of_packet,
            "event-record-header-field-class": structure(
                8, id=number(bits, 8 if bits == 16 else 1, "event-record-class-id"), v=choice
            ),
            "event-record-common-context-field-class": structure(vpid=number(32), vtid=number(32)),
        },
        *(
            {
                "type": "event-record-class",
                "id": id,
                "data-stream-class-id": 0,
                "name": name,
                "payload-field-class": structure(**{field: types[kind] for field, kind in fields.items()}),
            }
            for name, (id, fields) in trace.classes.items()
        ),
    ]


def written(stated):
    return "".join(f"\x1e{json.dumps(fragment)}\n" for fragment in stated)


def all_events(folder):
    damage = Damage()
    return list(events(folders(str(folder)), damage)), damage


@pytest.mark.parametrize("order", ["le", "be"])
@pytest.mark.parametrize("header", ["large", "small"])
@pytest.mark.parametrize("extended", [False, True])
def test_the_events_are_those_of_ctf_1_8(tmp_path, order, header, extended):
    trace = Trace(order, header)
    trace.declare("a:one", number="u64", text="str", small="u32")
    for index, time in enumerate([5, 6, 1_000, 130_000_000, 134_217_729, 260_000_000]):
        trace.add("a:one", time, cpu=index % 2, tid=index, number=2**63 + index, text="ä" * index, small=index)
    folder = trace.write(tmp_path, extended=extended, discarded=3)
    before, lost = all_events(folder)
    assert len(before) == 6
    (folder / "metadata").write_text(written(fragments_of(trace)))
    assert all_events(folder) == (before, lost)


@pytest.mark.parametrize("header", ["large", "small"])
def test_the_same_as_the_tracer_in_the_kernel_states_it(tmp_path, header):
    """lttng-modules 2.15 states headers as aliases, and locations from the structure that has them."""
    trace = Trace("le", header)
    trace.declare("a:one", number="u64", text="str")
    trace.add("a:one", 5, number=7, text="b")
    folder = trace.write(tmp_path)
    before = all_events(folder)
    stated = fragments_of(trace)
    for fragment in [fragment for fragment in stated if fragment["type"] in ("trace-class", "data-stream-class")]:
        for key in [key for key in fragment if key.endswith("-field-class")]:
            stated.insert(1, {"type": "field-class-alias", "name": key, "field-class": fragment[key]})
            fragment[key] = key
    text = written(stated)
    assert '"origin": "event-record-header", ' in text
    (folder / "metadata").write_text(text.replace('"origin": "event-record-header", ', ""))
    assert all_events(folder) == before


def test_a_ros_trace_in_ctf_2(tmp_path):
    trace = ros_trace(switches=True)
    folder = trace.write(tmp_path)
    before = read_ros_trace(str(folder), Findings())
    (folder / "metadata").write_text(written(fragments_of(trace)))
    assert read_ros_trace(str(folder), Findings()) == before


def field(stated):
    """The type of a field of an event."""
    payload = {"type": "structure", "member-classes": [{"name": "n", "field-class": {**NUMBER}}, stated]}
    event = {"type": "event-record-class", "name": "e", "payload-field-class": payload}
    (found,) = parse_fragments(written([{"type": "preamble", "version": 2}, event])).events
    return dict(found["fields"].fields)["f"]


NUMBER = {"type": "fixed-length-signed-integer", "length": 16, "byte-order": "big-endian"}
LENGTH = {"origin": "event-record-payload", "path": ["n"]}


def around(*stated):
    """A structure of `stated`, called a, b and so on."""
    members = [{"name": name, "field-class": inner} for name, inner in zip("abc", stated, strict=False)]
    return {"type": "structure", "member-classes": members}


@pytest.mark.parametrize(
    ("stated", "type"),
    [
        (NUMBER, Int(16, 1, True, ">")),
        ({"type": "fixed-length-boolean", "length": 8, "byte-order": "little-endian"}, Int(8, 1, False, "<")),
        (
            {"type": "fixed-length-floating-point-number", "length": 64, "alignment": 8, "byte-order": "little-endian"},
            Float(64, 8, "<"),
        ),
        ({"type": "null-terminated-string"}, String()),
        ({"type": "static-length-string", "length": 3}, Array(Int(8, 8, False, "<", text=True), 3)),
        (
            {"type": "dynamic-length-string", "length-field-location": LENGTH},
            Array(Int(8, 8, False, "<", text=True), "n"),
        ),
        ({"type": "static-length-blob", "length": 3}, Array(Int(8, 8, False, "<"), 3)),
        ({"type": "static-length-array", "length": 2, "element-field-class": NUMBER}, Array(Int(16, 1, True, ">"), 2)),
        (
            {"type": "dynamic-length-array", "length-field-location": LENGTH, "element-field-class": NUMBER},
            Array(Int(16, 1, True, ">"), "n"),
        ),
        (
            {"type": "static-length-array", "length": 2, "element-field-class": NUMBER, "minimum-alignment": 32},
            Array(Int(16, 1, True, ">"), 2, 32),
        ),
        ({"type": "structure", "minimum-alignment": 32}, Struct((), 32)),
        ({"type": "structure"}, Struct((), 1)),
        ({"type": "static-length-array", "length": 0, "element-field-class": NUMBER}, Array(Int(16, 1, True, ">"), 0)),
        ({"type": "static-length-blob", "length": 2**24}, Array(Int(8, 8, False, "<"), 2**24)),
        (NUMBER | {"bit-order": "last-to-first"}, Int(16, 1, True, ">")),
        ({"type": "null-terminated-string", "encoding": "utf-8"}, String()),
    ],
)
def test_classes_of_fields(stated, type):
    assert field({"name": "f", "field-class": stated}) == type


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ({"type": "variable-length-unsigned-integer"}, "variable-length-unsigned-integer"),
        ({"type": "optional", "field-class": NUMBER}, "optional"),
        ("unknown", "malformed"),
        ({"type": "static-length-array", "length": 2**40, "element-field-class": NUMBER}, "elements"),
        ({"type": "variant", "selector-field-location": {"path": ["zz"]}, "options": []}, "none of a structure"),
        (around({"type": "variant", "selector-field-location": LENGTH, "options": []}), "selector"),
        (NUMBER | {"alignment": 3}, "alignment"),
        (NUMBER | {"byte-order": "middle"}, "malformed"),
        (NUMBER | {"bit-order": "first-to-last"}, "bits first-to-last in bytes big-endian"),
        (NUMBER | {"byte-order": "little-endian", "bit-order": "last-to-first"}, "bits last-to-first"),
        ({"type": "null-terminated-string", "encoding": "utf-16le"}, "utf-16le"),
        ({"type": "static-length-string", "length": 3, "encoding": "utf-32be"}, "utf-32be"),
        ({"type": "static-length-array", "length": 2**24 + 1, "element-field-class": NUMBER}, "16777217 elements"),
        ({"type": "static-length-array", "length": -1, "element-field-class": NUMBER}, "-1 elements"),
    ],
)
def test_classes_that_are_not_read(stated, said):
    with pytest.raises(CtfError, match=said):
        field({"name": "f", "field-class": stated})


def test_aliases_that_double_with_each_level_are_refused():
    stated = [{"type": "field-class-alias", "name": "0", "field-class": {"type": "structure"}}]
    for level in range(1, 39):
        members = [{"name": name, "field-class": str(level - 1)} for name in "ab"]
        twice = {"type": "structure", "member-classes": members}
        stated.append({"type": "field-class-alias", "name": str(level), "field-class": twice})
    stated.append({"type": "trace-class", "packet-header-field-class": "38"})
    with pytest.raises(CtfError, match="more than 10000 fields"):
        parse_fragments(written(stated))


@pytest.mark.parametrize(
    "text",
    [
        "\x1e{",
        "\x1e[]",
        '\x1e{"type":"preamble","version":2,"version":2}',
        '\x1e{"type":"preamble","version":3}',
        '\x1e{"type":"clock-class","frequency":0}',
        '\x1e{"type":"field-class-alias","name":"a","field-class":"a"}\x1e{"type":"trace-class","packet-header-field-class":"a"}',
        '\x1e{"type":"trace-class","packet-header-field-class":'
        + '{"type":"static-length-array","length":1,"element-field-class":' * 5000
        + "1"
        + "}" * 5001,
    ],
)
def test_fragments_that_are_none(text):
    with pytest.raises(CtfError, match="fragment"):
        parse_fragments(text)


@pytest.fixture(scope="module")
def sound(tmp_path_factory):
    trace = ros_trace(2)
    return trace.write(tmp_path_factory.mktemp("sound")), fragments_of(trace)


VALUES = st.one_of(st.none(), st.integers(-3, 70), st.sampled_from(["", "u64", "structure", "path"]), st.just([]))


@examples(200)
@given(st.data())
def test_damaged_fragments_are_refused_or_read(sound, data):
    """Any value of the metadata may be another one: a `CtfError` or events come of it, and nothing else."""
    folder, stated = sound
    here = stated = json.loads(json.dumps(stated))
    while True:
        keys = list(here) if isinstance(here, dict) else range(len(here))
        key = data.draw(st.sampled_from(list(keys)))
        if not isinstance(here[key], dict | list) or not here[key] or data.draw(st.integers(0, 5)) == 0:
            here[key] = data.draw(VALUES)
            break
        here = here[key]
    (folder / "metadata").write_text(written(stated))
    with suppress(CtfError):
        all_events(folder)


@pytest.mark.parametrize(
    ("offset", "zero"), [({}, (0, 0)), ({"cycles": 7}, (0, 7)), ({"seconds": 3}, (3, 0)), (None, (0, 0))]
)
def test_a_clock_counts_from_its_origin_without_an_offset(offset, zero):
    stated = {"type": "clock-class", "frequency": 1000} | ({} if offset is None else {"offset-from-origin": offset})
    (clock,) = parse_fragments(written([{"type": "preamble", "version": 2}, stated])).clocks
    assert (clock["offset_s"], clock["offset"]) == zero


def test_a_stream_and_an_event_without_an_id_have_the_number_0(tmp_path):
    """CTF 2, "Data stream class fragment": the properties ``id`` and ``data-stream-class-id`` are 0 by default."""
    byte = {"type": "fixed-length-unsigned-integer", "length": 8, "byte-order": "little-endian", "alignment": 8}
    payload = {"type": "structure", "member-classes": [{"name": "n", "field-class": byte}]}
    stated = [
        {"type": "preamble", "version": 2},
        {"type": "trace-class"},
        {"type": "data-stream-class"},
        {"type": "event-record-class", "name": "e", "payload-field-class": payload},
    ]
    (tmp_path / "metadata").write_text(written(stated))
    (tmp_path / "s").write_bytes(b"\1\2")
    found, damage = all_events(tmp_path)
    assert [(event.name, event.fields) for event in found] == [("e", {"n": 1}), ("e", {"n": 2})]
    assert damage == Damage()


def test_fragments_are_counted_from_1_where_one_cannot_be_read():
    with pytest.raises(CtfError, match=r"fragment 2 of the metadata .* it is malformed"):
        parse_fragments('\x1e{"type":"preamble","version":2}\x1e \n\x1e{"type":"clock-class"}')
    with pytest.raises(CtfError, match=r"fragment 1 of the metadata .* version 3"):
        parse_fragments('\x1e{"type":"preamble","version":3}')


def test_an_option_without_a_name_is_chosen_by_its_ranges():
    """CTF 2, "Variant field class option": its name is optional."""
    options = [
        {"field-class": NUMBER, "selector-field-ranges": [[0, 3], [7, 7]]},
        {"field-class": {"type": "null-terminated-string"}, "selector-field-ranges": [[4, 6]]},
    ]
    variant = {"type": "variant", "selector-field-location": LENGTH, "options": options}
    payload = {"type": "structure", "member-classes": [{"name": "n", "field-class": NUMBER | {"alignment": 8}}]}
    payload["member-classes"].append({"name": "f", "field-class": variant})
    event = {"type": "event-record-class", "name": "e", "payload-field-class": payload}
    (found,) = parse_fragments(written([{"type": "preamble", "version": 2}, event])).events
    read = decoder(found["fields"])
    for selector, rest, value in ((3, b"\0\5", 5), (7, b"\0\5", 5), (4, b"a\0", "a"), (6, b"b\0", "b")):
        assert read(bytes([0, selector]) + rest, 0, {}) == ({"n": selector, "f": value}, 4)


@pytest.mark.parametrize(("levels", "is_read"), [(40, True), (41, False)])
def test_classes_nest_40_levels_deep(levels, is_read):
    stated = NUMBER
    for _ in range(levels - 2):  # and the structure of the event
        stated = {"type": "static-length-array", "length": 1, "element-field-class": stated}
    if is_read:
        assert field({"name": "f", "field-class": stated})
        return
    with pytest.raises(CtfError, match="nests deeper than 40"):
        field({"name": "f", "field-class": stated})


def text_at(*path, **origin):
    return {"type": "dynamic-length-string", "length-field-location": {"path": list(path), **origin}}


@pytest.mark.parametrize(
    "stated",
    [
        text_at("n"),  # as the tracer of LTTng in the kernel states it
        text_at("n", origin="event-record-payload"),  # and the one for programs
        around(text_at(None, "n")),
        around(around(text_at(None, None, "n"))),
        around(text_at("n", origin="event-record-payload")),
        around(NUMBER, around(text_at("f", "b", None, None, "n", origin="event-record-payload"))),
    ],
)
def test_a_location_leads_to_a_field_around(stated):
    *_, last = _inner(field({"name": "f", "field-class": stated}))
    assert last == Array(Int(8, 8, False, "<", text=True), "n")


def _inner(type):
    yield type
    while isinstance(type, Struct):
        type = type.fields[-1][1]
        yield type


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        (text_at("n", origin="event-record-header"), "none of a structure around"),
        (text_at(None, "n"), "malformed"),
        (around(text_at("n")), "none of a structure around"),
        (around(around({**NUMBER}), text_at("a", "a")), "none of a structure around"),
        (around(text_at("f", "n", origin="event-record-payload")), "none of a structure around"),
        (text_at("f"), "none of a structure around"),
        (text_at(), "malformed"),
        (
            {
                "type": "structure",
                "member-classes": [
                    {"name": "n", "field-class": NUMBER},
                    {"name": "a", "field-class": text_at("n", origin="event-record-payload")},
                ],
            },
            "hidden by another one",
        ),
    ],
)
def test_a_location_elsewhere_is_refused(stated, said):
    """Another field of that name would be taken for the length: the text, and all after it, would be misread."""
    with pytest.raises(CtfError, match=said):
        field({"name": "f", "field-class": stated})


BYTE = {"type": "fixed-length-unsigned-integer", "length": 8, "byte-order": "little-endian", "alignment": 8}


def events_with_header(tmp_path, header, data):
    stated = [
        {"type": "preamble", "version": 2},
        {"type": "trace-class"},
        {"type": "data-stream-class", "event-record-header-field-class": header},
        {"type": "event-record-class", "name": "zero"},
        {"type": "event-record-class", "name": "one", "id": 1},
    ]
    (tmp_path / "metadata").write_text(written(stated))
    (tmp_path / "s").write_bytes(data)
    return [event.name for event in all_events(tmp_path)[0]]


def test_a_field_has_the_meaning_of_its_role_and_none_of_its_name(tmp_path):
    members = [
        {"name": "id", "field-class": BYTE},
        {"name": "class", "field-class": BYTE | {"roles": ["event-record-class-id"]}},
    ]
    header = {"type": "structure", "member-classes": members}
    assert events_with_header(tmp_path, header, b"\0\1\1\0") == ["one", "zero"]


def test_roles_deeper_in_a_header_are_refused(tmp_path):
    """The last field with a role would count, and the one above it would be taken."""
    header = around(BYTE, around(BYTE | {"roles": ["event-record-class-id"]}))
    with pytest.raises(CtfError, match='"b" has members with roles'):
        events_with_header(tmp_path, header, b"\0\1")
