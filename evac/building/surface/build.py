"""Conversion of a surface mesh to a `Building`."""

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
from evac.building.geometry import connected_components, flat_parts, place_of, union
from evac.building.model.building import Area, Building, Level
from evac.building.model.elevation import level_elevation
from evac.building.model.findings import Finding, noting, numbered, refusal
from evac.building.model.links import close_links, isolated_parts, set_moving, with_controls
from evac.building.options import BuildingOptions, ExitLine, Outline, SurfaceOptions
from evac.building.surface.checks import (
    check_depth,
    check_exits,
    check_ground,
    check_overlap,
    check_stairs,
    missed_seams,
)
from evac.building.surface.foreign import turned
from evac.building.surface.levels import (
    COLLINEAR,
    LevelSet,
    edge_table,
    find_doors,
    find_exits_and_walls,
    find_levels,
    find_portals,
)
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
    return clean_surface(turned(checked(source, mesh), options.up), options)


def building_of(
    surface: Surface, source: Path, options: BuildingOptions = DEFAULT, *, need_exit: bool = True
) -> Building:
    """Return the building of a clean surface; see `build_building` for the arguments and errors."""
    try:
        return _building_of(surface, source, options, need_exit)
    except BuildingError as error:
        if not surface.doubts:
            raise
        found = error.findings or (Finding("error", str(error).removeprefix(f"{source}: ")),)
        text = "; ".join([found[-1].text, *(doubt.text for doubt in surface.doubts)])
        raise refusal(source, [*found[:-1], replace(found[-1], text=text)]) from error


def _building_of(surface: Surface, source: Path, options: BuildingOptions, need_exit: bool) -> Building:
    table = edge_table(source, surface.vertices, surface.triangles)
    level_set = find_levels(source, surface, table)
    tagged_exits, walls, wall_level = find_exits_and_walls(source, surface, table, level_set)
    areas, divided = _tagged_areas(source, surface, level_set)
    notes = (*divided, *(Finding("missing", text) for text in options.missing))
    building = Building(
        source=source,
        vertices=surface.vertices,
        levels=tuple(
            replace(level, is_ramp=0.0 < math.tan(level.slope) <= options.ramp * (1.0 + 1e-9))
            for level in level_set.levels
        ),
        portals=find_portals(surface, table, level_set),
        exits=tagged_exits,
        areas=areas,
        walls=walls,
        wall_level=wall_level,
        stairs=level_set.stairs,
        findings=(*surface.findings, *level_set.findings, *notes),
        doors=find_doors(surface, level_set.levels),
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


def _tagged_areas(source: Path, surface: Surface, level_set: LevelSet) -> tuple[tuple[Area, ...], list[Finding]]:
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
    """Find tagged obstacles drawn on top of a floor; obstacles cut out of the floor already have walls.

    Bodies of one name may stand on several storeys.
    """
    obstacles = []
    for tag, corners in ((tag, own) for tag, given in sorted(surface.obstacles.items()) for own in _by_foot(given)):
        cells = shapely.polygons(corners[:, :, :2])
        outline = union(cells[shapely.area(cells) > LEAST_LENGTH**2]).simplify(COLLINEAR)
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
