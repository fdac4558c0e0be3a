"""What a checkpoint keeps of a search, and when: by a clock that the test turns."""

import io
import zipfile
from dataclasses import replace
from types import SimpleNamespace

import pytest

from halpipe.core.diagnostics import HalpipeError
from halpipe.pipeline.solve import checkpoint
from halpipe.pipeline.solve.checkpoint import NO_CHECKPOINT, SAVED, SECONDS, Checkpoint
from halpipe.pipeline.solve.integers import ints
from halpipe.pipeline.solve.one_mode import Found
from halpipe.pipeline.solve.schedule import SearchOptions, schedule_model
from support import job, mode, model, schedule, task, version


class Clock:
    def __init__(self):
        self.now = 100

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def whole(tmp_path, clock):
    return Checkpoint(str(tmp_path / "search"), "identity", clock)


def state(value=7, length=3):
    return SimpleNamespace(**{name: ints([value] * length) for name in SAVED})


def written(whole, tmp_path):
    """What another run would find in the file."""
    later = Checkpoint(str(tmp_path / "search"), "identity", lambda: 0)
    later.load()
    return later.arrays


ASKED = ("seed", "tick", "modes", "target", "shipped", "near", "grid", "optimise")


def test_a_search_goes_on_only_from_one_that_was_asked_the_same():
    """The version, the model and all that decides the outcome, but not how long it may take."""
    plain = dict.fromkeys(ASKED)

    def identity(digest="m", version="1", **changes):
        return checkpoint.fingerprint(SimpleNamespace(digest=digest), SimpleNamespace(**plain | changes), version)

    others = [identity("n"), identity(version="2"), *(identity(**{name: "x"}) for name in ASKED)]
    others.append(identity(shipped="x", near="x"))
    assert len({identity(), *others}) == 1 + len(others)
    assert identity(shipped="x") != identity(shipped="y")
    assert identity(near="x") != identity(near="y")
    assert identity(budget=7) == identity(budget=8) == identity()


def test_a_state_is_kept_and_written_once_it_is_so_old(whole, clock, tmp_path):
    kept = whole.stage("0")
    clock.now += SECONDS - 1
    kept.keep(state(), now=False)
    assert (whole.arrays, whole.is_written) == ({}, False)
    clock.now += 1
    kept.keep(state(1), now=False)
    assert whole.is_written
    assert {name: values.tolist() for name, values in written(whole, tmp_path).items()} == {
        f"0/{name}": [1, 1, 1] for name in SAVED
    }


def test_each_stage_is_kept_as_often_and_the_file_written_no_oftener(whole, clock, tmp_path):
    clock.now += SECONDS
    whole.stage("a").keep(state(1), now=False)
    clock.now += 1
    whole.stage("b").keep(state(2), now=False)  # it is due by itself, but the file is new
    assert sorted({name[0] for name in whole.arrays}) == ["a", "b"]
    assert {name[0] for name in written(whole, tmp_path)} == {"a"}
    clock.now += SECONDS - 2
    whole.stage("a").keep(state(3), now=False)
    assert whole.arrays["a/start"].tolist() == [1, 1, 1]
    clock.now += 1
    whole.stage("a").keep(state(4), now=False)
    assert written(whole, tmp_path)["a/start"].tolist() == [4, 4, 4]
    assert written(whole, tmp_path)["b/start"].tolist() == [2, 2, 2]


def test_what_is_kept_at_once_is_kept_only_where_there_is_a_file(whole, clock):
    kept = whole.stage("0")
    kept.keep(state(1), now=True)
    assert whole.arrays == {}
    whole.write()
    kept.keep(state(2), now=True)
    assert whole.arrays["0/start"].tolist() == [2, 2, 2]


def test_the_outcome_of_a_stage_takes_the_place_of_its_state(whole, clock):
    clock.now += SECONDS
    kept = whole.stage("0").stage("step")
    kept.keep(state(), now=False)
    assert kept.noted() is None
    kept.note({"moves": ints([5])})
    assert {name: values.tolist() for name, values in kept.noted().items()} == {"moves": [5]}
    assert list(whole.arrays) == [f"0/step/{checkpoint.NOTED}/moves"]
    assert whole.stage("0").noted() is None


def test_a_state_is_restored_unless_it_has_another_size(whole, clock):
    clock.now += SECONDS
    whole.stage("0").keep(state(5), now=False)
    fresh = state(0)
    whole.stage("0").restore(fresh)
    assert {name: getattr(fresh, name).tolist() for name in SAVED} == {name: [5, 5, 5] for name in SAVED}
    untouched = state(0)
    whole.stage("1").restore(untouched)
    assert untouched.start.tolist() == [0, 0, 0]
    with pytest.raises(HalpipeError) as refused:
        whole.stage("0").restore(state(0, length=4))
    assert [found.code for found in refused.value.diagnostics] == [NO_CHECKPOINT.id]


@pytest.mark.parametrize("order", ["little", "big"])
def test_words_are_the_same_on_every_machine(whole, monkeypatch, order):
    """The least byte comes first, whatever the order of the machine is."""
    monkeypatch.setattr(checkpoint.sys, "byteorder", order)
    values = ints([1, -2])
    packed = checkpoint._packed("identity", {"0/start": values})
    in_file = values[:]
    if order == "big":
        in_file.byteswap()
    assert in_file.tobytes() in packed
    assert checkpoint._unpacked(packed) == ("identity", {"0/start": values})


@pytest.mark.parametrize("compressed", [(), ("0/start",), (checkpoint.IDENTITY, "0/start")])
def test_a_file_of_which_any_member_is_compressed_is_no_checkpoint(compressed):
    """Halpipe compresses nothing, and what others did might expand without bound."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as file:
        for name, content in ((checkpoint.IDENTITY, b"identity"), ("0/start", bytes(8))):
            how = zipfile.ZIP_DEFLATED if name in compressed else zipfile.ZIP_STORED
            file.writestr(zipfile.ZipInfo(name), content, compress_type=how)
    if compressed:
        with pytest.raises(ValueError, match="compressed"):
            checkpoint._unpacked(stream.getvalue())
    else:
        assert checkpoint._unpacked(stream.getvalue()) == ("identity", {"0/start": ints([0])})


def test_a_mode_that_starts_from_an_improvement_cut_short_is_not_kept(monkeypatch):
    """A resumed search ends the improvement first; what followed from its half was another search."""
    a, b, c = (task(name, "10ms", version("v", "1ms", "u1")) for name in "abc")
    modes = [mode("cut", [a]), mode("after", [a, b]), mode("later", [b]), mode("beside", [c])]
    system = model(a, b, c, units="u1", modes=modes).read_from("0" * 64)
    kept = {}

    def search(_model, expansion, options, *_):
        kept[expansion.mode.name] = options.keeper is not None
        found = schedule(system, 10, *(job(system, each.name, 0, 0, "u1") for each in expansion.tasks))
        return Found(replace(found.modes[0], name=expansion.mode.name), [], unimproved=expansion.mode.name == "cut")

    monkeypatch.setattr("halpipe.pipeline.solve.schedule.schedule_mode", search)
    schedule_model(system, SearchOptions(keeper=object()), lambda *_: True)
    assert kept == {"cut": True, "after": False, "later": False, "beside": True}
