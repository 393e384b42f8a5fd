"""Checks of a building before anything is computed on it."""

import itertools
import math
from collections.abc import Iterator

import numpy as np
import shapely

from evac.base.arrays import FloatArray
from evac.base.defaults import LEAST_LENGTH
from evac.building.geometry import place_of, segment_lengths, side_of
from evac.building.model.building import Building
from evac.building.model.elevation import elevation, level_elevation
from evac.building.model.findings import Finding, item_of

#: Minimum depth of a level between two portals that face each other [m].
LEAST_DEPTH = 1.0
#: Cosine of the smallest angle between the inward normals of segments that face each other (120 degrees).
FACING = -0.5
#: Minimum vertical distance of two floors, and of a floor and a flight, that overlap in plan [m].
LEAST_HEADROOM = 1.0
LEAST_CLEARANCE = 0.1
#: Floor before an exit on which nobody fits is less deep than this [m].
LEAST_GROUND = 0.3
#: Overlaps up to this area [m2], or up to this share of the smaller level, are taken as rounding errors.
LEAST_SHARED = 0.01
LEAST_SHARE = 5e-4
#: Walls drawn with both sides are thicker than this [m]; smaller gaps are cells that miss each other.
THINNEST = 0.01
#: Rounding tolerance of lengths [m] and areas [m2].
ROUNDING = 1e-6


def check_overlap(building: Building) -> Iterator[Finding]:
    """Yield an error for each level that overlaps itself in plan, or another level at the same height."""
    for level in building.levels:
        cells = shapely.polygons(building.vertices[level.triangles][:, :, :2])
        if shapely.area(cells).sum() <= level.polygon.area + ROUNDING * max(level.polygon.area, 1.0):
            continue
        one, other = shapely.STRtree(cells).query(cells, predicate="intersects")
        both = shapely.intersection(cells[one[one < other]], cells[other[one < other]])
        x, y = both[shapely.area(both).argmax()].centroid.coords[0]
        text = (
            f"level {level.name!r} overlaps itself in plan at ({x:z.2f}, {y:z.2f}); "
            "divide it by a landing or a floor tag, or remove the duplicate cells"
        )
        yield Finding("error", text, level.title, (x, y), item_of(level))
    yield from _same_ground(building)


def _same_ground(building: Building) -> Iterator[Finding]:
    """Yield levels that overlap without enough height between them: people on them would not see each other."""
    polygons = [level.polygon for level in building.levels]
    pairs = shapely.STRtree(polygons).query(polygons, "intersects").T
    for one_row, other_row in sorted(pairs[pairs[:, 0] < pairs[:, 1]].tolist()):
        a, b = building.levels[one_row], building.levels[other_row]
        needed = LEAST_CLEARANCE if "flight" in (a.kind, b.kind) else LEAST_HEADROOM
        if a.z_max + needed <= b.z_min or b.z_max + needed <= a.z_min:
            continue
        both = a.polygon.intersection(b.polygon)
        if both.area <= min(LEAST_SHARED, LEAST_SHARE * min(a.polygon.area, b.polygon.area)):
            continue
        # Where the levels meet, the intersection also contains points, lines, and slivers due to rounding.
        parts = shapely.get_parts(both.buffer(-LEAST_LENGTH, join_style="mitre"))
        for part in parts[~shapely.is_empty(parts)]:
            places = np.vstack([shapely.get_coordinates(part), part.representative_point().coords[0]])
            one, other = (level_elevation(building.vertices, level, places) for level in (a, b))
            room, k = one - other, np.abs(one - other).argmin()
            if abs(room[k]) < needed - ROUNDING or room.min() < 0.0 < room.max():
                x, y = places[k]
                text = (
                    f"levels {a.name!r} and {b.name!r} overlap by {both.area:.3g} m2 in plan; at "
                    f"({x:z.2f}, {y:z.2f}) their heights are {one[k]:z.2f} and {other[k]:z.2f} m, so people on one "
                    f"would walk through people on the other. Overlapping levels must be {needed:g} m apart in height: "
                    "cut the upper or the lower one away there (an area is a part of its floor, not drawn over it)"
                )
                yield Finding("error", text, b.title, (float(x), float(y)), item_of(a if a.stair else b))
                break


