"""Solid bodies of a mesh: the parts of their faces that people can walk on."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

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
#: Faces whose slopes differ by less than this do not cross, but touch.
PARALLEL = 0.01
#: Width of slivers that are left by overlays of faces [m].
SLIVER = 0.01


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
    free, notes = [], list[Finding]()
    low_area, places, stood, hollow = 0.0, [], list[BaseGeometry](), set[int]()
    for k, patch in enumerate(own):
        inside = _inside(patch, [own[j] for j in beside[k] if own[j].body in closed])
        hollow |= {patch.body} & set(inside)
        others = [part for body, part in inside.items() if body != patch.body]
        same = [own[j].over(patch, -TOUCHING, TOUCHING) for j in beside[k] if j < k and _is_again(own[j], patch)]
        rest = patch.without(shapely.union_all([*inside.values(), *same]))
        if patch.body not in inside:
            stood += [part for part in others if part.area > LEAST_TOP / 100.0]
        low = shapely.union_all([own[j].over(rest, _least(own[j], patch), headroom) for j in beside[k]])
        if not low.is_empty and low.area > LEAST_TOP / 100.0:
            low_area += low.area
            places.append((*place_of(low), float(rest.height(np.array([place_of(low)]))[0])))
        parts = shapely.get_parts(rest.without(low).plan)
        free += [replace(rest, plan=part) for part in parts[~shapely.is_empty(shapely.buffer(parts, -SLIVER / 2))]]
    if hollow:
        notes.append(Finding("found", f"{len(hollow)} solid bodies; people walk on their upper faces (headroom)"))
    if stood:
        text = f"{len(stood)} bodies stand on or in the ground of others and are cut out of it; one of them is here"
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


def _inside(patch: Patch, faces: Sequence[Patch]) -> dict[int, BaseGeometry]:
    """Return the parts of a patch inside each closed body: where an odd number of faces of the body lies above it."""
    inside: dict[int, BaseGeometry] = {}
    for face in faces:
        above = face.over(patch, _least(face, patch), HIGHEST)
        if not above.is_empty:
            part = inside.get(face.body, shapely.Polygon())
            inside[face.body] = flat_parts(shapely.symmetric_difference(part, above, grid_size=GRID))
    return {body: part for body, part in inside.items() if not part.is_empty}


def _is_again(one: Patch, other: Patch) -> bool:
    """Return whether two patches of different bodies are nearly parallel: where they touch, they are there twice."""
    return one.body != other.body and bool(np.hypot(*(one.rise - other.rise)) < PARALLEL)


def _least(one: Patch, other: Patch) -> float:
    """Return how far above another patch a patch begins to cover it [m]; inclined faces that cross have no gap."""
    return TOUCHING if one.body == other.body or _is_again(one, other) else 0.0


def _is_top(part: Patch) -> bool:
    """Return whether a patch is too small for a floor."""
    return part.plan.area < LEAST_TOP or bool(part.plan.buffer(-NARROWEST_TOP / 2).is_empty)


def _is_step(one: Patch, other: Patch) -> bool:
    """Return whether two patches touch in plan and differ in height by at most a riser: one may be a tread."""
    here = shapely.get_coordinates(shapely.shortest_line(one.plan, other.plan))[:1]
    return abs(float(one.height(here)[0] - other.height(here)[0])) <= MOST_RISER
