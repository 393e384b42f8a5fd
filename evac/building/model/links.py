"""Portals, exits and stairs by name, their closing, and the levels from which exits can be reached."""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import shapely

from evac.base.arrays import FloatArray
from evac.base.change import BODIES, CLOSES, LEAVE, OPENS, Change, Control, Moving
from evac.base.errors import BuildingError
from evac.base.parameters import did_you_mean
from evac.building.geometry import connected_components, place_of
from evac.building.model.building import Area, Building, Door, Exit, Portal, Ride
from evac.building.model.findings import Finding, item_of

ON_OUTLINE = 0.05  #: Distance from the outline of an area within which a link leads into it [m].


def links_named(building: Building, name: str) -> frozenset[int]:
    """Return the links of an exit, portal or door with a given name, or the portals of a stair or shaft."""
    own = [link for link in building.links if not isinstance(link, Ride)]
    links = {number for number, link in enumerate(own) if link.name == name}
    for lift in building.lifts:
        if not links.isdisjoint(door for doors in lift.doors for door in doors):
            raise BuildingError(
                f"{building.source}: {name!r} is a door of lift {lift.name!r}, which the lift opens and closes; "
                f"name the lift, to take it out of service"
            )
    links |= {portal.index for level in building.pieces_of(name) for portal in building.portals_of(level)}
    if not links:
        known = [*(link.name for link in own), *building.stairs, *building.shafts]
        raise BuildingError(
            f"{building.source}: no exit, portal, stair or door is named {name!r}; {did_you_mean(name, known)}"
        )
    return frozenset(links)


def ways_onto(building: Building, level: int) -> dict[str, list[Portal]]:
    """Return the portals of a level by their names and by those of the stairs behind them."""
    ways: dict[str, list[Portal]] = {}
    for portal in building.portals_of(level):
        for name in {portal.name, building.levels[portal.other(level)].stair or portal.name}:
            ways.setdefault(name, []).append(portal)
    return ways


def _origin(building: Building, link: int, towards: str) -> int:
    """Return where a link is passed from in a direction, as in `Building.one_way`; see the event ``one_way``."""
    way = building.links[link]
    if isinstance(way, Door):
        return _side_from(building, way, towards)
    if isinstance(way, Exit):
        if towards not in ("in", "out"):
            raise BuildingError(f"{building.source}: exit {way.name!r} does not lead to {towards!r}; use 'in' or 'out'")
        return way.level if towards == "out" else -1
    assert isinstance(way, Portal)
    ends = {building.levels[level].title: way.other(level) for level in way.levels}
    ends |= {building.levels[level].name: way.other(level) for level in way.levels}
    if towards in ("up", "down"):
        low, high = sorted(way.levels, key=lambda k: building.levels[k].z_min + building.levels[k].z_max)
        return low if towards == "up" else high
    if towards not in ends:
        known = ", ".join(map(repr, ("up", "down", *ends)))
        raise BuildingError(f"{building.source}: portal {way.name!r} does not lead to {towards!r}; use one of {known}")
    return ends[towards]


def _side_from(building: Building, door: Door, towards: str) -> int:
    """Return the side of a door from which an area is reached through it: 0 for the left of its segment, or 1."""
    areas = {area.name: area for area in building.areas if area.level == door.level}
    if towards in areas:
        left, right = shapely.distance(areas[towards].polygon, _sides(door))
        if left != right:
            return int(left < right)
    known = did_you_mean(towards, list(areas))
    raise BuildingError(
        f"{building.source}: door {door.name!r} does not lead to {towards!r}; name an area on one side of it; {known}"
    )


def changed(building: Building, change: Change) -> Building:
    """Return a building after a change, or itself if the change does not concern it or has no effect."""
    value = change.values.get("value")
    match change.kind:
        case "open" | "close" if any(lift.name == change.what for lift in building.lifts):
            from evac.building.model.lifts import with_service

            after = with_service(building, change.what, change.kind == "open")
        case "close" if value == LEAVE:
            after = replace(_without_entry(building, change.what), emptying=building.emptying | {change.what})
        case "open" | "close":
            links = links_named(building, change.what)
            is_open = change.kind == "open"
            closed = building.closed - links if is_open else building.closed | links
            awaited = building.awaited | links if value == BODIES else building.awaited - links
            if change.what in building.emptying:
                building = replace(_without_entry(building, change.what, ends=True))
            after = replace(building, closed=closed, awaited=awaited, emptying=building.emptying - {change.what})
        case "no_entry":
            after = _without_entry(building, change.what, ends=value is False)
        case "control":
            names = {change.what: None if value is False else Control.model_validate(value)}
            after = with_controls(building, names)
        case "one_way":
            links = links_named(building, change.what)
            levels = {level for link in links for level in building.links[link].levels}
            if not levels.isdisjoint(level for level, _, _ in building.moving):
                raise BuildingError(
                    f"{building.source}: {change.what!r} leads onto ground that moves, and is passed in its direction; "
                    f"use an event of kind 'move'"
                )
            ways = {(link, _origin(building, link, value)) for link in links if isinstance(value, str)}
            after = replace(building, one_way=_replaced(building.one_way, links, ways))
        case "move":
            after = set_moving(building, change.what, None if value is False else Moving.model_validate(value))
        case "slow":
            name, share = _area(building, change.what), float(1.0 if value is None else value)
            slowed = {one for one in building.slowed if one[0] != name}
            after = replace(building, slowed=frozenset(slowed | ({(name, share)} if share < 1.0 else set())))
        case "bar":
            name = _area(building, change.what)
            free = building.barred - {name}
            after = replace(building, barred=free if value is False else free | {name})
        case "lift" if value is not None:
            if value[0] not in (OPENS, CLOSES):
                return building
            lift = next(lift for lift in building.lifts if lift.name == change.what)
            doors = frozenset(lift.doors[lift.storeys.index(value[1])])
            after = replace(building, closed=building.closed - doors if value[0] == OPENS else building.closed | doors)
        case _:
            return building
    return building if after.condition == building.condition else after


