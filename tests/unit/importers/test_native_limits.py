"""Models and schedules far beyond any system are refused with what there is too much of, and where."""

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.core.files import TOO_MUCH
from halpipe.importers.native import model as models
from halpipe.importers.native import schedule as schedules

MODEL = b"""<task-model xmlns="urn:halpipe:task-model:1" name="m"><platform><unit name="u">
<interrupt name="i" distance="1ms" wcet="1us"/><interrupt name="j" distance="1ms" wcet="1us"/></unit>
<resource name="r"/></platform><tasks><task name="a" period="10ms"><version name="v" wcet="1ms"><units names="u"/>
<access resource="r" start="0ms" end="1us"/><access resource="r" start="1us" end="2us"/></version></task>
<task name="b" period="10ms"/></tasks>
<modes><mode name="a"><run task="a" versions="v"/></mode>
<mode name="b"><run task="a" versions="v"/></mode></modes></task-model>
"""
SCHEDULE = b"""<schedule xmlns="urn:halpipe:schedule:1" model="m"><mode name="a" hyperperiod="10ms" status="valid">
<job task="a" index="0" start="0ms" end="3ms" version="v" units="u"><part start="0ms" end="1ms" from="0ms" to="1ms"/>
<part start="2ms" end="3ms" from="1ms" to="2ms"/></job></mode></schedule>
"""


def refusal(read):
    with pytest.raises(HalpipeError) as refused:
        read()
    (found,) = refused.value.diagnostics
    assert found.code == TOO_MUCH.id
    return found


@pytest.mark.parametrize(
    ("holder", "held", "line"),
    [
        ("t:tasks", "task", 3),
        ("t:modes", "mode", 6),
        ("t:platform/t:unit", "interrupt", 1),
        ("t:tasks/t:task/t:version", "access", 3),
    ],
)
def test_a_model_has_no_more_than_there_is_time_for(monkeypatch, holder, held, line):
    assert (holder, held) in {row[:2] for row in models.MOST}
    monkeypatch.setattr(models, "MOST", ((holder, held, 2),))
    models.parse_model(MODEL, "m.xml")
    monkeypatch.setattr(models, "MOST", ((holder, held, 1),))
    found = refusal(lambda: models.parse_model(MODEL, "m.xml"))
    assert f"has 2 <{held}> in one <{holder.rpartition(':')[2]}>; at most 1" in found.message
    assert found.at.line == line


def test_a_job_has_no_more_parts_than_there_is_time_for(monkeypatch):
    monkeypatch.setattr(schedules, "MAX_PARTS", 2)
    schedules.parse_schedule(SCHEDULE, "s.xml")
    monkeypatch.setattr(schedules, "MAX_PARTS", 1)
    assert "has 2 parts of one job" in refusal(lambda: schedules.parse_schedule(SCHEDULE, "s.xml")).message


SPLITS = """<task-model xmlns="urn:halpipe:task-model:1" name="m"><platform><unit name="u"/></platform><tasks>
<task name="a" period="10ms"><version name="v" wcet="1ms" split="anywhere" max-gaps="-1"><units names="u"/></version>
<version name="w" wcet="1ms" split="anywhere" max-gaps="2"><units names="u"/></version></task></tasks>
<modes><mode name="a"><run task="a" versions="v w"/></mode></modes></task-model>
"""


def test_a_malformed_restriction_restricts_nothing_and_the_others_stay(tmp_path):
    path = tmp_path / "m.xml"
    path.write_text(SPLITS)
    system, malformed = models.read_what_is_well_formed(str(path))
    assert [(found.at.line, found.code) for found in malformed] == [(2, "HAL0102")]
    assert [version.split.max_gaps for version in system.tasks[0].versions] == [100, 2]
    path.write_text(SPLITS.replace(' max-gaps="-1"', ""))
    assert models.read_what_is_well_formed(str(path))[1] == []
    path.write_text(SPLITS.replace('period="10ms"', 'period="ten"'))
    with pytest.raises(HalpipeError) as refused:
        models.read_what_is_well_formed(str(path))
    assert {found.at.line for found in refused.value.diagnostics} == {2}
