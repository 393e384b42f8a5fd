"""Kernels, compiled once and kept on disk, and the memory that they share with Python."""

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
    "acquire",
    "call_pair_force",
    "fused",
    "inner",
    "kernel",
    "pair_force",
    "pause",
    "release",
    "row",
]

#: Return a b + c, rounded once: the same bits on every processor, in half the latency of two instructions.
fused = Intrinsic("fused", lambda a, b, c: a * b + c)

#: Return row k of a grid as an array.
row = Intrinsic("row", lambda grid, k: grid[k])

#: Read and write number k of an array that another thread writes and reads: what it wrote before is seen after.
acquire = Intrinsic("acquire", lambda array, k: array[k])
release = Intrinsic("release", lambda array, k, value: array.__setitem__(k, value))

#: Let the processor rest for a moment in a loop that waits for another thread.
pause = Intrinsic("pause", lambda: 0)

#: Call the pair force at an address with gap, nx, ny, ex, ey and its parameters: (fx, fy) [N].
call_pair_force = AddressCall([float, float, float, float, float, Floats], (float, float))


def pair_force(function: Callable[..., Any]) -> Entry:
    """Make a kernel of a force between two people, of the one signature that the step loop can call.

    Parameters
    ----------
    function : callable
        ``force(gap, nx, ny, ex, ey, parameters) -> (fx, fy)``: the force [N] on person i from person
        j, with the gap D_ij [m], the unit vector (nx, ny) from j to i, the desired direction
        (ex, ey) of i and the force's own parameters, a float64 array.

    Returns
    -------
    Entry
        Its ``address`` is what kernels call. Called from Python it runs the function.
    """
    return Entry(function, call_pair_force)
