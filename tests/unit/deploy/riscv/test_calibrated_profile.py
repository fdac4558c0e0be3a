"""Profiles that calibration makes of the one in a bundle, which may be damaged."""

from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError, Location
from halpipe.core.durations import Duration
from halpipe.deploy.riscv.codes import FOREIGN_MACHINE
from halpipe.deploy.riscv.judge.calibration import Constants, _profile

FOUND = Constants({"main": 10**6}, Duration.parse("2us"), Duration.parse("6us"), {})


def made(**files):
    return _profile(SimpleNamespace(bundle=SimpleNamespace(at=Location, files=files)), FOUND, "dump.bin").decode()


def test_other_values_of_the_profile_stay():
    text = made(**{"profile.yaml": b"clock: 5\ndma: {kind: pdma, bus: 9MB/s}\n"})
    assert "clock: '5'" in text
    assert "kind: pdma" in text
    assert "9MB/s" not in text


@pytest.mark.parametrize("content", [b"", b"- clock", b"clock: 5", b"dma: fast", b"dma: [pdma]"])
def test_a_damaged_profile_is_refused(content):
    with pytest.raises(HalpipeError) as refused:
        made(**{"profile.yaml": content})
    assert {found.code for found in refused.value.diagnostics} == {FOREIGN_MACHINE.id}


@pytest.mark.parametrize("content", [b"[", b"\xff"])
def test_what_is_no_yaml_is_refused(content):
    with pytest.raises(HalpipeError, match="HAL0020"):
        made(**{"profile.yaml": content})


def test_a_bundle_without_a_profile_is_refused():
    with pytest.raises(HalpipeError):
        made()
