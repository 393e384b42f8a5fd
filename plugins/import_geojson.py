"""Importer of GeoJSON files: storeys, exits, doors, areas and obstacles as features, see docs/buildings.md."""

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import NEGLIGIBLE
from evac.base.errors import BuildingError
from evac.base.parameters import Parameter, did_you_mean
from evac.building.geometry import flat_parts, lines_of, place_of
from evac.building.importer import Importer
from evac.building.model.findings import numbered
from evac.building.plan.outlines import distinct, geometries, with_walls
from evac.building.plan.plan import Plan
from evac.building.recover import indoormaps
from evac.building.recover.drawings import add_fitting
from evac.building.recover.linework import LEAST_CABIN, LEAST_ROOM, door_sides, hull_of, leads_out
from evac.building.recover.openstreetmap import features_of

#: Values of the property ``kind`` of a feature.
KINDS = ("storey", "room", "corridor", "area", "obstacle", "exit", "door", "opening")
#: Those of polygons that people walk on; how alike another word may be to a kind without being one with a mistake.
GROUNDS, ALIKE = KINDS[:3], 0.75
#: Beginnings of the descriptions of ground that is lost.
GROUND = ("way ", "room ", "ground ")
#: Kinds of features of an exported building, of which some follow from the others.
DERIVED = ("wall", "portal", "refuge", "assembly", "sign", "line")
EXPORTED = ("floor", "flight", "landing", "exit", "door", "area", *DERIVED)
#: Properties of features; others may be there beside them, or with the name or number of a feature alone.
KNOWN, LABELS = {"kind", "name", "storey", "level", "z"}, {"id", "fid", "objectid", "ogc_fid"}
#: Thickness of walls between rooms of indoor maps with doors, if none is given [m].
INDOOR_WALL = 0.1
#: Points of a line that deviate by less are on one straight line [m]; polygons this near a door are at it [m].
STRAIGHT, AT_DOOR = 0.01, 0.01
#: Polygons that rise by more above their base, which is lower than heads, are no ground if there are others [m].
STEP, HEADS = 0.3, 1.8
#: Largest content of an archive [bytes]; largest coordinate [units], beyond which GEOS may loop.
MOST_BYTES, LARGEST = 500_000_000, 1e12
#: Largest extent of a building with coordinates in degrees [degrees].
MOST_DEGREES = 0.05
#: Semi-axes of the WGS 84 ellipsoid [m].
MAJOR, MINOR = 6378137.0, 6356752.314245


