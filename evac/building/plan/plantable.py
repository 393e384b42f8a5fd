"""Plans as tables, as in plan files and ``[building.plan]`` of a case, and plans of existing buildings."""

import copy
import difflib
import inspect
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.defaults import DOOR_REACH
from evac.base.errors import BuildingError, escaped, quoted_line
from evac.base.parameters import did_you_mean
from evac.base.toml import toml_lines, toml_value
from evac.building.model.building import Building, Level
from evac.building.model.findings import Finding, refusal
from evac.building.plan.outlines import from_wkt, is_point
from evac.building.plan.plan import OUTSIDE, Item, Plan, Stair, Storey
from evac.building.plan.stairs import LEVEL
from evac.building.surface.patches import patches_of

#: Keys that are arguments of `Plan`.
NUMBERS = ("headroom", "north")
#: Rise and going of the steps of a stair that states none [m].
USUAL = {"rise": 0.17, "going": 0.29}
#: Lists of tables; the keys of a table are the arguments of the method of `Plan` with the name in the singular.
SECTIONS = (
    *("storeys", "rooms", "stairs", "shafts", "flights", "landings"),
    *("doors", "exits", "openings", "areas", "obstacles", "lifts"),
)


def read_table(path: Path) -> dict[str, Any]:
    """Return the table of a plan file."""
    text = path.read_text(encoding="utf-8-sig")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"invalid TOML: {error}{quoted_line(text, str(error))}") from error


def plan_of(table: Mapping[str, Any], source: Path, folder: Path, prefix: str = "") -> Plan:
    """Return the plan of a table, as a plan file in `folder` has; `prefix` is that of its keys in messages."""
    plan, errors = Plan(source, **{key: table[key] for key in NUMBERS if key in table}), list[Finding]()
    for key in table:
        if key not in (*NUMBERS, *SECTIONS):
            text = f"{prefix}{key}: unknown key; {did_you_mean(key, [*NUMBERS, *SECTIONS])}"
            errors.append(Finding("error", text, item=key, remedy="remove it"))
    for section in SECTIONS:
        items = table.get(section, [])
        if not isinstance(items, list):
            text = f"{prefix}{section} must be a list of tables: [[{section}]]"
            errors.append(Finding("error", text, item=section, remedy="remove it"))
            continue
        for index, item in enumerate(items):
            errors += _added(plan, section, index, item, folder, prefix)
    if not errors:
        return plan
    refused = refusal(source, errors)
    if not plan.files:  # these are read later, with all that is on their storeys
        try:
            refused.building = plan.building(need_exit=False)
        except BuildingError as error:
            refused = refusal(source, [*errors, *error.findings])
            refused.building = error.building
    raise refused


def _name(index: int, item: Any) -> str:
    return escaped(f"{item['name'] if isinstance(item, Mapping) and 'name' in item else index}")


def _add(plan: Plan, section: str, index: int, item: Any, folder: Path, prefix: str = "") -> None:
    """Add an item to a plan."""
    add = getattr(plan, section.removesuffix("s"))
    _check_keys(f"{plan.source}: {prefix}{section}.{_name(index, item)}", item, _known(section))
    values = dict(item)
    if section == "storeys" and isinstance(values.get("file"), str):
        values["file"] = folder / values["file"]
    add(**values)


def _added(plan: Plan, section: str, index: int, item: Any, folder: Path, prefix: str) -> list[Finding]:
    """Add an item to a plan, as it is or with the remedies of its errors, which have been tried; return the errors."""

    def refusal_of(row: Mapping[str, Any]) -> str | None:
        trial = copy.copy(plan)
        vars(trial).update({name: copy.copy(value) for name, value in vars(plan).items()})
        try:
            _add(trial, section, index, row, folder, prefix)
        except BuildingError as error:
            return str(error).removeprefix(f"{plan.source}: ")
        return None

    def mended(row: Mapping[str, Any], text: str, most: int = 3) -> tuple[list[tuple[str, str]], Mapping[str, Any]]:
        """Return the errors of a row with their remedies, each of which removes one, and the row without them."""
        changes = [(refusal_of(changed), changed, remedy) for changed, remedy in _changed(plan, section, row)]
        for again, changed, remedy in sorted(changes, key=lambda change: change[0] is not None):
            if again is None:
                return [(text, remedy)], changed
            if again != text and most > 1:
                further, right = mended(changed, again, most - 1)
                if further[-1][1]:
                    return [(text, remedy), *further], right
        return [(text, "")], row

    try:
        _add(plan, section, index, item, folder, prefix)
        return []
    except BuildingError as error:
        refused = str(error).removeprefix(f"{plan.source}: ")
    found, right = mended(item, refused) if isinstance(item, Mapping) else ([(refused, "")], {})
    key = f"{section}.{_name(index, item)}"
    if found[-1][1] and (section != "storeys" or item.keys() - right.keys() <= item.keys() - _known(section)):
        _add(plan, section, index, right, folder, prefix)
    elif section in ("storeys", "rooms"):
        plan.refused.add(str(right.get("name")))
    names = [right.get(one) for one in (["name"] if section == "storeys" else ["storey", "lower"])]
    storey, place = next((one for one in names if isinstance(one, str)), None), None
    for shape in ("segment", "polygon", "lower_edge", "foot"):
        with suppress(Exception):  # what is wrong with the shape is told already
            given = right[shape]
            corners = shapely.get_coordinates(from_wkt(given)) if isinstance(given, str) else np.reshape(given, (-1, 2))
            x, y = corners.mean(axis=0)
            place = (float(x), float(y))
    return [Finding("error", text, storey, place, key, remedy or "remove it") for text, remedy in found]


