"""Conversion of a plan to a surface mesh: doors join rooms, obstacles and stairs are cut out, exits are opened."""

from collections.abc import Iterable, Mapping
from contextlib import AbstractContextManager
from dataclasses import replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH, LEAST_LENGTH
from evac.base.errors import BuildingError, counted
from evac.base.progress import reading, track
from evac.building.geometry import (
    GRID,
    LEAST_AREA,
    between_floors,
    common,
    cut,
    flat_parts,
    place_of,
    rounded,
    segment_lengths,
    sides,
    united,
)
from evac.building.model.findings import Finding, noting, written
from evac.building.plan import stairs
from evac.building.plan.outlines import (
    SNAP,
    Strip,
    along,
    between_rooms,
    covered,
    distinct,
    doorway,
    normal,
    strips,
    with_walls,
)
from evac.building.plan.plan import Item, LiftItem, Plan, Stair
from evac.building.plan.rooms import check_storey, expanded, key_of, originals, with_known_storeys
from evac.building.surface.surfacemesh import Height, SurfaceMesh

#: The strips of ground on both sides of a door, if it stands between two rooms.
Beside = tuple[Strip | None, ...] | None
Drawn = tuple[tuple[str, ...], BaseGeometry, Height]  #: A surface: its tags, its polygon in plan and its height.

#: Distance from a segment at which the presence of floor is tested [m].
BESIDE = 0.05
#: Depth of floor added up to an exit above which it is a warning: more than the thickness of most walls [m].
DEEP = 0.3
#: Length of an exit or a stair edge that may lack a floor beside it without a warning [m].
UNCOVERED = 0.01
#: A door to the outside that is nearer than this to the outline of the floor is on it [m].
FLUSH = 0.01
#: Pieces of an outline at most this far apart are on one line [m]; narrowest part of an exit that another one has.
ON_ONE_LINE, NARROWEST = 1e-5, 0.5
#: Thickness of the walls of lifts [m].
LIFT_WALL = 0.15
#: Smallest overlap of two floors, and smallest part of an area beside its floor, that is reported [m2].
LEAST_REPORTED = 0.05
MOST_BESIDE = 0.05  #: Share of an area beside its floor above which it is a warning.


