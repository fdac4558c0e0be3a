"""The XML parser against hostile and broken files: a diagnostic with its line each time, never a traceback."""

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import parse_xml
from halpipe.core.files import xml as files

ENTITIES = '<!ENTITY a0 "aaaaaaaaaa">' + "".join(f'<!ENTITY a{n} "{f"&a{n - 1};" * 10}">' for n in range(1, 10))


def refusal(data):
    with pytest.raises(HalpipeError) as refused:
        parse_xml(data, "hostile.xml")
    return refused.value.diagnostics


@pytest.mark.parametrize(
    ("data", "line"),
    [
        pytest.param(b"<!DOCTYPE a>\n<a/>", 1, id="plain"),
        pytest.param(b'<?xml version="1.0"?>\n<!-- <!DOCTYPE no> -->\n<!DOCTYPE a\n>\n<a/>', 3, id="later"),
        pytest.param(b"\xef\xbb\xbf\n<!DOCTYPE a><a/>", 2, id="after BOM"),
        pytest.param(b'\n<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/passwd">]>\n<a>&x;</a>', 2, id="XXE"),
        pytest.param(b'\n\n<!DOCTYPE a SYSTEM "http://example.org/x.dtd">\n<a/>', 3, id="external DTD"),
        pytest.param(b'<!DOCTYPE a [<!ENTITY % p SYSTEM "p.dtd"> %p;]><a/>', 1, id="parameter entity"),
        pytest.param(f"<!DOCTYPE a [{ENTITIES}]>\n<a>&a9;</a>".encode(), 1, id="billion laughs"),
        pytest.param(f"<!DOCTYPE a [{ENTITIES}]>\n<a b='&a9;'/>".encode(), 1, id="billion laughs in an attribute"),
        pytest.param(
            b'<!DOCTYPE a [<!ENTITY x "' + b"a" * 10**5 + b'">]>\n<a>' + b"&x;" * 10**5 + b"</a>", 1, id="quadratic"
        ),
        pytest.param(b"<!DOCTYPE a [<!ENTITY x 'y'", 1, id="unfinished"),
        pytest.param('<?xml version="1.0" encoding="utf-16"?><!DOCTYPE a><a/>'.encode("utf-16"), 1, id="UTF-16"),
    ],
)
def test_a_doctype_is_refused(data, line):
    (found,) = refusal(data)
    assert (found.code, found.at.file, found.at.line) == (files.HAS_DOCTYPE.id, "hostile.xml", line)
    assert "DOCTYPE" in found.help


