"""Expansion of the short forms of a plan: rooms to ground and areas, shafts to stairs; repeated storeys, and ties."""

import copy
import difflib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import fields, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.defaults import DOOR_REACH, LEAST_LENGTH
from evac.base.parameters import did_you_mean
from evac.base.toml import toml_value
from evac.building.geometry import GRID, flat_parts, pieces_along, place_of, rounded, segment_lengths, sides
from evac.building.model.findings import Finding, noting
from evac.building.plan.plan import Item, Plan, Room, Shaft, Stair, Storey, Tie

Named = TypeVar("Named", Item, Room)
REPEATED = ("doors", "areas", "obstacles")  #: What a storey that is like another repeats.


def expanded(plan: Plan, errors: list[Finding]) -> Plan:
    """Return the plan with all ground in polygons of storeys, and stairs from storey to storey; notes errors."""
    flat, order = copy.copy(plan), dict[str, list[str]]()
    for name in plan.storeys:
        chain = originals(plan, name)
        if plan.storeys[[name, *chain][-1]].like is None:
            order[name] = chain
    rooms = {name: _rooms(plan, name, order[name]) for name in order}
    flat.rooms = [room for own in rooms.values() for room in own]
    outlines = {name: {room.name: room.outline for room in own} for name, own in rooms.items()}
    walls = _walls_of(plan, outlines)
    for kind in (*REPEATED, "exits", "openings"):
        own = [tied for item in getattr(plan, kind) if (tied := _tied(plan, kind, item, outlines, walls, errors))]
        if kind in REPEATED:
            own += [
                _copied(kind, item, original, name)
                for name, originals in order.items()
                for original in originals
                for item in own
                if item.storey == original
            ]
        setattr(flat, kind, own)
    flat.areas += [
        Item(one.name, name, polygons=one.polygons, key=key_of("rooms", one))
        for name, own in rooms.items()
        for one in own
        if one.is_area
    ]
    taken: dict[str, Item] = {}
    for area in sorted(flat.areas, key=lambda area: not key_of("areas", area).startswith("rooms.")):
        with noting(errors, f"area {area.name!r}", key_of("areas", area), area.storey, area.polygons[0]):
            if taken.setdefault(area.name, area) is not area:
                raise ValueError("another area or room has the same name; rename one")
    flat.areas = [area for area in flat.areas if taken[area.name] is area]
    flat.storeys, flat.stairs = {}, [*plan.stairs]
    for name in order:
        with noting(errors, f"storey {name!r}", f"storeys.{name}", name):
            flat.storeys[name] = _storey(plan, name, order[name], rooms[name])
    for shaft in plan.shafts:
        with noting(errors, f"shaft {shaft.name!r}", f"shafts.{shaft.name}", None, shaft.lower_edge):
            flat.stairs += _stairs(plan, shaft)
    return flat


def with_known_storeys(plan: Plan, errors: list[Finding]) -> Plan:
    """Return the plan with the closest storeys for those that it does not have, of rooms and `like`; notes errors."""
    known = copy.copy(plan)
    known.storeys = dict(plan.storeys)
    for name, storey in plan.storeys.items():
        like = storey.like
        others = [one for one in plan.storeys if name not in (one, *originals(known, one))]
        if like is None or like in others or like in plan.refused:
            continue
        text, close = f"no storey is named {like!r}; {did_you_mean(like, others)}", close_to(like, others)
        if like in plan.storeys:
            text, close = "it is like itself; name another storey", []
        right = next(iter(close or others[::-1]), None)
        remedy = f"like = {toml_value(right)}" if right else "remove like"
        errors.append(Finding("error", f"storey {name!r}: like: {text}", name, None, f"storeys.{name}", remedy))
        known.storeys[name] = replace(storey, like=right)
    known.rooms = [_on_known_storey(plan, room, errors) for room in plan.rooms]
    return known


def _on_known_storey(plan: Plan, room: Room, errors: list[Finding]) -> Room:
    """Return a room on the closest storey if a plan does not have its own, with an error."""
    if room.storey in plan.storeys or room.storey in plan.refused:
        return room
    close = close_to(room.storey, plan.storeys) or [*plan.storeys][:1]
    text = f"room {room.name!r}: no storey is named {room.storey!r}; {did_you_mean(room.storey, list(plan.storeys))}"
    remedy = f"storey = {toml_value(close[0])}" if close else ""
    errors.append(Finding("error", text, None, place_of(room.outline), f"rooms.{room.name}", remedy))
    return replace(room, storey=close[0]) if close else room