class Drawing:
    """The floors of a plan while they are cut and joined, and its errors, each of which leaves its item out."""

    def __init__(self, plan: Plan) -> None:
        self.errors: list[Finding] = []
        self.given = with_known_storeys(plan, self.errors)
        self.declared, self.plan = {*plan.storeys, *plan.refused}, expanded(self.given, self.errors)
        self.findings = [finding for finding in plan.findings if finding.kind != "error"]
        self.floors: dict[str, BaseGeometry] = {}
        self.rooms: dict[str, BaseGeometry] = {}  # the floors before anything is cut out of them
        self.pieces: dict[str, list[stairs.Piece]] = {}
        self.edges: list[tuple[str, str, FloatArray]] = []  # tag, storey, pieces (p, 4)
        self.openings: list[tuple[str, FloatArray]] = []
        self.doors: list[tuple[str, FloatArray]] = []
        self.exits: list[Item] = []

    def mesh(self) -> SurfaceMesh | None:
        """Return the surface mesh: apply all parts of the plan in order; None if nothing can be drawn."""
        plan = self.plan
        if not self.declared:
            self.errors.append(Finding("error", "the plan has no storey; add at least one with its polygons"))
        self._leave_out_misplaced()
        for section in ("doors", "exits", "openings", "areas", "obstacles"):
            setattr(plan, section, [item for item in getattr(plan, section) if self._is_on_storey(section, item)])
        for name in plan.storeys:
            self._make_floor(name)
        self._open_doors()
        cars = [car for lift in plan.lifts for car in self._place_lift(lift)]
        self.rooms = dict(self.floors)
        obstacles = [self._place_obstacle(item) for item in plan.obstacles]
        self.exits += plan.exits
        self._cut_exits()
        self._make_stairs()
        for item in self.exits:
            with self._noting("doors" if item.outside == "exit" else "exits", item):
                self._open_exit(item)
        self._part_exits()
        for item in plan.openings:
            assert item.segment is not None
            own = _on_outline(self.floors[item.storey], item.segment)
            self.openings += [(item.storey, piece) for piece in own]
            if not len(own):
                text = f"opening {item.name!r} is not on the outline of the floor"
                self._find("left out", text, item.storey, item.segment, key_of("openings", item), "remove it")
        self._find_areas_beside_floors()
        surfaces: list[Drawn] = [*self._ground(), *cars, *(drawn for drawn in obstacles if drawn is not None)]
        if not surfaces:
            return None
        for name, pieces in self.pieces.items():
            surfaces += [((f"stair:{name}",), piece.plan, piece.height) for piece in pieces]
        edges = []
        for tag, storey, ends in self.edges:
            z = plan.storeys[storey].z
            edges += [(tag, (x1, y1, z), (x2, y2, z)) for x1, y1, x2, y2 in ends.tolist()]
        try:
            uses = {room.name: (room.use or "", room.number) for room in plan.rooms if room.is_area}
            reading(0)
            mesh = SurfaceMesh.of_polygons(surfaces, edges, self.findings, self.openings, self.doors, uses)
            controls = {one.name: one.control for one in (*plan.doors, *plan.exits) if one.control is not None}
            drawn = {tag for (tag, *_), *_ in cars}
            whole = [one for one in plan.lifts if drawn.issuperset(map(one.tag_at, one.storeys))]
            heights = {name: storey.z for name, storey in plan.storeys.items()}
            lifts = [(one.name, sorted(one.storeys, key=heights.__getitem__), one.operation) for one in whole]
            return replace(mesh, north=plan.north, controls=controls, lifts=lifts)
        except ValueError as error:
            self.errors.append(Finding("error", str(error)))
        return None

    def _noting(self, section: str, item: Item) -> AbstractContextManager[None]:
        """Collect what is wrong with an item."""
        at = item.segment if item.segment is not None else item.polygons[0] if item.polygons else None
        return noting(self.errors, f"{section.removesuffix('s')} {item.name!r}", key_of(section, item), item.storey, at)

    def _is_on_storey(self, section: str, item: Item) -> bool:
        with self._noting(section, item):
            check_storey(self.declared, item.storey)
        return item.storey in self.plan.storeys

    def _find(
        self, kind: str, text: str, storey: str, at: BaseGeometry | FloatArray, item: str, remedy: str = ""
    ) -> None:
        """Add a finding about an item (by key) on a storey, at a geometry or at the middle of a segment."""
        self.findings.append(Finding(kind, text, storey, place_of(at), item, remedy))

    def _find_areas_beside_floors(self) -> None:
        """Tell of the parts of areas that are not on the floor of their storey, which do not belong to the areas."""
        for item in (item for item in self.plan.areas if not key_of("areas", item).startswith("rooms.")):
            outline = united(item.polygons)
            rest = cut(outline, self.rooms[item.storey])
            if rest.area > LEAST_REPORTED:
                kind = "warning" if rest.area > MOST_BESIDE * outline.area else "left out"
                text = f"{rest.area:.2f} of the {outline.area:.2f} m2 of area {item.name!r} are not on the floor"
                self._find(kind, text, item.storey, rest, key_of("areas", item))

    def _leave_out_misplaced(self) -> None:
        """Leave out storeys that are at the height of others and above their ground, as those without a height."""
        storeys, right = self.plan.storeys, dict[str, float]()
        for name, storey in storeys.items():
            level = [united(storeys[one].polygons) for one, z in right.items() if z == storey.z]
            if level and common(united(storey.polygons), united(level)).area > LEAST_REPORTED:
                continue
            right[name] = storey.z
        names = [*storeys]
        for row, name in enumerate(names):
            if name in right:
                continue
            before = right[names[row - 1]]
            above = next((k for k in range(row, len(names)) if right.get(names[k], before) > before), None)
            step = 3.0 if above is None else (right[names[above]] - before) / (above - row + 1)
            z, own = right.setdefault(name, round(before + step, 3)), storeys[name].z
            text = f"storey {name!r} is at the height of another one, z = {own:g}, and lies on it"
            place = place_of(storeys[name].polygons[0])
            self.errors.append(Finding("error", text, name, place, f"storeys.{name}", f"z = {z:g}"))
            del storeys[name]

    def _make_floor(self, name: str) -> None:
        """Make the floor of a storey: join its polygons, or put walls between them."""
        storey = self.plan.storeys[name]
        if storey.file is not None:
            raise BuildingError(f"{self.plan.source}: storey {name!r}: {storey.file} has not been read")
        rooms = distinct(storey.polygons)
        if len(rooms) < len(storey.polygons):
            count = counted(len(storey.polygons) - len(rooms), "polygon is a copy", "polygons are copies")
            self._find("assumed", f"{count} of another one, and left out", name, rooms[0], f"storeys.{name}")
        one, other = shapely.STRtree(rooms).query(rooms, "intersects")
        one, other = np.array(rooms)[[one[one < other], other[one < other]]]
        is_over = ~shapely.touches(one, other)
        both = shapely.intersection(one[is_over], other[is_over], grid_size=GRID)
        if len(both) and (double := united([flat_parts(one) for one in both])).area > LEAST_AREA:
            text = f"polygons overlap on {double.area:.2f} m2 and are joined; the largest overlap is here"
            largest = max(shapely.get_parts(double), key=lambda part: part.area)
            self._find("assumed", text, name, largest, f"storeys.{name}")
        self.floors[name] = united(with_walls(rooms, storey.wall) if storey.wall else rooms)

    def _open_doors(self) -> None:
        """Open the doors of the plan in order; each meets what is near it of the rooms and of earlier doors."""
        by_storey: dict[str, list[int]] = {}
        for row, door in enumerate(self.plan.doors):
            by_storey.setdefault(door.storey, []).append(row)
        near = {row: one for name, rows in by_storey.items() for row, one in self._near_doors(name, rows).items()}
        opened: dict[int, list[BaseGeometry]] = {}  # ground of doors between rooms, which further doors may meet
        outer: dict[str, list[BaseGeometry]] = {}
        for row, door in enumerate(track("opening doors", self.plan.doors, len(self.plan.doors))):
            around, rooms, earlier, beside = near[row]
            # If rooms are on both its sides, only what is between it and them matters.
            within = [one.polygon for one in beside if one is not None] if beside else [around]
            ground = [part for other in earlier for part in opened[other] if any(map(part.intersects, within))]
            opened[row] = []
            with self._noting("doors", door):
                try:
                    if ground:
                        made, is_inner = self._open_door(door, united([rooms, *ground]))
                    else:
                        made, is_inner = self._open_door(door, rooms, beside)
                except ValueError:
                    if self._lacks_wall(door):
                        continue
                    raise
                opened[row] = made if is_inner else []
                outer.setdefault(door.storey, []).extend([] if is_inner else made)
        for name, rows in by_storey.items():
            if ground := [*(part for row in rows for part in opened[row]), *outer.get(name, ())]:
                # Ground of several doors to the outside at one place may leave slivers between them.
                self.floors[name] = _joined(self.floors[name], [united(ground)])
                whole = shapely.get_parts(self.floors[name])
                holes = [[ring for ring in one.interiors if shapely.Polygon(ring).area > LEAST_AREA] for one in whole]
                if sum(map(len, holes)) < shapely.get_num_interior_rings(whole).sum():
                    outlines = zip(shapely.get_exterior_ring(whole), holes, strict=True)
                    self.floors[name] = united([shapely.Polygon(*outline) for outline in outlines])

    def _lacks_wall(self, door: Item) -> bool:
        """Return whether a door is on a side of two rooms that touch, and tell that their storey has no wall."""
        name, ends = door.storey, door.segment
        assert ends is not None
        length = 0.9 * float(np.hypot(*(ends[1] - ends[0])))
        beside = [room for room in self.plan.storeys[name].polygons if covered(along(room, ends, SNAP), ends) > length]
        if self.plan.storeys[name].wall or len(beside) < 2:
            return False
        name = [name, *originals(self.given, name)][-1]
        text = f"storey {door.storey!r}: the rooms beside door {door.name!r} touch, and there is no wall between them"
        self.errors.append(Finding("error", text, door.storey, place_of(ends), f"storeys.{name}", "wall = 0.1"))
        return True

    def _near_doors(
        self, storey: str, rows: list[int]
    ) -> dict[int, tuple[BaseGeometry, BaseGeometry, list[int], Beside]]:
        """Return what is near each door of a storey: place, rooms, earlier doors, and ground between two rooms."""
        doors = [self.plan.doors[row] for row in rows]
        ends, reach = np.array([door.segment for door in doors]), np.array([door.reach for door in doors])
        beyond = reach + np.hypot(*(ends[:, 1] - ends[:, 0]).T) + SNAP
        around = shapely.box(*(ends.min(axis=1) - beyond[:, None]).T, *(ends.max(axis=1) + beyond[:, None]).T)
        parts = shapely.get_parts(self.floors[storey])
        found = (shapely.STRtree(others).query(around, "intersects") for others in (parts, around))
        pairs = (pair[:, np.lexsort(pair[::-1])] for pair in found)
        near, before = (np.split(at, np.searchsorted(one, np.arange(1, len(rows)))) for one, at in pairs)
        rooms = np.array([shapely.multipolygons(parts[own]) for own in near])
        both = (np.array([1.0, -1.0])[:, None] * normal(ends)[:, None]).reshape(-1, 2)
        gaps = strips(rooms.repeat(2), ends.repeat(2, axis=0), both, reach.repeat(2))
        is_between = shapely.disjoint(rooms, shapely.linestrings(ends))
        return {
            row: (
                around[k],
                rooms[k],
                [rows[other] for other in before[k].tolist() if other < k],
                gaps[2 * k : 2 * k + 2] if is_between[k] and all(gaps[2 * k : 2 * k + 2]) else None,
            )
            for k, row in enumerate(rows)
        }

    def _open_door(self, door: Item, floor: BaseGeometry, beside: Beside = None) -> tuple[list[BaseGeometry], bool]:
        """Return the ground between a door and the rooms on both its sides, and whether there are such on both."""
        assert door.segment is not None
        segment, change, found = (door.segment, "", beside) if beside else doorway(floor, door.segment, door.reach)
        if change:
            remedy = "" if door.key else f"segment = {segment.tolist()}"
            text = f"door {door.name!r} {change}"
            self._find("assumed", text, door.storey, segment, key_of("doors", door), remedy)
        ground = [side.polygon for side in found if side is not None and not side.polygon.is_empty]
        if all(found):
            z = self.plan.storeys[door.storey].z
            self.doors.append((door.name, np.column_stack([segment, [z, z]])))
            return ground, True
        if not any(found):
            raise ValueError(
                f"at least a part of {written(segment)} has no room within {door.reach:g} m on storey {door.storey!r}; "
                "move the door to a wall between two rooms, or increase reach"
            )
        if door.outside == "refuse":
            raise ValueError(
                f"{written(segment)} on storey {door.storey!r} has a room on one side only; move it, increase "
                "reach if the wall is thicker, or make it an exit"
            )
        ends = along(floor, segment, FLUSH)
        if covered(ends, segment) > 0.9 * float(np.hypot(*(segment[1] - segment[0]))):
            ground = []
        if door.outside == "exit":
            self.exits.append(replace(door, segment=segment))
        else:
            ends = _on_outline(united([floor, *ground]), segment)
            self.openings.append((door.storey, ends[0] if len(ends) else segment.ravel()))
        return ground, False

    def _add(self, storey: str, added: list[Strip]) -> None:
        """Add strips of ground to a floor."""
        parts = [part.polygon for part in added if not part.polygon.is_empty]
        if parts:
            self.floors[storey] = _joined(self.floors[storey], parts)

    def _place_lift(self, lift: LiftItem) -> list[Drawn]:
        """Part the car of a lift from the floors of its storeys by walls, open its doors, and return its rooms."""
        rooms: list[Drawn] = []
        for name in lift.storeys:
            with noting(self.errors, f"lift {lift.name!r}", f"lifts.{lift.name}", name, lift.polygon):
                check_storey(self.declared, name)
                if name not in self.floors:
                    continue
                for other in self.plan.lifts[: self.plan.lifts.index(lift)]:
                    if name in other.storeys and common(other.polygon, lift.polygon).area > 0.0:
                        raise ValueError(f"it overlaps lift {other.name!r} on storey {name!r}; move one of them")
                self.floors[name] = cut(self.floors[name], lift.polygon.buffer(LIFT_WALL, join_style="mitre"))
                doors = [piece for one in lift.doors for piece in _on_outline(lift.polygon, one).reshape(-1, 2, 2)]
                if not doors:
                    raise ValueError(f"its door {written(lift.doors[0])} is not on the outline of its polygon; move it")
                sills = [self._sill(lift, name, door) for door in doors]
                if not any(sills):
                    raise ValueError(
                        f"storey {name!r} has no floor within {DOOR_REACH:g} m of its door {written(doors[0])}; extend "
                        "the floor, or leave the storey out"
                    )
                self._add(name, [sill for sill in sills if sill is not None])
                rooms.append(((lift.tag_at(name),), lift.polygon, self.plan.storeys[name].z))
        return rooms

    def _sill(self, lift: LiftItem, storey: str, door: FloatArray) -> Strip | None:
        """Return the ground between a door of a lift and the floor before it, None if there is no floor."""
        left, middle = normal(door), door.mean(axis=0)
        way = -left if shapely.intersects_xy(lift.polygon, *(middle + BESIDE * left)) else left
        return strips(self.floors[storey], door, way[None], DOOR_REACH)[0]

    def _place_obstacle(self, item: Item) -> tuple[tuple[str, ...], BaseGeometry, float] | None:
        """Cut an obstacle out of its floor; return its surface, or None if it is not on the floor."""
        floor, storey = self.floors[item.storey], self.plan.storeys[item.storey]
        outline = united(item.polygons)
        inside = common(floor, outline)
        if inside.is_empty:
            text = f"obstacle {item.name!r} is not on the floor"
            self._find("left out", text, item.storey, outline, key_of("obstacles", item), "remove it")
            return None
        self.floors[item.storey] = cut(floor, outline)
        return (f"obstacle:{item.name}",), inside, storey.z

    def _make_stairs(self) -> None:
        """Make flights and landings, cut the floors away from them, and join them to the floors."""
        plan = self.plan
        ends: list[tuple[Stair, str, str, FloatArray, FloatArray]] = []
        for stair in (one.clear for one in plan.stairs):
            with self._noting_stair(stair):
                for storey in (stair.lower, stair.upper):
                    check_storey(self.declared, storey)
                if {stair.lower, stair.upper} <= {*plan.storeys}:
                    self.pieces[stair.name], upper, ways = self._stair_pieces(stair)
                    ends.append((stair, "lower", stair.lower, stair.lower_edge, ways[0]))
                    ends.append((stair, "upper", stair.upper, upper, ways[1]))
        for name, kind, values in plan.pieces:
            with noting(self.errors, f"stair {name!r}", f"{'landings' if kind == 'landing' else 'flights'}.{name}"):
                if kind == "flight":
                    made = stairs.flight(*values)
                elif kind == "slope":
                    made = [stairs.slope(outline) for outline in values[0]]
                else:
                    polygons, z = values
                    made = [stairs.Piece(united(polygons), z, z, z)]
                self.pieces.setdefault(name, []).extend(made)
        if plan.headroom > 0.0:
            for name, pieces in self.pieces.items():
                for storey in plan.storeys:
                    self._cut_for_headroom(name, pieces, storey)
        for stair, end, storey, edge, way in ends:
            known = len(self.errors)
            with self._noting_stair(stair):
                self._join(stair, end, storey, edge, way)
            if len(self.errors) > known:
                self.pieces.pop(stair.name, None)

    def _noting_stair(self, stair: Stair) -> AbstractContextManager[None]:
        what = f"stair {stair.name!r}"
        return noting(self.errors, what, key_of("stairs", stair), stair.lower, stair.lower_edge)

    def _stair_pieces(self, stair: Stair) -> tuple[list[stairs.Piece], FloatArray, list[FloatArray]]:
        """Return the pieces of a stair, its upper edge, and the directions from both its ends into their floors."""
        low, high = self.plan.storeys[stair.lower].z, self.plan.storeys[stair.upper].z
        if low >= high:
            raise ValueError(
                f"the lower storey {stair.lower!r} (z = {low:g}) must be below the upper one {stair.upper!r} "
                f"(z = {high:g}); swap them, or correct z"
            )
        foot, head = stair.lower_edge, stair.upper_edge
        width = float(np.hypot(*(foot[1] - foot[0])))
        depth = stair.landing
        if stair.turn is None and stair.length is None:
            assert head is not None
            pieces = stairs.straight(foot, low, head, high, depth or 0.0, stair.landings)
            way = _across(head, head.mean(axis=0) - foot.mean(axis=0))
            return pieces, head, [-_across(foot, head.mean(axis=0) - foot.mean(axis=0)), way]
        way = self._way(stair)
        assert stair.length is not None or stair.turn is not None
        if stair.length is None:
            raise ValueError("a U-shaped stair needs the length of its first flight; set length")
        if stair.turn is None and head is None:
            head = rounded(foot + stair.length * way)
            return stairs.straight(foot, low, head, high, depth or 0.0, stair.landings), head, [-way, way]
        if head is None:
            aside = np.array([-way[1], way[0]]) * (1.0 if stair.turn == "left" else -1.0)
            head = rounded(foot + (width + stair.gap) * aside)
        pieces = stairs.switchback(foot, low, head, high, way, stair.length, width if depth is None else depth)
        return pieces, head, [-way, -way]

    def _way(self, stair: Stair) -> FloatArray:
        """Return the unit vector (2,) in the direction of the first flight."""
        edge, floor = stair.lower_edge, self.floors[stair.lower]
        if stair.direction is not None:
            return _across(edge, stair.direction)
        middle, left = edge.mean(axis=0), normal(edge)
        has_floor = shapely.intersects_xy(floor, middle + BESIDE * np.stack([left, -left])).tolist()
        if has_floor[0] == has_floor[1]:
            where = "both sides" if has_floor[0] else "neither side"
            raise ValueError(
                f"its direction is ambiguous: storey {stair.lower!r} has floor on {where} of its lower edge "
                f"{written(edge)}; set direction = [x, y]"
            )
        return -left if has_floor[0] else left

    def _cut_for_headroom(self, name: str, pieces: list[stairs.Piece], storey: str) -> None:
        """Remove the part of a floor that leaves too little height above or below a stair."""
        z, floor = self.plan.storeys[storey].z, self.floors[storey]
        low = [stairs.too_low(piece, z, self.plan.headroom) for piece in pieces]
        away = [part for part in low if not part.is_empty and common(floor, part).area > LEAST_AREA]
        if away:
            self.floors[storey] = cut(floor, united(away))
            area = floor.area - self.floors[storey].area
            text = f"{area:.2f} m2 of floor cut away for {self.plan.headroom:g} m of headroom at stair {name!r}"
            keys = {stair.name: key_of("stairs", stair) for stair in self.plan.stairs}
            largest = max(away, key=lambda part: part.area)
            self._find("assumed", text, storey, largest, keys.get(name, f"flights.{name}"))

    def _join(self, stair: Stair, end: str, storey: str, edge: FloatArray, way: FloatArray) -> None:
        """Check that an end of a stair lies on the outline of its floor, and close a small gap between them."""
        what, key = f"stair {stair.name!r}", key_of("stairs", stair)
        length = float(np.hypot(*(edge[1] - edge[0])))
        beside = covered(along(self.floors[storey], edge, 2e-6), edge)
        if beside < length - LEAST_LENGTH:
            (gap,) = strips(self.floors[storey], edge, way[None], SNAP)
            if gap is not None and not gap.polygon.is_empty:
                self._add(storey, [gap])
                self._find("repaired", f"gap of {gap.depth:.3f} m at the {end} end of {what} closed", storey, edge, key)
                beside = length
            else:
                beside = covered(along(self.floors[storey], edge, LEAST_LENGTH), edge)
        if beside < LEAST_LENGTH:
            raise ValueError(
                f"its {end} edge {written(edge)} does not lie on the outline of storey {storey!r}; move the edge "
                "there, or extend the floor"
            )
        if beside < length - UNCOVERED:
            text = f"only {beside:.2f} of {length:.2f} m of the {end} edge of {what} adjoin the floor"
            self._find("warning", text, storey, edge, key)

    def _cut_exits(self) -> None:
        """Cut the polygons of exits out of the floors, with the narrow strips of floor behind them."""
        for row, item in enumerate(self.exits):
            if item.polygons:
                floor, drawn = self.floors[item.storey], united(item.polygons)
                ground = _reaching(drawn, floor)
                if ground.area > drawn.area + LEAST_AREA:
                    text = f"exit {item.name!r} moved to the outline of its floor, at most {SNAP:g} m away"
                    self._find("repaired", text, item.storey, drawn, key_of("exits", item))
                self.floors[item.storey] = cut(floor, ground)
                self.exits[row] = replace(item, polygons=(ground,))

    def _open_exit(self, item: Item) -> None:
        """Put an exit on the outline of its floor; if it is on the outer face of a wall, extend the floor to it."""
        tag, floor, segment = f"exit:{item.name}", self.floors[item.storey], item.segment
        if segment is None:
            (ground,) = item.polygons
            outer = sides(ground).reshape(-1, 2, 2)
            pieces = [piece for side in outer for piece in along(floor, side, 2e-6)]  # which it has been cut out of
            pieces = pieces or [piece for side in outer for piece in along(floor, side, SNAP)]
            own = np.empty((0, 4))
            for piece in np.unique(
                np.reshape(pieces, (-1, 4)), axis=0
            ):  # several sides may be beside one of the outline
                free = _free(piece, own)
                is_whole = segment_lengths(free).sum() > segment_lengths(piece[None])[0] - LEAST_LENGTH
                own = np.concatenate([own, piece[None] if is_whole else free])
            wide = segment_lengths(own)
            others = [one.polygons for one in self.exits if one is not item and one.storey == item.storey]
            if wide.sum() < NARROWEST and ground.dwithin(united(sum(others, ())), SNAP):
                text = f"exit {item.name!r} is left out: other exits have all but {wide.sum():.2f} m of it"
                self._find("assumed", text, item.storey, ground, key_of("exits", item), "remove it")
                return
            if not len(own):
                raise ValueError(f"its polygon shares no edge with the floor of storey {item.storey!r}; move it there")
            if wide[between_floors(floor, own, DOOR_REACH)].sum() > 0.5 * wide.sum():
                text = (
                    f"exit {item.name!r} has floor on both its sides, which both count for its width of "
                    f"{wide.sum():.2f} m; if it lies between two rooms, make it a door"
                )
                self._find("warning", text, item.storey, ground, key_of("exits", item))
            self.edges.append((tag, item.storey, own))
            return
        outline = _on_outline(floor, segment)
        length = float(np.hypot(*(segment[1] - segment[0])))
        beside = covered(outline, segment)
        if beside < 0.9 * length:
            outline = self._recess(item, segment, beside)
        elif item.outside != "exit" and between_floors(floor, outline, DOOR_REACH).any():
            raise ValueError(between_rooms(segment, item.storey))
        elif beside < length - LEAST_LENGTH:
            text = f"exit {item.name!r} is {beside:.3f} m wide instead of {length:.3f} m: walls cover the rest of it"
            remedy = "" if item.key else f"segment = {_longest(outline).tolist()}"
            self._find("warning", text, item.storey, segment, key_of("exits", item), remedy)
        self.edges.append((tag, item.storey, outline))

    def _part_exits(self) -> None:
        """Take from exits what others have, or the floor before these: too little that is left is left out."""
        parted, taken = [], dict[str, FloatArray]()
        keys = {item.name: key_of("doors" if item.outside == "exit" else "exits", item) for item in self.exits}
        for tag, storey, pieces in self.edges:
            name, others = tag.removeprefix("exit:"), taken.get(storey, np.empty((0, 4)))
            lines = [along(self.floors[storey], piece.reshape(2, 2), ON_ONE_LINE) for piece in pieces]
            free = np.concatenate([np.empty((0, 4)), *(_free(piece, others) for own in lines for piece in own)])
            width, left = (float(segment_lengths(own).sum()) for own in (pieces, free))
            is_whole = left > width - LEAST_LENGTH
            if not is_whole and left < NARROWEST:
                text = f"exit {name!r} is left out: other exits have all but {left:.2f} of its {width:.2f} m"
                self._find("assumed", text, storey, pieces[0], keys[name], "remove it")
                continue
            if not is_whole:
                text = f"exit {name!r} is {left:.2f} m wide instead of {width:.2f} m, which other exits share"
                self._find("warning", text, storey, free[0], keys[name])
            parted.append((tag, storey, pieces if is_whole else free))
            taken[storey] = np.concatenate([others, free])
        self.edges = parted

    def _recess(self, item: Item, segment: FloatArray, beside: float) -> FloatArray:
        """Extend the floor to an exit on the outer face of a wall; `beside` of its length [m] is on the outline."""
        floor, middle, left = self.floors[item.storey], segment.mean(axis=0), normal(segment)
        edge = "put both ends of the exit on its outer outline"
        if shapely.intersects_xy(floor, middle + BESIDE * np.stack([left, -left])).all():
            raise ValueError(f"{written(segment)} runs through the floor of storey {item.storey!r}; {edge}")
        beside_it = strips(floor, segment, np.outer([1.0, -1.0], left), DOOR_REACH)
        inward = [side for side in beside_it if side is not None and not side.polygon.is_empty]
        if len(inward) > 1:
            raise ValueError(between_rooms(segment, item.storey))
        if not inward:
            if beside > LEAST_LENGTH:
                longest, whole = _longest(_on_outline(floor, segment)), float(np.hypot(*(segment[1] - segment[0])))
                raise ValueError(
                    f"of {written(segment)}, only {beside:.2f} of {whole:.2f} m are on the outline of storey "
                    f"{item.storey!r}; move the exit along it, or shorten it to {written(longest)}"
                )
            raise ValueError(f"{written(segment)} does not lie on the outline of storey {item.storey!r}; {edge}")
        self._add(item.storey, inward)
        text = f"floor extended by {inward[0].depth:.2f} m to exit {item.name!r}, which is drawn outside of it"
        kind = "warning" if inward[0].depth > DEEP else "assumed"
        self._find(kind, text, item.storey, segment, key_of("exits", item))
        return segment.reshape(1, 4)

    def _ground(self) -> list[tuple[tuple[str, ...], BaseGeometry, float]]:
        """Return the floors, divided by the areas on them, with their tags."""
        surfaces = []
        for name, floor in self.floors.items():
            with noting(self.errors, f"storey {name!r}", f"storeys.{name}", name):
                if floor.is_empty:
                    raise ValueError("obstacles, stairs and exits cover all of it; move them")
            areas = {item.name: united(item.polygons) for item in self.plan.areas if item.storey == name}
            shapely.prepare(floor)
            for item in (item for item in self.plan.areas if item.storey == name and not floor.is_empty):
                with self._noting("areas", item):
                    area = areas[item.name]
                    if not floor.contains_properly(area.point_on_surface()) and common(floor, area).is_empty:
                        del areas[item.name]
                        raise ValueError(f"is not on the floor of storey {name!r}; move it there")
            if floor.is_empty:
                continue
            surfaces += [
                ((f"floor:{name}", *(f"area:{area}" for area in own)), part, self.plan.storeys[name].z)
                for own, part in _divided(floor, areas)
            ]
        return surfaces


