"""Importer of DXF drawings: one storey, on the layers of the JuPedSim convention or on other layers."""

import fnmatch
import itertools
import logging
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import NEGLIGIBLE
from evac.base.errors import BuildingError, counted, text_of
from evac.base.parameters import Parameter
from evac.building.geometry import lines_of, place_of, segment_lengths
from evac.building.importer import Importer, optional_library
from evac.building.model.findings import numbered
from evac.building.plan.plan import Plan
from evac.building.recover import drawings
from evac.building.recover.linework import THICKEST_WALL, Rooms, faces_of, reaching, rooms_of
from evac.building.surface.resolution import LARGEST, SMALLEST, helpful_factor

#: Optional prefix of layer names.
PREFIX = "jps-"
#: Maximum nesting depth of blocks, and maximum number of entities after blocks are expanded.
DEEPEST, MOST_ENTITIES = 30, 500_000
#: Entity types that are read as lines, and those that fill ground, besides blocks and multilines.
LINES = frozenset(("LINE", "LWPOLYLINE", "POLYLINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE", "HATCH"))
FILLS = frozenset(("SOLID", "TRACE", "3DFACE"))
#: Entity types with bodies or surfaces, which are not read, and told.
BODIES = frozenset(("REGION", "3DSOLID", "BODY", "SURFACE", "MESH", "POLYLINE", "ACAD_PROXY_ENTITY", "HELIX"))
#: Entity types of texts; what the name of a room begins with, its greatest length, and what is the size of one.
TEXTS = frozenset(("TEXT", "MTEXT", "ATTRIB"))
NAME, LONGEST = re.compile(r"([\d.]+[ -]+)?([^\W\d_]{3}|WC\b)"), 30
SIZE = re.compile(r"\d\s*(m2|m²|m\^2|qm|sq|ft|mm|cm|m\b|\"|'|x\s*\d)", re.IGNORECASE)
#: Minimum length of the pieces of a curve, as a share of its extent.
FINEST = 1e-4
#: Largest coordinate, beyond which GEOS may loop [units].
FURTHEST = 1e12
#: Greatest difference of the heights of faces of one floor [m or other units].
FLAT = 0.5
#: Largest gap between the ends of a polyline that is treated as closed [m].
CLOSED = 1e-3
#: Width from which a polyline is an outline; greatest width of the outline of a wall; thickness of a door's leaf [m].
THINNEST, THICKEST_OUTLINE, LEAF = 0.02, 0.9, 0.06
#: Length from which lines of windows are walls [m].
LEAST_PANE = 0.5
#: Walls of two plans this near are above each other [m], and the share that is wanted of them.
SAME_WALL, LEAST_ALIKE = 0.05, 0.3
#: Names of layers with outlines of rooms, which are read where nothing else has walls.
ROOM_LAYER = re.compile("area|room|raum|space|zone|piece|local", re.IGNORECASE)
#: Why entities are left out.
NAMED, HIDDEN = "since it or their block is named so", "since it is off or frozen"
UNNAMED = "since other layers have the floor"
STEEP = "since faces at several heights are not read; export them as .obj or .stl"
LOOSE = "a line of {:.2f} m encloses nothing; a larger gap may close it"
#: Areas of rooms that are believed [m2], and units that are tried where doors are too wide or too narrow, or where
#: lines enclose no room [m].
ROOMS = 4.0, 2000.0
DOUBTED = (1e-3, 1e-2, 0.0254, 1.0, 0.3048, 0.1)
#: Values of $INSUNITS: name and length of the unit [m].
UNITS = (
    *(("", 1.0), ("inch", 0.0254), ("foot", 0.3048), ("mile", 1609.344), ("millimetre", 1e-3), ("centimetre", 1e-2)),
    *(("metre", 1.0), ("kilometre", 1e3), ("microinch", 2.54e-8), ("mil", 2.54e-5), ("yard", 0.9144)),
    *(("angstrom", 1e-10), ("nanometre", 1e-9), ("micrometre", 1e-6), ("decimetre", 0.1), ("decametre", 10.0)),
    *(("hectometre", 100.0), ("gigametre", 1e9), ("astronomical unit", 1.496e11), ("light year", 9.461e15)),
    *(("parsec", 3.086e16), ("US survey foot", 1200 / 3937), ("US survey inch", 100 / 3937)),
    *(("US survey yard", 3600 / 3937), ("US survey mile", 6336000 / 3937)),
)


class NothingEnclosedError(ValueError):
    """Lines of a drawing enclose no room."""


