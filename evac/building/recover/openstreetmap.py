"""OpenStreetMap XML (.osm) as a collection of GeoJSON features."""

import xml.etree.ElementTree as Tree
from collections.abc import Mapping
from typing import Any

import shapely
from shapely.geometry import mapping
from shapely.geometry.base import BaseGeometry

from evac.building.geometry import enclosed

#: Keys of closed ways that are lines and no areas, unless `area=yes` states it.
LINES = ("highway", "barrier", "railway", "waterway")


def features_of(text: str) -> dict[str, Any]:
    """Return the nodes, ways and multipolygons that have tags; raise ValueError if the text is none.

    Elements that are deleted, and ways of which nodes are missing, as at the border of an extract, are left out.
    """
    try:
        root = Tree.fromstring(text)
    except Tree.ParseError as error:
        raise ValueError(f"not OpenStreetMap XML: {error}") from error
    if root.tag != "osm":
        raise ValueError(f"not OpenStreetMap XML: the first element is <{root.tag}>")
    there = [one for one in root if one.get("action") != "delete" and one.get("visible") != "false"]
    nodes = {one.get("id"): (_number(one, "lon"), _number(one, "lat")) for one in there if one.tag == "node"}
    features, ways = [], {}
    for one in there:
        tags = {str(tag.get("k")): str(tag.get("v")) for tag in one.iter("tag")}
        shape: BaseGeometry | None = None
        if one.tag == "node" and tags:
            shape = shapely.Point(nodes[one.get("id")])
        elif one.tag == "way":
            corners = [nodes[ref] for nd in one.iter("nd") if (ref := nd.get("ref")) in nodes]
            if len(corners) < 2 or len(corners) < len([*one.iter("nd")]):
                continue
            ways[one.get("id")] = shapely.LineString(corners)
            shape = ways[one.get("id")]
            if len(corners) > 3 and corners[0] == corners[-1] and _is_area(tags):
                shape = shapely.Polygon(corners)
        elif one.tag == "relation" and tags.get("type") == "multipolygon":
            shape = _multipolygon(one, ways)
        if shape is not None and tags:
            label = f"{one.tag}/{one.get('id')}"
            features.append({"type": "Feature", "id": label, "properties": tags, "geometry": mapping(shape)})
    return {"type": "FeatureCollection", "features": features}


def _number(node: Tree.Element, key: str) -> float:
    try:
        if abs(number := float(node.get(key, ""))) <= 360.0:
            return number
    except ValueError:
        pass
    raise ValueError(f"node {node.get('id')}: {key} is {node.get(key)!r} and no angle in degrees")


def _is_area(tags: Mapping[str, str]) -> bool:
    is_line = any(key in tags for key in LINES) or tags.get("indoor") in ("wall", "pathway")
    return tags.get("area") == "yes" or not is_line or tags.get("highway") == "elevator"


def _multipolygon(relation: Tree.Element, ways: Mapping[str | None, BaseGeometry]) -> BaseGeometry | None:
    """Return the area within the outer ways of a relation and not within the inner ones; None if they do not close."""
    areas = []
    for role in ("outer", "inner"):
        refs = [one.get("ref") for one in relation.iter("member") if (one.get("role") or "outer") == role]
        areas.append(enclosed([ways[ref] for ref in refs if ref in ways]))
    area = areas[0].difference(areas[1])
    return None if area.is_empty else area