class GeojsonImporter(Importer):
    """GeoJSON (.geojson, .json): features with the properties `kind`, `name`, `storey` (or `level`) and `z`.

    Without `kind`, polygons are the ground of their storey, and lines exits, or doors between two rooms. Indoor maps of
    IMDF (also as .zip), OpenStreetMap (also as .osm) and wrld3d are read by their own properties, and so is an export
    of evac.
    """

    name = "geojson"
    suffixes = (".geojson", ".json", ".zip", ".osm")

    storey = Parameter("floor", "name of the storey of features without storey")
    z = Parameter(0.0, "height of the lowest storey without z", unit="m")
    height = Parameter(3.0, "height between consecutive storeys without z", unit="m", above=0.0)
    unit = Parameter(1.0, "metres per unit of the coordinates", unit="m", above=0.0)
    wall = Parameter(
        0.0, "thickness of walls between polygons that touch; 0: none without doors between them", unit="m", minimum=0.0
    )
    coordinates = Parameter("auto", "plane, or degrees of longitude and latitude", choices=("auto", "plane", "degrees"))

    def read(self, path: Path) -> Plan:
        """Read the features; raise ValueError if the file is not GeoJSON."""
        try:
            is_xml = path.suffix.lower() == ".osm"
            documents = [features_of(text) if is_xml else json.loads(text) for text in _texts(path)]
        except (json.JSONDecodeError, RecursionError) as error:
            raise ValueError(f"invalid JSON: {error}") from error
        if len(documents) == 1 and _are_exported(documents[0]):
            return _plan_of_features(documents[0]["features"], path)
        objects = [item for document in documents for item in _objects(document)]
        names = {name for item in objects for name in _properties(item)}
        profile = next((one for one, keys in indoormaps.PROFILES.items() if names & {*keys}), "")
        profile = indoormaps.OSM if is_xml else "" if "kind" in names else profile
        if not profile and names and not {name.lower() for name in names} & (KNOWN | LABELS):
            raise BuildingError(
                f"{path}: features have the properties {', '.join(sorted(names)[:12])}, which are not those of evac "
                f"nor of {', '.join(indoormaps.PROFILES)}; give every feature a kind ({', '.join(KINDS)}) and a storey"
            )
        features = [_feature(number, item, profile) for number, item in enumerate(objects, start=1)]
        if not features:
            raise ValueError("the file contains no feature with a geometry")
        plan = Plan(path)
        ground = [row for row, one in enumerate(features) if one.kind == "storey"]
        solid = [row for row in ground if _rises(_properties(objects[row]))]
        if 0 < len(solid) < len(ground):
            for row in solid:
                features[row] = replace(features[row], kind="obstacle")
            text = f"{len(solid)} polygons that rise above the ground (height, base_height) are obstacles"
            plan.note("assumed", f"{text}, such as feature {features[solid[0]].number}")
        place = self._placing(plan, [feature.shape for feature in features], are_degrees=is_xml)
        features = [replace(feature, shape=place(feature.shape)) for feature in features]
        if profile:
            plan.note("found", f"an indoor map of {profile}")
            for row, one in enumerate(features):
                if not one.shape.is_valid:
                    text = f"feature {one.number}: {shapely.is_valid_reason(one.shape).partition('[')[0]}"
                    plan.note("repaired", text, place=place_of(one.shape))
                    whole = shapely.make_valid(one.shape, method="structure", keep_collapsed=False)
                    features[row] = replace(one, shape=whole)
            labels = ({key: item[key] for key in ("id", "feature_type") if key in item} for item in objects)
            own = [{**_properties(item), **of} for item, of in zip(objects, labels, strict=True)]
            shapes = [one.shape for one in features]
            storeys, steps, nowhere = indoormaps.read_map(profile, [*zip(own, shapes, strict=True)])
            plan.note("found", f"{len(features)} features", element="feature", number=len(features))
            self._add_map(plan, storeys, steps, nowhere)
            _note_lost(plan, nowhere)
        else:
            for kind, number in Counter(one.kind or "line" for one in features).items():
                plan.note("found", f"{number} features of the kind {kind}", element=kind, number=number)
            self._add_storeys(plan, [one for one in features if one.kind in ("", *KINDS)])
            area = sum(one.shape.area for one in features if one.kind in GROUNDS)
            for one in (one for one in features if one.kind not in ("", *KINDS)):
                lost = "missing" if one.shape.area > NEGLIGIBLE * area else "left out"
                text = f"feature {one.number}: kind {one.kind!r} is none of {', '.join(KINDS)}"
                plan.note(lost, text, place=place_of(one.shape), element=one.kind)
        return plan

    def _add_map(
        self,
        plan: Plan,
        storeys: Sequence[indoormaps.Storey],
        steps: Sequence[indoormaps.Steps],
        nowhere: list[tuple[str, BaseGeometry]],
    ) -> None:
        """Add the storeys and stairs of an indoor map, and to what is on no storey what is left out of them."""
        if not storeys:
            raise ValueError("the indoor map has no room, corridor or unit that people can walk in")
        ground = min(storeys, key=lambda one: abs(one.order))
        named = {storey.name: storey for storey in storeys}
        heights = {one.name: self.z + (one.order - storeys[0].order) * self.height for one in storeys}
        flights = []
        for one in steps:
            low, up = (named[name] for name in one.levels)
            flights.append(indoormaps.pieces_of(indoormaps.laid(one, low, up, heights[up.name] - heights[low.name])))
        for one, (edges, landings) in zip(steps, flights, strict=True):
            pieces = [shapely.MultiPoint(edge.reshape(-1, 2)).convex_hull for edge in edges]
            for name in one.levels:
                named[name].steps += [*pieces, *landings]
        for storey in storeys:
            is_ground = storey.order == ground.order
            nowhere += self._add_level(plan, storey, heights[storey.name], "exit" if is_ground else "opening")
        numbers = range(1, len(steps) + 1)
        stairs = [(f"{one.name} {k}", one, own) for k, one, own in zip(numbers, steps, flights, strict=True)]
        faults = add_fitting(
            plan, {name: partial(_add_stair, plan, name, one, own, heights) for name, one, own in stairs}
        )
        for name, one, _ in stairs:
            if name in faults:
                text = f"stair {name!r} from {one.levels[0]!r} to {one.levels[1]!r}: {faults[name]}"
                plan.note("missing", text, one.levels[0], place_of(one.line), element="feature")
                continue
            plan.note("found", f"stair {name!r}", one.levels[0], place_of(one.line))
            if not one.is_directed:
                plan.note("assumed", f"stair {name!r} ascends in the order of its points", one.levels[0])

    def _add_level(
        self, plan: Plan, storey: indoormaps.Storey, z: float, outside: str
    ) -> list[tuple[str, BaseGeometry]]:
        """Add one storey of an indoor map; return what is left out. Its rooms have walls if most of them have doors."""
        solid = shapely.union_all([*storey.solids, *storey.steps])
        rooms = [shape for _, shape in storey.rooms]
        has_walls = 2 * sum(room.dwithin(storey.outlets, indoormaps.BESIDE) for room in rooms) >= len(rooms) > 0
        spaces = storey.spaces() if has_walls else [shapely.union_all([*storey.ways, *rooms])]
        parts = [one for space in spaces for one in shapely.get_parts(flat_parts(space.difference(solid)))]
        if has_walls and parts:
            parts = indoormaps.agreeing(parts, shapely.get_coordinates(storey.steps))
        parts = [one for one in parts if one.area > LEAST_CABIN]
        small = [one for one in parts if one.area < LEAST_ROOM and not one.dwithin(storey.outlets, indoormaps.BESIDE)]
        parts = [one for one in parts if one not in small]
        wall = self.wall or (INDOOR_WALL if has_walls else 0.0)
        floor = shapely.union_all(with_walls(distinct(parts), wall) if has_walls else parts)
        plan.storey(storey.name, parts, z, wall=wall)
        plan.note("found", f"{len(rooms)} rooms and {len(storey.ways)} ways", storey.name)
        if rooms and not has_walls:
            text = (
                f"the map has {len(storey.doors)} doors for {len(rooms)} rooms: rooms that touch are open to each other"
            )
            plan.note("assumed", text, storey.name)
        hull = hull_of(floor)
        for number, door in enumerate(storey.doors, start=1):
            label = f"{storey.name} {door.name or 'door'} {number}"
            self._add_door(plan, storey, door, label, parts, floor, hull, outside)
        for number, (name, shape) in enumerate(storey.rooms, start=1):
            whole = shape.buffer(indoormaps.SAME, join_style="mitre") if has_walls else shape  # to its walls
            own = flat_parts(whole & floor)
            plan.area(f"{storey.name} {name or 'room'} {number}", storey.name, shape if own.is_empty else own)
        return [(f"ground of less than {LEAST_ROOM:g} m2 without a door", one) for one in small]

    def _add_door(
        self,
        plan: Plan,
        storey: indoormaps.Storey,
        door: indoormaps.MapDoor,
        label: str,
        spaces: Sequence[BaseGeometry],
        floor: BaseGeometry,
        hull: BaseGeometry,
        outside: str,
    ) -> None:
        """Add one door of an indoor map, or say why it is none."""
        ends, place = indoormaps.door_at(door.shape, door.width, spaces), place_of(door.shape)
        leads = ends is not None and bool(leads_out(ends.reshape(1, 4), hull)[0])
        if ends is not None:
            ends = indoormaps.at_wall(ends, floor, leads_out=leads)
        sides = 0 if ends is None else int(door_sides(ends.reshape(1, 4), floor)[0])
        if sides < 2 and shapely.union_all(storey.shafts).dwithin(door.shape, indoormaps.BESIDE):
            kind, text = "left out", "a door to a lift, a shaft or a void"
        elif ends is not None and sides == 1 and door_sides(ends, shapely.union_all([floor, *storey.steps]))[0] == 2:
            kind, text = "missing", "a door to the side of steps; draw a stair that begins behind it"
        elif ends is None or sides == 0 or (sides == 1 and not leads):
            kind, text = "left out", "a door that joins nothing"
        else:
            outside = "exit" if door.is_entrance else outside
            plan.door(label, storey.name, ends, outside=outside)
            plan.note("found", f"{'door' if sides == 2 else outside} {label!r}", storey.name, place)
            return
        plan.note(kind, f"{label!r}: {text}", storey.name, place, element="feature")

    def _placing(
        self, plan: Plan, shapes: list[BaseGeometry], *, are_degrees: bool
    ) -> Callable[[BaseGeometry], BaseGeometry]:
        """Return the function that converts coordinates of the file to metres."""
        corners = shapely.get_coordinates(shapes)
        low, high = corners.min(axis=0), corners.max(axis=0)
        is_small = bool((high - low).max() < MOST_DEGREES and np.abs(corners).max() <= 180.0)
        is_plane = not (are_degrees or (is_small and self.unit == 1.0))
        if self.coordinates == "plane" or (self.coordinates == "auto" and is_plane):
            return lambda shape: shapely.transform(shape, lambda xy: self.unit * xy)
        plan.north = 0.0
        metres = _metres_per_degree(math.radians(0.5 * (low[1] + high[1])))
        text = f"coordinates are longitude and latitude with the origin {low[0]:.7f}, {low[1]:.7f} (coordinates)"
        plan.note("assumed", text)
        return lambda shape: shapely.transform(shape, lambda xy: (xy - low) * metres)

    def _add_storeys(self, plan: Plan, features: "list[Feature]") -> None:
        """Add the features to the plan, storey by storey."""
        names = list(dict.fromkeys(feature.storey or self.storey for feature in features))
        ground = {name: [one for one in features if (one.storey or self.storey) == name] for name in names}
        for index, name in enumerate(names):
            floors = [one for one in ground[name] if one.kind in GROUNDS]
            labels = Counter(one.name for one in floors)
            named = [one for one in floors if one.name and labels[one.name] == 1 < len(floors)]
            rooms = [one for one in named if one.shape.geom_type == "Polygon"]
            given = sorted({one.z for one in ground[name] if one.z is not None})
            if not floors:
                raise ValueError(f"storey {name!r} has no ground; add a polygon of the kind 'storey'")
            if len(given) > 1:
                raise ValueError(f"storey {name!r} must have one height z, not {', '.join(f'{z:g}' for z in given)}")
            z = given[0] if given else self.z + index * self.height
            doors = [one.shape.centroid for one in ground[name] if one.shape.geom_type == "LineString"]
            shapes = [one.shape for one in floors]
            divides = not self.wall and any((shapely.distance(shapes, door) <= AT_DOOR).sum() > 1 for door in doors)
            wall = INDOOR_WALL if divides else self.wall
            plan.storey(name, [one.shape for one in floors if one not in rooms] or None, z, wall=wall)
            if divides:
                text = f"walls of {wall:g} m between polygons that touch, since doors are drawn between them (wall)"
                plan.note("assumed", text, name)
            for one in rooms:
                use = None if one.kind == "storey" else one.kind
                plan.room(numbered(one.name, {room.name for room in plan.rooms}), name, one.shape, use=use)
            plan.note("found", f"{len(floors)} polygons of ground", name)
            if not given and len(names) > 1:
                plan.note("assumed", f"z = {z:g} m, since the storey has no z (z, height)", name)
            for number, one in enumerate((one for one in ground[name] if one.kind not in GROUNDS), start=1):
                self._add(plan, one, name, one.name or f"{one.kind or 'exit'} {number}")

    def _add(self, plan: Plan, feature: "Feature", storey: str, name: str) -> None:
        """Add one feature that is not ground."""
        sides = lines_of(feature.shape.simplify(STRAIGHT)) if feature.shape.geom_type == "LineString" else []
        if feature.kind in ("door", "opening") and len(sides) != 1:
            raise ValueError(f"feature {feature.number}: a {feature.kind} must be a straight LineString")
        if not feature.kind and len(sides) == 1:
            plan.door(name, storey, sides[0], outside="exit")
        elif feature.kind in ("", "exit") and sides:
            plan.exit(name, storey, [shapely.get_coordinates(side).tolist() for side in sides])
        elif feature.kind == "exit":
            plan.exit(name, storey, polygon=feature.shape)
        elif feature.kind == "door":
            plan.door(name, storey, sides[0], outside="opening")
        elif feature.kind == "opening":
            plan.opening(storey, sides[0], name)
        else:
            getattr(plan, feature.kind)(name, storey, feature.shape)
        plan.note("found", f"{feature.kind or 'exit or door'} {name!r}", storey, place_of(feature.shape))


