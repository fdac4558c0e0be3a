"""The public functions of the package: the tool from Python."""

import subprocess
import sys
from dataclasses import replace

import pytest

import halpipe
from halpipe.diagnostics import Exit, HalpipeError
from halpipe.exporters.native import format_model
from support import model, task, version


def small():
    return model(task("a", 10, version("v", 3)), task("b", 10, version("v", 4)))


def test_from_file_to_report(tmp_path):
    path = tmp_path / "model.xml"
    path.write_bytes(format_model(small()))
    system = halpipe.load(str(path))
    assert halpipe.validate(system) == []
    plan = halpipe.schedule(system, seed=2)
    assert halpipe.verify(system, plan) == []
    assert b"<svg" in halpipe.export("report", system, plan)[""]


def test_what_is_invalid_is_told_and_not_exported():
    system = small()
    plan = halpipe.schedule(system)
    late = replace(plan.modes[0], jobs=plan.modes[0].jobs[:1])
    wrong = replace(plan, modes=(late,))
    assert halpipe.verify(system, wrong)
    with pytest.raises(HalpipeError):
        halpipe.export("report", system, wrong)


def test_a_search_that_fails_raises_with_what_is_still_wrong():
    hard = model(task("short", 4, version("v", 1)), task("long", 12, version("v", 4)))
    with pytest.raises(HalpipeError) as failure:
        halpipe.schedule(hard, budget=20)
    assert failure.value.exit in (Exit.NOT_FOUND, Exit.INFEASIBLE)
    assert failure.value.diagnostics
    assert halpipe.explain(hard).diagnostics


def test_importing_the_package_is_cheap():
    program = "import halpipe, sys; print(sorted(m for m in ('lxml', 'numpy', 'typer') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
