"""Strangers of known truth as plans in GeoJSON and as indoor maps of OpenStreetMap and IMDF."""

import json
import math
import random
import uuid
import zipfile
from xml.sax.saxutils import quoteattr

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, box
from shapely.geometry import mapping

from tests.importing.strangers.judge import Stranger
from tests.importing.strangers.truth import building

HOME = (8.4037, 49.0069)


def _degrees(shape):
    """Return longitude and latitude of a shape in metres east and north of a place."""
    latitude, square = math.radians(HOME[1]), 0.00669437999014  # of the ellipsoid of WGS 84
    root = 1 - square * math.sin(latitude) ** 2
    metres = np.radians([math.cos(latitude), (1 - square) / root]) * 6378137.0 / math.sqrt(root)
    return shapely.transform(shape, lambda p: np.round(np.array(HOME) + p / metres, 10))


def _from_origin(truth, lowest):
    """Move a truth to the origin that readers choose for degrees: the least longitude and latitude of the file."""
    scale = _degrees(Point(0, 0)).coords[0], _degrees(Point(1, 1)).coords[0]
    moved = [(low - zero) / (one - zero) for low, zero, one in zip(lowest, *scale, strict=True)]
    truth.moved = tuple(own - by for own, by in zip(truth.moved, moved, strict=True))


def _doubled(shape, rng):
    """Return a polygon with a vertex that is there twice, as digitised files have."""
    if not isinstance(shape, Polygon) or rng.random() < 0.5:
        return shape
    ring = list(shape.exterior.coords)
    at = rng.randrange(1, len(ring) - 1)
    return Polygon([*ring[: at + 1], *ring[at:]], [hole.coords for hole in shape.interiors])


def _feature(shape, properties, **more):
    return {"type": "Feature", "properties": properties, "geometry": mapping(shape), **more}


def _shared(storey):
    """Return rooms whose common edges are on the centre lines of walls, and what walls may count as floor."""
    half = next(wall.thickness for wall in storey.walls if not wall.outer) / 2
    rooms = {room.name: room.polygon.buffer(half, join_style="mitre") for room in storey.rooms}
    return rooms, shapely.union_all(list(rooms.values())) - shapely.union_all([r.polygon for r in storey.rooms])


def _onto(door, shapes):
    """Return a door on the outline of the room that is nearest."""
    outline = min((shape.exterior for shape in shapes), key=lambda ring: ring.distance(door.segment.centroid))
    return LineString([outline.interpolate(outline.project(Point(p))) for p in door.segment.coords])


def _elements(truth, rng):
    """Return what a mapper draws of a building by Simple Indoor Tagging, as (shape, tags), and what walls are loose."""
    loose, found = [], []
    last = len(truth.storeys) - 1
    apart = rng.random() < 0.5  # Stairwells: a room on each level with a line of steps, or one area on all levels.
    lines = truth.storeys[0].rooms
    for k, storey in enumerate(truth.storeys):
        rooms, walls = _shared(storey)
        wells = [room.polygon.buffer(0.3) for room in storey.rooms if room.use in ("stairs",)]
        loose.append(shapely.union_all([walls, *wells]))
        for room in storey.rooms:
            tags = {"indoor": "corridor" if room.use == "corridor" else "room", "level": str(k)}
            if room.use == "office":
                tags |= {
                    "ref": room.name[-4:],
                    **rng.choice([{}, {"room": "office"}, {"name": f"Büro {room.name[-4:]}"}]),
                }
            elif room.use == "lift":
                if k:
                    continue
                tags |= {"highway": "elevator", "level": f"0-{last}"}
            elif room.use == "stairs":
                tags |= {"room": "stairs"} if apart else {"stairs": "yes", "level": f"0-{last}"}
                if k and not apart:
                    continue
            found.append((rooms[room.name], tags))
        for door in storey.doors:
            if door.kind == "lift" and rng.random() < 0.5:
                continue
            wide = f"{door.segment.length:.2f}"
            tags = {"door": rng.choice(["hinged", "yes"]), "level": str(k), "width": rng.choice([wide, wide + " m"])}
            if door.kind == "exit":
                tags["entrance"] = rng.choice(["yes", "main", "emergency"])
            shapes = [rooms[room.name] for room in storey.rooms]
            found.append((_onto(door, shapes).centroid, tags))
        if k == 0:
            outline = shapely.union_all(list(rooms.values())).buffer(0.001).buffer(-0.001)
            tags = {
                "building": "office",
                "building:levels": str(last + 1),
                "height": f"{truth.height * (last + 1):.1f}",
            }
            found.append((outline.exterior.convex_hull, {**tags, "name": "Amt", "addr:street": "Hauptstraße"}))
    for stair in truth.stairs if apart else ():
        ends = [stair.lower_edge.centroid, stair.upper_edge.centroid]
        if stair.kind == "turning":
            y = stair.landings[0][0].centroid.y
            ends[1:1] = [Point(ends[0].x, y), Point(ends[1].x, y)]
        tags = {"highway": "steps", "level": f"{stair.lower};{stair.lower + 1}", "incline": "up", "width": "1.2"}
        found.append((LineString(ends), {**tags, "indoor": "yes"} if rng.random() < 0.5 else tags))
    x1, y1, x2, _ = truth.storeys[0].outline.bounds
    outside = [
        (LineString([(x1 - 20, y1 - 6), (x2 + 20, y1 - 6)]), {"highway": "footway", "surface": "asphalt"}),
        (Point(x1 - 8, y1 - 4), {"natural": "tree"}),
        (Point(x1 + 3, y1 + 3), {"amenity": "vending_machine", "level": "0", "indoor": "yes"}),
        (box(x1 - 19, y1 - 20, x1 - 10, y1 - 12), {"building": "garage"}),
        (Point(lines[0].polygon.centroid), {"emergency": "fire_extinguisher", "level": "0"}),
    ]
    return found + [one for one in outside if rng.random() < 0.6], loose, apart


