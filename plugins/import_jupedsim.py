"""Importer of geometries of JuPedSim in XML: rooms and subrooms, crossings, transitions, obstacles and stairs."""

import xml.etree.ElementTree as Tree
from pathlib import Path

import networkx
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.building.geometry import flat_parts, place_of
from evac.building.importer import Importer
from evac.building.plan.plan import Plan

#: Share of the common side of two subrooms from which on a crossing joins them without walls beside it.
WHOLE = 0.95


class JupedsimImporter(Importer):
    """Geometries of JuPedSim 0.x (.xml): subrooms are rooms, transitions to the room -1 exits, other ones doors.

    A crossing joins two subrooms; if it is shorter than their common side, the rest is a wall. Stairs are subrooms of
    the class `stair` or with a sloping plane, between the two floors that they cross to.
    """

    name = "jupedsim"
    suffixes = (".xml",)

    wall = Parameter(0.1, "thickness of walls between rooms that touch", unit="m", above=0.0)

    def read(self, path: Path) -> Plan:
        """Read the geometry; raise ValueError if the file is none."""
        try:
            root = Tree.fromstring(path.read_bytes())
            if root.tag != "geometry":
                raise ValueError(f"not a geometry of JuPedSim: the first element is <{root.tag}>")
            links = [
                (one, _links(one, room.get("id", ""))) for room in root.iter("room") for one in room.iter("crossing")
            ]
            links += [(one, _links(one)) for one in root.iter("transition") if one.find("vertex") is not None]
            segments = [(one.tag, one.get("id", ""), keys, _line(one)) for one, keys in links]
            shapes, z, uses, stairs = {}, {}, {}, set()
            for room in root.iter("room"):
                for one in room.iter("subroom"):
                    key = (room.get("id", ""), one.get("id", ""))
                    lines = [_line(wall) for wall in one.findall("polygon")]
                    faces = shapely.polygonize([shapely.union_all([*lines, *(s[3] for s in segments if key in s[2])])])
                    solid = [
                        shapely.polygonize([_line(wall) for wall in own.iter("polygon")])
                        for own in one.iter("obstacle")
                    ]
                    shapes[key] = flat_parts(shapely.union_all(faces.geoms).difference(shapely.union_all(solid)))
                    slopes = [_number(one.get(name)) for name in ("A_x", "B_y")]
                    z[key] = _number(one.get("C_z") or one.get("C") or room.get("zpos"))
                    if "stair" in one.get("class", "").lower() or "escalator" in one.get("class", "") or any(slopes):
                        stairs.add(key)
                    uses[key] = (one.get("class") or "room").lower()
                    if shapes[key].is_empty:
                        raise ValueError(f"room {key[0]}, subroom {key[1]}: its walls and doors enclose no area")
        except (Tree.ParseError, LookupError, shapely.GEOSException) as error:
            raise ValueError(f"not a geometry of JuPedSim: {str(error).rpartition('Exception: ')[2]}") from error
        if not shapes.keys() - stairs:
            raise ValueError("the geometry has no subroom that is a floor")
        plan, joined = Plan(path), networkx.Graph()
        for kind in ("subroom", "obstacle", "crossing", "transition"):
            if many := len([*root.iter(kind)]):
                plan.note("found", f"{many} <{kind}>", element=kind, number=many)
        joined.add_nodes_from(key for key in shapes if key not in stairs)
        between = [one for one in segments if len(one[2]) == 2 and not stairs & {*one[2]}]
        for tag, _, (a, b), line in between:
            common = shapes[a].boundary.intersection(shapes[b].boundary).length
            if tag == "crossing" and z[a] == z[b] and line.length > WHOLE * common:
                joined.add_edge(a, b)
        of = {height: f"z {height:g}" for height in sorted({z[key] for key in joined})}
        for height, name in of.items():
            spaces = [sorted(keys) for keys in networkx.connected_components(joined) if z[min(keys)] == height]
            plan.storey(name, None, height, wall=self.wall)
            for keys in spaces:
                parts = shapely.get_parts(shapely.union_all([shapes[key] for key in keys]))
                for row, part in enumerate(parts, start=1):
                    label = f"room {' '.join(keys[0])}" + (f" ({row})" if len(parts) > 1 else "")
                    plan.room(label, name, part, use=uses[keys[0]])
            plan.note("found", f"{len(spaces)} rooms at z = {height:g} m", name)
        for tag, number, keys, line in segments:
            name, place, own = f"{tag} {number}", place_of(line), [key for key in keys if key not in stairs]
            ends = shapely.get_coordinates(line)[[0, -1]]
            if len(keys) == 1 and own:
                plan.exit(name, of[z[own[0]]], ends)
                plan.note("found", f"exit {name!r}", of[z[own[0]]], place)
            elif len(own) == 2 and z[own[0]] == z[own[1]] and not joined.has_edge(*own):
                plan.door(name, of[z[own[0]]], ends)
                plan.note("found", f"door {name!r}", of[z[own[0]]], place)
            elif len(keys) == 1 or (len(own) == 2 and not joined.has_edge(*own)):
                text = f"{name} leads from a stair, or to a room at another height"
                plan.note("missing", text, place=place, element=tag)
        for key in sorted(stairs):
            ways = [(keys, line) for _, _, keys, line in segments if key in keys]
            at = [(z[other], line) for keys, line in ways for other in keys if other not in stairs]
            at.sort(key=lambda end: end[0])
            name, place = f"stair {key[0]} {key[1]}", place_of(shapes[key])
            if len(at) != 2 or at[0][0] == at[1][0]:
                text = f"{name} does not lead from one floor to another, higher one"
                plan.note("missing", text, place=place, element="subroom")
                continue
            edges = [shapely.get_coordinates(line)[[0, -1]] for _, line in at]
            plan.flight(name, edges[0], at[0][0], edges[1], at[1][0])
            plan.note("found", name, of[at[0][0]], place)
        return plan


def _links(one: Tree.Element, room: str = "") -> list[tuple[str, str]]:
    """Return the rooms and subrooms that a crossing or transition joins; one alone if it leads outside."""
    keys = [(room or one.get(f"room{k}_id", ""), one.get(f"subroom{k}_id", "")) for k in (1, 2)]
    return [key for key in keys if "-1" not in key]


def _line(one: Tree.Element) -> BaseGeometry:
    """Return the line through the vertices of an element."""
    corners: FloatArray = np.array(
        [[_number(vertex.get(key)) for key in ("px", "py")] for vertex in one.iter("vertex")]
    )
    if len(corners) < 2 or not np.isfinite(corners).all():
        raise ValueError(f"<{one.tag}> {one.get('id', '')} needs two vertices with px and py")
    return shapely.LineString(corners)


def _number(text: str | None) -> float:
    """Return a number, in which a minus sign may be typographical; 0 without one."""
    try:
        return float((text or "0").replace("\u2212", "-"))
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None
