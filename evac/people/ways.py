"""Check that everybody can reach an exit: walks along the directions."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IntArray
from evac.base.change import Change
from evac.base.errors import ScenarioError, counted, some_of
from evac.building.model.building import Building
from evac.building.model.findings import Finding
from evac.directions.fields import Fields, columns_of
from evac.directions.sampling import cell_of, sample_direction, sample_travel_times
from evac.jit import Bytes, Floats, Ints, Longs, Pairs, Triples, inner, kernel
from evac.physics.contact.neighbours import segment_distance
from evac.physics.seams import crossing, passes_through, side_of, walls_near
from evac.physics.state import Crowd, World

if TYPE_CHECKING:
    from evac.people.population import Group

#: Step length of a walk, in cells.
STEP = 0.5
#: Parts of a step beside a wall, so that no body slips through a gap that is a millimetre narrower than it.
PARTS = 8
#: Greatest number of times that a body is moved away from the walls that it overlaps, and the overlap that is left [m].
MOVES, OVERLAP = 64, 2.5e-4
#: People who end within this distance of each other are stopped by the same place [m].
SAME_PLACE = 1.0
#: A walk fails if it exceeds the length of the way by this factor plus this number of cells.
LONGEST, EXTRA = 3.0, 200.0


def check_ways(
    source: Path,
    building: Building,
    fields: Fields,
    world: World,
    crowd: Crowd,
    groups: "tuple[Group, ...]",
    full: Sequence[str] = (),
    may_wait: bool = False,
) -> tuple[Finding, ...]:
    """Check that everybody can reach an exit, by two criteria that must agree.

    The travel time is finite; and the body of the person, which follows the directions and slides along walls, arrives
    at an exit, or a point in its place does. The last criterion is checked for every route that is available there,
    since behaviours may change the route, and only if the clearance of directions is at least one cell: with less
    clearance, directions touch corners, which a point does not pass as a body does.
    """
    walks, lost = _Walks(source, building, fields, world, crowd, groups), without_way(fields, crowd)
    if lost.any() and not may_wait:
        group = next(one for one in groups if lost[one.rows].any())
        raise ScenarioError(walks.unreachable(group, group.rows[lost[group.rows]], full))
    if fields.clearance < fields.packed.spacing:
        return ()
    findings: list[Finding] = []
    for route in (index for index, one in enumerate(fields.routes) if not (one.area or one.lifts)):
        ends = walks.walk(route)
        stopped = (ends[:, 2] >= 0.0) & (crowd.route == route)
        for group in groups:
            findings += walks.stopped_places(group, group.rows[stopped[group.rows]], ends)
    return tuple(findings)


def cut_off(
    building: Building,
    fields: Fields,
    crowd: Crowd,
    groups: "tuple[Group, ...]",
    since: FloatArray,
    changes: Sequence[Change],
) -> tuple[str, ...]:
    """Return a line for all people of a group whom the same changes have left without a way to the end of their route.

    `since` (n,) is the time from which each person has none [s], NaN for those who have one.
    """
    lines = []
    for group in groups:
        lost = group.rows[np.isfinite(since[group.rows]) & (crowd.level[group.rows] >= 0)]
        for time in np.unique(since[lost]).tolist():
            rows = lost[since[lost] == time]
            titles = {repr(building.levels[level].title): None for level in np.unique(crowd.level[rows]).tolist()}
            routes = np.unique(crowd.route[rows]).tolist()
            ends = " or ".join(sorted({fields.routes[route].area or "any exit" for route in routes}))
            events = " and ".join(str(change) for change in changes if change.time == time)
            why = f" because of: {events}" if events else ""
            lines.append(
                f"people.{group.name}: {counted(len(rows), 'person', 'people')} on {', '.join(titles)} "
                f"cannot reach {ends} any more{why}; they stop: {some_of(rows.tolist())}"
            )
    return tuple(lines)


def without_way(fields: Fields, crowd: Crowd) -> BoolArray:
    """Return which people inside have an infinite travel time (n,), except those who stay."""
    here, time = np.flatnonzero(crowd.level >= 0), np.zeros(len(crowd.level))
    time[here] = fields.travel_time_at(*crowd.ways(here))
    return np.isinf(time) & np.isfinite(crowd.start_time)


@dataclass(frozen=True)
class _Walks:
    """Walks of all people along the directions of their routes, and what is said of those who do not arrive."""

    source: Path
    building: Building
    fields: Fields
    world: World
    crowd: Crowd
    groups: "tuple[Group, ...]"

    def walk(self, route: int) -> FloatArray:
        """Check one route by walks along its directions from all start positions; return where bodies are stopped.

        The ends (people, 3) are coordinates x, y [m] and level; the level of those who arrive is -1.
        """
        column = columns_of(self.fields.packed, np.full(len(self.crowd.level), route), self.crowd.contact_radius)
        ends = np.full((len(self.crowd.level), 3), -1.0)
        is_here = self.crowd.level >= 0
        for one in np.unique(column[is_here]):
            rows = np.flatnonzero(is_here & (column == one))
            # The widest first: where it arrives, the others of its class do.
            rows = rows[np.argsort(-self.crowd.contact_radius[rows], kind="stable")]
            ends[rows] = self._walked(rows, int(one), self.crowd.contact_radius[rows])
            ends[rows] = self._arrived(route, ends[rows])
            stopped = rows[ends[rows, 2] >= 0.0]
            as_points = self._walked(stopped, int(one), np.zeros(len(stopped)))
            as_points = self._arrived(route, as_points)
            for group in self.groups:
                lost = group.rows[np.isin(group.rows, stopped[as_points[:, 2] >= 0.0])]
                if lost.size:
                    x, y, level = as_points[stopped == lost[0]][0]
                    what = f"do not arrive at an exit along the directions {self.fields.routes[route]!s}"
                    raise ScenarioError(
                        f"{self._affected(group, lost, what)}; they end at ({x:.2f}, {y:.2f}) on level "
                        f"{self.building.levels[int(level)].title!r}: check for a gap there narrower than two cells of "
                        f"directions.spacing = {self.fields.packed.spacing:g} m, and choose a smaller spacing"
                    )
        return ends

    def _arrived(self, route: int, ends: FloatArray) -> FloatArray:
        """Return the ends of walks, of which those within a cell of an exit of a route have arrived."""
        # The cells of a long exit that is not parallel to the grid are partly behind it, where there are no directions.
        ends = ends.copy()
        names = self.fields.routes[route].exits
        for way in self.building.exits:
            if self.building.is_open(way) and (not names or way.name in names):
                line = shapely.multilinestrings(way.segments.reshape(-1, 2, 2))
                is_near = shapely.dwithin(shapely.points(ends[:, :2]), line, self.fields.packed.spacing)
                ends[is_near & (ends[:, 2] == way.level), 2] = -1.0
        return ends

    def _walked(self, rows: NDArray[np.int64], column: int, radius: FloatArray) -> FloatArray:
        """Return where the walks of some people end, as `walk_all`."""
        ends = np.zeros((len(rows), 3))
        if not len(rows):
            return ends
        level, position = self.crowd.level[rows], np.ascontiguousarray(self.crowd.position[rows])
        time = np.empty(len(rows))
        sample_travel_times(self.fields.packed, position, level, np.full(len(rows), column, np.int32), time)
        # Reference speeds are at most 1 m/s, so the travel time [s] is an upper bound of the path length [m].
        most = LONGEST * np.maximum(time, 0.0) / (STEP * self.world.fields.spacing) + EXTRA
        most = np.where(np.isfinite(time), most, 0.0)
        sizes = self.world.fields.shape.astype(np.int64).prod(axis=1)
        seen = np.zeros(int(sizes.sum()), dtype=np.uint8)
        first = np.concatenate([[0], np.cumsum(sizes)])
        steps = most.astype(np.int64)
        trail = np.empty(steps.max() + 1, np.int64)
        walk_all(self.world, position, level, column, radius, steps, first, seen, trail, ends)
        return ends

    def stopped_places(self, group: "Group", rows: IntArray, ends: FloatArray) -> list[Finding]:
        """Return a warning for each place where people of a group, in these rows, are stopped."""
        findings = []
        while rows.size:
            x, y, level = ends[rows[0]]
            away = np.hypot(ends[rows, 0] - x, ends[rows, 1] - y)
            here = (away < SAME_PLACE) & (ends[rows, 2] == level)
            widths = [f"{end(2.0 * self.crowd.contact_radius[rows[here]]):.2f}" for end in (np.min, np.max)]
            text = (
                f"people.{group.name}: {np.count_nonzero(here)} of {counted(len(group.rows), 'person', 'people')} "
                f"({' to '.join(dict.fromkeys(widths))} m wide) do not fit through here, and no other way to an exit "
                "is wide enough for them: widen the place, move them, or reduce their radius"
            )
            name, item = self.building.levels[int(level)].title, f"people.{group.name}"
            findings.append(Finding("warning", text, name, (float(x), float(y)), item))
            rows = rows[~here]
        return findings

    def _affected(self, group: "Group", rows: IntArray, what: str) -> str:
        """Return the beginning of a message: the number of affected people of a group, the problem and the place."""
        x, y = self.crowd.position[rows[0]]
        return (
            f"{self.source}: people.{group.name}: {rows.size} of {len(group.rows)} people {what}, "
            f"the first at ({x:.2f}, {y:.2f}) on level {self.building.levels[self.crowd.level[rows[0]]].title!r}"
        )

    def unreachable(self, group: "Group", rows: IntArray, full: Sequence[str]) -> str:
        """Describe, for a message, why people have no travel time to an exit."""
        route = self.fields.routes[self.crowd.route[rows[0]]]
        exits = " or ".join(route.exits) or "any exit"
        opened = (
            "remove a name from building.closed"
            if self.building.closed - self.building.lift_doors.keys()
            else "add a connection to the mesh"
        )
        if route.steepest is not None:
            exits += f" without slopes above {route.steepest:g}"
            opened = f"raise people.{group.name}.steepest"
        if full:
            opened += " or, because it is full, " + " or ".join(f"place.{name}.capacity" for name in full)
        return (
            f"{self._affected(group, rows, f'cannot reach {exits}')}; move them, allow other exits, "
            f"{opened}, or if a narrow gap leads there, reduce directions.spacing = {self.fields.packed.spacing:g} m"
        )


@kernel
def walk_all(
    world: World,
    position: Pairs,
    level: Ints,
    column: int,
    radius: Floats,
    most: Longs,
    first: Longs,
    seen: Bytes,
    trail: Longs,
    ends: Triples,
) -> None:
    """Walk from all positions; a walk that reaches a cell from which another walk arrived ends there.

    Bodies do not overlap walls; a radius of 0 is that of a point. `most` (n,) are the greatest numbers of steps, 0 for
    no walk; cells of a level are numbered from `first` (levels,) on. Cells from which an exit is reached are marked in
    `seen` (cells,); `trail` (steps,) is scratch; `ends` (n, 3) are x, y [m] and level of failed walks, or level -1.
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
            x, y, at = walk_on(world, x, y, at, column, radius[p])
            count += 1
        if at < 0:
            for k in range(count):
                seen[trail[k]] = 1
        else:
            ends[p, 0], ends[p, 1], ends[p, 2] = x, y, at