def close_to(name: str, known: Iterable[str]) -> list[str]:
    """Return the known name that is most similar to one, if any is similar."""
    return difflib.get_close_matches(name, [*known], 1, 0.5)


def key_of(section: str, item: Item | Room | Stair) -> str:
    """Return the key of an item, or of that which it repeats."""
    return item.key or f"{section}.{item.name}"


def check_storey(storeys: Collection[str], name: str) -> None:
    """Refuse the name of a storey that a plan does not have."""
    if name not in storeys:
        raise ValueError(f"no storey is named {name!r}; {did_you_mean(name, list(storeys))}")


def originals(plan: Plan, name: str) -> list[str]:
    """Return the storeys that a storey is like, directly or through others, as far as they are known."""
    found = [name]
    while (like := plan.storeys[found[-1]].like) in plan.storeys and like not in found:
        found.append(str(like))
    return found[1:]


def _copied(section: str, item: Named, original: str, storey: str) -> Named:
    """Return an item of one storey on another one that is like it."""
    name = f"{storey} {item.name.removeprefix(original).strip()}"
    return replace(item, name=name, storey=storey, key=key_of(section, item))


def _rooms(plan: Plan, name: str, originals: list[str]) -> list[Room]:
    """Return the rooms of a storey with those that it repeats."""
    own = [room for room in plan.rooms if room.storey == name]
    return own + [_copied("rooms", room, one, name) for one in originals for room in plan.rooms if room.storey == one]


def _storey(plan: Plan, name: str, originals: list[str], rooms: list[Room]) -> Storey:
    """Return a storey with the ground of its rooms, or of those of the storey that it is like."""
    given = [plan.storeys[one] for one in (name, *originals)]
    ground = [polygon for one in given for polygon in one.polygons]
    ground += [polygon for room in rooms for polygon in room.polygons]
    if not ground and given[0].file is None:
        raise ValueError("it has no ground: give it polygons, a file or rooms")
    wall = next((one.wall for one in given if one.wall is not None), 0.0)
    return replace(given[0], polygons=tuple(ground), wall=wall, like=None)


def _tied(
    plan: Plan,
    section: str,
    item: Item,
    outlines: Mapping[str, Mapping[str, BaseGeometry]],
    walls: Mapping[tuple[str, tuple[str, ...]], FloatArray],
    errors: list[Finding],
) -> Item | None:
    """Return an item whose tie to rooms or walls is a segment or polygons, or None with an error."""
    if item.tie is None:
        return item
    known = outlines.get(item.storey, {})
    at = next((known[name] for name in item.tie.rooms if name in known), None)
    with noting(errors, f"{section.removesuffix('s')} {item.name!r}", key_of(section, item), item.storey, at):
        check_storey({*plan.storeys, *plan.refused}, item.storey)
        if item.storey not in outlines or plan.refused.intersection(item.tie.rooms):  # which have errors of their own
            return None
        for name in item.tie.rooms:
            if name not in known:
                hint = did_you_mean(name, list(known))
                raise ValueError(f"no room of storey {item.storey!r} is named {name!r}; {hint}")
        one, *other = [known[name] for name in item.tie.rooms]
        if section == "areas":
            inner = one.buffer(-(item.tie.inset or 0.0), join_style="mitre")
            if inner.is_empty:
                raise ValueError(f"inset = {item.tie.inset:g} leaves nothing of room {item.tie.rooms[0]!r}; reduce it")
            return replace(item, polygons=(flat_parts(shapely.set_precision(inner, GRID)),), tie=None)
        wall = walls.get((item.storey, item.tie.rooms)) if other else _side(item.tie, one)
        if wall is None:
            names = " and ".join(map(repr, item.tie.rooms))
            raise ValueError(f"no wall at most {DOOR_REACH:g} m thick is between {names}")
        return replace(item, segment=_part(item.tie, wall), tie=None)
    return None


