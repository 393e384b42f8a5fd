"""Strangers of known truth as drawings in DXF, in the manner of architects: one plan for each storey, side by side.

What offices do differently is a manner of `MANNERS`.
"""

import itertools
import math
import random

import ezdxf
import shapely
from shapely.affinity import translate

from tests.importing.strangers.judge import Stranger
from tests.importing.strangers.truth import building

#: Names of layers of walls, doors, stairs, furniture, axes, and texts, by office.
LAYERS = [
    ("A-WALL", "A-DOOR", "A-FLOR-STRS", "A-FURN", "S-GRID", "A-ANNO-TEXT"),
    ("WAND", "TUEREN", "TREPPE", "MOEBEL", "ACHSEN", "BESCHRIFTUNG"),
    ("Walls", "Doors", "Stairs", "Furniture", "Axis", "Text"),
    ("MURS", "PORTES", "ESCALIER", "MOBILIER", "AXES", "TEXTE"),
]
#: Beyond arcs of doors, tables as blocks, axes, dimensions and a title block, which all have.
MANNERS = {
    "arrows": "stairs have arrows and break lines",
    "blocks": "doors are blocks, which are turned and mirrored, on layer 0",
    "facade": "outer walls are on another layer than inner ones",
    "gaps": "doors are gaps alone",
    "hatches": "walls are filled by hatches, and a lone hatch is beside the plan",
    "hidden": "an older state of the plan is on a layer that is frozen",
    "one layer": "walls, doors and stairs are on layer 0",
    "open ends": "walls have no end faces at doors",
    "outlines": "rooms have outlines on a layer of their own",
    "windows": "outer walls are interrupted by windows of three lines",
    "xrefs": "furniture and axes are in other files, which are absent",
}
UNITS = {1.0: 6, 0.001: 4, 0.01: 5, 0.0254: 1, 0.3048: 2}


