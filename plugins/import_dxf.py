"""Importer of DXF drawings: one storey, on the layers of the JuPedSim convention or on other layers."""

import fnmatch
import math
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.errors import BuildingError, text_of
from evac.base.parameters import Parameter
from evac.building.geometry.overlays import place_of
from evac.building.importer import Importer, optional_library
from evac.building.plan.plan import Plan
from evac.building.recover.linework import faces_of, rooms_of
from evac.building.surface.resolution import LARGEST, SMALLEST, helpful_factor

#: Optional prefix of layer names.
PREFIX = "jps-"
#: Maximum nesting depth of blocks, and maximum number of entities after blocks are expanded.
DEEPEST, MOST_ENTITIES = 30, 500_000
#: Entity types that are read, besides blocks; texts, dimensions, hatches and images are ignored.
DRAWN = frozenset(
    ("LINE", "LWPOLYLINE", "POLYLINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE", "SOLID", "TRACE", "3DFACE"),
)
#: Minimum length of the pieces of a curve, as a share of its extent.
FINEST = 1e-4
#: Largest gap between the ends of a polyline that is treated as closed [m].
CLOSED = 1e-3
#: Values of $INSUNITS: name and length of the unit [m].
UNITS = {
    **{1: ("inch", 0.0254), 2: ("foot", 0.3048), 4: ("millimetre", 1e-3), 5: ("centimetre", 1e-2), 6: ("metre", 1.0)},
    **{7: ("kilometre", 1e3), 10: ("yard", 0.9144), 14: ("decimetre", 0.1), 21: ("US survey foot", 1200 / 3937)},
}


