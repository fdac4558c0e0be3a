"""Targets that cannot hold jobs refuse gaps also where only the table of a switch has them."""

from dataclasses import replace

import pytest

import split_switches
from halpipe.core.diagnostics import Findings, HalpipeError
from halpipe.exporters.amalthea import FORMAT as AMALTHEA
from halpipe.exporters.amalthea import AmaltheaOptions
from halpipe.exporters.common.codes import NEEDS_HOLD
from halpipe.exporters.riscv.cores import check_splits
from halpipe.exporters.ros import FORMAT as ROS
from halpipe.exporters.ros import RosOptions
from halpipe.importers.amalthea import FORMAT as IMPORTER
from halpipe.importers.amalthea import AmaltheaImportOptions
from halpipe.models import Split
from halpipe.pipeline.verify import verify
from support import job, version


def switch_alone(split=split_switches.POINTS):
    """The jobs of both modes are in one piece; that of the table of "two" to "one" has gaps."""
    system = split_switches.system(version("v", 4), version("v", 1), split)
    plan = split_switches.plan(system)
    starts = {"one": 6, "two": 11}
    modes = tuple(
        replace(
            mode,
            jobs=(
                job(system, "kept", 0, starts[mode.name], "u1"),
                *split_switches.brief(system, 0, 5, 10, 15),
            ),
        )
        for mode in plan.modes
    )
    back = (split_switches.kept(system, 1, 3, 7), *split_switches.brief(system, 0, "5.5ms"))
    tables = (split_switches.switch("one", "two", 0), split_switches.switch("two", "one", 10, *back))
    plan = replace(plan, modes=modes, transitions=tables)
    assert [d for d in verify(system, plan) if d.is_error] == []
    return system, plan


def test_executors_refuse_a_table_with_gaps():
    system, plan = switch_alone()
    with pytest.raises(HalpipeError) as refused:
        ROS.write(system, plan, RosOptions(cpus={"u1": 0}))
    assert [(d.code, d.path) for d in refused.value.diagnostics] == [(NEEDS_HOLD.id, 'task "kept"')]
    assert ROS.write(system, plan, RosOptions(cpus={"u1": 0}, mode="two"))  # which has none


def test_boards_refuse_a_table_with_gaps_anywhere():
    findings = Findings()
    check_splits(*switch_alone(Split(anywhere=True, max_gaps=2)), findings)
    assert [d.code for d in findings.items] == [NEEDS_HOLD.id]


def test_amalthea_states_what_may_be_split_and_reads_it_again(tmp_path):
    """It has no place for tables of switches or parts; what the model says of them is not lost."""
    system = split_switches.system(version("v", 4), version("v", 1))
    path = tmp_path / "m.amxmi"
    path.write_bytes(AMALTHEA.write(system, split_switches.plan(system), AmaltheaOptions())[""])
    back = IMPORTER.read([str(path)], AmaltheaImportOptions()).model
    assert [t.versions[0].split for t in back.tasks] == [t.versions[0].split for t in system.tasks]
    assert [(t.source, t.target, t.max_length) for t in back.transitions] == [
        (t.source, t.target, t.max_length) for t in system.transitions
    ]