def _divided(floor: BaseGeometry, areas: Mapping[str, BaseGeometry]) -> Iterable[tuple[tuple[str, ...], BaseGeometry]]:
    """Return the parts of a floor and the areas that each is in; only areas that overlap divide each other."""
    names, outlines = [*areas], np.array([*areas.values()], dtype=object)
    one, other = shapely.STRtree(outlines).query(outlines, "intersects")
    overlap = (one != other) & ~shapely.touches(outlines[one], outlines[other])
    shared = np.unique(one[overlap]).tolist()
    alone = np.setdiff1d(np.arange(len(names)), shared).tolist()
    parts: list[tuple[tuple[str, ...], BaseGeometry]] = [((), floor)]
    for row in shared:
        pairs = [((own, cut(at, outlines[row])), ((*own, names[row]), common(at, outlines[row]))) for own, at in parts]
        parts = [part for pair in pairs for part in pair if not part[1].is_empty]
    rest = parts[0][1]
    yield from (((names[row],), common(rest, outlines[row])) for row in alone)
    parts[0] = parts[0][0], cut(rest, united(outlines[alone])) if alone else rest
    yield from (part for part in parts if not part[1].is_empty)


def _joined(floor: BaseGeometry, ground: list[BaseGeometry]) -> BaseGeometry:
    """Return a floor with ground that touches it, if need be by moving its outline by a rounding error."""
    whole = united([floor, *ground])
    inside = shapely.STRtree(shapely.point_on_surface(shapely.get_parts(floor)))
    of_floor, _ = inside.query(shapely.get_parts(whole), "intersects")
    if len(np.unique(of_floor)) == shapely.get_num_geometries(whole):
        return whole
    return united([shapely.snap(floor, shapely.multipoints(shapely.get_coordinates(ground)), 2 * GRID), *ground])


