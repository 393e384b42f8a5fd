"""Four numbers at a time: what a kernel computes with where four rows do not depend on each other.

`Lanes` are one vector register of four float64, or two of two where the processor has no wider ones; each lane is
rounded as a single number would be, so that the bits are the same everywhere. Arrays are flat. LLVM finds such code
by itself only where loops store to places that do not depend on what they read, so kernels say it.

Without compilation (NUMBA_DISABLE_JIT) lanes are numpy arrays of four, and each operation has a twin in numpy.
"""

import operator
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, lower_builtin, models, register_model, type_callable

#: Lanes in one group.
FOUR = 4

_NUMBERS = ir.VectorType(ir.DoubleType(), FOUR)
_PAIR = ir.VectorType(ir.DoubleType(), 2)
_PLACE = ir.IntType(64)


class Lanes(types.Type):  # type: ignore[misc]
    """The numba type of four float64 in one register."""

    def __init__(self) -> None:
        super().__init__(name="Lanes")


LANES = Lanes()


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):  # type: ignore[misc]
    def __init__(self, manager: Any, front_end_type: Any) -> None:
        super().__init__(manager, front_end_type, _NUMBERS)


def _define(operation: Callable[..., Any], instruction: str) -> None:
    """Let compiled code apply a Python operator to lanes, by an instruction of LLVM."""

    @type_callable(operation)
    def type_operation(context):
        return lambda *given: LANES if all(one == LANES for one in given) else None

    def generate(context, builder, signature, arguments):
        return getattr(builder, instruction)(*arguments)

    lower_builtin(operation, *[LANES] * (1 if operation is operator.neg else 2))(generate)


for _operation, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.neg, "fneg"),
):
    _define(_operation, _instruction)


def _data(context: Any, builder: Any, kind: Any, array: Any) -> Any:
    """Return the address of an array's first number."""
    return context.make_array(kind)(context, builder, array).data


def _call(builder: Any, name: str, arguments: list[Any]) -> Any:
    """Call a function of LLVM that takes and returns lanes."""
    function = ir.FunctionType(_NUMBERS, [_NUMBERS] * len(arguments))
    return builder.call(builder.module.declare_intrinsic(f"{name}.v4f64", fnty=function), arguments)


def _shuffled(builder: Any, first: Any, second: Any, *picks: int) -> Any:
    """Return the picked numbers of two vectors, one behind the other."""
    mask = ir.Constant(ir.VectorType(ir.IntType(32), len(picks)), list(picks))
    return builder.shuffle_vector(first, second, mask)


def _pair(context: Any, builder: Any, kinds: Any, arguments: Any, lane: int) -> Any:
    """Return the address of the two numbers that a lane's place points to."""
    places = _data(context, builder, kinds[1], arguments[1])
    at = builder.add(arguments[2], ir.Constant(_PLACE, lane))
    place = builder.zext(builder.load(builder.gep(places, [at])), _PLACE)
    return builder.bitcast(builder.gep(_data(context, builder, kinds[0], arguments[0]), [place]), _PAIR.as_pointer())


def _or_else(twin: Callable[..., Any]) -> Callable[..., Any]:
    """Make a numba intrinsic of a function, or return its twin where nothing is compiled."""
    return lambda typed: twin if numba.config.DISABLE_JIT else intrinsic(typed)


@_or_else(lambda number: np.full(FOUR, number))
def spread(typing_context, number):
    """Return lanes that all hold `number`."""

    def generate(context, builder, signature, arguments):
        empty = ir.Constant(_NUMBERS, ir.Undefined)
        first = builder.insert_element(empty, arguments[0], ir.Constant(ir.IntType(32), 0))
        return _shuffled(builder, first, empty, 0, 0, 0, 0)

    return LANES(types.float64), generate


@_or_else(lambda array, at: array[at : at + FOUR].copy())
def load(typing_context, array, at):
    """Return four numbers of a flat array, from `at`."""

    def generate(context, builder, signature, arguments):
        address = builder.gep(_data(context, builder, signature.args[0], arguments[0]), [arguments[1]])
        return builder.load(builder.bitcast(address, _NUMBERS.as_pointer()), align=8)

    return LANES(array, types.intp), generate


