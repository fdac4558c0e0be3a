"""The cost law: whatever is in a file of up to 10 MB, it is answered within seconds and a bounded memory.

`worst_inputs` has, for each reader, what a reader of its kind is slow at. Here it is tried at a size at which growth
shows; `make endurance` tries 10 MB.
"""

import gc
import time

import pytest

from command_line import run_here
from halpipe.exporters.native import format_model
from halpipe.suggest import COMPARISONS, bounded_suggestions, nearest
from support import model, task, version
from worst_inputs import READERS, WORST

SIZE = 150_000
SECONDS = 6
"""For 150 kB; a reader that is quadratic takes minutes. Far above what is needed, since the machine may be busy."""


@pytest.fixture
def place(tmp_path):
    (tmp_path / "model.xml").write_bytes(format_model(model(task("a", "10ms", version("v", "1ms", "u")), units="u")))
    (tmp_path / "tiny.dot").write_text("digraph { a -> b; }")
    assert run_here(tmp_path, "schedule", "model.xml", "-o", "s.xml", "-q").returncode == 0
    return tmp_path


@pytest.mark.slow  # test_schemas.py has the quicker one for the reader of models
@pytest.mark.parametrize("kind", WORST)
def test_the_worst_inputs_are_answered_soon(place, kind):
    command, file, make = WORST[kind]
    (place / file).write_text(make(SIZE))
    gc.collect()
    gc.freeze()  # what earlier tests have left is not looked at again and again on the time of this one
    begin = time.process_time()
    run = run_here(place, *[file if word == "FILE" else word for word in command])
    spent = time.process_time() - begin
    gc.unfreeze()
    assert spent < SECONDS
    assert run.returncode in (0, 1, 2), run.stderr
    assert len(run.stderr) < 100_000, "what people read has an end"


def test_every_reader_is_among_them():
    readers = {kind.partition(":")[0] for kind in WORST}
    assert readers >= READERS


def test_suggestions_end_with_their_budget_and_begin_anew():
    known = [f"name{number}" for number in range(COMPARISONS // 10)]
    with bounded_suggestions():
        found = [bool(nearest("name1x", known)) for _ in range(12)]
    assert found == [True] * 10 + [False] * 2
    assert nearest("name1x", known)
    assert nearest("x" * 10_000, known) == []
