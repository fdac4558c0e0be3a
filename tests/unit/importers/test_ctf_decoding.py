"""Values of CTF by its rules of layout: CTF 1.8, section 4, and CTF 2, "Data stream decoding procedure".

Every value begins at the next multiple of its alignment, counted from the begin of the packet. That of a structure or
an array is the largest of what it holds, and of the least that is stated; `put` below writes by that rule alone, one
value after the other.
"""

import struct
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ctf_writer import Trace
from halpipe.importers.traces.ctf import CtfError, Damage, events, folders
from halpipe.importers.traces.ctf.decoding import Array, Enum, Float, Int, String, Struct, Variant, decoder
from profiles import examples


def aligned(type):
    """The alignment of a type in bytes."""
    if isinstance(type, Struct):
        return max([1, type.align // 8, *(aligned(field) for _, field in type.fields)])
    if isinstance(type, Array):
        return max(type.align // 8, aligned(type.element))
    if isinstance(type, Enum):
        return aligned(type.base)
    return max(1, getattr(type, "align", 8) // 8)


def put(data, type, value, beside=None):
    """Append a value."""
    if isinstance(type, Variant):  # it has no alignment; its choice has
        return put(data, dict(type.choices)[beside[type.tag]], value)
    data += bytes(-len(data) % aligned(type))
    if isinstance(type, Struct):
        labels = {
            name: next(label for low, high, label in field.ranges if low <= value[name] <= high)
            for name, field in type.fields
            if isinstance(field, Enum)
        }
        for name, field in type.fields:
            put(data, field, value[name], labels)
    elif isinstance(type, Array):
        for each in value:
            put(data, type.element, each)
    elif isinstance(type, String):
        data += value.encode() + b"\0"
    elif isinstance(type, Float):
        data += struct.pack(type.order + {32: "f", 64: "d"}[type.size], value)
    else:
        type = type.base if isinstance(type, Enum) else type
        data += value.to_bytes(type.size // 8, "little" if type.order == "<" else "big", signed=type.signed)
    return data


ORDERS = st.sampled_from("<>")
ALIGNS = st.sampled_from([1, 8, 16, 32, 64])
INTS = st.builds(Int, st.sampled_from([8, 16, 32, 64]), ALIGNS, st.booleans(), ORDERS)
NUMBERS = INTS | st.builds(Float, st.sampled_from([32, 64]), ALIGNS, ORDERS)
LENGTH = Int(8, 8, False, "<")
ENUM = Enum(LENGTH, ((0, 1, "a"), (2, 2, "_b")))


def filled(inner):
    """Types of elements: many of none would take no bytes, and are refused as longer than their packet."""
    return inner.filter(lambda type: not isinstance(type, Array) or type.length)


def structures(inner):
    """Structures, some with a sequence or a variant behind the field that decides it."""

    def built(fields, align, element, choices):
        named = [("head", LENGTH), *((f"f{n}", field) for n, field in enumerate(fields))]
        if element:
            named += [("_n", LENGTH), ("s", Array(element, "_n"))]
        if choices:
            named += [("t", ENUM), ("v", Variant("t", tuple(zip(("a", "_b"), choices, strict=True))))]
        return Struct(tuple(named), align)

    return st.builds(
        built, st.lists(inner, max_size=4), ALIGNS, st.none() | filled(inner), st.none() | st.tuples(inner, inner)
    )


TYPES = st.recursive(
    NUMBERS | st.just(String()),
    lambda inner: structures(inner) | st.builds(Array, filled(inner), st.integers(0, 3), ALIGNS),
    max_leaves=8,
)


def values(type):
    """Values of a type, as the reader returns them but for the names of fields."""
    if isinstance(type, Int):
        low = -(1 << type.size - 1) if type.signed else 0
        return st.integers(low, low + (1 << type.size) - 1)
    if isinstance(type, Float):
        return st.floats(width=type.size, allow_nan=False)
    if isinstance(type, String):
        return st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=3)
    if isinstance(type, Array):
        return st.lists(values(type.element), min_size=type.length, max_size=type.length)
    return st.deferred(lambda: fields_of(type))


@st.composite
def fields_of(draw, type):
    """Values of a structure, in which a length or a selector comes before what it decides."""
    found = {}
    for name, field in type.fields:
        if isinstance(field, Enum):
            found[name] = draw(st.integers(0, 2))
        elif isinstance(field, Variant):
            found[name] = draw(values(dict(field.choices)["_b" if found["t"] == 2 else "a"]))
        elif name == "_n":
            found[name] = draw(st.integers(0, 3))
        else:
            is_sequence = isinstance(field, Array) and field.length == "_n"
            found[name] = draw(values(Array(field.element, found["_n"]) if is_sequence else field))
    return found


def shown(value):
    """A value with the names of fields as they are reported."""
    if isinstance(value, dict):
        return {name.removeprefix("_"): shown(each) for name, each in value.items()}
    return [shown(each) for each in value] if isinstance(value, list) else value


@examples(200)
@given(TYPES.flatmap(lambda type: st.tuples(st.just(type), values(type))), st.integers(0, 9))
def test_values_are_where_the_rules_of_alignment_put_them(typed, at):
    type, value = typed
    data = put(bytearray(at), type, value)
    assert decoder(type)(bytes(data), at, {}) == (shown(value), len(data))


PARTS = st.lists(
    st.tuples(st.integers(1, 64), st.sampled_from([1, 1, 1, 2, 4, 8]), st.booleans()), min_size=1, max_size=8
)


@examples(100)
@given(PARTS, ORDERS, st.integers(0, 2**600 - 1), st.integers(0, 9))
def test_parts_of_bytes_follow_each_other(parts, order, drawn, at):
    """By bits alone: they begin at the lowest of a byte, and low bits come first; with the other order, the highest."""
    bits, value = [0] * 8 * at, {}
    fields = [(f"f{number}", Int(size, align, signed, order)) for number, (size, align, signed) in enumerate(parts)]
    for name, field in fields:
        bits += [0] * (-len(bits) % field.align)
        own = [drawn >> len(bits) + place & 1 for place in range(field.size)]  # the lowest first
        whole = sum(bit << place for place, bit in enumerate(own))
        value[name] = whole - (own[-1] << field.size if field.signed else 0)
        bits += own if order == "<" else own[::-1]
    if rest := -len(bits) % 8:
        fields.append(("rest", Int(rest, 1, False, order)))
        value["rest"] = 0
        bits += [0] * rest
    bytes_of_bits = [bits[first : first + 8] for first in range(0, len(bits), 8)]
    data = bytes(
        sum(bit << (place if order == "<" else 7 - place) for place, bit in enumerate(b)) for b in bytes_of_bits
    )
    assert decoder(Struct(tuple(fields)))(data, at, {}) == (value, len(data))
    if len(bits) > 8 * at + 8 or rest:
        with pytest.raises((CtfError, struct.error)):
            decoder(Struct(tuple(fields)))(data[:-1], at, {})


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("length", "size"), [(3, 5), ("n", 1), ("n", 4), (0, 3)])
def test_elements_that_are_parts_of_bytes_follow_each_other(order, length, size):
    """As the tracer in the kernel writes fields of flags, behind a field that aligns them."""
    number = 8 if length == "n" else length
    data = bytes([number, 0b10110001, 0x5A, 7, 9])
    bits = [data[1 + at // 8] >> (at % 8 if order == "<" else 7 - at % 8) & 1 for at in range(number * size)]
    parts = [bits[first : first + size] for first in range(0, len(bits), size)]
    values = [sum(bit << place for place, bit in enumerate(part if order == "<" else part[::-1])) for part in parts]
    read = decoder(Struct((("n", LENGTH), ("s", Array(Int(size, 1, False, order), length)))))
    if len(bits) % 8:
        with pytest.raises(CtfError, match=f"fields of {len(bits)} bits, which end within a byte"):
            read(data, 0, {})
        return
    assert read(data, 0, {}) == ({"n": number, "s": values}, 1 + len(bits) // 8)
    if length == "n":
        with pytest.raises(CtfError, match="longer than its packet"):
            read(bytes([255, *data[1:]]), 0, {})


def test_a_field_that_is_aligned_follows_parts_of_a_byte_and_another_one_does_not():
    part, byte = Int(3, 1, False, "<"), Int(8, 8, False, "<")
    for following, data in (
        (byte, b"\7\5"),
        (String(), b"\7\0"),
        (Array(byte, 1), b"\7\5"),
        (Float(32, 8, ">"), bytes(5)),
    ):
        assert decoder(Struct((("a", part), ("b", following))))(data, 0, {})[1] == len(data)
    for following in (Struct((("c", Int(5, 1, False, "<")),)), Int(5, 1, False, ">"), Float(32, 1, "<")):
        with pytest.raises(CtfError, match="cannot be read"):
            decoder(Struct((("a", part), ("b", following))))
    with pytest.raises(CtfError, match="fields of 3 bits, which end within a byte"):
        decoder(Struct((("a", part),)))


@pytest.mark.parametrize("name", ["_n", "n"])
def test_texts_end_with_the_first_null_byte(name):
    text = Array(Int(8, 8, False, "<", text=True), name)
    read = decoder(Struct(((name, LENGTH), ("f", text), ("after", LENGTH))))
    assert read(b"\5ab\0cd\7", 0, {}) == ({"n": 5, "f": "ab", "after": 7}, 7)
    assert read(b"\2ab\7", 0, {}) == ({"n": 2, "f": "ab", "after": 7}, 4)
    assert decoder(Array(Int(16, 16, False, "<", text=True), 2))(b"a\0b\0", 0, {}) == ([97, 98], 4)


@pytest.mark.parametrize(
    ("element", "most", "refused"),
    [(Int(16, 16, True, "<"), 6, 7), (Int(16, 32, True, "<"), 3, 13), (String(), 12, 13)],
)
def test_a_sequence_is_within_its_packet(element, most, refused):
    """Its length may be any number where the file is damaged: no memory is taken for more than what follows."""
    read = decoder(Struct((("n", Int(32, 8, True, "<")), ("s", Array(element, "n")))))
    for length in (-1, refused, 2**31 - 1):
        with pytest.raises(CtfError, match="sequence"):
            read(length.to_bytes(4, "little", signed=True) + bytes(12), 0, {})
    whole, _ = read(most.to_bytes(4, "little") + bytes(12), 0, {})
    assert len(whole["s"]) == most


@pytest.mark.parametrize(
    ("type", "said"),
    [
        (Int(12, 8, False, "<"), "12 bits"),
        (Int(8, 4, False, "<"), "8 bits"),
        (Float(16, 8, "<"), "16 bits"),
        (Variant("t", (("a", String()),)), "outside of a structure"),
        (Struct((("t", LENGTH), ("v", Variant("t", (("a", String()),))))), '"t", which is no enumeration'),
        (Struct((("v", Variant("t", (("a", String()),))),)), '"t", which is no enumeration'),
    ],
)
def test_types_that_no_bytes_can_be_read_by_are_refused(type, said):
    with pytest.raises(CtfError, match=said):
        decoder(type)


def test_a_selector_without_a_choice_is_refused():
    read = decoder(Struct((("t", ENUM), ("v", Variant("t", (("a", LENGTH),))))))
    assert read(b"\0\1", 0, {})[0] == read(b"\1\1", 0, {})[0] | {"t": 0} == {"t": 0, "v": 1}
    for selector in (2, 3):  # one label has no choice, the other number no label
        with pytest.raises(CtfError, match=f'"t" = {selector}'):
            read(bytes([selector, 1]), 0, {})


# ------------------------------------------------------------------------------------------------ streams


def all_events(folder):
    damage = Damage()
    found = list(events(folders(str(folder)), damage))
    assert damage == Damage()
    return found


@pytest.mark.parametrize(
    ("stated", "origin", "offset", "frequency"),
    [
        ("offset = 7", 0, 7, 10**9),
        ("freq = 1000000000; offset_s = 3; offset = 7", 3, 7, 10**9),
        ("freq = 1000; offset = 7", 0, 7, 1000),
        ("freq = 3; offset_s = 1", 1, 0, 3),
        ("freq = 2500000000; offset = 5", 0, 5, 2_500_000_000),
    ],
)
def test_clocks_count_from_their_offset_in_cycles_of_their_frequency(tmp_path, stated, origin, offset, frequency):
    """CTF 1.8, 8: ``offset_s + (offset + count) / freq`` seconds; the frequency is 1 GHz where none is stated."""
    trace = Trace()
    trace.declare("a:one")
    trace.text = trace.text.replace("freq = 1000000000; offset = 1000000", stated)
    counts = [2, 5, 1001]
    for count in counts:
        trace.add("a:one", count)
    found = [event.time for event in all_events(trace.write(tmp_path))]
    exact = [10**9 * (origin + Fraction(offset + count, frequency)) for count in counts]
    assert all(0 <= due - at < 2 for at, due in zip(found, exact, strict=True))  # both parts are rounded down


HEADERS = {
    "struct large align(32)": "<HI",
    "struct small align(32)": "<I",
    "struct { uint8_t id; uint64_t timestamp; } align(32)": "<BQ",
}


@pytest.mark.parametrize("header", HEADERS)
def test_headers_of_events_are_aligned(tmp_path, header):
    """Texts of 1 to 8 bytes come before the header of the next event, which is aligned by 32 bits."""
    trace = Trace()
    trace.declare("a:one", text="str")
    if "{" in header:
        trace.text = trace.text.replace("struct large;", f"{header};")
    else:
        trace.text = trace.text.replace("struct large;", f"{header.removesuffix(' align(32)')};")
        trace.text = trace.text.replace("} align(8);", "} align(32);")
    body, times = bytearray(52), range(5, 13)  # behind the header and the context of the packet
    for time in times:
        body += bytes(-len(body) % 4)
        body += struct.pack(HEADERS[header], *([time << 5] if "small" in header else [0, time]))
        body += struct.pack("<II", 7, 8) + b"x" * (time - 5) + b"\0"
    body[:52] = struct.pack("<IIQQQQQI", 0xC1FC1FC1, 0, 0, 0, 8 * len(body), 8 * len(body), 0, 3)
    (tmp_path / "metadata").write_text(trace.text)
    (tmp_path / "s").write_bytes(body)
    found = all_events(tmp_path)
    assert [event.time - trace.offset for event in found] == [*times]
    assert [event.fields["text"] for event in found] == ["x" * (time - 5) for time in times]
    assert {event.cpu for event in found} == {3}
