"""Strangers of known truth as bodies: meshes in OBJ and STL, decks of FDS, and IFC."""

import math
import random

import numpy as np
import shapely
from shapely import box
from shapely.geometry.polygon import orient

from tests.ifcfiles import IfcFile
from tests.importing.strangers.judge import Stranger
from tests.importing.strangers.truth import building

#: Thickness of slabs, clear height of walls beside doors, and height of a table [m].
SLAB, CLEAR, TABLE = 0.25, 2.1, 0.75


def _extruded(shape, low, high):
    """Return triangles (n, 3, 3) of the closed body above a polygon."""
    found = []
    for polygon in getattr(shape, "geoms", [shape]):
        polygon = orient(polygon)
        for triangle in shapely.constrained_delaunay_triangles(polygon).geoms:
            a, b, c = np.array(orient(triangle).exterior.coords)[:3]
            found += [[(*p, high) for p in (a, b, c)], [(*p, low) for p in (c, b, a)]]
        for ring in (polygon.exterior, *polygon.interiors):
            for (x1, y1), (x2, y2) in zip(ring.coords, ring.coords[1:], strict=False):
                found.append([(x1, y1, low), (x2, y2, low), (x2, y2, high)])
                found.append([(x1, y1, low), (x2, y2, high), (x1, y1, high)])
    return np.array(found)


def _bodies(truth, rng):
    """Return bodies (name, polygon, low, high): slabs, walls, lintels, stairs, roof and furniture."""
    found = []
    top = len(truth.storeys) - 1
    riser = truth.stairs[0].treads[0][1]
    for k, storey in enumerate(truth.storeys):
        holes = [stair.footprint for stair in truth.stairs if stair.lower == k - 1]
        found.append((f"Slab_{k}", storey.outline - shapely.union_all(holes), storey.z - SLAB, storey.z))
        shafts = shapely.union_all([r.polygon for r in storey.rooms if r.use == "lift"])
        ceiling = storey.z + truth.height - SLAB
        found.append((f"Walls_{k}", shapely.union_all([storey.wall_bodies, shafts]), storey.z, ceiling))
        found += [(f"Lintel_{d.name}", d.strip - shafts, storey.z + CLEAR, ceiling) for d in storey.doors]
        for room in storey.rooms:
            if room.use == "office" and rng.random() < 0.4:
                x, y = room.polygon.centroid.coords[0]
                found.append(
                    (f"Table_{room.name}", box(x, y, x + 1, y + 0.7), storey.z + TABLE - 0.04, storey.z + TABLE)
                )
    for stair in truth.stairs:
        z = truth.storeys[stair.lower].z
        for i, (tread, up) in enumerate(stair.treads + stair.landings):
            found.append((f"Stair_{stair.lower}_{stair.well[-1]}_{i}", tread, z + up - riser, z + up))
    outline = truth.storeys[top].outline
    found.append(("Roof", outline, (top + 1) * truth.height - SLAB, (top + 1) * truth.height))
    return found


def _mesh(seed, units):
    """Return a truth, the triangles of each body in the coordinates of the file, and the option for y upwards."""
    rng = random.Random(seed)
    truth = building(seed, lifts=seed % 3 == 0)
    unit, y_up = rng.choice(units), rng.random() < 0.5
    bodies = []
    for name, shape, low, high in _bodies(truth, rng):
        if shape.is_empty:
            continue
        points = _extruded(truth.placed(shape), low, high)
        if y_up:
            points = points[..., [0, 2, 1]] * [1, 1, -1]
        bodies.append((name, points / unit))
    return rng, truth, bodies, {"up": "y"} if y_up else {}