class DxfImporter(Importer):
    """DXF drawings (.dxf): one storey from closed outlines, or from walls drawn as lines.

    Layers are given as comma-separated names, in which * matches any text. Names are case-insensitive and may have the
    prefix `jps-`. Blocks are expanded, and curves are approximated by polygons.
    """

    name = "dxf"
    suffixes = (".dxf",)

    floor = Parameter("walkablearea", "layers with outlines of the floor, or with open lines that enclose it")
    walls = Parameter("", "layers with walls; if neither these nor `floor` exist, by name, else by spacing of lines")
    doors = Parameter("", "layers with lines that close doors, besides arcs and interruptions of walls")
    obstacles = Parameter("obstacles", "layers with outlines of obstacles")
    exits = Parameter("exits", "layers with exits: outlines of the ground outside, or lines")
    areas = Parameter("distributions", "layers with outlines of start areas")
    storey = Parameter("floor", "name of the storey")
    z = Parameter(0.0, "height of the storey's floor", unit="m")
    plan = Parameter("", "numbers of the plans of a drawing with several, which become storeys; empty: all")
    height = Parameter(3.0, "height between plans of one drawing", unit="m", above=0.0)
    unit = Parameter(0.0, "metres per unit of the drawing; 0: as declared, if plausible", minimum=0.0)
    gap = Parameter(0.1, "ends of lines up to this distance from another line are joined to it", unit="m", minimum=0.0)
    door = Parameter(2.5, "greatest width of a gap in a wall that is taken as a door; 0: none", unit="m", minimum=0.0)
    wall = Parameter(0.1, "thickness of walls drawn as one line between two rooms", unit="m", minimum=0.01)
    repair = Parameter(False, "whether to read the parts of a damaged file that ezdxf can repair")
    deviation = Parameter(0.002, "greatest distance of a polygon from its curve", unit="m", above=0.0)

    def read(self, path: Path) -> Plan:
        """Read the drawing; raise ValueError if it is damaged, BuildingError if it has neither floor nor walls."""
        optional_library(path, "ezdxf", "dxf")
        document, faults = _opened(path, self.repair)
        plan = Plan(path)
        if faults:
            plan.note("warning", f"the file was damaged in {len(faults)} places and is repaired: {faults[0]}, ...")
        missing = [block.name for block in document.blocks if block.block is not None and block.block.is_xref]
        if missing:
            plan.note("warning", f"{', '.join(missing)}: drawn in other files (xref), which are not read; bind them")
        left_out: Counter[tuple[str, str]] = Counter()
        texts = list[Drawn]()
        try:
            shapes = [*self._shapes(document, left_out, texts)]
        except (ArithmeticError, AttributeError, LookupError, TypeError) as error:  # damaged entities
            raise ValueError(f"an entity cannot be read: {text_of(error)}") from error
        rooms = sorted({layer for layer, why in left_out if why == NAMED and ROOM_LAYER.search(layer)})
        if rooms and not self.walls and all(shape.use in ("doors", "areas") for shape in shapes):
            plan = DxfImporter(**{**self.values(), "walls": ",".join(rooms)}).read(path)
            text = "outlines of rooms, which are read as their walls, since no layer has walls or a floor (walls)"
            plan.note("assumed", f"layers {', '.join(map(repr, rooms))}: {text}")
            return plan
        has_floor = any(shape.use == "floor" for shape in shapes)
        if has_floor:
            left_out.update((one.layer, UNNAMED) for one in shapes if not self._given_use(one.layer))
            shapes = [shape for shape in shapes if self._given_use(shape.layer)]
        for (layer, why), number in sorted(left_out.items()):
            text = f"layer {layer!r}: {counted(number, 'entity', 'entities')} left out, {why}"
            plan.note("left out", text, element=f"layer {layer!r}", number=number)
        if not shapes:
            lost = "".join(f"; layer {layer!r} is left out, {why}" for layer, why in sorted(left_out)[:3])
            raise BuildingError(f"{path}: {_no_floor(document)}{lost}")
        arcs = [shape for shape in shapes if shape.is_curve and shape.use != "stairs"]
        arcs = [shape for shape in arcs if shape.use == "doors"] or arcs
        swings = [swing for shape in arcs if (swing := drawings.swing_of(_corners(shape, 0.0))) is not None]
        radii = np.array([swing.radius for swing in swings])
        unit = self._metres(plan, document, shapes, radii)
        try:
            return self._planned(plan, document, shapes, texts, unit, has_floor, left_out)
        except NothingEnclosedError:
            for other in () if self.unit or drawings.unit_of(radii, [unit]) else DOUBTED:
                again = Plan(path)
                again.findings = [one for one in plan.findings if not one.text.startswith("1 unit is")]
                with suppress(ValueError, BuildingError):
                    found = self._planned(again, document, shapes, texts, other, has_floor, left_out)
                    grounds = [one.polygons for one in found.storeys.values()] + [one.polygons for one in found.rooms]
                    areas = shapely.area(list(itertools.chain(*grounds)))
                    if other != unit and ROOMS[0] <= (area := float(np.median(areas))) <= ROOMS[1]:
                        text = f"1 unit is {other:.4g} m: with {unit:.4g} m, the lines enclose no room, and now half"
                        found.note("assumed", f"{text} of the parts of the ground have {area:.1f} m2 or more (unit)")
                        return found
            raise

    def _planned(
        self,
        plan: Plan,
        document: Any,
        shapes: "list[Shape]",
        texts: "list[Drawn]",
        unit: float,
        has_floor: bool,
        left_out: Counter[tuple[str, str]],
    ) -> Plan:
        """Return the plan with the storeys of the paths and texts, of a unit [m]."""
        path = plan.source
        drawn = [line for shape in shapes for line in _drawn(shape, unit, self.deviation, CLOSED)]
        if not has_floor and not any(one.use == "walls" for one in drawn):
            drawn = _with_walls(plan, drawn)
        without = Counter(layer for layer, _ in left_out.elements())
        for (layer, use), number in sorted(Counter((one.layer, one.use) for one in drawn).items()):
            element = f"layer {layer!r}"
            text = f"{element}: {counted(number, 'line')} taken as {use or 'nothing'}"
            plan.note("found", text, element=element, number=number + without.pop(layer, 0))
            if not use:
                plan.note("left out", f"{text}, since its name is not known", element=element, number=number)
        if has_floor:
            self._add_floor(plan, drawn)
            self._add_items(plan, drawn, self.storey)
        elif not any(one.use == "walls" for one in drawn):
            raise BuildingError(f"{path}: {_no_floor(document)}")
        else:
            drawn += [replace(one, line=shapely.transform(one.line, lambda xy: unit * xy)) for one in texts]
            self._add_plans(plan, drawn)
        others = len(texts) - sum(one.number for one in plan.findings if one.element == "text")
        if others:
            text = f"{counted(others, 'text')} that {'names' if others == 1 else 'name'} no room"
            for kind in ("found", "left out"):
                plan.note(kind, text, element="text", number=others)
        return plan

    def _shapes(self, document: Any, left_out: Counter[tuple[str, str]], texts: "list[Drawn]") -> "Iterator[Shape]":
        """Yield the paths of the model space, with blocks expanded; count what is left out by layers and reasons.

        Texts are added to a list, in units of the drawing.
        """
        from ezdxf.path import from_vertices

        hidden = {one.dxf.name for one in document.layers if one.is_off() or one.is_frozen()}
        fills: dict[tuple[str, str], list[BaseGeometry]] = {}
        heights = set[float]()
        for layer, names, entity in _entities(document.modelspace(), (), 0, [0]):
            kind = entity.dxftype()
            is_line = kind in LINES and (kind != "POLYLINE" or entity.is_2d_polyline or entity.is_3d_polyline)
            use = self._use_of(layer, names)
            if kind in TEXTS and layer not in hidden:
                texts.append(_text(layer, entity))
            why = HIDDEN if layer in hidden and not self._given_use(layer) else NAMED if use == "left out" else ""
            if kind in BODIES and not is_line:
                why = why or f"since {kind} is not read; explode them"
            if why and (is_line or kind in FILLS | BODIES):
                left_out[layer, why] += 1
            if why or not (is_line or kind in FILLS):
                continue
            try:
                paths = [(path, _frame(path)) for path in _paths(entity)]
                ground = shapely.Polygon(paths[0][1]) if kind in FILLS and len(paths[0][1]) > 2 else None
                if ground is not None and ground.area > 0.0:
                    fills.setdefault((layer, use), []).append(shapely.make_valid(ground))
                    heights.update(vertex.z for vertex in paths[0][0].control_vertices() if use != "walls")
                    continue
                rings = [shapely.Polygon(frame) for _, frame in paths if len(frame) > 3 and kind == "HATCH"]
                is_fill = kind == "HATCH" and (len(paths) == 1 or not all(ring.is_valid for ring in rings))
                width = _width(entity)
                for path, frame in paths:
                    if len(frame):
                        yield Shape(layer, use, path, frame, path.has_curves, is_fill, width)
            except Exception as error:  # ezdxf raises errors of many types for damaged entities
                handle = entity.dxf.get("handle", "")
                text = f"{kind} {handle} on layer {layer!r} cannot be read: {text_of(error)}"
                raise ValueError(text) from error
        if heights and max(heights) - min(heights) > FLAT:
            left_out.update((layer, STEEP) for (layer, use), parts in fills.items() for _ in parts if use != "walls")
            fills = {key: parts for key, parts in fills.items() if key[1] == "walls"}
        for (layer, use), parts in fills.items():
            for ring in shapely.get_rings(shapely.get_parts(shapely.union_all(parts))):
                path = from_vertices(ring.coords)
                yield Shape(layer, use, path, _frame(path), False, False, 0.0)

    def _use_of(self, layer: str, blocks: tuple[str, ...]) -> str:
        """Return the use of a line, by the options or by likeness of the names of its layer and of the blocks."""
        given = self._given_use(layer)
        if given:
            return given
        use, around = drawings.use_of(layer), [drawings.use_of(name) for name in blocks]
        if "left out" in (use, *(around if not use else ())):
            return "left out"
        use = "windows" if "windows" in around else use or next((one for one in around if one), "")
        return "" if use == "walls" and self.walls else use

    def _given_use(self, layer: str) -> str:
        """Return the use of a layer by the options; empty if none names it."""
        name = layer.lower().removeprefix(PREFIX)
        for use in ("floor", "walls", "doors", "obstacles", "exits", "areas"):
            patterns = [pattern.strip().lower().removeprefix(PREFIX) for pattern in getattr(self, use).split(",")]
            if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns if pattern):
                return use
        return ""

    def _metres(self, plan: Plan, document: Any, shapes: "list[Shape]", radii: FloatArray) -> float:
        """Return the metres per unit: as declared, or as radii of doors have it, or a more plausible value."""
        if self.unit:
            return float(self.unit)
        points = np.concatenate([shape.frame for shape in shapes])
        extent = float(np.ptp(points, axis=0).max())
        code = document.header.get("$INSUNITS", 0)
        name, said = UNITS[code if 0 <= code < len(UNITS) else 0]
        measure = f"the drawing extends over {extent:.4g} units"
        factor = helpful_factor(extent * said)
        unit = said if factor is None else said * factor
        if SMALLEST <= extent <= LARGEST and factor is not None:
            unit = 1.0
        by_doors = drawings.unit_of(radii, [unit, *DOUBTED])
        if by_doors is not None and by_doors != unit:
            unit = by_doors
            radius = float(np.median(radii))
            measure += f"; doors of {radius:.4g} units are then {radius * unit:.2f} m wide"
        kind = "found" if name and unit == said else "assumed"
        says = f"the unit in the file is {name}" if name else "the file has no unit"
        plan.note(kind, f"1 unit is {unit:.4g} m: {says}, and {measure}, {extent * unit:.4g} m (unit)")
        return unit

    def _add_floor(self, plan: Plan, drawn: "list[Drawn]") -> None:
        """Add the storey of a drawing with outlines of the floor: closed ones, and faces of open lines."""
        floor = [one for one in drawn if one.use == "floor"]
        lines = [one.line for one in floor if not one.is_closed]
        ground: list[BaseGeometry] = [shapely.Polygon(one.line.coords) for one in floor if one.is_closed]
        if lines:
            faces = faces_of(lines, self.gap)
            ground += faces.faces
            self._note_segments(plan, self.storey, "repaired", "gap of {:.3f} m closed (gap)", faces.closed)
            self._note_segments(plan, self.storey, "left out", LOOSE, faces.loose)
        self._add_storey(plan, self.storey, ground, self.z, lines)

    def _add_plans(self, plan: Plan, drawn: "list[Drawn]") -> None:
        """Add a storey for each plan of a drawing, from its walls."""
        built = [one for one in drawn if one.use in ("walls", "windows", "doors")]
        grounds = drawings.plans_of([one.line for one in built])
        owned = [[one for one in drawn if one.line.intersects(ground)] for ground in grounds]
        area = shapely.union_all(grounds)
        shapely.prepare(area)
        few = [one for one in built if not area.intersects(one.line)]
        text = f"lines apart from the plans, with less than {drawings.LEAST_PLAN:.0%} of the walls of the largest one"
        lost = self._rooms_in(few)[0] if any(one.use == "doors" for one in few) else None
        is_lost = lost is not None and lost.floor.area > NEGLIGIBLE * area.area
        _note_lines(plan, "missing" if is_lost else "left out", few, text, area)
        if len(grounds) > 1:
            rooms = [self._rooms_in(own)[0] for own in owned]
            closed = [row for row, one in enumerate(rooms) if one is not None and not one.floor.is_empty]
            for row in {*range(len(grounds))} - {*closed} if closed else ():
                x1, y1, x2, y2 = grounds[row].buffer(-drawings.APART / 2).bounds
                text = f"lines on {x2 - x1:.1f} x {y2 - y1:.1f} m apart from the others enclose no room"
                is_storey = any(one.use in ("doors", "stairs") for one in owned[row])
                kind, more = ("missing", "; close its walls") if is_storey else ("left out", "")
                _note_lines(plan, kind, owned[row], text + more, grounds[row])
            grounds, owned = ([given[row] for row in closed or range(len(rooms))] for given in (grounds, owned))
        numbers = [*range(1, len(grounds) + 1)]
        if self.plan:
            words = re.split(r"\s*,\s*", self.plan.strip())
            chosen = [int(word) for word in words if word.isdecimal()]
            if len(words) > len({*chosen} & {*numbers}):
                raise ValueError(f"plan = {self.plan!r}: the drawing has {len(grounds)} plans; give numbers, as in 1,2")
            numbers = chosen
        if len(grounds) > 1:
            text = f"{'those chosen' if self.plan else 'all'} are storeys, the lowest first (plan)"
            plan.note("assumed", f"{len(grounds)} plans, numbered from the left and the top; {text}")
        storeys: dict[str, list[Drawn]] = {}
        for index, number in enumerate(numbers):
            own = owned[number - 1]
            name = self.storey if len(numbers) == 1 else f"{self.storey} {number}"
            if storeys:
                move, share = _move_above([*storeys.values()][-1], own)
                own = [replace(one, line=shapely.transform(one.line, lambda xy, move=move: xy + move)) for one in own]
                text = f"moved by ({move[0]:.2f}, {move[1]:.2f}) above the plan before it, on whose walls {share:.0%}"
                kind = "assumed" if share > LEAST_ALIKE else "warning"
                plan.note(kind, f"{text} of its walls then are", name)
            storeys[name] = own
            self._add_plan(plan, own, name, self.z + index * self.height)
            self._add_items(plan, own, name)
        _add_stairs(plan, storeys)

    def _rooms_in(
        self, drawn: "list[Drawn]"
    ) -> "tuple[Rooms | None, list[BaseGeometry], list[tuple[Drawn, drawings.Swing]]]":
        """Return the rooms between walls and doors, None without walls, lines of walls, and arcs that are no doors."""
        walls = [one for one in drawn if one.use == "walls" and (one.is_solid or not one.is_fill)]
        arcs = [one for one in drawn if one.is_curve and one.use not in ("windows", "stairs")]
        arcs = [arc for arc in arcs if arc.use == "doors"] or arcs
        swung = [
            (arc, swing) for arc in arcs if (swing := drawings.swing_of(shapely.get_coordinates(arc.line))) is not None
        ]
        swings = [swing for _, swing in swung]
        panes = [one for one in drawn if one.use == "windows"]
        leaves = [side for one in drawn if not one.is_curve and one.use != "stairs" for side in one.sides]
        small = {id(arc) for arc, swing in swung if swing.radius <= drawings.LARGEST_SWING}
        doors, swings = drawings.doors_of(
            swings, [one.line for one in (*walls, *panes) if id(one) not in small], leaves
        )
        hung = [id(swing.ends) for swing in swings]
        lost = [(arc, swing) for arc, swing in swung if arc.use == "doors" and id(swing.ends) not in hung]
        treads = [flight.ground.buffer(CLOSED) for flight in _flights_in(drawn)]
        swept = shapely.union_all([*(swing.sector.buffer(LEAF) for swing in swings), *treads])
        shapely.prepare(swept)
        lines = [wall.line for wall in walls if not swept.covers(wall.line)]
        long = [side for pane in panes for side in pane.sides if side.length >= LEAST_PANE and not swept.covers(side)]
        lines += [*shapely.linestrings(reaching(shapely.get_coordinates(long), lines).reshape(-1, 2, 2))]
        others = [side for one in drawn if one.use == "doors" and not one.is_curve for side in one.sides]
        if self.doors:
            doors = np.concatenate([doors, shapely.get_coordinates(others).reshape(-1, 4)])
            others = []
        others = [side for side in others if not swept.covers(side)]
        solids = [wall.polygon for wall in walls if wall.is_solid]
        rooms = rooms_of(lines, self.gap, self.door, self.wall, doors, others, solids) if lines else None
        return rooms, lines, lost

    def _add_plan(self, plan: Plan, drawn: "list[Drawn]", storey: str, z: float) -> None:
        """Add one storey from walls and doors."""
        rooms, lines, lost = self._rooms_in(drawn)
        floor = shapely.Polygon() if rooms is None else rooms.floor
        for arc, swing in lost:
            text = f"an arc on {arc.layer!r} with a radius of {swing.radius:.2f} m"
            is_inside = swing.sector.intersection(floor).area > 0.5 * swing.sector.area
            if is_inside or not drawings.RADII[0] <= swing.radius <= drawings.RADII[1]:
                kind, text = "left out", f"{text} is at no wall" if is_inside else f"{text} is no door"
            else:
                kind, text = "missing", f"{text} is a door at no wall: move it there, or to a layer for something else"
            plan.note(kind, text, storey, place_of(arc.line), element=f"layer {arc.layer!r}")
        if rooms is None or rooms.floor.is_empty:
            self._add_storey(plan, storey, [], z, lines or [one.line for one in drawn])
            return
        self._note_segments(plan, storey, "repaired", "gap of {:.3f} m in walls closed (gap)", rooms.closed)
        for where, found in (("between rooms", rooms.between), ("to the outside", rooms.openings)):
            self._note_segments(plan, storey, "found", f"opening {where} {{:.2f}} m wide", found)
        self._note_segments(plan, storey, "left out", LOOSE, rooms.loose)
        for face in rooms.left_out:
            text = f"{face.area:.2f} m2 between walls, too small for a room"
            plan.note("left out", text, storey, place_of(face))
        plan.note("assumed", f"walls drawn as one line between two rooms are {self.wall:g} m thick (wall)", storey)
        outlines = shapely.get_parts(shapely.get_exterior_ring(shapely.get_parts(rooms.floor)))
        first, *others = drawings.plans_of([*lines, *outlines], THICKEST_WALL)
        for other in others:
            text = f"a plan {other.distance(first) + THICKEST_WALL:.1f} m from another one that nothing joins"
            remedy = f"if it is another storey, move it in the drawing to more than {drawings.APART:g} m from the other"
            plan.note("warning", f"{text} is on the same storey; {remedy}", storey, place_of(other))
        self._add_rooms(plan, storey, rooms, z, drawn)
        for number, ends in enumerate(rooms.doors.reshape(-1, 2, 2), start=1):
            plan.door(f"{self._prefix(storey)}door {number}", storey, ends)
        outside = "exit" if z == self.z and not any(one.use == "exits" for one in drawn) else "opening"
        for number, ends in enumerate(rooms.outer.reshape(-1, 2, 2), start=1):
            plan.door(f"{self._prefix(storey)}exit door {number}", storey, ends, outside=outside)
        for ends in rooms.openings.reshape(-1, 2, 2):
            plan.opening(storey, ends)

    def _add_rooms(self, plan: Plan, storey: str, rooms: Rooms, z: float, drawn: "list[Drawn]") -> None:
        """Add the ground of a storey, as rooms if names are written in any of them: the largest, nearest its middle."""
        between = np.concatenate([rooms.doors.reshape(-1, 4), rooms.between.reshape(-1, 4)])
        ends = between.reshape(-1, 2, 2)
        beyond = CLOSED * (ends[:, 1:] - ends[:, :1]) / segment_lengths(between)[:, None, None]
        lines = shapely.linestrings(ends + np.concatenate([-beyond, beyond], axis=1))
        ground = shapely.get_parts(shapely.polygonize([shapely.union_all([rooms.floor.boundary, *lines])]))
        shapely.prepare(rooms.floor)
        ground = ground[shapely.contains(rooms.floor, shapely.point_on_surface(ground))]
        texts, names = [one for one in drawn if one.text], [""] * len(ground)
        points = np.array([one.line for one in texts], dtype=object)
        room, text = shapely.STRtree(points).query(ground, "covers")
        away = shapely.distance(points[text], shapely.centroid(ground[room]))
        for row in np.lexsort((-away, np.array([one.size for one in texts])[text])):
            names[room[row]] = texts[text[row]].text
        if not any(names):
            self._add_storey(plan, storey, [*shapely.get_parts(rooms.floor)], z, [])
            return
        plan.storey(storey, None, z)
        use = None if any(one.use == "areas" for one in drawn) else "room"
        for number, (part, name) in enumerate(zip(ground, names, strict=True), start=1):
            taken = {one.name for one in plan.rooms}
            plan.room(numbered(name or f"{self._prefix(storey)}room {number}", taken), storey, part, use=use)
        number = sum(map(bool, names))
        plan.note("found", f"names of {number} of {len(ground)} rooms", storey, element="text", number=number)

    def _prefix(self, storey: str) -> str:
        """Return what names of items begin with on one of several storeys."""
        return "" if storey == self.storey else f"{storey} "

    def _add_storey(
        self, plan: Plan, storey: str, ground: list[BaseGeometry], z: float, lines: list[BaseGeometry]
    ) -> None:
        if not ground:
            place = shapely.get_coordinates(lines)[0]
            raise NothingEnclosedError(
                f"the lines of the floor enclose nothing, for example at ({place[0]:.2f}, {place[1]:.2f}): close "
                "them, or set gap to the widest gap between their ends [m]"
            )
        plan.storey(storey, ground, z)
        plan.note("found", f"{len(plan.storeys[storey].polygons)} polygons of ground", storey)

    def _add_items(self, plan: Plan, drawn: "list[Drawn]", storey: str) -> None:
        """Add obstacles, exits and areas."""
        for use, word in (("obstacles", "obstacle"), ("exits", "exit"), ("areas", "area")):
            for number, item in enumerate((one for one in drawn if one.use == use), start=1):
                name = f"{self._prefix(storey)}{word} {number}"
                place = place_of(item.line)
                corners = shapely.get_coordinates(item.line)
                if item.is_closed and item.polygon.area > 0.0 and word == "exit":
                    plan.exit(name, storey, polygon=item.polygon)
                elif item.is_closed and item.polygon.area > 0.0:
                    getattr(plan, word)(name, storey, item.polygon)
                elif word == "exit" and len(corners) == 2 and item.line.length > CLOSED:
                    plan.exit(name, storey, corners)
                else:
                    kind, element = "left out" if word == "obstacle" else "missing", f"layer {item.layer!r}"
                    text = f"{word} {number}: the outline is not closed; close it in the drawing"
                    plan.note(kind, text, storey, place, element=element)
                    continue
                plan.note("found", f"{name!r} on layer {item.layer!r}", storey, place)

    def _note_segments(self, plan: Plan, storey: str, kind: str, text: str, ends: FloatArray) -> None:
        """Add a finding for each segment (n, 4), with its length."""
        for one, far in zip(ends, segment_lengths(ends).tolist(), strict=True):
            plan.note(kind, text.format(far), storey, place_of(one))


