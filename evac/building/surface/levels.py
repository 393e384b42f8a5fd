"""Levels of a surface, and the portals, exits, walls and doors between and around them."""

import itertools
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from evac.base.arrays import BoolArray, FloatArray, IndexArray, IntArray
from evac.base.errors import BuildingError
from evac.building.geometry import connected_components, segment_lengths, union
from evac.building.model.building import Door, Exit, Level, Portal
from evac.building.model.elevation import level_elevation
from evac.building.model.findings import Finding, item_of, numbered, refusal
from evac.building.surface.surface import Surface

#: Corners at most this far from the straight line between their neighbours are removed [m].
COLLINEAR = 1e-4
SPIKE = 0.01  #: Greatest length of a tagged edge that may have lost its cell [m].


@dataclass(frozen=True)
class EdgeTable:
    """All sides of all triangles, directed with the cell on their left."""

    ends: IndexArray  # (3 t, 2) int64
    cell: IndexArray  # (3 t,) int64
    partner: IndexArray  # (3 t,) int64: cell on the other side, -1 at a free edge


def edge_table(source: Path, vertices: FloatArray, triangles: IndexArray) -> EdgeTable:
    """Find the neighbouring cell across every edge."""
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    cell = np.tile(np.arange(len(triangles)), 3)
    least = np.sort(ends, axis=1)
    order = np.lexsort((cell, least[:, 1], least[:, 0]))
    same = (least[order[1:]] == least[order[:-1]]).all(axis=1)

    triple = np.flatnonzero(same[1:] & same[:-1])
    if len(triple):
        place = edge_place(vertices, least[order[triple[0]]])
        raise BuildingError(
            f"{source}: more than two cells share the edge {place}; an edge may join two cells only: cut the floor "
            "open where it passes under the foot of a stair"
        )
    one, other = order[:-1][same], order[1:][same]
    folded = (ends[one] == ends[other]).all(axis=1)
    if folded.any():
        place = edge_place(vertices, ends[one[folded][0]])
        raise BuildingError(
            f"{source}: the surface folds over itself at the edge {place}: both of its cells are on the same side in "
            "plan; put a landing there"
        )
    partner = np.full(len(ends), -1, dtype=np.int64)
    partner[one], partner[other] = cell[other], cell[one]
    return EdgeTable(ends, cell, partner)


def chains(vertices: FloatArray, ends: IndexArray) -> list[FloatArray]:
    """Join directed edges (e, 2) into chains, as plan segments (s, 4) [m] with collinear neighbours merged.

    A chain ends where the next edge is missing or ambiguous. A closed chain starts and ends at its smallest
    vertex, which is a corner. Chains are sorted by their vertices.
    """
    starting, lines = Counter(map(tuple, vertices[ends[:, 0], :2].tolist())), []
    edges = shapely.multilinestrings(vertices[ends][:, :, :2])
    for line in shapely.get_parts(shapely.line_merge(edges, directed=True)):
        corners = shapely.get_coordinates(line)
        if (corners[0] == corners[-1]).all() and starting[tuple(corners[0].tolist())] == 1:
            least = np.lexsort(corners[:-1].T[::-1])[0]
            corners = np.concatenate([corners[least:-1], corners[: least + 1]])
        lines.append(corners.tolist())
    whole = [shapely.LineString(line) for line in sorted(lines)]
    straight = shapely.simplify(whole, COLLINEAR, preserve_topology=False)
    return [np.concatenate([own[:-1], own[1:]], axis=1) for own in map(shapely.get_coordinates, straight)]


def edge_place(vertices: FloatArray, ends: IndexArray) -> str:
    """Describe the place of an edge, for a message."""
    return " - ".join(f"({x:z.2f}, {y:z.2f}, {z:z.2f})" for x, y, z in vertices[ends])


