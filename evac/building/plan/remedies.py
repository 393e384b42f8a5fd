"""Changes of an item of a plan that may remove what is wrong with it, the most likely first."""

import difflib
import inspect
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from itertools import combinations, pairwise
from typing import Any, TypeAlias

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.change import Control, LiftOptions
from evac.base.defaults import DOOR_REACH, FARTHEST
from evac.base.toml import toml_lines
from evac.building.geometry import between_floors, rounded, segment_lengths, sides
from evac.building.model.findings import numbered
from evac.building.plan.drawing import Drawing
from evac.building.plan.outlines import SNAP, is_point, normal
from evac.building.plan.plan import OUTSIDE, Plan
from evac.building.plan.rooms import close_to

Row: TypeAlias = Mapping[str, Any]  #: An item as a plan file has it.

#: Keys whose values are texts, and those among them that have few values.
TEXTS = ("name", "storey", "lower", "upper", "stair", "turn", "outside", "file", "like", "use", "kind")
CHOICES = {"turn": ("left", "right"), "kind": ("straight", "dog-leg"), "outside": OUTSIDE}
#: Words that stand for keys to which they are not similar.
OTHER_WORDS = {"height": "z", "elevation": "z", "level": "storey", "floor": "storey", "from": "lower", "to": "upper"}
#: Keys of the tables in items.
INNER = {
    "segment": ("rooms", "side", "at", "width"),
    "polygon": ("rooms", "inset"),
    "control": tuple(Control.model_fields),
    "operation": tuple(LiftOptions.model_fields),
}
#: Keys of the places of flights and landings, and those of the heights there.
PLACES = {"lower_edge": "lower_z", "upper_edge": "upper_z", "polygon": "z"}
#: Rise and going of the steps of a stair that states none [m].
USUAL = {"rise": 0.17, "going": 0.29}
#: Directions that are tried of a stair that states none.
DIRECTIONS = ([0, 1], [0, -1], [1, 0], [-1, 0])
#: Number of walls at which a door or an exit is tried, the nearest first.
MOST_WALLS = 3
#: Least width of a door [m], and its least distance from the corner of a room.
LEAST_WIDTH, JAMB = 0.5, 0.05
USUAL_WIDTH = 0.9  #: Width that is tried of a door that is too wide for its wall [m].


@cache
def keys_of(section: str) -> dict[str, inspect.Parameter]:
    """Return the keys of the items of a section: the arguments of a method of `Plan`."""
    parameters = inspect.signature(getattr(Plan, section.removesuffix("s"))).parameters
    return {key: parameter for key, parameter in parameters.items() if key != "self"}


def remedy_of(row: Row, changed: Row) -> str:
    """Return a change of an item as the remedy of a finding."""
    new = {key: value for key, value in changed.items() if key not in row or row[key] is not value}
    return "\n".join([*toml_lines(new), *(f"remove {key}" for key in row if key not in changed)])


def changes_of_refused(plan: Plan, section: str, row: Row, unknown: list[str]) -> Iterator[Sequence[Row]]:
    """Yield changes of an item that cannot be added to a plan; of several at once, that which fits best is meant.

    `unknown`: names that other items use, which may be its own.
    """
    known = keys_of(section)
    yield from ([one] for one in _renamed(row, [*known]))
    yield from _on_storeys(plan, section, row)
    items = () if section in ("flights", "landings") else getattr(plan, section)
    taken = [*items] if section == "storeys" else [one.name for one in items]
    if "name" in known and row.get("name", "") in ("", *taken):
        yield [{**row, "name": name} for name in [*unknown, numbered(row.get("name") or section[:-1], taken)]]
    for key, value in row.items():
        yield from ([{**row, key: one}] for one in values_like(key, value))
        if key in CHOICES and isinstance(value, str):
            close = close_to(value, CHOICES[key])
            yield [{**row, key: one} for one in close or CHOICES[key]]
        if key in USUAL:
            yield [{**row, key: USUAL[key]}]
        if isinstance(value, Mapping) and key in INNER:
            inner = [*_renamed(value, INNER[key]), *_without(value, [one for one in value if one not in INNER[key]])]
            inner += [{**value, name: right} for name, given in value.items() for right in values_like(name, given)]
            yield from ([{**row, key: one}] for one in inner)
            yield [{**row, key: one} for one in _other_rooms(plan, row, value)]
        if key == "segment" and isinstance(value, list) and is_point(value[0] if value else None):
            x, y = value[0]
            if max(abs(x), abs(y)) <= FARTHEST:
                ends = [round(x + USUAL_WIDTH, 6), y], [x, round(y + USUAL_WIDTH, 6)]
                yield [{**row, key: [[x, y], end]} for end in ends]
    yield from _completed(plan, section, row, unknown)
    optional = [key for key, own in known.items() if key != "name" and own.default is not inspect.Parameter.empty]
    yield from ([one] for one in _without(row, [key for key in row if key not in known or key in optional]))


