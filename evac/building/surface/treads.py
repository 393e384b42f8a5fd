"""Replacement of stairs drawn as treads by inclined flights."""

from dataclasses import dataclass, replace

import numpy as np
import shapely

from evac.base.arrays import FloatArray
from evac.building.geometry.overlays import GRID, flat_parts
from evac.building.model.findings import Finding
from evac.building.surface.patches import Patch

#: Range of the riser, the difference in height of consecutive treads [m].
LEAST_RISER, MOST_RISER = 0.05, 0.25
#: Maximum depth of a tread [m], and minimum number of treads of a stair.
DEEPEST, FEWEST = 0.65, 3
#: Largest gap in plan between consecutive treads, and minimum width over which they meet [m].
APART, LEAST_WIDTH = 0.04, 0.4
#: Largest distance of the centres of the treads of a flight from a straight line [m].
STRAIGHT = 0.15


@dataclass(frozen=True)
class Flight:
    """Consecutive treads from bottom to top, and the patches that they join, if there are any."""

    treads: list[Patch]
    lower: Patch | None
    upper: Patch | None


def with_flights(patches: list[Patch], headroom: float) -> tuple[list[Patch], list[Finding]]:
    """Replace every row of treads by one inclined patch.

    A flight begins at the height of the floor below its first riser and ends at the height of the floor above its last
    one, or one riser lower or higher if there is no floor. Ground with too little headroom below a flight is removed.

    Parameters
    ----------
    patches : list of Patch
    headroom : float [m]
    """
    notes, made, gone = list[Finding](), list[Patch](), list[Patch]()
    for flight in _flights(patches):
        places = np.array([tread.plan.centroid.coords[0] for tread in flight.treads])
        way = places[-1] - places[0]
        run = float(np.hypot(*way))
        x, y = places[0].tolist()
        if run > 0.0 and np.abs((places - places[0]) @ np.array([-way[1], way[0]]) / run).max() <= STRAIGHT:
            inclined = _inclined(flight, way / run)
            made.append(inclined)
            gone += flight.treads
            heights = inclined.height(shapely.get_coordinates(inclined.plan))
            text = (
                f"a flight of {len(flight.treads)} treads, from {heights.min():z.2f} to {heights.max():z.2f} m, is "
                "replaced by one inclined surface (treads)"
            )
            notes.append(Finding("assumed", text, place=(x, y, flight.treads[0].z)))
        else:
            text = (
                f"a stair of {len(flight.treads)} treads turns and is not replaced: draw it as straight flights with "
                "landings between them"
            )
            notes.append(Finding("warning", text, place=(x, y, flight.treads[0].z)))
    kept = [patch for patch in patches if not any(patch is other for other in gone)]
    for flight_ in made:
        for row, patch in enumerate(kept):
            low = shapely.union_all([flight_.over(patch, -headroom, headroom)])
            if not low.is_empty:
                kept[row] = patch.without(low)
    return [patch for patch in kept if not patch.plan.is_empty] + made, notes


def may_have_treads(heights: FloatArray) -> bool:
    """Return whether enough flat cells at heights (n,) [m] differ in height by a riser."""
    steps = np.diff(np.unique(np.round(heights, 3)))
    return bool(((steps >= LEAST_RISER) & (steps <= MOST_RISER)).sum() >= FEWEST - 1)


def _flights(patches: list[Patch]) -> list[Flight]:
    """Return the rows of treads, sorted by their lowest tread."""
    flat = [patch for patch in patches if patch.is_flat]
    is_tread = [_is_tread(patch) for patch in flat]
    plans = np.array([patch.plan for patch in flat], dtype=object)
    one, other = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=APART) if flat else ((), ())
    above: dict[int, list[int]] = {}
    beneath: dict[int, list[int]] = {}
    for a, b in zip(np.array(one).tolist(), np.array(other).tolist(), strict=True):
        is_riser = LEAST_RISER <= flat[b].z - flat[a].z <= MOST_RISER
        if (is_tread[a] or is_tread[b]) and is_riser and _meet(flat[a], flat[b]):
            above.setdefault(a, []).append(b)
            beneath.setdefault(b, []).append(a)
    flights, seen = [], set[int]()
    for first in sorted((k for k in range(len(flat)) if is_tread[k]), key=lambda k: (flat[k].z, k)):
        if first in seen:
            continue
        row = [first]
        while True:
            following = [k for k in above.get(row[-1], []) if is_tread[k] and k not in seen and k not in row]
            if len(following) != 1:
                break
            row += following
        seen |= set(row)
        if len(row) >= FEWEST:
            near = (beneath.get(row[0], []), above.get(row[-1], []))
            lower, upper = (next((flat[k] for k in ends if k not in row), None) for ends in near)
            flights.append(Flight([flat[k] for k in row], lower, upper))
    return flights


def _is_tread(patch: Patch) -> bool:
    """Return whether a flat patch has the depth and width of a tread and is not a floor."""
    is_floor = any(tag.startswith(("floor:", "area:", "obstacle:")) for tag in patch.tags)
    return not is_floor and patch.plan.buffer(-DEEPEST / 2).is_empty and patch.plan.length > 2.0 * LEAST_WIDTH


def _meet(one: Patch, other: Patch) -> bool:
    """Return whether two patches meet in plan over the width of a stair."""
    border = one.plan.boundary.intersection(other.plan.buffer(APART))
    return bool(border.length >= LEAST_WIDTH)


def _inclined(flight: Flight, way: FloatArray) -> Patch:
    """Return the plane patch that replaces a row of treads."""
    treads = flight.treads
    riser = (treads[-1].z - treads[0].z) / (len(treads) - 1)
    z_lower = treads[0].z - riser if flight.lower is None else flight.lower.z
    z_upper = treads[-1].z + riser if flight.upper is None else flight.upper.z
    joined = shapely.union_all([tread.plan.buffer(APART, join_style="mitre") for tread in treads])
    plan = joined.buffer(-APART, join_style="mitre")
    for floor in (flight.lower, flight.upper):
        if floor is not None:
            plan = shapely.snap(plan, floor.plan, APART)
    plan = flat_parts(shapely.set_precision(plan, GRID))
    along = shapely.get_coordinates(plan) @ way
    rise = (z_upper - z_lower) / float(along.max() - along.min()) * way
    tags = frozenset(tag for tag in treads[0].tags if all(tag in tread.tags for tread in treads))
    return replace(treads[0], tags=tags, plan=plan, rise=rise, z=float(z_lower - along.min() * np.hypot(*rise)))
