"""Whether an imported building is the one that was written."""

import math
import re
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import networkx
import numpy as np
import shapely
from shapely import LineString

from evac import EvacError, import_building
from evac.building.model.links import levels_reaching
from tests.importing.strangers.truth import Truth

#: What of an opening may be wrong: its place, its width [m]; and of the area of a storey.
PLACE, WIDTH, AREA = 0.3, 0.1, 0.02
RIGHT, REFUSED, UNTRUE, TOLD, SILENT = "right", "refused", "refused untruly", "wrong, told", "silently wrong"
VERDICTS = (RIGHT, REFUSED, UNTRUE, TOLD, SILENT)


@dataclass
class Stranger:
    """A file of a building, and what of the building the file tells.

    `loose` is what may count as floor or not, for each storey: walls, if the file has none, stairwells drawn as stairs.
    `reasons` are regular expressions of reasons for which the file may truly be refused.
    """

    truth: Truth
    files: list[Path]
    loose: list[Any] = field(default_factory=list)
    heights: bool = True
    exits: bool = True
    doors: bool = True
    options: dict[str, Any] = field(default_factory=dict)
    reasons: tuple[str, ...] = ()


def judge(stranger: Stranger, folder: Path) -> tuple[str, list[str]]:
    """Import a stranger's file as a user would, and return the verdict with the differences or the reason."""
    options = dict(stranger.options)
    try:
        made = import_building(stranger.files, folder, options=options)
        scales = [re.search(r"building.scale = (\S+)", one.text) for one in made.findings]
        if scale := next((one for one in scales if one), None):
            options["scale"] = float(scale[1])
            shutil.rmtree(folder)
            made = import_building(stranger.files, folder, options=options)
        if not stranger.exits and made.openings:
            chosen = _chosen(stranger, made)
            if isinstance(chosen, str):
                return UNTRUE, [chosen]
            made = import_building(stranger.files, folder, options=options, exits=chosen)
        if any("remove the marks #" in one.text for one in made.findings):
            made = _with_stairs(stranger, folder)
    except EvacError as error:
        text = str(error)
        return (REFUSED if any(re.search(one, text) for one in stranger.reasons) else UNTRUE), [text]
    wrong = differences(stranger, made.building)
    if made.fault:
        if any(re.search(one, text) for one in stranger.reasons for text in (made.fault, *made.missing)):
            return REFUSED, [made.fault, *made.missing]
        return (TOLD if wrong else UNTRUE), [made.fault, *made.missing, *wrong]
    return (SILENT if wrong else RIGHT), wrong


def _chosen(stranger, made):
    """Return the numbers of the openings that are the exits, which a user reads from the picture."""
    local = _frame(stranger, made.building)
    numbers = []
    for k, storey in enumerate(stranger.truth.storeys):
        for door in (one for one in storey.doors if one.kind == "exit"):
            near = [
                one.number
                for one in made.openings
                if abs(one.z - local.z[k]) < 0.3
                and _is_at(local(LineString(np.asarray(one.segment).reshape(-1, 2))), door)
            ]
            if not near:
                return f"no opening is offered at {door.name} among {len(made.openings)}"
            numbers.append(near[0])
    return numbers


def _with_stairs(stranger, folder):
    """Take the comment marks from the stairs that the import proposes."""
    path = folder / "building.plan.toml"
    head, mark, rest = path.read_text(encoding="utf-8").partition("# [[stairs]]")
    text = (mark + rest).replace("# ", "")
    path.write_text(head + text, encoding="utf-8")
    return import_building(stranger.files, folder, options=stranger.options)


class _frame:  # noqa: N801
    """From coordinates of the building to those of the truth; `z` are its storeys."""

    def __init__(self, stranger, building):
        self.truth = stranger.truth
        self.levels = [one for one in building.levels if not np.any(one.uphill)]
        if stranger.heights:
            self.z = [storey.z for storey in self.truth.storeys]
        else:
            large = sorted(level.z_min for level in self.levels if level.polygon.area > 20 and level.kind == "floor")
            self.z = [z for i, z in enumerate(large) if i == 0 or z - large[i - 1] > 0.5]

    def __call__(self, shape):
        return self.truth.local(shape)

    def floor(self, k):
        """All that is level at the height of a storey."""
        return self(shapely.union_all([one.polygon for one in self.levels if abs(one.z_min - self.z[k]) < 0.15]))


def _is_at(segment, door):
    """Whether a segment is an exit, on either face of its wall."""
    middle = segment.interpolate(0.5, normalized=True)
    along = abs(door.segment.project(middle) - door.segment.length / 2)
    return (
        along <= PLACE
        and door.segment.distance(middle) <= door.wall.thickness / 2 + PLACE
        and abs(segment.length - door.segment.length) <= WIDTH
    )


def differences(stranger, building):
    """Return what of a building is not as in the truth, as texts."""
    truth, local = stranger.truth, _frame(stranger, building)
    if len(local.z) != len(truth.storeys):
        return [f"{len(local.z)} storeys instead of {len(truth.storeys)}: {local.z}"]
    found: list[str] = []
    for k, storey in enumerate(truth.storeys):
        floor = local.floor(k)
        steps = shapely.union_all([one.footprint for one in truth.stairs_at(k)])
        loose = shapely.union_all([steps, *(door.strip for door in storey.doors), *stranger.loose[k : k + 1]])
        low, high = (storey.floor - loose).area, shapely.union_all([storey.floor, loose]).area
        if not low * (1 - AREA) <= floor.area <= high * (1 + AREA):
            found.append(f"{storey.name}: {floor.area:.1f} m2 instead of {low:.1f} to {high:.1f}")
        found += _walls(storey, floor) if stranger.doors else []
        found += _exits(building, storey, k, local)
    return found + _stairs(truth, building, local) + _reached(truth, building, local, stranger)