def missed_seams(building: Building) -> tuple[Finding, ...]:
    """Warn of walls back to back that are closer than the thickness of any wall: cells that should probably meet."""
    walls, level = building.walls, building.wall_level
    lines = shapely.linestrings(walls.reshape(-1, 2, 2))
    middle = (walls[:, :2] + walls[:, 2:]) / 2
    one, other = shapely.STRtree(lines).query(shapely.points(middle), predicate="dwithin", distance=THINNEST)
    step = (walls[:, 2:] - walls[:, :2]) / segment_lengths(walls)[:, None]
    # The midpoint of one wall lies beside and behind the other one, and the walls face away from each other.
    along = ((middle[one] - walls[other, :2]) * step[other]).sum(axis=1)
    is_beside = (along > 0.0) & (along < segment_lengths(walls)[other])
    is_behind = side_of(walls[other].T, *middle[one].T) <= 0.0
    opposed = (step[one] * step[other]).sum(axis=1) < FACING
    rows = np.flatnonzero(is_beside & is_behind & opposed)
    height = elevation(
        building, np.concatenate([level[one[rows]], level[other[rows]]]), np.tile(middle[one[rows]], (2, 1))
    )
    drop = np.abs(np.subtract(*height.reshape(2, -1)))
    rows, drop = rows[drop < THINNEST], drop[drop < THINNEST]
    if not len(rows):
        return ()
    first = rows[0]
    x, y = middle[one[first]]
    gap = math.hypot(shapely.distance(shapely.points(x, y), lines[other[first]]), drop[0])
    names = [building.levels[index].title for index in sorted({level[one[first]], level[other[first]]})]
    ends = shapely.points(walls[one[rows]].reshape(-1, 2, 2))
    miss = np.hypot(shapely.distance(ends, lines[other[rows]][:, None]), drop[:, None])
    weld = math.ceil(1.1e3 * miss[miss < THINNEST].max(initial=gap)) / 1e3  # 10 % more, rounded up to a millimetre
    text = (
        f"cells {'of ' + ' and '.join(map(repr, names)) + ' ' if len(names) > 1 else ''}miss each other by "
        f"{1e3 * gap:.1f} mm here and by less than {THINNEST:g} m along {len(np.unique(one[rows]))} walls; if they "
        f"should meet, building.weld = {weld:g} joins them"
    )
    item = item_of(building.levels[min(level[one[first]], level[other[first]])])
    return (Finding("warning", text, names[0], (float(x), float(y)), item),)


def check_depth(building: Building) -> Iterator[Finding]:
    """Yield an error for each level less than 1 m deep between two portals that face each other."""
    for level in building.levels:
        for one, other in itertools.combinations(building.portals_of(level.index), 2):
            for a, b in itertools.product(one.segments_from(level.index), other.segments_from(level.index)):
                line = shapely.shortest_line(shapely.LineString(a.reshape(2, 2)), shapely.LineString(b.reshape(2, 2)))
                if line.length < LEAST_DEPTH - ROUNDING and _face(a, b):
                    x, y = line.centroid.coords[0]
                    text = (
                        f"level {level.name!r} is only {line.length:.2f} m deep between its portals "
                        f"{one.name!r} and {other.name!r} at ({x:z.2f}, {y:z.2f}); make it at least {LEAST_DEPTH:g} m "
                        f"deep, or join it to a neighbouring level; {measures(building)}"
                    )
                    yield Finding("error", text, level.title, (x, y), item_of(level))


def measures(building: Building) -> str:
    """Describe the size of the building for a message, in case its unit is not the metre."""
    width, depth, height = np.ptp(building.vertices, axis=0).tolist()
    return f"the building measures {width:.4g} x {depth:.4g} m in plan, {height:.4g} m in height (building.scale)"