#: Largest angle between the uphill directions of a cell and of its flight [degrees]; at 90, up would become down.
MOST_TURN = 60.0
#: A flight that turns further is divided into flights that turn by at most this [degrees].
PART = 90.0
#: Share of a part by which a flight may turn further, so that straight flights between winders stay whole.
BEYOND = 0.02
#: A flight that turns by more than this winds [degrees].
WINDS = 15.0
#: Stairs of one tag are above each other if each begins at most this far below the top of the one before [m].
STACKED = 0.05


@dataclass(frozen=True)
class LevelSet:
    """The levels of a surface, and the level of each of its cells."""

    levels: tuple[Level, ...]
    level_of_cell: IndexArray
    stairs: dict[str, tuple[int, ...]]
    findings: tuple[Finding, ...]


def find_levels(source: Path, surface: Surface, table: EdgeTable) -> LevelSet:
    """Divide a surface into levels: maximal edge-connected sets of cells with one slope class and one tag.

    Sloped neighbours that rise in opposite directions (a ridge or a trough) are also divided, and so are flights that
    wind, since a level rises in one direction. Levels are ordered by mid height, then by plan position.
    """
    names = sorted(name for name in surface.cell_tags if name.startswith(("floor:", "stair:")))
    group = _groups(source, surface, names)
    label = _order(surface, _connected_cells(surface, table, group, names))
    is_tagged_area = np.zeros(label.max() + 1, dtype=bool)
    for name, mask in surface.cell_tags.items():
        if name.startswith("area:"):
            is_tagged_area[label[mask]] = True
    tag_of = {level: names[g] for level, g in zip(label.tolist(), group.tolist(), strict=True) if g >= 0}
    levels = [_level(surface, label, index, tag_of.get(index)) for index in range(label.max() + 1)]

    shared = table.partner >= 0
    pairs = np.column_stack([label[table.cell[shared]], label[table.partner[shared]]])
    neighbours = np.unique(pairs[pairs[:, 0] != pairs[:, 1]], axis=0)  # every pair in both orders
    levels = _mark_landings(levels, neighbours, is_tagged_area)
    levels = _name_stairs(levels, neighbours)
    levels = _name_levels(levels, tag_of)
    stairs: dict[str, tuple[int, ...]] = {}
    for level in sorted(levels, key=lambda level: -(level.z_min + level.z_max)):
        if level.stair is not None:
            stairs[level.stair] = (*stairs.get(level.stair, ()), level.index)
    stairs = {name: stairs[name] for name in sorted(stairs, key=lambda name: (min(stairs[name]), name))}
    return LevelSet(tuple(levels), label, stairs, _not_plane(surface, label, levels))


def _groups(source: Path, surface: Surface, names: list[str]) -> IndexArray:
    """Return the row in `names` of the tag of each cell, -1 for none."""
    group = np.full(len(surface.triangles), -1, dtype=np.int64)
    for row, name in enumerate(names):
        mask = surface.cell_tags[name]
        twice = np.flatnonzero(mask & (group >= 0))
        if len(twice):
            x, y, z = surface.vertices[surface.triangles[twice[0]]].mean(axis=0)
            raise BuildingError(
                f"{source}: the cell at ({x:z.2f}, {y:z.2f}, {z:z.2f}) has both tags {names[group[twice[0]]]!r} and "
                f"{name!r}; remove one, since a cell belongs to one floor or stair"
            )
        group[mask] = row
    return group