@dataclass(frozen=True)
class Shape:
    """A piece of a path of the drawing, straight or curved.

    Its layer, its use by likeness of names, ezdxf's path, its control points (n, 2) and its width [units].
    """

    layer: str
    use: str
    path: Any
    frame: FloatArray
    is_curve: bool
    is_fill: bool
    width: float


@dataclass(frozen=True)
class Drawn:
    """A line of the drawing in metres."""

    layer: str
    use: str
    line: BaseGeometry
    is_closed: bool
    is_curve: bool
    is_fill: bool  # a hatch, whose outline is a wall only if it is narrow
    text: str = ""  # of a text, what may be the name of a room
    size: float = 0.0  # height of its letters [units]

    @property
    def polygon(self) -> BaseGeometry:
        """The polygon enclosed by a closed line."""
        return shapely.make_valid(shapely.Polygon(self.line.coords), method="structure", keep_collapsed=False)

    @property
    def is_solid(self) -> bool:
        """Whether it is the outline of a wall or a column."""
        return self.is_closed and self.polygon.buffer(-THICKEST_OUTLINE / 2).is_empty

    @property
    def sides(self) -> list[BaseGeometry]:
        """Its lines of two points."""
        return lines_of(self.line)


def _note_lines(plan: Plan, kind: str, lines: Sequence[Drawn], text: str, ground: BaseGeometry) -> None:
    """Add a finding on lines, for each of their layers, at the ground around them, or else at one of them."""
    for layer, number in Counter(one.layer for one in lines).items():
        line = next(one.line for one in lines if one.layer == layer)
        place = place_of(ground if ground.intersects(line) else line)
        plan.note(kind, text, place=place, element=f"layer {layer!r}", number=number)


