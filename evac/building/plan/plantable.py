"""Plans as tables, as in plan files and ``[building.plan]`` of a case, and plans of existing buildings."""

import inspect
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.defaults import HEADROOM
from evac.base.errors import BuildingError, escaped, quoted_line
from evac.base.parameters import did_you_mean
from evac.building.model.building import Building, Level
from evac.building.plan.plan import Item, Plan, Stair
from evac.building.plan.stairs import LEVEL
from evac.building.surface.patches import patches_of

#: Lists of tables; the keys of a table are the arguments of the method of `Plan` with the name in the singular.
SECTIONS = ("storeys", "stairs", "flights", "landings", "doors", "exits", "openings", "areas", "obstacles")


def read_table(path: Path) -> dict[str, Any]:
    """Return the table of a plan file."""
    text = path.read_text(encoding="utf-8-sig")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"invalid TOML: {error}{quoted_line(text, str(error))}") from error


def plan_of(table: Mapping[str, Any], source: Path, folder: Path, prefix: str = "") -> Plan:
    """Return the plan that a table describes.

    `table`: ``headroom`` [m], and lists of tables under the keys of `SECTIONS`, with the arguments of that method of
    `evac.building.plan.plan.Plan`; `source`: name of the plan in messages; `folder`: folder that paths of storey files
    are relative to; `prefix`: prefix of keys in messages.
    """
    for key in table:
        if key != "headroom" and key not in SECTIONS:
            raise BuildingError(f"{source}: {prefix}{key}: unknown key; {did_you_mean(key, ['headroom', *SECTIONS])}")
    plan = Plan(source, headroom=table.get("headroom", HEADROOM))
    for section in SECTIONS:
        add = getattr(plan, section.removesuffix("s"))
        items = table.get(section, [])
        if not isinstance(items, list):
            raise BuildingError(f"{source}: {prefix}{section} must be a list of tables: [[{section}]]")
        for index, item in enumerate(items):
            name = item["name"] if isinstance(item, Mapping) and "name" in item else index
            key = escaped(f"{prefix}{section}.{name}")
            _check_keys(f"{source}: {key}", item, add)
            values = dict(item)
            if section == "storeys" and isinstance(values.get("file"), str):
                values["file"] = folder / values["file"]
            add(**values)
    return plan


def table_of(plan: Plan) -> dict[str, Any]:
    """Return a plan as a table of plain data; `plan_of` is the inverse."""
    table: dict[str, Any] = {"headroom": plan.headroom}
    table["storeys"] = [
        {"name": one.name, "z": one.z, "wall": one.wall}
        | ({"file": str(one.file), "options": dict(one.options)} if one.file else {"polygons": _wkt(one.polygons)})
        for one in plan.storeys.values()
    ]
    table["stairs"] = [_stair(one) for one in plan.stairs]
    table["flights"], table["landings"] = [], []
    for stair, kind, values in plan.pieces:
        if kind == "flight":
            lower, lower_z, upper, upper_z = values
            piece = {"lower_edge": lower.tolist(), "lower_z": lower_z, "upper_edge": upper.tolist(), "upper_z": upper_z}
            table["flights"].append({"stair": stair, **piece})
        elif kind == "slope":
            table["flights"].append({"stair": stair, "polygon": _wkt(values[0])})
        else:
            table["landings"].append({"stair": stair, "polygon": _wkt(values[0]), "z": values[1]})
    table["doors"] = [_item(door) | {"reach": door.reach, "outside": door.outside} for door in plan.doors]
    table["exits"] = [
        _exit([one for one in plan.exits if one.name == name]) for name in dict.fromkeys(one.name for one in plan.exits)
    ]
    for section in ("openings", "areas", "obstacles"):
        table[section] = [_item(one) for one in getattr(plan, section)]
    return {key: value for key, value in table.items() if value != []}


def _check_keys(what: str, item: Any, method: Any) -> None:
    """Refuse an item that is not a table, lacks a key, or has an unknown key."""
    if not isinstance(item, Mapping):
        raise BuildingError(f"{what}: must be a table, not {item!r}")
    known = inspect.signature(method).parameters
    for key in item:
        if key not in known:
            raise BuildingError(f"{what}.{key}: unknown key; {did_you_mean(str(key), list(known))}")
    for key, parameter in known.items():
        if parameter.default is inspect.Parameter.empty and key not in item:
            raise BuildingError(f"{what}.{key}: missing; the known keys are {', '.join(known)}")
    for key in ("name", "storey", "lower", "upper", "stair", "turn", "outside", "file"):
        if key in item and not (isinstance(item[key], str) and item[key]):
            raise BuildingError(f"{what}.{key}: must be a string, not {item[key]!r}")


def _stair(stair: Stair) -> dict[str, Any]:
    given = {one.name: getattr(stair, one.name) for one in fields(stair)}
    if stair.landing is None:
        del given["landings"]
    values = {key: value.tolist() if isinstance(value, np.ndarray) else value for key, value in given.items()}
    return {key: value for key, value in values.items() if value is not None}


def _exit(items: list[Item]) -> dict[str, Any]:
    """Return an exit, which may have several segments."""
    table = _item(items[0])
    segments = [item.segment.tolist() for item in items if item.segment is not None]
    return table | ({"segment": segments} if len(segments) > 1 else {})


def _item(item: Item) -> dict[str, Any]:
    shape = {"polygon": _wkt(item.polygons)} if item.segment is None else {"segment": item.segment.tolist()}
    return {"name": item.name or "unnamed", "storey": item.storey, **shape}


def _wkt(polygons: tuple[Any, ...]) -> list[str]:
    """Return polygons, whose coordinates are on the grid of plans, as WKT without loss of digits."""
    return [str(shapely.to_wkt(polygon, rounding_precision=6)) for polygon in polygons]


def plan_of_building(building: Building) -> Plan:
    """Return the plan from which a building is made again."""
    plan = Plan(building.source, headroom=0.0)
    for level in building.levels:
        if level.kind == "flight":
            plan.flight(str(level.stair), polygon=slopes_of(building, level))
        elif level.z_max - level.z_min > LEVEL:
            raise ValueError(f"level {level.name!r} is not level")
        elif level.kind == "landing":
            plan.landing(str(level.stair), level.polygon, level.z_min)
        else:
            plan.storey(level.name, level.polygon, level.z_min)
    for way in building.exits:
        level = building.levels[way.level]
        if level.kind != "floor":
            raise ValueError(f"exit {way.name!r} is on a stair")
        plan.exit(way.name, level.name, way.segments.reshape(-1, 2, 2).tolist())
    for door in building.doors:
        plan.door(door.name, building.levels[door.level].name, door.segment.reshape(2, 2))
    for area in building.areas:
        plan.area(area.name, building.levels[area.level].name, area.polygon)
    return plan


def slopes_of(building: Building, level: Level) -> list[BaseGeometry]:
    """Return the planes of a flight: polygons whose corners have heights [m]."""
    cells = level.triangles.astype(np.int64)
    patches = patches_of(building.vertices, cells, np.zeros(len(cells), dtype=np.int64), {})
    return [
        shapely.transform(
            shapely.force_3d(patch.plan),
            lambda at, patch=patch: np.column_stack([at[:, :2], patch.height(at[:, :2])]),
            include_z=True,
        )
        for patch in patches
    ]
