"""Importer of GeoJSON files: storeys, exits, doors, areas and obstacles as features, see docs/buildings.md."""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.errors import BuildingError
from evac.base.parameters import Parameter, did_you_mean
from evac.building.geometry.overlays import place_of
from evac.building.importer import Importer
from evac.building.plan.features import are_exported, plan_of_features
from evac.building.plan.plan import Plan
from evac.building.plan.shapes import geometries

#: Values of the property ``kind`` of a feature.
KINDS = ("storey", "area", "obstacle", "exit", "door", "opening")
#: Properties by which indoor maps are known, in which polygons are not the ground of a storey.
INDOOR_MAPS = {"level_id": "IMDF", "indoor": "OpenStreetMap", "roomnumber": "wrld3d"}
#: Largest extent of a building with coordinates in degrees [degrees].
MOST_DEGREES = 0.05
#: Semi-axes of the WGS 84 ellipsoid [m].
MAJOR, MINOR = 6378137.0, 6356752.314245


class GeojsonImporter(Importer):
    """GeoJSON (.geojson, .json): features with the properties `kind`, `name`, `storey` (or `level`) and `z`.

    Without `kind`, polygons are the ground of their storey and lines are exits. A building that evac has exported to
    GeoJSON is read too.
    """

    name = "geojson"
    suffixes = (".geojson", ".json")

    storey = Parameter("floor", "name of the storey of features without storey")
    z = Parameter(0.0, "height of the lowest storey, for storeys without z", unit="m")
    height = Parameter(3.0, "height between consecutive storeys without z", unit="m", above=0.0)
    unit = Parameter(1.0, "metres per unit of the coordinates", unit="m", above=0.0)
    wall = Parameter(0.0, "thickness of walls between polygons that touch; 0 joins them", unit="m", minimum=0.0)
    coordinates = Parameter("auto", "plane, or degrees of longitude and latitude", choices=("auto", "plane", "degrees"))

    def read(self, path: Path) -> Plan:
        """Read the features; raise ValueError if the file is not GeoJSON."""
        try:
            data = json.loads(path.read_text(encoding="utf-8-sig"))
        except (json.JSONDecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ValueError(f"invalid JSON: {error}") from error
        if are_exported(data):
            return plan_of_features(data["features"], path)
        names = {name for item in _objects(data) for name in _properties(item)}
        foreign = names & INDOOR_MAPS.keys()
        if foreign and "kind" not in names:
            maps = " and ".join(f"{key!r} of {INDOOR_MAPS[key]}" for key in sorted(foreign))
            raise BuildingError(
                f"{path}: indoor maps are not read: features have the property {maps}, and none has a kind; give "
                f"every feature a kind ({', '.join(KINDS)}) and a storey"
            )
        features = [_feature(number, item) for number, item in enumerate(_objects(data), start=1)]
        if not features:
            raise ValueError("the file contains no feature with a geometry")
        plan = Plan(path)
        place = self._placing(plan, [feature.shape for feature in features])
        self._add_storeys(plan, [replace(feature, shape=place(feature.shape)) for feature in features])
        return plan

    def _placing(self, plan: Plan, shapes: list[BaseGeometry]) -> Callable[[BaseGeometry], BaseGeometry]:
        """Return the function that converts coordinates of the file to metres."""
        corners = shapely.get_coordinates(shapes)
        low, high = corners.min(axis=0), corners.max(axis=0)
        is_small = bool((high - low).max() < MOST_DEGREES and np.abs(corners).max() <= 180.0)
        if self.coordinates == "plane" or (self.coordinates == "auto" and not (is_small and self.unit == 1.0)):
            return lambda shape: shapely.transform(shape, lambda xy: self.unit * xy)
        metres = _metres_per_degree(math.radians(0.5 * (low[1] + high[1])))
        text = f"coordinates are longitude and latitude with the origin {low[0]:.7f}, {low[1]:.7f} (coordinates)"
        plan.note("assumed", text)
        return lambda shape: shapely.transform(shape, lambda xy: (xy - low) * metres)

    def _add_storeys(self, plan: Plan, features: "list[Feature]") -> None:
        """Add the features to the plan, storey by storey."""
        names = list(dict.fromkeys(feature.storey or self.storey for feature in features))
        ground = {name: [one for one in features if (one.storey or self.storey) == name] for name in names}
        for index, name in enumerate(names):
            polygons = [one.shape for one in ground[name] if one.kind == "storey"]
            given = sorted({one.z for one in ground[name] if one.z is not None})
            if not polygons:
                raise ValueError(f"storey {name!r} has no ground; add a polygon of the kind 'storey'")
            if len(given) > 1:
                raise ValueError(f"storey {name!r} must have one height z, not {', '.join(f'{z:g}' for z in given)}")
            z = given[0] if given else self.z + index * self.height
            plan.storey(name, polygons, z, wall=self.wall)
            plan.note("found", f"{len(polygons)} polygons of ground", name)
            if not given and len(names) > 1:
                plan.note("assumed", f"z = {z:g} m, since the storey has no z (z, height)", name)
            for number, one in enumerate((one for one in ground[name] if one.kind != "storey"), start=1):
                self._add(plan, one, name, one.name or f"{one.kind} {number}")

    def _add(self, plan: Plan, feature: "Feature", storey: str, name: str) -> None:
        """Add one feature that is not ground."""
        is_line = feature.shape.geom_type == "LineString"
        if feature.kind in ("door", "opening") and not is_line:
            raise ValueError(f"feature {feature.number}: a {feature.kind} must be a LineString of two points")
        if feature.kind == "exit" and is_line:
            plan.exit(name, storey, feature.shape)
        elif feature.kind == "exit":
            plan.exit(name, storey, polygon=feature.shape)
        elif feature.kind == "door":
            plan.door(name, storey, feature.shape, outside="opening")
        elif feature.kind == "opening":
            plan.opening(storey, feature.shape, name)
        else:
            getattr(plan, feature.kind)(name, storey, feature.shape)
        plan.note("found", f"{feature.kind} {name!r}", storey, place_of(feature.shape))


@dataclass(frozen=True)
class Feature:
    """A feature: number in the file, shape, and kind, name, storey and height if they are given."""

    number: int
    shape: BaseGeometry
    kind: str
    name: str
    storey: str
    z: float | None


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
    return found if isinstance(found, Mapping) else {}


def _feature(number: int, given: Any) -> Feature:
    """Return one feature, checked."""
    if not isinstance(given, dict) or given.get("type") != "Feature":
        raise ValueError(f"feature {number}: not a GeoJSON feature")
    properties = given.get("properties") or {}
    try:
        shapes = list(geometries(given))
    except ValueError as error:
        raise ValueError(f"feature {number}: {error}") from error
    if not shapes or not np.isfinite(shapely.get_coordinates(shapes)).all():
        raise ValueError(f"feature {number}: coordinates are missing or not finite")
    shape = shapes[0] if len(shapes) == 1 else shapely.GeometryCollection(shapes)
    kind = str(properties.get("kind") or ("exit" if shape.geom_type == "LineString" else "storey")).lower()
    if kind not in KINDS:
        raise ValueError(f"feature {number}: unknown kind {kind!r}; {did_you_mean(kind, KINDS)}")
    z = properties.get("z")
    if z is not None and (isinstance(z, bool) or not isinstance(z, int | float)):
        raise ValueError(f"feature {number}: z must be a number, not {z!r}")
    storey = properties.get("storey", properties.get("level"))
    name = properties.get("name")
    return Feature(number, shape, kind, "" if name is None else str(name), "" if storey is None else str(storey), z)


def _metres_per_degree(latitude: float) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Return the lengths (2,) of a degree of longitude and of latitude on the WGS 84 ellipsoid [m]."""
    square = 1.0 - (MINOR / MAJOR) ** 2
    flattened = 1.0 - square * math.sin(latitude) ** 2
    across, along = MAJOR / math.sqrt(flattened), MAJOR * (1.0 - square) / flattened**1.5
    return np.radians([across * math.cos(latitude), along])


evac_interface = 3