def _with_walls(plan: Plan, drawn: list[Drawn]) -> list[Drawn]:
    """Return lines of a drawing whose layers are not named like walls with the walls found by the spacing of lines."""
    unknown: dict[str, list[BaseGeometry]] = {}
    for one in drawn:
        if not one.use and not one.is_curve:
            unknown.setdefault(one.layer, []).extend(one.sides)
    walls = drawings.walls_by_spacing(unknown)
    for layer, why in walls.items():
        plan.note("assumed", f"layer {layer!r}: {why} (walls)")
    return [replace(one, use="walls") if not one.use and one.layer in walls else one for one in drawn]


def _move_above(lower: Sequence[Drawn], upper: Sequence[Drawn]) -> tuple[FloatArray, float]:
    """Return the move (2,) of a plan that brings most of its walls onto those of another one, and their share."""
    below, own = ([one.line for one in drawn if one.use == "walls"] for drawn in (lower, upper))
    ground = shapely.union_all(shapely.buffer(below, SAME_WALL))
    shapely.prepare(ground)
    points = shapely.get_coordinates([side.centroid for line in own for side in lines_of(line)])
    boxes = [shapely.minimum_rotated_rectangle(shapely.union_all(lines)) for lines in (below, own)]
    corners, others = (shapely.get_coordinates(box)[:4] for box in boxes)
    moves = (corners[:, None] - others[None]).reshape(-1, 2)
    shares = [float(shapely.contains_xy(ground, points + move).mean()) for move in moves]
    best = int(np.argmax(shares))
    return np.round(moves[best], 6), shares[best]


