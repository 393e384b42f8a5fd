"""Plans of building models: passages between rooms, and the storeys, stairs, doors and exits of all bodies."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH, HEADROOM
from evac.base.errors import BuildingError, counted
from evac.building.geometry import common, cut, flat_parts, place_of, united
from evac.building.model.findings import Finding, and_more, grouped, numbered
from evac.building.plan.outlines import normal, strips
from evac.building.plan.plan import Plan
from evac.building.recover.bodies.body import MILLIMETRE, NOTCH, Body, closed, snapped, without_slivers
from evac.building.recover.bodies.flights import FoundStair, meeting, stairs_of
from evac.building.recover.bodies.floors import Floor, Rules, floors_of

#: Largest difference in height between the foot of a door and the floor that it stands on [m].
SILL = 0.3
#: Minimum height of an opening without a door that people can pass [m].
LEAST_HEIGHT = 1.8
#: A door or window fills an opening if its box, grown across walls, covers at least this fraction of the opening's.
FILLED = 0.5
#: An opening reaches the foot of its wall if it ends at most this high above it [m].
FOOT = 0.1
#: Largest gap between the face of a wall and the room beside it [m].
BEHIND = 0.15
#: Lengths tried in turn by which each end of a door is shortened, until rooms lie along all of it [m].
SHORTENED = (0.0, 0.02, 0.05, 0.1, 0.15)
#: Greatest height of the foot of a door above the floors beside it, if it stands on no other floor [m].
STEP = 0.8
#: Floors whose heights differ by at most this are of one storey [m].
HALF_STOREY = 1.5
#: How far beyond a door the outside of the storey begins; recesses that are narrower than twice this are inside [m].
BEYOND = 0.3
#: Largest area of a pit, below a group of lifts [m2], and how far below the next floor pits are [m].
LARGEST_PIT, PIT = 30.0, (0.9, HEADROOM)
#: Names of doors of lifts.
LIFT = re.compile(r"(?i)(lift|elevator|aufzug|fahrstuhl|ascens)(?!.*(vorraum|lobby))")
#: Narrowest door [m].
NARROWEST = 0.5


@dataclass(frozen=True, eq=False)
class Doorway:
    """A door: its segment (2, 2) in the middle of a wall, its reach to rooms [m], and how many sides have rooms."""

    name: str
    floor: Floor
    beside: BaseGeometry  # the parts of the floor near it
    segment: FloatArray
    reach: float
    sides: int
    leads_out: bool  # whether one side is outside of the storey
    is_filled: bool  # whether there is a door, not only an opening

    @property
    def ground(self) -> BaseGeometry:
        """The ground between the door and the rooms beside it."""
        ways = np.outer([1.0, -1.0], normal(self.segment))
        sides = strips(self.beside, self.segment, ways, self.reach)
        return united([side.polygon for side in sides if side is not None and not side.polygon.is_empty])


def passages_of(bodies: Sequence[Body]) -> tuple[list[Body], list[Body]]:
    """Return the bodies that people pass through, and the openings that must be filled in the walls.

    A passage is the opening that a door fills, the door itself if it fills no opening, or an empty opening that reaches
    down to the floor. Openings are holes in walls. They are filled again, since rooms end at their walls and are joined
    by doors only.
    """
    openings = [body for body in bodies if body.kind == "opening"]
    boxes, row_of = _boxes(openings), {one.number: row for row, one in enumerate(openings) if one.number != -1}
    walls = _boxes([body for body in bodies if body.kind == "wall"])
    passages, taken, filled = [], set(), []
    for body in bodies:
        if body.kind in ("door", "window"):
            row = row_of[body.fills] if body.fills in row_of else _filled(body, boxes)
            taken.add(row)
            shape = body if row is None else openings[row]
            filled.append(replace(shape, kind="opening", name=body.name, fills=body.number))
            if body.kind == "door":
                passages.append(filled[-1])
    middles = boxes[sorted(row for row in taken if row is not None)].mean(axis=1)
    for row, opening in enumerate(openings):
        is_free = row not in taken and opening.z_max - opening.z_min >= LEAST_HEIGHT
        if is_free and not ((opening.box[0] <= middles) & (middles <= opening.box[1])).all(axis=1).any():
            passages += [opening] if _is_in_wall(opening, walls) else []
    return passages, [*filled, *(opening for opening in passages if opening not in filled)]


def _boxes(bodies: Sequence[Body]) -> FloatArray:
    return np.array([body.box for body in bodies]).reshape(-1, 2, 3)


def _is_in_wall(opening: Body, walls: FloatArray) -> bool:
    """Return whether an opening is in one of the walls, given by boxes (w, 2, 3), and reaches down to its foot."""
    low, high = opening.box
    meets = ((walls[:, 0] - 0.01 < high) & (walls[:, 1] + 0.01 > low)).all(axis=1)
    return bool((meets & (opening.z_min - walls[:, 0, 2] < FOOT)).any())


def _filled(door: Body, boxes: FloatArray) -> int | None:
    """Return the row of the box of the opening that a door or window fills; None if there is none.

    A leaf is thinner than its opening, and may stand beside its wall: what counts is the share of the shorter sides.
    """
    low, high = door.box + np.array([[-BEHIND], [BEHIND]]) * (1.0, 1.0, 0.0)
    both = np.maximum(np.minimum(high, boxes[:, 1]) - np.maximum(low, boxes[:, 0]), 0.0)
    size = np.maximum(boxes[:, 1] - boxes[:, 0], 1e-3)
    share = np.prod(both / size, axis=1)
    return int(share.argmax()) if len(share) and share.max() > FILLED else None


def doorways_of(
    passages: Sequence[Body], floors: Sequence[Floor], hulls: Mapping[str, BaseGeometry], findings: list[Finding]
) -> list[Doorway]:
    """Return the doors of each floor that join rooms or lead outside; doors without a room are added to `findings`."""
    doorways = []
    trees = {floor.name: shapely.STRtree(shapely.get_parts(floor.ground)) for floor in floors}

    def fitted(body: Body, floor: Floor) -> Doorway | None:
        corners, tree = body.rectangle(), trees[floor.name]
        if corners is None:
            return None
        near = tree.query(shapely.Polygon(corners), "dwithin", distance=2 * BEHIND)
        return _fit(body, corners, floor, shapely.multipolygons(tree.geometries[np.sort(near)]), hulls[floor.name])

    for body in passages:
        near = [floor for floor in floors if abs(floor.z - body.z_min) <= SILL]
        below = [floor for floor in floors if SILL < body.z_min - floor.z <= STEP and body.fills != -1]
        near.sort(key=lambda floor: abs(floor.z - body.z_min))
        ways = [fitted(body, floor) for floor in near[:1]]
        ways += [way for floor in below if (way := fitted(body, floor)) and way.sides == 2]
        way = next((way for way in ways if way is not None), None)
        if way is not None:
            doorways.append(way)
            if way.floor in below:
                text = f"{body.name!r} begins {body.z_min - way.floor.z:.2f} m above the floors on both of its sides"
                findings.append(Finding("assumed", f"{text}; it is a door between them", way.floor.name, body.place))
        elif near:
            text, element = f"{body.name!r} has no room on either side", "door" if body.fills != -1 else "opening"
            findings.append(Finding("left out", text, near[0].name, body.place, element=element))
        elif body.fills != -1:
            text = f"{body.name!r} is not on a floor (z = {body.z_min:z.2f} m)"
            findings.append(Finding("left out", text, None, body.place, element="door"))
    return doorways


def _hull(floor: Floor, floors: Sequence[Floor], walls: Sequence[Body]) -> BaseGeometry:
    """Return the ground and the walls of a storey without holes, as which shafts and voids belong to it."""
    near = [other.ground for other in floors if abs(other.z - floor.z) <= HALF_STOREY]
    beside = [wall.shadow for wall in walls if wall.z_min - SILL <= floor.z + 1.0 <= wall.z_max + SILL]
    plan = closed(united([*near, *(part for part in beside if not part.is_empty)]), 2.0 * BEYOND)
    return united([shapely.Polygon(part.exterior) for part in shapely.get_parts(plan)])


def _fit(body: Body, corners: FloatArray, floor: Floor, ground: BaseGeometry, hull: BaseGeometry) -> Doorway | None:
    """Return the widest door, in a rectangle (4, 2), with the largest number of rooms beside it; None without a room.

    `ground`: the parts of the floor near the door.
    """
    best: Doorway | None = None
    for side in (0, 1):
        a, b, c, d = np.roll(corners, -side, axis=0)
        ends = np.array([(a + d) / 2, (b + c) / 2])
        width, depth = float(np.hypot(*(ends[1] - ends[0]))), float(np.hypot(*(d - a)))
        if width < NARROWEST:
            continue
        along, reach = (ends[1] - ends[0]) / width, depth / 2 + BEHIND
        for start, end, less in _parts(ground, ends, width, reach):
            if end - start - 2 * less < NARROWEST:
                continue
            segment = np.round(np.array([ends[0] + (start + less) * along, ends[0] + (end - less) * along]), 3)
            ways = np.outer([1.0, -1.0], normal(segment))
            rooms = [side is not None for side in strips(ground, segment, ways, reach)]
            if any(rooms) and (best is None or sum(rooms) > best.sides):
                behind = [
                    shapely.Point(segment.mean(axis=0) + (reach + BEYOND) * way)
                    for way, has_room in zip(ways, rooms, strict=True)
                    if not has_room
                ]
                leads_out = any(not hull.contains(point) for point in behind)
                best = Doorway(body.name, floor, ground, segment, reach, sum(rooms), leads_out, body.fills != -1)
                if best.sides == 2:
                    return best
    return best


def _parts(ground: BaseGeometry, ends: FloatArray, width: float, reach: float) -> Iterator[tuple[float, float, float]]:
    """Yield the parts of a segment that are tried in turn, from its first end, and what both ends are shortened [m].

    After all of it come its parts that have ground on both sides.
    """
    yield 0.0, width, 0.0
    along, spans = (ends[1] - ends[0]) / width, []
    for way in (normal(ends), -normal(ends)):
        band = shapely.Polygon([ends[0], ends[1], ends[1] + reach * way, ends[0] + reach * way])
        near = [(shapely.get_coordinates(part) - ends[0]) @ along for part in shapely.get_parts(common(ground, band))]
        spans.append([(float(own.min()), float(own.max())) for own in near])
    parts = {(0.0, width), *((max(a, c), min(b, d)) for a, b in spans[0] for c, d in spans[1])}
    yield from ((*part, less) for less in SHORTENED for part in sorted(parts))


#: Minimum area of the remaining part of a room in which people can start [m2].
LEAST_ROOM = 0.5
#: Share of the ground that a space without a floor may have, such as the upper part of a hall.
LOST = 0.02
#: Distance by which rooms extend beyond their spaces, less than the thickness of walls [m].
OVERLAP = 0.02
#: Share of a part of the ground from which on a space is all of it.
ALL = 0.9


def plan_of_bodies(
    source: Path, bodies: Sequence[Body], storeys: Sequence[tuple[str, float]], rules: Rules, findings: list[Finding]
) -> Plan:
    """Return the plan of a building.

    `source`: for messages; `storeys` [m]: names and heights. The floors themselves are found from the bodies;
    `findings`: findings so far; they become the first findings of the plan.
    """
    idle = sum(body.kind == "furniture" for body in bodies)
    if idle and not rules.furniture:
        findings.append(Finding("left out", "it is no obstacle (furniture)", element="furniture", number=idle))
    passages, openings = passages_of(bodies)
    solid = [body for body in bodies if body.kind not in ("opening", "door", "window")]
    floors = floors_of([*solid, *openings], passages, storeys, rules, findings)
    if not floors:
        kinds = sorted({body.kind for body in bodies})
        missing = grouped(finding for finding in findings if finding.kind == "missing")
        lost = "".join(f"; {group[0].text}{and_more(group)}" for group in missing)
        raise BuildingError(
            f"{source}: the file has no floor: neither a space nor a slab with a level top, only "
            f"{', '.join(kinds) or 'nothing'}{lost}"
        )
    walls = [body for body in bodies if body.kind == "wall"]
    hulls = {floor.name: _hull(floor, floors, walls) for floor in floors}
    lifts = [body for body in bodies if body.kind == "lift"]
    _leave_out_lifts(floors, passages, lifts, findings)
    ways = doorways_of(passages, floors, hulls, findings)
    passable = [way.ground for way in ways]
    for floor in floors:
        own = [ground for way, ground in zip(ways, passable, strict=True) if way.floor is floor]
        floor.ground = snapped(united([floor.ground, *own]))
    stairs = stairs_of(bodies, floors, hulls, rules.cut_slabs, findings)
    floors = _without_pits(floors, ways, stairs, findings)
    plan = Plan(source)
    plan.findings = findings
    away, names = united([stair.plan for stair in stairs]), set[str]()
    whole = sum(floor.ground.area for floor in floors)
    for floor in floors:
        more = [polygon for stair in stairs for of, polygon in stair.ground if of is floor]
        for polygon in more:
            text = f"{polygon.area:.3f} m2 of floor added at the end of a stair"
            findings.append(Finding("repaired", text, floor.name, place_of(polygon)))
        floor.ground = meeting(floor, stairs)
        inner = [ground for way, ground in zip(ways, passable, strict=True) if way.floor is floor and way.sides == 2]
        _add_floor(plan, floor, cut(floor.ground, united(inner)), away, names, LOST * whole)
        slab = "" if floor.rooms else ", of slabs"
        plan.note("found", f"{floor.ground.area:.2f} m2 at {floor.z:.2f} m{slab}", floor.name)
    for stair in stairs:
        stair.add_to(plan)
    _add_lifts(plan, lifts, passages, floors)
    _add_doors(plan, [way for way in ways if way.sides == 2 or not _is_of_lift(plan, way)], rules)
    return plan


def _leave_out_lifts(
    floors: Sequence[Floor], passages: Sequence[Body], lifts: Sequence[Body], findings: list[Finding]
) -> None:
    """Take lifts from the ground of floors: small parts around cars, or with doors all named as those of lifts."""
    cars = [body.shadow for body in lifts]
    for floor in floors:
        near = [body for body in passages if abs(body.z_min - floor.z) <= SILL]
        parts = shapely.get_parts(floor.ground)
        small = parts[shapely.area(parts) < LARGEST_PIT]
        shadows = [body.shadow for body in near]
        part, door = shapely.STRtree(shadows).query(small, predicate="dwithin", distance=BEHIND)
        is_lift = np.array([bool(LIFT.search(body.name)) for body in near], dtype=bool)
        for k in np.unique(part).tolist():
            is_car = shapely.dwithin(small[k], cars, 0.0).any()
            if is_car or is_lift[door[part == k]].all():
                why = "the shaft of a lift" if is_car else "a lift by the names of its doors"
                text = f"{small[k].area:.2f} m2, {why}"
                findings.append(Finding("left out", text, floor.name, place_of(small[k])))
                floor.ground = cut(floor.ground, small[k])


def _add_lifts(plan: Plan, lifts: Sequence[Body], passages: Sequence[Body], floors: Sequence[Floor]) -> None:
    """Add the lifts with doors on at least two floors, which do not run until a case says so."""
    from evac.base.change import LiftOptions
    from evac.building.model.lifts import LEAST_GROUND

    names = set[str]()
    for body in lifts:
        stops, doors, car = list[str](), list[FloatArray](), body.rectangle()
        is_new = not any(common(other.polygon, body.shadow).area > 0.0 for other in plan.lifts)
        for floor in sorted(floors, key=lambda one: one.z):
            if car is None or not is_new:
                break
            near = [door for door in passages if abs(door.z_min - floor.z) <= SILL]
            own = [line for door in near if (line := _lift_door(car, door, floor)) is not None]
            stops += [floor.name] if own else []
            doors += [line for line in own if all(np.abs(line - other).max() > SILL for other in doors)]
        if car is None or len(stops) < 2:
            text = f"{body.name!r}, a lift, has doors on {len(stops)} floors; draw it in the plan"
            plan.note("left out", text, None, body.place, element="lift")
            continue
        name = numbered(body.name, names)
        names.add(name)
        most = int(shapely.Polygon(car).area / LEAST_GROUND)
        people = max(1, min(body.capacity or LiftOptions().capacity, most))
        load = {"load": body.load} if body.load else {}
        plan.lift(name, stops, np.round(car, 3), doors, operation={"service": False, "capacity": people} | load)
        stated = f"{body.load:.0f} kg" if body.load else "no limit of mass"
        text = f"lift {name!r} stops at {', '.join(stops)}, for {counted(people, 'person', 'people')} and {stated}"
        text += "; it runs if the case says service = true"
        plan.note("assumed", text, stops[0], body.place)


def _is_of_lift(plan: Plan, way: Doorway) -> bool:
    """Return whether a door leads to a car of a lift alone."""
    line, near = shapely.linestrings(way.segment), [one for one in plan.lifts if way.floor.name in one.storeys]
    return any(shapely.dwithin(line, lift.polygon, DOOR_REACH) for lift in near)


def _lift_door(car: FloatArray, door: Body, floor: Floor) -> FloatArray | None:
    """Return the part (2, 2) of the outline of a car (4, 2) that is a door to a floor [m]; None if it is none."""
    sides = np.round(np.stack([car, np.roll(car, -1, axis=0)], axis=1), 3)
    away = shapely.distance(shapely.linestrings(sides), door.shadow.centroid)
    (start, end), length = sides[away.argmin()], float(np.hypot(*np.subtract(*sides[away.argmin()])))
    along = (end - start) / length
    at = np.clip((shapely.get_coordinates(door.shadow) - start) @ along, 0.0, length)
    line = start + np.outer([at.min(), at.max()], along)
    if away.min() > DOOR_REACH or np.ptp(at) < NARROWEST:
        return None
    out = normal(line) * np.sign(normal(line) @ (start - car.mean(axis=0)))
    return None if strips(floor.ground, line, out[None], DOOR_REACH)[0] is None else line


def _without_pits(
    floors: list[Floor], ways: Sequence[Doorway], stairs: Sequence[FoundStair], findings: list[Finding]
) -> list[Floor]:
    """Return the floors without pits: small ones below another floor to which neither door nor stair leads."""
    met = [*(way.floor for way in ways), *(floor for stair in stairs for floor in stair.floors)]
    kept = []
    for floor in floors:
        is_low = any(PIT[0] < other.z - floor.z < PIT[1] for other in floors)
        if is_low and floor.ground.area < LARGEST_PIT and not any(floor is other for other in met):
            text = f"{floor.ground.area:.2f} m2 at {floor.z:.2f} m, a pit: neither door nor stair leads there"
            element, number = ("space", len(floor.rooms)) if floor.rooms else ("slab", 1)
            place = (*place_of(floor.ground), floor.z)
            findings.append(Finding("left out", text, None, place, element=element, number=number))
        else:
            kept.append(floor)
    return kept


def _add_doors(plan: Plan, ways: Sequence[Doorway], rules: Rules) -> None:
    """Add the doors and exits."""
    outer = [way for way in ways if way.sides == 1 and way.leads_out and way.is_filled]
    floors = list({way.floor.name: way.floor for way in outer}.values())
    if rules.exits == "none":
        floors = []
    elif rules.exits == "ground" and floors:
        ground = min(floors, key=lambda floor: (abs(floor.z - rules.ground_z), floor.z))
        floors = [floor for floor in floors if abs(floor.z - ground.z) <= HALF_STOREY]
        text = "doors that lead outside are exits on this storey but not on others (exits, ground_z)"
        plan.note("assumed", text, ground.name)
    taken: set[str] = set()
    for way in ways:
        name = numbered(way.name, taken)
        taken.add(name)
        is_exit = way in outer and way.floor in floors
        if is_exit:
            plan.exit(name, way.floor.name, way.segment)
        elif way.sides == 2:
            plan.door(name, way.floor.name, way.segment, reach=way.reach)
        else:
            plan.opening(way.floor.name, way.segment, name)
        width = float(np.hypot(*(way.segment[1] - way.segment[0])))
        x, y = way.segment.mean(axis=0).tolist()
        kind = "door" if way.is_filled else "opening"
        to = "the outside" if way.leads_out else "a void inside of the building"
        what = "exit" if is_exit else kind if way.sides == 2 else f"{kind} to {to} (not an exit)"
        plan.note("found", f"{what} {name!r}, {width:.2f} m wide", way.floor.name, (x, y))


def _add_floor(
    plan: Plan, floor: Floor, ground: BaseGeometry, away: BaseGeometry, names: set[str], least: float
) -> None:
    """Add the ground of a floor: its spaces as rooms, except those that stairs cover, and the rest to its storey.

    `away`: stairs in plan; `names`: names of rooms so far; `least`: area of a space without ground that is missing
    [m2].
    """
    spaces = []
    for room, use, polygon in floor.rooms:
        if common(open_part := cut(polygon, away), ground).area < LEAST_ROOM:
            kind = "missing" if open_part.area > least else "left out"
            text = f"{room!r} is not an area: a stair covers it, or it has no floor"
            plan.note(kind, text, floor.name, place_of(polygon), element="space")
        else:
            spaces.append((room, use, snapped(shapely.buffer(polygon, OVERLAP, join_style="mitre"))))
    rooms, rest = list[tuple[str, str, BaseGeometry]](), []
    tree = shapely.STRtree([grown for _, _, grown in spaces])
    for part in shapely.get_parts(ground):
        left = part
        for room, use, grown in (spaces[row] for row in np.sort(tree.query(part))):
            pieces = shapely.get_parts(flat_parts(shapely.intersection(grown, left, grid_size=MILLIMETRE)))
            if shapely.area(pieces).sum() > max(LEAST_ROOM, ALL * part.area):
                pieces = [left]
            piece = max(pieces, key=lambda own: own.area, default=shapely.Polygon())
            if piece.area > LEAST_ROOM:
                name = numbered(room if room not in names else f"{room} of {floor.name}", names)
                names.add(name)
                rooms.append((name, use, piece))
                left = flat_parts(shapely.difference(left, piece, grid_size=MILLIMETRE))
        # A buffer as small as the precision of a geometry is empty.
        rest += [*shapely.get_parts(without_slivers(shapely.set_precision(left, 0.0), NOTCH))]
    plan.storey(floor.name, rest or None, floor.z)
    for name, use, piece in rooms:
        plan.room(name, floor.name, piece, use=use or None)
