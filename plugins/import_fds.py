"""Importer of FDS decks: the floor of each storey from meshes, obstructions and holes, and exits of FDS+Evac."""

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.base.parameters import Parameter
from evac.building.geometry import common, connected_components, cut, flat_parts, place_of, united
from evac.building.importer import Importer
from evac.building.model.findings import Finding
from evac.building.plan.plan import Plan
from evac.building.recover.bodies import Body
from evac.building.recover.bodies.flights import FoundStair, meeting, stairs_of
from evac.building.recover.bodies.floors import Floor

#: Heights above the floor at which an obstruction is in the way [m], and the clear height that a storey needs [m].
SECTIONS, CLEAR = (0.3, 1.0, 1.7), 1.8
#: Height of the middle of an evacuation mesh above its floor, unless EVAC_Z_OFFSET states another [m]: the default of
#: FDS+Evac; and the highest above a floor at which lines of FDS+Evac belong to it [m].
Z_OFFSET, REACH = 1.0, 2.5
#: Greatest thickness of a slab [m], least area of a storey [m2], and heights that are one storey [m].
THICKEST_SLAB, LEAST_FLOOR, SAME = 0.6, 4.0, 0.3
#: Least thickness of an obstruction [m]: those without a thickness are walls too.
THINNEST = 0.05
#: Least depth of a step [m], greatest area of a step or landing [m2], rise from one to the next [m] and gap between
#: them [m], and least number of steps of a stair.
STEP, LANDING, RISER, GAP, STEPS = 0.15, 10.0, (0.08, 0.26), 0.05, 3
#: What a vent is on that is the side of a mesh.
SIDE = re.compile(r"MB\s*=\s*.[XY](MIN|MAX)")
#: Groups of FDS+Evac and of complex geometry that are not read.
LEFT_OUT = {
    "CORR": "write the stair or passage between its doors and entrances as [[stairs]] or [[rooms]]",
    "DOOR": "people go on from there to the node that it names",
    "STRS": "write it as [[shafts]], with the foot, width, direction and turn of its flights",
    "ENTR": "write a group of [[people]] with arrive into case.toml for those who come in there",
    "EVSS": "write it as [[stairs]]",
    "GEOM": "people would walk through it; write the boxes around its parts as &OBST",
}
#: Depth of the ground outside of an exit [m]; least area of a part of the ground [m2].
OUTSIDE, LEAST_PART = 0.1, 0.5