def _flights_in(drawn: Sequence[Drawn]) -> list[drawings.DrawnFlight]:
    return drawings.flights_of([side for one in drawn if one.use not in ("windows", "doors") for side in one.sides])


def _add_stairs(plan: Plan, storeys: Mapping[str, Sequence[Drawn]]) -> None:
    """Add the stairs that are drawn in plans to the one above; propose what may be none, or does not fit."""
    drawn = {}
    for name, own in storeys.items():
        drawn[name] = drawings.stairs_of(_flights_in(own), [one.line for one in own if one.use == "walls"])
    added: dict[str, tuple[drawings.DrawnStair, str, str]] = {}
    for lower, upper in itertools.zip_longest(storeys, [*storeys][1:]):
        below = [stair for stair, _, top in added.values() if top == lower]
        for stair in drawn[lower]:
            x, y = stair.foot.mean(axis=0).tolist()
            text = f"the lines of a stair {stair.width:.2f} m wide, which begins at ({x:.2f}, {y:.2f})"
            if upper is None:
                if not stair.is_among(below):
                    plan.note("left out", f"{text}, with no plan above it", lower, place_of(stair.ground))
                continue
            is_named = any(one.use == "stairs" and one.line.intersects(stair.ground) for one in storeys[lower])
            if is_named or stair.is_directed or stair.is_among([*below, *drawn[upper]]):
                added[f"stair {len(added) + 1}"] = stair, lower, upper
                continue
            _propose(plan, stair, lower, upper, "warning", f"{text}, is left out, since it may be none")
    adding = {
        name: partial(plan.stair, name, lower, stair.foot, upper, stair.head, **stair.turn)
        for name, (stair, lower, upper) in added.items()
    }
    faults = drawings.add_fitting(plan, adding)
    for name, (stair, lower, upper) in added.items():
        place = place_of(stair.ground)
        if name in faults:
            _propose(plan, stair, lower, upper, "missing", f"a stair {stair.width:.2f} m wide: {faults[name]}")
        elif stair.is_directed:
            plan.note("found", f"{name!r} to {upper!r}, {stair.width:.2f} m wide", lower, place)
        else:
            text = f"{name!r} to {upper!r}, {stair.width:.2f} m wide, ascends as written, since no arrow says how"
            plan.note("assumed", text, lower, place)


