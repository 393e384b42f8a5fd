"""People who walk along a wall keep to the right."""

from evac import Force, Parameter
from evac.jit import body_force


@body_force
def to_the_right(x, y, vx, vy, ex, ey, gap, nx, ny, parameters):
    """Return a force along (ey, -ex), to the right of the desired direction, up to a distance from a wall there."""
    force, reach, distance = parameters[0], parameters[1], parameters[2]
    if gap >= reach:
        return 0.0, 0.0
    if nx * ey - ny * ex < 0.0:  # the wall is on the right
        force *= min(gap / distance - 1.0, 1.0)
    return force * ey, -force * ex


class KeepRight(Force):
    """A force to the right near a wall, until a wall on the right is at a distance."""

    name = "keep_right"
    body = to_the_right

    strength = Parameter(60.0, "force to the right", unit="N", minimum=0.0)
    reach = Parameter(1.0, "gap from which on walls have no influence", unit="m", above=0.0)
    distance = Parameter(0.3, "gap to a wall on the right at which the force is zero", unit="m", above=0.0)

    def cutoff(self):
        """Return the gap beyond which walls have no influence."""
        return self.reach


evac_interface = 3
