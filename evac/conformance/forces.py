"""Checks of forces between two people and on one person."""

import math
from collections.abc import Callable

import numpy as np

from evac.base.arrays import FloatArray
from evac.conformance.failures import CheckError, examining, require, scene
from evac.physics.force import Force
from evac.physics.parts import functions_of


def check_functions(force: Force) -> None:
    """Check the signatures of the functions, the packed parameters, and the cut-off."""
    functions_of(force)


def check_pair_force(force: Force) -> None:
    """Check that a pair force is finite, zero from its cut-off on or if not needed, and rotates with the scene."""
    with examining("its is_needed()"):
        needed = force.is_needed()
    if force.pair is None:
        return
    cutoff, random = force.cutoff(), np.random.default_rng(1)
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0):
        n, e, v = _unit(random), _unit(random), tuple(random.uniform(-3.0, 3.0, 2).tolist())
        with scene(f"two people at a gap of {gap:.3f} m"):
            x, y = _call(force, force.pair, (gap, *n, *v, *e))
            if not needed:
                wrong = f"is_needed() is False, but the force is {math.hypot(x, y):.3g} N"
                require((x, y) == (0.0, 0.0), wrong, "return True from is_needed()")
            wrong = f"the force is ({x:.3g}, {y:.3g}) N, beyond its cutoff() of {cutoff:.3f} m"
            require(gap < cutoff or (x, y) == (0.0, 0.0), wrong, "return zero there")
            turned_x, turned_y = _call(force, force.pair, (gap, -n[1], n[0], -v[1], v[0], -e[1], e[0]))
            apart = math.hypot(turned_x + y, turned_y - x)
            wrong = f"the force does not rotate with the scene, it differs by {apart:.3g} N"
            require(apart <= 1e-9 * max(math.hypot(x, y), 1.0), wrong, "use the given normal, velocity and direction")


def check_body_force(force: Force) -> None:
    """Check that a force on one person is finite, also without a wall nearby, and has no side effects."""
    if force.body is None:
        return
    cutoff, random, nothing = force.cutoff(), np.random.default_rng(1), (0.0, 0.0)
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), math.inf):
        n = _unit(random) if math.isfinite(gap) else nothing
        e = _unit(random) if gap != 0.0 else nothing  # as of a person without a way out
        speed = random.uniform(0.0, 3.0) if gap != 0.0 else 0.0
        with scene(f"a person at a gap of {gap:.3f} m to the nearest wall, at {speed:.2f} m/s"):
            velocity = speed * np.array(_unit(random))
            _call(force, force.body, (*random.uniform(-50.0, 50.0, 2), *velocity.tolist(), *e, gap, *n))


def _unit(random: np.random.Generator) -> tuple[float, float]:
    angle = random.uniform(0.0, 2.0 * math.pi)
    return math.cos(angle), math.sin(angle)


def _call(force: Force, function: Callable[..., tuple[float, float]], given: tuple[float, ...]) -> FloatArray:
    """Return the force, after checking that it is finite and leaves its parameters unchanged."""
    packed = force.packed()
    before = packed.copy()
    try:
        with np.errstate(all="ignore"):
            returned = function(*given, packed)
    except ArithmeticError as error:
        raise CheckError(f"the force is not finite: {error}", "it must be finite there") from error
    wrong = f"the function returns {returned!r}"
    require(np.shape(returned) == (2,), wrong, "return the two components of the force [N]")
    found = np.array(returned, dtype=np.float64)
    require(np.isfinite(found).all(), f"the force is ({found[0]}, {found[1]}) N", "it must be finite there")
    require(np.array_equal(packed, before), "the function changes its parameters", "only return the force")
    return found


CHECKS = (check_functions, check_pair_force, check_body_force)