class FdsImporter(Importer):
    """FDS input files (.fds): storeys at the bottom of the meshes and at the top of each slab, exits and start areas.

    Evacuation meshes of FDS+Evac state floors, EVAC_Z_OFFSET below their middle; other meshes then state none. The
    floor area is what no obstruction occupies between 0.3 and 1.7 m above the floor, except where holes are cut out
    of them. Obstructions that rise by steps beside each other from one storey to another are a stair. Lines with
    EVACUATION=.FALSE. are not met. `&EXIT` lines of FDS+Evac are exits, or lines if they only count, `&EVAC` lines
    start areas with their numbers of people, and open vents openings.
    """

    name = "fds"
    suffixes = (".fds",)

    least = Parameter(LEAST_FLOOR, "smallest area of a storey", unit="m2", above=0.0)
    cut_slabs = Parameter(False, "cut slabs that block a stair; if false, the stair is left out")

    def read(self, path: Path) -> Plan:
        """Read the deck; raise ValueError if it has no mesh."""
        text = path.read_text(encoding="utf-8", errors="replace")
        lines = [*_repeated([*_namelists(text)])]
        plan = Plan(path)
        unseen = [one for one in lines if one.says("EVACUATION", "F")]
        if unseen:
            first = f"the first is &{unseen[0].group} in line {unseen[0].number}"
            plan.note("found", f"{len(unseen)} lines with EVACUATION=.FALSE., which people do not meet; {first}")
        seen = [one for one in lines if one not in unseen and len(one.box)]
        of = {group: [line for line in seen if line.group == group] for group in GROUPS}
        for group, number in sorted(Counter(one.group for one in lines if one.group in (*GROUPS, *LEFT_OUT)).items()):
            plan.note("found", f"{number} &{group}", element=f"&{group}", number=number)
        of["MESH"] = _of_storeys(of["MESH"], [one for one in lines if one.group == "STRS"], of["EXIT"] + of["EVAC"])
        if not of["MESH"]:
            raise ValueError("the deck has no &MESH with XB that people can walk in")
        for one in lines:
            if one.group in LEFT_OUT or "MULT_ID" in one.text:
                why = "its &MULT is missing" if "MULT_ID" in one.text else LEFT_OUT[one.group]
                node = re.search(r"TO_NODE\s*=\s*['\"]([^'\"]*)", one.text)
                to = f", to {node[1]}" if node else ""
                text = f"&{one.group} {one.name} (line {one.number}){to}{one.edge} is not read; {why}"
                kind = "missing" if one.group in ("CORR", "STRS", "EVSS", "GEOM") else "left out"
                plan.note(kind, text, element=f"&{one.group}")
            elif one.group == "VENT" and "OPEN" in one.text and not len(one.box) and SIDE.search(one.text):
                side = "the ground up to there is read, although it may be outside of the building"
                plan.note("warning", f"the meshes are open at a side (&VENT, line {one.number}): {side}")
        steps = _steps(of["OBST"])
        taken = {one for own in steps for one in own}
        of["OBST"] = [one for one in of["OBST"] if one not in taken]
        ground = [one for one in _floors(of["MESH"], of["OBST"], of["HOLE"]) if one[1].area >= self.least]
        if not ground:
            raise ValueError(f"nowhere in the meshes are there {self.least:g} m2 of floor with {CLEAR:g} m above it")
        floors = [Floor(f"floor {number}", z, floor, floor) for number, (z, floor) in enumerate(ground, start=1)]
        stairs = _stairs(steps, floors, self.cut_slabs, plan.findings)
        heights = np.array([floor.z for floor in floors])
        for one in [one for one in of["EXIT"] if one.says("COUNT_ONLY", "T")]:
            of["EXIT"].remove(one)
            storey = one.storey_of(heights)
            if storey is not None and one.segment is not None:
                plan.lines.append((f"{one.name} (line {one.number})", f"floor {storey + 1}", one.segment))
        for one in (*of["EXIT"], *of["EVAC"]):
            if one.storey_of(heights) is None:
                text = f"&{one.group} {one.name} (line {one.number}) at z = {one.middle:.2f} m is on no storey"
                plan.note("missing", text, element=f"&{one.group}")
        for row, floor in enumerate(floors):
            own = {group: [one for one in found if one.storey_of(heights) == row] for group, found in of.items()}
            self._add_storey(plan, floor.name, floor.z, meeting(floor, stairs), own)
        for stair in stairs:
            stair.add_to(plan)
        return plan

    def _add_storey(self, plan: Plan, storey: str, z: float, floor: BaseGeometry, own: "dict[str, list[Line]]") -> None:
        """Add one storey with its exits, openings and start areas."""
        starts = shapely.union_all([one.plan for one in own["EVAC"]])
        outer = [(one, one.outside) for one in own["EXIT"]]
        floor = floor.difference(shapely.union_all([ground for _, ground in outer]))
        parts = [part for part in shapely.get_parts(flat_parts(floor)) if part.area > LEAST_PART]
        inside = [part for part in parts if part.intersects(starts)] or parts
        ground = shapely.union_all(inside)
        numbers = {one: _numbers(one.text, "NUMBER_INITIAL_PERSONS") for one in own["EVAC"]}
        rooms = dict[Line, BaseGeometry]()
        for one in own["EVAC"]:
            part = flat_parts(one.plan & ground)
            others = shapely.union_all([other.plan for other in own["EVAC"] if other is not one])
            if numbers[one] and part.geom_type == "Polygon" and not (part.interiors or (others & part).area):
                rooms[one] = part
        plan.storey(storey, flat_parts(ground.difference(shapely.union_all([*rooms.values()]))), z)
        plan.note("found", f"{len(inside)} parts of ground at z = {z:g} m", storey)
        for part in parts:
            if part not in inside:
                text = f"{part.area:.2f} m2 of ground in which no &EVAC line starts"
                plan.note("left out", text, storey, place_of(part))
        for one, outside in outer:
            if not ground.dwithin(outside, OUTSIDE):
                text = f"&EXIT {one.name} (line {one.number}) is not at the ground"
                plan.note("missing", text, storey, element="&EXIT")
                continue
            plan.exit(f"{one.name} (line {one.number})", storey, polygon=outside)
        vents = [one for one in own["VENT"] if "OPEN" in one.text and one.segment is not None]
        for one in vents:
            if ground.boundary.dwithin(shapely.LineString(one.segment).centroid, OUTSIDE):
                plan.opening(storey, one.segment)
        for one in own["EVAC"]:
            if not one.plan.intersects(ground):
                text = f"&EVAC {one.name} (line {one.number}) is not on the ground"
                plan.note("missing", text, storey, element="&EVAC")
                continue
            name = f"{one.name} (line {one.number})"
            if one in rooms:
                plan.room(name, storey, rooms[one], people=int(numbers[one][0]))
                continue
            plan.area(name, storey, one.plan)
            if numbers[one]:
                text = f"&EVAC {name} starts {numbers[one][0]:g} people; write the number into case.toml"
                plan.note("left out", text, storey, place_of(one.plan))


