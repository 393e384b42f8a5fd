"""Conversion of a surface mesh to a `Building`, and checks before anything is computed on it."""

import itertools
import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import LEAST_LENGTH
from evac.base.errors import BuildingError
from evac.base.keys import Point
from evac.base.progress import reading
from evac.building.geometry import connected_components, flat_parts, place_of, segment_lengths, side_of, union
from evac.building.model.building import Area, Building, Level
from evac.building.model.elevation import elevation, level_elevation
from evac.building.model.findings import Finding, item_of, noting, numbered, refusal
from evac.building.model.links import close_links, isolated_parts, set_moving, with_controls
from evac.building.options import BuildingOptions, ExitLine, Outline, SurfaceOptions
from evac.building.surface import levels
from evac.building.surface.foreign import turned
from evac.building.surface.places import HEIGHT_REACH, add_area, add_exit, add_obstacles, obstacle_place
from evac.building.surface.surface import Surface, clean_surface
from evac.building.surface.surfacemesh import SurfaceMesh, checked

#: Largest height of a tagged obstacle above its floor [m]; a table or counter may be drawn by its top.
OBSTACLE_HEIGHT = 1.2

DEFAULT = BuildingOptions()


def build_building(
    mesh: SurfaceMesh, source: Path, options: BuildingOptions = DEFAULT, *, need_exit: bool = True
) -> Building:
    """Build a `Building` from a surface mesh; it depends on the geometry only, not on the order of cells."""
    return building_of(clean(mesh, source, options), source, options, need_exit=need_exit)


def clean(mesh: SurfaceMesh, source: Path, options: SurfaceOptions = DEFAULT) -> Surface:
    """Return the clean walkable surface of a mesh in metres; see `build_building` for the arguments and errors."""
    reading(1)
    return clean_surface(turned(checked(source, mesh), options.up), options)


def building_of(
    surface: Surface, source: Path, options: BuildingOptions = DEFAULT, *, need_exit: bool = True
) -> Building:
    """Return the building of a clean surface; see `build_building` for the arguments and errors."""
    reading(2)
    try:
        return _building_of(surface, source, options, need_exit)
    except BuildingError as error:
        if not surface.doubts:
            raise
        found = error.findings or (Finding("error", str(error).removeprefix(f"{source}: ")),)
        text = "; ".join([found[-1].text, *(doubt.text for doubt in surface.doubts)])
        raise refusal(source, [*found[:-1], replace(found[-1], text=text)]) from error
    finally:
        reading(3)


def _building_of(surface: Surface, source: Path, options: BuildingOptions, need_exit: bool) -> Building:
    table = levels.edge_table(source, surface.vertices, surface.triangles)
    level_set = levels.find_levels(source, surface, table)
    tagged_exits, walls, wall_level = levels.find_exits_and_walls(source, surface, table, level_set)
    areas, divided = _tagged_areas(source, surface, level_set)
    notes = (*divided, *(Finding("missing", text) for text in options.missing))
    building = Building(
        source=source,
        vertices=surface.vertices,
        levels=tuple(
            replace(level, is_ramp=0.0 < math.tan(level.slope) <= options.ramp * (1.0 + 1e-9))
            for level in level_set.levels
        ),
        portals=levels.find_portals(surface, table, level_set),
        exits=tagged_exits,
        areas=areas,
        walls=walls,
        wall_level=wall_level,
        stairs=level_set.stairs,
        findings=(*surface.findings, *level_set.findings, *notes),
        doors=levels.find_doors(surface, level_set.levels),
        north=surface.given.north if options.north is None else options.north,
    )
    if errors := [*check_overlap(building), *check_depth(building)]:
        raise refusal(source, errors)
    building = replace(building, findings=(*building.findings, *missed_seams(building)))
    for item in options.exits:
        with _given(errors, "exit", item, item.segment):
            building = add_exit(building, item)
    errors += [*(check_exits(building) if need_exit and not errors else ()), *check_stairs(building)]
    for area in options.areas:
        with _given(errors, "area", area, area.polygon):
            building = add_area(building, area)
    obstacles = _standing_obstacles(building, surface)
    for one in options.obstacles:
        with _given(errors, "obstacle", one, one.polygon):
            obstacles.append((f"building.obstacles.{one.name}", *obstacle_place(building, one)))
    building = add_obstacles(building, obstacles, errors)
    if errors:
        raise refusal(source, errors)
    if surface.given.lifts or options.lifts:
        from evac.building.model.lifts import with_lifts_of

        building = with_lifts_of(building, surface.given.lifts, options.lifts)
    more = [*isolated_parts(building), *check_ground(building)] if building.exits else []
    building = replace(building, findings=(*building.findings, *more))
    building = with_controls(building, surface.given.controls)
    for name, control in options.controls.items():
        with _named(f"building.controls.{name}"):
            building = with_controls(building, {name: control})
    for name, moving in options.moving.items():
        with _named(f"building.moving.{name}"):
            building = set_moving(building, name, moving)
    with _named("building.closed"):
        return close_links(building, options.closed) if options.closed else building


