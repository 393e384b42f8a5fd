"""The centrifugal force of Chraibi, Seyfried and Schadschneider (2010), eq. 3: people see who is ahead of them."""

import math

from evac import Force, Parameter
from evac.jit import pair_force


@pair_force
def centrifugal(gap, nx, ny, vx, vy, ex, ey, ux, uy, mass, speed, group, parameters):
    """Return m k (eta v0 + w)^2 / d along n: w is the closing speed, k the part of the velocity towards the other."""
    towards = -(ux * nx + uy * ny)
    own = math.sqrt(ux * ux + uy * uy)
    if towards <= 0.0 or gap >= parameters[1]:
        return 0.0, 0.0
    closing = max(-(vx * nx + vy * ny), 0.0)
    force = mass * towards / own * (parameters[0] * speed + closing) ** 2 / max(gap, parameters[2])
    return force * nx, force * ny


class Centrifugal(Force):
    """A force on those who walk towards others, which grows with their closing speed and their desired speed."""

    name = "centrifugal"
    pair = centrifugal

    eta = Parameter(0.2, "weight of the desired speed", minimum=0.0, maximum=10.0)
    reach = Parameter(2.0, "gap from which on it is zero", unit="m", above=0.0)
    least = Parameter(0.1, "gap below which it grows no more", unit="m", above=0.0)

    def cutoff(self):
        """Return the gap beyond which nobody feels it."""
        return self.reach


evac_interface = 3
