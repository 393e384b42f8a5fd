"""Importer of scenarios of Vadere: obstacles, targets, sources and stairs of its topography."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

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
            of["targets"] = exits
            stairs = [(*_edges(*one), self.rise * int(one[0].get("treadCount", 1))) for one in of["stairs"]]
        except (LookupError, TypeError, ValueError, AttributeError, RecursionError, shapely.GEOSException) as error:
            raise ValueError("not a scenario of Vadere: its topography, or a shape of it, is missing") from error
        solid = shapely.union_all([shape for key in READ if key != "sources" for _, shape in of[key]])
        parts = shapely.get_parts(flat_parts(ground.difference(solid)))
        if not len(parts):
            raise ValueError("the topography has no floor beside its obstacles, targets and stairs")
        heights = np.zeros(len(parts))
        links = [([shapely.dwithin(parts, edge.centroid, TOUCH) for edge in edges], rise) for *edges, rise in stairs]
        for (low, up), rise in links * len(links):  # as far as stairs lead over stairs
            if low.any() and not (low & up).any():
                heights[up] = np.maximum(heights[up], heights[low].min() + rise).round(4)
        for z in np.unique(heights).tolist():
            plan.storey(f"z {z:g}", [*parts[heights == z]], z)
        for key, number in ((key, len(given)) for key, given in topography.items() if isinstance(given, list)):
            plan.note("found", f"{number} {key}", element=key, number=number)
            if idle := number - len(of.get(key, [])):
                text = f"{idle} {key}, which absorb nobody, or are not read"
                plan.note("left out", text, element=key, number=idle)
        rises = {f"stair {number}": stair for number, stair in enumerate(stairs, start=1)}
        places = [(f"{key[:-1]} {one.get('id')}", shape) for key in ("targets", "sources") for one, shape in of[key]]
        for name, shape in [*places, *((name, low.centroid) for name, (low, _, _) in rises.items())]:
            z = heights[shapely.dwithin(parts, shape, TOUCH)].tolist()
            if not z:
                plan.note("missing", f"{name} is not at a floor", place=place_of(shape), element=name.split()[0] + "s")
            elif name in rises:
                low, up, rise = rises[name]
                plan.flight(name, low, z[0], up, z[0] + rise)
                plan.note("assumed", f"{name} rises {rise:.2f} m (rise)", f"z {z[0]:g}", place_of(shape))
            elif name.startswith("target"):
                plan.exit(name, f"z {z[0]:g}", polygon=shape)
            else:
                plan.area(name, f"z {z[0]:g}", shape)
        return plan


def _shape(given: Mapping[str, Any]) -> shapely.Geometry:
    """Return a rectangle, polygon or circle of Vadere."""
    if given["type"] == "CIRCLE":
        shape = shapely.Point(given["center"]["x"], given["center"]["y"]).buffer(float(given["radius"]))
    elif given["type"] == "RECTANGLE":
        x, y, width, height = (float(given[key]) for key in ("x", "y", "width", "height"))
        shape = shapely.box(x, y, x + width, y + height)
    else:
        shape = shapely.make_valid(shapely.Polygon([(float(one["x"]), float(one["y"])) for one in given["points"]]))
    if not (np.abs(shape.bounds) <= FARTHEST).all() or flat_parts(shape).is_empty:  # GEOS may loop far beyond
        raise ValueError("a shape has no area, or is too far away")
    return flat_parts(shape)


def _edges(one: Mapping[str, Any], shape: shapely.Geometry) -> list[shapely.Geometry]:
    """Return the lower and the upper edge of a stair."""
    up = one.get("upwardDirection") or {"x": 1.0, "y": 0.0}
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:4]
    order = np.argsort(corners @ [float(up["x"]), float(up["y"])], kind="stable")
    return [*shapely.linestrings(corners[order].reshape(2, 2, 2))]
