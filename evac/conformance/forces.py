"""Checks of forces between two people and on one person."""

import math
from collections.abc import Callable

import numpy as np

from evac.arrays import FloatArray
from evac.errors import PluginError
from evac.jit import call_body_force, call_pair_force
from evac.physics.force import Force


def check_parameters(force: Force) -> None:
    """Check the signatures of the functions, the packed parameters, and the cut-off."""
    packed, cutoff = force.packed(), force.cutoff()
    if packed.dtype != np.float64 or packed.ndim != 1 or not np.isfinite(packed).all():
        raise PluginError(f"packed() must return finite numbers in one float64 row, not {packed!r}")
    if force.pair is None and force.body is None:
        raise PluginError("it names no function; define `pair` or `body`, see docs/plugins.md")
    for function, call, name in ((force.pair, call_pair_force, "pair"), (force.body, call_body_force, "body")):
        if function is not None:
            call.check(function, name)
    if not (math.isfinite(cutoff) and cutoff >= 0.0):
        raise PluginError(f"cutoff() is {cutoff} m; it must be finite and not negative")


def check_pair_force(force: Force) -> None:
    """Check that a pair force is finite, zero beyond its cut-off, invariant under rotation, and has no side effects."""
    if force.pair is None:
        return
    cutoff, random = force.cutoff(), np.random.default_rng(1)
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0):
        normal, ahead = random.uniform(0.0, 2.0 * math.pi, 2)
        n, e = (math.cos(normal), math.sin(normal)), (math.cos(ahead), math.sin(ahead))
        scene = f"two people at a gap of {gap:.3f} m"
        x, y = _call(force, force.pair, (gap, *n, *e), scene)
        if gap >= cutoff and (x, y) != (0.0, 0.0):
            raise PluginError(
                f"{scene}: the force is ({x:.3g}, {y:.3g}) N, beyond its cutoff() of {cutoff:.3f} m; return zero there"
            )
        turned_x, turned_y = _call(force, force.pair, (gap, -n[1], n[0], -e[1], e[0]), scene)
        if math.hypot(turned_x + y, turned_y - x) > 1e-9 * max(math.hypot(x, y), 1.0):
            raise PluginError(f"{scene}: does not rotate with the scene; use the given normal and direction")


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
        scene = f"a person at a gap of {gap:.3f} m to the nearest wall, at {speed:.2f} m/s"
        _call(force, force.body, (*random.uniform(-50.0, 50.0, 2), *v, *e, gap, *n), scene)


def check_need(force: Force) -> None:
    """Check that a pair force which is not needed is zero."""
    if force.is_needed() or force.pair is None:
        return
    for gap in np.linspace(-0.3, max(force.cutoff(), 0.1), 50):
        x, y = _call(force, force.pair, (float(gap), 1.0, 0.0, 0.6, 0.8), f"two people at a gap of {gap:.3f} m")
        if (x, y) != (0.0, 0.0):
            raise PluginError(
                f"two people at a gap of {gap:.3f} m: is_needed() must not be False, since the force is"
                f" {math.hypot(x, y):.3g} N"
            )


def _call(
    force: Force, function: Callable[..., tuple[float, float]], given: tuple[float, ...], scene: str
) -> FloatArray:
    """Return the force, after checking that it is finite and leaves its parameters unchanged."""
    packed = force.packed()
    before = packed.copy()
    try:
        with np.errstate(all="ignore"):
            found = np.array(function(*given, packed), dtype=np.float64)
    except ArithmeticError as error:
        raise PluginError(f"{scene}: {error}; it must be finite there") from error
    if not np.isfinite(found).all():
        raise PluginError(f"{scene}: the force is ({found[0]}, {found[1]}) N; it must be finite there")
    if not np.array_equal(packed, before):
        raise PluginError(f"{scene}: changes its parameters; only return the force")
    return found


FORCE_CHECKS: tuple[Callable[[Force], None], ...] = (check_parameters, check_pair_force, check_body_force, check_need)
