"""Numbers of the foreign buildings, read by shapely, trimesh, ezdxf and ifcopenshell, without any code of evac.

python -m tests.importing.independent >tests/importing/foreign.csv
"""

import csv
import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import shapely.geometry
from shapely.geometry.base import BaseGeometry

FOREIGN = Path(__file__).parents[3] / "shared" / "data" / "foreign"
TABLE = Path(__file__).parent / "foreign.csv"
#: A space that is lower than this is an attic or a crawl space [m].
STANDING = 1.8
#: How far beyond a wall the outside begins [m].
BEYOND = 0.6
#: Radius of the Earth [m].
EARTH = 6371008.8

#: Drawings by architects: metres per unit (from doors of 30, 32 and 900 units), corner, layers of walls, and lines that
#: close the outer doors and what is cut off, all read by eye.
DRAWINGS: dict[str, tuple[float, tuple[float, float], tuple[str, ...], list[list[tuple[float, float]]]]] = {
    "bjnortier_floorplan.dxf": (
        0.0254,
        (-700, -250),
        ("A-WALL", "A-GARAGE-DOOR"),
        [
            [(-650, 347), (48, 347)],
            [(47, 360), (47, 40)],
            [(-640, -13), (-500, -13)],
            [(-480, -37), (-340, -37)],
        ],
    ),
    "constructiq_house_plan.dxf": (
        0.0254,
        (220, 540),
        ("WALL", "WALLS"),
        [
            [(280, 981), (445, 981)],
            [(481, 850), (481, 965)],
            [(515, 837), (630, 837)],
            [(287, 655), (287, 770)],
            [(478, 635), (478, 675)],
            [(615, 682), (660, 682)],
            [(721, 680), (721, 780)],
        ],
    ),
    "wrld3d_cad.dxf": (
        0.001,
        (10000, 10000),
        ("wall", "concr", "windows line"),
        [
            [(48750, 28000), (48750, 38600)],
            [(45000, 38500), (48900, 38500)],
            [(34000, 28200), (38500, 28200)],
            [(38500, 29000), (38500, 30600)],
            [(12400, 11700), (67000, 11700)],
            [(12400, 27450), (34500, 27450)],
            [(43000, 27450), (69000, 27450)],
            [(12400, 11700), (12400, 27450)],
            [(69000, 17000), (69000, 27500)],
            [(67000, 11700), (67000, 16700)],
            [(34600, 32000), (34600, 38150)],
            [(34600, 38150), (45000, 38150)],
            [(12500, 28000), (12500, 31300)],
        ],
    ),
}
#: Where the plans that are measured lie in them [m].
REGION = shapely.box(-1.0, -1.0, 62.0, 30.0)

Row = tuple[str, str, str, str]  # file, quantity, value, source


def rows_of(path: Path) -> Iterator[Row]:
    """Yield the rows of one file."""
    readers = {".wkt": _wkt, ".dxf": _dxf, ".ifc": _ifc, ".geojson": _geojson, ".obj": _obj}
    for quantity, value, source in readers[path.suffix](path):
        yield path.name, quantity, f"{value:.2f}" if isinstance(value, float) else str(value), source


def _wkt(path: Path) -> Iterator[tuple[str, Any, str]]:
    ground = shapely.union_all(shapely.get_parts(shapely.from_wkt(path.read_text())))
    yield "storeys", 1, "one collection of polygons"
    yield "stairs", 0, "a plan"
    yield "area", ground.area, "shapely: area of the union"


def _dxf(path: Path) -> Iterator[tuple[str, Any, str]]:
    import ezdxf

    layers: dict[str, list[BaseGeometry]] = {}
    for line in ezdxf.readfile(path).modelspace().query("LWPOLYLINE"):
        corners = [point[:2] for point in line.get_points()]
        if len(corners) > 2:
            layers.setdefault(line.dxf.layer, []).append(shapely.Polygon(corners))
    yield "stairs", 0, "no text or block of the drawing names one that leaves the storey"
    if "walkablearea" not in layers:
        yield "storeys", 1, "plans of the drawing, by its texts; constructiq repeats one with its electrical fittings"
        yield (
            "area",
            _within(path),
            "ezdxf and shapely: walls and closings by eye, filled, without gaps up to 0.76 m",
        )
        return
    yield "storeys", 1, "one walkablearea"
    ground = shapely.union_all(layers["walkablearea"]).difference(shapely.union_all(layers["jps-exits"]))
    yield "exits", len(layers["jps-exits"]), "polylines of layer jps-exits"
    yield "area", ground.area, "shapely: walkablearea without exits"