@contextmanager
def _named(key: str) -> Iterator[None]:
    """Add a key of the case to an error."""
    try:
        yield
    except BuildingError as error:
        raise BuildingError(f"{error} (given as {key})") from None


def _given(
    errors: list[Finding], kind: str, item: ExitLine | Outline, corners: Sequence[Point]
) -> AbstractContextManager[None]:
    """Collect what is wrong with an item of the case."""
    key = f"building.{kind}s.{item.name}"
    return noting(errors, f"{kind} {item.name!r} (given as {key})", key, item.level, np.array(corners))


def _tagged_areas(source: Path, surface: Surface, level_set: levels.LevelSet) -> tuple[tuple[Area, ...], list[Finding]]:
    """Make the areas of the tags ``area:NAME``, in the order of their names; one over several levels is divided."""
    areas, notes = [], []
    names = sorted(tag.removeprefix("area:") for tag in surface.cell_tags if tag.startswith("area:"))
    taken = set(names)
    for name in names:
        cells = np.flatnonzero(surface.cell_tags[f"area:{name}"])
        level_of = level_set.level_of_cell[cells]
        parts = [
            (union(shapely.polygons(surface.vertices[surface.triangles[cells[level_of == level]]][:, :, :2])), level)
            for level in np.unique(level_of).tolist()
        ]
        if not parts:
            raise BuildingError(f"{source}: area {name!r} lies on no walkable level; put it on a level")
        parts.sort(key=lambda part: (-part[0].area, part[1]))
        use, people = surface.given.uses.get(name, ("", None))
        ground = sum(polygon.area for polygon, _ in parts)
        for row, (polygon, level) in enumerate(parts):
            own = numbered(name, taken) if row else name
            taken.add(own)
            share = None if people is None else people * polygon.area / ground
            areas.append(Area(own, level, polygon.normalize(), use, share))
        if len(parts) > 1:
            text = f"area {name!r} lies on {len(parts)} levels and has been divided into as many areas"
            on = level_set.levels[parts[0][1]].name
            notes.append(Finding("assumed", text, on, place_of(parts[0][0]), f"areas.{name}"))
    return tuple(areas), notes


def _standing_obstacles(building: Building, surface: Surface) -> list[tuple[str, Level, BaseGeometry]]:
    """Find tagged obstacles on top of a floor, also on several storeys; those cut out of it have walls already."""
    obstacles = []
    for tag, corners in ((tag, own) for tag, given in sorted(surface.obstacles.items()) for own in _by_foot(given)):
        cells = shapely.polygons(corners[:, :, :2])
        outline = union(cells[shapely.area(cells) > LEAST_LENGTH**2]).simplify(levels.COLLINEAR)
        z = float(corners[:, :, 2].min())
        for level in building.levels:
            on = flat_parts(outline.intersection(level.polygon))
            if on.area <= LEAST_LENGTH**2:
                continue
            height = level_elevation(building.vertices, level, shapely.get_coordinates(on.centroid))[0]
            if -HEIGHT_REACH <= z - height <= OBSTACLE_HEIGHT:
                obstacles.append((tag.replace(":", "s.", 1), level, on))
    return obstacles


def _by_foot(corners: FloatArray) -> list[FloatArray]:
    """Return triangles (c, 3, 3) divided by the height of the lowest corner of the bodies that they form."""
    corner = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)[1].reshape(-1, 3)
    body = connected_components(corner.max(initial=-1) + 1, corner[:, [0, 1, 0, 2]].reshape(-1, 2))[corner[:, 0]]
    foot = np.full(len(corners), np.inf)
    np.minimum.at(foot, body, corners[:, :, 2].min(axis=1))
    return [corners[foot[body] == z] for z in np.unique(foot[body])]


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
ROUNDING = 1e-6  #: Rounding tolerance of lengths [m] and areas [m2].


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
