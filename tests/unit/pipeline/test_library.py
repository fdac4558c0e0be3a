"""Python and C agree on what lies where, and the kernel refuses what it would misread."""

import ctypes
import re
from array import array
from dataclasses import replace

import pytest

from halpipe.core.libraries import library
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.integers import Table, filled, ints
from halpipe.pipeline.solve.kernel import kernel as border
from halpipe.pipeline.solve.kernel import kernel as state
from halpipe.pipeline.solve.kernel.kernel import SIZE, Part, State, anneal, new_state
from halpipe.pipeline.solve.problem import ANY_SET, Arrays, build_problem
from support import access, after, chain, model, task, version

HEADER = re.sub(r"/\*.*?\*/", "", (border.SOURCES / "arrays.h").read_text(), flags=re.DOTALL)


def members(struct):
    """Return name, type and whether it is a pointer of each member of a struct of the header, in order."""
    body = re.search(rf"typedef struct \{{([^}}]*)\}} {struct};", HEADER)[1]
    found = []
    for kind, names in re.findall(r"(?:const )?(\w+) ([^;]+);", body):
        found += [(name.strip(" *"), kind, "*" in name) for name in names.split(",")]
    return found


def constant(name):
    """Return the value of a macro of the header, which is a number or a shifted one."""
    value = rf"#define {name} \(?(?:\(int64_t\))?(-?\d+)(?: << (\d+))?\)?$"
    number, shift = re.search(value, HEADER, re.MULTILINE).groups()
    return int(number) << int(shift or 0)


def example():
    rows = version("v", 2, "u1 u2", access("r", 0, 1), after("a", 0, 4))
    system = model(
        task("a", 40, version("v", 2, "u1")),
        task("b", 40, rows),
        units="u1 u2",
        resources="r",
        chains=[chain("c", "a b", reaction=30)],
    )
    problem = build_problem(expand(system, system.modes[0]), system.units, ["r"], system.chains)
    return problem.arrays, new_state(problem.arrays, 1, problem.mean_wcet)


@pytest.mark.parametrize(("struct", "value"), list(zip(("Arrays", "State"), example(), strict=True)))
def test_structs_have_the_fields_of_the_records_in_their_order(struct, value):
    fields = members(struct)
    counts = list(border.COUNTED) if struct == "Arrays" else []
    names = [name.replace("registers", "register") for name, _, _ in fields]  # a word that C keeps for itself
    assert names == [*{"Arrays": Arrays, "State": State}[struct].__slots__, *counts]
    for (name, kind, is_array), field in zip(fields, border.values(value), strict=False):
        assert isinstance(field, array | Table) == is_array, name
        if isinstance(field, Table):
            assert field.width == len(members(kind)), name
        elif isinstance(field, array):
            assert field.typecode == {"uint64_t": "Q"}.get(kind, "q"), name


def test_registers_constants_and_parts_are_the_same_on_both_sides():
    names = [name.upper() for name, _, _ in members("Registers")]
    assert [getattr(state, name) for name in names] == list(range(state.REGISTERS))
    shared = ("NEVER", "FROZEN_HINT", "CLUSTER", "ANY_SET", "NOISES")
    expected = (state.NEVER, state.FROZEN_HINT, state.CLUSTER, ANY_SET)
    assert [constant(name) for name in shared] == [*expected, SIZE]
    parts = re.findall(r"^ +(\w+) = 1 << (\d+),$", HEADER, re.MULTILINE)
    assert {name: 1 << int(bit) for name, bit in parts} == {part.name: part.value for part in Part}


def test_rows_of_the_state_are_as_long_as_its_structs():
    arrays, fresh = example()
    assert [len(members(name)) for name in ("Step", "Owner", "Spot")] == [2, 3, 3]
    assert len(fresh.step) == 2 * arrays.lane_first[-1]
    assert len(fresh.owner) == 3 * arrays.owner_first[-1]
    assert len(fresh.old) == len(fresh.kept) == 3 * len(arrays.job_task)
    assert len(fresh.owner_at) == fresh.max_rects * len(arrays.job_task)


def test_the_struct_holds_addresses_integers_and_lengths():
    arrays, _ = example()
    words = list(border.words([*border.values(arrays), 4711]))
    assert words[0] == arrays.hyperperiod
    assert words[Arrays.__slots__.index("rect")] == arrays.rect.flat.buffer_info()[0]
    assert words[-1] == 4711
    assert [len(getattr(arrays, name)) for name in border.COUNTED.values()] == [3, 2, 2, 2, 1]


WRONG = [array("i", [0] * 8), array("d", [0.0] * 8), [0] * 8, memoryview(ints(range(16)))[::2], None]


@pytest.mark.parametrize("wrong", WRONG)
def test_what_the_kernel_would_misread_is_refused(wrong):
    arrays, fresh = example()
    with pytest.raises(TypeError):
        anneal(arrays, replace(fresh, start=wrong), filled(SIZE), 1)


def test_only_what_is_meant_to_be_called_can_be():
    loaded = library(border.SOURCES, "kernel")
    assert loaded.halpipe_anneal
    with pytest.raises(AttributeError):
        loaded.take  # noqa: B018
    assert ctypes.sizeof(ctypes.c_void_p) == 8
