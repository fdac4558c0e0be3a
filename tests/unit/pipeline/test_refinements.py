"""Requirements of MODEL 10 that a stage does not know are refused by name, never ignored."""

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.models import Anchor, Precedence
from halpipe.pipeline.jobs import NOT_SEARCHED, expand
from support import model, ms, task, version

PLAIN = Precedence(task="a", max=ms(20))


def system(row=PLAIN):
    return model(task("a", 20, version()), task("b", 20, version("v", "1ms", "u1", row)), units="u1")


def test_a_model_without_refinements_is_expanded():
    plain = system()
    assert expand(plain, plain.modes[0]).job_count == 2


@pytest.mark.parametrize("row", [Precedence(task="a", max=ms(20), to=Anchor.END)])
def test_a_requirement_that_the_search_does_not_know_is_refused_by_name(row):
    refined = system(row)
    with pytest.raises(HalpipeError) as refused:
        expand(refined, refined.modes[0])
    assert [d.code for d in refused.value.diagnostics] == [NOT_SEARCHED.id]