def _propose(plan: Plan, stair: drawings.DrawnStair, lower: str, upper: str, kind: str, text: str) -> None:
    """Write a stair with marks of a comment into the plan."""
    name = f"drawn stair {len(plan.proposals) + 1}"
    more = f"to add it, remove the marks # of {name!r} at the end of building.plan.toml"
    plan.note(kind, f"{text}; {more}", lower, place_of(stair.ground))
    keys = {"lower_edge": stair.foot, "upper_edge": stair.head, **stair.turn}
    edges = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in keys.items()}
    plan.proposals.append((plan.findings[-1], {"name": name, "lower": lower, "upper": upper} | edges))


def _opened(path: Path, repair: bool) -> tuple[Any, list[str]]:
    """Return the document of a file, and the faults that ezdxf repaired if this is permitted."""
    import ezdxf
    from ezdxf import recover

    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)  # What it repairs is told by findings alone.
    tail = path.read_bytes()[-1000:].rstrip(b"\0\r\n\t \x1a")
    if not tail.endswith(b"EOF"):
        lines = path.read_bytes().count(b"\n") + 1
        raise ValueError(f"the file is truncated: it ends at line {lines} without EOF")
    try:
        return ezdxf.readfile(path), []
    except Exception as first:  # ezdxf raises errors of many types for damaged files
        why = text_of(first)
        if not isinstance(first, ezdxf.DXFError) or "<class" in why:
            why = "a record lacks values, or has others than it must"
        if not repair:
            raise ValueError(f"not a DXF file, or damaged: {why} (repair = true repairs it)") from first
        try:
            document, auditor = recover.readfile(path)
        except Exception:
            raise ValueError(f"not a DXF file: {why}") from first
        return document, [why, *(error.message for error in auditor.errors)]


