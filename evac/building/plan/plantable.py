"""Plans as tables, as in plan files and ``[building.plan]`` of a case, and plans of existing buildings."""

import inspect
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
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
from evac.building.plan.drawing import Drawing
from evac.building.plan.outlines import from_wkt, is_point
from evac.building.plan.plan import OUTSIDE, Item, Plan, Stair, Storey, copied
from evac.building.plan.remedies import TEXTS, changes_of_piece, changes_of_refused, keys_of, remedy_of, values_like
from evac.building.plan.rooms import close_to
from evac.building.plan.stairs import LEVEL
from evac.building.surface.patches import patches_of

#: Keys that are arguments of `Plan`.
NUMBERS = ("headroom", "north")
#: Lists of tables; the keys of a table are the arguments of the method of `Plan` with the name in the singular.
SECTIONS = (
    *("storeys", "rooms", "stairs", "shafts", "flights", "landings"),
    *("doors", "exits", "openings", "areas", "obstacles", "lifts"),
)
PIECES = ("flights", "landings")  #: Those that are pieces of stairs.


def read_table(path: Path) -> dict[str, Any]:
    """Return the table of a plan file."""
    text = path.read_text(encoding="utf-8-sig")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"invalid TOML: {error}{quoted_line(text, str(error))}") from error


def plan_of(table: Mapping[str, Any], source: Path, folder: Path, prefix: str = "") -> Plan:
    """Return the plan of a table, as a plan file in `folder` has; `prefix` is that of its keys in messages."""
    errors, table = list[Finding](), dict(table)
    for key in [*table]:
        if key not in (*NUMBERS, *SECTIONS):
            text = f"{prefix}{key}: unknown key; {did_you_mean(key, [*NUMBERS, *SECTIONS])}"
            close = close_to(key, [one for one in (*NUMBERS, *SECTIONS) if one not in table])
            table |= {one: table[key] for one in close}
            errors.append(Finding("error", text, item=key, remedy=f"rename it to {close[0]}" if close else "remove it"))
    plan = Plan(source)
    for key in NUMBERS:
        if key in table:
            errors += _set(plan, key, table[key], prefix)
    for section in SECTIONS:
        items = table.get(section, [])
        if not isinstance(items, list):
            remedy = f"write it as [[{section}]]" if isinstance(items, Mapping) else "remove it"
            text = f"{prefix}{section} must be a list of tables: [[{section}]]"
            errors.append(Finding("error", text, item=section, remedy=remedy))
            items = [items] if isinstance(items, Mapping) else []
        for index, item in enumerate(items):
            errors += _Row(plan, table, folder, prefix, section, index, item).add()
    if not errors:
        return plan
    plan.pieces = [piece for piece in plan.pieces if piece[0] not in plan.refused]
    refused = refusal(source, errors)
    if not plan.files:  # these are read later, with all that is on their storeys
        try:
            refused.building = plan.building(need_exit=False)
        except BuildingError as error:
            refused = refusal(source, [*errors, *error.findings])
            refused.building = error.building
    raise refused


def _set(plan: Plan, key: str, value: Any, prefix: str) -> list[Finding]:
    """Set a number of a plan, or that which is meant; return the errors."""
    for given in (value, *values_like(key, value)):
        try:
            setattr(plan, key, getattr(Plan(plan.source, **{key: given}), key))
        except BuildingError as error:
            text = f"{prefix}{key}: {str(error).removeprefix(f'{plan.source}: plan: {key} ')}"
            continue
        return [] if given is value else [Finding("error", text, item=key, remedy=f"{key} = {toml_value(given)}")]
    return [Finding("error", text, item=key, remedy="remove it")]


def _name(index: int, item: Any) -> str:
    return escaped(f"{(isinstance(item, Mapping) and item.get('name')) or index}")


