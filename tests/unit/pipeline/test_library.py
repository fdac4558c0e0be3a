"""Python and C agree on what lies where, and the kernel refuses what it would misread."""

import ctypes
import re

import numpy as np
import pytest

from halpipe.libraries import library
from halpipe.pipeline.jobs import expand
from halpipe.pipeline.solve.kernel import library as border
from halpipe.pipeline.solve.kernel import state
from halpipe.pipeline.solve.kernel.kernel import anneal
from halpipe.pipeline.solve.kernel.noise import SIZE
from halpipe.pipeline.solve.kernel.state import Part, State, new_state
from halpipe.pipeline.solve.problem import Arrays, build_problem
from support import access, after, chain, model, task, version

HEADER = re.sub(r"/\*.*?\*/", "", (border.SOURCES / "arrays.h").read_text(), flags=re.DOTALL)
WIDTH = {"Rect": 4, "Row": 4, "Partner": 5, "Limits": 2, "Owner": 3, "Spot": 3}


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
def test_structs_have_the_fields_of_the_tuples_in_their_order(struct, value):
    fields = members(struct)
    counts = list(border.COUNTED) if struct == "Arrays" else []
    names = [name.replace("registers", "register") for name, _, _ in fields]  # a word that C keeps for itself
    assert names == [*{"Arrays": Arrays, "State": State}[struct]._fields, *counts]
    for (name, kind, is_array), field in zip(fields, value, strict=False):
        assert isinstance(field, np.ndarray) == is_array, name
        if is_array and name != "registers":
            assert (kind in WIDTH) == (field.ndim == 2 and name != "owner_at"), name
            assert kind not in WIDTH or field.shape[1] == WIDTH[kind] == len(members(kind)), name
            assert field.dtype == {"uint64_t": np.uint64}.get(kind, np.int64), name


def test_registers_constants_and_parts_are_the_same_on_both_sides():
    names = [name.upper() for name, _, _ in members("Registers")]
    assert [getattr(state, name) for name in names] == list(range(state.REGISTERS))
    shared = ("NEVER", "FROZEN_HINT", "CLUSTER", "NOISES")
    assert [constant(name) for name in shared] == [state.NEVER, state.FROZEN_HINT, state.CLUSTER, SIZE]
    parts = re.findall(r"^ +(\w+) = 1 << (\d+),$", HEADER, re.MULTILINE)
    assert {name: 1 << int(bit) for name, bit in parts} == {part.name: part.value for part in Part}


def test_the_struct_holds_addresses_integers_and_lengths():
    arrays, _ = example()
    words = list(border.words([*arrays, 4711]))
    assert words[0] == arrays.hyperperiod
    assert words[Arrays._fields.index("rect")] == arrays.rect.ctypes.data
    assert words[-1] == 4711
    assert [len(getattr(arrays, name)) for name in border.COUNTED.values()] == [3, 2, 2, 2, 1]


WRONG = [
    np.zeros(8, np.int32),
    np.zeros(8, np.float64),
    np.zeros((4, 4), np.int64)[:, 1],
    np.zeros(16, np.int64)[::2],
]


@pytest.mark.parametrize("wrong", WRONG)
def test_what_the_kernel_would_misread_is_refused(wrong):
    arrays, fresh = example()
    with pytest.raises(TypeError):
        anneal(arrays, fresh._replace(start=wrong), np.zeros(SIZE, np.int64), 1)


def test_only_what_is_meant_to_be_called_can_be():
    loaded = library(border.SOURCES, "kernel")
    assert loaded.halpipe_anneal
    with pytest.raises(AttributeError):
        loaded.take  # noqa: B018
    assert ctypes.sizeof(ctypes.c_void_p) == 8