def osm(seed, folder):
    """The same as OpenStreetMap XML: nodes, ways with shared nodes, doors as nodes of the ways of rooms."""
    rng = random.Random(seed)
    truth = building(seed)
    elements, loose, _ = _elements(truth, rng)
    nodes, ways = {}, []

    def node(point, level=""):
        key = (*(round(float(c), 9) for c in _degrees(truth.placed(Point(point))).coords[0]), level)
        return nodes.setdefault(key, [-len(nodes) - 1 if seed % 2 else 1000 + len(nodes), {}])

    doors = [(shape, tags) for shape, tags in elements if isinstance(shape, Point)]
    for shape, tags in doors:
        node(shape.coords[0], tags.get("level", ""))[1].update(tags)
    for shape, tags in elements:
        if isinstance(shape, Point):
            continue
        line = shape.exterior if isinstance(shape, Polygon) else shape
        refs = [(line.project(Point(p)), node(p)[0]) for p in line.coords[: -1 if line.is_ring else None]]
        for door, own in doors if isinstance(shape, Polygon) and "indoor" in tags else ():
            if line.distance(door) < 1e-6 and own.get("level") == tags["level"]:
                refs.append((line.project(door), node(door.coords[0], own["level"])[0]))
        numbers = [ref for _, ref in sorted(refs)]
        ways.append((len(ways) + 1, [*numbers, numbers[0]] if line.is_ring else numbers, tags))
    lons, lats, _ = zip(*nodes, strict=True)
    lines = ["<?xml version='1.0' encoding='UTF-8'?>", "<osm version='0.6' generator='JOSM'>", "  <!-- exported -->"]
    lines.append(f"  <bounds minlat='{min(lats)}' minlon='{min(lons)}' maxlat='{max(lats)}' maxlon='{max(lons)}'/>")

    def tagged(head, tags, inner=()):
        texts = [*inner, *(f"    <tag k={quoteattr(k)} v={quoteattr(v)}/>" for k, v in tags.items())]
        return [f"  <{head}>", *texts, f"  </{head.split()[0]}>"] if texts else [f"  <{head}/>"]

    for (lon, lat, _), (number, tags) in nodes.items():
        lines += tagged(f"node id='{number}' version='1' visible='true' lat='{lat:.9f}' lon='{lon:.9f}'", tags)
    for number, refs, tags in ways:
        lines += tagged(f"way id='{number}' version='3'", tags, [f"    <nd ref='{ref}'/>" for ref in refs])
    lines += ["  <relation id='9'>", "    <member type='way' ref='1' role='outer'/>", "    <tag k='type' v='site'/>"]
    _from_origin(truth, (min(lons), min(lats)))
    path = folder / f"indoor_{seed}.osm"
    path.write_text("\n".join([*lines, "  </relation>", "</osm>", ""]), encoding="utf-8")
    return Stranger(truth, [path], loose, heights=False)