def _renamed(row: Row, known: Iterable[str]) -> Iterator[Row]:
    """Yield a table with an unknown key renamed."""
    for wrong in (key for key in row if key not in known):
        free = [key for key in known if key not in row]
        other = difflib.get_close_matches(wrong, OTHER_WORDS, 1, 0.7)
        close = [OTHER_WORDS[one] for one in other if OTHER_WORDS[one] in free]
        for right in (close or close_to(wrong, free))[:1]:
            yield {key: value for key, value in row.items() if key != wrong} | {right: row[wrong]}


def _without(row: Row, keys: Iterable[str]) -> Iterator[Row]:
    """Yield a table without one of some keys."""
    yield from ({key: value for key, value in row.items() if key != wrong} for wrong in keys)


def values_like(key: str, value: Any) -> Iterator[Any]:
    """Yield a value in the form that its key has: texts, numbers that are not negative, segments of two points."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST
    if key in TEXTS and is_number:
        yield f"{value:g}"
    elif is_number and value < 0.0:
        yield -value
    elif isinstance(value, str) and key not in TEXTS:
        with suppress(ValueError):
            number = float(value)
            yield int(number) if number.is_integer() else number
    elif key == "segment" and isinstance(value, list) and len(value) > 2:
        yield [value[0], value[-1]]


def _on_storeys(plan: Plan, section: str, row: Row) -> Iterator[Sequence[Row]]:
    """Yield an item on storeys, in place of one that it lacks or that is no text."""
    names = [*plan.storeys]
    for key, other in (("storey", "storey"), ("lower", "upper"), ("upper", "lower")):
        if key in keys_of(section) and not isinstance(row.get(key), str):
            near = names.index(row[other]) if row.get(other) in names else 0
            own = sorted(names, key=lambda name: abs(names.index(name) - near))
            same = [name for name in own if name == str(row.get(key))]
            yield [{**row, key: name} for name in same or own if name != row.get(other)]


def _completed(plan: Plan, section: str, row: Row, unknown: list[str]) -> Iterator[Sequence[Row]]:
    """Yield an item with a key that it lacks."""
    names = [*plan.storeys]
    if section == "lifts" and len(names) > 1:
        yield [{**row, "storeys": names}]
        corners = row.get("polygon") if "door" not in row else None
        if isinstance(corners, list) and all(map(is_point, corners)):
            yield [{**row, "door": [*ends]} for ends in pairwise([*corners, *corners[:1]])]
    if "stair" in keys_of(section) and "stair" not in row:
        yield [{**row, "stair": name} for name in unknown]
    if section == "shafts" and "foot" in row:
        yield [{**row, "direction": way} for way in DIRECTIONS]
    more = [USUAL, {"going": USUAL["going"]}, {"rise": USUAL["rise"]}, {"width": 1.2}] if section == "shafts" else []
    ends = [one for one in plan.storeys.values() if one.name in (row.get("lower"), row.get("upper"))]
    if section == "stairs" and len(ends) == 2:
        slope = USUAL["going"] / USUAL["rise"] / (2.0 if "turn" in row else 1.0)
        more = [{"length": round(abs(ends[0].z - ends[1].z) * slope, 2)}]
    yield from ([{**row, **own}] for own in more if not own.keys() & row.keys())


def _other_rooms(plan: Plan, row: Row, tie: Row) -> Iterator[Row]:
    """Yield ties of an item to the wall between other rooms of its storey, or to another side of the same."""
    own, given = {one.name: one.outline for one in plan.rooms if one.storey == row.get("storey")}, tie.get("rooms")
    known = [name for name in given if name in own] if isinstance(given, list | tuple) else []
    tie = {**tie, "width": tie.get("width", USUAL_WIDTH)}
    if len(known) > 2:
        yield from ({**tie, "rooms": [*pair]} for pair in combinations(known, 2))
    for name in known[: 2 if "side" not in tie else 0]:
        near = [other for other in own if other != name and own[other].dwithin(own[name], DOOR_REACH)]
        yield from ({**tie, "rooms": [name, other]} for other in near)
    if len(known) == 1 and "inset" not in tie:
        count = len(shapely.get_coordinates(own[known[0]])) - 1
        yield from ({**tie, "side": side} for side in range(count) if side != tie.get("side"))


def changes_of_piece(plan: Plan, section: str, row: Row, rows: Sequence[Row]) -> Iterator[dict[str, Any]]:
    """Yield heights and places of a flight or a landing where it meets others of its stair or a storey."""
    ends = [(one[key], one[z]) for one in rows if one["stair"] == row["stair"] for key, z in PLACES.items() if z in one]
    met = [(shapely.multipoints(corners).convex_hull, high) for corners, high in ends if is_point(corners[0])]
    own = {key: z for key, z in PLACES.items() if key in row and z in keys_of(section) and is_point(row[key][0])}
    for key, z in own.items():
        shape = shapely.multipoints(row[key]).convex_hull
        far = row.get({"lower_z": "upper_z", "upper_z": "lower_z"}.get(z, z), 0.0)
        end = shape if key == "polygon" else shape.centroid  # flights side by side touch at a corner
        near = [(round(other.distance(end), 3), high) for other, high in met]
        near += [(SNAP, storey.z) for storey in plan.storeys.values()]
        near.sort(key=lambda one: (one[0], (one[1] > far) == (z == "lower_z"), abs(one[1] - far)))
        yield from ({z: high} for _, high in near[:MOST_WALLS] if high not in (row.get(z), far))
        for other in (other for other, high in met if high == row.get(z)):
            step = np.diff(shapely.get_coordinates(shapely.shortest_line(shape, other)), axis=0)
            yield {key: rounded(np.array(row[key]) + step).tolist()}


def names_like(plan: Plan, drawing: Drawing, row: Row) -> list[dict[str, Any]]:
    """Return changes of an item to storeys and rooms that exist, with names like those that do not."""
    found: list[dict[str, Any]] = []
    for key in ("storey", "lower", "upper"):
        if key in row and row[key] not in plan.storeys:
            close = difflib.get_close_matches(row[key], plan.storeys, 2, 0.5)
            found += [{key: name} for name in close or plan.storeys]
    for key, names, own in (
        *(("storeys", row[key], [*plan.storeys]) for key in ("storeys",) if key in row),
        *((key, row[key]["rooms"], None) for key in ("segment", "polygon") if isinstance(row.get(key), Mapping)),
    ):
        known = own or [room.name for room in drawing.plan.rooms if room.storey == row["storey"]]
        closest = [(close_to(name, known) or [name])[0] for name in names]
        if closest != [*names]:
            found.append({key: closest if own else {**row[key], "rooms": closest}})
    return found


def changes_of_drawn(plan: Plan, drawing: Drawing, section: str, row: Row, text: str) -> Iterator[dict[str, Any]]:
    """Yield changes of an item that may remove its error, the most likely first."""
    segment, polygon = row.get("segment"), row.get("polygon")
    if isinstance(segment, Mapping):
        yield {"segment": {key: value for key, value in segment.items() if key != "at"}}
        in_the_middle = {key: value for key, value in segment.items() if key not in ("at", "width")}
        yield from ({"segment": one} for one in (in_the_middle, {**in_the_middle, "width": USUAL_WIDTH}))
        yield from ({"segment": one} for one in _other_rooms(drawing.plan, row, segment))
    elif segment is not None and row["storey"] in drawing.rooms and np.shape(segment) == (2, 2):
        if section == "doors" and "one side" in text:
            yield {"outside": "exit"}
        yield from ({"segment": ends} for ends in _on_walls(drawing, section, row["storey"], np.array(segment)))
    elif section == "areas":
        if "name" in text:
            taken = [*(one.name for one in plan.areas), *(one.name for one in plan.rooms)]
            yield {"name": numbered(row["name"], taken)}
        yield from ({"storey": name} for name in plan.storeys)
        if isinstance(polygon, Mapping):
            yield {"polygon": {key: value for key, value in polygon.items() if key != "inset"}}
        elif isinstance(polygon, list) and all(map(is_point, polygon)) and row["storey"] in drawing.rooms:
            yield {"polygon": _moved(np.array(polygon), drawing.rooms[row["storey"]])}
    elif section in ("stairs", "shafts"):
        yield from _other_ways([*plan.storeys], row)
        for key, storey in (("lower_edge", row["lower"]), ("upper_edge", row["upper"])):
            if np.shape(row.get(key, 0)) == (2, 2) and storey in drawing.rooms:
                walls = sides(drawing.rooms[storey])
                yield from ({key: ends} for ends in _along_walls(walls, np.array(row[key]), MOST_WALLS))
    elif section == "lifts":
        outline = np.array(polygon) if isinstance(polygon, list) else np.empty((0, 2))
        if np.shape(row["door"]) == (2, 2) and len(outline):
            walls = np.concatenate([outline, np.roll(outline, -1, axis=0)], axis=1)
            yield from ({"door": ends} for ends in _along_walls(walls, np.array(row["door"]), len(walls)))
        yield from ({"storeys": [one for one in row["storeys"] if one != name]} for name in row["storeys"])


def _moved(corners: FloatArray, floor: BaseGeometry) -> list[list[float]]:
    """Return an outline (n, 2) at the nearest place where it is within a floor, if there is one."""
    size = float(np.ptp(corners, axis=0).max()) / 2
    inner = floor.buffer(-size, join_style="mitre")
    middle = shapely.points(corners.mean(axis=0))
    place = shapely.shortest_line(inner if not inner.is_empty else floor, middle).coords[0]
    moved: list[list[float]] = rounded(corners + place - corners.mean(axis=0)).tolist()
    return moved


def _on_walls(drawing: Drawing, section: str, storey: str, ends: FloatArray) -> Iterable[list[list[float]]]:
    """Yield segments on the nearest walls between two rooms for a door, or at the outline of the floor for an exit."""
    floor = drawing.rooms[storey]
    whole = shapely.multipolygons([shapely.Polygon(part.exterior) for part in shapely.get_parts(floor)])
    walls = sides(floor if section == "doors" else whole)
    walls = walls[segment_lengths(walls) > LEAST_WIDTH + 2 * JAMB]
    walls = walls[between_floors(floor, walls, DOOR_REACH) == (section == "doors")]
    yield from _along_walls(walls, ends, MOST_WALLS)


def _along_walls(walls: FloatArray, ends: FloatArray, most: int) -> Iterable[list[list[float]]]:
    """Yield segments on those of some walls (n, 4) that are nearest to a segment (2, 2), as many as `most`."""
    start, length = walls[:, :2], segment_lengths(walls)
    step = (walls[:, 2:] - start) / length[:, None]
    half = np.minimum(np.hypot(*(ends[1] - ends[0])), length - 2 * JAMB) / 2
    at = ((ends.mean(axis=0) - start) * step).sum(axis=1).clip(half + JAMB, length - half - JAMB)
    off = np.hypot(*(start + at[:, None] * step - ends.mean(axis=0)).T)
    span = ends[1] - ends[0]
    off += (np.hypot(*span) - np.abs(step @ span)) / 2  # rather along its own wall than around a corner
    for row in np.argsort(off, kind="stable")[:most]:
        reach = np.outer([at[row] - half[row], at[row] + half[row]], step[row])
        yield rounded(start[row] + reach).tolist()


def _other_ways(storeys: list[str], row: Row) -> Iterator[dict[str, Any]]:
    """Yield other directions, turns, ends and lengths of a stair."""
    turn: dict[str, Any] | None = {"turn": "left" if row.get("turn") == "right" else "right"} if "turn" in row else None
    back = {"direction": [-value for value in row["direction"]]} if "direction" in row else None
    yield from (change for change in (turn, back, turn and back and {**turn, **back}) if change)
    if "upper_edge" not in row and "turn" not in row:
        yield from ({"turn": side} for side in CHOICES["turn"])
    if "direction" in row and np.shape(row.get("lower_edge", 0)) == (2, 2):
        across = rounded(normal(np.array(row["lower_edge"]))).tolist()
        yield from ({"direction": way} for way in (across, [0.0 - value for value in across]))
    if row["lower"] == row["upper"] in storeys:
        at = storeys.index(row["lower"])
        yield from ({"upper": name} for name in storeys[at + 1 : at + 2])
        yield from ({"lower": name} for name in storeys[max(at - 1, 0) : at])
    else:
        yield {"lower": row["upper"], "upper": row["lower"]}
    if "length" in row:
        yield from ({"length": round(factor * row["length"], 2)} for factor in (1.25, 1.5, 2.0, 3.0, 4.0, 6.0))
    if "rise" in row:
        yield {"going": round(2.0 * row["rise"], 3)}
    if "landing" in row:
        yield {"landing": 1.2}
        if row.get("landings", 1) > 1:
            yield {"landings": 1}