@dataclass(frozen=True)
class Feature:
    """A feature: number in the file, shape, and kind, name, storey and height if they are given."""

    number: int
    shape: BaseGeometry
    kind: str
    name: str
    storey: str
    z: float | None


def _texts(path: Path) -> list[str]:
    """Return the text of a file, or of the files in an archive."""
    try:
        if path.suffix.lower() != ".zip":
            return [path.read_text(encoding="utf-8-sig")]
        with ZipFile(path) as archive:
            names = [one for one in archive.infolist() if one.filename.lower().endswith((".geojson", ".json"))]
            names = [name for name in names if not name.filename.rpartition("/")[2].startswith(("manifest", "."))]
            if sum(name.file_size for name in names) > MOST_BYTES:
                raise ValueError(f"the archive contains more than {MOST_BYTES} bytes")
            return [archive.read(name).decode("utf-8-sig") for name in names]
    except (BadZipFile, UnicodeDecodeError) as error:
        raise ValueError(f"cannot be read: {error}") from error


def _add_stair(
    plan: Plan,
    name: str,
    one: indoormaps.Steps,
    pieces: tuple[list[FloatArray], list[BaseGeometry]],
    heights: Mapping[str, float],
) -> None:
    """Add a stair of an indoor map; its flights ascend by their lengths."""
    flights, landings = pieces
    if len(flights) == 1:
        plan.stair(name, one.levels[0], flights[0][0], one.levels[1], flights[0][1])
        return
    lengths = np.hypot(*np.diff([edges.mean(axis=1) for edges in flights], axis=1)[:, 0].T)
    low, up = (heights[level] for level in one.levels)
    ends = np.append(low + (up - low) * np.cumsum([0.0, *lengths[:-1]]) / lengths.sum(), up)
    for edges, z1, z2 in zip(flights, ends.tolist(), ends[1:].tolist(), strict=False):
        plan.flight(name, edges[0], z1, edges[1], z2)
    for landing, z in zip(landings, ends[1:].tolist(), strict=False):
        plan.landing(name, landing, z)