def _within(path: Path) -> float:
    """Return the area within the walls of an architect's drawing, whose layers and extent were read by eye."""
    import ezdxf

    unit, corner, layers, closing = DRAWINGS[path.name]
    parts: list[tuple[Any, str]] = [(one, one.dxf.layer) for one in ezdxf.readfile(path).modelspace()]
    lines, solids = [shapely.LineString(unit * (np.array(line) - corner)) for line in closing], []
    for entity, layer in parts:  # grows by what is in blocks
        if entity.dxftype() == "INSERT" and entity.dxf.name.startswith(("wind", "xref")):
            parts += [(one, "glass") for one in entity.virtual_entities() if entity.dxf.name.startswith("wind")]
        if layer.rpartition("$")[2] not in (*layers, "glass") or entity.dxftype() not in ("LINE", "LWPOLYLINE"):
            continue
        is_line = entity.dxftype() == "LINE"
        points = [entity.dxf.start, entity.dxf.end] if is_line else [*entity.vertices_in_wcs()]
        corners = unit * (np.array([[point.x, point.y] for point in points]) - corner)
        is_closed = not is_line and len(corners) > 2 and (entity.closed or np.allclose(corners[0], corners[-1]))
        line = shapely.LineString([*corners, corners[0]] if is_closed else corners)
        if (layer == "glass" and line.length < 0.5) or not line.within(REGION):
            continue
        lines.append(line)
        if is_closed and shapely.Polygon(corners).buffer(-0.45).is_empty:
            solids.append(shapely.Polygon(corners).buffer(0))
    walls = shapely.union_all([*lines, *solids])
    grown = shapely.get_parts(walls.buffer(0.4, join_style="mitre"))
    filled = shapely.union_all([shapely.Polygon(part.exterior) for part in grown]).buffer(-0.4, join_style="mitre")
    thick = walls.buffer(0.38, join_style="mitre").buffer(-0.379, join_style="mitre")
    rooms = shapely.get_parts(filled.difference(thick))
    return float(sum(room.area for room in rooms if room.area > 1.0))


def _geojson(path: Path) -> Iterator[tuple[str, Any, str]]:
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    shapes = [shapely.geometry.shape(feature["geometry"]) for feature in features]
    west, south, _, north = shapely.total_bounds(shapes)
    scale = np.radians(EARTH) * np.array([np.cos(np.radians((south + north) / 2)), 1.0])
    levels: dict[str, list[BaseGeometry]] = {}
    walls = []
    for feature, given in zip(features, shapes, strict=True):
        shape = shapely.transform(given, lambda xy: (xy - [west, south]) * scale)
        own = feature["properties"]
        if shape.geom_type == "Polygon" and own.get("type") in ("wall", "window"):
            walls.append(shape)
        elif shape.geom_type == "Polygon" and own.get("type") == "building_outline":
            levels["outline"] = [shape]
        elif shape.geom_type == "Polygon" and ("level_id" in own or "indoor" in own):
            for level in str(own.get("level_id") or own.get("level") or "").split(";"):
                if level:
                    levels.setdefault(level, []).append(shape)
    area = sum(shapely.union_all(found).difference(shapely.union_all(walls)).area for found in levels.values())
    yield "storeys", len(levels), "values of level and level_id, or the outline of the building"
    yield "area", area, "shapely: union of the polygons of each level, without walls and windows"


def _obj(path: Path) -> Iterator[tuple[str, Any, str]]:
    import trimesh

    mesh = trimesh.load(path, process=False)
    steep = mesh.face_normals[:, 1] > np.cos(np.radians(50.0))
    yield "area", float(mesh.area_faces[steep].sum()), "trimesh: faces within 50 degrees of level, before clear heights"


