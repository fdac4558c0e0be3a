"""From Python to machine code, by numba: needed at the first search of an installation only.

Compiled code sees `Arrays` and `State` as a pointer to a table of addresses, instead of field by field. numba passes a
NamedTuple of arrays as seven words for each array, 400 in each call here, and generates code that takes them apart and
puts them together in every function: that was two thirds of the time to compile. A `Table` is one word. Its entries
never change while compiled code runs, and the code generator is told so.

A field is read as a `View`. Unlike numba's arrays, views do not look for negative indices, which the kernel never uses;
looking for them was a third of the time to run. Both types are made with numba's interface for extensions.
"""

from __future__ import annotations

import operator
from hashlib import sha256
from typing import TYPE_CHECKING, Any

import numpy as np
from llvmlite import ir
from numba import njit
from numba.core import cgutils, config, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    models,
    overload,
    register_model,
    type_callable,
)

from halpipe.pipeline.solve.kernel.profile import move_within
from halpipe.pipeline.solve.kernel.registry import ENTRIES, FIXED, INNER, WORDS_PER_FIELD

if TYPE_CHECKING:
    from collections.abc import Callable

config.OPT = type(config.OPT)(1)
"""What LLVM does beyond its first level takes a third of the compilation and makes no search faster."""

_WORD = ir.IntType(64)

_OPTIONS: dict[str, Any] = {"_nrt": False, "no_cfunc_wrapper": True, "no_cpython_wrapper": True}
"""The kernel allocates nothing, so it needs no reference counts, which would be kept at every use of an array. It is
called as C is, so it needs no wrappers."""