def _connected_cells(surface: Surface, table: EdgeTable, group: IndexArray, names: list[str]) -> IndexArray:
    """Label the level of each cell, in no particular order; untagged flat cells join a floor (also in `group`)."""
    shared = (table.partner >= 0) & (table.cell < table.partner)
    one, other, ends = table.cell[shared], table.partner[shared], table.ends[shared]
    sloped = surface.is_sloped
    same_class = sloped[one] == sloped[other]
    same_way = ~sloped[one] | ((surface.gradient[one] * surface.gradient[other]).sum(axis=1) > 0)

    def components() -> IndexArray:
        joined = same_class & same_way & (group[one] == group[other])
        return connected_components(len(group), np.stack([one[joined], other[joined]], axis=1))

    label = components()
    is_floor = np.array([name.startswith("floor:") for name in names] + [False])
    length = np.linalg.norm(surface.vertices[ends[:, 1]] - surface.vertices[ends[:, 0]], axis=1)
    parts = _parts_that_turn(surface, label, one, other)
    if parts.any():
        same_way &= parts[one] == parts[other]
        label = components()
    a, b = np.concatenate([one, other]), np.concatenate([other, one])
    rows = np.flatnonzero((group[a] < 0) & is_floor[group[b]] & ~sloped[a] & ~sloped[b])
    if not len(rows):
        return label
    pairs, pair = np.unique(np.column_stack([label[a[rows]], group[b[rows]]]), axis=0, return_inverse=True)
    common = np.bincount(pair.ravel(), np.tile(length, 2)[rows]).round(6)
    for component in np.unique(pairs[:, 0]).tolist():  # joins the floor with which it has the longest side
        own = np.flatnonzero(pairs[:, 0] == component)
        group[label == component] = pairs[own[common[own].argmax()], 1]
    return components()


def _parts_that_turn(surface: Surface, label: IndexArray, one: IndexArray, other: IndexArray) -> IndexArray:
    """Return the part (t,) of its flight in which each cell is: 0, unless the flight turns too far."""
    part = np.zeros(len(label), dtype=np.int64)
    heading = np.arctan2(surface.gradient[:, 1], surface.gradient[:, 0])
    inner = label[one] == label[other]
    pairs = np.column_stack([one[inner], other[inner]])
    for index in np.unique(label[surface.is_sloped]):
        cells = np.flatnonzero(label == index)
        mean = surface.gradient[cells].mean(axis=0)
        along = surface.gradient[cells] @ mean / np.hypot(*surface.gradient[cells].T)
        if (along >= np.cos(np.radians(MOST_TURN)) * np.hypot(*mean)).all():
            continue
        first = cells[surface.vertices[surface.triangles[cells], 2].mean(axis=1).argmin()]
        import networkx  # takes 0.1 s, and few buildings need it

        beside = networkx.Graph(pairs[label[pairs[:, 0]] == index].tolist())
        turned = {int(first): 0.0}
        for cell, near in networkx.bfs_edges(beside, int(first)):
            turned[near] = turned[cell] + float(np.angle(np.exp(1j * (heading[near] - heading[cell]))))
        # The cells of a tread, which have the same heights, stay together.
        z = surface.vertices[surface.triangles[cells], 2]
        tread = np.unique(np.round([z.min(axis=1), z.max(axis=1)], 6), axis=1, return_inverse=True)[1].ravel()
        angle = np.degrees([turned[cell] for cell in cells.tolist()])
        angle = (np.bincount(tread, weights=angle) / np.bincount(tread))[tread]
        if not np.ptp(angle):  # a surface folded over itself, whose cells have the same heights
            continue
        count = int(np.ceil(np.ptp(angle) / PART - BEYOND))
        share = count * (angle - angle.min()) / np.ptp(angle)
        part[cells] = np.clip(np.ceil(share - BEYOND) - 1, 0, count - 1)
    return part


def _order(surface: Surface, label: IndexArray) -> IndexArray:
    """Renumber labels by mid height, then by the centre of the plan extent, then by the smallest cell."""
    keys = []
    for index in range(label.max() + 1):
        cells = np.flatnonzero(label == index)
        corners = surface.vertices[surface.triangles[cells]].reshape(-1, 3)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        keys.append((*np.round(middle[[2, 0, 1]], 6).tolist(), int(cells[0])))
    rank = np.empty(len(keys), dtype=np.int64)
    rank[sorted(range(len(keys)), key=keys.__getitem__)] = np.arange(len(keys))
    return rank[label]