class DxfImporter(Importer):
    """DXF drawings (.dxf): one storey from closed outlines, or from walls drawn as lines.

    Layers are given as comma-separated names, in which * matches any text. Names are case-insensitive and may have the
    prefix `jps-`. Blocks are expanded, and curves are approximated by polygons.
    """

    name = "dxf"
    suffixes = (".dxf",)

    floor = Parameter("walkablearea", "layers with outlines of the floor, or with open lines that enclose it")
    walls = Parameter("", "layers with walls as lines, which enclose rooms")
    doors = Parameter("", "layers with lines that close doors; doors are also found where walls are interrupted")
    obstacles = Parameter("obstacles", "layers with outlines of obstacles")
    exits = Parameter("exits", "layers with exits: outlines of the ground outside, or lines")
    areas = Parameter("distributions", "layers with outlines of start areas")
    storey = Parameter("floor", "name of the storey")
    z = Parameter(0.0, "height of the storey's floor", unit="m")
    unit = Parameter(0.0, "metres per unit of the drawing; 0: as declared, if plausible", minimum=0.0)
    gap = Parameter(0.1, "ends of lines at most this far from another line are joined to it", unit="m", minimum=0.0)
    door = Parameter(2.5, "largest width of a gap in a wall that is a door; 0: none", unit="m", minimum=0.0)
    wall = Parameter(0.1, "thickness of walls drawn as one line between two rooms", unit="m", minimum=0.01)
    repair = Parameter(False, "whether to read the parts of a damaged file that ezdxf can repair")
    deviation = Parameter(0.002, "largest distance of a polygon from its curve", unit="m", above=0.0)

    def read(self, path: Path) -> Plan:
        """Read the drawing; raise ValueError if it is damaged, BuildingError if the layers of the floor are empty."""
        optional_library(path, "ezdxf", "dxf")
        document, faults = _opened(path, self.repair)
        plan = Plan(path)
        if faults:
            plan.note("warning", f"the file was damaged in {len(faults)} places and is repaired: {faults[0]}, ...")
        try:
            shapes = [shape for shape in _shapes(document) if self._use_of(shape.layer)]
        except (ArithmeticError, AttributeError, LookupError, TypeError) as error:  # damaged entities
            raise ValueError(f"an entity cannot be read: {text_of(error)}") from error
        if not any(self._use_of(shape.layer) in ("floor", "walls") for shape in shapes):
            raise BuildingError(f"{path}: {_no_floor(document)}")
        unit = self._metres(plan, document, shapes)
        drawn: dict[str, list[Drawn]] = {}
        for shape in shapes:
            for line in _drawn(shape, unit, self.deviation, CLOSED):
                drawn.setdefault(self._use_of(shape.layer), []).append(line)
        self._add_floor(plan, drawn)
        self._add_items(plan, drawn)
        return plan

    def _use_of(self, layer: str) -> str:
        """Return the use of a layer; empty if it is ignored."""
        name = layer.lower().removeprefix(PREFIX)
        for use in ("floor", "walls", "doors", "obstacles", "exits", "areas"):
            patterns = [pattern.strip().lower().removeprefix(PREFIX) for pattern in getattr(self, use).split(",")]
            if any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns if pattern):
                return use
        return ""

    def _metres(self, plan: Plan, document: Any, shapes: "list[Shape]") -> float:
        """Return the metres per unit: as declared in the drawing, or a more plausible value."""
        if self.unit:
            return float(self.unit)
        points = np.concatenate([shape.frame for shape in shapes])
        extent = float(np.ptp(points, axis=0).max())
        name, said = UNITS.get(document.header.get("$INSUNITS", 0), ("", 1.0))
        measure = f"the drawing extends over {extent:.4g} units"
        factor = helpful_factor(extent * said)
        unit = said if factor is None else said * factor
        if SMALLEST <= extent <= LARGEST and factor is not None:
            unit = 1.0
        kind = "found" if name and unit == said else "assumed"
        says = f"the unit in the file is {name}" if name else "the file has no unit"
        plan.note(kind, f"1 unit is {unit:.4g} m: {says}, and {measure}, {extent * unit:.4g} m (unit)")
        return unit

    def _add_floor(self, plan: Plan, drawn: "dict[str, list[Drawn]]") -> None:
        """Add the storey: closed outlines, faces of open lines, rooms between walls."""
        outlines = [line.polygon for line in drawn.get("floor", []) if line.is_closed]
        lines = [line.line for line in drawn.get("floor", []) if not line.is_closed]
        ground: list[BaseGeometry] = list(outlines)
        if lines:
            faces = faces_of(lines, self.gap)
            ground += faces.faces
            self._note_segments(plan, "repaired", "gap of {:.3f} m closed (gap)", faces.closed)
            self._note_loose_lines(plan, faces.loose)
        walls = [line.line for line in drawn.get("walls", [])]
        openings: list[FloatArray] = []
        if walls:
            rooms = rooms_of(walls, self.gap, self.door, self.wall, [line.line for line in drawn.get("doors", [])])
            ground += [*shapely.get_parts(rooms.floor)]
            self._note_segments(plan, "repaired", "gap of {:.3f} m in walls closed (gap)", rooms.closed)
            self._note_segments(plan, "found", "door {:.2f} m wide", rooms.doors)
            self._note_segments(plan, "found", "opening to the outside {:.2f} m wide", rooms.openings)
            self._note_loose_lines(plan, rooms.loose)
            for face in rooms.left_out:
                plan.note(
                    "left out", f"{face.area:.2f} m2 between walls, too small for a room", self.storey, place_of(face)
                )
            text = f"walls drawn as one line between two rooms are {self.wall:g} m thick (wall)"
            plan.note("assumed", text, self.storey)
            openings = [*rooms.openings.reshape(-1, 2, 2)]
        if not ground:
            place = shapely.get_coordinates([*lines, *walls])[0]
            raise ValueError(
                f"the lines of the floor enclose nothing, for example at ({place[0]:.2f}, {place[1]:.2f}): close "
                "them, or set gap to the widest gap between their ends [m]"
            )
        plan.storey(self.storey, ground, self.z)
        plan.note("found", f"{len(plan.storeys[self.storey].polygons)} polygons of ground", self.storey)
        for ends in openings:
            plan.opening(self.storey, ends)

    def _add_items(self, plan: Plan, drawn: "dict[str, list[Drawn]]") -> None:
        """Add obstacles, exits and areas."""
        for use, word in (("obstacles", "obstacle"), ("exits", "exit"), ("areas", "area")):
            for number, item in enumerate(drawn.get(use, []), start=1):
                name, place = f"{word} {number}", place_of(item.line)
                corners = shapely.get_coordinates(item.line)
                if item.is_closed and item.polygon.area > 0.0 and word == "exit":
                    plan.exit(name, self.storey, polygon=item.polygon)
                elif item.is_closed and item.polygon.area > 0.0:
                    getattr(plan, word)(name, self.storey, item.polygon)
                elif word == "exit" and len(corners) == 2 and item.line.length > CLOSED:
                    plan.exit(name, self.storey, corners)
                else:
                    plan.note("left out", f"{word} {number}: the outline is not closed", self.storey, place)
                    continue
                plan.note("found", f"{name!r} on layer {item.layer!r}", self.storey, place)

    def _note_segments(self, plan: Plan, kind: str, text: str, ends: FloatArray) -> None:
        """Add a finding for each segment (n, 4), with its length."""
        for x1, y1, x2, y2 in ends.tolist():
            plan.note(kind, text.format(math.hypot(x2 - x1, y2 - y1)), self.storey, ((x1 + x2) / 2, (y1 + y2) / 2))

    def _note_loose_lines(self, plan: Plan, lines: list[BaseGeometry]) -> None:
        for line in lines:
            text = f"a line of {line.length:.2f} m encloses nothing; a larger gap may close it"
            plan.note("left out", text, self.storey, place_of(line))


@dataclass(frozen=True)
class Shape:
    """A path of the drawing: its layer, ezdxf's path, and its control points (n, 2) [units of the drawing]."""

    layer: str
    path: Any
    frame: FloatArray


