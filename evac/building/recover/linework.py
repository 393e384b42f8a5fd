"""Rooms from drawn lines: walls are noded, gaps are closed, doors are known or found where walls are interrupted."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import compress

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.base.defaults import DOOR_REACH, LEAST_LENGTH
from evac.building.geometry import GRID, flat_parts, segment_lengths
from evac.building.plan.outlines import doorway
from evac.building.surface.welding import welded

#: Grid on which lines are noded [m]; lines that were meant to coincide do so on this grid.
NODING = 1e-4
#: Corners of lines are merged within this share of the gap.
WELDED = 0.05
#: Minimum width of a room [m]; narrower faces are the interior of walls drawn with both sides.
THICKEST_WALL = 0.6
#: Widest end face of a wall beside an opening [m].
THICKEST_JAMB = 0.9
#: Thickest outer wall with a door to the outside [m].
THICKEST_HULL = 1.0
#: Spacings of the two sides of a wall [m], and least length of a side.
SPACING, LEAST_SIDE = (0.04, THICKEST_WALL), 0.3
#: Minimum area of a room [m2]; smaller faces are columns, ducts or the swing of doors.
LEAST_ROOM = 1.5
#: Area from which what is narrow and open to a room is the interior of walls [m2].
LEAST_WALL = 0.6
#: Greatest distance of the panes of a window from its opening [m].
BETWEEN_PANES = 0.2
#: Minimum area of a room that has a door [m2].
LEAST_CABIN = 0.5
#: Greatest width of a door's frame on either side [m].
FRAME = 0.3
#: Distance from a line at which the presence of floor is tested [m].
BESIDE = 0.01
#: Lines have the same direction if they differ by less than this (25 degrees).
PARALLEL = 0.9
#: An end is joined to lines up to this multiple of the distance to the nearest one.
FARTHER = 2.0

Lines = NDArray[np.object_]


@dataclass(frozen=True)
class Faces:
    """Faces enclosed by lines."""

    pieces: Lines  # (n,) array of LineString [m]: the lines, divided where they meet, and the lines that close gaps
    # list of polygon [m]: enclosed faces, without those narrower than the gap, which come from lines drawn twice
    faces: list[BaseGeometry]
    closed: FloatArray  # (c, 4) float64 [m]: gaps that were closed
    loose: FloatArray  # (l, 4) float64 [m]: lines that enclose nothing


@dataclass(frozen=True)
class Rooms:
    """Rooms enclosed by walls."""

    floor: BaseGeometry  # shapely polygon or multipolygon [m]: union of the rooms and the doors between them
    closed: FloatArray  # (c, 4) float64 [m]: gaps in walls that were closed
    between: FloatArray  # (d, 4) float64 [m]: openings with floor on both sides
    doors: FloatArray  # (d, 4) float64 [m]: known doors with floor on both sides
    openings: FloatArray  # (o, 4) float64 [m]: openings with floor on one side only
    outer: FloatArray  # (e, 4) float64 [m]: known doors with floor on one side only
    loose: FloatArray  # (l, 4) float64 [m]: lines that enclose nothing, apart from the walls of the rooms
    left_out: list[BaseGeometry]  # list of polygon [m]: enclosed faces that are neither rooms nor the interior of walls


def faces_of(lines: Sequence[BaseGeometry], gap: float) -> Faces:
    """Return the faces enclosed by lines after their ends are joined to the nearest lines within a gap [m].

    `lines` [m]; `gap` [m].
    """
    pieces = _without_overshoots(_noded(welded(lines, WELDED * gap)), gap)
    closed = _closings(pieces, gap)
    pieces = _noded([*pieces, *_as_lines(closed)])
    faces, cuts, dangles, _ = shapely.polygonize_full(pieces)
    whole = shapely.get_parts(shapely.union_all(shapely.get_parts(faces), grid_size=GRID))
    slivers = shapely.union_all([line for line in whole if line.buffer(-max(gap, LEAST_LENGTH) / 2).is_empty])
    loose = shapely.get_coordinates([cuts, dangles]).reshape(-1, 4)
    wide = [face for face in shapely.get_parts(faces) if not slivers.covers(face.representative_point())]
    return Faces(pieces, wide, closed, loose[segment_lengths(loose) > gap])


def rooms_of(
    lines: Sequence[BaseGeometry],
    gap: float,
    door: float,
    wall: float,
    doors: ArrayLike = (),
    panes: Sequence[BaseGeometry] = (),
    solids: Sequence[BaseGeometry] = (),
) -> Rooms:
    """Return the rooms enclosed by walls.

    Ends of walls are joined to the nearest lines within `gap`. Wider openings, up to `door`, straight ahead of the end
    of a wall are doors, unless two panes cross them as in a window. The enclosed faces are then rooms, the interior of
    walls drawn with both sides, or columns.

    `lines` [m]: walls, closed or not; `gap` [m]: ends at most this far from another line are joined to it; `door` [m]:
    width of the widest door that is searched for; 0 for none; `wall` [m]: thickness of walls that are drawn as one line
    between two rooms; `doors` (k, 4) [m]: doors that are known, each between two walls; `panes` [m]: lines between
    walls that are not known to be walls, such as panes and sills: they close what has no door; `solids` [m]: outlines
    of walls and columns.
    """
    body = shapely.union_all([*solids], grid_size=GRID)
    drawn = faces_of(lines, gap)
    walls = _noded([*drawn.pieces, *_end_faces(drawn.pieces)])
    found = _door_lines(walls, gap, door)
    known = _into_walls(np.asarray(doors, dtype=np.float64).reshape(-1, 4), walls, [middle for middle, _ in found])
    across = reaching(known, walls)
    found = [one for one in found if not _is_at(_as_lines(across), shapely.LineString(one[0].reshape(2, 2)))]
    ends = shapely.get_coordinates([*panes]).reshape(-1, 4)
    is_long = segment_lengths(ends) > THICKEST_WALL
    sills = _joining(reaching(ends[is_long], walls), walls)  # through frames
    sills = [one for one in sills if not _is_at(_as_lines(across), one)]
    at = [_hull(pair).buffer(BETWEEN_PANES) for _, pair in found]
    is_door = [sum(_is_at([one], sill) for sill in sills) < 2 for one in at]
    found, openings = [*compress(found, is_door)], [*compress(at, is_door)]
    glass = [sill for sill in sills if not _is_at(openings, sill)]
    jambs = [side for _, pair in found if len(pair) == 2 for side in (pair[:, :2], pair[:, 2:])]
    glass += [shapely.LineString(jamb) for jamb in jambs] + _joining(ends[~is_long], walls)
    ways = np.concatenate([*(pair for _, pair in found), across]).reshape(-1, 4)
    closed = _noded([*walls, *_as_lines(ways), *glass])
    mouths = _mouths(drawn.pieces, _floor_of(closed, ways, body), door)
    closed = _noded([*closed, *_as_lines(mouths)])
    rooms = _floor_of(closed, np.concatenate([ways, mouths]), body)
    strips = [_hull(pair) for _, pair in found if len(pair) == 2 and _with_floor(_as_lines(pair), rooms).any()]
    floor = shapely.union_all([rooms, *strips], grid_size=GRID)
    middle = shapely.points((drawn.loose[:, :2] + drawn.loose[:, 2:]) / 2)
    outside = drawn.loose[~shapely.dwithin(middle, floor, THICKEST_WALL)]
    shared = shapely.union_all(walls[_with_floor(walls, floor).all(axis=1)])
    if not shared.is_empty:
        thick = shapely.line_merge(shared).buffer(wall / 2, cap_style="flat", join_style="mitre")
        floor = shapely.difference(floor, thick, grid_size=GRID)
    floor = flat_parts(floor)
    sides = door_sides(known, floor)
    inside = [middle for middle, pair in found if _with_floor(_as_lines(pair), floor).all()]
    outer = np.concatenate([ways[: len(ways) - len(known)], mouths[segment_lengths(mouths) > THICKEST_WALL]])
    outer = outer[_with_floor(_as_lines(outer), floor).sum(axis=1) == 1]
    small = [face for face in _wide(closed) if not floor.intersects(face.representative_point())]
    hull = hull_of(floor)
    is_outer = (sides == 1) & leads_out(known, hull)
    is_open = is_outer & ~_walled(known, floor, walls)
    outer = np.concatenate([outer[leads_out(outer, hull)], known[is_outer & ~is_open]])
    between = np.array(inside).reshape(-1, 4)
    return Rooms(floor, drawn.closed, between, known[sides == 2], outer, known[is_open], outside, small)


def sides_of_walls(lines: Sequence[BaseGeometry] | Lines) -> IndexArray:
    """Return those pairs (p, 2) of some lines of two points that are beside each other as the two sides of a wall."""
    ends = shapely.get_coordinates([*lines]).reshape(-1, 4)
    step, middle = ends[:, 2:] - ends[:, :2], (ends[:, :2] + ends[:, 2:]) / 2
    length = np.hypot(*step.T)
    way = step / np.maximum(length, 1e-12)[:, None]
    one, other = shapely.STRtree([*lines]).query(shapely.points(middle), predicate="dwithin", distance=SPACING[1])
    off = ends[other, :2] - middle[one]
    apart = np.abs(way[one, 0] * off[:, 1] - way[one, 1] * off[:, 0])
    alike = np.abs((way[one] * way[other]).sum(axis=1)) > 0.999
    fits = alike & (apart > SPACING[0]) & (length[other] > 0.3 * length[one]) & (length[one] > LEAST_SIDE)
    found: IndexArray = np.column_stack([one, other])[fits]
    return found


def _wide(pieces: Lines) -> list[BaseGeometry]:
    """Return the faces of lines that are wider than walls, without the interior of walls that is open to them."""
    found = []
    for face in shapely.get_parts(shapely.polygonize_full(pieces)[0]):
        core = face.buffer(LEAST_LENGTH - THICKEST_WALL / 2)
        if not core.is_empty:
            narrow = face.difference(core.buffer(THICKEST_WALL / 2 + LEAST_LENGTH, join_style="mitre"))
            walls = [part for part in shapely.get_parts(narrow) if part.area > LEAST_WALL]
            found += [*shapely.get_parts(flat_parts(face.difference(shapely.union_all(walls))))] if walls else [face]
    return found


def _floor_of(pieces: Lines, doors: FloatArray, solid: BaseGeometry) -> BaseGeometry:
    """Return the union of the rooms; small faces are rooms only if they have a door."""
    at = shapely.union_all(_as_lines(doors)).buffer(BESIDE)
    rooms = [one for one in _wide(pieces) if one.area >= LEAST_ROOM or (one.area >= LEAST_CABIN and one.intersects(at))]
    ground = shapely.get_parts(shapely.difference(shapely.union_all(rooms, grid_size=GRID), solid, grid_size=GRID))
    return shapely.union_all(ground[shapely.area(ground) >= LEAST_CABIN], grid_size=GRID)


def reaching(doors: FloatArray, walls: Sequence[BaseGeometry] | Lines) -> FloatArray:
    """Return doors (k, 4) with both ends extended to the walls beside their frames."""
    pieces = np.array([*walls], dtype=object)
    tree, found = shapely.STRtree(pieces), []
    for door in doors.reshape(-1, 2, 2):
        step = (door[1] - door[0]) / np.hypot(*(door[1] - door[0]))
        ends = []
        for end, way in ((door[0], -step), (door[1], step)):
            far = ahead(pieces, tree, end - BESIDE * way, way, FRAME + BESIDE) or BESIDE
            ends.append(end + (far - BESIDE) * way)
        found.append(np.concatenate(ends))
    return np.array(found).reshape(-1, 4)


def _into_walls(doors: FloatArray, walls: Lines, found: Sequence[FloatArray]) -> FloatArray:
    """Return doors (k, 4), of which those drawn beside an interruption (4,) of a wall are moved into it."""
    moved = doors.copy()
    for row, (door, reached) in enumerate(zip(_as_lines(doors), _as_lines(reaching(doors, walls)), strict=True)):
        near = [ends for ends in found if _is_at([door], shapely.LineString(ends.reshape(2, 2)))]
        if near and not _joining(shapely.get_coordinates(reached).reshape(1, 4), walls, NODING):
            moved[row] = min(near, key=lambda ends: door.distance(shapely.Point((ends[:2] + ends[2:]) / 2)))
    return moved


def _end_faces(pieces: Lines) -> list[BaseGeometry]:
    """Return the end faces of walls whose two sides end beside each other without one."""
    if not len(pieces):
        return []
    nodes, at, count = _nodes(pieces)
    free = np.flatnonzero(count[at] == 1)
    ends, behind = nodes[at.ravel()[free]], nodes[at[:, ::-1].ravel()[free]]
    way = (ends - behind) / np.hypot(*(ends - behind).T)[:, None]
    one, other = shapely.STRtree(shapely.points(ends)).query(shapely.points(ends), "dwithin", distance=THICKEST_WALL)
    across = ends[other] - ends[one]
    far = np.hypot(*across.T)
    fits = (far > SPACING[0]) & ((way[one] * way[other]).sum(axis=1) > PARALLEL)
    fits &= np.abs((way[one] * across).sum(axis=1)) < far / 2
    nearest = {int(one[row]): int(other[row]) for row in np.flatnonzero(fits)[np.argsort(-far[fits], kind="stable")]}
    pairs = [(a, b) for a, b in nearest.items() if a < b and nearest.get(b) == a]
    return [shapely.LineString(ends[[a, b]]) for a, b in pairs]


def _is_at(places: Sequence[BaseGeometry], line: BaseGeometry) -> bool:
    """Return whether a line lies at one of some doors or openings."""
    middle = line.interpolate(0.5, normalized=True)
    return any(
        place.distance(middle) < THICKEST_WALL / 2 if place.geom_type == "LineString" else place.intersects(middle)
        for place in places
    )


def _joining(ends: FloatArray, walls: Lines, distance: float = BESIDE) -> list[BaseGeometry]:
    """Return those of some lines (k, 4) that end at walls on both sides, at most a distance [m] away."""
    points = shapely.points(ends.reshape(-1, 2))
    near = shapely.STRtree(walls).query(points, predicate="dwithin", distance=distance)[0]
    return _as_lines(ends[np.isin(np.arange(len(points)), near).reshape(-1, 2).all(axis=1)])


def _mouths(pieces: Lines, floor: BaseGeometry, reach: float) -> FloatArray:
    """Return lines (m, 4) from ends of walls outside of all rooms to the walls beside them: where the drawing ends."""
    if not len(pieces):
        return np.empty((0, 4))
    nodes, at, count = _nodes(pieces)
    tree, found = shapely.STRtree(pieces), []
    for a, b in at.tolist():
        for end, behind in ((a, b), (b, a)):
            if count[end] != 1 or floor.dwithin(shapely.Point(nodes[end]), BESIDE):
                continue
            step = nodes[end] - nodes[behind]
            for side in (np.array([-step[1], step[0]]), np.array([step[1], -step[0]])):
                way = side / np.hypot(*side)
                start = nodes[end] - BESIDE * step / np.hypot(*step)
                far = ahead(pieces, tree, start, way, reach)
                if far is not None:
                    found.append((*start, *(start + far * way)))
    return np.array(found).reshape(-1, 4)


def hull_of(floor: BaseGeometry) -> BaseGeometry:
    """Return the prepared hull of a floor with its walls."""
    thick = floor.buffer(THICKEST_HULL / 2, join_style="mitre").buffer(-THICKEST_HULL / 2, join_style="mitre")
    hull = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(thick)])
    shapely.prepare(hull)
    return hull


def leads_out(doors: FloatArray, hull: BaseGeometry) -> NDArray[np.bool_]:
    """Return which doors (k, 4) lead to the outside of the hull of a floor."""
    middle, across = _across(doors)
    sides = [shapely.intersects_xy(hull, *(middle + way * THICKEST_HULL * across).T) for way in (1.0, -1.0)]
    found: NDArray[np.bool_] = ~(sides[0] & sides[1])
    return found


def _walled(doors: FloatArray, floor: BaseGeometry, walls: Lines) -> NDArray[np.bool_]:
    """Return which doors (k, 4) with floor on one side have a wall right behind them on the other."""
    middle, across = _across(doors)
    out = np.where(shapely.intersects_xy(floor, *(middle + 2.0 * BESIDE * across).T), -1.0, 1.0)[:, None] * across
    rays = shapely.linestrings(np.stack([middle + 2.0 * BESIDE * out, middle + THICKEST_WALL * out], axis=1))
    return np.isin(np.arange(len(doors)), shapely.STRtree(walls).query(rays, predicate="intersects")[0])


def door_sides(doors: FloatArray, floor: BaseGeometry) -> IndexArray:
    """Return on how many sides (k,) of doors there are rooms; 0 for a door inside a room or across a wall."""
    found = []
    for ends in doors.reshape(-1, 2, 2):
        reach = shapely.LineString(ends).buffer(3.0 * DOOR_REACH + 1.0, cap_style="square")
        near = flat_parts(floor.intersection(reach))
        try:
            segment, _, beside = doorway(near, ends, DOOR_REACH)
        except ValueError:
            found.append(0)
            continue
        strips = [one.polygon for one in beside if one is not None]
        ground = shapely.union_all([near, *strips])
        is_whole = all(ground.dwithin(shapely.Point(end), LEAST_LENGTH) for end in segment)
        found.append(len(strips) if is_whole else 0)
    return np.array(found, dtype=np.int64)


def _noded(lines: Sequence[BaseGeometry] | Lines) -> Lines:
    """Divide lines where they meet, on a grid, into sorted pieces of two points."""
    joined = shapely.union_all([*lines], grid_size=NODING)
    pieces = []
    for part in shapely.get_parts(joined):
        corners = shapely.get_coordinates(part)
        pieces.append(np.stack([corners[:-1], corners[1:]], axis=1))
    if not pieces:
        return np.empty(0, dtype=object)
    ends = np.sort(np.concatenate(pieces).view("f8,f8"), axis=1).view(np.float64).reshape(-1, 4)
    distinct = np.unique(ends, axis=0)
    return np.asarray(shapely.linestrings(distinct.reshape(-1, 2, 2)))


def _as_lines(ends: FloatArray) -> list[BaseGeometry]:
    return [shapely.LineString(segment.reshape(2, 2)) for segment in ends]


def _nodes(pieces: Lines) -> tuple[FloatArray, IndexArray, IndexArray]:
    """Return the nodes where pieces meet, the two nodes of each piece, and the number of pieces at each node."""
    ends = shapely.get_coordinates(pieces)
    nodes, at, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return nodes, at.reshape(-1, 2), count


def _without_overshoots(pieces: Lines, gap: float) -> Lines:
    """Drop pieces that overshoot another wall by at most the gap and end freely."""
    if not len(pieces):
        return pieces
    _, at, count = _nodes(pieces)
    degree = np.sort(count[at], axis=1)
    is_over = (degree[:, 0] == 1) & (degree[:, 1] > 2) & (shapely.length(pieces) <= gap)
    return np.asarray(pieces[~is_over])


def _closings(pieces: Lines, gap: float) -> FloatArray:
    """Return lines (c, 4) that join ends of walls to other ends and walls within a gap, nearest first."""
    # Joined ends form one cluster, which is joined to every other end and wall once. Lines much farther from an end
    # than the nearest one are not joined to it.
    if not len(pieces) or not gap > 0.0:
        return np.empty((0, 4))
    nodes, at, count = _nodes(pieces)
    ends = np.flatnonzero(count == 1)
    one, piece = shapely.STRtree(pieces).query(shapely.points(nodes[ends]), predicate="dwithin", distance=gap)
    start = ends[one]
    across = shapely.shortest_line(shapely.points(nodes[start]), pieces[piece])
    target = shapely.get_coordinates(across)[1::2]
    far = shapely.length(across)
    is_other = (start[:, None] != at[piece]).all(axis=1)
    start, piece, target, far = start[is_other], piece[is_other], target[is_other], far[is_other]
    nearest = np.full(len(nodes), math.inf)
    np.minimum.at(nearest, start, far)
    cluster = {int(end): {int(end)} for end in ends}
    touched: dict[int, set[int]] = {int(end): set() for end in ends}
    closed: set[tuple[float, ...]] = set()
    for row in np.lexsort((piece, start, far)).tolist():
        a, k = int(start[row]), int(piece[row])
        b = next((n for n in at[k].tolist() if n in cluster and (nodes[n] == target[row]).all()), None)
        if far[row] > FARTHER * nearest[a] + LEAST_LENGTH or k in touched[a] or cluster[a] & set(at[k].tolist()):
            continue
        together = cluster[a] | (cluster[b] if b is not None else set())
        pieces_of = touched[a] | {k} | (touched[b] if b is not None else set())
        for end in together:
            cluster[end], touched[end] = together, pieces_of
        closed.add((*nodes[a].tolist(), *target[row].tolist()))
    return np.array(sorted(one for one in closed if one[:2] != one[2:])).reshape(-1, 4)


def _door_lines(pieces: Lines, gap: float, door: float) -> list[tuple[FloatArray, FloatArray]]:
    """Return the doors: the segment (4,) of each, and the lines (1 or 2, 4) that close it, one per side of the wall."""
    if not len(pieces) or not door > gap:
        return []
    nodes, at, count = _nodes(pieces)
    tree, corners = shapely.STRtree(pieces), shapely.STRtree(shapely.points(nodes))
    beside: dict[int, list[int]] = {}
    for a, b in at.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    doors: dict[tuple[float, ...], tuple[FloatArray, FloatArray]] = {}
    rays: list[tuple[list[int], FloatArray]] = []
    for node in np.flatnonzero(count == 1).tolist():
        (behind,) = beside[node]
        rays.append(([node], nodes[node] - nodes[behind]))
    for a, b in at[(count[at] == 2).all(axis=1)].tolist():
        across = nodes[b] - nodes[a]
        further = [next(far for far in beside[node] if far != other) for node, other in ((a, b), (b, a))]
        back = [nodes[far] - nodes[node] for far, node in zip(further, (a, b), strict=True)]
        if GRID < np.hypot(*across) <= THICKEST_JAMB and _is_jamb(across, back):
            rays.append(([a, b], -(back[0] / np.hypot(*back[0]) + back[1] / np.hypot(*back[1]))))
    for starts, way in rays:
        way = way / np.hypot(*way)
        hits = [ahead(pieces, tree, nodes[start], way, door) for start in starts]
        if all(hit is not None and hit > gap for hit in hits):
            far = np.array([nodes[s] + h * way for s, h in zip(starts, hits, strict=True) if h])
            nearest = corners.query_nearest(shapely.points(far), all_matches=False)[1]
            is_corner = np.hypot(*(nodes[nearest] - far).T) < LEAST_LENGTH
            far = np.where(is_corner[:, None], nodes[nearest], np.round(far / NODING) * NODING)
            pair = np.column_stack([nodes[starts], far])
            middle = pair.mean(axis=0)
            key = np.sort(np.round(middle.reshape(2, 2), 2).view("f8,f8"), axis=0)  # the same from both of its sides
            doors.setdefault(tuple(key.view(np.float64).ravel().tolist()), (middle, np.round(pair, 6) + 0.0))
    return [doors[name] for name in sorted(doors)]


def _is_jamb(across: FloatArray, back: list[FloatArray]) -> bool:
    """Return whether a piece is the end face of a wall: both sides of the wall lead away from it in one direction."""
    lengths = [float(np.hypot(*step)) for step in back]
    width = float(np.hypot(*across))
    alike = float(back[0] @ back[1]) > PARALLEL * lengths[0] * lengths[1]
    return alike and abs(float(back[0] @ across)) < 0.5 * lengths[0] * width and min(lengths) > 0.5 * width


def ahead(pieces: Lines, tree: shapely.STRtree, start: FloatArray, way: FloatArray, reach: float) -> float | None:
    """Return the distance from a point to the next wall in a direction [m]; None if there is none within reach."""
    ray = shapely.LineString([start + LEAST_LENGTH * way, start + reach * way])
    hit = pieces[tree.query(ray, predicate="dwithin", distance=LEAST_LENGTH / 2)]
    corners = shapely.points(shapely.get_coordinates(hit))  # which lines on the grid may miss
    met = [*shapely.intersection(ray, hit), *corners[shapely.dwithin(ray, corners, LEAST_LENGTH / 2)]]
    far = shapely.distance(shapely.Point(ray.coords[0]), [one for one in met if not one.is_empty])
    return LEAST_LENGTH + float(far.min()) if len(far) else None


def _hull(pair: FloatArray) -> BaseGeometry:
    """Return the ground between the two lines that close a door."""
    return shapely.set_precision(shapely.convex_hull(shapely.MultiPoint(pair.reshape(-1, 2))), GRID)


def _with_floor(lines: Sequence[BaseGeometry] | Lines, floor: BaseGeometry) -> NDArray[np.bool_]:
    """Return whether there is floor to the left and right (n, 2) of the midpoints of lines of two points."""
    if not len(lines):
        return np.empty((0, 2), dtype=bool)
    middle, across = _across(shapely.get_coordinates([*lines]).reshape(-1, 4))
    shapely.prepare(floor)
    sides = [shapely.intersects_xy(floor, *(middle + side * BESIDE * across).T) for side in (1.0, -1.0)]
    return np.stack(sides, axis=1)


def _across(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middles (k, 2) of lines (k, 4), and the unit vectors to their left."""
    step = ends[:, 2:] - ends[:, :2]
    left = np.column_stack([-step[:, 1], step[:, 0]]) / np.hypot(*step.T)[:, None]
    return (ends[:, :2] + ends[:, 2:]) / 2, left
