"""Checks of forces at a distance."""

import math

import numpy as np

from evac.errors import PluginError
from evac.jit import call_pair_force
from evac.physics.force import Force


def check_pair_force(force: Force) -> None:
    """Check that a pair force is finite, zero beyond its cut-off, invariant under rotation, and has no side effects."""
    packed = force.packed()
    if packed.dtype != np.float64 or packed.ndim != 1 or not np.isfinite(packed).all():
        raise PluginError(f"{force.name}: packed() must return finite numbers in one float64 row, not {packed!r}")
    call_pair_force.check(getattr(force, "pair", None), f"{force.name}: pair")
    cutoff = force.cutoff()
    if not (math.isfinite(cutoff) and cutoff >= 0.0):
        raise PluginError(f"{force.name}: cutoff() is {cutoff} m; it must be finite and not negative")
    before = packed.copy()
    random = np.random.default_rng(1)
    greatest = 0.0
    for gap in (-0.3, 0.0, *random.uniform(-0.3, max(cutoff, 0.1), 100), cutoff, cutoff + 1e-9, 2.0 * cutoff + 1.0):
        normal, ahead = random.uniform(0.0, 2.0 * math.pi, 2)
        n, e = (math.cos(normal), math.sin(normal)), (math.cos(ahead), math.sin(ahead))
        try:
            x, y = force.pair(gap, *n, *e, packed)
        except ArithmeticError as error:
            raise PluginError(f"{force.name}: {error} at a gap of {gap:.3f} m; it must be finite there") from error
        if not (math.isfinite(x) and math.isfinite(y)):
            raise PluginError(f"{force.name}: is ({x}, {y}) N at a gap of {gap:.3f} m; it must be finite there")
        if gap >= cutoff and (x, y) != (0.0, 0.0):
            raise PluginError(
                f"{force.name}: is ({x:.3g}, {y:.3g}) N at {gap:.3f} m, beyond its cutoff() of {cutoff:.3f} m"
            )
        turned_x, turned_y = force.pair(gap, -n[1], n[0], -e[1], e[0], packed)
        size = math.hypot(x, y)
        greatest = max(greatest, size)
        if math.hypot(turned_x + y, turned_y - x) > 1e-9 * max(size, 1.0):
            raise PluginError(f"{force.name}: does not rotate with the scene; use the given normal and direction")
    if not np.array_equal(packed, before):
        raise PluginError(f"{force.name}: changes its parameters; only return the force")
    if greatest > 0.0 and not force.is_needed():
        raise PluginError(f"{force.name}: is_needed() must not be False, since the force reaches {greatest:.3g} N")
