"""Checks of functions of numbers: forces on one person and between two, and laws of the speed in smoke."""

import math
from collections.abc import Callable

import numpy as np

from evac.base.arrays import FloatArray
from evac.conditions.law import SmokeLaw
from evac.conformance.failures import CheckError, examining, require, require_close, scene
from evac.physics.force import Force
from evac.physics.parts import functions_of

#: Desired speeds [m/s], and extinction coefficients [1/m] from clear air to smoke in which nothing is seen.
SPEEDS = (0.0, 0.2, 0.8, 1.25, 2.0)
SMOKE = (0.0, 0.01, 0.1, 0.5, 1.0, 3.0, 10.0, 100.0)


def check_force(force: Force) -> None:
    """Check the signatures of the functions, the packed parameters, and the forces.

    They must be finite, also without a wall nearby or a way out. Those between two people must be zero from the cut-off
    on or if the force is not needed, and rotate with the scene.
    """
    functions_of(force)
    with examining("its is_needed()"):
        needed = force.is_needed()
    cutoff, random, nothing = force.cutoff(), np.random.default_rng(1), np.zeros(2)
    gaps = (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0)
    for gap in gaps if force.pair is not None else ():
        n, e, v = _unit(random), _unit(random), random.uniform(-3.0, 3.0, 2)
        with scene(f"two people at a gap of {gap:.3f} m"):
            x, y = push = _call(force, force.pair, gap, n, v, e)
            told = f"is_needed() is False, but the force is {math.hypot(x, y):.3g} N; return True from is_needed()"
            require(needed or not push.any(), told)
            told = f"the force is ({x:.3g}, {y:.3g}) N, beyond its cutoff() of {cutoff:.3f} m; return zero there"
            require(gap < cutoff or not push.any(), told)
            told = "the force does not rotate with the scene, it differs by {:.3g} N; use the given normal, "
            turned = _call(force, force.pair, gap, *(np.array([-y, x]) for x, y in (n, v, e)))
            require_close(turned, [-y, x], 1e-9 * max(math.hypot(x, y), 1.0), f"{told}velocity and direction")
    for gap in (*gaps, math.inf) if force.body is not None else ():
        n, e, v, place = _unit(random), _unit(random), random.uniform(-3.0, 3.0, 2), random.uniform(-50.0, 50.0, 2)
        if gap == 0.0:  # a person who stands, without a way out
            e = v = nothing
        with scene(f"a person at a gap of {gap:.3f} m to the nearest wall, at {math.hypot(*v):.2f} m/s"):
            _call(force, force.body, *place, v, e, gap, n if math.isfinite(gap) else nothing)


def _unit(random: np.random.Generator) -> FloatArray:
    angle = random.uniform(0.0, 2.0 * math.pi)
    return np.array([math.cos(angle), math.sin(angle)])


def _call(force: Force, function: Callable[..., tuple[float, float]], *given: float | FloatArray) -> FloatArray:
    """Return the force, after checking that it is finite and leaves its parameters unchanged."""
    packed = force.packed()
    before = packed.copy()
    try:
        with np.errstate(all="ignore"):
            returned = function(*np.hstack(given).tolist(), packed)
    except ArithmeticError as error:
        raise CheckError(f"the force is not finite: {error}; it must be finite there") from error
    told = f"the function returns {returned!r}; return the two components of the force [N]"
    require(np.shape(returned) == (2,), told)
    require(np.isfinite(returned).all(), "the force is ({}, {}) N; it must be finite there".format(*returned))
    require(np.array_equal(packed, before), "the function changes its parameters; only return the force")
    return np.array(returned, dtype=np.float64)


def check_speeds(law: SmokeLaw) -> None:
    """Check that speeds in smoke are finite, the desired ones in clear air, and of each person alone."""
    desired, extinction = given = np.array(np.meshgrid(SPEEDS, SMOKE)).reshape(2, -1)
    before, is_clear = given.copy(), extinction == 0.0
    with examining("its speed()"):
        speed = np.asarray(law.speed(desired, extinction))
        told = f"returns {speed.shape}, not {desired.shape}; return one for each person"
        require(speed.shape == desired.shape, told)
        told = "returns a speed that is not finite; check extinction coefficients of 0"
        require(np.isfinite(speed).all(), told)
        require(np.array_equal(given, before), "changes its arguments; return a new array")
        told = "slows people in clear air; return the desired speeds where K is 0"
        require((np.clip(speed, 0.0, desired) == desired)[is_clear].all(), told)
        alone = [law.speed(desired[k : k + 1], extinction[k : k + 1])[0] for k in range(len(speed))]
        told = "gives a person another speed if others are there; use only the values of each person"
        require(np.array_equal(speed, alone), told)
