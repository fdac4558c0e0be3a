"""Hashes of documents that hold a model: what tools change in passing does not count, and what they mean does."""

import pytest
from lxml import etree

from halpipe.core.embedding import PIECE, content_hash, joined, package_hash, pieces, properties_hash


def same(one, other, of=package_hash):
    first, second = (of(etree.fromstring(text)) for text in (one, other))
    return first == second


@pytest.mark.parametrize(
    ("other", "is_same"),
    [
        ('<p:P xmlns:p="u"><!-- c --><p:A n="1"> x  y </p:A></p:P>', True),
        ('<P xmlns="u"><A n="1">x y</A><ADMIN-DATA/></P>', True),
        ('<P xmlns="u"><A n="1">x y</A><ECUC-VALUE/></P>', True),
        ('<P xmlns="u"><A n="1" UUID="3" T="4" S="5">x y</A></P>', True),
        ('<P xmlns="u"><A n="2">x y</A></P>', False),
        ('<P xmlns="u"><A n="1">x z</A></P>', False),
        ('<P xmlns="u"><A n="1" V="3">x y</A></P>', False),
        ('<P xmlns="u"><A n="1">x y</A><B/></P>', False),
        ('<P xmlns="u"><B n="1">x y</B></P>', False),
        ('<P xmlns="u"/>', False),
    ],
)
def test_a_package_is_what_it_means(other, is_same):
    assert same('<P xmlns="u"><A n="1">x y</A></P>', other) == is_same


def test_the_order_of_elements_of_a_package_means_nothing_and_that_of_others_does():
    a, b = "<A/>", "<B/>"
    for tag, is_same in (("ELEMENTS", True), ("AR-PACKAGES", True), ("PORTS", False)):
        assert same(f"<P><{tag}>{a}{b}</{tag}></P>", f"<P><{tag}>{b}{a}</{tag}></P>") == is_same


def test_properties_of_halpipe_are_no_part_of_a_model():
    own, other = '<customProperties key="halpipe:model"/>', '<customProperties key="tool:x"/>'
    assert same("<m><t/></m>", f"<m><t/>{own}</m>", properties_hash)
    assert not same("<m><t/></m>", f"<m><t/>{other}</m>", properties_hash)


def test_an_element_that_is_frozen_stands_for_the_hash_that_it_has():
    whole = etree.fromstring("<a><b n='1'/></a>")
    digest = content_hash(whole[0], leaves_out=lambda element: False)
    frozen = etree.fromstring(f"<a><frozen hash='{digest}'/></a>")
    assert content_hash(frozen[0], leaves_out=lambda element: False) == digest


@pytest.mark.parametrize("length", [10, PIECE, PIECE + 1, 3 * PIECE])
def test_a_document_is_joined_from_its_pieces(length):
    text = "".join(f"<line n='{n}'/>\n" for n in range(length // 14 + 1))[: length - 1] + "\n"
    found = list(pieces(b"<?xml version='1.0'?>\n" + text.encode()))
    assert "".join(found) == text
    assert all(len(piece) <= PIECE for piece in found)
    assert all(piece.endswith("\n") for piece in found)
    assert joined(found, 3) == b"\n\n" + text.encode()
    assert joined(found, 0) == joined(found, 1) == text.encode()


def test_a_declaration_needs_no_line_of_its_own():
    assert list(pieces(b"<?xml version='1.0'?><a/>")) == ["<a/>"]


def test_a_line_longer_than_a_piece_is_cut():
    found = list(pieces(b"x" * (PIECE + 5)))
    assert [len(piece) for piece in found] == [PIECE, 5]