@cache
def _known(section: str) -> dict[str, inspect.Parameter]:
    """Return the keys of the items of a section."""
    parameters = inspect.signature(getattr(Plan, section.removesuffix("s"))).parameters
    return {key: parameter for key, parameter in parameters.items() if key != "self"}


def _changed(plan: Plan, section: str, row: Mapping[str, Any]) -> Iterator[tuple[Mapping[str, Any], str]]:
    """Yield a row with one key renamed, removed or added, and the remedy that this is."""
    known = _known(section)
    for wrong in (key for key in row if key not in known):
        for close in difflib.get_close_matches(wrong, known.keys() - row.keys(), 1, 0.5):
            renamed = {close if key == wrong else key: value for key, value in row.items()}
            yield renamed, f"{close} = {toml_value(row[wrong])}\nremove {wrong}"
    for wrong in row:
        if wrong not in known or (wrong != "name" and known[wrong].default is not inspect.Parameter.empty):
            yield {key: value for key, value in row.items() if key != wrong}, f"remove {wrong}"
    added = [USUAL, {"going": USUAL["going"]}, {"width": 1.2}] if section == "shafts" else []
    ends = [one for one in plan.storeys.values() if one.name in (row.get("lower"), row.get("upper"))]
    if section == "stairs" and len(ends) == 2:
        slope = USUAL["going"] / USUAL["rise"] / (2.0 if "turn" in row else 1.0)
        added = [{"length": round(abs(ends[0].z - ends[1].z) * slope, 2)}]
    for more in (one for one in added if not one.keys() & row.keys()):
        yield {**row, **more}, "\n".join(f"{key} = {value:g}" for key, value in more.items())


def table_of(plan: Plan) -> dict[str, Any]:
    """Return a plan as a table of plain data; `plan_of` is the inverse."""
    table: dict[str, Any] = _given(plan, *NUMBERS)
    table["storeys"] = [_storey(one) for one in plan.storeys.values()]
    table["rooms"] = [
        _given(room, "name", "storey") | {"polygon": _corners(room.outline)} | _given(room, "use", "people", "density")
        for room in plan.rooms
    ]
    table["stairs"] = [_stair(one) for one in plan.stairs]
    table["shafts"] = [_stair(one) for one in plan.shafts]
    table["flights"], table["landings"] = [], []
    for stair, kind, values in plan.pieces:
        if kind == "flight":
            lower, lower_z, upper, upper_z = values
            piece = {"lower_edge": _plain(lower), "lower_z": lower_z, "upper_edge": _plain(upper), "upper_z": upper_z}
            table["flights"].append({"stair": stair, **piece})
        elif kind == "slope":
            table["flights"].append({"stair": stair, "polygon": [_wkt(one) for one in values[0]]})
        else:
            table["landings"].append({"stair": stair, "polygon": _shape(values[0]), "z": values[1]})
    usual = {"reach": DOOR_REACH, "outside": OUTSIDE[0]}
    table["doors"] = [
        _item(door) | {key: value for key, value in _given(door, *usual).items() if value != usual[key]}
        for door in plan.doors
    ]
    table["exits"] = [
        _exit([one for one in plan.exits if one.name == name]) for name in dict.fromkeys(one.name for one in plan.exits)
    ]
    for section in ("openings", "areas", "obstacles"):
        table[section] = [_item(one) for one in getattr(plan, section)]
    table["lifts"] = [
        {"name": lift.name, "storeys": list(lift.storeys), "polygon": _corners(lift.polygon)}
        | {"door": _plain(lift.doors[0] if len(lift.doors) == 1 else [one.tolist() for one in lift.doors])}
        | ({"operation": own} if (own := lift.operation.model_dump(exclude_unset=True)) else {})
        for lift in plan.lifts
    ]
    return {key: value for key, value in table.items() if value != []}