def obj(seed, folder):
    """OBJ as modellers write it: an object for each body, normals and texture coordinates, vertices of its own."""
    rng, truth, bodies, options = _mesh(seed, [1.0, 0.001, 0.01, 0.3048, 0.0254])
    lines = ["# Exported", "mtllib house.mtl", "vt 0 0", "vn 0 0 1"]
    count, word = 0, rng.choice(["o", "g"])
    for name, triangles in bodies:
        lines += [f"{word} {name}", "usemtl Concrete", "s off"]
        for triangle in triangles:
            lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in triangle]
            lines.append("f " + " ".join(f"{count + i}/1/1" for i in (1, 2, 3)))
            count += 3
    path = folder / f"house_{seed}.obj"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return Stranger(truth, [path], exits=False, options=options)


def fds(seed, folder):
    """A deck of FDS, in half of the cases of FDS+Evac: slabs, walls with holes, and stairs that a deck may tell."""
    rng = random.Random(seed)
    evac, linked = rng.random() < 0.7, rng.random() < 0.3
    truth = building(seed, grid=0.1, storeys=rng.randint(1, 4), lifts=False, setback=False, stairs=False)
    lines = [f"&HEAD CHID='case_{seed}', TITLE='Office / test' /", "&TIME T_END=300. /", "! Meshes"]
    lows, highs = np.reshape(
        truth.placed(truth.storeys[0].outline.buffer(0.6 if evac else 0, join_style="mitre")).bounds, (2, 2)
    )
    top = len(truth.storeys) * truth.height

    def xb(shape, low, high):
        x1, y1, x2, y2 = truth.placed(shape).bounds if hasattr(shape, "bounds") else shape
        return f"XB={x1:.2f},{x2:.2f}, {y1:.2f},{y2:.2f}, {low:.2f},{high:.2f}"

    whole = (*lows, *highs)
    nx, ny = (round(n / 0.2) for n in highs - lows)
    lines.append(f"&MESH ID='fire', IJK={nx},{ny},{math.ceil(top / 0.2)}, {xb(whole, 0.0, top)} /")
    lines += ["&REAC FUEL='PROPANE', SOOT_YIELD=0.02 /", "&SURF ID='WALL', COLOR='GRAY 80', DEFAULT=.TRUE. /"]
    for k, storey in enumerate(truth.storeys):
        z = storey.z
        if evac:
            flag = rng.choice([".TRUE.", "T", ".true."])
            mesh = f"&MESH ID='Floor{k}', IJK={nx},{ny},1, {xb(whole, z + 0.4, z + 1.6)},"
            lines += [mesh, f"      EVACUATION={flag}, EVAC_HUMANS={flag}, EVAC_Z_OFFSET=1.0 /"]
        if k:
            lines.append(f"&OBST {xb(whole, z - 0.2, z)}, SURF_ID='WALL' / slab of {storey.name}")
        for wall in storey.walls:
            lines.append(f"&OBST ID='w', {xb(wall.body, z, z + truth.height - 0.2)}, SURF_ID='WALL' /")
        for door in storey.doors:
            hole = door.segment.buffer(door.wall.thickness / 2 + 0.05, cap_style="flat")
            lines.append(f"&HOLE {xb(hole, z, z + 2.0)} / {door.name}")
        for room in (one for one in storey.rooms if one.use == "office"):
            if rng.random() < 0.2:
                x, y = (round(c, 1) for c in room.polygon.centroid.coords[0])
                lines.append(f"&OBST {xb(box(x, y, x + 0.6, y + 0.4), z, z + 0.8)}, COLOR='BROWN' / table")
            if evac and rng.random() < 0.6:
                inner = room.polygon.buffer(-0.2, join_style="mitre")
                lines.append(f"&EVAC ID='{room.name}', NUMBER_INITIAL_PERSONS={rng.randint(1, 5)},")
                lines.append(f"      {xb(inner, z + 0.4, z + 1.6)}, PERS_ID='Adult' /")
        for door in (one for one in storey.doors if one.kind == "exit"):
            placed = truth.placed(door.segment.buffer(1e-9, cap_style="flat"))
            x1, y1, x2, y2 = placed.bounds
            centre = truth.placed(storey.outline).centroid
            axis = 1 if x2 - x1 < y2 - y1 else 2
            ior = axis * int(math.copysign(1, (x1 - centre.x) if axis == 1 else (y1 - centre.y)))
            if evac:
                lines.append(f"&EXIT ID='{door.name}', IOR={ior}, {xb(door.segment, z + 0.4, z + 1.6)} / way out")
            else:
                side = 0 if axis == 1 else 1
                at = (lows if ior < 0 else highs)[side]
                edge = (at, y1, at, y2) if axis == 1 else (x1, at, x2, at)
                lines.append(f"&VENT ID='{door.name}', {xb(edge, z, z + 2.0)}, SURF_ID='OPEN' /")
    if evac:
        lines.append("&PERS ID='Adult', FYI='Male+Female / adults', DEFAULT_PROPERTIES='Adult',\n PRE_MEAN=60. /")
    reasons = ()
    if evac and linked and len(truth.storeys) > 1:
        y = round(truth.storeys[0].rooms[0].polygon.bounds[1], 2)
        x1 = truth.storeys[0].rooms[0].polygon.bounds[0] + 3
        for k in range(1, len(truth.storeys)):
            z = truth.storeys[k].z
            door, entrance = box(x1, y, x1 + 1.2, y), box(x1, y, x1 + 1.2, y)
            lines.append(f"&DOOR ID='Down{k}', IOR=-2, {xb(door, z + 0.4, z + 1.6)}, TO_NODE='Stair{k}' /")
            lines.append(f"&CORR ID='Stair{k}', MAX_HUMANS_INSIDE=20, EFF_LENGTH=8.5, FAC_SPEED=0.7, TO_NODE='In{k}' /")
            lines.append(f"&ENTR ID='In{k}', IOR=2, {xb(entrance, z - truth.height + 0.4, z - truth.height + 1.6)} /")
        reasons = ("CORR",)
    lines += ["&SLCF PBY=2.0, QUANTITY='TEMPERATURE' /", "&DEVC XYZ=1,1,1, QUANTITY='VISIBILITY', ID='v' /", "&TAIL /"]
    path = folder / f"deck_{seed}.fds"
    text = "\n".join(lines) + "\n"
    path.write_text(
        text if rng.random() < 0.8 else text.replace("&OBST", "&obst").replace("XB=", "xb="), encoding="utf-8"
    )
    return Stranger(truth, [path], exits=evac, reasons=reasons)


