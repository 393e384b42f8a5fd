"""Grids of levels: own nodes, halos of the neighbouring levels behind portals, and strips behind exits."""

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import maximum_inscribed_circle

from evac.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from evac.base.progress import track
from evac.building.model.building import DOWN, FLAT, UP, Area, Building, Door, Exit, Level, Link, Portal
from evac.building.model.narrow import gaps_below, gaps_between_walls
from evac.directions.raster.lattice import (
    SLACK,
    Lattice,
    Window,
    behind,
    chain,
    free_rows,
    grown,
    parts_of,
    walkable_nodes,
    wall_distance,
)

#: Values of a sheet: not walkable, the level itself, or 1 + link for nodes behind a link.
NOTHING, OWN = -1, 0
#: Radius in cells of the ring around an end of ways within which times are those of the distance.
RING = 3
#: Minimum number of nodes around a level, into its walls and behind its exits.
MARGIN = 4


@dataclass(frozen=True)
class LevelGrid:
    """The grid of one level."""

    level: int
    alike: int  # first level whose grid has the same nodes and links at the same places
    window: Window
    # (nx, ny) int32: ``NOTHING``, ``OWN``, or 1 + link for a node of the neighbour behind a portal or of the strip
    # behind an exit
    sheet: IntArray
    # (nx, ny) int32: packed index of the node that a node represents: itself, or the neighbour's own node; -1 for none
    source: IntArray
    offset: int  # packed index of node (0, 0)
    # (r,) int64: packed indices of the own nodes and strips that may be nearer to a wall than the clearance
    ring: IndexArray
    distance: FloatArray  # (r,) float64: their distance to the nearest wall, at most the clearance [m]
    # dict of int to (2, s) int64: packed indices of the own nodes exactly on a portal, by portal: on this grid and on
    # the grid of the neighbour, where they are own nodes as well
    seams: dict[int, NDArray[np.int64]]
    # number of rows of the strip behind each open exit, by exit index; 0 if there is no room for a strip
    strip_rows: dict[int, int]
    # (2, d) int64: packed indices of own nodes before doors of one direction, each with the nearest one behind the door
    passages: IndexArray
    # (3, m) int64: packed indices of nodes of the level that are excluded from marching, each with the visible own node
    # that represents it and the next one in line; see `evac.directions.raster.lattice.walkable_nodes`
    stands_for: IndexArray

    @property
    def packed(self) -> slice:
        """Slice of the level's nodes in packed arrays."""
        return slice(self.offset, self.offset + self.sheet.size)

    def distances_from(self, area: Area) -> FloatArray:
        """Return the distances (nx, ny) of the nodes from the innermost point of an area [m]."""
        place = maximum_inscribed_circle(area.polygon).coords[0]
        x, y = self.window.coordinates()
        distance: FloatArray = np.hypot(x - place[0], y - place[1])
        return distance

    def nodes_near(self, segments: FloatArray, reach: float) -> IndexArray:
        """Return the packed indices of the nodes within a reach [m] of segments (s, 4)."""
        if not len(segments):
            return np.zeros(0, np.int64)
        lines = shapely.multilinestrings(segments.reshape(-1, 2, 2))
        shapely.prepare(lines)
        near = np.argwhere(self.window.around(shapely.get_parts(lines), reach))
        near = near[shapely.dwithin(lines, shapely.points(self.window.places(near)), reach)]
        nodes: IndexArray = self.offset + np.ravel_multi_index(tuple(near.T), self.window.shape)
        return nodes


class JumpWay(NamedTuple):
    """A jump, from the nodes around the middle of its start to the node in the middle of its end."""

    time: float  # [s]
    area: Area  # its start
    nodes: IndexArray
    away: FloatArray  # their distances from the middle [m]
    end: int


