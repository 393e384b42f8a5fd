"""The social force of eq. 34."""

import math

import numpy as np
from numpy.typing import NDArray

from evac.base.parameters import Parameter
from evac.jit import pair_force
from evac.physics.force import Force


@pair_force
def social(gap, nx, ny, vx, vy, ex, ey, parameters):
    """Return the force of eq. 34 [N], with e_ij pointing away from j and cos phi = 1 if j is straight ahead.

    It is zero beyond the gap at which it is below the tolerance. See docs/physics.md.
    """
    if gap >= parameters[4]:
        return 0.0, 0.0
    view = 0.5
    if parameters[3] == 0.0:
        view = parameters[2] + (1.0 - parameters[2]) * 0.5 * (1.0 - (ex * nx + ey * ny))
    force = parameters[0] * math.exp(-gap / parameters[1]) * view
    return force * nx, force * ny


class SocialForce(Force):
    """Repulsive force between two people, which decreases with the distance D of their bodies.

        A exp(-D / B) [Lambda + (1 - Lambda) (1 + cos phi) / 2]

    Table 5 of the paper gives Lambda = 0 and phi = 90 degrees. Taken literally (``isotropic``), the bracket is the
    constant 1/2. With ``anisotropic``, phi is the angle to the desired direction.
    """

    name = "social"
    pair = social
    strength = Parameter(2000.0, "interaction strength A", unit="N", minimum=0.0)
    range = Parameter(0.08, "range of the interaction B", unit="m", above=0.0)
    anisotropy = Parameter(0.0, "weight Lambda of a person behind, relative to one ahead", minimum=0.0, maximum=1.0)
    reading = Parameter("isotropic", "interpretation of phi in table 5", choices=("isotropic", "anisotropic"))
    tolerance = Parameter(1.0, "force below which the interaction is neglected", unit="N", above=0.0)

    def cutoff(self) -> float:
        """Return B ln(A / tolerance), at least 0 [m]."""
        if not self.is_needed():
            return 0.0
        return max(0.0, float(self.range * math.log(self.strength / self.tolerance)))

    def is_needed(self) -> bool:
        """Return False if A = 0."""
        return bool(self.strength > 0.0)

    def packed(self) -> NDArray[np.float64]:
        """Return A, B, Lambda, whether isotropic, and the cut-off."""
        isotropic = 1.0 if self.reading == "isotropic" else 0.0
        return np.array([self.strength, self.range, self.anisotropy, isotropic, self.cutoff()])
