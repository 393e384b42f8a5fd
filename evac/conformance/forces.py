"""Checks of forces between two people and on one person."""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager

import numpy as np

from evac.base.arrays import FloatArray
from evac.conformance.failures import CheckError, examining, scene
from evac.physics.force import Force
from evac.physics.parts import functions_of


def check_functions(force: Force) -> None:
    """Check the signatures of the functions, the packed parameters, and the cut-off."""
    functions_of(force)


def check_pair_force(force: Force) -> None:
    """Check that a pair force is finite, zero beyond its cut-off, invariant under rotation, and has no side effects."""
    if force.pair is None:
        return
    cutoff, random = force.cutoff(), np.random.default_rng(1)
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0):
        normal, ahead = random.uniform(0.0, 2.0 * math.pi, 2)
        n, e = (math.cos(normal), math.sin(normal)), (math.cos(ahead), math.sin(ahead))
        with _two_people(gap):
            x, y = _call(force, force.pair, (gap, *n, *e))
            if gap >= cutoff and (x, y) != (0.0, 0.0):
                raise CheckError(
                    f"the force is ({x:.3g}, {y:.3g}) N, beyond its cutoff() of {cutoff:.3f} m", "return zero there"
                )
            turned_x, turned_y = _call(force, force.pair, (gap, -n[1], n[0], -e[1], e[0]))
            wrong = math.hypot(turned_x + y, turned_y - x)
            if wrong > 1e-9 * max(math.hypot(x, y), 1.0):
                raise CheckError(
                    f"the force does not rotate with the scene, it differs by {wrong:.3g} N",
                    "use the given normal and direction",
                )


def check_body_force(force: Force) -> None:
    """Check that a force on one person is finite, also without a wall nearby, and has no side effects."""
    if force.body is None:
        return
    cutoff, random = force.cutoff(), np.random.default_rng(1)
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), math.inf):
        normal, ahead, going = random.uniform(0.0, 2.0 * math.pi, 3)
        n = (math.cos(normal), math.sin(normal)) if math.isfinite(gap) else (0.0, 0.0)
        e = (math.cos(ahead), math.sin(ahead)) if gap != 0.0 else (0.0, 0.0)  # as of a person without a way out
        speed = random.uniform(0.0, 3.0) if gap != 0.0 else 0.0
        v = (speed * math.cos(going), speed * math.sin(going))
        with scene(f"a person at a gap of {gap:.3f} m to the nearest wall, at {speed:.2f} m/s"):
            _call(force, force.body, (*random.uniform(-50.0, 50.0, 2), *v, *e, gap, *n))


def check_need(force: Force) -> None:
    """Check that a pair force which is not needed is zero."""
    with examining("its is_needed()"):
        needed = force.is_needed()
    if needed or force.pair is None:
        return
    for gap in np.linspace(-0.3, max(force.cutoff(), 0.1), 50):
        with _two_people(gap):
            x, y = _call(force, force.pair, (float(gap), 1.0, 0.0, 0.6, 0.8))
            if (x, y) != (0.0, 0.0):
                raise CheckError(
                    f"is_needed() is False, but the force is {math.hypot(x, y):.3g} N", "return True from is_needed()"
                )


def _two_people(gap: float) -> AbstractContextManager[None]:
    return scene(f"two people at a gap of {gap:.3f} m")


def _call(force: Force, function: Callable[..., tuple[float, float]], given: tuple[float, ...]) -> FloatArray:
    """Return the force, after checking that it is finite and leaves its parameters unchanged."""
    packed = force.packed()
    before = packed.copy()
    try:
        with np.errstate(all="ignore"):
            returned = function(*given, packed)
    except ArithmeticError as error:
        raise CheckError(f"the force is not finite: {error}", "it must be finite there") from error
    if np.shape(returned) != (2,):
        raise CheckError(f"the function returns {returned!r}", "return the two components of the force [N]")
    found = np.array(returned, dtype=np.float64)
    if not np.isfinite(found).all():
        raise CheckError(f"the force is ({found[0]}, {found[1]}) N", "it must be finite there")
    if not np.array_equal(packed, before):
        raise CheckError("the function changes its parameters", "only return the force")
    return found


FORCE_CHECKS: tuple[Callable[[Force], None], ...] = (check_functions, check_pair_force, check_body_force, check_need)
