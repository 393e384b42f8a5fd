"""Walkable surfaces of meshes from other tools, with solid bodies and with stairs drawn as treads."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import BoolArray, FloatArray, IndexArray
from evac.base.errors import BuildingError, counted
from evac.building.geometry import GRID, connected_components, flat_parts, least_height, place_of
from evac.building.model.findings import Finding
from evac.building.options import SurfaceOptions
from evac.building.surface.patches import Patch, bodies, closed_bodies, patches_of
from evac.building.surface.surfacemesh import SurfaceMesh, TriangleMesh
from evac.building.surface.welding import weld_points

#: Faces whose heights differ by at most this are in contact [m].
TOUCHING = 0.02
#: Minimum area [m2] and width [m] of ground on a body; smaller faces are tops of walls or furniture.
LEAST_TOP, NARROWEST_TOP = 1.0, 0.6
#: Least height of walls and guard rails above a floor [m].
RAIL = 0.8
#: Largest vertical distance of faces of a body that is searched [m].
HIGHEST = 1e3
#: Faces whose slopes differ by less than this do not cross, but touch.
PARALLEL = 0.01
#: Width of slivers that are left by overlays of faces [m].
SLIVER = 0.01
#: Range of the riser, the difference in height of consecutive treads [m].
LEAST_RISER, MOST_RISER = 0.05, 0.25
#: Maximum depth of a tread [m], and minimum number of treads of a stair.
DEEPEST, FEWEST = 0.65, 3
#: Largest gap in plan between consecutive treads [m].
BETWEEN = 0.1
#: Treads turn if the directions between consecutive ones differ from their mean by more than this [degrees].
MOST_TURN = 25.0
#: Largest gap in plan between faces that touch, and minimum width over which a flight meets a floor [m].
APART, LEAST_WIDTH = 0.04, 0.4


def turned(mesh: TriangleMesh, up: str) -> TriangleMesh:
    """Rotate a mesh so that its axis `up` becomes z."""
    if up == "z":
        return mesh
    doors = [(name, _turned(np.asarray(ends))) for name, ends in mesh.given.doors]
    return replace(mesh, points=_turned(mesh.points), given=replace(mesh.given, doors=doors))


def _turned(points: FloatArray) -> FloatArray:
    x, y, z = points.T
    return np.ascontiguousarray(np.column_stack([x, -z, y]) + 0.0)


def walked_surface(
    mesh: TriangleMesh, points: FloatArray, is_steep: BoolArray, options: SurfaceOptions
) -> tuple[TriangleMesh, FloatArray]:
    """Return mesh and points without ground in solid bodies or with little headroom; treads become inclined flights."""
    weld, headroom, treads = options.weld, options.headroom, options.treads
    heights = points[mesh.triangles][:, :, 2]
    steps = np.diff(np.unique(np.round(heights[np.ptp(heights, axis=1) <= weld][:, 0], 3)))
    has_treads = treads and np.sum((steps >= LEAST_RISER) & (steps <= MOST_RISER)) >= FEWEST - 1
    has_bodies = headroom > 0.0 and bool(is_steep.any())
    if not (has_treads or has_bodies) or is_steep.all():
        return mesh, points
    vertices, index = weld_points(points, weld)
    rows = np.unique(np.sort(index[mesh.triangles], axis=1), axis=0, return_index=True)[1]
    rows = rows[least_height(vertices[index[mesh.triangles[rows]]]) > weld]
    cells, steep = index[mesh.triangles[rows]], is_steep[rows]
    if steep.all():
        return mesh, points
    body = bodies(len(vertices), cells)
    tags = {name: mask[rows][~steep] for name, mask in mesh.cell_tags.items()}
    before = patches_of(vertices, cells[~steep], body[~steep], tags)
    after, notes = before, list[Finding]()
    if has_bodies and steep.any():
        solid = set(body[steep].tolist())
        closed = closed_bodies(cells, body) & solid
        after, notes = _walked_on(before, solid, closed, headroom)
        after, more = _reached(after, before, solid, closed, _Upright(vertices, cells[steep], body[steep]))
        notes = notes + more
    if has_treads:
        after, more = _with_flights(after, headroom)
        notes = notes + more
    if not notes:
        return mesh, points
    # Overlays leave sides as short as the grid, which no triangulation has room for.
    plans = [flat_parts(shapely.set_precision(patch.plan, weld / 10.0)) for patch in after]
    pairs = [(patch, plan) for patch, plan in zip(after, plans, strict=True) if not plan.is_empty]
    if not pairs:
        text = "; ".join(note.text for note in notes)
        raise BuildingError(f"{mesh.source}: no face is a floor with headroom above it ({text}): set building.headroom")
    try:
        drawn = SurfaceMesh.of_polygons([(tuple(patch.tags) or "", plan, patch.height_at) for patch, plan in pairs])
    except ValueError as error:
        raise BuildingError(f"{mesh.source}: {error}; repair the mesh there, or set building.headroom = 0") from error
    made = np.reshape(drawn.cells, (-1, 3)) + len(points)
    none = np.zeros(len(made), dtype=bool)
    cell_tags = {name: np.asarray(drawn.cell_tags.get(name, none)) for name in mesh.cell_tags}
    whole = np.concatenate([points, drawn.points])
    findings = (*mesh.findings, *notes)
    return replace(mesh, points=whole, triangles=made, cell_tags=cell_tags, findings=findings), whole


def _walked_on(
    patches: list[Patch], solid: set[int], closed: set[int], headroom: float
) -> tuple[list[Patch], list[Finding]]:
    """Return the parts of patches outside of bodies, with upright faces or closed ones, and with enough headroom."""
    own = [patch for patch in patches if patch.body in solid]
    beside = _beside(own)
    heights = [patch.height(shapely.get_coordinates(patch.plan)) for patch in own]
    least, most = np.array([[z.min(), z.max()] for z in heights]).reshape(-1, 2).T
    body = np.array([patch.body for patch in own])
    foot, top = ({one: float(end(z[body == one])) for one in set(body)} for end, z in ((np.min, least), (np.max, most)))
    free, notes = [], list[Finding]()
    low_area, places, hollow = 0.0, [], set[int]()
    for k, patch in enumerate(own):
        # No patch is inside of a closed body that is all above or all below it.
        around = [own[j] for j in beside[k] if own[j].body in closed]
        inside = _inside(patch, [one for one in around if foot[one.body] <= most[k] and top[one.body] >= least[k]])
        hollow |= {patch.body} & set(inside)
        near = [j for j in beside[k] if least[j] <= most[k] + headroom and most[j] >= least[k] - TOUCHING]
        same = [own[j].over(patch, -TOUCHING, TOUCHING) for j in near if j < k and _is_again(own[j], patch)]
        rest = patch.without(shapely.union_all([*inside.values(), *same]))
        low = shapely.union_all([own[j].over(rest, _least(own[j], patch), headroom) for j in near])
        if not low.is_empty and low.area > LEAST_TOP / 100.0:
            low_area += low.area
            places.append((*place_of(low), float(rest.height(np.array([place_of(low)]))[0])))
        parts = shapely.get_parts(rest.without(low).plan)
        free += [replace(rest, plan=part) for part in parts[~shapely.is_empty(shapely.buffer(parts, -SLIVER / 2))]]
    if hollow:
        notes.append(Finding("found", f"{len(hollow)} solid bodies; people walk on their upper faces (headroom)"))
    if low_area:
        text = f"{low_area:.2f} m2 of floor with less headroom than {headroom:g} m; the first part is here (headroom)"
        notes.append(Finding("left out", text, place=places[0]))
    return [patch for patch in patches if patch.body not in solid] + free, notes


class _Upright:
    """Upright cells of a mesh: which parts of it have walls."""

    def __init__(self, points: FloatArray, triangles: IndexArray, body: IndexArray) -> None:
        corners = points[triangles]
        self._foot = corners[:, :, 2].min(axis=1)
        self._peak = np.take_along_axis(corners, corners[:, :, 2].argmax(axis=1)[:, None, None], axis=1)[:, 0]
        top = np.full(int(body.max()) + 1, -np.inf)
        np.maximum.at(top, body, corners[:, :, 2].max(axis=1))
        self._top = top[body]
        self._lines = shapely.linestrings(corners[:, [0, 1, 2, 0], :2])
        self._tree = shapely.STRtree(self._lines)

    def stand_on(self, parts: Sequence[Patch]) -> BoolArray:
        """Return which level parts (n,) have faces of walls, columns or guard rails that stand on them."""
        plans, z = [part.plan for part in parts], np.array([part.z for part in parts])
        part, cell = self._tree.query(plans, predicate="dwithin", distance=APART)
        stands = (np.abs(self._foot[cell] - z[part]) < MOST_RISER / 2) & (self._top[cell] > z[part] + RAIL)
        found = np.zeros(len(parts), dtype=bool)
        found[part[stands]] = True
        return found & [part.is_flat for part in parts]

    def bear(self, part: Patch) -> bool:
        """Return whether faces end at a part from below along most of its outline, as sides of a slab or walls do."""
        outline = shapely.boundary(part.plan)
        near = self._tree.query(outline, predicate="dwithin", distance=APART)
        near = near[np.abs(self._peak[near, 2] - part.height(self._peak[near, :2])) < MOST_RISER / 2]
        sides = shapely.union_all(shapely.buffer(self._lines[near], APART))
        return bool(outline.intersection(sides).length > 0.5 * outline.length)


def _reached(
    parts: list[Patch], before: Sequence[Patch], solid: set[int], closed: set[int], upright: _Upright
) -> tuple[list[Patch], list[Finding]]:
    """Return the parts without those that nobody reaches by steps: tops of walls and furniture, and roofs.

    A roof or the top of a table is above a floor with walls, and has none itself, nor a name as a floor; it is the
    upper side of a closed body, or has sides below most of its outline: a bare floor that only touches some wall has
    not. `before`: patches before any part of them was removed, since bodies that stand on a floor are cut out of it.
    """
    pairs = [(k, j) for k, near in enumerate(_beside(parts)) for j in near if k < j and _is_step(parts[k], parts[j])]
    group = connected_components(len(parts), np.array(pairs, dtype=np.int64).reshape(-1, 2))
    is_solid = np.array([part.body in solid for part in parts])
    tops = [part.plan.area < LEAST_TOP or part.plan.buffer(-NARROWEST_TOP / 2).is_empty for part in parts]
    is_walled, is_small = upright.stand_on(parts), np.array(tops)
    has_floor, has_walls = (np.zeros(len(parts), dtype=bool) for _ in range(2))
    is_named = np.array([any(tag.startswith(("floor:", "stair:")) for tag in part.tags) for part in parts], dtype=bool)
    has_floor[group[~is_small | ~is_solid | is_named]] = True
    has_walls[group[(is_walled & ~is_small) | ~is_solid | is_named]] = True
    walled = {(part.body, part.z) for part, has in zip(parts, is_walled, strict=True) if has}
    floors = [patch for patch in before if (patch.body, patch.z) in walled]
    tree = shapely.STRtree([floor.plan for floor in floors])
    covering, whole = np.zeros(len(parts)), np.zeros(len(parts))
    for k in np.flatnonzero(has_floor[group] & ~has_walls[group]):
        own = parts[k]
        if own.body in closed or upright.bear(own):
            over = [own.over(floors[j], MOST_RISER, HIGHEST) for j in tree.query(own.plan)]
            covering[group[k]] += shapely.union_all(over).area
        whole[group[k]] += own.plan.area
    is_roof = covering > 0.5 * whole
    notes = []
    for which, what in ((~has_floor[group], "too small for floors"), (is_roof[group], "without walls above a floor")):
        rows = np.flatnonzero(which)
        if len(rows):
            first = parts[rows[0]]
            x, y = place_of(first.plan)
            area = sum(parts[row].plan.area for row in rows)
            text = (
                f"{counted(len(rows), 'face')} {what}, {area:.2f} m2: tops of walls, furniture or roofs, to which no "
            )
            text += "step leads; the first one is here"
            notes.append(Finding("left out", text, place=(x, y, first.height_at(x, y))))
    return [part for part, at in zip(parts, group, strict=True) if has_floor[at] and not is_roof[at]], notes


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


def _is_step(one: Patch, other: Patch) -> bool:
    """Return whether two patches touch in plan and somewhere there differ in height by at most a riser."""
    if one.is_flat and other.is_flat and abs(one.z - other.z) > 2.0 * MOST_RISER:
        return False
    contact = shapely.get_coordinates(shapely.intersection(one.plan.buffer(APART), other.plan))
    apart = one.height(contact) - other.height(contact)  # linear along a side that they share
    return bool(len(contact) and apart.min() <= MOST_RISER and apart.max() >= -MOST_RISER)


def _with_flights(patches: list[Patch], headroom: float) -> tuple[list[Patch], list[Finding]]:
    """Replace every row of treads by one inclined patch, and remove ground with too little headroom below it."""
    notes, made, gone = list[Finding](), list[Patch](), list[Patch]()
    flat = [patch for patch in patches if patch.is_flat]
    steps = [patch for patch in flat if _is_tread(patch)]
    for numbers in chains([(patch.plan, patch.z) for patch in steps]):
        treads = [steps[k] for k in numbers]
        if len(treads) < FEWEST:
            continue
        way, winds = direction_of([tread.plan for tread in treads])
        x, y = place_of(treads[0].plan)
        if winds:
            text = (
                f"a stair of {len(treads)} treads turns and is not replaced: draw it as straight flights with landings"
            )
            notes.append(Finding("warning", text, place=(x, y, treads[0].z)))
            continue
        lower = next((floor for floor in flat if _leads(floor, treads[0])), None)
        upper = next((floor for floor in flat if _leads(treads[-1], floor)), None)
        inclined = _inclined(treads, lower, upper, way)
        made.append(inclined)
        gone += treads
        heights = inclined.height(shapely.get_coordinates(inclined.plan))
        text = (
            f"a flight of {len(treads)} treads, from {heights.min():z.2f} to {heights.max():z.2f} m, is "
            "replaced by one inclined surface (treads)"
        )
        notes.append(Finding("assumed", text, place=(x, y, treads[0].z)))
    kept = [patch for patch in patches if not any(patch is other for other in gone)]
    for flight in made:
        for row, patch in enumerate(kept):
            low = flight.over(patch, -headroom, headroom)
            if not low.is_empty:
                kept[row] = patch.without(low)
    return [patch for patch in kept if not patch.plan.is_empty] + made, notes


def chains(faces: Sequence[tuple[BaseGeometry, float]]) -> list[list[int]]:
    """Return the rows of treads among level faces (plan, height [m]): each is one riser above the one before it."""
    rows: list[list[int]] = []
    for k in sorted(range(len(faces)), key=lambda k: faces[k][1]):
        plan, z = faces[k]
        below = [
            (z - faces[row[-1]][1], away, number)
            for number, row in enumerate(rows)
            if LEAST_RISER <= z - faces[row[-1]][1] <= MOST_RISER
            and (away := faces[row[-1]][0].distance(plan)) <= BETWEEN
        ]
        if below:
            rows[min(below)[2]].append(k)
        else:
            rows.append([k])
    return rows


def direction_of(treads: Sequence[BaseGeometry]) -> tuple[FloatArray, bool]:
    """Return the mean direction (2,) uphill of treads in plan, and whether they turn."""
    middle = shapely.get_coordinates(shapely.centroid(treads))
    steps = np.diff(middle, axis=0)
    steps /= np.maximum(np.hypot(*steps.T), 1e-9)[:, None]
    direction = steps.sum(axis=0)
    direction /= max(np.hypot(*direction), 1e-9)
    turn = np.degrees(np.arccos(np.clip(steps @ direction, -1.0, 1.0))).max()
    return direction, bool(turn > MOST_TURN)


def _is_tread(patch: Patch) -> bool:
    """Return whether a flat patch has the depth and width of a tread and is not a floor."""
    is_floor = any(tag.startswith(("floor:", "area:", "obstacle:")) for tag in patch.tags)
    return not is_floor and patch.plan.buffer(-DEEPEST / 2).is_empty and patch.plan.length > 2.0 * LEAST_WIDTH


def _leads(lower: Patch, upper: Patch) -> bool:
    """Return whether a flat patch is one riser below another, and meets it in plan over the width of a stair."""
    if not LEAST_RISER <= upper.z - lower.z <= MOST_RISER:
        return False
    border = lower.plan.boundary.intersection(upper.plan.buffer(APART))
    return bool(border.length >= LEAST_WIDTH)


def _inclined(treads: list[Patch], lower: Patch | None, upper: Patch | None, way: FloatArray) -> Patch:
    """Return the plane patch that replaces a row of treads, from the floor below to that above or a riser beyond."""
    riser = (treads[-1].z - treads[0].z) / (len(treads) - 1)
    z_lower = treads[0].z - riser if lower is None else lower.z
    z_upper = treads[-1].z + riser if upper is None else upper.z
    joined = shapely.union_all([tread.plan.buffer(APART, join_style="mitre") for tread in treads])
    plan = joined.buffer(-APART, join_style="mitre")
    for floor in (lower, upper):
        if floor is not None:
            plan = shapely.snap(plan, floor.plan, APART)
    plan = flat_parts(shapely.set_precision(plan, GRID))
    along = shapely.get_coordinates(plan) @ way
    rise = (z_upper - z_lower) / float(along.max() - along.min()) * way
    tags = frozenset(tag for tag in treads[0].tags if all(tag in tread.tags for tread in treads))
    return replace(treads[0], tags=tags, plan=plan, rise=rise, z=float(z_lower - along.min() * np.hypot(*rise)))