def _frame(path: Any) -> FloatArray:
    """Return the control points (n, 2) of a path; raise ValueError if they are not finite."""
    frame = np.array([[vertex.x, vertex.y] for vertex in path.control_vertices()]).reshape(-1, 2)
    if not (np.abs(frame) <= FURTHEST).all():
        raise ValueError(f"a coordinate is not finite, or larger than {FURTHEST:g}")
    return frame


def _width(entity: Any) -> float:
    """Return the width of a polyline [units], which may be given at its vertices; 0 for other entities."""
    if entity.dxftype() == "LWPOLYLINE":
        given = [width for widths in entity.get_points("se") for width in widths]
        return float(entity.dxf.get("const_width", 0.0) or np.median(given or [0.0]))
    return float(entity.dxf.get("default_start_width", 0.0)) if entity.dxftype() == "POLYLINE" else 0.0


def _paths(entity: Any) -> list[Any]:
    from ezdxf.path import from_hatch, make_path

    whole = [*from_hatch(entity)] if entity.dxftype() == "HATCH" else [make_path(entity)]
    return [part for one in whole for part in (one.sub_paths() if one.has_sub_paths else [one])]


def _entities(
    space: Any, blocks: tuple[str, ...], depth: int, count: list[int], outer: str = ""
) -> Iterator[tuple[str, tuple[str, ...], Any]]:
    """Yield (layer, blocks around it, entity); layer 0 in a block is the layer of the block."""
    for entity in space:
        count[0] += 1
        if count[0] > MOST_ENTITIES or depth > DEEPEST:
            raise ValueError(
                f"more than {MOST_ENTITIES} entities, or blocks nested deeper than {DEEPEST}: explode the blocks"
            )
        layer = entity.dxf.get("layer", "0")
        layer = outer if layer == "0" and outer else layer
        if entity.dxftype() == "INSERT":
            yield from ((layer, blocks, text) for text in entity.attribs)
            for part in entity.multi_insert() if entity.mcount > 1 else [entity]:
                yield from _entities(_expanded(part), (part.dxf.name, *blocks), depth + 1, count, layer)
            continue
        # Arcs of a thin, open polyline may be those of doors.
        has_arc = getattr(entity, "has_arc", False) and not entity.is_closed and not _width(entity)
        if entity.dxftype() == "MLINE" or has_arc:
            yield from ((layer, blocks, line) for line in entity.virtual_entities())
        else:
            yield layer, blocks, entity