@dataclass(frozen=True)
class BuildingGrids:
    """The grids of all levels on a common lattice."""

    building: Building  # with portals and exits closed that are treated as closed
    lattice: Lattice
    levels: tuple[LevelGrid, ...]
    # tuple of (w, 4) float64: walls of each level, including closed portals and exits, gaps that are treated as closed,
    # and doors of one direction [m]
    walls: tuple[FloatArray, ...]
    clearance: float  # distance from walls up to which the slowness is increased [m]
    size: int  # total number of nodes of all grids
    margin: int  # number of nodes around each level; strips behind exits have at most one row less
    # (nodes,) float64 by width: weights of the kernels of densities on the floor, found when they are first needed
    weights: dict[float, FloatArray] = field(default_factory=dict)

    def portals_of(self, level: int) -> list[Portal]:
        """Return the open portals of a level."""
        return _open_portals(self.building, level)

    @property
    def own_nodes(self) -> BoolArray:
        """The mask (nodes,) of the own nodes of all levels."""
        return np.concatenate([(grid.sheet == OWN).ravel() for grid in self.levels])

    def is_ground(self, grid: LevelGrid) -> BoolArray:
        """Return the mask (nx, ny) of the nodes of a grid on a level: own nodes and halos, but not strips."""
        ground: BoolArray = (grid.sheet != NOTHING) & (grid.sheet <= len(self.building.portals))
        return ground

    def around(self, area: Area) -> tuple[IndexArray, FloatArray]:
        """Return the nodes around the innermost point of an area and their distances from it [m], the nearest first."""
        grid = self.levels[area.level]
        away = grid.distances_from(area)
        near = np.flatnonzero((away <= RING * self.lattice.spacing) & self.is_ground(grid))
        near = near[np.argsort(away.ravel()[near], kind="stable")]
        return grid.offset + near, away.ravel()[near]

    def jumps(self, lifts: bool) -> list[JumpWay]:
        """Return the jumps, with those of lifts if these are used."""
        areas = {area.name for area in self.building.areas}
        return [way for way in self._all_jumps if lifts or way.area.name in areas]

    @cached_property
    def _all_jumps(self) -> list[JumpWay]:
        areas = {area.name: area for area in (*self.building.areas, *self.building.backs)}
        jumps = sorted(jump for jump in self.building.jumps if jump.start in areas)
        around = {name: self.around(areas[name]) for name in {name for jump in jumps for name in jump[:2]}}
        return [
            JumpWay(jump.time, areas[jump.start], *around[jump.start], int(around[jump.end][0][0])) for jump in jumps
        ]

    def is_beside(self, grid: LevelGrid) -> BoolArray:
        """Return the mask (nx, ny) of nodes that are not walkable, but at most `margin` nodes from one that is."""
        walkable: BoolArray = grid.sheet != NOTHING
        beside: BoolArray = grown(walkable, self.margin) & ~walkable
        return beside


def use_towards(level: Level, segments: FloatArray) -> int:
    """Return the use of a level on the way to a link on it: FLAT, UP or DOWN.

    On a slope, a link in the lower half is reached by walking down, one in the upper half by walking up.
    """
    if not np.any(level.climb):
        return FLAT
    heights = shapely.get_coordinates(level.polygon) @ level.uphill
    middle = 0.5 * (heights.min() + heights.max())
    return DOWN if (segments.reshape(-1, 2) @ level.uphill).mean() < middle else UP


class Shared:
    """What was found for levels, by what it follows from, so that it is found once for storeys that are alike."""

    def __init__(self) -> None:
        self._found: dict[Hashable, Any] = {}

    def get(self, find: Callable[[], Any], *key: Hashable) -> Any:
        """Return what was found for a key, or find it."""
        if key not in self._found:
            self._found[key] = find()
        return self._found[key]


def build_grids(
    building: Building, spacing: float, clearance: float, barred: float = 0.0, shared: Shared | None = None
) -> BuildingGrids:
    """Create the grids of all levels, with walls looked at up to the distance `clearance` [m].

    Gaps, portals and exits narrower than `barred` [m] are treated as closed; the windows do not depend on it. `shared`
    is that of other grids of the building with the same spacing [m] and clearance.
    """
    narrow = {k for k, link in enumerate(building.links[: building.n_links]) if link.width < barred}
    whole, building = building, replace(building, closed=building.closed | narrow)
    x_min, y_min = building.vertices[:, :2].min(axis=0)
    lattice = Lattice((float(x_min), float(y_min)), spacing)
    shared = shared or Shared()
    closed = [link for link in building.links if not building.is_open(link)]
    lasting = [_walls_of(building, level, closed, barred) for level in building.levels]
    doors = [_doors_of_one_direction(building, level.index) for level in building.levels]
    walls = [
        np.concatenate([own, *(door.segments for door, _ in some)]) for own, some in zip(lasting, doors, strict=True)
    ]
    # Strips behind exits are as deep as the clearance, so that paths pass the posts of an exit as those of any door.
    margin = _margin(spacing, clearance)
    own_windows = [lattice.window(level.polygon.bounds, margin) for level in building.levels]
    layers = _Layers(building, whole, own_windows, lasting, walls, clearance, margin, shared)
    made = [layers.grid(level) for level in track("laying grids", building.levels, len(building.levels))]
    grids = [(one.window, layers.renumbered(one.sheet, one.links, level)) for level, one in enumerate(made)]
    offsets = np.concatenate(([0], np.cumsum([sheet.size for _, sheet in grids])))
    level_grids = []
    for level, ((window, sheet), one) in enumerate(zip(grids, made, strict=True)):
        offset = int(offsets[level])
        wide = [(door, side) for door, side in doors[level] if door.width >= barred]
        exits = [exit_.index for exit_ in layers.open_exits(level)]
        seams = {p.index: _seam(p, level, grids, offsets) for p in _open_portals(building, level)}
        stands_for = offset + _moved(layers.nodes(level)[1], own_windows[level], window)
        level_grids.append(
            LevelGrid(
                level,
                one.level,
                window,
                sheet,
                _sources(building, level, grids, offsets),
                offset,
                offset + one.ring,
                one.distance,
                seams,
                dict(zip(exits, one.strip_rows, strict=True)),
                offset + _passages(window, sheet, wide),
                stands_for,
            )
        )
    return BuildingGrids(building, lattice, tuple(level_grids), tuple(walls), clearance, int(offsets[-1]), margin)


