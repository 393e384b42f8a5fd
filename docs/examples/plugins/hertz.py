"""The contact of elastic spheres (Hertz, 1882), with a damper."""

import math

from evac import PairContact, Parameter
from evac.jit import pair_contact


@pair_contact
def hertz(gap, closing_speed, reduced_mass, parameters):
    """Return K D sqrt(D) + c w with the overlap D = -gap and the closing speed w."""
    return -parameters[0] * gap * math.sqrt(-gap) + parameters[1] * closing_speed


class Hertz(PairContact):
    """Force max(0, K D^(3/2) + c w) along the line of centres, with a stiffness that increases with the overlap."""

    name = "hertz"
    pair = hertz
    stiffness = Parameter(1e6, "stiffness K", unit="N/m^1.5", above=0.0)
    damping = Parameter(0.0, "damping c", unit="kg/s", minimum=0.0)


evac_interface = 3
