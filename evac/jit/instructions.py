"""Numba types and lowering of structs, arrays, intrinsics and calls of addresses.

This module is imported only to compile. A struct is one pointer; an array is one pointer to its header, which contains
its address and extents. Headers do not change while a kernel runs, and loads from them are marked as invariant, so
that the compiler does not reload them after stores. Negative indices are not supported.
"""

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.datamodel import models
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AbstractTemplate, AttributeTemplate, infer_getattr, infer_global, signature
from numba.core.typing.typeof import typeof_impl
from numba.extending import lower_builtin, lower_cast, lower_getattr_generic, lower_setattr_generic, register_model

from evac.jit.kernels import AddressCall, ArgumentKind, Array, Intrinsic, Struct, describe

_WORD = ir.IntType(64)
_ADDRESS = _WORD.as_pointer()


class StructType(types.Type):
    """A struct, passed as a pointer to its memory."""

    def __init__(self, struct: type[Struct]) -> None:
        self.struct = struct
        super().__init__(name=f"{struct.__module__}.{struct.__qualname__}")

    @property
    def key(self) -> type[Struct]:
        """The class, since another class of the same name, such as a redefinition, may have a different layout."""
        return self.struct


class BufferType(types.Type):
    """An array, passed as a pointer to its header."""

    def __init__(self, kind: Array) -> None:
        self.kind = kind
        self.number = getattr(types, kind.dtype)
        super().__init__(name=describe(kind))

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.kind.shape)


class RowType(BufferType):
    """A row of a grid, given by its address and length; it has no header, since that would change in a kernel."""

    def __init__(self, dtype: str) -> None:
        super().__init__(Array(dtype, (None,)))
        self.name = f"row of {dtype}"


def type_of(kind: ArgumentKind) -> types.Type:
    """Return the numba type of an argument or attribute."""
    if isinstance(kind, Array):
        return BufferType(kind)
    if isinstance(kind, str):
        return getattr(types, kind)
    return StructType(kind)


@register_model(StructType)
@register_model(BufferType)
class _PointerModel(models.PrimitiveModel):
    def __init__(self, manager: Any, front_end_type: Any) -> None:
        super().__init__(manager, front_end_type, _ADDRESS)


@register_model(RowType)
class _RowModel(models.StructModel):
    def __init__(self, manager: Any, front_end_type: Any) -> None:
        super().__init__(manager, front_end_type, [("data", types.int64), ("length", types.int64)])


def _word(builder: Any, pointer: Any, number: int) -> Any:
    return builder.gep(pointer, [ir.Constant(ir.IntType(32), number)]) if number else pointer


def _load_constant(builder: Any, pointer: Any) -> Any:
    """Load a value that kernels do not change (invariant load)."""
    loaded = builder.load(pointer)
    loaded.set_metadata("invariant.load", builder.module.add_metadata([]))
    return loaded


# Attributes of structs


@infer_getattr
class _StructAttributes(AttributeTemplate):
    key = StructType

    def generic_resolve(self, struct: StructType, name: str) -> types.Type | None:
        kind = struct.struct.kinds.get(name)
        return None if kind is None else type_of(kind)


@lower_getattr_generic(StructType)
def _get_attribute(context: Any, builder: Any, struct: StructType, value: Any, name: str) -> Any:
    kind = struct.struct.kinds[name]
    place = _word(builder, value, struct.struct.words[name])
    if isinstance(kind, Array):
        return place
    if isinstance(kind, str):
        if kind == "float64":
            place = builder.bitcast(place, ir.DoubleType().as_pointer())
        return builder.load(place)
    return _load_constant(builder, builder.bitcast(place, _ADDRESS.as_pointer()))


@lower_setattr_generic(StructType)
def _set_attribute(context: Any, builder: Any, sig: Any, arguments: Any, name: str) -> None:
    struct, given = sig.args
    kind = struct.struct.kinds[name]
    if not isinstance(kind, str):
        raise NotImplementedError(f"{struct}.{name}: kernels cannot replace arrays and structs; write into them")
    place = _word(builder, arguments[0], struct.struct.words[name])
    if kind == "float64":
        place = builder.bitcast(place, ir.DoubleType().as_pointer())
    builder.store(context.cast(builder, arguments[1], given, getattr(types, kind)), place)