def _note_lost(plan: Plan, nowhere: Sequence[tuple[str, BaseGeometry]]) -> None:
    """Add findings on features that are on no storey; ground among them is missing if it is more than negligible."""
    ground = sum(part.area for storey in plan.storeys.values() for part in storey.polygons)
    is_lost = sum(shape.area for text, shape in nowhere if text.startswith(GROUND)) > NEGLIGIBLE * ground
    for text, number in Counter(text for text, _ in nowhere).items():
        shape = next(shape for other, shape in nowhere if other == text)
        kind = "missing" if is_lost and text.startswith(GROUND) else "left out"
        place = None if shape.is_empty else place_of(shape)
        plan.note(kind, text, place=place, element="feature", number=number)


def _objects(data: Any) -> list[Mapping[str, Any]]:
    """Return the features of a document; a single geometry is returned as one feature."""
    if not isinstance(data, dict) or "type" not in data:
        raise ValueError("not GeoJSON: the document is not an object with a type")
    if data["type"] == "FeatureCollection":
        features = data.get("features")
        if not isinstance(features, list):
            raise ValueError("invalid GeoJSON: the collection has no list of features")
        return [item for item in features if not isinstance(item, dict) or item.get("geometry") is not None]
    return [data if data["type"] == "Feature" else {"type": "Feature", "geometry": data, "properties": {}}]