@dataclass(frozen=True)
class _Row:
    """An item of a section of a table, which is added to a plan."""

    plan: Plan
    table: Mapping[str, Any]
    folder: Path
    prefix: str
    section: str
    index: int
    item: Any

    @cached_property
    def names_missing(self) -> list[str]:
        """The names that other items use, and that no item of the section has."""
        given = [row.get("name") for row in self.table[self.section] if isinstance(row, Mapping)]
        return [name for name in _used(self.table, self.section, self.item) if name not in given]

    def add(self) -> list[Finding]:
        """Add the item, as it is or with the remedies of its errors, which have been tried; return the errors."""
        if (refused := self.refusal_of(self.item, self.plan)) is None:
            return []
        found, right = self.mended(self.item, refused) if isinstance(self.item, Mapping) else ([(refused, "")], {})
        if found[-1][1]:
            self.add_to(self.plan, right)
        elif self.section in ("storeys", "rooms"):
            self.plan.refused.update([str(right["name"])] if "name" in right else self.names_missing)
        elif self.section in PIECES:  # without which the others of its stair lead nowhere
            self.plan.refused.update([str(right["stair"])] if "stair" in right else self.names_missing)
        names = [right.get(one) for one in (["name"] if self.section == "storeys" else ["storey", "lower"])]
        storey = next((one for one in names if isinstance(one, str)), None)
        key, place = f"{self.section}.{_name(self.index, self.item)}", _place_of(right)
        last = "" if self.plan.refused.intersection(_used(self.table, self.section, self.item)) else "remove it"
        return [Finding("error", text, storey, place, key, remedy or last) for text, remedy in found]

    def add_to(self, plan: Plan, row: Any) -> None:
        """Add a row to a plan."""
        _check_keys(f"{plan.source}: {self.prefix}{self.section}.{_name(self.index, row)}", row, keys_of(self.section))
        values = dict(row)
        if self.section == "storeys" and isinstance(values.get("file"), str):
            values["file"] = self.folder / values["file"]
        getattr(plan, self.section.removesuffix("s"))(**values)

    def refusal_of(self, row: Any, trial: Plan) -> str | None:
        """Add a row to a plan, and return why it is refused."""
        try:
            self.add_to(trial, row)
        except BuildingError as error:
            return str(error).removeprefix(f"{self.plan.source}: ")
        return None

    def misfits(self, row: Mapping[str, Any]) -> tuple[int, int]:
        """Return how many errors a row has on the storeys and rooms of the plan, and how many findings there are."""
        if self.plan.files:  # which are read later
            return 0, 0
        trial = copied(self.plan)
        for others in SECTIONS[2:]:
            getattr(trial, "pieces" if others in PIECES else others).clear()
        self.refusal_of(row, trial)
        drawing = Drawing(trial)
        drawing.mesh()
        return len(drawing.errors), len(drawing.findings)

    def changes_of(self, row: Mapping[str, Any]) -> Iterator[tuple[str | None, Mapping[str, Any]]]:
        """Yield the changes of a row that may be meant, each with why the plan refuses it; of alike ones the best."""
        pieces: list[Sequence[Mapping[str, Any]]] = []
        with suppress(Exception):  # what is wrong with other pieces of the stair is told there
            rows = [one for own in PIECES for one in self.table.get(own, ()) if one is not self.item]
            changes = changes_of_piece(self.plan, self.section, row, rows) if self.section in PIECES else ()
            pieces += ([{**row, **own}] for own in changes)
        for alike in [*pieces, *changes_of_refused(self.plan, self.section, row, self.names_missing)]:
            tried = [(self.refusal_of(changed, copied(self.plan)), changed) for changed in alike]
            fitting = [changed for again, changed in tried if again is None]
            if len(fitting) > 1 and self.section != "storeys":
                tried = [(None, min(fitting, key=self.misfits))]
            yield from tried

    def mended(
        self, row: Mapping[str, Any], text: str, most: int = 3
    ) -> tuple[list[tuple[str, str]], Mapping[str, Any]]:
        """Return the errors of a row with their remedies, each of which removes one, and the row without them."""
        for again, changed in sorted(self.changes_of(row), key=lambda change: change[0] is not None):
            if again is None:
                return [(text, remedy_of(row, changed))], changed
            if again != text and most > 1:
                further, right = self.mended(changed, again, most - 1)
                if further[-1][1]:
                    return [(text, remedy_of(row, changed)), *further], right
        return [(text, "")], row


def _place_of(row: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return the middle of the last shape of a row, as far as it can be read."""
    place = None
    for shape in ("segment", "polygon", "lower_edge", "foot"):
        with suppress(Exception):  # what is wrong with the shape is told already
            given = row[shape]
            corners = shapely.get_coordinates(from_wkt(given)) if isinstance(given, str) else np.reshape(given, (-1, 2))
            x, y = corners.mean(axis=0)
            place = (float(x), float(y))
    return place


def _used(table: Mapping[str, Any], section: str, item: Any) -> list[str]:
    """Return the names of storeys, of rooms of the storey of an item, or of stairs of pieces, that items use."""
    rows = [
        row for own in SECTIONS if isinstance(table.get(own), list) for row in table[own] if isinstance(row, Mapping)
    ]
    used: list[Any] = []
    if section == "storeys":
        used = [row.get(key) for row in rows for key in ("storey", "lower", "upper", "like")]
    elif section == "rooms":
        storey = item.get("storey") if isinstance(item, Mapping) else None
        rows = [row for row in rows if storey in (None, row.get("storey"))]
        ties = [row[key] for row in rows for key in ("segment", "polygon") if isinstance(row.get(key), Mapping)]
        used = [name for tie in ties if isinstance(tie.get("rooms"), list) for name in tie["rooms"]]
    elif section in PIECES:
        used = [row.get("stair") for row in rows]
    return [*dict.fromkeys(one for one in used if isinstance(one, str))]


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
    for key in TEXTS:
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