# Arrays


@infer_getattr
class _BufferAttributes(AttributeTemplate):
    key = BufferType

    def resolve_shape(self, buffer: BufferType) -> types.Type:
        return types.UniTuple(types.int64, buffer.ndim)


def _extent(builder: Any, buffer: BufferType, value: Any, axis: int) -> Any:
    if isinstance(buffer, RowType):
        return builder.extract_value(value, 1)
    fixed = buffer.kind.shape[axis]
    if fixed is not None:
        return ir.Constant(_WORD, fixed)
    return _load_constant(builder, _word(builder, value, 1 + axis))


@lower_getattr_generic(BufferType)
def _get_shape(context: Any, builder: Any, buffer: BufferType, value: Any, name: str) -> Any:
    extents = [_extent(builder, buffer, value, axis) for axis in range(buffer.ndim)]
    return context.make_tuple(builder, types.UniTuple(types.int64, buffer.ndim), extents)


@infer_global(len)
class _Length(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(types.int64, args[0]) if isinstance(args[0], BufferType) else None


@lower_builtin(len, BufferType)
def _length(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    return _extent(builder, sig.args[0], args[0], 0)


def _fits(buffer: types.Type, index: types.Type) -> bool:
    """Return whether an index selects one element of an array."""
    if not isinstance(buffer, BufferType):
        return False
    if isinstance(index, types.Integer):
        return buffer.ndim == 1
    return (
        isinstance(index, types.BaseTuple)
        and len(index) == buffer.ndim
        and all(isinstance(part, types.Integer) for part in index)
    )


@infer_global(operator.getitem)
class _GetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(args[0].number, *args) if _fits(*args) else None


@infer_global(operator.setitem)
class _SetItem(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(types.void, args[0], args[1], args[0].number) if _fits(*args[:2]) else None


def _place(context: Any, builder: Any, buffer: BufferType, value: Any, index: types.Type, given: Any) -> Any:
    """Return the address of an element of an array."""
    kinds = [index] if isinstance(index, types.Integer) else list(index)
    numbers = [given] if isinstance(index, types.Integer) else cgutils.unpack_tuple(builder, given)
    numbers = [context.cast(builder, number, kind, types.int64) for number, kind in zip(numbers, kinds, strict=True)]
    at = numbers[0]
    for axis in range(1, buffer.ndim):
        at = builder.add(builder.mul(at, _extent(builder, buffer, value, axis)), numbers[axis])
    data = context.get_data_type(buffer.number).as_pointer()
    if isinstance(buffer, RowType):
        return builder.gep(builder.inttoptr(builder.extract_value(value, 0), data), [at])
    return builder.gep(_load_constant(builder, builder.bitcast(value, data.as_pointer())), [at])


@lower_builtin(operator.getitem, BufferType, types.Integer)
@lower_builtin(operator.getitem, BufferType, types.BaseTuple)
def _get_item(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    loaded = builder.load(_place(context, builder, sig.args[0], args[0], sig.args[1], args[1]))
    return impl_ret_borrowed(context, builder, sig.return_type, loaded)


@lower_builtin(operator.setitem, BufferType, types.Integer, types.Any)
@lower_builtin(operator.setitem, BufferType, types.BaseTuple, types.Any)
def _set_item(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    buffer, index, number = sig.args
    place = _place(context, builder, buffer, args[0], index, args[1])
    builder.store(context.cast(builder, args[2], number, buffer.number), place)
    return context.get_dummy_value()


# Operations and calls of addresses


def _callable(key: Any, result: Callable[..., Any], lower: Callable[..., Any]) -> types.Type:
    """Make a numba function type for an object that kernels call; `result` infers the type of its result."""

    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return result(args)

    Template.key = key
    lower_builtin(key, types.VarArg(types.Any))(lower)
    return types.Function(Template)


def _type_address_call(call: AddressCall) -> types.Type:
    kinds = [type_of(kind) for kind in call.kinds]
    numbers = [getattr(types, kind) for kind in call.returns]
    returned = numbers[0] if len(numbers) == 1 else types.Tuple(numbers)
    wanted = signature(returned, types.int64, *kinds)

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        inputs = [context.get_value_type(kind) for kind in kinds]
        outputs = [context.get_value_type(number) for number in numbers]
        output = outputs[0] if len(outputs) == 1 else ir.LiteralStructType(outputs)
        result = builder.call(builder.inttoptr(args[0], ir.FunctionType(output, inputs).as_pointer()), args[1:])
        if len(numbers) == 1:
            return result
        return context.make_tuple(builder, returned, [builder.extract_value(result, k) for k in range(len(numbers))])

    return _callable(call, lambda args: wanted if len(args) == len(wanted.args) else None, generate)


def _row(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    """Return the address and length of a row of a grid."""
    buffer = sig.args[0]
    pair = context.make_tuple(builder, types.UniTuple(types.int64, 2), [args[1], ir.Constant(_WORD, 0)])
    place = _place(context, builder, buffer, args[0], types.UniTuple(types.int64, 2), pair)
    row = ir.Constant(context.get_value_type(sig.return_type), ir.Undefined)
    row = builder.insert_value(row, builder.ptrtoint(place, _WORD), 0)
    return builder.insert_value(row, _extent(builder, buffer, args[0], 1), 1)


@lower_cast(RowType, BufferType)
def _make_header(context: Any, builder: Any, given: RowType, wanted: BufferType, value: Any) -> Any:
    """Make a header of a row for a call of an address; only the callee reads it."""
    pointer = builder.bitcast(cgutils.alloca_once(builder, ir.ArrayType(_WORD, 2)), _ADDRESS)
    for word in range(2):
        builder.store(builder.extract_value(value, word), _word(builder, pointer, word))
    return pointer


def _extreme(comparison: str) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Return typing and lowering of ``max`` (">") and ``min`` ("<"), which treat NaN as Python does."""

    def result(args: Any) -> Any:
        if len(args) < 2 or not all(isinstance(kind, types.Integer | types.Float) for kind in args):
            return None
        number = types.float64 if any(isinstance(kind, types.Float) for kind in args) else types.int64
        return signature(number, *[number] * len(args))

    def generate(context: Any, builder: Any, sig: Any, args: Any) -> Any:
        extreme = args[0]
        for value in args[1:]:
            if sig.return_type == types.float64:
                is_beyond = builder.fcmp_ordered(comparison, value, extreme)
            else:
                is_beyond = builder.icmp_signed(comparison, value, extreme)
            extreme = builder.select(is_beyond, value, extreme)
        return extreme

    return result, generate


def _truncated(args: Any) -> Any:
    number = args[0] if len(args) == 1 else None
    return signature(types.int64, number) if isinstance(number, types.Integer | types.Float) else None


_THREE = signature(types.float64, types.float64, types.float64, types.float64)

#: Typing and lowering of each `Intrinsic`, by name.
_INTRINSICS: dict[str, tuple[Callable[..., Any], Callable[..., Any]]] = {
    "fused": (lambda args: _THREE, lambda context, builder, sig, args: builder.fma(*args)),
    "row": (lambda args: signature(RowType(args[0].kind.dtype), args[0], types.int64), _row),
}

_known: dict[Any, types.Type] = {}

#: Python functions for which numba would compile a separate function for each combination of types.
BUILTINS = {
    max: _callable("evac max", *_extreme(">")),
    min: _callable("evac min", *_extreme("<")),
    int: _callable(
        "evac int", _truncated, lambda own, builder, sig, args: own.cast(builder, *args, sig.args[0], types.int64)
    ),
}


@typeof_impl.register(AddressCall)
def _typeof_address_call(value: AddressCall, context: Any) -> types.Type:
    if value not in _known:
        _known[value] = _type_address_call(value)
    return _known[value]


@typeof_impl.register(Intrinsic)
def _typeof_intrinsic(value: Intrinsic, context: Any) -> types.Type:
    if value not in _known:
        _known[value] = _callable(value, *_INTRINSICS[value.name])
    return _known[value]
