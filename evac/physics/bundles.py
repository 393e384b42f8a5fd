"""The arrays that kernels work on, bundled by owner. float64, int32, uint8; contiguous; checked at the border."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int32]
ByteArray = NDArray[np.uint8]


class Crowd(NamedTuple):
    """Everybody; row p is person p and never moves. Who writes what stands in docs/architecture.md.

    Attributes
    ----------
    position, velocity : (n, 2) [m], [m/s], in plan. Written by the contact model only.
    level : (n,) int32, -1 once out. Written by the contact model only.
    radius, mass, tau : (n,) [m], [kg], [s]
    speed : (n, 3) desired speeds on the flat, up and down stairs, along the slope [m/s]
    group : (n,) int32
    start_time : (n,) time at which a person sets off [s]; written by behaviours
    route : (n,) int32, row of ``Fields.routes``; written by behaviours
    speed_factor : (n,), set to 1 before each tick's behaviours, which multiply it
    extra_direction : (n, 2), set to 0 before each tick's behaviours, which add to it; the unit
        direction of the field plus this, normalised, is the desired direction
    exit_time : (n,) [s], NaN until out;  exit_used : (n,) int32, -1 until out
    distance : (n,) walked in plan [m];  contact_force : (n,) sum of contact forces at the last output step [N]
    """

    position: FloatArray
    velocity: FloatArray
    level: IntArray
    radius: FloatArray
    mass: FloatArray
    tau: FloatArray
    speed: FloatArray
    group: IntArray
    start_time: FloatArray
    route: IntArray
    speed_factor: FloatArray
    extra_direction: FloatArray
    exit_time: FloatArray
    exit_used: IntArray
    distance: FloatArray
    contact_force: FloatArray


class World(NamedTuple):
    """The scene as kernels read it: walls, links (portals and exits), levels, fields.

    A link is a portal (0 .. n_portals-1) or an exit (n_portals + exit index). Each portal segment
    stands here twice, once for each level, oriented with that level's inside on its left.
    """

    wall: FloatArray  # (w, 4)
    wall_level: IntArray  # (w,)
    wall_open: ByteArray  # (w,) 1: not there
    link_segment: FloatArray  # (s, 4)
    link_level: IntArray  # (s,) level it is seen from
    link_to: IntArray  # (s,) level behind it, -1 outside
    link_id: IntArray  # (s,)
    link_open: ByteArray  # (portals + exits,) 0: closed, acts as a wall
    uphill: FloatArray  # (levels, 2) unit plan vector, zero on the flat
    cosine: FloatArray  # (levels,) cosine of the slope
    linked: ByteArray  # (levels, levels) 1: same level or at most two portals apart
    grid_origin: FloatArray  # (levels, 2) [m] plan position of node (0, 0)
    grid_shape: IntArray  # (levels, 2) nodes along x and y
    grid_spacing: float  # [m]
    field_of: IntArray  # (levels, routes) row of field_offset, -1: no way out from here
    field_offset: NDArray[np.int64]  # (fields,) first node in the packed arrays; node (ix, iy) at + ix * ny + iy
    direction: FloatArray  # (nodes, 2) unit vectors
    travel_time: FloatArray  # (nodes,) [s]