def _across(edge: FloatArray, direction: FloatArray) -> FloatArray:
    """Return the unit normal of an edge on the side of a direction."""
    across = normal(edge)
    side = float(across @ direction)
    if abs(side) < 0.1 * float(np.hypot(*direction)):
        raise ValueError(
            f"direction [{direction[0]:g}, {direction[1]:g}] is parallel to its edge {written(edge)}; change it"
        )
    return across if side > 0.0 else -across


def _free(piece: FloatArray, others: FloatArray) -> FloatArray:
    """Return the parts (p, 4) of a segment (4,) along which none of some others (n, 4) lies."""
    taken = shapely.multilinestrings(others.reshape(-1, 2, 2)).buffer(ON_ONE_LINE, cap_style="flat")
    rest = shapely.difference(shapely.linestrings(piece.reshape(2, 2)), taken)
    ends = shapely.get_coordinates(shapely.get_parts(rest)).reshape(-1, 4)
    return rounded(ends[segment_lengths(ends) > LEAST_LENGTH])


def _on_outline(floor: BaseGeometry, segment: FloatArray) -> FloatArray:
    """Return the pieces (p, 4) of a floor's outline along a segment; only those exactly on it if they cover it."""
    exact = along(floor, segment, 2e-6)
    is_whole = covered(exact, segment) > float(np.hypot(*(segment[1] - segment[0]))) - LEAST_LENGTH
    return exact if is_whole else along(floor, segment, SNAP)


def _longest(pieces: FloatArray) -> FloatArray:
    """Return the ends (2, 2) of the longest of some pieces (p, 4)."""
    longest: FloatArray = pieces[segment_lengths(pieces).argmax()].reshape(2, 2)
    return longest


def _reaching(outside: BaseGeometry, floor: BaseGeometry) -> BaseGeometry:
    """Extend the ground of an exit, often drawn slightly inside the outline, by the narrow rim of floor behind it."""
    rest = cut(floor, outside)
    wide = rest.buffer(-SNAP / 2, join_style="mitre").buffer(SNAP / 2, join_style="mitre")
    near = outside.buffer(SNAP, join_style="mitre").buffer(LEAST_LENGTH)
    narrow = shapely.get_parts(common(cut(rest, wide), near))
    # No needles as narrow as the grid are left of them.
    touching = [part.buffer(10 * GRID, join_style="mitre") for part in narrow if part.dwithin(outside, LEAST_LENGTH)]
    return shapely.remove_repeated_points(united([outside, *touching]), 10 * GRID) if touching else outside