@dataclass(frozen=True, eq=False)
class Line:
    """A namelist of the deck: its group, text, number of line, name, and box (6,) [m], empty if it has none."""

    group: str
    text: str
    number: int
    name: str
    box: FloatArray

    @property
    def middle(self) -> float:
        """The height of its middle [m], at most `Z_OFFSET` above its lower side."""
        return float(min(self.box[4:].mean(), self.box[4] + Z_OFFSET))

    @property
    def floor(self) -> float:
        """The height of the floor that a mesh states [m]."""
        offset = (_numbers(self.text, "EVAC_Z_OFFSET") or [Z_OFFSET])[0]
        return float(self.box[4:].mean() - offset if self.says("EVACUATION", "T") else self.box[4])

    def says(self, key: str, value: str) -> bool:
        """Return whether a key is true ("T") or false ("F")."""
        return re.search(rf"\b{key}\s*=\s*\.?{value}", self.text) is not None

    def storey_of(self, heights: FloatArray) -> int | None:
        """Return the storey on whose floor it stands, of ascending heights [m]; None if there is none."""
        below = self.middle - heights
        found = np.flatnonzero((below >= -SAME) & (below <= REACH))
        return int(found[-1]) if len(found) else None

    def holds(self, other: "Line") -> bool:
        """Return whether the middle of another box is in its box."""
        middle = other.box.reshape(3, 2).mean(axis=1)
        return bool(((self.box[::2] - SAME <= middle) & (middle <= self.box[1::2] + SAME)).all())

    @property
    def plan(self) -> BaseGeometry:
        """Its box in plan."""
        x1, x2, y1, y2 = self.box[:4].tolist()
        return shapely.box(x1, y1, x2, y2)

    @property
    def segment(self) -> FloatArray | None:
        """The segment (2, 2) of a vertical face; None for a horizontal one."""
        x1, x2, y1, y2, z1, z2 = self.box.tolist()
        if z2 - z1 < SAME:
            return None
        x, y = (x1 + x2) / 2, (y1 + y2) / 2
        return np.array([[x1, y], [x2, y]]) if x2 - x1 > y2 - y1 else np.array([[x, y1], [x, y2]])

    @property
    def edge(self) -> str:
        """Its segment and the height of the floor below, for messages."""
        ends = self.segment if len(self.box) else None
        return "" if ends is None else f", at {ends.tolist()}, z = {self.middle - Z_OFFSET:.2f} m"

    @property
    def outside(self) -> BaseGeometry:
        """The ground outside of an exit, to which its orientation IOR points."""
        found = re.search(r"IOR\s*=\s*([+-]?[123])\b", self.text)
        way = int(found[1]) if found else 0
        step = np.sign(way) * OUTSIDE * np.eye(3)[abs(way) - 1][:2] if way else np.zeros(2)
        near = self.plan.buffer(1e-6, join_style="mitre") if way else self.plan.buffer(OUTSIDE / 2, join_style="mitre")
        moved = shapely.transform(near, lambda xy: xy + step)
        return shapely.set_precision(shapely.envelope(shapely.union(near, moved)), 1e-4)


#: Groups that are read.
GROUPS = ("MESH", "OBST", "HOLE", "VENT", "EXIT", "EVAC")
#: Numbers of a namelist, such as 1.5 and 2E-3.
NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[ED][-+]?\d+)?"
#: Most copies of a line that is repeated.
MOST_COPIES = 100_000


