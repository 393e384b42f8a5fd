"""Importer of scenarios of Vadere: obstacles, targets, sources and stairs of its topography."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import FARTHEST
from evac.base.parameters import Parameter
from evac.building.geometry import flat_parts, place_of
from evac.building.importer import Importer
from evac.building.plan.plan import Plan

#: Lists of the topography that are read; distance at which a stair touches a floor [m].
READ, TOUCH = ("obstacles", "targets", "sources", "stairs"), 0.05


class VadereImporter(Importer):
    """Scenarios of Vadere (.scenario): the topography without its obstacles, targets as exits, sources as start areas.

    The topography is a plane. Floors that only stairs connect are at different heights, `rise` for each tread.
    """

    name = "vadere"
    suffixes = (".scenario",)

    rise = Parameter(0.17, "height of a tread of a stair", unit="m", above=0.0)

    def read(self, path: Path) -> Plan:
        """Read the topography; raise ValueError if the file has none."""
        plan = Plan(path)
        try:
            topography = json.loads(path.read_text(encoding="utf-8-sig"))["scenario"]["topography"]
            own = topography["attributes"]
            ground = _shape({**own["bounds"], "type": "RECTANGLE"})
            if own.get("bounded", True):
                ground = ground.buffer(-float(own.get("boundingBoxWidth", 0.5)), join_style="mitre")
            of = {key: [(one, _shape(one["shape"])) for one in topography.get(key) or []] for key in READ}
            exits = [one for one in of["targets"] if one[0].get("absorbing", one[0].get("absorber", {}).get("enabled"))]
            stairs = [(_edges(one, shape), self.rise * int(one.get("treadCount", 1))) for one, shape in of["stairs"]]
            counts = {key: len(given) for key, given in topography.items() if isinstance(given, list)}
        except (LookupError, TypeError, ValueError, AttributeError, RecursionError, shapely.GEOSException) as error:
            text = "the topography, or a shape or number of it, is missing or none"
            raise ValueError(f"not a scenario of Vadere: {text}") from error
        solid = shapely.union_all([shape for _, shape in (*of["obstacles"], *exits, *of["stairs"])])
        parts = [*shapely.get_parts(flat_parts(ground.difference(solid)))]
        if not parts:
            raise ValueError("the topography has no floor beside its obstacles, targets and stairs")
        heights = _heights(parts, stairs)
        names = {z: f"floor {number}" for number, z in enumerate(sorted(set(heights)), start=1)}
        for z, name in names.items():
            plan.storey(name, [part for part, height in zip(parts, heights, strict=True) if height == z], z)
        idle = counts | dict.fromkeys(READ, 0) | {"targets": len(of["targets"]) - len(exits)}
        for key, number in counts.items():
            plan.note("found", f"{number} {key}", element=key, number=number)
            if idle[key]:
                text = f"{idle[key]} {key}, which absorb nobody, or are not read"
                plan.note("left out", text, element=key, number=idle[key])
        rises = [({"id": number}, shapely.LineString(edges[0]).centroid) for number, (edges, _) in enumerate(stairs, 1)]
        for kind, items in (("target", exits), ("source", of["sources"]), ("stair", rises)):
            for one, shape in items:
                name, on = f"{kind} {one.get('id')}", [heights[k] for k in _at(parts, shape)]
                if not on:
                    plan.note("missing", f"{name} is not at the floor", place=place_of(shape), element=f"{kind}s")
                elif kind == "target":
                    plan.exit(name, names[on[0]], polygon=shape)
                elif kind == "source":
                    plan.area(name, names[on[0]], shape)
                else:
                    (low, up), rise = stairs[one["id"] - 1]
                    plan.flight(name, low, on[0], up, on[0] + rise)
                    plan.note("assumed", f"{name} rises {rise:.2f} m (rise)", names[on[0]], place_of(shape))
        return plan


def _heights(parts: list[BaseGeometry], stairs: list[tuple[FloatArray, float]]) -> list[float]:
    """Return the height of each part of the floor, the lowest of those that stairs join at 0."""
    heights, group = np.zeros(len(parts)), np.arange(len(parts))
    for edges, rise in stairs:
        low, up = (_at(parts, shapely.LineString(edge).centroid)[:1] for edge in edges)
        if low and up and group[low] != group[up]:
            own = group == group[up]
            heights[own] += heights[low] + rise - heights[up]
            group[own] = group[low]
    for rows in (group == one for one in set(group)):
        heights[rows] -= heights[rows].min()
    return [float(z) for z in heights.round(4)]


def _at(parts: list[BaseGeometry], shape: BaseGeometry) -> list[int]:
    return [k for k, part in enumerate(parts) if part.dwithin(shape, TOUCH)]


def _shape(given: Mapping[str, Any]) -> BaseGeometry:
    """Return a rectangle, polygon or circle of Vadere."""
    if given["type"] == "CIRCLE":
        shape = shapely.Point(given["center"]["x"], given["center"]["y"]).buffer(float(given["radius"]))
    elif given["type"] == "RECTANGLE":
        x, y, width, height = (float(given[key]) for key in ("x", "y", "width", "height"))
        shape = shapely.box(x, y, x + width, y + height)
    else:
        shape = shapely.make_valid(shapely.Polygon([(float(one["x"]), float(one["y"])) for one in given["points"]]))
    ground = flat_parts(shape)
    if not (np.abs(ground.bounds) <= FARTHEST).all():  # nor NaN, if it is empty; GEOS may loop far beyond
        raise ValueError("a shape has no area, or is too far away")
    return ground


def _edges(one: Mapping[str, Any], shape: BaseGeometry) -> FloatArray:
    """Return the lower and the upper edge (2, 2, 2) of a stair."""
    up = one.get("upwardDirection") or {"x": 1.0, "y": 0.0}
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:4]
    edges: FloatArray = corners[np.argsort(corners @ [float(up["x"]), float(up["y"])], kind="stable")].reshape(2, 2, 2)
    return edges