def _check_keys(what: str, item: Any, known: Mapping[str, inspect.Parameter]) -> None:
    """Refuse an item that is not a table, lacks a key, or has an unknown key."""
    if not isinstance(item, Mapping):
        raise BuildingError(f"{what}: must be a table, not {item!r}")
    for key in item:
        if key not in known:
            raise BuildingError(f"{what}.{key}: unknown key; {did_you_mean(str(key), list(known))}")
    for key, parameter in known.items():
        if parameter.default is inspect.Parameter.empty and key not in item:
            raise BuildingError(f"{what}.{key}: missing; the known keys are {', '.join(known)}")
    for key in ("name", "storey", "lower", "upper", "stair", "turn", "outside", "file", "like", "use", "kind"):
        if key in item and not (isinstance(item[key], str) and item[key]):
            raise BuildingError(f"{what}.{key}: must be a string, not {item[key]!r}")


def _storey(storey: Storey) -> dict[str, Any]:
    table = {"name": storey.name, "z": storey.z} | _given(storey, "wall", "like")
    if storey.file is not None:
        table |= {"file": str(storey.file)} | ({"options": dict(storey.options)} if storey.options else {})
    return table | ({"polygons": _shape(storey.polygons)} if storey.polygons else {})


def _given(item: Any, *names: str) -> dict[str, Any]:
    """Return the values of some attributes as plain data, without those that are None."""
    return {name: _plain(value) for name in names if (value := getattr(item, name)) is not None}


def _stair(stair: Stair) -> dict[str, Any]:
    """Return a stair or a shaft."""
    given = _given(stair, *(one.name for one in fields(stair) if one.name != "key"))
    if stair.landing is None:
        del given["landings"]
    if stair.turn is None:
        del given["gap"]
    if not stair.handrails:
        del given["handrails"]
    return given


def _exit(items: list[Item]) -> dict[str, Any]:
    """Return an exit, which may have several segments."""
    tables = [_item(item) for item in items]
    return tables[0] | ({"segment": [table["segment"] for table in tables]} if len(items) > 1 else {})


def _item(item: Item) -> dict[str, Any]:
    is_line = item.segment is not None or (item.tie is not None and (item.tie.side, *item.tie.rooms[1:]) != (None,))
    if item.tie is not None:
        shape: Any = _given(item.tie, "rooms", "side", "at", "width", "inset")
    else:
        shape = _plain(item.segment) if item.segment is not None else _shape(item.polygons)
    table = {"name": item.name or "unnamed", "storey": item.storey, "segment" if is_line else "polygon": shape}
    return table if item.control is None else table | {"control": item.control.model_dump(exclude_none=True)}


def _plain(value: Any) -> Any:
    """Return a value as plain data, with whole coordinates as integers."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [int(one) if isinstance(one, float) and one.is_integer() else _plain(one) for one in value]
    return value


def _shape(polygons: Sequence[BaseGeometry]) -> Any:
    """Return polygons as corners: one as its list, several as a list of theirs."""
    corners = [_corners(polygon) for polygon in polygons]
    return corners[0] if len(corners) == 1 else corners


def _corners(polygon: BaseGeometry) -> Any:
    """Return a polygon as the list of its corners, or as WKT if it has holes."""
    return _wkt(polygon) if len(polygon.interiors) else _plain(shapely.get_coordinates(polygon)[:-1])


def _wkt(polygon: BaseGeometry) -> str:
    """Return a polygon, whose coordinates are on the grid of plans, as WKT without loss of digits."""
    return str(shapely.to_wkt(polygon, rounding_precision=6))


def plan_text(table: Mapping[str, Any]) -> str:
    """Return the table of a plan as the text of a plan file."""
    lines = toml_lines({key: value for key, value in table.items() if key not in SECTIONS})
    for section in SECTIONS:
        for item in table.get(section, ()):
            lines += ["", f"[[{section}]]"]
            for key, value in item.items():
                is_several = key in ("polygon", "polygons") and isinstance(value, list) and not is_point(value[0])
                if is_several:
                    lines += [f"{key} = [", *(f"    {toml_value(one)}," for one in value), "]"]
                elif isinstance(value, str):
                    lines.append(f"{key} = {toml_value(value)}")
                else:
                    lines += toml_lines({key: value})
    return "\n".join([*lines, ""])


def plan_of_building(building: Building) -> Plan:
    """Return the plan from which a building is made again."""
    plan = Plan(building.source, headroom=0.0, north=building.north)
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