def _walls_of(
    plan: Plan, outlines: Mapping[str, Mapping[str, BaseGeometry]]
) -> dict[tuple[str, tuple[str, ...]], FloatArray]:
    """Return the longest straight wall (2, 2) between two rooms, by storey and rooms, of all that are tied to two."""
    # It is given from its end with the least (x, y), in the middle of a wall that is drawn with both its faces.
    items = (item for kind in (*REPEATED, "exits", "openings") for item in getattr(plan, kind) if item.tie is not None)
    ties = {(item.storey, item.tie.rooms) for item in items if len(item.tie.rooms) == 2}
    pairs = [one for one in sorted(ties) if outlines.get(one[0], {}).keys() >= {*one[1]}]
    tied = {(storey, room) for storey, rooms in pairs for room in rooms}
    lines = {(storey, room): sides(outlines[storey][room]) for storey, room in tied}
    both = [(lines[storey, one], lines[storey, other]) for storey, (one, other) in pairs]
    own = np.concatenate([np.empty((0, 4)), *(np.tile(one, (len(other), 1)) for one, other in both)])
    others = np.concatenate([np.empty((0, 4)), *(other.repeat(len(one), axis=0) for one, other in both)])
    pair = np.array([row for row, (one, other) in enumerate(both) for _ in range(len(one) * len(other))], np.int64)
    (low, high), (least, most) = (np.sort(each.reshape(-1, 2, 2), axis=1).swapaxes(0, 1) for each in (own, others))
    reach = DOOR_REACH + LEAST_LENGTH
    is_near = ((high + reach >= least) & (most + reach >= low)).all(axis=1)
    own, others, pair = own[is_near], others[is_near], pair[is_near]
    pieces, found = pieces_along(own, others, DOOR_REACH)
    near, start, end = rounded(pieces).reshape(-1, 2, 2), others[found, None, :2], others[found, None, 2:]
    step = (end - start) / np.linalg.norm(end - start, axis=-1, keepdims=True)
    far = start + ((near - start) * step).sum(axis=-1, keepdims=True) * step
    walls = (near + far) / 2
    order = np.lexsort((-segment_lengths(walls.reshape(-1, 4)), pair[found]))
    rows, first = np.unique(pair[found][order], return_index=True)
    longest = zip(rows.tolist(), walls[order[first]], strict=True)
    return {pairs[row]: wall[np.lexsort(wall.T[::-1])] for row, wall in longest}


def _side(tie: Tie, room: BaseGeometry) -> FloatArray:
    """Return the wall from one corner of a room to the next."""
    corners = shapely.get_coordinates(room.exterior)
    assert tie.side is not None
    if not tie.side < len(corners) - 1:
        raise ValueError(f"room {tie.rooms[0]!r} has no side {tie.side}; its sides are 0 to {len(corners) - 2}")
    wall: FloatArray = corners[tie.side : tie.side + 2]
    return wall


def _part(tie: Tie, wall: FloatArray) -> FloatArray:
    """Return the part of a wall (2, 2) that a tie names."""
    length = float(np.hypot(*(wall[1] - wall[0])))
    width = length if tie.width is None else tie.width
    start = (length / 2 if tie.at is None else tie.at) - width / 2
    if not -LEAST_LENGTH <= start <= length - width + LEAST_LENGTH:
        raise ValueError(
            f"the wall is {length:.2f} m long: {width:.2f} m from {start:.2f} m on are not within it; at must be "
            f"between {width / 2:.2f} and {length - width / 2:.2f}, or width less"
        )
    return rounded(wall[0] + np.outer([start, start + width], (wall[1] - wall[0]) / length))


def _stairs(plan: Plan, shaft: Shaft) -> list[Stair]:
    """Return the stairs of a shaft, from the lowest storey up."""
    names = list(plan.storeys)
    for name in (shaft.lower, shaft.upper):
        check_storey({*names, *plan.refused}, name)
    if shaft.lower not in names or shaft.upper not in names:
        return []
    first, last = names.index(shaft.lower), names.index(shaft.upper)
    if first == last:
        raise ValueError(f"it begins and ends on storey {shaft.lower!r}; name another one")
    way = names[first : last + 1] if first <= last else names[last : first + 1][::-1]
    stairs = []
    for number, (lower, upper) in enumerate(pairwise(way)):
        length = shaft.length
        if shaft.rise is not None and shaft.going is not None:
            run = (plan.storeys[upper].z - plan.storeys[lower].z) * shaft.going / shaft.rise
            is_bent = shaft.turn is not None or shaft.upper_edge is not None
            length = round(run / 2 if is_bent else run + (shaft.landing or 0.0) * shaft.landings, 6)
        values = {one.name: getattr(shaft, one.name) for one in fields(Stair)}
        values |= {"lower": lower, "upper": upper, "length": length, "key": key_of("shafts", shaft)}
        stairs.append(Stair(**values | {"name": f"{shaft.name} {number}" if len(way) > 2 else shaft.name}))
    return stairs