def dxf(seed, folder, manner=""):
    """Faces of walls, arcs and leaves of doors, treads, tables as blocks, axes, dimensions, a title block."""
    rng = random.Random(seed)
    truth = building(seed, storeys=rng.randint(1, 3), lifts=False, setback=False)
    unit = rng.choice([*UNITS])
    document = ezdxf.new(rng.choice(["R2000", "R2010", "R2018"]))
    document.header["$INSUNITS"] = UNITS[unit] if rng.random() < 0.8 else 0
    walls, doors, stairs, furniture, axes, texts = rng.choice(LAYERS)
    facade = "FACADE" if manner == "facade" else walls
    for layer in {walls, doors, stairs, furniture, axes, texts, facade, "DIM", "TITLE", "RAUMGRENZE", "WALL-OLD"}:
        document.layers.add(layer)
    if manner == "one layer":
        walls = facade = doors = stairs = "0"
    space = document.modelspace()
    leaf = document.blocks.new("LEAF")
    leaf.add_arc((0, 0), 1, 0, 90)
    leaf.add_line((0, 0), (0, 1))
    if manner == "xrefs":
        document.add_xref_def("furniture.dwg", "FURNITURE")
        space.add_blockref("FURNITURE", (0, 0))
    if manner == "hidden":
        document.layers.get("WALL-OLD").freeze()
    table = document.blocks.new("TABLE")
    table.add_lwpolyline([(0, 0), (1.2 / unit, 0), (1.2 / unit, 0.7 / unit), (0, 0.7 / unit)], close=True)
    closed = rng.random() < 0.5
    width = truth.placed(truth.storeys[0].outline).bounds
    step = width[2] - width[0] + rng.uniform(6, 12)

    def draw(shape, layer, close=False):
        points = [(x / unit, y / unit) for x, y in shape.coords]
        if close:
            space.add_lwpolyline(points[:-1], close=True, dxfattribs={"layer": layer})
        else:
            for a, b in itertools.pairwise(points):
                space.add_line(a, b, dxfattribs={"layer": layer})

    for k, storey in enumerate(truth.storeys):

        def at(shape, k=k):
            return translate(truth.placed(shape), k * step)

        bodies = at(storey.wall_bodies)
        if manner == "windows":
            end = storey.walls[0].line[2] - storey.walls[0].line[0]
            panes = [wall.along(end - 2.6, end - 1.4) for wall in storey.walls[:2]]
            panes = [pane.buffer(storey.walls[0].thickness / 2, cap_style="flat") for pane in panes]
            bodies -= at(shapely.union_all(panes))
            for pane in panes:
                x1, y1, x2, y2 = pane.bounds
                for y in (y1, (y1 + y2) / 2, y2):
                    draw(at(shapely.LineString([(x1, y), (x2, y)])), "WINDOWS")
        outer = at(storey.outline.exterior).buffer(0.001)
        ends = shapely.union_all([at(end) for door in storey.doors for end in ends_of(door)]).buffer(0.001)
        for body in getattr(bodies, "geoms", [bodies]):
            for ring in (body.exterior, *body.interiors):
                if manner in ("facade", "open ends"):
                    for side in map(shapely.LineString, itertools.pairwise(ring.coords)):
                        if manner == "facade" or not ends.covers(side):
                            draw(side, facade if outer.covers(side) else walls)
                else:
                    draw(ring, walls, closed)
            if manner == "hatches":
                hatch = space.add_hatch(dxfattribs={"layer": walls})
                for ring in (body.exterior, *body.interiors):
                    hatch.paths.add_polyline_path([(x / unit, y / unit) for x, y in ring.coords])
        if manner == "hatches":
            x, y = (one / unit for one in at(storey.outline).bounds[:2])
            corners = [(x + a / unit, y - b / unit) for a, b in ((0, 4), (1, 4), (1, 4.4), (0, 4.4))]
            space.add_hatch(dxfattribs={"layer": walls}).paths.add_polyline_path(corners)
        if manner == "hidden":
            draw(at(storey.outline.centroid.buffer(3)).exterior, "WALL-OLD")
        for door in storey.doors if manner != "gaps" else ():
            a, b = at(door.segment).coords
            radius = door.segment.length / unit
            swing = rng.choice([90, -90])
            first = math.degrees(math.atan2(b[1] - a[1], b[0] - a[0]))
            if manner == "blocks":
                scales = {"xscale": radius, "yscale": math.copysign(radius, swing), "rotation": first}
                space.add_blockref("LEAF", (a[0] / unit, a[1] / unit), dxfattribs={"layer": doors, **scales})
                continue
            turn = shapely.affinity.rotate(shapely.LineString([a, b]), swing, origin=a).coords[1]
            ends = sorted((first, first + swing))
            space.add_arc((a[0] / unit, a[1] / unit), radius, *ends, dxfattribs={"layer": doors})
            draw(shapely.LineString([a, turn]), doors)
        for stair in (one for one in truth.stairs if one.lower == k):
            for tread, _ in stair.treads:
                x1, y1, x2, y2 = tread.bounds
                draw(at(shapely.LineString([(x1, y1), (x2, y1)])), stairs)
                draw(at(shapely.LineString([(x1, y2), (x2, y2)])), stairs)
            draw(at(stair.footprint.exterior), stairs)
            if manner == "arrows":
                arrow(stair, at, draw, stairs)
        for room in storey.rooms:
            x, y = at(room.polygon.centroid).coords[0]
            place = (x / unit, y / unit)
            space.add_text(room.name, height=0.25 / unit, dxfattribs={"layer": texts, "insert": place})
            if manner == "outlines":
                draw(at(room.polygon.exterior), "RAUMGRENZE", True)
            if manner != "xrefs" and room.use == "office" and rng.random() < 0.4:
                space.add_blockref("TABLE", place, dxfattribs={"layer": furniture})
        x1, y1, x2, y2 = at(storey.outline).bounds
        for x in (x1, (x1 + x2) / 2, x2) if manner != "xrefs" else ():
            draw(shapely.LineString([(x, y1 - 2), (x, y2 + 2)]), axes)
            space.add_circle((x / unit, (y2 + 2.4) / unit), 0.4 / unit, dxfattribs={"layer": axes})
        base = (x1 / unit, (y1 - 1) / unit)
        ends = ((x1 / unit, y1 / unit), (x2 / unit, y1 / unit))
        space.add_linear_dim(base=base, p1=ends[0], p2=ends[1], dxfattribs={"layer": "DIM"}).render()
        space.add_text(
            storey.name, height=0.6 / unit, dxfattribs={"layer": texts, "insert": (base[0], base[1] - 2 / unit)}
        )
    frame = shapely.box(width[0] - 6, width[1] - 9, width[0] + len(truth.storeys) * step + 2, width[3] + 6)
    draw(frame.exterior, "TITLE", True)
    path = folder / f"drawing_{seed}.dxf"
    document.saveas(path)
    return Stranger(truth, [path], heights=False, exits=manner != "gaps", options={"height": truth.height})


def ends_of(door):
    """Return the end faces of the wall at both sides of a door."""
    x1, y1, x2, y2 = door.strip.bounds
    sides = [((x1, y1), (x1, y2)), ((x2, y1), (x2, y2))] if door.wall.line[1] == door.wall.line[3] else []
    sides = sides or [((x1, y1), (x2, y1)), ((x1, y2), (x2, y2))]
    return [shapely.LineString(side) for side in sides]


def arrow(stair, at, draw, layer):
    """Draw an arrow along the last flight of a stair, and a break line across it."""
    low, up = stair.treads[-min(8, len(stair.treads) // 2 - 1)][0].centroid, stair.treads[-1][0].centroid
    way = (up.y - low.y) / abs(up.y - low.y)
    tip = up.y + 0.3 * way
    draw(at(shapely.LineString([(low.x, low.y - 0.2 * way), (up.x, tip)])), layer)
    for side in (-0.1, 0.1):
        draw(at(shapely.LineString([(up.x, tip), (up.x + side, tip - 0.2 * way)])), layer)
    draw(at(shapely.LineString([(low.x - 0.7, low.y), (low.x + 0.7, low.y + 0.3)])), layer)
