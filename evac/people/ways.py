"""Check that everybody can reach an exit: walks along the directions, and connectivity of the ground."""

import itertools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.arrays import FloatArray, IntArray
from evac.building.components import connected_components
from evac.building.model import Building
from evac.building.narrow import CLOSED
from evac.directions.fields import Fields
from evac.directions.sampling import cell_of, sample_direction
from evac.errors import ScenarioError
from evac.jit import Bytes, Ints, Longs, Pairs, Triples, inner, kernel
from evac.physics.seams import crossing, side_of
from evac.physics.sight import bucket_at, passes_through
from evac.physics.state import Crowd, World

if TYPE_CHECKING:
    from pathlib import Path

    from evac.people.population import Group

#: Step length of a walk, in cells.
STEP = 0.5
#: A walk fails if it exceeds the length of the way by this factor plus this number of cells.
LONGEST, EXTRA = 3.0, 200.0
#: Minimum length that the outline of a part of a level shares with a portal or exit on it [m].
SHARED = 0.1

# Outcomes of a walk.
ARRIVED, LOST = 0, 1


def check_ways(
    source: "Path", building: Building, fields: Fields, world: World, crowd: Crowd, groups: "tuple[Group, ...]"
) -> None:
    """Check that everybody can reach an exit, by three criteria that must agree.

    The travel time is finite; the ground is connected to an exit of the route; and a point that starts at the position
    of the person, follows the directions and slides along walls arrives at an exit. The last criterion is checked for
    every route that is available there, since behaviours may change the route, and only if the clearance of directions
    is at least one cell: with less clearance, directions touch corners, which a point does not pass as a body does.

    Parameters
    ----------
    source : Path
        File of the case, for messages.
    building : Building
    fields : Fields
    world : World
        World of the building and the fields.
    crowd : Crowd
        The people at the start.
    groups : tuple of Group

    Raises
    ------
    ScenarioError
        People cannot reach any permitted exit, or the criteria disagree; names the group, the place and what to
        change.
    """
    time = fields.travel_time_at(crowd.level, crowd.position, crowd.route)
    is_connected = _connected(building, fields, crowd)
    for group in groups:
        rows = group.rows
        lost = rows[~np.isfinite(time[rows])]
        if lost.size:
            raise ScenarioError(_unreachable(source, building, fields, crowd, group, lost, is_connected))
        leaking = rows[~is_connected[rows]]
        if leaking.size:
            what = f"have a travel time but no ground to {fields.routes[crowd.route[leaking[0]]].destination}"
            raise ScenarioError(
                f"{_affected(source, building, crowd, group, leaking, what)}: the grid passes through a wall; choose "
                "another directions.spacing, and report this case as a bug of evac"
            )
    for route in range(len(fields.routes)) if fields.clearance >= fields.packed.spacing else ():
        _check_walks(source, building, fields, world, crowd, groups, route)


def _check_walks(
    source: "Path",
    building: Building,
    fields: Fields,
    world: World,
    crowd: Crowd,
    groups: "tuple[Group, ...]",
    route: int,
) -> None:
    """Check one route by walks along its directions from all start positions."""
    people = len(crowd.level)
    # Reference speeds are at most 1 m/s, so the travel time [s] is an upper bound of the path length [m].
    time = fields.travel_time_at(crowd.level, crowd.position, route)
    most = np.where(np.isfinite(time), LONGEST * np.maximum(time, 0.0) / (STEP * world.fields.spacing) + EXTRA, 0.0)
    nodes = int((world.fields.shape[:, 0].astype(np.int64) * world.fields.shape[:, 1]).sum())
    seen = np.zeros(nodes, dtype=np.uint8)
    first = np.concatenate([[0], np.cumsum(world.fields.shape.astype(np.int64).prod(axis=1))])
    ends = np.zeros((people, 3))
    steps = most.astype(np.int64)
    trail = np.empty(steps.max() + 1, np.int64)
    walk_all(world, crowd.position, crowd.level, route, steps, first, seen, trail, ends)
    for group in groups:
        lost = group.rows[ends[group.rows, 2] >= 0.0]
        if lost.size:
            x, y, level = ends[lost[0]]
            what = f"do not arrive at an exit along the directions {fields.routes[route]!s}"
            raise ScenarioError(
                f"{_affected(source, building, crowd, group, lost, what)}; they end at ({x:.2f}, {y:.2f}) on level "
                f"{building.levels[int(level)].name!r}: check for a gap there narrower than two cells of "
                f"directions.spacing = {world.fields.spacing:g} m, and choose a smaller spacing"
            )