@inner
def walk_on(world: World, ax: float, ay: float, level: int, column: int, radius: float) -> tuple[float, float, int]:
    """Make one step along the direction, or along a wall in its way; return position and level, -1 beyond an exit."""
    length, parts = STEP * world.fields.spacing, 1
    if radius > 0.0:
        _, _, moves = off_walls(world, ax, ay, level, radius + length)
        if moves > 0:
            length, parts = length / PARTS, PARTS
    for _ in range(parts):
        ex, ey = sample_direction(world.fields, ax, ay, level, column)
        bx, by = slide(world, ax, ay, level, length, ex, ey)
        if radius > 0.0:
            bx, by, moves = off_walls(world, bx, by, level, radius)
            if moves == MOVES or first_wall(world, ax, ay, bx, by, level) >= 0:
                break
        level = level_behind(world, ax, ay, bx, by, level)
        ax, ay = bx, by
        if level < 0:
            break
    return ax, ay, level


@inner
def slide(world: World, ax: float, ay: float, level: int, length: float, ex: float, ey: float) -> tuple[float, float]:
    """Return the end of a step along a direction, or along a wall in its way."""
    step_x, step_y = length * ex, length * ey
    for _ in range(3):
        wall = first_wall(world, ax, ay, ax + step_x, ay + step_y, level)
        if wall < 0:
            return ax + step_x, ay + step_y
        tx = world.wall[wall, 2] - world.wall[wall, 0]
        ty = world.wall[wall, 3] - world.wall[wall, 1]
        # A full step: near a corner, directions may point almost straight at the wall.
        across = ex * tx + ey * ty
        along = (1.0 if across > 0.0 else -1.0 if across < 0.0 else 0.0) * length / math.sqrt(tx * tx + ty * ty)
        step_x, step_y = along * tx, along * ty
    return ax, ay