def check_stairs(building: Building) -> Iterator[Finding]:
    """Yield an error for each stair that does not join two levels, or a level and an exit; walkways may join one."""
    for name, members in building.stairs.items():
        ends = {f"exit {way.name!r}" for way in building.exits if way.level in members}
        for portal in building.portals:
            one, other = portal.levels
            if (one in members) != (other in members):
                ends.add(f"level {building.levels[other if one in members else one].title!r}")
        own = [building.levels[index] for index in members]
        is_flat = all(level.slope == 0.0 for level in own)
        if len(ends) < 2 and not (is_flat and len(building.portals_of(members[0])) > 1):
            x, y = place_of(own[0].polygon)
            joined = f"only {ends.pop()}" if ends else "nothing"
            text = (
                f"stair {name!r} at ({x:z.2f}, {y:z.2f}), z = {min(lv.z_min for lv in own):.2f} to "
                f"{max(lv.z_max for lv in own):.2f}, joins {joined}: its ends must share vertices with two levels "
                f"(within building.weld)"
            )
            yield Finding("error", text, name, (x, y), f"stairs.{name}")


def check_exits(building: Building) -> Iterator[Finding]:
    """Yield an error for a building without an exit, at its longest wall."""
    if building.exits:
        return
    level, place, example = building.levels[building.wall_level.min(initial=0)], None, ""
    own = building.walls[building.wall_level == level.index]
    if len(own):
        longest = own[np.argmax(segment_lengths(own).round(6))]
        place, (x1, y1, x2, y2) = place_of(longest), longest.tolist()
        example = (
            f', such as name = "exit", segment = [[{x1:z.2f}, {y1:z.2f}], [{x2:z.2f}, {y2:z.2f}]], '
            f'level = "{level.name}" (storey = in a plan)'
        )
    remedy = f"give it one, as [[building.exits]] in case.toml or [[exits]] in a plan{example}"
    yield Finding("error", "the building has no exit", level.title, place, "exits", remedy)


def check_ground(building: Building) -> Iterator[Finding]:
    """Yield a warning for each exit before which nobody can stand, as beside a stair that fills its room."""
    for way in building.exits:
        own = shapely.multilinestrings(way.segments.reshape(-1, 2, 2))
        portals = [portal.segments for portal in building.portals if way.level in portal.levels]
        if any(
            shapely.dwithin(shapely.linestrings(ends.reshape(-1, 2, 2)), own, LEAST_GROUND).any() for ends in portals
        ):
            continue  # people come from the level behind it
        around = building.levels[way.level].polygon.intersection(own.buffer(3.0 * LEAST_GROUND))
        ground = around.buffer(-LEAST_GROUND / 2.0)  # of the centres of bodies
        if ground.is_empty or own.distance(ground) > LEAST_GROUND / 2.0 + ROUNDING:
            text = f"exit {way.name!r} cannot be used: the floor before it is less than {LEAST_GROUND:g} m deep"
            remedy = "move it, or what is in the way, such as a stair"
            level = building.levels[way.level].title
            yield Finding("warning", text, level, place_of(way.segments), f"exits.{way.name}", remedy)


def _face(a: FloatArray, b: FloatArray) -> bool:
    """Return whether two segments face each other: opposed inward normals, each partly on the other's inner side."""
    step_a, step_b = a[2:] - a[:2], b[2:] - b[:2]
    opposed = float(step_a @ step_b) < FACING * float(np.hypot(*step_a) * np.hypot(*step_b))
    return opposed and _is_ahead(a, b) and _is_ahead(b, a)


def _is_ahead(a: FloatArray, b: FloatArray) -> bool:
    """Return whether any end of segment b is on the left of segment a."""
    return bool((side_of(a, b[[0, 2]], b[[1, 3]]) > ROUNDING).any())