def imdf(seed, folder):
    """An archive of IMDF with the features that the specification demands, and some that it allows."""
    rng = random.Random(seed)
    truth = building(seed)
    shared = rng.random() < 0.5
    whole = rng.random() < 0.5  # A unit of stairs is the stairwell, or the flights within a room.
    files = {name: [] for name in ("venue", "building", "footprint", "level", "unit", "opening", "fixture", "amenity")}
    loose = []

    def add(kind, shape, properties, bare=False):
        number = str(uuid.UUID(int=rng.getrandbits(128)))
        feature = _feature(_degrees(truth.placed(shape)), properties, id=number, feature_type=kind)
        files[kind].append({**feature, "geometry": None} if bare else feature)
        return number

    def label(text):
        return {"en": text}

    outline = truth.storeys[0].outline
    ordinary = {"alt_name": None, "restriction": None, "display_point": None}
    add("venue", outline.buffer(3), {"category": "businesscampus", "name": label("Campus"), "address_id": None})
    house = add("building", outline, {"category": "unspecified", "name": label("House"), **ordinary}, bare=True)
    add("footprint", outline, {"category": "ground", "building_ids": [house], "name": None})
    first = rng.choice([0, 0, -1])
    for k, storey in enumerate(truth.storeys):
        ordinal = {"ordinal": k + min(first, 0), "short_name": label(str(k)), "building_ids": [house], "outdoor": False}
        about = {"category": "unspecified", "name": label(storey.name), **ordinal, **ordinary}
        level = add("level", storey.outline, about)
        rooms, walls = _shared(storey) if shared else ({r.name: r.polygon for r in storey.rooms}, Polygon())
        wells = [room.polygon.buffer(0.3) for room in storey.rooms if room.use == "stairs"]
        loose.append(shapely.union_all([walls, *wells]))
        for room in storey.rooms:
            category = {"corridor": "walkway", "lift": "elevator", "stairs": "stairs" if whole else "room"}
            category = category.get(room.use) or rng.choice(
                ["office", "room", "conferenceroom", "nonpublic", "restroom"]
            )
            shape = rooms[room.name]
            for stair in truth.stairs_at(k) if room.use == "stairs" and not whole else ():
                if stair.footprint.intersects(shape):
                    shape = shape - stair.footprint
            about = {"category": category, "accessibility": None, "level_id": level, "name": label(room.name)}
            add("unit", _doubled(shape, rng), {**about, **ordinary})
        for stair in {s.well: s for s in truth.stairs_at(k)}.values() if not whole else ():
            about = {"category": "stairs", "accessibility": None, "level_id": level, "name": None, **ordinary}
            add("unit", stair.footprint, about)
        for door in storey.doors:
            shape = _onto(door, [rooms[room.name] for room in storey.rooms])
            kind = "pedestrian"
            if door.kind == "exit" and (first or rng.random() < 0.5):
                kind += ".principal"
            door_type = {"type": rng.choice(["swinging", "sliding", "open"]), "automatic": False, "material": "wood"}
            about = {"category": kind, "accessibility": None, "access_control": None, "door": door_type}
            add("opening", shape, {**about, "level_id": level, "name": None, **ordinary})
        x, y = storey.rooms[1].polygon.centroid.coords[0]
        about = {"category": "furniture", "level_id": level, "anchor_id": None, "name": None, **ordinary}
        add("fixture", box(x, y, x + 0.5, y + 0.5), about)
        about = {"category": "seating", "unit_ids": [], "name": None, "correlation_id": None}
        add("amenity", Point(x, y), about)
    shapes = [shapely.geometry.shape(f["geometry"]) for found in files.values() for f in found if f["geometry"]]
    _from_origin(truth, shapely.total_bounds(shapes)[:2])
    path = folder / f"imdf_{seed}.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("manifest.json", json.dumps({"version": "1.0.0", "created": "2020-01-01", "language": "en"}))
        archive.writestr("address.geojson", json.dumps({"type": "FeatureCollection", "features": []}))
        for name, features in files.items():
            top = {"type": "FeatureCollection", "name": name, "features": features}
            archive.writestr(f"{name}.geojson", json.dumps(top))
    return Stranger(truth, [path], loose, heights=False)
