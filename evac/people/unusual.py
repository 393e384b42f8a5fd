"""Warnings about unusual properties of people, which are valid but often mistakes."""

from collections.abc import Sequence

import numpy as np
import shapely

from evac.base.errors import counted
from evac.people.population import Group
from evac.physics.extent import extent, greatest_extent
from evac.physics.state import Crowd

#: Quantities with their units and usual ranges for people.
USUAL = (
    ("speed", "m/s", 0.1, 3.0),
    ("radius", "m", 0.1, 0.5),
    ("height", "m", 0.7, 2.3),
    ("mass", "kg", 10.0, 200.0),
    ("tau", "s", 0.01, 2.0),
)

#: Initial overlaps below this are taken as rounding errors [m].
ROUNDING = 1e-6


def unusual(crowd: Crowd, groups: Sequence[Group]) -> tuple[str, ...]:
    """Return a warning for each quantity of a group outside its usual range, and one for initial overlaps."""
    notes = []
    for group in groups:
        for name, unit, low, high in USUAL:
            values = getattr(crowd, name)[group.rows]
            if ((values < low) | (values > high)).any():
                notes.append(
                    f"people.{group.name}.{name} is {values.min():.3g} to {values.max():.3g} {unit}, which is "
                    f"unusual for people ({low:g} to {high:g} {unit}): is the unit right?"
                )
    pairs, deepest = overlapping(crowd)
    if pairs:
        notes.append(
            f"{counted(pairs, 'pair')} of people overlap at the start, by up to {deepest:.2f} m: depending on the "
            "contact model, they are pushed apart or continue to overlap; correct "
            "people.NAME.positions if this is not intended"
        )
    return tuple(notes)


def overlapping(crowd: Crowd) -> tuple[int, float]:
    """Return the number of overlapping pairs of bodies and the largest overlap [m]."""
    pairs, deepest = 0, 0.0
    for level in np.unique(crowd.level[crowd.level >= 0]):
        rows = np.flatnonzero(crowd.level == level)
        position, greatest = crowd.position[rows], float(greatest_extent(crowd, rows).max())
        points = shapely.points(position)
        near = shapely.STRtree(points).query(points, predicate="dwithin", distance=2.0 * greatest)
        one, other = near[:, near[0] < near[1]]
        apart = position[one] - position[other]
        distance = np.hypot(*apart.T)
        nx, ny = (apart / np.where(distance > 0.0, distance, 1.0)[:, None]).T
        overlap = extent(crowd, rows[one], -nx, -ny) + extent(crowd, rows[other], nx, ny) - distance
        pairs += int((overlap > ROUNDING).sum())
        deepest = max(deepest, float(overlap.max(initial=0.0)))
    return pairs, deepest