def _properties(item: object) -> Mapping[str, Any]:
    """Return the properties of a feature; empty for anything else."""
    found = item.get("properties") if isinstance(item, Mapping) else None
    if not isinstance(found, Mapping):
        return {}
    # Exports of OpenStreetMap have the tags of a feature, and those of the relations that it belongs to, in tables.
    relations = found.get("relations")
    tables = (
        [one.get("reltags") for one in relations if isinstance(one, Mapping)] if isinstance(relations, list) else []
    )
    nested = [one for one in (*tables, found.get("tags")) if isinstance(one, Mapping)]
    return {key: value for table in (*nested, found) for key, value in table.items()}


def _rises(own: Mapping[str, Any]) -> bool:
    """Return whether the properties `height` and `base_height` of a feature make it a body in the way of people."""
    height, base = own.get("height"), own.get("base_height", 0.0)
    is_given = all(isinstance(one, int | float) for one in (height, base)) and own.get("kind") is None
    return is_given and base < HEADS and height - base > STEP


def _feature(number: int, given: Any, profile: str) -> Feature:
    """Return one feature, checked."""
    if not isinstance(given, dict) or given.get("type") != "Feature":
        raise ValueError(f"feature {number}: not a GeoJSON feature")
    properties = _properties(given)
    try:
        shapes = list(geometries(given))
    except ValueError as error:
        raise ValueError(f"feature {number}: {error}") from error
    if not shapes or not (np.abs(shapely.get_coordinates(shapes)) <= LARGEST).all():
        raise ValueError(f"feature {number}: coordinates are missing, not finite or larger than {LARGEST:g}")
    shape = shapes[0] if len(shapes) == 1 else shapely.GeometryCollection(shapes)
    if profile:
        return Feature(number, shape, "", "", "", None)
    usual = {"LineString": "", "Point": "point"}.get(shape.geom_type, "storey")
    kind = str(properties.get("kind") or usual).lower()
    if kind and kind not in KINDS and get_close_matches(kind, KINDS, cutoff=ALIKE):
        raise ValueError(f"feature {number}: unknown kind {kind!r}; {did_you_mean(kind, KINDS)}")
    z = properties.get("z")
    if z is not None and (isinstance(z, bool) or not isinstance(z, int | float)):
        raise ValueError(f"feature {number}: z must be a number, not {z!r}")
    storey = properties.get("storey", properties.get("level"))
    name = properties.get("name")
    return Feature(number, shape, kind, "" if name is None else str(name), "" if storey is None else str(storey), z)