def compile_entry(function: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[str, bytes]:
    """Return symbol and object file of a function for arguments of these kinds, with all that it uses compiled in."""
    _make_callable()
    kinds = tuple(kind_of(argument) for argument in arguments)
    made = njit(kinds, **_OPTIONS)(function).overloads[kinds]
    return made.fndesc.llvm_func_name, made.library._get_compiled_object()  # noqa: SLF001 - as numba's own cache does


_callable: set[Callable[..., Any]] = set()


def _make_callable() -> None:
    """Let compiled code call what has been registered since the last time."""
    for called, function in (*ENTRIES.items(), *((inner, inner) for inner in INNER)):
        if called not in _callable:
            overload(called, jit_options=_OPTIONS, strict=False)(_standing_for(function))
            _callable.add(called)


def _standing_for(function: Callable[..., Any]) -> Callable[..., Any]:
    return lambda *_: function


def kind_of(value: Any) -> Any:
    """Return the type that compiled code has for a table, an array, or an integer."""
    if isinstance(value, tuple):
        fixed = FIXED[type(value)]
        fields = ((name, _kind_of_field(field, fixed)) for name, field in zip(value._fields, value, strict=True))
        return Table(type(value).__name__, tuple(fields))
    return _kind_of_field(value, fixed=False)


def _kind_of_field(value: Any, fixed: bool) -> Any:
    if isinstance(value, np.ndarray):
        return View(value.ndim, getattr(types, value.dtype.name), fixed=fixed)
    return types.int64


class Table(types.Type):
    """A NamedTuple of arrays and integers; `fields` are the names and types that its attributes have."""

    def __init__(self, name: str, fields: tuple[tuple[str, Any], ...]) -> None:
        self.fields = fields
        # Names of types are in the names of all functions that take them: short ones compile faster.
        super().__init__(name=f"Table({name}, {sha256(repr(fields).encode()).hexdigest()[:16]})")


class View(types.Type):
    """An array of 64 bit integers in one or two dimensions; `fixed` if compiled code never writes to it."""

    def __init__(self, dimensions: int, element: Any, *, fixed: bool) -> None:
        self.dimensions, self.element, self.fixed = dimensions, element, fixed
        super().__init__(name=f"View({dimensions}, {element}, {fixed})")


@register_model(Table)
class _TableModel(models.PrimitiveModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        super().__init__(dmm, fe_type, _WORD.as_pointer())


@register_model(View)
class _ViewModel(models.StructModel):
    def __init__(self, dmm: Any, fe_type: Any) -> None:
        members = [("data", types.CPointer(fe_type.element)), ("rows", types.intp), ("columns", types.intp)]
        super().__init__(dmm, fe_type, members)


@infer_getattr
class _TableAttributes(AttributeTemplate):
    key = Table

    def generic_resolve(self, typ: Any, attr: str) -> Any:
        return dict(typ.fields).get(attr)


@lower_getattr_generic(Table)
def _read_field(context: Any, builder: Any, typ: Any, table: Any, attr: str) -> Any:
    index = [name for name, _ in typ.fields].index(attr)
    kind = typ.fields[index][1]
    words = [_fixed_load(builder, table, WORDS_PER_FIELD * index + word) for word in range(WORDS_PER_FIELD)]
    if not isinstance(kind, View):
        return words[0]
    view = cgutils.create_struct_proxy(kind)(context, builder)
    view.data = builder.inttoptr(words[0], _WORD.as_pointer())
    view.rows, view.columns = words[1:]
    return view._getvalue()  # noqa: SLF001 - numba's own name for it


def _fixed_load(builder: Any, base: Any, index: int) -> Any:
    return _never_changing(builder, builder.load(builder.gep(base, [ir.Constant(_WORD, index)])))


def _never_changing(builder: Any, load: Any) -> Any:
    """Let the optimiser reuse what was loaded, whatever is written in between."""
    load.set_metadata("invariant.load", builder.module.add_metadata([]))
    return load


@type_callable(len)
def _type_len(_: Any) -> Any:
    return lambda view: types.intp if isinstance(view, View) else None


@type_callable(operator.getitem)
def _type_getitem(_: Any) -> Any:
    def typer(view: Any, index: Any) -> Any:
        return view.element if isinstance(view, View) and _is_index(view, index) else None

    return typer


@type_callable(operator.setitem)
def _type_setitem(_: Any) -> Any:
    def typer(view: Any, index: Any, value: Any) -> Any:
        writable = isinstance(view, View) and not view.fixed and _is_index(view, index)
        return types.none if writable and isinstance(value, types.Integer) else None

    return typer


def _is_index(view: Any, index: Any) -> bool:
    indices = tuple(index) if isinstance(index, types.BaseTuple) else (index,)
    return len(indices) == view.dimensions and all(isinstance(one, types.Integer) for one in indices)


@lower_builtin(len, View)
def _len(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0]).rows


@lower_builtin(operator.getitem, View, types.Integer)
@lower_builtin(operator.getitem, View, types.BaseTuple)
def _getitem(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    load = builder.load(_place(context, builder, *sig.args, *args))
    return _never_changing(builder, load) if sig.args[0].fixed else load


@lower_builtin(operator.setitem, View, types.Integer, types.Integer)
@lower_builtin(operator.setitem, View, types.BaseTuple, types.Integer)
def _setitem(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    kind, index_type, value_type = sig.args
    view, index, value = args
    place = _place(context, builder, kind, index_type, view, index)
    builder.store(context.cast(builder, value, value_type, kind.element), place)
    return context.get_dummy_value()


@type_callable(move_within)
def _type_move_within(_: Any) -> Any:
    def typer(view: Any, begin: Any, end: Any, steps: Any) -> Any:
        writable = isinstance(view, View) and not view.fixed and view.dimensions == 1
        return types.none if writable and all(isinstance(one, types.Integer) for one in (begin, end, steps)) else None

    return typer


@lower_builtin(move_within, View, types.Integer, types.Integer, types.Integer)
def _move_within(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    proxy = cgutils.create_struct_proxy(sig.args[0])(context, builder, value=args[0])
    begin, end, steps = (context.cast(builder, *one, types.intp) for one in zip(args[1:], sig.args[1:], strict=True))
    source = builder.gep(proxy.data, [begin])
    cgutils.raw_memmove(builder, builder.gep(source, [steps]), source, builder.sub(end, begin), _WORD.width // 8)
    return context.get_dummy_value()


def _place(context: Any, builder: Any, kind: Any, index_type: Any, view: Any, index: Any) -> Any:
    """Return the pointer to an element."""
    proxy = cgutils.create_struct_proxy(kind)(context, builder, value=view)
    if not isinstance(index_type, types.BaseTuple):
        return builder.gep(proxy.data, [context.cast(builder, index, index_type, types.intp)])
    row, column = (
        context.cast(builder, value, one, types.intp)
        for value, one in zip(cgutils.unpack_tuple(builder, index), index_type, strict=True)
    )
    return builder.gep(proxy.data, [builder.add(builder.mul(row, proxy.columns), column)])
