"""Strangers of known truth as drawings in DXF, in the manner of architects: one plan for each storey, side by side."""

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
UNITS = {1.0: 6, 0.001: 4, 0.01: 5, 0.0254: 1, 0.3048: 2}


def dxf(seed, folder):
    """Faces of walls, arcs and leaves of doors, treads, tables as blocks, axes, dimensions, a title block."""
    rng = random.Random(seed)
    truth = building(seed, storeys=rng.randint(1, 3), lifts=False, setback=False)
    unit = rng.choice([*UNITS])
    document = ezdxf.new(rng.choice(["R2000", "R2010", "R2018"]))
    document.header["$INSUNITS"] = UNITS[unit] if rng.random() < 0.8 else 0
    walls, doors, stairs, furniture, axes, texts = rng.choice(LAYERS)
    for layer in (walls, doors, stairs, furniture, axes, texts, "DIM", "TITLE"):
        document.layers.add(layer)
    space = document.modelspace()
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
        for body in getattr(bodies, "geoms", [bodies]):
            for ring in (body.exterior, *body.interiors):
                draw(ring, walls, closed)
        for door in storey.doors:
            a, b = at(door.segment).coords
            radius = door.segment.length / unit
            swing = rng.choice([90, -90])
            turn = shapely.affinity.rotate(shapely.LineString([a, b]), swing, origin=a).coords[1]
            first = math.degrees(math.atan2(b[1] - a[1], b[0] - a[0]))
            ends = sorted((first, first + swing))
            space.add_arc((a[0] / unit, a[1] / unit), radius, *ends, dxfattribs={"layer": doors})
            draw(shapely.LineString([a, turn]), doors)
        for stair in (one for one in truth.stairs if one.lower == k):
            for tread, _ in stair.treads:
                x1, y1, x2, y2 = tread.bounds
                draw(at(shapely.LineString([(x1, y1), (x2, y1)])), stairs)
                draw(at(shapely.LineString([(x1, y2), (x2, y2)])), stairs)
            draw(at(stair.footprint.exterior), stairs)
        for room in storey.rooms:
            x, y = at(room.polygon.centroid).coords[0]
            place = (x / unit, y / unit)
            space.add_text(room.name, height=0.25 / unit, dxfattribs={"layer": texts, "insert": place})
            if room.use == "office" and rng.random() < 0.4:
                space.add_blockref("TABLE", place, dxfattribs={"layer": furniture})
        x1, y1, x2, y2 = at(storey.outline).bounds
        for x in (x1, (x1 + x2) / 2, x2):
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
    return Stranger(truth, [path], heights=False, options={"height": truth.height})