def count_nodes(building: Building, spacing: float, clearance: float) -> float:
    """Estimate the number of nodes that `build_grids` would create; see there for the parameters."""
    around = 2.0 * _margin(spacing, clearance) + 1.0
    count = 0.0
    for level in building.levels:
        left, bottom, right, top = _bounds(building, level, spacing)
        count += ((right - left) / spacing + around) * ((top - bottom) / spacing + around)
    return count


def _margin(spacing: float, clearance: float) -> int:
    """Return the number of nodes around each level."""
    return max(MARGIN, math.ceil(clearance / spacing) + 3)


def _bounds(building: Building, level: Level, spacing: float) -> tuple[float, ...]:
    """Return the box (x_min, y_min, x_max, y_max) of a level and the halos behind its portals [m]."""
    halos = [shapely.buffer(chain(p.segments), _depth(p, spacing)) for p in _open_portals(building, level.index)]
    bounds = np.array([geometry.bounds for geometry in (level.polygon, *halos)])
    return (*bounds[:, :2].min(axis=0).tolist(), *bounds[:, 2:].max(axis=0).tolist())


def _depth(portal: Portal, spacing: float) -> float:
    """Return the depth of a halo [m]: the portal width, so that waves to all of the portal pass through the halo."""
    return max(portal.width, MARGIN * spacing)


def _walls_of(building: Building, level: Level, closed: Sequence[Link], barred: float) -> FloatArray:
    """Return the walls of a level, including its closed links and gaps that are treated as closed."""
    parts = [building.walls[building.wall_level == level.index].reshape(-1, 4)]
    parts += [link.segments for link in closed if level.index in link.levels]
    parts.append(gaps_below(level.polygon))
    if barred > 0.0:
        parts.append(gaps_between_walls(building, level, barred))
    return np.concatenate(parts)


def _doors_of_one_direction(building: Building, level: int) -> list[tuple[Door, int]]:
    """Return the open doors of one direction on a level, each with the side from which it is passed."""
    sides = building.directed
    doors = [(door, sides.get(building.link_of(door))) for door in building.doors if door.level == level]
    return [(door, side) for door, side in doors if side is not None]


def _passages(window: Window, sheet: IntArray, doors: list[tuple[Door, int]]) -> IndexArray:
    """Return the flat indices (2, d) of own nodes just before doors, and of the nearest ones behind the doors."""
    pairs = [np.zeros((2, 0), dtype=np.int64)]
    for door, side in doors:
        reach = 2.0 * window.lattice.spacing
        box = window.box_around(door.segment.reshape(1, 4), reach)
        nodes = np.argwhere(sheet[box] == OWN) + [part.start for part in box]
        start, end = door.segment.reshape(2, 2)
        along = (end - start) / np.hypot(*(end - start))
        away = window.places(nodes) - start
        across, share = away @ [-along[1], along[0]], away @ along
        in_front = (share >= 0.0) & (share <= door.width) & (np.abs(across) <= reach)
        nodes, across, share = nodes[in_front], across[in_front] * (1.0 if side == 0 else -1.0), share[in_front]
        before, behind = np.flatnonzero(across > 0.0), np.flatnonzero(across < 0.0)
        if len(before) and len(behind):
            apart = np.hypot(share[before, None] - share[behind], across[before, None] - across[behind])
            order = np.argsort(-apart.min(axis=1), kind="stable")  # the nearest last, which later ones replace
            chosen = np.stack([before, behind[apart.argmin(axis=1)]])[:, order]
            pairs.append(np.ravel_multi_index(tuple(nodes[chosen].transpose(2, 0, 1)), window.shape))
    return np.concatenate(pairs, axis=1)


