"""The header of a trajectory file: the building and the people as plain JSON, there and back."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import mapping, shape

from evac.building.findings import as_findings
from evac.building.model import Area, Building, Exit, Level, Portal


def building_to_json(building: Building) -> dict[str, Any]:
    """Return the whole building as lists, numbers and words; floats keep every bit."""
    return {
        "source": building.source.name,
        "vertices": building.vertices.tolist(),
        "levels": [_level_to_json(level) for level in building.levels],
        "portals": [
            {"name": p.name, "levels": list(p.levels), "segments": p.segments.tolist(), "width": p.width}
            for p in building.portals
        ],
        "exits": [
            {"name": e.name, "level": e.level, "segments": e.segments.tolist(), "width": e.width}
            for e in building.exits
        ],
        "areas": [{"name": a.name, "level": a.level, "polygon": mapping(a.polygon)} for a in building.areas],
        "walls": building.walls.tolist(),
        "wall_level": building.wall_level.tolist(),
        "stairs": {name: list(levels) for name, levels in building.stairs.items()},
        "warnings": list(building.warnings),
        "closed": sorted(building.closed),
    }


def building_from_json(data: Mapping[str, Any]) -> Building:
    """Return the building that `building_to_json` wrote; in files of earlier versions every link is open."""
    return Building(
        source=Path(data["source"]),
        vertices=np.array(data["vertices"], np.float64).reshape(-1, 3),
        levels=tuple(_level_from_json(index, level) for index, level in enumerate(data["levels"])),
        portals=tuple(
            Portal(index, p["name"], (p["levels"][0], p["levels"][1]), _segments(p["segments"]), p["width"])
            for index, p in enumerate(data["portals"])
        ),
        exits=tuple(
            Exit(index, e["name"], e["level"], _segments(e["segments"]), e["width"])
            for index, e in enumerate(data["exits"])
        ),
        areas=tuple(Area(a["name"], a["level"], shape(a["polygon"])) for a in data["areas"]),
        walls=_segments(data["walls"]),
        wall_level=np.array(data["wall_level"], np.int32),
        stairs={name: tuple(levels) for name, levels in data["stairs"].items()},
        findings=as_findings(data["warnings"]),
        closed=frozenset(data.get("closed", ())),
    )


def _segments(rows: list[list[float]]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.array(rows, np.float64).reshape(-1, 4)


def _level_to_json(level: Level) -> dict[str, Any]:
    return {
        "name": level.name,
        "kind": level.kind,
        "stair": level.stair,
        "triangles": level.triangles.tolist(),
        "polygon": mapping(level.polygon),
        "uphill": level.uphill.tolist(),
        "slope": level.slope,
        "z_min": level.z_min,
        "z_max": level.z_max,
    }


def _level_from_json(index: int, data: Mapping[str, Any]) -> Level:
    return Level(
        index=index,
        name=data["name"],
        kind=data["kind"],
        stair=data["stair"],
        triangles=np.array(data["triangles"], np.int32).reshape(-1, 3),
        polygon=shape(data["polygon"]),
        uphill=np.array(data["uphill"], np.float64),
        slope=data["slope"],
        z_min=data["z_min"],
        z_max=data["z_max"],
    )