def _walls(storey, floor):
    """Return differences between what is open along walls and the doors."""
    found = []
    for wall in (one for one in storey.walls if not one.outer):
        x1, y1, x2, y2 = wall.line
        line = wall.along(wall.thickness, math.hypot(x2 - x1, y2 - y1) - wall.thickness)
        ways = floor.buffer(-0.01).intersection(line)  # Not along the edge of a room.
        ways = [one for one in getattr(ways, "geoms", [ways]) if one.length > 0.05]
        for door in (one for one in wall.doors if one.kind == "door"):
            near = [one for one in ways if one.centroid.distance(door.segment.centroid) <= PLACE]
            if not near:
                found.append(f"{storey.name}: door {door.name} is lost")
            elif abs(near[0].length + 0.02 - door.segment.length) > WIDTH:
                found.append(
                    f"{storey.name}: door {door.name} is {near[0].length:.2f} m wide, {door.segment.length:.2f}"
                )
            ways = [one for one in ways if one not in near]
        known = shapely.union_all([one.segment for one in wall.doors if one.kind == "lift"]).buffer(0.2)
        ways = [one for one in ways if not known.contains(one)]
        if ways:
            at = ways[0].centroid
            found.append(f"{storey.name}: wall open at {at.x:.1f}, {at.y:.1f} over {sum(w.length for w in ways):.2f} m")
    return found


def _exits(building, storey, k, local):
    left = [one for one in storey.doors if one.kind == "exit"]
    found = []
    for one in building.exits:
        if abs(building.levels[one.level].z_min - local.z[k]) > 0.3:
            continue
        segments = [local(LineString(segment.reshape(-1, 2))) for segment in one.segments]
        ends = shapely.union_all(segments).envelope
        middle, (dx, dy) = ends.centroid, np.ptp(np.reshape(ends.bounds, (2, 2)), axis=0)
        whole = LineString([(middle.x - dx / 2, middle.y - dy / 2), (middle.x + dx / 2, middle.y + dy / 2)])
        match = next((door for door in left if _is_at(whole, door)), None)
        if match is None:
            found.append(f"{storey.name}: exit of {one.width:.2f} m at {middle.x:.1f}, {middle.y:.1f} is none")
        else:
            left.remove(match)
    return found + [f"{storey.name}: exit {one.name} of {one.segment.length:.2f} m is lost" for one in left]


def _stairs(truth, building, local):
    """Return differences between stairs, which are what connects storeys."""
    graph = networkx.Graph()
    storey = {
        level.index: k
        for level in local.levels
        for k, z in enumerate(local.z)
        if abs(level.z_min - z) < 0.15 and level.kind == "floor"
    }
    graph.add_nodes_from(level.index for level in building.levels if level.index not in storey)
    graph.add_edges_from(p.levels for p in building.portals if not set(p.levels) & set(storey))
    made = []
    for parts in networkx.connected_components(graph):
        ends = sorted({storey[a] for p in building.portals for a in p.levels if a in storey and set(p.levels) & parts})
        place = local(shapely.union_all([building.levels[i].polygon for i in parts]))
        if len(ends) > 1 or any(np.any(building.levels[i].uphill) for i in parts):
            made.append((ends, place.centroid))
    found = []
    for stair in truth.stairs:
        ends = [stair.lower, stair.lower + 1]
        match = next((m for m in made if m[0] == ends and m[1].distance(stair.footprint) < 2), None)
        if match is None:
            found.append(f"stair from storey {stair.lower} in {stair.well} is lost")
        else:
            made.remove(match)
    return found + [f"stair between storeys {ends} at {at.x:.1f}, {at.y:.1f} is none" for ends, at in made]


def _reached(truth, building, local, stranger):
    """Return rooms that cannot be left, and ground that can although there is none."""
    reached = [building.levels[index] for index in sorted(levels_reaching(building, building.exits))]
    found = []
    for k, storey in enumerate(truth.storeys):
        ground = shapely.union_all(
            [level.polygon for level in reached if not np.any(level.uphill) and abs(level.z_min - local.z[k]) < 0.15]
        )
        ground = local(ground)
        steps = shapely.union_all([one.footprint for one in truth.stairs_at(k)])
        loose = shapely.union_all([*stranger.loose[k : k + 1]])
        for room in (one for one in storey.rooms if one.use != "lift"):
            clear = room.polygon - steps
            if not loose.contains(clear.representative_point()) and (clear & ground).area < 0.5 * clear.area:
                found.append(f"{storey.name}: {room.name} cannot be left")
        allowed = shapely.union_all([storey.floor, *(door.strip for door in storey.doors), loose]).buffer(0.4)
        allowed = allowed - shapely.union_all([r.polygon.buffer(-0.3) for r in storey.rooms if r.use == "lift"])
        if (excess := (ground - allowed).area) > 1:
            found.append(f"{storey.name}: {excess:.1f} m2 of ground where nobody can be")
    known = shapely.union_all([*(one.footprint for one in truth.stairs), *stranger.loose])
    for level in reached:
        place = local(level.polygon)
        if all(abs(level.z_min - z) > 0.15 for z in local.z) and (extra := (place - known.buffer(1)).area) > 1:
            found.append(f"{level.name}: {extra:.1f} m2 where nobody can be")
    return found