def _set_four(array: Any, at: int, lanes: Any) -> None:
    array[at : at + FOUR] = lanes


@_or_else(_set_four)
def store(typing_context, array, at, lanes):
    """Write four numbers into a flat array, from `at`."""

    def generate(context, builder, signature, arguments):
        address = builder.gep(_data(context, builder, signature.args[0], arguments[0]), [arguments[1]])
        builder.store(arguments[2], builder.bitcast(address, _NUMBERS.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(array, types.intp, LANES), generate


@_or_else(lambda pairs, places, at: (pairs[places[at : at + FOUR]], pairs[places[at : at + FOUR] + 1]))
def gather(typing_context, pairs, places, at):
    """Return the first and the second numbers of four pairs of a flat array; places (uint32) count numbers."""

    def generate(context, builder, signature, arguments):
        found = [
            builder.load(_pair(context, builder, signature.args, arguments, lane), align=8) for lane in range(FOUR)
        ]
        even, odd = (_shuffled(builder, found[k], found[k + 2], 0, 1, 2, 3) for k in (0, 1))
        firsts, seconds = _shuffled(builder, even, odd, 0, 4, 2, 6), _shuffled(builder, even, odd, 1, 5, 3, 7)
        return context.make_tuple(builder, signature.return_type, [firsts, seconds])

    return types.UniTuple(LANES, 2)(pairs, places, types.intp), generate


def _set_pairs(pairs: Any, places: Any, at: int, firsts: Any, seconds: Any) -> None:
    pairs[places[at : at + FOUR]] = firsts
    pairs[places[at : at + FOUR] + 1] = seconds


@_or_else(_set_pairs)
def scatter(typing_context, pairs, places, at, firsts, seconds):
    """Write four pairs to where `gather` reads them."""

    def generate(context, builder, signature, arguments):
        even = _shuffled(builder, arguments[3], arguments[4], 0, 4, 2, 6)
        odd = _shuffled(builder, arguments[3], arguments[4], 1, 5, 3, 7)
        for lane, (source, first) in enumerate([(even, 0), (odd, 0), (even, 2), (odd, 2)]):
            one = _shuffled(builder, source, source, first, first + 1)
            builder.store(one, _pair(context, builder, signature.args, arguments, lane), align=8)
        return context.get_dummy_value()

    return types.void(pairs, places, types.intp, LANES, LANES), generate


@_or_else(lambda a, b, c: a * b + c)
def fused_lanes(typing_context, a, b, c):
    """Return a b + c, rounded once."""

    def generate(context, builder, signature, arguments):
        return _call(builder, "llvm.fma", list(arguments))

    return LANES(LANES, LANES, LANES), generate


@_or_else(np.maximum)
def larger(typing_context, a, b):
    """Return the larger one of each lane."""

    def generate(context, builder, signature, arguments):
        return builder.select(builder.fcmp_ordered(">", *arguments), *arguments)

    return LANES(LANES, LANES), generate


@_or_else(np.abs)
def magnitude(typing_context, a):
    """Return the absolute value of each lane."""

    def generate(context, builder, signature, arguments):
        return _call(builder, "llvm.fabs", list(arguments))

    return LANES(LANES), generate


def _folded(builder: Any, lanes: Any, join: Callable[..., Any]) -> Any:
    """Return the numbers of all lanes joined: first with second, third with fourth, then both."""
    one, two, three, four = (builder.extract_element(lanes, ir.Constant(ir.IntType(32), k)) for k in range(FOUR))
    return join(join(one, two), join(three, four))


@_or_else(lambda lanes: (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]))
def total(typing_context, lanes):
    """Return the sum of the lanes."""

    def generate(context, builder, signature, arguments):
        return _folded(builder, arguments[0], builder.fadd)

    return types.float64(LANES), generate


@_or_else(np.max)
def greatest(typing_context, lanes):
    """Return the greatest lane."""

    def generate(context, builder, signature, arguments):
        return _folded(builder, arguments[0], lambda a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))

    return types.float64(LANES), generate
