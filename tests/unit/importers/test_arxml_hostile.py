"""Damaged input gives a model or findings, never anything else."""

from arxml_case import FIXTURES
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from lxml import etree

from halpipe.core.diagnostics import HalpipeError
from halpipe.importers.arxml import FORMAT
from halpipe.importers.arxml.files.words import NS
from halpipe.importers.arxml.options import ArxmlImportOptions
from profiles import examples

SOURCES = [
    (FIXTURES / "findings" / f"{name}.arxml").read_bytes()
    for name in (
        "HAL0524-alarm-period",
        "HAL0528-uneven-table",
        "HAL0532-senders-differ",
        "HAL0544-cycle",
        "HAL0545-several-groups",
        "HAL0548-angle",
        "HAL0550-copy",
        "HAL0555-same-function",
    )
]
TEXTS = ["", "0", "-1", "1e40", "INF", "x", "/", "//", "/T", "T/x", "0x", "/Types/Pump", "1/0", "\u00e4 *"]


def findings_of(path, granularity):
    try:
        return FORMAT.read([str(path)], ArxmlImportOptions(granularity=granularity)).diagnostics
    except HalpipeError as failure:
        return failure.diagnostics


def attempt(path):
    """Import at every granularity; what was assumed or wrong is always said."""
    for granularity in ("runnable", "event", "ostask"):
        assert findings_of(path, granularity)


@examples(150, HealthCheck.function_scoped_fixture)
@given(source=st.sampled_from(SOURCES), data=st.data())
def test_damaged_elements(source, data, tmp_path):
    root = etree.fromstring(source)
    for _ in range(data.draw(st.integers(1, 6))):
        elements = [element for element in root.iter(etree.Element) if element.getparent() is not None]
        if not elements:
            break
        element = data.draw(st.sampled_from(elements))
        other = data.draw(st.sampled_from(elements))
        match data.draw(st.integers(0, 4)):
            case 0:
                element.getparent().remove(element)
            case 1:
                element.text = data.draw(st.sampled_from(TEXTS))
            case 2:
                element.tag = other.tag
            case 3:
                element.getparent().append(etree.fromstring(etree.tostring(element)))
            case _:
                element.text = other.text
    path = tmp_path / "damaged.arxml"
    path.write_bytes(etree.tostring(root))
    attempt(path)


@examples(60, HealthCheck.function_scoped_fixture)
@given(source=st.sampled_from(SOURCES), data=st.data())
def test_damaged_bytes(source, data, tmp_path):
    start = data.draw(st.integers(0, len(source)))
    end = data.draw(st.integers(start, min(len(source), start + 40)))
    path = tmp_path / "damaged.arxml"
    path.write_bytes(source[:start] + data.draw(st.binary(max_size=4)) + source[end:])
    attempt(path)


def test_elements_outside_the_namespace_are_passed_over(tmp_path):
    path = tmp_path / "foreign.arxml"
    text = (FIXTURES / "findings" / "HAL0540-default-unit.arxml").read_text()
    path.write_text(
        text.replace("<EVENTS>", '<x:EVENTS xmlns:x="urn:x"><x:SHORT-NAME>n</x:SHORT-NAME></x:EVENTS><EVENTS>')
    )
    imported = FORMAT.read([str(path)], ArxmlImportOptions())
    assert len(imported.model.tasks) == 1
    assert NS not in str(imported.coverage.rows())