def lead_through_doors(grid: LevelGrid, cost: FloatArray, direction: FloatArray) -> None:
    """Lead nodes before doors of one direction through these, where no neighbour has a lower cost (nx, ny).

    Directions (nx * ny, 2) are changed in place. Around the grid are nodes of infinite cost.
    """
    before, behind = (np.stack(np.unravel_index(nodes - grid.offset, cost.shape)) for nodes in grid.passages)
    beside = [cost[before[0] + i, before[1] + j] for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    lowest = np.isfinite(cost[*before]) & (cost[*before] <= np.min(beside, axis=0))
    away = (behind - before)[:, lowest]
    direction[np.ravel_multi_index(tuple(before[:, lowest]), cost.shape)] = (away / np.hypot(*away)).T


def _open_portals(building: Building, level: int) -> list[Portal]:
    return [portal for portal in building.portals_of(level) if building.is_open(portal)]


def _moved(nodes: IndexArray, window: Window, larger: Window) -> IndexArray:
    """Convert flat indices of nodes of a window to those of a larger window."""
    i, j = np.unravel_index(nodes, window.shape)
    shift = np.array(window.first) - np.array(larger.first)
    moved: IndexArray = np.ravel_multi_index((i + shift[0], j + shift[1]), larger.shape).astype(np.int64)
    return moved


@dataclass(frozen=True)
class _Made:
    """A grid as it was made for the first of the levels that are alike."""

    level: int
    links: IndexArray  # its open portals, then its exits
    window: Window
    sheet: IntArray
    strip_rows: list[int]  # for each open exit
    ring: IndexArray  # flat indices
    distance: FloatArray


@dataclass(frozen=True)
class _Layers:
    """The nodes of each level, from which the sheet of a grid is assembled."""

    building: Building
    whole: Building  # without the links closed that are treated as closed
    windows: list[Window]
    lasting: list[FloatArray]  # walls without doors of one direction
    walls: list[FloatArray]
    clearance: float
    margin: int
    shared: Shared

    def nodes(self, level: int) -> tuple[BoolArray, IndexArray]:
        """Return the nodes of a level, and those that stand for others; see `walkable_nodes`."""
        window, polygon, walls = self.windows[level], self.building.levels[level].polygon, self.walls[level]
        nodes_and_others: tuple[BoolArray, IndexArray] = self.shared.get(
            lambda: walkable_nodes(window, polygon, walls), *self._ground(level)
        )
        return nodes_and_others

    def _ground(self, level: int) -> tuple[Hashable, ...]:
        """Return what the nodes of a level follow from."""
        return self.windows[level], self.building.levels[level].polygon, self.walls[level].tobytes()

    def open_exits(self, level: int) -> list[Exit]:
        """Return the open exits of a level."""
        return [exit_ for exit_ in self.building.exits_of(level) if self.building.is_open(exit_)]

    def _links(self, level: int) -> IndexArray:
        portals = [portal.index for portal in _open_portals(self.building, level)]
        return np.array([*portals, *map(self.building.link_of, self.building.exits_of(level))], np.int64)

    def renumbered(self, sheet: IntArray, links: IndexArray, level: int) -> IntArray:
        """Return a sheet with the links of another level that is alike."""
        own = self._links(level)
        if np.array_equal(own, links):
            return sheet
        table = np.full(2 + self.building.n_links, NOTHING, dtype=np.int32)
        table[OWN], table[1 + links] = OWN, 1 + own
        renumbered: IntArray = table[sheet]
        return renumbered

    def grid(self, level: Level) -> _Made:
        """Return the grid of a level, or of the first one that is like it."""
        index, portals = level.index, _open_portals(self.building, level.index)
        window = self.windows[index].lattice.window(
            _bounds(self.whole, level, self.windows[index].lattice.spacing), self.margin
        )
        around = [index, *(portal.other(index) for portal in portals)]
        exits = self.building.exits_of(index)
        made: _Made = self.shared.get(
            lambda: self._grid(level, window),
            window,
            *(self._ground(one) for one in around),
            *(self.lasting[one].tobytes() for one in around),
            *(portal.segments.tobytes() for portal in portals),
            *(exit_.segments.tobytes() for exit_ in exits),
            *map(self.building.is_open, exits),
        )
        return made

    def _grid(self, level: Level, window: Window) -> _Made:
        lattice, index = window.lattice, level.index
        portals = _open_portals(self.building, index)
        sheet = np.full(window.shape, NOTHING, dtype=np.int32)
        here, there = window.overlap(self.windows[index])
        sheet[here][self.nodes(index)[0][there]] = OWN
        taken, strip_rows = [level.polygon], []
        for portal in portals:
            neighbour, depth = portal.other(index), _depth(portal, lattice.spacing)
            self._add_halo(window, sheet, portal, neighbour, depth)
            behind_it = shapely.buffer(chain(portal.segments), depth)
            taken.append(self.building.levels[neighbour].polygon.intersection(behind_it))
        for exit_ in self.open_exits(index):
            rows = free_rows(exit_.segments, shapely.union_all(taken), lattice.spacing, self.margin - 1)
            strip_rows.append(rows)
            for box, strip in behind(window, exit_.segments, rows):
                sheet[box][strip & (sheet[box] == NOTHING)] = 1 + self.building.link_of(exit_)
            taken.append(shapely.buffer(chain(exit_.segments), rows * lattice.spacing, cap_style="flat"))
        self._cut_links(window, sheet, index, portals)
        ring, distance = _distances(self.building, index, window, sheet, self.lasting, self.clearance)
        return _Made(index, self._links(index), window, sheet, strip_rows, ring, distance)

    def _add_halo(self, window: Window, sheet: IntArray, portal: Portal, neighbour: int, depth: float) -> None:
        """Add the neighbour's nodes that can be reached directly behind a portal to the sheet."""
        box = window.box_around(portal.segments, depth)
        part = window.part(box)
        nodes = np.zeros(part.shape, dtype=np.bool_)
        here, there = part.overlap(self.windows[neighbour])
        nodes[here] = self.nodes(neighbour)[0][there]
        line = chain(portal.segments)
        shapely.prepare(line)
        x, y = window.coordinates(box)
        nodes[nodes] = shapely.dwithin(line, shapely.points(x[nodes], y[nodes]), depth)
        beside = np.zeros(part.shape, dtype=np.bool_)
        for axis in (0, 1):
            links = window.crossed_links(portal.segments, axis, touching=True)
            for i, j in (links.near, links.far):
                beside[i - box[0].start, j - box[1].start] = True
        number = parts_of(nodes)
        nodes[nodes] = np.isin(number, number[beside[nodes]])
        sheet[box][(sheet[box] == NOTHING) & nodes] = 1 + portal.index

    def _cut_links(self, window: Window, sheet: IntArray, level: int, portals: Sequence[Portal]) -> None:
        """Remove nodes of halos and strips that would be connected other than through their portal or exit."""
        # Neighbouring nodes may be connected if they are on one level, or if the link between them crosses the open
        # portal or exit and no wall on either side. Otherwise, the wave would leak between two flights side by side in
        # the grid of their landing, or between a flight and the floor beside it.
        behind = {1 + p.index: (p.segments, p.other(level)) for p in portals}
        for exit_ in self.building.exits_of(level):
            behind[1 + self.building.link_of(exit_)] = (exit_.segments, -1 - exit_.index)
        ground = np.full(2 + self.building.n_links, NOTHING, dtype=np.int64)
        ground[OWN] = level
        for index, (_, other) in behind.items():
            ground[index] = other
        doors = [self._doors(window, sheet, level, behind, axis) for axis in (0, 1)]
        for axis in (0, 1):
            one = sheet[:-1, :] if axis == 0 else sheet[:, :-1]
            two = sheet[1:, :] if axis == 0 else sheet[:, 1:]
            near = np.nonzero((one != two) & (one != NOTHING) & (two != NOTHING))
            first, second = one[near], two[near]
            wrong = (ground[first] != ground[second]) & ~doors[axis][near]
            for gives, ends in ((wrong & (first > second), one), (wrong & (second > first), two)):
                ends[near[0][gives], near[1][gives]] = NOTHING

    def _doors(
        self, window: Window, sheet: IntArray, level: int, behind: dict[int, tuple[FloatArray, int]], axis: int
    ) -> BoolArray:
        """Mark the links along an axis, by their near ends, from the level through an open portal or exit."""
        through = np.zeros(window.shape, dtype=np.bool_)
        walled = {other: np.zeros(window.shape, dtype=np.bool_) for _, other in behind.values() if other >= 0}
        walled[level] = np.zeros(window.shape, dtype=np.bool_)
        for other, blocked in walled.items():
            blocked[window.crossed_links(self.walls[other], axis, touching=False).near] = True
        for index, (segments, other) in behind.items():
            links = window.crossed_links(segments, axis, touching=True)
            one, two = sheet[links.near], sheet[links.far]
            is_open = ((one == OWN) & (two == index)) | ((one == index) & (two == OWN))
            is_open &= ~walled[level][links.near]
            if other >= 0:
                is_open &= ~walled[other][links.near]
            through[links.some(is_open).near] = True
        return through


def _sources(
    building: Building, level: int, grids: list[tuple[Window, IntArray]], offsets: NDArray[np.int64]
) -> IntArray:
    """Return the packed index of the node that each node of a level's grid represents."""
    window, sheet = grids[level]
    source = np.arange(offsets[level], offsets[level] + sheet.size, dtype=np.int32).reshape(sheet.shape)
    source[sheet == NOTHING] = -1
    halo = np.flatnonzero((sheet > OWN) & (sheet <= len(building.portals)))
    portals = sheet.ravel()[halo] - 1
    for portal in building.portals_of(level):
        neighbour = portal.other(level)
        other_window, _ = grids[neighbour]
        own = halo[portals == portal.index]
        source.ravel()[own] = offsets[neighbour] + _moved(own, window, other_window)
    return source


def _seam(
    portal: Portal, level: int, grids: list[tuple[Window, IntArray]], offsets: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Return the packed indices (2, s) of the nodes on a portal, on the grids of both of its levels."""
    window, sheet = grids[level]
    neighbour = portal.other(level)
    other_window, other_sheet = grids[neighbour]
    spacing = window.lattice.spacing
    box = window.box_around(portal.segments, 2.0 * SLACK * spacing)
    here, there = window.part(box).overlap(other_window)
    shared = np.argwhere((sheet[box][here] == OWN) & (other_sheet[there] == OWN))
    ours = shared + [box[axis].start + here[axis].start for axis in (0, 1)]
    theirs = shared + [there[axis].start for axis in (0, 1)]
    line = chain(portal.segments)
    shapely.prepare(line)
    on_portal = shapely.dwithin(line, shapely.points(window.places(ours)), 2.0 * SLACK * spacing)
    return np.stack(
        [
            offset + np.ravel_multi_index(tuple(nodes[on_portal].T), shape)
            for offset, nodes, shape in (
                (offsets[level], ours, window.shape),
                (offsets[neighbour], theirs, other_window.shape),
            )
        ]
    )


def _distances(
    building: Building, level: int, window: Window, sheet: IntArray, walls: list[FloatArray], clearance: float
) -> tuple[IndexArray, FloatArray]:
    """Return the nodes near walls of the level or those just behind its portals, and their distances [m]."""
    near_walls = [walls[level]]
    for portal in _open_portals(building, level) if clearance > 0.0 else ():
        beyond = walls[portal.other(level)]
        close = shapely.dwithin(shapely.linestrings(beyond.reshape(-1, 2, 2)), chain(portal.segments), clearance)
        near_walls.append(_clipped(beyond[close], portal.segments, clearance))
    steps = math.ceil(clearance / window.lattice.spacing) + 2
    edge = grown(sheet != OWN, steps)
    edge &= sheet == OWN
    edge |= sheet > len(building.portals)
    ring = np.flatnonzero(edge)
    nodes = np.stack(np.unravel_index(ring, window.shape), axis=1)
    return ring, wall_distance(window, nodes, np.concatenate(near_walls), clearance)


def _clipped(walls: FloatArray, segments: FloatArray, clearance: float) -> FloatArray:
    """Return the parts of walls within `clearance` of a portal."""
    zone = shapely.buffer(chain(segments), clearance)
    parts = shapely.get_parts(shapely.intersection(shapely.linestrings(walls.reshape(-1, 2, 2)), zone))
    lines = [shapely.get_coordinates(part)[[0, -1]].ravel() for part in parts if part.length > 0.0]
    return np.array(lines, dtype=np.float64).reshape(-1, 4)