def _affected(source: "Path", building: Building, crowd: Crowd, group: "Group", rows: IntArray, what: str) -> str:
    """Return the beginning of a message: the number of affected people of a group, the problem and the place."""
    x, y = crowd.position[rows[0]]
    return (
        f"{source}: people.{group.name}: {rows.size} of {len(group.rows)} people {what}, "
        f"the first at ({x:.2f}, {y:.2f}) on level {building.levels[crowd.level[rows[0]]].name!r}"
    )


def _unreachable(
    source: "Path",
    building: Building,
    fields: Fields,
    crowd: Crowd,
    group: "Group",
    rows: IntArray,
    is_connected: NDArray[np.bool_],
) -> str:
    """Describe, for a message, why people have no travel time to an exit."""
    exits = " or ".join(fields.routes[crowd.route[rows[0]]].exits) or "any exit"
    told = _affected(source, building, crowd, group, rows, f"cannot reach {exits}")
    if is_connected[rows[0]]:
        return (
            f"{told}; the ground leads there, but through a gap that the grid with directions.spacing = "
            f"{fields.packed.spacing:g} m does not resolve: reduce the spacing, or widen the gap"
        )
    opened = "remove a name from building.closed" if building.closed else "add a connection to the mesh"
    return f"{told}; move them, allow other exits, or {opened}"


def _connected(building: Building, fields: Fields, crowd: Crowd) -> NDArray[np.bool_]:
    """Return whether each person (n,) is connected to an exit of the route, by polygons instead of grids."""
    parts = [shapely.get_parts(level.polygon.buffer(-0.5 * CLOSED)) for level in building.levels]
    parts = [own[~shapely.is_empty(own)] for own in parts]  # a level that is too narrow everywhere has no parts
    # Nodes are the parts of all levels, then the exits.
    first = np.cumsum([0, *map(len, parts)])
    exit_node = first[-1] + np.arange(len(building.exits))
    pairs: list[tuple[int, int]] = []
    for portal in building.portals:
        if building.is_open(portal):
            one, other = (first[level] + _parts_at(parts[level], portal.segments) for level in portal.levels)
            pairs += itertools.product(one, other)
    for way in building.exits:
        if building.is_open(way):
            beside = first[way.level] + _parts_at(parts[way.level], way.segments)
            pairs += itertools.product(beside, [exit_node[way.index]])
    nodes = int(first[-1]) + len(building.exits)
    component = connected_components(nodes, np.array(pairs, dtype=np.int64).reshape(-1, 2))
    leads_out = np.array(
        [
            np.isin(component, [component[exit_node[way.index]] for way in building.exits if route.leads_to(way.name)])
            for route in fields.routes
        ]
    )
    found = np.zeros(len(crowd.level), dtype=np.bool_)
    for level, own in enumerate(parts):
        here = np.flatnonzero(crowd.level == level)
        if not len(own):
            continue
        nearest = np.zeros(len(here), np.int64)
        if len(own) > 1:
            nearest = shapely.STRtree(own).nearest(shapely.points(crowd.position[here]))
        found[here] = leads_out[crowd.route[here], first[level] + nearest]
    return found


def _parts_at(parts: NDArray[Any], segments: FloatArray) -> NDArray[np.int64]:
    """Return the parts of a level that a portal or exit is on."""
    line = shapely.buffer(shapely.multilinestrings(segments.reshape(-1, 2, 2)), CLOSED, cap_style="flat")
    shared = shapely.length(shapely.intersection(shapely.boundary(parts), line))
    return np.flatnonzero(shared > SHARED)


