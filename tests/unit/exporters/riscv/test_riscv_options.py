"""Options of RISC-V bundles in pipeline files: what is a place is sought beside the file."""

import pytest

from halpipe.exporters.riscv import FORMAT, PrepareOptions, RiscvOptions
from stated_options import stated

PLACES = {"sources": "src", "regulator": "r.yaml", "drivers": "d.yaml", "inputs": "in"}


@pytest.mark.parametrize("profile", ["p.yaml", "p.yml", "p.dts", "p.json"])
def test_places_are_those_beside_the_pipeline_file(profile):
    text = "".join(f"{key}: {value}\n" for key, value in (PLACES | {"profile": profile}).items())
    found, problems = stated(FORMAT, text, "/base")
    assert problems == []
    assert found == RiscvOptions(profile=f"/base/{profile}", **{key: f"/base/{name}" for key, name in PLACES.items()})


def test_names_of_profiles_are_no_places():
    found, problems = stated(FORMAT, "profile: pynq\ntoolchain: gcc\ncalibrate: true\n", "/base")
    assert problems == []
    assert found == RiscvOptions(profile="pynq", toolchain="gcc", calibrate=True)


def test_nothing_is_measured_or_made_up_unless_it_is_asked_for():
    assert (RiscvOptions().calibrate, PrepareOptions().dummy) == (False, False)
    stated_of_both = {"profile": "p", "toolchain": "gcc", "sources": "s", "drivers": "d"}
    assert PrepareOptions(**stated_of_both, dummy=True).target == RiscvOptions(**stated_of_both)
