"""Bundles of small systems, exported with a real toolchain."""

import pytest

pytest.importorskip("ziglang", reason="needs a compiler for RISC-V: pip install ziglang pyelftools unicorn")
pytest.importorskip("elftools", reason="needs pyelftools: pip install ziglang pyelftools unicorn")

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.riscv import RiscvOptions
from halpipe.flow.formats import export
from riscv_models import on_disk, single


def _bundle(folder, system, tables, toolchain="zig", profile="vcu118", **sources):
    model, schedule = on_disk(folder, system, tables, **sources)
    return export("riscv", model, schedule, RiscvOptions(toolchain=toolchain, profile=profile))


@pytest.fixture
def build(tmp_path):
    """Export a system with its schedule; further arguments are sources."""

    def make(system, tables, toolchain="zig", profile="vcu118", **sources):
        return _bundle(tmp_path, system, tables, toolchain, profile, **sources)

    return make


@pytest.fixture
def refusal(build):
    """Return the one diagnostic with which an export is refused."""

    def catch(system, tables, **options):
        with pytest.raises(HalpipeError) as caught:
            build(system, tables, **options)
        [found] = caught.value.diagnostics
        return found

    return catch


@pytest.fixture(scope="session")
def simple(tmp_path_factory):
    """The bundle of one task, as files by name."""
    return _bundle(tmp_path_factory.mktemp("simple"), *single())