@kernel
def walk_all(
    world: World,
    position: Pairs,
    level: Ints,
    route: int,
    most: Longs,
    first: Longs,
    seen: Bytes,
    trail: Longs,
    ends: Triples,
) -> None:
    """Walk from all positions; a walk that reaches a cell from which another walk arrived ends there.

    Parameters
    ----------
    world : World
    position : (n, 2) float64 [m]
    level : (n,) int32
    route : int
    most : (n,) int64
        Maximum number of steps of each walk; 0 to skip it.
    first : (levels,) int64
        Number of the first cell of each level.
    seen : (cells,) uint8
        Written: 1 in cells from which an exit is reached.
    trail : (steps,) int64
        Scratch for the cells of one walk.
    ends : (n, 3) float64
        Written: end of each failed walk, x, y [m] and level; the level is -1 if the walk arrived.
    """
    for p in range(position.shape[0]):
        ends[p, 2] = -1.0
        if most[p] == 0:
            continue
        x, y, at = position[p, 0], position[p, 1], level[p]
        count = 0
        while count < most[p] and at >= 0:
            ix, iy, _, _ = cell_of(world.fields, x, y, at)
            cell = first[at] + ix * world.fields.shape[at, 1] + iy
            if seen[cell]:
                at = -1
                break
            trail[count] = cell
            count += 1
            x, y, at = walk_on(world, x, y, at, route)
        if at < 0:
            for k in range(count):
                seen[trail[k]] = 1
        else:
            ends[p, 0], ends[p, 1], ends[p, 2] = x, y, at


@inner
def walk_on(world: World, ax: float, ay: float, level: int, route: int) -> tuple[float, float, int]:
    """Make one step along the direction, or along a wall in its way; return position and level, -1 beyond an exit."""
    ex, ey = sample_direction(world.fields, ax, ay, level, route)
    length = STEP * world.fields.spacing
    step_x, step_y = length * ex, length * ey
    for _ in range(3):
        bx, by = ax + step_x, ay + step_y
        wall = first_wall(world, ax, ay, bx, by, level)
        if wall < 0:
            break
        tx = world.wall[wall, 2] - world.wall[wall, 0]
        ty = world.wall[wall, 3] - world.wall[wall, 1]
        # A full step: near a corner, directions may point almost straight at the wall.
        across = ex * tx + ey * ty
        along = (1.0 if across > 0.0 else -1.0 if across < 0.0 else 0.0) * length / math.sqrt(tx * tx + ty * ty)
        step_x, step_y = along * tx, along * ty
    else:
        return ax, ay, level
    passed = 0.0
    for _ in range(4):
        best, link = 2.0, -1
        for s in range(world.link_start[level], world.link_start[level + 1]):
            if world.link_open[world.link_id[s]]:
                share = crossing(world.link_segment, s, ax, ay, bx, by, 0.0)
                if passed <= share < best:
                    best, link = share, s
        if link < 0:
            break
        level = world.link_to[link]
        if level < 0:
            break
        passed = best
    return bx, by, level


@inner
def first_wall(world: World, ax: float, ay: float, bx: float, by: float, level: int) -> int:
    """Return the first wall of a level that the line from a to b crosses, -1 for none."""
    found, least = -1, 2.0
    first, last = bucket_at(world, ax, ay)
    for slot in range(first, last):
        w = world.bucket_wall[slot]
        if world.wall_level[w] != level or world.wall_open[w]:
            continue
        if passes_through(world.wall, w, ax, ay, bx, by):
            x1, y1, x2, y2 = world.wall[w, 0], world.wall[w, 1], world.wall[w, 2], world.wall[w, 3]
            before = side_of(x1, y1, x2, y2, ax, ay)
            share = before / (before - side_of(x1, y1, x2, y2, bx, by))
            if share < least:
                found, least = w, share
    return found
