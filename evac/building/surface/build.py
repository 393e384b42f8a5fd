"""Conversion of a surface mesh to a `Building`."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from evac.base.defaults import FLAT_ANGLE, HEADROOM, SCALE, UP, WALKABLE_ANGLE, WELD
from evac.base.errors import BuildingError
from evac.building.geometry.polygons import union
from evac.building.model.building import Area, Building
from evac.building.model.elevation import level_elevation
from evac.building.model.links import close_links, find_doors, find_exits_and_walls, find_portals
from evac.building.surface.checks import (
    check_depth,
    check_exits,
    check_overlap,
    check_stairs,
    isolated_parts,
    missed_seams,
)
from evac.building.surface.edges import COLLINEAR, edge_table
from evac.building.surface.foreign import turned
from evac.building.surface.levels import LevelSet, find_levels
from evac.building.surface.places import HEIGHT_REACH, LEAST_LENGTH, add_area, add_exit, add_obstacles
from evac.building.surface.surface import Surface, clean_surface
from evac.building.surface.surfacemesh import SurfaceMesh, checked

#: Largest height of a tagged obstacle above its floor [m]; a table or counter may be drawn by its top.
OBSTACLE_HEIGHT = 1.2


def build_building(
    mesh: SurfaceMesh,
    source: Path,
    *,
    weld: float = WELD,
    flat_angle: float = FLAT_ANGLE,
    walkable_angle: float = WALKABLE_ANGLE,
    scale: float = SCALE,
    up: str = UP,
    headroom: float = HEADROOM,
    treads: bool = True,
    exits: Sequence[Mapping[str, Any]] = (),
    areas: Sequence[Mapping[str, Any]] = (),
    obstacles: Sequence[Mapping[str, Any]] = (),
    closed: Sequence[str] = (),
    need_exit: bool = True,
) -> Building:
    """Build a `Building` from a surface mesh with or without tags.

    The result depends only on the geometry, not on the order of vertices and cells or on their orientation.
    Walls have the inside of their level on their left.

    Parameters
    ----------
    mesh : SurfaceMesh
    source : Path
        The file that the mesh was read from, for messages.
    weld : float [m]
        Vertices at most this far apart are merged.
    flat_angle, walkable_angle : float [degrees]
        Cells with a slope below `flat_angle` are flat, those above `walkable_angle` are not walkable.
    scale : float
        Metres per unit of the mesh.
    up : "z" or "y"
        Axis of the mesh that points upwards.
    headroom : float [m]
        Ground on solid bodies, and beside flights of treads, with less free height above it is removed; 0 keeps it.
    treads : bool
        Whether stairs drawn as treads are replaced by inclined flights.
    exits : sequence of mappings
        Exits to add: ``name``, ``segment`` on free edges ((2, 2) [m]) and ``level`` (name) or ``z`` (height [m]).
    areas, obstacles : sequences of mappings
        Areas and obstacles to add: ``name``, ``polygon`` ((k, 2) [m]) and ``level`` or ``z``.
    closed : sequence of str
        Names of exits, portals and stairs that are closed during the whole run.
    need_exit : bool
        Whether a building without exits is an error. Without exits, a building can be inspected but not simulated.

    Returns
    -------
    Building

    Raises
    ------
    BuildingError
        If a setting is out of range or the building cannot be used: no cell is walkable, an edge has three cells, a
        level overlaps itself in plan or is less than 1 m deep between facing portals, a stair does not join two levels,
        an exit is not on a free edge, there is no exit, or a name in `closed` does not exist.
    PluginError
        If an array of the mesh has the wrong shape.
    """
    surface = clean(
        mesh,
        source,
        weld=weld,
        flat_angle=flat_angle,
        walkable_angle=walkable_angle,
        scale=scale,
        up=up,
        headroom=headroom,
        treads=treads,
    )
    return building_of(
        surface, source, exits=exits, areas=areas, obstacles=obstacles, closed=closed, need_exit=need_exit
    )


def clean(
    mesh: SurfaceMesh,
    source: Path,
    *,
    weld: float = WELD,
    flat_angle: float = FLAT_ANGLE,
    walkable_angle: float = WALKABLE_ANGLE,
    scale: float = SCALE,
    up: str = UP,
    headroom: float = HEADROOM,
    treads: bool = True,
) -> Surface:
    """Return the clean walkable surface of a mesh in metres; see `build_building` for the arguments and errors."""
    if not (0.0 <= weld < np.inf and 0.0 < scale < np.inf and 0.0 < flat_angle < walkable_angle < 90.0):
        raise BuildingError(
            f"{source}: building needs weld >= 0, scale > 0 and 0 < flat_angle < walkable_angle < 90 degrees, "
            f"not weld = {weld:g}, scale = {scale:g}, flat_angle = {flat_angle:g}, walkable_angle = {walkable_angle:g}"
        )
    if up not in ("z", "y") or not 0.0 <= headroom < np.inf:
        raise BuildingError(f"{source}: building needs up = 'z' or 'y' and headroom >= 0, not {up!r} and {headroom!r}")
    return clean_surface(turned(checked(source, mesh), up), weld, flat_angle, walkable_angle, scale, headroom, treads)


def building_of(
    surface: Surface,
    source: Path,
    *,
    exits: Sequence[Mapping[str, Any]] = (),
    areas: Sequence[Mapping[str, Any]] = (),
    obstacles: Sequence[Mapping[str, Any]] = (),
    closed: Sequence[str] = (),
    need_exit: bool = True,
) -> Building:
    """Return the building of a clean surface; see `build_building` for the arguments and errors."""
    table = edge_table(source, surface.vertices, surface.triangles)
    level_set = find_levels(source, surface, table)
    tagged_exits, walls, wall_level = find_exits_and_walls(source, surface, table, level_set)
    building = Building(
        source=source,
        vertices=surface.vertices,
        levels=level_set.levels,
        portals=find_portals(surface, table, level_set),
        exits=tagged_exits,
        areas=_tagged_areas(source, surface, level_set),
        walls=walls,
        wall_level=wall_level,
        stairs=level_set.stairs,
        findings=(*surface.findings, *level_set.findings),
        doors=find_doors(surface, level_set.levels),
    )
    check_overlap(building)
    check_depth(building)
    building = replace(building, findings=(*building.findings, *missed_seams(building)))
    for item in exits:
        with _given("exits", item):
            building = add_exit(building, item)
    if need_exit:
        check_exits(building)
    check_stairs(building)
    for item in areas:
        with _given("areas", item):
            building = add_area(building, item)
    building = add_obstacles(building, [*_standing_obstacles(building, surface), *obstacles])
    building = replace(building, findings=(*building.findings, *(isolated_parts(building) if building.exits else ())))
    return close_links(building, closed) if closed else building


@contextmanager
def _given(key: str, item: Mapping[str, Any]) -> Iterator[None]:
    """Add the key of a place in the case to errors, which name the mesh only."""
    try:
        yield
    except BuildingError as error:
        raise BuildingError(f"{error} (given as building.{key}.{item['name']})") from error


def _tagged_areas(source: Path, surface: Surface, level_set: LevelSet) -> tuple[Area, ...]:
    """Make the areas of the tags ``area:NAME``, in the order of their names."""
    areas = []
    for tag in sorted(name for name in surface.cell_tags if name.startswith("area:")):
        cells = np.flatnonzero(surface.cell_tags[tag])
        on = np.unique(level_set.level_of_cell[cells])
        if len(on) != 1:
            names = " and ".join(repr(level_set.levels[level].name) for level in on) or "no walkable level"
            raise BuildingError(f"{source}: {tag!r} lies on {names}; put an area on exactly one walkable level")
        plan = shapely.polygons(surface.vertices[surface.triangles[cells]][:, :, :2])
        areas.append(Area(tag.removeprefix("area:"), int(on[0]), union(plan).normalize()))
    return tuple(areas)


def _standing_obstacles(building: Building, surface: Surface) -> list[dict[str, Any]]:
    """Find tagged obstacles drawn on top of a floor; obstacles cut out of the floor already have walls."""
    found = []
    for tag, corners in sorted(surface.obstacles.items()):
        cells = shapely.polygons(corners[:, :, :2])
        outline = union(cells[shapely.area(cells) > LEAST_LENGTH**2]).simplify(COLLINEAR)
        z = float(corners[:, :, 2].min())
        for level in building.levels:
            on = outline.intersection(level.polygon)
            if on.area <= LEAST_LENGTH**2:
                continue
            height = level_elevation(building.vertices, level, shapely.get_coordinates(on.centroid))[0]
            if -HEIGHT_REACH <= z - height <= OBSTACLE_HEIGHT:
                found.append({"name": tag.removeprefix("obstacle:"), "polygon": on, "level": level.name})
    return found