def _namelists(text: str) -> Iterator[Line]:
    """Yield the namelists of a deck up to &TAIL; quoted texts may contain slashes."""
    text = re.split(r"(?im)^\s*&TAIL\b", text)[0]
    closed = {
        found.start(): found for found in re.finditer(r"(?m)^\s*&(\w{4})\b((?:'[^']*'|\"[^\"]*\"|[^'\"/&])*)/", text)
    }
    for start in re.finditer(r"(?m)^\s*&(\w{4})\b", text):
        number = text.count("\n", 0, start.start(1)) + 1
        found = closed.get(start.start())
        if found is None:
            raise ValueError(f"line {number}: &{start[1].upper()} is not closed by a slash")
        own = found[2].upper()
        name = re.search(r"(?i)\bID\s*=\s*['\"]([^'\"]*)", found[2])
        numbers = _numbers(own, "XB")
        if numbers and (len(numbers) != 6 or not np.isfinite(numbers).all()):
            raise ValueError(f"line {number}: XB of &{found[1].upper()} must be six numbers")
        box = np.sort(np.reshape(numbers, (3, 2)), axis=1).ravel() if numbers else np.empty(0)
        yield Line(found[1].upper(), own, number, name[1] if name else found[1].lower(), box)


def _numbers(text: str, key: str) -> list[float]:
    """Return the numbers that a key of a namelist has; none without it."""
    found = re.search(rf"(?<![A-Z_]){key}\s*=((?:[\s,]*{NUMBER}(?![\w(]))*)", text)
    return [float(word.replace("D", "E")) for word in re.findall(NUMBER, found[1])] if found else []


def _repeated(lines: list[Line]) -> Iterator[Line]:
    """Yield namelists, of which those with a MULT_ID are replaced by their copies."""
    copies = {line.name.upper(): line for line in lines if line.group == "MULT"}
    for one in lines:
        given = re.search(r"MULT_ID\s*=\s*['\"]([^'\"]*)", one.text)
        if given is None or not len(one.box) or given[1] not in copies:
            yield one
            continue
        text = one.text.replace(given[0], "")
        yield from (replace(one, text=text, box=one.box + move) for move in _moves(copies[given[1]]))


def _moves(mult: Line) -> FloatArray:
    """Return by how much the sides of each copy of a line are moved (n, 6) [m]."""

    def first(key: str) -> float:
        return float(np.clip((_numbers(mult.text, key) or [0.0])[0], -1e9, 1e9))

    origin, step = ([first(f"D{axis}{end}") for axis in "XYZ"] for end in ("0", ""))
    low, high = ([int(first(f"{axis}_{end}")) for axis in "IJKN"] for end in ("LOWER", "UPPER"))
    spread = np.array((_numbers(mult.text, "DXB") + [0.0] * 6)[:6])
    count = np.maximum(np.subtract(high, low) + 1, 1)
    if count.prod(dtype=float) > MOST_COPIES:
        raise ValueError(f"line {mult.number}: &MULT {mult.name} makes more than {MOST_COPIES} lines")
    grid = np.meshgrid(*(np.arange(start, start + n) for start, n in zip(low, count, strict=True)), indexing="ij")
    *along, number = (axis.ravel() for axis in grid)
    times = np.stack(along, axis=1) + (0 if spread.any() else number[:, None])
    moves: FloatArray = np.repeat(origin + times * step, 2, axis=1) + number[:, None] * spread
    return moves


def _of_storeys(meshes: list[Line], stairs: list[Line], used: list[Line]) -> list[Line]:
    """Return the meshes without those that `&STRS` lines name and in which nobody starts or leaves."""
    named = {name for one in stairs for name in re.findall(r"\bMESH_ID\s*=\s*['\"]([^'\"]*)", one.text)}
    wells = [mesh for mesh in meshes if mesh.name.upper() in named and not any(map(mesh.holds, used))]
    return [mesh for mesh in meshes if mesh not in wells]


