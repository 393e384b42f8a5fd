"""The header of a trajectory file: format and columns, and the building as plain JSON. See docs/trajectory.md."""

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from shapely.geometry import mapping, shape
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IntArray
from evac.base.change import Control, LiftOptions
from evac.building.model.building import Area, Building, Door, Exit, Level, Place, Portal
from evac.building.model.findings import as_findings

FORMAT = 4

#: Folder in messages about the trajectory of a run without one.
IN_MEMORY = Path("in memory")

#: Key of the header, in the metadata of the schema.
TRAJECTORY_KEY = b"evac.trajectory"

#: Numbers that are recorded of each person; those from x on are in the column `motion`, and x and y are relative to the
#: header's origin.
FIELDS = ("person", "level", "x", "y", "velocity_x", "velocity_y", "contact_force")

#: The same in a case with `[dose]`: the greater one of the doses of gases and heat.
FIELDS_WITH_DOSE = (*FIELDS, "dose")

#: Classes of the parts of a building, by their key in the header.
PARTS = {"levels": Level, "portals": Portal, "exits": Exit, "areas": Area, "doors": Door, "places": Place}


def _floats(values: Any) -> FloatArray:
    return np.array(values, np.float64)


def _rows(values: Any) -> IntArray:
    return np.array(values, np.int32)


#: What is made of the values in JSON of attributes of parts; the others stay as they are.
READ: Mapping[str, Callable[[Any], Any]] = {
    **dict.fromkeys(("uphill", "segment", "segments"), _floats),
    **dict.fromkeys(("polygon", "shape"), shape),
    **{"triangles": _rows, "levels": tuple},
}


def building_to_json(building: Building) -> dict[str, Any]:
    """Return the building as lists, numbers and strings; floats are exact."""
    return {
        "source": building.source.name,
        "vertices": building.vertices.tolist(),
        **{key: [_part_to_json(part) for part in getattr(building, key)] for key in PARTS},
        "walls": building.walls.tolist(),
        "wall_level": building.wall_level.tolist(),
        "stairs": {name: list(levels) for name, levels in building.stairs.items()},
        "warnings": list(building.warnings),
        "closed": sorted(building.closed),
        "north": building.north,
        "moving": sorted(building.moving),
        **({"lifts": [_part_to_json(lift) for lift in building.lifts]} if building.lifts else {}),
        "controls": [[link, control.model_dump(exclude_none=True)] for link, control in building.controlled.items()],
    }


def _part_to_json(part: Any) -> dict[str, Any]:
    """Return the attributes of a level, portal, exit, area, door or place, without its index."""
    row: dict[str, Any] = {}
    for key in (field.name for field in fields(part) if field.name != "index"):
        value = getattr(part, key)
        is_shape = isinstance(value, BaseGeometry)
        row[key] = mapping(value) if is_shape else value.tolist() if isinstance(value, np.ndarray) else value
        row[key] = value.model_dump() if isinstance(value, LiftOptions) else row[key]
    return row


def building_from_json(data: Mapping[str, Any]) -> Building:
    """Return the building from the output of `building_to_json`."""
    parts: dict[str, Any] = {}
    for key, kind in PARTS.items():
        rows = [
            {name: READ[name](value) if name in READ else value for name, value in row.items()}
            for row in data.get(key, ())
        ]
        is_numbered = any(field.name == "index" for field in fields(kind))
        parts[key] = tuple(kind(**{"index": k} if is_numbered else {}, **row) for k, row in enumerate(rows))
    building = Building(
        source=Path(data["source"]),
        vertices=_floats(data["vertices"]),
        walls=_floats(data["walls"]).reshape(-1, 4),
        wall_level=_rows(data["wall_level"]),
        stairs={name: tuple(levels) for name, levels in data["stairs"].items()},
        findings=as_findings(tuple(data["warnings"])),
        closed=frozenset(data["closed"]),
        north=data.get("north"),
        moving=frozenset((level, x, y) for level, x, y in data.get("moving", ())),
        controls=frozenset((link, Control.model_validate(control)) for link, control in data.get("controls", ())),
        **parts,
    )
    return _with_lifts(building, data["lifts"]) if "lifts" in data else building


def _with_lifts(building: Building, rows: list[dict[str, Any]]) -> Building:
    """Return a building with the lifts of `building_to_json`."""
    from evac.building.model.lifts import Lift, with_lifts

    lifts = []
    for row in rows:
        own: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in row.items()}
        own |= {"doors": tuple(map(tuple, row["doors"])), "operation": LiftOptions.model_validate(row["operation"])}
        lifts.append(Lift(**own))
    return with_lifts(building, tuple(lifts))