@dataclass(frozen=True)
class Drawn:
    """A line of the drawing in metres, closed or not."""

    layer: str
    line: BaseGeometry
    is_closed: bool

    @property
    def polygon(self) -> BaseGeometry:
        """The polygon enclosed by a closed line."""
        return shapely.Polygon(self.line.coords)


def _opened(path: Path, repair: bool) -> tuple[Any, list[str]]:
    """Return the document of a file, and the faults that ezdxf repaired if this is permitted."""
    import ezdxf
    from ezdxf import recover

    tail = path.read_bytes()[-1000:].rstrip(b"\0\r\n\t \x1a")
    if not tail.endswith(b"EOF"):
        lines = path.read_bytes().count(b"\n") + 1
        raise ValueError(f"the file is truncated: it ends at line {lines} without EOF")
    try:
        return ezdxf.readfile(path), []
    except Exception as first:  # ezdxf raises errors of many types for damaged files
        if not repair:
            raise ValueError(f"not a DXF file, or damaged: {text_of(first)} (repair = true repairs it)") from first
        try:
            document, auditor = recover.readfile(path)
        except Exception:
            raise ValueError(f"not a DXF file: {text_of(first)}") from first
        return document, [text_of(first), *(error.message for error in auditor.errors)]


def _shapes(document: Any) -> Iterator[Shape]:
    """Yield the paths of the model space, with blocks expanded."""
    from ezdxf.path import make_path

    for layer, entity in _entities(document.modelspace(), "", 0, [0]):
        if entity.dxftype() not in DRAWN or (entity.dxftype() == "POLYLINE" and not _is_line(entity)):
            continue
        try:
            path = make_path(entity)
            corners = [[vertex.x, vertex.y] for vertex in path.control_vertices()]
            parts = [*path.sub_paths()] if path.has_sub_paths else [path]
        except Exception as error:  # ezdxf raises errors of many types for damaged entities
            handle = entity.dxf.get("handle", "")
            text = f"{entity.dxftype()} {handle} on layer {layer!r} cannot be read: {text_of(error)}"
            raise ValueError(text) from error
        if corners and not np.isfinite(corners).all():
            raise ValueError(f"{entity.dxftype()} on layer {layer!r}: a coordinate is not finite")
        for part in parts if corners else ():
            yield Shape(layer, part, np.array(corners))


def _is_line(polyline: Any) -> bool:
    """Return whether a polyline is a line and not a mesh."""
    return bool(polyline.is_2d_polyline or polyline.is_3d_polyline)


def _entities(space: Any, outer: str, depth: int, count: list[int]) -> Iterator[tuple[str, Any]]:
    """Yield (layer, entity), with blocks expanded; layer 0 in a block is the layer of the block."""
    for entity in space:
        count[0] += 1
        if count[0] > MOST_ENTITIES or depth > DEEPEST:
            raise ValueError(
                f"more than {MOST_ENTITIES} entities, or blocks nested deeper than {DEEPEST}: explode the blocks"
            )
        layer = entity.dxf.get("layer", "0")
        layer = outer if layer == "0" and outer else layer
        if entity.dxftype() != "INSERT":
            yield layer, entity
            continue
        for part in entity.multi_insert() if entity.mcount > 1 else [entity]:
            yield from _entities(_expanded(part), layer, depth + 1, count)


def _expanded(insert: Any) -> Iterator[Any]:
    """Yield the transformed entities of a block."""
    try:
        yield from insert.virtual_entities()
    except (ArithmeticError, LookupError, TypeError, AttributeError) as error:
        x, y, _ = insert.dxf.insert
        raise ValueError(f"block {insert.dxf.name!r} at ({x:.2f}, {y:.2f}) cannot be expanded: {error}") from error


def _drawn(shape: Shape, unit: float, deviation: float, closed: float) -> Iterator[Drawn]:
    """Yield a path as a polyline in metres."""
    size = float(np.ptp(shape.frame, axis=0).max())
    distance = max(deviation / unit, FINEST * size, 1e-9)
    corners = np.array([[vertex.x, vertex.y] for vertex in shape.path.flattening(distance, segments=4)]).reshape(-1, 2)
    corners = (
        corners[np.append(True, (np.diff(corners, axis=0) != 0.0).any(axis=1))] * unit if len(corners) else corners
    )
    if len(corners) < 2:
        return
    is_closed = bool(len(corners) > 3 and np.hypot(*(corners[-1] - corners[0])) <= closed)
    if is_closed:
        corners[-1] = corners[0]
    yield Drawn(shape.layer, shapely.LineString(corners), is_closed)


def _no_floor(document: Any) -> str:
    """Return the message for an empty floor, with the layers sorted by their number of entities."""
    count = Counter(layer for layer, entity in _entities(document.modelspace(), "", 0, [0]))
    layers = ", ".join(f"{name} ({number})" for name, number in count.most_common(20)) or "none"
    return (
        "the layers of the floor are empty; set floor to the layers with outlines, or walls to the layers with walls "
        f"as lines; the layers and their numbers of entities are: {layers}"
    )


evac_interface = 3