def _are_exported(data: Any) -> bool:
    """Return whether a document is a building as evac exports it."""
    features = data.get("features") if isinstance(data, Mapping) else None
    return isinstance(features, list) and any(_properties(feature).get("kind") == "floor" for feature in features)


def _plan_of_features(features: Sequence[Any], source: Path) -> Plan:
    """Return the plan of a building that evac has exported: floors, flights, landings, exits, doors and areas."""
    plan = Plan(source, headroom=0.0)
    for number, feature in enumerate(features, start=1):
        own = _properties(feature)
        kind = own.get("kind")
        if kind not in EXPORTED:
            raise ValueError(f"feature {number}: unknown kind {kind!r}; {did_you_mean(str(kind), EXPORTED)}")
        if own.get("open") is False:
            plan.note("warning", f"{kind} {own.get('name')!r} was closed at the start; building.closed keeps it so")
        if kind in DERIVED:
            continue
        try:
            shapes = list(geometries(feature))
            name, level = str(own["name"]), str(own["levels"][0])
            if kind == "floor":
                plan.storey(name, shapes, own["z_min"])
            elif kind == "flight":
                plan.flight(str(own["stair"]), polygon=shapes)
            elif kind == "landing":
                plan.landing(str(own["stair"]), shapes, own["z_min"])
            elif kind == "exit":
                lines = [shapely.get_coordinates(line).tolist() for line in shapes]
                plan.exit(name, level, lines[0] if len(lines) == 1 else lines)
            elif kind == "door":
                plan.door(name, level, shapely.get_coordinates(shapes))
            else:
                plan.area(name, level, shapes)
        except (KeyError, IndexError, TypeError) as error:
            text = f"feature {number}: a {kind} needs name, levels, z_min and stair as evac exports them"
            raise ValueError(text) from error
    return plan


def _metres_per_degree(latitude: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the lengths (2,) of a degree of longitude and of latitude on the WGS 84 ellipsoid [m]."""
    square = 1.0 - (MINOR / MAJOR) ** 2
    flattened = 1.0 - square * math.sin(latitude) ** 2
    across, along = MAJOR / math.sqrt(flattened), MAJOR * (1.0 - square) / flattened**1.5
    return np.radians([across * math.cos(latitude), along])
