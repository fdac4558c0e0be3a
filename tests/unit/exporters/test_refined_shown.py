"""Exports of models with requirements on instants, cycles, locks and LET (MODEL 10): shown as they are, or refused."""

from dataclasses import replace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.exporters.common.codes import KEEPS_NO_LET
from halpipe.exporters.common.timeline import links
from halpipe.exporters.graph.dot import _window
from halpipe.exporters.ros import RosExporter, RosOptions
from halpipe.models import Anchor, Match, Precedence
from support import job, model, ms, schedule, task, version

LET = replace(task("a", 20, version("v", 4, "u1"), offset=0), let=ms(10))
REFINED = Precedence(task="a", anchor=Anchor.RELEASE, to=Anchor.END, match=Match.CYCLE, max=ms(15))


@pytest.mark.parametrize("options", [RosOptions(), RosOptions(package=True)])
def test_targets_that_copy_no_data_refuse_a_logical_execution_time(options):
    system = model(LET)
    with pytest.raises(HalpipeError) as refused:
        RosExporter().write(system, schedule(system, 20, job(system, "a", 0, 0, "u1")), options)
    assert KEEPS_NO_LET.id in {d.code for d in refused.value.diagnostics}


def test_no_arrow_is_drawn_for_a_window_that_counts_from_elsewhere():
    plain = Precedence(task="a", max=ms(15))
    for row, count in ((plain, 1), (REFINED, 0)):
        system = model(task("a", 20, version("v", 4, "u1")), task("b", 20, version("v", 4, "u2", row)), units="u1 u2")
        plan = schedule(system, 20, job(system, "a", 0, 0, "u1"), job(system, "b", 0, 5, "u2"))
        assert len(links(system, plan.modes[0])) == count


def test_graphs_say_from_where_to_where_a_window_counts():
    assert _window(REFINED) == "release +0..15ms to end, same cycle"
    assert (
        _window(replace(REFINED, anchor=Anchor.POINT, point=ms(2), match=Match.WINDOW)) == "point 2ms +0..15ms to end"
    )
