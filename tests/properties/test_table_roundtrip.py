"""What goes out as a workbook comes in again as the same model, and its sheets have the schedule."""

import io
import random
import sys
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refined_systems import refined
from verify_systems import switching_system, valid_system

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.base import ExportOptions
from halpipe.exporters.xlsx import FORMAT as OUT
from halpipe.importers.common.base import ImportOptions
from halpipe.importers.table import FORMAT as IN
from halpipe.models import Interrupt, Split
from profiles import examples
from support import bare, ms

openpyxl = pytest.importorskip("openpyxl", reason="the extra [table]")


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    return tmp_path_factory.mktemp("books") / "system.xlsx"


@examples(60)
@given(st.integers(0, 2**32))
def test_a_workbook_comes_back(path, seed):
    draw = random.Random(seed)
    model, schedule = (valid_system if seed % 2 else switching_system)(draw)
    model = refined(draw, model, schedule)
    written = OUT.write(model, schedule, ExportOptions())[""]
    path.write_bytes(written)
    imported = IN.read([str(path)], ImportOptions(name=model.name))
    again = imported.model
    for kind in ("units", "resources", "tasks", "chains", "modes", "transitions", "health"):
        assert bare(getattr(again, kind)) == bare(getattr(model, kind)), kind
    assert not imported.diagnostics
    assert OUT.write(model, schedule, ExportOptions())[""] == written


def test_the_schedule_has_a_row_for_each_job():
    model, schedule = valid_system(random.Random(5))
    book = openpyxl.load_workbook(io.BytesIO(OUT.write(model, schedule, ExportOptions())[""]), read_only=True)
    head, *rows = book["Schedule jobs"].iter_rows(values_only=True)
    jobs = [(job.task, job.index, float(job.start.in_unit("ms"))) for job in schedule.modes[0].jobs]
    columns = [head.index(name) for name in ("task", "job", "start_ms")]
    assert sorted(tuple(row[place] for place in columns) for row in rows) == sorted(jobs)


def test_what_has_no_column_is_named():
    model, _ = valid_system(random.Random(5))
    first = model.tasks[0]
    version = replace(first.versions[0], split=Split(points=(ms(1),)))
    changed = replace(model, tasks=(replace(first, versions=(version,)), *model.tasks[1:]))
    assert [one.code for one in OUT.remarks(changed, None, ExportOptions(), {})] == ["HAL1488"]
    assert not OUT.remarks(model, None, ExportOptions(), {})


def test_interrupts_come_back(path):
    model, schedule = valid_system(random.Random(5))
    isr = Interrupt(name="i", distance=ms(10), wcet=ms(1))
    changed = replace(model, units=(replace(model.units[0], interrupts=(isr,)), *model.units[1:]))
    path.write_bytes(OUT.write(changed, schedule, ExportOptions())[""])
    assert bare(IN.read([str(path)], ImportOptions()).model.units) == bare(changed.units)


def test_without_openpyxl_nothing_is_written(monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    model, schedule = valid_system(random.Random(5))
    with pytest.raises(HalpipeError) as failure:
        OUT.write(model, schedule, ExportOptions())
    assert [one.code for one in failure.value.diagnostics] == ["HAL1487"]
