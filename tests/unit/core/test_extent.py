"""Every format states what it carries; the manual's table is made of these statements."""

import pytest

from halpipe.core.extent import ASPECTS, Extent
from halpipe.flow.formats import EXPORTERS, IMPORTERS, exporter, formats, importer

FORMATS = [importer(name) for name in formats(IMPORTERS)] + [exporter(name) for name in formats(EXPORTERS)]


@pytest.mark.parametrize("format", FORMATS, ids=lambda format: type(format).__name__)
def test_every_format_states_what_it_carries_and_what_it_loses(format):
    assert isinstance(format.extent, Extent)
    assert format.extent.carried
    assert all(text for text in format.extent.carried.values())
    assert format.extent.lost or set(format.extent.carried) == set(ASPECTS)


def test_an_aspect_that_no_model_has_is_refused():
    with pytest.raises(AssertionError):
        Extent({"colour": "red"})
