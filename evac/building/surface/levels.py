"""Division of cells into levels: the cells, the name and the stair of each level."""

import itertools
from collections import defaultdict
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely

from evac.base.arrays import BoolArray, IndexArray
from evac.base.errors import BuildingError
from evac.building.geometry.components import connected_components
from evac.building.geometry.polygons import union
from evac.building.model.building import Level
from evac.building.model.findings import Finding
from evac.building.model.names import numbered
from evac.building.surface.edges import EdgeTable
from evac.building.surface.surface import Surface

#: Largest angle between the uphill directions of a cell and of its flight [degrees]; at 90, up would become down.
MOST_TURN = 60.0
#: A flight that turns further is divided into flights that turn by at most this [degrees].
PART = 90.0
#: Share of a part by which a flight may turn further, so that straight flights between winders stay whole.
BEYOND = 0.02
#: A flight that turns by more than this winds [degrees].
WINDS = 15.0


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
    common: dict[tuple[int, int], float] = defaultdict(float)
    for a, b in ((one, other), (other, one)):
        touching = np.flatnonzero((group[a] < 0) & is_floor[group[b]] & ~sloped[a] & ~sloped[b])
        for component, floor, shared_length in zip(
            label[a[touching]], group[b[touching]], length[touching], strict=True
        ):
            common[int(component), int(floor)] += shared_length
    if not common:
        return label
    for component in sorted({component for component, _ in common}):
        floors = [(-round(total, 6), floor) for (other, floor), total in common.items() if other == component]
        group[label == component] = min(floors)[1]
    return components()


def _parts_that_turn(surface: Surface, label: IndexArray, one: IndexArray, other: IndexArray) -> IndexArray:
    """Return the part of its flight to which each cell belongs: 0, unless the flight turns too far for one level.

    Parameters
    ----------
    label : (t,) int64
        Flight or floor of each cell.
    one, other : (e,) int64
        Cells that share an edge.
    """
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
    """Number the chains of flights and landings without a tag; ``stair 1`` has the lowest level index."""
    is_untagged = np.array([level.kind != "floor" and level.stair is None for level in levels])
    chain = connected_components(len(levels), neighbours[is_untagged[neighbours].all(axis=1)])
    taken = {level.stair for level in levels}
    free = (name for number in itertools.count(1) if (name := f"stair {number}") not in taken)
    stair_of = dict(zip(np.unique(chain[is_untagged]).tolist(), free, strict=False))
    return [
        replace(level, stair=stair_of[part]) if is_new else level
        for level, part, is_new in zip(levels, chain.tolist(), is_untagged.tolist(), strict=True)
    ]


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
            if turn > WINDS:
                text = (
                    f"the flight winds: its mean slope of {np.degrees(level.slope):.0f} degrees is used for all of it"
                )
                notes.append(Finding("assumed", text, level.name, (x, y)))
            elif worst > 0.1:
                text = (
                    f"the flight is not plane: its cells differ by up to {100 * worst:.0f} % in slope and "
                    f"{turn:.0f} degrees in direction from its mean, which is used for all of it"
                )
                notes.append(Finding("warning", text, level.name, (x, y)))
    return tuple(notes)
