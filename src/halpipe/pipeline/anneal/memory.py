"""How compiled code sees `Arrays` and `State`: as a pointer to a table of addresses, instead of field by field.

numba passes a NamedTuple of arrays as seven words for each array, 400 in each call here, and generates code that takes
them apart and puts them together in every function: that was two thirds of the time to compile. A `Table` is one
word. Its entries never change while compiled code runs, and the code generator is told so.

A field is read as a `View`. Unlike numba's arrays, views do not look for negative indices, which the kernel never uses;
looking for them was a third of the time to run. Both types are made with numba's interface for extensions.
"""

from __future__ import annotations

import operator
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.typing.templates import AttributeTemplate
from numba.extending import (
    NativeValue,
    infer_getattr,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    type_callable,
    typeof_impl,
    unbox,
)

if TYPE_CHECKING:
    from numpy.typing import NDArray

_WORD = ir.IntType(64)
_WORDS_PER_FIELD = 3
"""Address, rows and columns of an array; or an integer."""

T = TypeVar("T", bound="type[tuple[Any, ...]]")


class Table(types.Type):
    """A NamedTuple of arrays and integers; `fields` are the names and types that its attributes have."""

    def __init__(self, name: str, fields: tuple[tuple[str, Any], ...]) -> None:
        self.fields = fields
        super().__init__(name=f"Table({name}, {fields})")


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


# ------------------------------------------------------------------------------------------------ from Python


def as_table(cls: T, *, fixed: bool = False) -> T:
    """Let compiled code take instances of a NamedTuple as tables; `fixed` if it never writes to their arrays.

    All instances must have arrays of the same dimensions and types.
    """
    known: list[Table] = []

    @typeof_impl.register(cls)
    def typeof(values: Any, _: Any) -> Table:
        if not known:
            fields = (_field(name, value, fixed) for name, value in zip(values._fields, values, strict=True))
            known.append(Table(cls.__name__, tuple(fields)))
        return known[0]

    return cls


def _field(name: str, value: Any, fixed: bool) -> tuple[str, Any]:
    if isinstance(value, np.ndarray):
        return name, View(value.ndim, getattr(types, value.dtype.name), fixed=fixed)
    return name, types.int64


def addresses(values: tuple[Any, ...]) -> NDArray[np.int64]:
    """Return the table of a NamedTuple; it is good as long as the arrays live."""
    table = np.zeros((len(values), _WORDS_PER_FIELD), np.int64)
    for row, value in zip(table, values, strict=True):
        if isinstance(value, np.ndarray):
            row[0] = value.__array_interface__["data"][0]
            row[1 : 1 + value.ndim] = value.shape
        else:
            row[0] = value
    return table


@unbox(Table)
def _unbox(typ: Any, instance: Any, c: Any) -> Any:
    make = c.pyapi.unserialize(c.pyapi.serialize_object(addresses))
    table = c.pyapi.call_function_objargs(make, [instance])
    c.pyapi.decref(make)
    kind = types.Array(types.int64, 2, "C")
    native = c.unbox(kind, table)
    array = c.context.make_array(kind)(c.context, c.builder, native.value)
    pointer = c.builder.bitcast(array.data, _WORD.as_pointer())
    return NativeValue(pointer, is_error=native.is_error, cleanup=lambda: c.pyapi.decref(table))


# ------------------------------------------------------------------------------------------------ in compiled code


@infer_getattr
class _TableAttributes(AttributeTemplate):
    key = Table

    def generic_resolve(self, typ: Any, attr: str) -> Any:
        return dict(typ.fields).get(attr)


@lower_getattr_generic(Table)
def _read_field(context: Any, builder: Any, typ: Any, table: Any, attr: str) -> Any:
    index = [name for name, _ in typ.fields].index(attr)
    kind = typ.fields[index][1]
    words = [_fixed_load(builder, table, _WORDS_PER_FIELD * index + word) for word in range(_WORDS_PER_FIELD)]
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