def ifc(seed, folder):
    """IFC of an architect: spaces, slabs, walls with openings and doors, stairs of treads, furniture, property sets."""
    rng = random.Random(seed)
    truth = building(seed)
    unit = rng.choice(["METRE", "MILLI"])
    file = IfcFile(unit=unit, schema=rng.choice(["IFC4", "IFC2X3"]) if rng.random() < 0.3 else "IFC4")
    spaces = rng.random() < 0.7
    top = len(truth.storeys) - 1

    def corners(shape):
        return [tuple(p) for p in truth.placed(orient(shape)).exterior.coords[:-1]]

    def contain(storey, elements, kind="IFCRELCONTAINEDINSPATIALSTRUCTURE"):
        listed = ",".join(elements)
        ends = f"({listed}),{storey}" if kind == "IFCRELCONTAINEDINSPATIALSTRUCTURE" else f"{storey},({listed})"
        file.add(f"{kind}({file.guid()},$,$,$,{ends})")

    def solid(shape, low, high):
        return file.extruded(corners(shape), low, high - low)

    for k, storey in enumerate(truth.storeys):
        level = file.storey(storey.name, storey.z)
        z, made = storey.z, []
        slab = file.body("IFCSLAB", "Decke", solid(storey.outline.envelope, z - SLAB, z), predefined="FLOOR")
        for stair in (one for one in truth.stairs if one.lower == k - 1):
            hole = file.body("IFCOPENINGELEMENT", "Deckenloch", solid(stair.footprint, z - SLAB - 0.1, z + 0.1))
            file.add(f"IFCRELVOIDSELEMENT({file.guid()},$,$,$,{slab},{hole})")
        made.append(slab)
        for number, wall in enumerate(storey.walls):
            clear = z + truth.height - SLAB
            body = file.body("IFCWALL", f"Wand {k}.{number}", solid(wall.body, z, clear), predefined="STANDARD")
            made.append(body)
            for door in wall.doors:
                hole = door.segment.buffer(wall.thickness / 2 + 0.02, cap_style="flat")
                hole = hole & wall.body.buffer(0.05, join_style="mitre") & door.segment.buffer(5, cap_style="flat")
                opening = file.body("IFCOPENINGELEMENT", "Oeffnung", solid(hole, z, z + CLEAR))
                file.add(f"IFCRELVOIDSELEMENT({file.guid()},$,$,$,{body},{opening})")
                leaf = door.segment.buffer(0.025, cap_style="flat")
                name = "Aufzugstuer" if door.kind == "lift" else f"Tuer {door.name}"
                tail = f",{file.number(CLEAR)},{file.number(0.7)},.DOOR.,.SINGLE_SWING_LEFT.,$"
                filling = file.body("IFCDOOR", name, solid(leaf, z, z + CLEAR), tail=tail)
                file.add(f"IFCRELFILLSELEMENT({file.guid()},$,$,$,{opening},{filling})")
                made.append(filling)
        for room in storey.rooms:
            if room.use == "office" and rng.random() < 0.3:
                x, y = room.polygon.centroid.coords[0]
                body = solid(box(x, y, x + 1.2, y + 0.7), z, z + 0.75)
                made.append(file.body("IFCFURNITURE", "Schreibtisch", body))
        for stair in (one for one in truth.stairs if one.lower == k):
            riser = stair.treads[0][1]
            parts = [solid(one, z + up - riser, z + up) for one, up in stair.treads]
            flight = file.body("IFCSTAIRFLIGHT", "Lauf", *parts, tail=",$,$,$,$,.STRAIGHT.")
            whole = [flight]
            for one, up in stair.landings:
                whole.append(file.body("IFCSLAB", "Podest", solid(one, z + up - riser, z + up), predefined="LANDING"))
            kind = "STRAIGHT_RUN_STAIR" if stair.kind == "straight" else "HALF_TURN_STAIR"
            case = file.add(f"IFCSTAIR({file.guid()},$,'Treppe',$,$,{file.placement},$,$,.{kind}.)")
            contain(case, whole, "IFCRELAGGREGATES")
            made.append(case)
        if k == top:
            made.append(
                file.body(
                    "IFCSLAB",
                    "Dach",
                    solid(storey.outline, z + truth.height - SLAB, z + truth.height),
                    predefined="ROOF",
                )
            )
        contain(level, made)
        if spaces:
            rooms = []
            for room in storey.rooms:
                body = solid(room.polygon, z, z + truth.height - SLAB)
                rooms.append(file.body("IFCSPACE", room.name, body, tail=",$,.ELEMENT.,.INTERNAL.,$"))
                if room.use == "lift":
                    rooms[-1] = file.body(
                        "IFCSPACE", "Aufzugsschacht", body, tail=",'Aufzugsschacht',.ELEMENT.,.INTERNAL.,$"
                    )
            contain(level, rooms, "IFCRELAGGREGATES")
        value = file.add("IFCPROPERTYSINGLEVALUE('LoadBearing',$,IFCBOOLEAN(.T.),$)")
        values = file.add(f"IFCPROPERTYSET({file.guid()},$,'Pset_WallCommon',$,({value}))")
        file.add(f"IFCRELDEFINESBYPROPERTIES({file.guid()},$,$,$,({made[1]}),{values})")
    path = file.write(folder / f"office_{seed}.ifc")
    return Stranger(truth, [path])