def _replaced(pairs: frozenset[tuple[int, Any]], links: Collection[int], new: set[tuple[int, Any]]) -> frozenset[Any]:
    """Return pairs that begin with a link, in which new ones take the place of those of some links."""
    return frozenset({one for one in pairs if one[0] not in links} | new)


def with_controls(building: Building, controls: Mapping[str, Control | None]) -> Building:
    """Return a building with controls of links by name, None for no control."""
    for name, control in controls.items():
        pieces = set(building.pieces_of(name))  # a stair lets people through at its ends, not between its pieces
        links = {link for link in links_named(building, name) if not pieces.issuperset(building.links[link].levels)}
        new = set() if control is None else {(link, control) for link in links}
        building = replace(building, controls=_replaced(building.controls, links, new))
    return building


def set_moving(building: Building, name: str, moving: Moving | None) -> Building:
    """Return a building in which the ground of a stair moves, and is passed in this direction only; None: it stops."""
    pieces = building.pieces_of(name)
    if not pieces:
        raise BuildingError(
            f"{building.source}: no stair is named {name!r} that could move; {did_you_mean(name, [*building.stairs])}"
        )
    flights = [level for level in pieces if building.levels[level].slope > 0.0]
    velocities = {} if moving is None else {level: _velocity(building, level, moving) for level in flights or pieces}
    ways = set()
    for level, velocity in velocities.items():
        for portal in building.portals_of(level):
            is_ahead = velocity @ _from_centre(building, level, portal) > 0.0
            ways.add((portal.index, level if is_ahead else portal.other(level)))
    links = {portal.index for level in flights or pieces for portal in building.portals_of(level)}
    others = {one for one in building.moving if one[0] not in pieces}
    return replace(
        building,
        moving=frozenset(others | {(level, *velocity.tolist()) for level, velocity in velocities.items()}),
        one_way=_replaced(building.one_way, links, ways),
    )


def _velocity(building: Building, number: int, moving: Moving) -> FloatArray:
    """Return the velocity of the ground of a level in plan, (2,) [m/s]."""
    level, towards, way = building.levels[number], moving.towards, np.zeros(2)
    beside = [(portal, building.levels[portal.other(number)]) for portal in building.portals_of(number)]
    if isinstance(towards, float):
        way = np.array([math.cos(math.radians(towards)), math.sin(math.radians(towards))])
    elif towards in ("up", "down"):
        way = level.uphill if towards == "up" else -level.uphill
    for portal, other in beside:
        if towards in (other.name, other.title):
            way = way + _from_centre(building, number, portal)
    if level.slope > 0.0:
        way = level.uphill * np.sign(way @ level.uphill)
    ways = [_from_centre(building, number, portal) for portal, _ in beside]
    if not any(abs(way @ one) > 0.5 * np.hypot(*way) * np.hypot(*one) for one in ways):
        known = did_you_mean(str(towards), [other.title for _, other in beside])
        known += "; or give the direction of its ends in degrees" if level.slope == 0.0 else "; or 'up' or 'down'"
        raise BuildingError(f"{building.source}: {level.title!r} does not move towards {towards!r}; {known}")
    velocity: FloatArray = moving.speed * math.cos(level.slope) * way / np.hypot(*way)
    return velocity


def _from_centre(building: Building, level: int, portal: Portal) -> FloatArray:
    """Return the way in plan from the centre of a level to the middle of one of its portals, (2,) [m]."""
    centre = building.levels[level].polygon.centroid
    middle: FloatArray = portal.segments.reshape(-1, 2).mean(axis=0) - [centre.x, centre.y]
    return middle


def _without_entry(building: Building, name: str, ends: bool = False) -> Building:
    """Return a building in which the links of an area, level, stair or shaft lead out of it only, or no more so."""
    parts = building.parts_named(_area(building, name))
    ways = {(link, side) for part in parts for link, side in _ways_out(building, part, {one.level for one in parts})}
    if not ways:
        raise BuildingError(
            f"{building.source}: nothing leads into {name!r} that could be closed; name a stair or level"
        )
    return replace(building, one_way=_replaced(building.one_way, {link for link, _ in ways}, set() if ends else ways))