def _floors(meshes: list[Line], obstructions: list[Line], holes: list[Line]) -> Iterator[tuple[float, BaseGeometry]]:
    """Yield the height and the ground of each storey, the lowest first."""
    top = max(float(mesh.box[5]) for mesh in meshes)
    stated = [mesh for mesh in meshes if mesh.says("EVACUATION", "T") and not mesh.says("EVAC_HUMANS", "F")]
    ground = [(mesh.floor, mesh.plan) for mesh in stated or meshes]
    boxes = np.array([obstruction.box for obstruction in obstructions]).reshape(-1, 6)
    sides = boxes.reshape(-1, 3, 2)[:, :2]
    sides += np.clip(THINNEST - np.ptp(sides, axis=2), 0.0, None)[:, :, None] / 2 * [-1.0, 1.0]
    slabs = boxes[
        (boxes[:, 5] - boxes[:, 4] <= THICKEST_SLAB)
        & (np.ptp(boxes.reshape(-1, 3, 2)[:, :2], axis=2).min(axis=1) > 1.0)
    ]
    given = [z for z, _ in ground] if stated else [min(z for z, _ in ground)]
    # Each with whether it is the top of a slab, which is the floor of a mesh around it.
    heights: list[tuple[float, bool]] = []
    for z, is_slab in sorted([*((z, False) for z in given), *((z, True) for z in slabs[:, 5].tolist())]):
        if not heights or z - heights[-1][0] > SAME:
            heights.append((z, is_slab))
        elif is_slab and not heights[-1][1]:
            heights[-1] = z, True
    for z, _ in heights:
        tops = slabs[np.abs(slabs[:, 5] - z) <= SAME]
        floor = _solid(tops, holes, z - 0.01) if len(tops) else shapely.GeometryCollection()
        floor = shapely.union_all([floor, *(plan for low, plan in ground if abs(low - z) <= SAME)])
        between = slabs[:, 4:].mean(axis=1)
        between = between[(between > z + SECTIONS[0]) & (between < z + SECTIONS[-1])]
        cuts = [*(z + h for h in SECTIONS), *np.unique(np.round(between, 2)).tolist()]
        walls = [_solid(boxes[(boxes[:, 4] < cut) & (boxes[:, 5] > cut)], holes, cut) for cut in cuts]
        is_given = any(abs(low - z) <= SAME for low in given)
        if is_given or (z + CLEAR <= top and any(wall.intersects(floor) for wall in walls[1 : len(SECTIONS)])):
            yield z, floor.difference(shapely.union_all(walls))


def _steps(obstructions: list[Line]) -> list[list[Line]]:
    """Return the obstructions of each stair: steps and landings beside each other, which rise from one to the next."""
    sides = np.array([np.diff(one.box)[[0, 2]] for one in obstructions]).reshape(-1, 2)
    found = [obstructions[row] for row in np.flatnonzero((sides.min(axis=1) >= STEP) & (sides.prod(axis=1) <= LANDING))]
    plans, tops = np.array([one.plan for one in found], dtype=object), np.array([one.box[5] for one in found])
    low, up = shapely.STRtree(plans).query(plans, "dwithin", GAP)
    rise = tops[up] - tops[low]
    pairs = np.column_stack([low, up])[(rise >= RISER[0]) & (rise <= RISER[1])]
    group = connected_components(len(found), pairs)
    stairs = [np.flatnonzero(group == label) for label in np.unique(group[pairs])]
    return [[found[row] for row in rows] for rows in stairs if len(np.unique(tops[rows])) >= STEPS]


def _stairs(steps: list[list[Line]], floors: list[Floor], cut_slabs: bool, findings: list[Finding]) -> list[FoundStair]:
    """Return the stairs between the floors; steps that are none are left out of the floors, as obstructions are."""
    bodies = [Body("stair", f"&OBST of line {own[0].number}", *_faces([one.box for one in own])) for own in steps]
    hulls = {floor.name: shapely.convex_hull(floor.ground) for floor in floors}
    # Steps that begin below a floor and end at it; others are tribunes.
    lead = [one for one in bodies if any(one.z_min + SAME < on.z and abs(on.z - one.z_max) < SAME for on in floors)]
    stairs = stairs_of(lead, floors, hulls, cut_slabs, findings)
    made = united([stair.plan for stair in stairs])
    for body in bodies:
        plan = body.shadow
        if common(plan, made).area < 0.5 * plan.area:
            for floor in floors:
                if body.z_min < floor.z + SECTIONS[-1] and body.z_max > floor.z + SECTIONS[0]:
                    floor.ground = cut(floor.ground, plan)
    return stairs


def _faces(boxes: list[FloatArray]) -> tuple[FloatArray, IndexArray]:
    """Return the points (8 n, 3) and triangles (4 n, 3) of the tops and bottoms of n boxes."""
    points = np.array(
        [[(box[i], box[2 + j], box[4 + k]) for k in (0, 1) for j in (0, 1) for i in (0, 1)] for box in boxes]
    )
    faces = np.array([(0, 2, 1), (1, 2, 3), (4, 5, 6), (5, 7, 6)])
    return points.reshape(-1, 3), (faces + 8 * np.arange(len(boxes))[:, None, None]).reshape(-1, 3)


def _solid(boxes: FloatArray, holes: list[Line], z: float) -> BaseGeometry:
    """Return the plan of boxes (n, 6) without the holes that reach a height [m]."""
    away = [hole.plan for hole in holes if hole.box[4] <= z <= hole.box[5]]
    return shapely.union_all([*shapely.box(*boxes[:, [0, 2, 1, 3]].T)]).difference(shapely.union_all(away))
