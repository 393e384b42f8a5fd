"""Compiled kernels, which are cached on disk, and the memory that they share with Python."""

from collections.abc import Callable
from typing import Any

from evac.jit.kernels import AddressCall, Entry, Intrinsic, Kernel, inner, kernel
from evac.jit.layout import (
    ByteGrid,
    Bytes,
    FloatGrid,
    Floats,
    Indices,
    IntGrid,
    IntPairs,
    Ints,
    Longs,
    Pairs,
    Quads,
    Struct,
    Triples,
)

__all__ = [
    "AddressCall",
    "ByteGrid",
    "Bytes",
    "Entry",
    "FloatGrid",
    "Floats",
    "Indices",
    "IntGrid",
    "IntPairs",
    "Intrinsic",
    "Ints",
    "Kernel",
    "Longs",
    "Pairs",
    "Quads",
    "Struct",
    "Triples",
    "call_pair_force",
    "fused",
    "inner",
    "kernel",
    "pair_force",
    "row",
]

#: Return a b + c, rounded once (fused multiply-add): identical on all processors, with half the latency.
fused = Intrinsic("fused", lambda a, b, c: a * b + c)

#: Return row k of a grid as an array.
row = Intrinsic("row", lambda grid, k: grid[k])

#: Call the pair force at an address with gap, nx, ny, ex, ey and its parameters: (fx, fy) [N].
call_pair_force = AddressCall([float, float, float, float, float, Floats], (float, float))


def pair_force(function: Callable[..., Any]) -> Entry:
    """Compile a force between two people with the signature that the step loop calls.

    Parameters
    ----------
    function : callable
        ``force(gap, nx, ny, ex, ey, parameters) -> (fx, fy)``: the force [N] on person i from person
        j, with the gap D_ij [m], the unit vector (nx, ny) from j to i, the desired direction
        (ex, ey) of i and the force's own parameters, a float64 array.

    Returns
    -------
    Entry
        Kernels call its ``address``. A call from Python runs the function.
    """
    return Entry(function, call_pair_force)
