"""Solid bodies of a mesh: the parts of their faces that people can walk on."""

from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import IndexArray
from evac.building.geometry.overlays import GRID, flat_parts, place_of
from evac.building.model.findings import Finding
from evac.building.surface.patches import Patch
from evac.building.surface.treads import APART, MOST_RISER

#: Faces whose heights differ by at most this are in contact [m].
TOUCHING = 0.02
#: Minimum area [m2] and width [m] of ground on a body; smaller faces are tops of walls or furniture.
LEAST_TOP, NARROWEST_TOP = 1.0, 0.6
#: Largest vertical distance of faces of a body that is searched [m].
HIGHEST = 1e3


def closed_bodies(triangles: IndexArray, body: IndexArray) -> set[int]:
    """Return the closed bodies, which enclose a volume: all of their edges have an even number of cells."""
    sides = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, row, uses = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    is_open = uses[row.ravel()] % 2 == 1
    return set(body.tolist()) - set(np.tile(body, 3)[is_open].tolist())


def walked_on(
    patches: list[Patch], solid: set[int], closed: set[int], headroom: float
) -> tuple[list[Patch], list[Finding]]:
    """Return the parts of patches that people can walk on: outside of bodies and with enough headroom.

    Parameters
    ----------
    patches : list of Patch
    solid, closed : sets of int
        Bodies with upright faces, and those of them that enclose a volume.
    headroom : float [m]
    """
    own = [patch for patch in patches if patch.body in solid]
    beside = _beside(own)
    inner = [_inside(own, k, beside[k]) if own[k].body in closed else shapely.Polygon() for k in range(len(own))]
    free, notes = [], list[Finding]()
    low_area, places, stood = 0.0, [], list[BaseGeometry]()
    for k, patch in enumerate(own):
        standing = [replace(own[j], plan=inner[j]) for j in beside[k] if own[j].body != patch.body]
        feet = [one.over(patch, -TOUCHING, TOUCHING) for one in standing if not one.plan.is_empty]
        rest = patch.without(inner[k]).without(shapely.union_all(feet))
        stood += [foot for foot in feet if foot.area > LEAST_TOP / 100.0]
        low = shapely.union_all([own[j].over(rest, TOUCHING, headroom) for j in beside[k]])
        if not low.is_empty and low.area > LEAST_TOP / 100.0:
            low_area += low.area
            places.append((*place_of(low), float(rest.height(np.array([place_of(low)]))[0])))
        free += [replace(rest, plan=part) for part in shapely.get_parts(rest.without(low).plan)]
    bodies = len({patch.body for patch, inside in zip(own, inner, strict=True) if not inside.is_empty})
    if bodies:
        notes.append(Finding("found", f"{bodies} solid bodies; people walk on their upper faces (headroom)"))
    if stood:
        text = f"{len(stood)} bodies stand on the ground of others and are cut out of it; one of them is here"
        notes.append(Finding("found", text, place=place_of(stood[0])))
    if low_area:
        text = f"{low_area:.2f} m2 of ground with less headroom than {headroom:g} m; the first part is here (headroom)"
        notes.append(Finding("left out", text, place=places[0]))
    beside = _beside(free)
    is_top = [_is_top(part) and not any(_is_step(part, free[j]) for j in beside[k]) for k, part in enumerate(free)]
    if any(is_top):
        first = free[is_top.index(True)]
        place = place_of(first.plan)
        text = f"{sum(is_top)} faces too small for floors, such as tops of walls and furniture; the first one is here"
        notes.append(Finding("left out", text, place=(*place, float(first.height(np.array([place]))[0]))))
    kept = [part for part, top in zip(free, is_top, strict=True) if not top]
    return [patch for patch in patches if patch.body not in solid] + kept, notes


def _beside(patches: list[Patch]) -> list[list[int]]:
    """Return, for each patch, the other patches that it touches in plan."""
    plans = np.array([patch.plan for patch in patches], dtype=object)
    neighbours: list[list[int]] = [[] for _ in patches]
    if patches:
        one, other = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=APART)
        for a, b in sorted(zip(one.tolist(), other.tolist(), strict=True)):
            if a != b:
                neighbours[a].append(b)
    return neighbours


def _inside(own: list[Patch], k: int, beside: list[int]) -> BaseGeometry:
    """Return the part of a patch inside its body: where an odd number of faces of the body lies above it."""
    inside: BaseGeometry = shapely.Polygon()
    for other in (own[j] for j in beside if own[j].body == own[k].body):
        above = other.over(own[k], TOUCHING, HIGHEST)
        if not above.is_empty:
            inside = flat_parts(shapely.symmetric_difference(inside, above, grid_size=GRID))
    return inside


def _is_top(part: Patch) -> bool:
    """Return whether a patch is too small for a floor."""
    return part.plan.area < LEAST_TOP or bool(part.plan.buffer(-NARROWEST_TOP / 2).is_empty)


def _is_step(one: Patch, other: Patch) -> bool:
    """Return whether two patches touch in plan and differ in height by at most a riser: one may be a tread."""
    here = shapely.get_coordinates(shapely.shortest_line(one.plan, other.plan))[:1]
    return abs(float(one.height(here)[0] - other.height(here)[0])) <= MOST_RISER