def _ways_out(building: Building, part: Area, inside: Collection[int]) -> Iterable[tuple[int, int]]:
    """Yield the links on the outline of a part, each with where it is passed from to leave it, as `one_way`."""
    for number, link in enumerate(building.links):
        if part.level not in link.levels or isinstance(link, Ride) or number in building.lift_doors:
            continue
        if isinstance(link, Door):
            off = shapely.distance(part.polygon, _sides(link)).tolist()
            if min(off) == 0.0 < max(off):
                yield number, off.index(0.0)
        elif not (isinstance(link, Portal) and link.other(part.level) in inside):
            middle = shapely.points(link.segments.reshape(-1, 2, 2).mean(axis=1))
            if (shapely.distance(part.polygon, middle) < ON_OUTLINE).all():
                yield number, part.level


def _sides(door: Door) -> Any:
    """Return a point on either side of a door, to the left of its segment first."""
    ends = door.segment.reshape(2, 2)
    along = ends[1] - ends[0]
    across = 0.5 * door.width * np.array([-along[1], along[0]]) / np.hypot(*along)
    return shapely.points(ends.mean(axis=0) + across * np.array([[1.0], [-1.0]]))


def _area(building: Building, name: str) -> str:
    """Return the name of an area, level, stair or shaft, if there is one."""
    if not building.parts_named(name):
        known = [area.name for area in building.areas] + [level.title for level in building.levels]
        raise BuildingError(
            f"{building.source}: no area, level or stair is named {name!r}; {did_you_mean(name, known)}"
        )
    return name


def building_at(building: Building, changes: Iterable[Change], time: float) -> Building:
    """Return a building, given as it is at the start, as it is at a time [s] after the changes until then."""
    for change in changes:
        if change.time <= time:
            building = changed(building, change)
    return building


def states_of(building: Building, changes: Iterable[Change]) -> list[list[tuple[float, bool]]]:
    """Return for each link whether it is open at the start, with time 0, and each time [s] at which that changes."""
    states = [[(0.0, link not in building.closed)] for link in range(len(building.links))]
    for change in changes:
        after = building_at(building, [change], change.time)
        for link in after.closed ^ building.closed:
            states[link].append((change.time, link not in after.closed))
        building = after
    return states


def close_links(building: Building, names: Sequence[str]) -> Building:
    """Return the building with exits, portals and stairs closed for the whole run; closed links are walls."""
    closed = building.closed.union(*(links_named(building, name) for name in names))
    stairs = set[int]().union(*map(building.pieces_of, names))
    result = replace(building, closed=closed)
    cut_off = [note for note in isolated_parts(result, stairs) if note not in building.findings]
    return replace(result, findings=(*building.findings, *cut_off))


def levels_reaching(
    building: Building, exits: Iterable[Exit | Area], barred: Collection[tuple[int, int]] = (), lifts: bool = True
) -> set[int]:
    """Return the levels from which one of some open exits or areas can be reached.

    The portals `barred` are not passed from the level with which they are given.
    """
    reached = {exit_.level for exit_ in exits}
    waiting, jumped = list(reached), dict[int, set[int]]()
    for start, end in jumped_levels(building, lifts):
        jumped.setdefault(end, set()).add(start)
    while waiting:
        level = waiting.pop()
        behind = [(portal, portal.other(level)) for portal in building.portals_of(level)]
        leading = ((one, other) for one, other in behind if building.leads_from(one, other))
        more = {other for one, other in leading if (one.index, other) not in barred}
        more |= jumped.get(level, set())
        waiting += more - reached
        reached |= more
    return reached


def jumped_levels(building: Building, lifts: bool = True) -> list[tuple[int, int]]:
    """Return the levels of the start and of the end of each jump."""
    level = {area.name: area.level for area in (*building.areas, *(building.backs if lifts else ()))}
    return [(level[jump.start], level[jump.end]) for jump in building.jumps if jump.start in level]


def isolated_parts(building: Building, closed: Collection[int] = ()) -> tuple[Finding, ...]:
    """Warn of levels from which no exit can be reached, except the levels in `closed`."""
    pairs = [portal.levels for portal in building.portals if building.for_ways.is_open(portal)]
    pairs += jumped_levels(building)
    part = connected_components(len(building.levels), np.array(pairs, dtype=np.int64).reshape(-1, 2))
    open_levels = {way.level for way in building.exits if building.is_open(way)}
    notes = []
    for number in np.unique(part):
        members = np.flatnonzero(part == number).tolist()
        if open_levels.isdisjoint(members) and not set(members) <= set(closed):
            names = list(dict.fromkeys(building.levels[index].title for index in members))
            others = f" and its neighbours {', '.join(map(repr, names[1:]))}" if len(names) > 1 else ""
            area = sum(building.levels[index].polygon.area for index in members)
            text = f"no exit can be reached from {names[0]!r}{others}, {area:.2f} m2: people there cannot leave"
            first = building.levels[members[0]]
            notes.append(Finding("warning", text, first.title, place_of(first.polygon), item_of(first)))
    return tuple(notes)
