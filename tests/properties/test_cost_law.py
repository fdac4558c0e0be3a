"""The cost law: what is answered takes time that grows with the file and not with its square.

`worst_inputs` has, for each reader, what a reader of its kind is slow at. Here two sizes are tried, and what they take
is held against each other, and against a sound model of the same size: no clock is asked how fast the machine is.
`make endurance` tries 10 MB, and there seconds and memory are counted.
"""

from subprocess import CompletedProcess

import pytest

from command_line import run_here
from growth import TRIES, growth, half_way, seconds
from halpipe.core.suggest import COMPARISONS, bounded_suggestions, nearest
from halpipe.exporters.native import format_model
from support import model, task, version
from worst_inputs import BESIDE, READERS, WORST, as_bytes

FIRST, SMALL, LARGE = 2_000, 20_000, 160_000
MOST = 100
"""Times that the worst inputs may take of what a sound model of their size takes; today it is some 15."""
SOUND = "model: tasks"
MEASURED: dict[int, float] = {}


@pytest.fixture
def place(tmp_path):
    (tmp_path / "model.xml").write_bytes(format_model(model(task("a", "10ms", version("v", "1ms", "u")), units="u")))
    for name, text in BESIDE.items():
        (tmp_path / name).write_text(text)
    assert run_here(tmp_path, "schedule", "model.xml", "-o", "s.xml", "-q").returncode == 0
    return tmp_path


@pytest.fixture
def takes(place):
    """Return the processor time that a kind of a size takes, after a look at how it ends."""

    def run(kind, size):
        command, file, make = WORST[kind]
        (place / file).write_bytes(as_bytes(make(size)))
        words = [file if word == "FILE" else word for word in command]
        ended = []
        spent = seconds(lambda: ended.append(run_here(place, *words)))
        assert ended[0].returncode in (0, 1, 2), ended[0].stderr
        assert len(ended[0].stderr) < 100_000, "what people read has an end"
        return spent

    return run


@pytest.fixture
def least(takes):
    """Return what a sound model of a size takes at least: measured once, since it is the same for all kinds."""

    def of(size):
        if size not in MEASURED:
            MEASURED[size] = min(takes(SOUND, size) for _ in range(TRIES))
        return MEASURED[size]

    return of


@pytest.mark.slow  # test_schemas.py has the quicker one for the reader of models
@pytest.mark.parametrize("kind", WORST)
def test_the_worst_inputs_take_time_that_grows_with_them(takes, least, kind):
    """The least of several tries, since other programs disturb; most kinds need one."""
    takes(kind, FIRST)  # modules are loaded
    small, large = [], []
    for _ in range(TRIES):
        small.append(max(takes(kind, SMALL), least(0)))  # that of a command that reads next to nothing
        large.append(takes(kind, LARGE))
        grown, multiple = min(large) / min(small), min(large) / least(LARGE)
        if grown < half_way(LARGE / SMALL) and multiple < MOST:
            break
    assert grown < half_way(LARGE / SMALL)
    assert multiple < MOST


def test_a_reader_that_compares_all_with_all_is_noticed(takes, place, monkeypatch):
    """The law can be broken."""

    def quadratic(folder, *_):
        lines = (folder / "m.xml").read_text().splitlines()
        sum(a is b for a in lines for b in lines)
        return CompletedProcess([], 0, "", "")

    monkeypatch.setitem(globals(), "run_here", quadratic)
    assert growth(lambda size: lambda: takes(SOUND, size), SMALL, LARGE) > half_way(LARGE / SMALL)


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