def _expanded(insert: Any) -> Iterator[Any]:
    """Yield the transformed entities of a block."""
    try:
        yield from insert.virtual_entities()
    except (ArithmeticError, LookupError, TypeError, AttributeError) as error:
        x, y, _ = insert.dxf.insert
        raise ValueError(f"block {insert.dxf.name!r} at ({x:.2f}, {y:.2f}) cannot be expanded: {error}") from error


def _text(layer: str, entity: Any) -> Drawn:
    """Return a text of the drawing, with the first of its lines that may be the name of a room."""
    lines = (" ".join(line.split()) for line in entity.plain_text().splitlines())
    name = next((one for one in lines if NAME.match(one) and not SIZE.search(one) and len(one) <= LONGEST), "")
    is_one_line = entity.dxftype() != "MTEXT"
    x, y, _ = entity.ocs().to_wcs(entity.get_placement()[1]) if is_one_line else entity.dxf.insert
    size = entity.dxf.height if is_one_line else entity.dxf.char_height
    return Drawn(layer, "texts", shapely.Point(x, y), False, False, False, name, size)


def _corners(shape: Shape, distance: float) -> FloatArray:
    """Return the corners (n, 2) of a path within a distance of it [units of the drawing]."""
    least = max(distance, FINEST * float(np.ptp(shape.frame, axis=0).max()), 1e-9)
    corners = np.array([[vertex.x, vertex.y] for vertex in shape.path.flattening(least, segments=4)]).reshape(-1, 2)
    return corners[np.append(True, (np.diff(corners, axis=0) != 0.0).any(axis=1))] if len(corners) else corners


def _drawn(shape: Shape, unit: float, deviation: float, closed: float) -> Iterator[Drawn]:
    """Yield a path as a polyline in metres; a wide one as its outline."""
    corners = unit * _corners(shape, deviation / unit)
    if len(corners) < 2:
        return
    is_closed = bool(len(corners) > 3 and np.hypot(*(corners[-1] - corners[0])) <= closed)
    if is_closed:
        corners[-1] = corners[0]
    line = shapely.LineString(corners)
    if shape.width * unit > THINNEST:
        body = line.buffer(shape.width * unit / 2, cap_style="flat", join_style="mitre")
        for ring in shapely.get_rings(body):
            yield Drawn(shape.layer, shape.use, shapely.LineString(ring.coords), True, False, False)
        return
    yield Drawn(shape.layer, shape.use, line, is_closed, shape.is_curve, shape.is_fill)


def _no_floor(document: Any) -> str:
    """Return the message for an empty floor, with the layers sorted by their number of entities."""
    count = Counter(layer for layer, _, _ in _entities(document.modelspace(), (), 0, [0]))
    if not count:
        return "the model space of the drawing is empty; copy what is drawn on its layouts to the model space"
    layers = ", ".join(f"{name} ({number})" for name, number in count.most_common(20))
    return (
        "the layers of the floor are empty; set floor to the layers with outlines, or walls to the layers with walls "
        f"as lines; the layers and their numbers of entities are: {layers}"
    )