def _ifc(path: Path) -> Iterator[tuple[str, Any, str]]:
    import ifcopenshell

    # An asterisk stands for a derived value, which ifcopenshell refuses where there is none.
    text = re.sub(r"(?m)^#(?!.*IFCSIUNIT).*$", lambda line: line[0].replace("*", "$"), path.read_text("latin-1"))
    model = ifcopenshell.file.from_string(text)
    storeys, area, exits, hulls = 0, 0.0, 0, []
    roofs = [_shape(slab).bounds[1, 2] for slab in model.by_type("IfcSlab") if slab.PredefinedType == "ROOF"]
    for storey in model.by_type("IfcBuildingStorey"):
        inside = [one for link in storey.ContainsElements for one in link.RelatedElements]
        spaces = [_shape(one) for link in storey.IsDecomposedBy for one in link.RelatedObjects if one.is_a("IfcSpace")]
        slabs = [_shape(one) for one in inside if one.is_a("IfcSlab") and one.PredefinedType in ("FLOOR", None)]
        rooms = [one for one in spaces if np.ptp(one.bounds[:, 2]) >= STANDING]
        if rooms and not slabs and any(abs(z - rooms[0].bounds[0, 2]) < 0.5 for z in roofs):
            continue  # a space above the roof
        walls = [_section(_shape(one), 0.1) for one in inside if one.is_a("IfcWall")]
        if rooms:
            ground = shapely.union_all([_face(one, up=False) for one in rooms])
            below = shapely.union_all([_face(one, up=True) for one in slabs])
            ground = ground if below.is_empty else ground.intersection(below.buffer(0.05))
        elif spaces:
            continue  # nobody can stand there
        else:
            ground = shapely.union_all([_face(one, up=True) for one in slabs]).difference(shapely.union_all(walls))
        if ground.area < 1.0:
            continue
        hull = shapely.union_all([ground, *walls]).buffer(0.3).buffer(-0.3)
        hull = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(hull)])
        filled = [one.FillsVoids[0].RelatingOpeningElement for one in inside if one.is_a("IfcDoor") and one.FillsVoids]
        doors = [_shape(one) for one in filled]
        inner = [
            _plan(one) for one in doors if shapely.get_num_geometries(_plan(one).buffer(0.05).intersection(ground)) > 1
        ]
        storeys, area, hulls = storeys + 1, area + shapely.union_all([ground, *inner]).area, [*hulls, hull]
        if min(abs(one.bounds[0, 2]) for one in spaces or slabs) < 0.5:
            exits += sum(_leads_out(one, ground, hull) for one in doors)
    yield "storeys", storeys, f"ifcopenshell: storeys with spaces at least {STANDING} m high and no roof, or with slabs"
    stairs = [_plan(_shape(part)).intersection(shapely.union_all(hulls)).area > 0.5 for part in _stairs(model)]
    yield "stairs", sum(stairs), "ifcopenshell: IfcStair, without those outside of the hulls of all storeys"
    yield "exits", exits, "ifcopenshell: doors at the outer hull of storeys up to 0.5 m"
    text = (
        "ifcopenshell and trimesh: faces of spaces over slabs, or of slabs without walls, and openings of inner doors"
    )
    yield "area", area, text


def _shape(element: Any) -> Any:
    """Return an element as a mesh of trimesh, in metres."""
    import ifcopenshell.geom
    import trimesh

    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    geometry = ifcopenshell.geom.create_shape(settings, element).geometry
    return trimesh.Trimesh(np.reshape(geometry.verts, (-1, 3)), np.reshape(geometry.faces, (-1, 3)))


def _stairs(model: Any) -> Iterator[Any]:
    """Yield a part with a shape of each stair: its first flight, or the stair itself."""
    for stair in model.by_type("IfcStair"):
        parts = [one for link in stair.IsDecomposedBy for one in link.RelatedObjects if one.is_a("IfcStairFlight")]
        yield parts[0] if parts else stair


def _plan(mesh: Any) -> BaseGeometry:
    """Return the convex hull of a mesh in plan."""
    return shapely.convex_hull(shapely.multipoints(mesh.vertices[:, :2]))


def _face(mesh: Any, *, up: bool) -> BaseGeometry:
    """Return the level faces of a mesh, upwards or downwards, in plan."""
    level = mesh.face_normals[:, 2] * (1.0 if up else -1.0) > 0.999
    return shapely.union_all(shapely.polygons(mesh.triangles[level][:, :, :2]), grid_size=1e-4)


def _section(mesh: Any, above: float) -> BaseGeometry:
    """Return the section of a mesh at a height above its foot [m], in plan."""
    import trimesh.intersections

    lines = trimesh.intersections.mesh_plane(mesh, (0, 0, 1), (0, 0, mesh.bounds[0, 2] + above))
    return shapely.build_area(shapely.union_all(shapely.linestrings(lines[:, :, :2]), grid_size=1e-4))


def _leads_out(door: Any, ground: BaseGeometry, hull: BaseGeometry) -> bool:
    """Return whether there is ground on one side of a door only, and the outside of the storey on the other."""
    low, high = door.bounds[:, :2]
    middle, along = (low + high) / 2, int(np.argmax(high - low))
    way = np.eye(2)[1 - along] * ((high - low)[1 - along] / 2 + BEYOND)
    sides = [shapely.Point(middle + way), shapely.Point(middle - way)]
    return sum(ground.contains(one) for one in sides) == 1 and not all(hull.contains(one) for one in sides)


def main() -> None:
    """Write the table."""
    writer = csv.writer(sys.stdout, lineterminator="\n")
    writer.writerow(("file", "quantity", "value", "source"))
    for path in sorted(FOREIGN.iterdir()):
        writer.writerows(rows_of(path))


if __name__ == "__main__":
    main()
