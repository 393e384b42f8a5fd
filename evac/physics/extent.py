"""The shape of bodies: how far a body extends from its centre, in every direction, for all contacts.

Bodies are discs. For another shape, such as an ellipse across the desired direction, these two functions change, and
nothing else in contacts, forces at a distance, neighbour lists and contact models. `Bodies` then needs the arrays that
they read, see docs/contributing.md.
"""

from evac.jit import inlined


@inlined
def extent(bodies, i, nx, ny):
    """Return the distance from the centre of body i to its surface in the direction of the unit vector (nx, ny) [m].

    `bodies` has the arrays of `Bodies` or of a `Crowd`. From Python, `i`, `nx` and `ny` may be arrays.
    """
    return bodies.contact_radius[i]


@inlined
def greatest_extent(bodies, i):
    """Return the radius of the smallest circle around the centre of body i that contains the body [m]."""
    return bodies.contact_radius[i]