def _level(surface: Surface, label: IndexArray, index: int, tag: str | None) -> Level:
    """Create one level, without its final names."""
    cells = np.flatnonzero(label == index)
    corners = surface.vertices[surface.triangles[cells]]
    uphill, slope = np.zeros(2), 0.0
    is_sloped = bool(surface.is_sloped[cells[0]])
    if is_sloped:
        plan_area = shapely.area(shapely.polygons(corners[:, :, :2]))
        gradient = surface.gradient[cells]
        mean = plan_area @ gradient
        # The mean steepness of the cells, since their gradients cancel in a flight that turns.
        uphill, slope = mean / np.hypot(*mean), float(np.arctan(np.average(np.hypot(*gradient.T), weights=plan_area)))
    stair = tag.removeprefix("stair:") if tag and tag.startswith("stair:") else None
    return Level(
        index=index,
        name="",
        kind="flight" if is_sloped else "landing" if stair else "floor",
        stair=stair,
        triangles=surface.triangles[cells].astype(np.int32),
        polygon=union(shapely.polygons(corners[:, :, :2])).normalize(),
        uphill=uphill,
        slope=slope,
        z_min=float(corners[:, :, 2].min()),
        z_max=float(corners[:, :, 2].max()),
    )


def _mark_landings(levels: list[Level], neighbours: IndexArray, is_area: BoolArray) -> list[Level]:
    """Mark a flat level as a landing if it only joins flights, up and down, and is not larger than they are."""
    marked = list(levels)
    for level in levels:
        around = [levels[other] for other in neighbours[neighbours[:, 0] == level.index, 1]]
        height = level.z_min + level.z_max
        if (
            level.kind == "floor"
            and not is_area[level.index]
            and all(other.kind == "flight" for other in around)
            and any(other.z_min + other.z_max < height for other in around)
            and any(other.z_min + other.z_max > height for other in around)
            and level.polygon.area <= sum(other.polygon.area for other in around)
        ):
            marked[level.index] = replace(level, kind="landing")
    return marked


def _name_stairs(levels: list[Level], neighbours: IndexArray) -> list[Level]:
    """Number stairs: chains of flights and landings, from storey to storey, the lowest first."""
    # Of those without a tag, ``stair 1`` has the lowest level index; several above each other with one tag are ``TAG
    # 0`` for the lowest, ``TAG 1`` and so on. A landing beside a floor ends the stair that leads up to it.
    height = [level.z_min + level.z_max for level in levels]
    around = {level.index: neighbours[neighbours[:, 0] == level.index, 1].tolist() for level in levels}
    ends = {
        level.index
        for level in levels
        if level.kind == "landing" and any(levels[other].kind == "floor" for other in around[level.index])
        if any(
            levels[other].stair == level.stair and height[other] < height[level.index] for other in around[level.index]
        )
    }
    is_within = [
        levels[one].kind != "floor" != levels[other].kind
        and levels[one].stair == levels[other].stair
        and min((one, other), key=height.__getitem__) not in ends
        for one, other in neighbours.tolist()
    ]
    chain = connected_components(len(levels), neighbours[is_within])
    chains: dict[str | None, list[list[Level]]] = {}
    for number in np.unique(chain).tolist():
        members = [levels[index] for index in np.flatnonzero(chain == number).tolist()]
        if members[0].kind != "floor":
            chains.setdefault(members[0].stair, []).append(members)
    free = (name for number in itertools.count(1) if (name := f"stair {number}") not in chains)
    stair_of = {level.index: name for own, name in zip(chains.pop(None, []), free, strict=False) for level in own}
    for tag, parts in chains.items():
        parts.sort(key=lambda own: min(level.z_min for level in own))
        tops = [max(level.z_max for level in own) for own in parts]
        are_stacked = all(
            min(level.z_min for level in own) >= top - STACKED for own, top in zip(parts[1:], tops, strict=False)
        )
        for number, own in enumerate(parts):
            stair_of |= {level.index: f"{tag} {number}" if are_stacked and tops[1:] else str(tag) for level in own}
    return [replace(level, stair=stair_of.get(level.index)) for level in levels]


