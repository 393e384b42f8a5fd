"""Compiled kernels, which are cached on disk, and the memory that they share with Python."""

from collections.abc import Callable
from typing import Any

from evac.jit.kernels import AddressCall as AddressCall
from evac.jit.kernels import ByteGrid as ByteGrid
from evac.jit.kernels import Bytes as Bytes
from evac.jit.kernels import Callback as Callback
from evac.jit.kernels import Entry as Entry
from evac.jit.kernels import FloatGrid as FloatGrid
from evac.jit.kernels import Floats as Floats
from evac.jit.kernels import Indices as Indices
from evac.jit.kernels import IntGrid as IntGrid
from evac.jit.kernels import IntPairs as IntPairs
from evac.jit.kernels import Intrinsic as Intrinsic
from evac.jit.kernels import Ints as Ints
from evac.jit.kernels import Kernel as Kernel
from evac.jit.kernels import Longs as Longs
from evac.jit.kernels import Pairs as Pairs
from evac.jit.kernels import Quads as Quads
from evac.jit.kernels import Struct as Struct
from evac.jit.kernels import Triples as Triples
from evac.jit.kernels import inlined as inlined
from evac.jit.kernels import inner as inner
from evac.jit.kernels import kernel as kernel

#: Return a b + c, rounded once (fused multiply-add): identical on all processors, with half the latency.
fused = Intrinsic("fused", lambda a, b, c: a * b + c)

#: Return row k of a grid as an array.
row = Intrinsic("row", lambda grid, k: grid[k])

#: Call the pair force at an address with gap, nx, ny, vx, vy, ex, ey and its parameters: (fx, fy) [N].
call_pair_force = AddressCall([*[float] * 7, Floats], (float, float))

#: The same with the velocity, the mass [kg], the desired speed [m/s] and the group of the person before its parameters.
call_person_force = AddressCall([*[float] * 11, int, Floats], (float, float))

#: Call the body force at an address with x, y, vx, vy, ex, ey, gap, nx, ny and its parameters: (fx, fy) [N].
call_body_force = AddressCall([*[float] * 9, Floats], (float, float))

#: Signature of the law of a contact: gap, closing speed, reduced mass and its parameters to a force [N].
call_pair_contact = AddressCall([float, float, float, Floats], (float,))

#: Signature of the law of a contact with friction: gap, closing and sliding speed, reduced mass, time, memory and its
#: parameters to a force along the normal and one along the tangent [N].
call_pair_friction = AddressCall([float, float, float, float, float, Floats, Floats], (float, float))


def pair_force(function: Callable[..., Any]) -> Entry:
    """Compile a force between two people with the signature that the step loop calls.

    Parameters
    ----------
    function : callable
        ``force(gap, nx, ny, vx, vy, ex, ey, parameters) -> (fx, fy)``: the force [N] on person i from person
        j, with the gap D_ij [m], the unit vector (nx, ny) from j to i, the velocity (vx, vy) of i relative to j
        [m/s], the desired direction (ex, ey) of i and the force's own parameters, a float64 array. Or
        ``force(gap, nx, ny, vx, vy, ex, ey, ux, uy, mass, speed, group, parameters)``, with the velocity (ux, uy) of i
        in plan [m/s], its mass [kg], its desired speed in plan [m/s] and the index of its group.

    Returns
    -------
    Entry
        Kernels call its ``address``. A call from Python runs the function.
    """
    is_long = function.__code__.co_argcount == len(call_person_force.kinds)
    return Entry(function, call_person_force if is_long else call_pair_force)


def body_force(function: Callable[..., Any]) -> Entry:
    """Compile a force on one person with the signature that the step loop calls.

    Parameters
    ----------
    function : callable
        ``force(x, y, vx, vy, ex, ey, gap, nx, ny, parameters) -> (fx, fy)``: the force [N] on a person at (x, y) [m]
        with the velocity (vx, vy) [m/s] and the desired direction (ex, ey), in plan. `gap` [m] is the distance from
        the body to the nearest wall, and (nx, ny) the unit vector from there towards the person; they are infinity
        and (0, 0) if no wall is closer than the cut-off of the force. `parameters` is a float64 array with the
        parameters of the force.

    Returns
    -------
    Entry
        Kernels call its ``address``. A call from Python runs the function.
    """
    return Entry(function, call_body_force)


def pair_contact(function: Callable[..., Any]) -> Entry:
    """Declare the force of a single contact, which is compiled together with the loop of `evac.PairContact`.

    Parameters
    ----------
    function : callable
        ``law(gap, closing_speed, reduced_mass, parameters) -> force``: the repulsive force [N] of two people who
        overlap, or of a person and a wall, along their normal. `gap` [m] is negative or zero: the negative overlap.
        The closing speed [m/s] is positive while the overlap increases. 1 / reduced mass is 1/m_i + 1/m_j [1/kg], and
        1/m_i at a wall. `parameters` is a float64 array with the parameters of the model.

    Returns
    -------
    Entry
        For `evac.PairContact.pair`. Its attribute ``function`` is the Python function.
    """
    return Entry(function, call_pair_contact)


def pair_friction(function: Callable[..., Any]) -> Entry:
    """Declare the two forces of a single contact, which may depend on what it remembers, for `evac.PairContact`.

    Parameters
    ----------
    function : callable
        ``law(gap, closing_speed, sliding_speed, reduced_mass, elapsed, memory, parameters) -> (force, friction)``: the
        repulsive force [N] as of `pair_contact`, and the force [N] along the tangent. The sliding speed [m/s] is that
        of the person along the tangent (-ny, nx), relative to the other person or the wall, with the unit normal
        towards the person; friction is that on the person, so that it brakes with the opposite sign. During `elapsed`
        [s], the part of the last sub-step in which the bodies overlapped, they had these speeds. `memory` is a float64
        array with the numbers that `ContactModel.memory` names, to be replaced by their values now.

    Returns
    -------
    Entry
        For `evac.PairContact.pair`. Its attribute ``function`` is the Python function.
    """
    return Entry(function, call_pair_friction)
