"""People keep a distance, with a force that rises linearly as the gap closes."""

from evac import Force, Parameter
from evac.jit import pair_force


@pair_force
def spring(gap, nx, ny, vx, vy, ex, ey, parameters):
    """Return strength (1 - gap / range), pushing apart, zero from `range` on."""
    strength, reach = parameters[0], parameters[1]
    if gap >= reach:
        return 0.0, 0.0
    force = strength * (1.0 - max(gap, 0.0) / reach)
    return force * nx, force * ny


class PersonalSpace(Force):
    """A spring over the gap between two people; those who overlap are pushed no harder than those who touch."""

    name = "personal_space"
    pair = spring

    strength = Parameter(100.0, "force where two people touch", unit="N", minimum=0.0)
    reach = Parameter(0.5, "gap at which it starts", unit="m", above=0.0)

    def cutoff(self):
        """Return the gap beyond which nobody feels it."""
        return self.reach


evac_interface = 3