def _name_levels(levels: list[Level], tag_of: dict[int, str]) -> list[Level]:
    """Name levels by their floor tag, or by kind and height; equal names are numbered from the second on."""
    used: set[str] = set()
    named = []
    for level in levels:
        tag = tag_of.get(level.index, "")
        if tag.startswith("floor:"):
            name = tag.removeprefix("floor:")
        else:
            heights = f"z={level.z_min:z.2f}" + (f"..{level.z_max:z.2f}" if level.kind == "flight" else "")
            prefix = f"{level.stair} " if tag.startswith("stair:") else ""
            name = f"{prefix}{level.kind} {heights}"
        named.append(replace(level, name=numbered(name, used)))
        used.add(named[-1].name)
    return named


def _not_plane(surface: Surface, label: IndexArray, levels: list[Level]) -> tuple[Finding, ...]:
    """Tell of flights that are not plane."""
    notes = []
    for level in levels:
        if level.kind == "flight":
            gradient = surface.gradient[label == level.index]
            along = gradient @ level.uphill / np.hypot(*gradient.T)
            x, y = surface.vertices[surface.triangles[label == level.index][along.argmin()]].mean(axis=0)[:2].tolist()
            turn = float(np.degrees(np.arccos(np.clip(along.min(), -1.0, 1.0))))
            worst = float(np.hypot(*(gradient - np.tan(level.slope) * level.uphill).T).max())
            if turn > WINDS or worst > 0.1:
                text = (
                    f"the flight {'winds' if turn > WINDS else 'is not plane'}: its cells differ by up to "
                    f"{100 * worst:.0f} % in slope and {turn:.0f} degrees in direction from its mean of "
                    f"{np.degrees(level.slope):.0f} degrees, which is used for all of it"
                )
                kind = "assumed" if turn > WINDS else "warning"
                notes.append(Finding(kind, text, level.title, (x, y), item_of(level)))
    return tuple(notes)


def find_portals(surface: Surface, table: EdgeTable, level_set: LevelSet) -> tuple[Portal, ...]:
    """Make a portal from each chain of edges shared by two levels, ordered by levels and place, and named by both."""
    shared = np.flatnonzero(table.partner >= 0)
    pairs = np.column_stack([table.cell[shared], table.partner[shared]])
    pairs = level_set.level_of_cell[pairs]
    portals, used = list[Portal](), set[str]()
    for first, second in np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0).tolist():
        between = shared[(pairs == (first, second)).all(axis=1)]
        one, other = level_set.levels[first], level_set.levels[second]
        title = f"{one.name} - {other.name}" if one.title == other.title else f"{one.title} - {other.title}"
        for segments in chains(surface.vertices, table.ends[between]):
            used.add(name := numbered(title, used))
            width = float(segment_lengths(segments).sum())
            portals.append(Portal(len(portals), name, (first, second), segments, width))
    return tuple(portals)


