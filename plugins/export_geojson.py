"""Exporter "geojson": the building in plan, for geographic information systems and drawing programs."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import shapely
from shapely.geometry import MultiLineString, mapping
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.building.model.building import Building
from evac.building.model.links import states_of
from evac.building.plan.plantable import slopes_of
from evac.export.exporter import Exporter
from evac.trajectory.trajectory import Trajectory

#: Note at the top of the file, since RFC 7946 requires longitude and latitude unless otherwise agreed.
COORDINATES = "plan of the building: x and y in metres, not longitude and latitude (RFC 7946, section 4)"


class GeojsonExporter(Exporter):
    """The building as GeoJSON: levels, walls, portals, exits, doors, areas and places with names, in plan coordinates.

    Flights have a polygon with heights for each of their planes. `evac import` reads the file again. Portals, exits and
    doors have the property ``open`` for the start of the run, and ``changes`` if they open or close later.
    """

    name = "geojson"
    suffix = ".geojson"

    def write(self, trajectory: Trajectory, path: Path) -> Iterable[Path]:
        """Write one feature collection; features have the properties ``kind``, ``name``, ``level`` and heights [m]."""
        building = trajectory.building
        data = {
            "type": "FeatureCollection",
            "coordinates": COORDINATES,
            "building": building.source.name,
            "features": [*_surfaces(building), *_lines(building, states_of(building, trajectory.changes))],
        }
        path.write_text(json.dumps(data, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")
        return [path]

    def place(self, trajectory: Trajectory) -> Path:
        """Return ``export/building.geojson`` in the result folder."""
        return super().place(trajectory).with_name("building.geojson")


def _surfaces(building: Building) -> Iterable[dict[str, Any]]:
    """Return the levels, the areas, and the places and lines of the case."""
    for level in building.levels:
        shape = shapely.MultiPolygon(slopes_of(building, level)) if level.kind == "flight" else level.polygon
        more = {"stair": level.stair, "z_min": level.z_min, "z_max": level.z_max, "slope": level.slope}
        yield _feature(shape, level.kind, level.name, [level.name], **more)
    for area in building.areas:
        yield _feature(area.polygon, "area", area.name, [building.levels[area.level].name])
    for place in building.places:
        more = {key: getattr(place, key) for key in ("area", "capacity", "exit", "range") if getattr(place, key)}
        yield _feature(place.shape, place.kind, place.name, [building.levels[place.level].name], **more)


def _lines(building: Building, states: list[list[tuple[float, bool]]]) -> Iterable[dict[str, Any]]:
    """Return the walls of each level, the portals, the exits and the doors."""
    for level in building.levels:
        walls = building.walls[building.wall_level == level.index]
        if len(walls):
            yield _feature(_drawn(walls), "wall", f"walls of {level.name}", [level.name])
    for link, own in zip(building.links[: len(building.links) - len(building.rides)], states, strict=False):
        levels = [building.levels[index].name for index in link.levels]
        yield _feature(_drawn(link.segments), link.kind, link.name, levels, width=link.width, **_state(own))


def _state(states: list[tuple[float, bool]]) -> dict[str, Any]:
    """Return the properties of a link that is open or closed from certain times on."""
    changes = [{"time": time, "open": is_open} for time, is_open in states[1:]]
    return {"open": states[0][1]} | ({"changes": changes} if changes else {})


def _drawn(segments: FloatArray) -> BaseGeometry:
    return MultiLineString([segment for segment in segments.reshape(-1, 2, 2)])


def _feature(shape: BaseGeometry, kind: str, name: str, levels: list[str], **more: Any) -> dict[str, Any]:
    properties = {"kind": kind, "name": name, "levels": levels, **more}
    return {"type": "Feature", "properties": properties, "geometry": mapping(shape)}