def test_a_doctype_is_refused_before_anything_it_names_is_opened(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("hunter2")
    data = f'<!DOCTYPE a [<!ENTITY x SYSTEM "{secret.as_uri()}">]>\n<a>&x;</a>'.encode()
    assert "hunter2" not in str(refusal(data))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_no_document_type_is_read_from_elsewhere(tmp_path, encoding):
    """Its faults would be reported, and its entities stand in the text."""
    (tmp_path / "x.dtd").write_text("<!ENTITY x 'hunter2'>\n<!BROKEN")
    text = f'<?xml version="1.0" encoding="{encoding}"?>\n<!DOCTYPE a SYSTEM "{tmp_path / "x.dtd"}">\n<a/>'
    assert [found.code for found in refusal(text.encode(encoding))] == [files.HAS_DOCTYPE.id]


@pytest.mark.parametrize(
    ("data", "line"),
    [
        pytest.param(b"", 1, id="empty"),
        pytest.param(b" \n \n", 3, id="white space"),
        pytest.param(b"\0", 1, id="NUL only"),
        pytest.param(b"<a>\n\0</a>", 2, id="NUL"),
        pytest.param(b"<a>\n\x1b</a>", 2, id="control character"),
        pytest.param(b"<a>\n&#0;</a>", 2, id="character reference to NUL"),
        pytest.param(b"<a>\n<b>", 2, id="cut off in content"),
        pytest.param(b"<a>\n<b c='1", 2, id="cut off in an attribute"),
        pytest.param(b"<a>\n<![CDATA[x", 2, id="cut off in CDATA"),
        pytest.param(b"\n".join([b"<a>"] * 300) + b"</a>" * 300, 257, id="300 deep"),
        pytest.param(b"<a>" * 10**6, 1, id="a million deep"),
        pytest.param(b"<a>\n\xe9</a>", 2, id="Latin-1 without declaration"),
        pytest.param(b'<?xml version="1.0" encoding="utf-16"?><a/>', 1, id="UTF-8 that says UTF-16"),
        pytest.param(b'<?xml version="1.0" encoding="klingon"?><a/>', 1, id="unknown encoding"),
        pytest.param('<?xml version="1.0" encoding="cp037"?><a/>'.encode("cp037"), 1, id="EBCDIC"),
        pytest.param(b"<a>\n&unknown;</a>", 2, id="unknown entity"),
        pytest.param(b"<a/>\n<b/>", 2, id="two roots"),
        pytest.param(b"<a>\n</b>", 2, id="crossed tags"),
        pytest.param(b"<a\nb='1' b='2'/>", 2, id="attribute twice"),
        pytest.param(b"\n<x:a/>", 2, id="unbound prefix"),
        pytest.param(b"<!doctype html>\n<html/>", 1, id="HTML"),
        pytest.param(b"PK\x03\x04" + bytes(100), 1, id="zip archive"),
        pytest.param(b"<a>" + b"x" * 11_000_000 + b"</a>", 1, id="endless text"),
    ],
)
def test_broken_xml_is_refused_at_its_line(data, line):
    found = refusal(data)
    assert {d.code for d in found} == {files.BROKEN_XML.id}
    assert line in {d.at.line for d in found}
    assert all(d.message and d.help and d.message.isprintable() for d in found)
    assert not any("XML_PARSE" in d.message for d in found), "advice for programmers is no help"


def test_all_syntax_errors_are_told_up_to_a_limit():
    two = refusal(b"<a>\n<b c=1/>\n<b d=2/>\n</a>")
    assert {2, 3} <= {d.at.line for d in two}
    many = refusal(b"<a>" + b"\n<b c=1/>" * 500 + b"</a>")
    assert len(many) == files.MAX_SYNTAX_ERRORS


@pytest.mark.parametrize(
    "data",
    [
        pytest.param("<a>é</a>".encode(), id="UTF-8"),
        pytest.param(b"\xef\xbb\xbf" + "<a>é</a>".encode(), id="BOM"),
        pytest.param('<?xml version="1.0" encoding="utf-16"?><a>é</a>'.encode("utf-16"), id="UTF-16"),
        pytest.param('<?xml version="1.0" encoding="ISO-8859-1"?><a>é</a>'.encode("latin-1"), id="Latin-1"),
        pytest.param(b"<!-- <!DOCTYPE a> --><?p <!DOCTYPE a>?>\n<a>\xc3\xa9</a>", id="DOCTYPE in a comment"),
        pytest.param(b"<a><![CDATA[\xc3\xa9]]></a>", id="CDATA"),
    ],
)
def test_every_declared_encoding_is_read(data):
    assert parse_xml(data, "m.xml").text == "é"


def test_includes_are_not_followed(tmp_path):
    secret = tmp_path / "secret.txt"
    secret.write_text("hunter2")
    include = f'<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="{secret}" parse="text"/>'
    root = parse_xml(f"<a>{include}</a>".encode(), "m.xml")
    assert "".join(root.itertext()) == ""


@pytest.mark.parametrize(
    "text", [b"<v>0.1<!-- -->5</v>", b"<v>0.1<?p x?>5</v>", b"<v><!-- -->0.1<![CDATA[5]]></v>", b"<v>0.15<!-- --></v>"]
)
def test_comments_and_instructions_do_not_cut_values(text):
    root = parse_xml(text, "a.xml")
    assert (root.text, len(root)) == ("0.15", 0)


@pytest.mark.parametrize("prolog", [b"", b'<?xml version="1.0"?>', b'<?xml version="1.0" encoding="UTF-8"?>'])
@pytest.mark.parametrize("part", [b"%s", b"<![CDATA[%s]]>", b"<!--%s-->"])
def test_long_texts_are_read_where_a_format_has_them(prolog, part):
    data = prolog + b"<a><b>1</b>" + part % (b"x" * 10_100_000) + b"</a>"
    assert parse_xml(data, "a.xml", long_texts=True)[0].text == "1"
    assert refusal(data)


def test_beside_long_texts_as_many_levels_are_read_as_without():
    text = b"<a/>" + b"x" * 10_100_000
    for depth in (255, 256):
        data = b"<a>" * depth + text + b"</a>" * depth
        if depth == 255:
            assert parse_xml(data, "a.xml", long_texts=True).tag == "a"
        else:
            with pytest.raises(HalpipeError, match=r"nests deeper than 256 elements|Excessive depth"):
                parse_xml(data, "a.xml", long_texts=True)


def test_long_texts_lift_no_other_limit():
    deep = b"\n<a>" * 300 + b"x" * 10_100_000 + b"</a>" * 300
    with pytest.raises(HalpipeError) as refused:
        parse_xml(deep, "a.xml", long_texts=True)
    assert 258 in {found.at.line for found in refused.value.diagnostics}