def find_exits_and_walls(
    source: Path, surface: Surface, table: EdgeTable, level_set: LevelSet
) -> tuple[tuple[Exit, ...], FloatArray, IntArray]:
    """Divide the free edges into tagged exits, ordered by name, and walls with their levels."""
    free = np.flatnonzero(table.partner < 0)
    level = level_set.level_of_cell[table.cell]
    row_of = {(min(a, b), max(a, b)): row for row, (a, b) in zip(free.tolist(), table.ends[free].tolist(), strict=True)}
    exits: list[Exit] = []
    taken: dict[int, str] = {}
    for tag in sorted(surface.exit_edges):
        rows = []
        edges = sorted({(min(edge), max(edge)) for edge in surface.exit_edges[tag].tolist()})
        length = np.linalg.norm(np.diff(surface.vertices[edges], axis=1)[:, 0], axis=1)
        # A cell that was a spike of the floor has been dropped.
        kept = [edge for edge, own in zip(edges, length, strict=True) if own > SPIKE or edge in row_of]
        for a, b in kept or edges:
            row = row_of.get((a, b))
            if row is None or row in taken:
                place = edge_place(surface.vertices, np.array([a, b]))
                cause = (
                    "is not a free edge of the walkable surface" if row is None else f"also has the tag {taken[row]!r}"
                )
                raise BuildingError(f"{source}: the edge {place} of {tag!r} {cause}; move or remove the tag")
            rows.append(row)
            taken[row] = tag
        exits.append(_tagged_exit(source, surface, table, level_set, len(exits), tag, np.array(rows, dtype=np.int64)))

    walls, wall_level = [np.empty((0, 4))], [np.empty(0, dtype=np.int32)]
    is_wall = np.isin(free, list(taken), invert=True)
    for index in range(len(level_set.levels)):
        own = chains(surface.vertices, table.ends[free[is_wall & (level[free] == index)]])
        walls += own
        wall_level.append(np.full(sum(map(len, own)), index, dtype=np.int32))
    return tuple(exits), *sorted_walls(np.concatenate(walls), np.concatenate(wall_level))


def find_doors(surface: Surface, levels: tuple[Level, ...]) -> tuple[Door, ...]:
    """Return the doors of a surface, each on the level that is nearest to its middle."""
    given = [(name, np.asarray(ends)) for name, ends in surface.given.doors]
    if not given:
        return ()
    middle = np.array([ends.mean(axis=0) for _, ends in given])
    point = shapely.points(middle[:, :2])
    off = np.empty((len(levels), len(middle)))
    for row, level in enumerate(levels):
        shapely.prepare(level.polygon)
        near, beside = middle[:, :2].copy(), ~shapely.intersects(level.polygon, point)
        near[beside] = shapely.get_coordinates(shapely.shortest_line(level.polygon, point[beside]))[::2]
        height = level_elevation(surface.vertices, level, near)
        off[row] = np.hypot(*(near - middle[:, :2]).T) + np.abs(height - middle[:, 2])
    doors: list[Door] = []
    for (name, ends), on in zip(given, off.argmin(axis=0).tolist(), strict=True):
        segment = ends[:, :2].ravel()
        doors.append(Door(len(doors), name, on, segment, float(np.hypot(*(segment[2:] - segment[:2])))))
    return tuple(doors)


def sorted_walls(walls: FloatArray, wall_level: NDArray[np.integer]) -> tuple[FloatArray, IntArray]:
    """Sort walls (w, 4) by level, x1, y1, x2, y2."""
    order = np.lexsort((*walls.T[::-1], wall_level))
    return np.ascontiguousarray(walls[order]), wall_level[order].astype(np.int32)


def _tagged_exit(
    source: Path, surface: Surface, table: EdgeTable, level_set: LevelSet, index: int, tag: str, rows: IndexArray
) -> Exit:
    """Make the exit of one tag from rows of the edge table."""
    if not len(rows):
        raise BuildingError(f"{source}: the edges of {tag!r} have no length; tag edges longer than building.weld")
    on = np.unique(level_set.level_of_cell[table.cell[rows]])
    if len(on) > 1:
        names = " and ".join(repr(level_set.levels[level].name) for level in on)
        x, y = surface.vertices[table.ends[rows]].mean(axis=(0, 1))[:2].tolist()
        name = tag.removeprefix("exit:")
        text = f"exit {name!r} lies on the levels {names}; give each part its own name"
        raise refusal(source, [Finding("error", text, place=(x, y), item=f"exits.{name}")])
    segments = np.concatenate(chains(surface.vertices, table.ends[rows]))
    return Exit(index, tag.removeprefix("exit:"), int(on[0]), segments, float(segment_lengths(segments).sum()))
