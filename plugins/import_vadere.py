"""Importer of scenarios of Vadere: obstacles, targets, sources and stairs of its topography."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import networkx
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.parameters import Parameter
from evac.building.geometry import flat_parts, place_of
from evac.building.importer import Importer
from evac.building.plan.plan import Plan

#: Lists of the topography that are read, and those that are not; distance at which a stair touches a floor [m].
READ = ("obstacles", "targets", "sources", "stairs")
LEFT_OUT = ("measurementAreas", "targetChangers", "absorbingAreas", "dynamicElements")
TOUCH = 0.05


class VadereImporter(Importer):
    """Scenarios of Vadere (.scenario): the topography without its obstacles, targets as exits, sources as start areas.

    The topography is a plane. Floors that only stairs connect are at different heights, `rise` for each tread.
    """

    name = "vadere"
    suffixes = (".scenario",)

    rise = Parameter(0.17, "height of a tread of a stair", unit="m", above=0.0)

    def read(self, path: Path) -> Plan:
        """Read the topography; raise ValueError if the file has none."""
        try:
            topography = json.loads(path.read_text(encoding="utf-8-sig"))["scenario"]["topography"]
            own = topography["attributes"]
            ground = _shape({**own["bounds"], "type": "RECTANGLE"})
            if own.get("bounded", True):
                ground = ground.buffer(-float(own.get("boundingBoxWidth", 0.5)), join_style="mitre")
            of = {key: [(one, _shape(one["shape"])) for one in topography.get(key) or []] for key in READ}
            exits = [
                one for one in of["targets"] if one[0].get("absorbing", (one[0].get("absorber") or {}).get("enabled"))
            ]
            stairs = [(_edges(one, shape), self.rise * int(one.get("treadCount", 1))) for one, shape in of["stairs"]]
            counts = {key: len(topography.get(key) or []) for key in LEFT_OUT}
        except (LookupError, TypeError, ValueError, AttributeError, RecursionError, shapely.GEOSException) as error:
            text = "the topography, or a shape or number of it, is missing or none"
            raise ValueError(f"not a scenario of Vadere: {text}") from error
        solid = shapely.union_all([shape for _, shape in (*of["obstacles"], *exits, *of["stairs"])])
        parts = [*shapely.get_parts(flat_parts(ground.difference(solid)))]
        if not parts:
            raise ValueError("the topography has no floor beside its obstacles, targets and stairs")
        plan, heights = Plan(path), _heights(parts, stairs)
        for key, items in of.items():
            plan.note("found", f"{len(items)} {key}", element=key, number=len(items))
        names = {z: f"floor {number}" for number, z in enumerate(sorted(set(heights)), start=1)}
        on = [names[z] for z in heights]
        for z, name in names.items():
            plan.storey(name, [part for part, height in zip(parts, heights, strict=True) if height == z], z)
        for number, (edges, rise) in enumerate(stairs, start=1):
            low = next((k for k in range(len(parts)) if _touches(parts[k], edges[0])), None)
            place = tuple(edges.mean(axis=(0, 1)).tolist())
            if low is None:
                plan.note("missing", f"stair {number} begins at no floor", place=place, element="stairs")
                continue
            plan.flight(f"stair {number}", edges[0], heights[low], edges[1], heights[low] + rise)
            plan.note("assumed", f"stair {number} rises {rise:.2f} m (rise)", on[low], place)
        for kind, items in (("target", exits), ("source", of["sources"])):
            for one, shape in items:
                name = f"{kind} {one.get('id')}"
                storey = next((own for part, own in zip(parts, on, strict=True) if part.dwithin(shape, TOUCH)), None)
                if storey is None:
                    plan.note("missing", f"{name} is not at the floor", place=place_of(shape), element=f"{kind}s")
                    continue
                if kind == "target":
                    plan.exit(name, storey, polygon=shape)
                else:
                    plan.area(name, storey, shape)
                plan.note("found", f"{'exit' if kind == 'target' else 'start area'} {name!r}", storey, place_of(shape))
        if idle := len(of["targets"]) - len(exits):
            plan.note("left out", f"{idle} targets absorb nobody", element="targets", number=idle)
        for what, count in counts.items():
            if count:
                plan.note("left out", f"{count} {what} are not read", element=what, number=count)
        return plan


def _heights(parts: list[BaseGeometry], stairs: list[tuple[FloatArray, float]]) -> list[float]:
    """Return the height of each part of the floor, the lowest of those that stairs join at 0."""
    graph = networkx.DiGraph()
    graph.add_nodes_from(range(len(parts)))
    for edges, rise in stairs:
        low, up = ([k for k, part in enumerate(parts) if _touches(part, edge)] for edge in edges)
        graph.add_edges_from((a, b, {"rise": way * rise}) for a, b, way in [*zip(low, up, [1]), *zip(up, low, [-1])])  # noqa: B905
    heights = np.zeros(len(parts))
    for rows in networkx.weakly_connected_components(graph):
        for a, b in networkx.bfs_edges(graph, min(rows)):
            heights[b] = heights[a] + graph.edges[a, b]["rise"]
        heights[[*rows]] -= heights[[*rows]].min()
    return [float(z) for z in heights.round(4)]


def _touches(part: BaseGeometry, edge: FloatArray) -> bool:
    return bool(part.dwithin(shapely.LineString(edge).centroid, TOUCH))


def _shape(given: Mapping[str, Any]) -> BaseGeometry:
    """Return a rectangle, polygon or circle of Vadere."""
    if given["type"] == "CIRCLE":
        shape = shapely.Point(given["center"]["x"], given["center"]["y"]).buffer(float(given["radius"]))
    elif given["type"] == "RECTANGLE":
        x, y, width, height = (float(given[key]) for key in ("x", "y", "width", "height"))
        shape = shapely.box(x, y, x + width, y + height)
    else:
        shape = shapely.Polygon([(float(one["x"]), float(one["y"])) for one in given["points"]])
    shape = flat_parts(shapely.make_valid(shape))
    if shape.is_empty:
        raise ValueError("a shape has no area")
    return shape


def _edges(one: Mapping[str, Any], shape: BaseGeometry) -> FloatArray:
    """Return the lower and the upper edge (2, 2, 2) of a stair."""
    up = one.get("upwardDirection") or {"x": 1.0, "y": 0.0}
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shape))[:4]
    edges: FloatArray = corners[np.argsort(corners @ [float(up["x"]), float(up["y"])], kind="stable")].reshape(2, 2, 2)
    return edges
