"""Broken forces between two people and on one person."""

import numpy as np

from evac.base.parameters import Parameter
from evac.contract.registry import Registry
from evac.jit import body_force, pair_force
from evac.physics.force import Force
from tests.conformance.broken import Broken, odd


@pair_force
def constant(gap, nx, ny, vx, vy, ex, ey, parameters):
    return parameters[0] * nx, parameters[0] * ny


@pair_force
def eastward(gap, nx, ny, vx, vy, ex, ey, parameters):
    if gap >= 1.0:
        return 0.0, 0.0
    return parameters[0], 0.0


@pair_force
def singular(gap, nx, ny, vx, vy, ex, ey, parameters):
    if gap >= 1.0:
        return 0.0, 0.0
    return nx / abs(gap), ny / abs(gap)


class Constant(Force):
    """Never ends."""

    name = "constant"
    pair = constant
    strength = Parameter(1.0, "strength", unit="N")

    def cutoff(self):
        return 1.0


class Eastward(Constant):
    """Does not turn."""

    name = "eastward"
    pair = eastward


class Singular(Constant):
    """Is infinite where people touch."""

    name = "singular"
    pair = singular


@body_force
def towards_walls(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    return -parameters[0] * nx / gap, -gap * ny


class TowardsWalls(Constant):
    """Is infinite at a wall."""

    name = "towards_walls"
    pair = None
    body = towards_walls


class Denied(Eastward):
    """Says that it is not needed, and pushes."""

    name = "denied"
    pair = Registry().forces["social"].pair

    def packed(self):
        return np.array([1.0, 0.1, 0.0, 1.0, 1.0])

    def is_needed(self):
        return False


@pair_force
def zero(gap, nx, ny, vx, vy, ex, ey, parameters):
    return 0.0, 0.0


@pair_force
def scribbles(gap, nx, ny, vx, vy, ex, ey, parameters):
    parameters[0] += 1.0
    return 0.0, 0.0


class Sound(Constant):
    """Is zero everywhere."""

    name = "sound"
    pair = zero


PAIR, PERSON = "scene 'two people at a gap of", "scene 'a person at a gap of"

BROKEN = [
    Broken(Constant, "check_force", PAIR, r"N, beyond its cutoff\(\) of 1.000 m; return zero"),
    Broken(Eastward, "check_force", PAIR, "rotate .* by .* N; use the given normal"),
    Broken(Singular, "check_force", f"{PAIR} 0.000", "division by zero", ZeroDivisionError),
    Broken(TowardsWalls, "check_force", f"{PERSON} 0.000", "must be finite there"),
    Broken(Denied, "check_force", PAIR, r"is_needed\(\) is False, but the force is .* N"),
    Broken(odd(Sound, pair=scribbles), "check_force", PAIR, "changes its parameters; only return"),
]
