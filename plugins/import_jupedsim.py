"""Importer of geometries of JuPedSim in XML: rooms and subrooms, crossings, transitions, obstacles and stairs."""

import xml.etree.ElementTree as Tree
from pathlib import Path

import numpy as np
import shapely

from evac.base.defaults import FARTHEST
from evac.base.parameters import Parameter
from evac.building.geometry import connected_components, enclosed, flat_parts, place_of
from evac.building.importer import Importer
from evac.building.model.findings import numbered
from evac.building.plan.plan import Plan


class JupedsimImporter(Importer):
    """Geometries of JuPedSim 0.x (.xml): subrooms are rooms, transitions to the room -1 exits, other ones doors.

    A crossing shorter than the common side of its subrooms is a door; `stair` and sloping subrooms join two floors.
    """

    name = "jupedsim"
    suffixes = (".xml",)

    wall = Parameter(0.1, "thickness of walls between rooms that touch", unit="m", above=0.0)

    def read(self, path: Path) -> Plan:
        """Read the geometry; raise ValueError if the file is none."""
        plan, joined = Plan(path), list[tuple[int, ...]]()
        shapes, z, use = dict[tuple[str, str], shapely.Geometry](), {}, {}
        try:
            root = Tree.fromstring(path.read_bytes())
            links = [(one, room.get("id", "")) for room in root.iter("room") for one in room.iter("crossing")]
            links += [(one, "") for one in root.iter("transition") if one.find("vertex") is not None]
            ways = [(f"{one.tag} {one.get('id', '')}", _joined(one, room), _line(one)) for one, room in links]
            for room in root.iter("room"):
                for one in room.iter("subroom"):
                    key = (room.get("id", ""), one.get("id", ""))
                    walls = [*map(_line, one.findall("polygon")), *(line for _, keys, line in ways if key in keys)]
                    solid = [*map(_line, one.findall(".//obstacle/polygon"))]
                    shapes[key] = flat_parts(enclosed(walls).difference(enclosed(solid)))
                    z[key] = _number(one.get("C_z") or one.get("C") or room.get("zpos"))
                    is_sloping = any(_number(one.get(name)) for name in ("A_x", "B_y"))
                    use[key] = "stair" if is_sloping else one.get("class", "room").lower()
        except (Tree.ParseError, shapely.GEOSException) as error:
            raise ValueError(f"not a geometry of JuPedSim: {str(error).rpartition('Exception: ')[2]}") from error
        known = {key for key, shape in shapes.items() if not shape.is_empty}
        for place, subroom in (shapes.keys() | {key for _, keys, _ in ways for key in keys}) - known:
            raise ValueError(f"room {place}, subroom {subroom}: missing, or its walls and doors enclose no area")
        floors = sorted(key for key in shapes if not any(kind in use[key] for kind in ("stair", "escalator")))
        if not floors:
            raise ValueError("not a geometry of JuPedSim: it has no subroom that is a floor")
        for kind in ("subroom", "obstacle", "crossing", "transition"):
            plan.note("found", f"<{kind}>", element=kind, number=len([*root.iter(kind)]))
        for height in sorted({z[key] for key in floors}):
            plan.storey(f"z {height:g}", None, height, wall=self.wall)
        for name, keys, line in (way for way in ways if way[1] and set(way[1]) <= set(floors)):
            common = shapes[keys[0]].boundary & shapes[keys[-1]].boundary
            if name.startswith("crossing") and line.buffer(self.wall).covers(common):
                joined.append(tuple(floors.index(key) for key in keys))
            else:
                (plan.exit if len(keys) == 1 else plan.door)(name, f"z {z[keys[0]]:g}", line)
        group = connected_components(len(floors), np.array(joined, dtype=int).reshape(-1, 2))
        for label in np.unique(group):
            own = [floors[row] for row in np.flatnonzero(group == label)]
            for part in shapely.get_parts(shapely.union_all([shapes[key] for key in own])):
                name = numbered(f"room {' '.join(own[0])}", {room.name for room in plan.rooms})
                plan.room(name, f"z {z[own[0]]:g}", part, use=use[own[0]])
        for key in sorted(shapes.keys() - floors):
            name, at = f"stair {' '.join(key)}", [(keys, line) for _, keys, line in ways if key in keys]
            ends = {z[other]: line for keys, line in at for other in keys if other in floors}
            if len(at) == len(ends) == 2:
                plan.flight(name, ends[min(ends)], min(ends), ends[max(ends)], max(ends))
            else:
                text = f"{name} does not lead from one floor to another, higher one, and nowhere else"
                plan.note("missing", text, place=place_of(shapes[key]), element="subroom")
        return plan


def _joined(one: Tree.Element, room: str) -> list[tuple[str, str]]:
    """Return the rooms and subrooms that a crossing or transition joins; one alone if it leads outside."""
    keys = [(room or one.get(f"room{k}_id", ""), one.get(f"subroom{k}_id", "")) for k in (1, 2)]
    return [key for key in keys if "-1" not in key]


def _line(one: Tree.Element) -> shapely.Geometry:
    """Return the line through the vertices of an element."""
    corners = [[_number(vertex.get(key)) for key in ("px", "py")] for vertex in one.iter("vertex")]
    if len(corners) < 2 or not (np.abs(corners) <= FARTHEST).all():
        raise ValueError(f"<{one.tag}> {one.get('id', '')} needs two vertices with px and py up to {FARTHEST:g} m")
    return shapely.LineString(corners)


def _number(text: str | None) -> float:
    """Return a number, in which a minus sign may be typographical; 0 without one."""
    try:
        return float((text or "0").replace("\u2212", "-"))
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None