@inner
def off_walls(world: World, x: float, y: float, level: int, radius: float) -> tuple[float, float, int]:
    """Return a place near a position at which a body overlaps no wall, and how often it was moved: at most `MOVES`."""
    for moves in range(MOVES):
        is_free = True
        first, last = walls_near(world, level, x, y, 0.0)
        for slot in range(first, last):
            w = world.bucket_wall[slot]
            if world.wall_open[w]:
                continue
            distance, wx, wy = segment_distance(world.wall, w, x, y)
            if 0.0 < distance < radius - OVERLAP:
                x, y = x + (radius / distance - 1.0) * (x - wx), y + (radius / distance - 1.0) * (y - wy)
                is_free = False
        if is_free:
            return x, y, moves
    return x, y, MOVES


@inner
def level_behind(world: World, ax: float, ay: float, bx: float, by: float, level: int) -> int:
    """Return the level after a step from a to b through portals and exits, -1 beyond an exit."""
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
    return level


@inner
def first_wall(world: World, ax: float, ay: float, bx: float, by: float, level: int) -> int:
    """Return the first wall of a level that the line from a to b crosses, -1 for none."""
    found, least = -1, 2.0
    first, last = walls_near(world, level, ax, ay, 0.0)
    for slot in range(first, last):
        w = world.bucket_wall[slot]
        if world.wall_open[w]:
            continue
        if passes_through(world.wall, w, ax, ay, bx, by):
            x1, y1, x2, y2 = world.wall[w, 0], world.wall[w, 1], world.wall[w, 2], world.wall[w, 3]
            before = side_of(x1, y1, x2, y2, ax, ay)
            share = before / (before - side_of(x1, y1, x2, y2, bx, by))
            if share < least:
                found, least = w, share
    return found
