"""Strangers of known truth as bodies: decks of FDS, and IFC."""

import math
import random

import numpy as np
from shapely import box
from shapely.geometry.polygon import orient

from tests.ifcfiles import IfcFile
from tests.importing.strangers.judge import Stranger
from tests.importing.strangers.truth import building

#: Thickness of slabs, and clear height of walls beside doors [m].
SLAB, CLEAR = 0.25, 2.1


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
