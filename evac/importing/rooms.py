"""The rooms of a building, and the number of people in each."""

from dataclasses import dataclass, replace

import numpy as np

from evac.building.model.building import Building
from evac.building.model.findings import Finding
from evac.building.model.links import levels_reaching

#: Greatest density of people in an area; the others start on the floor around it [1/m2].
FULL = 3.0


@dataclass(frozen=True)
class Room:
    """An area, or a floor without areas: its key in a case, its name, level, ground [m2] and number of people."""

    key: str
    name: str
    level: int
    ground: float
    number: int = 0


def find_rooms(building: Building) -> list[Room]:
    """Return the areas of a building, and the floors without areas."""
    rooms = [Room("area", area.name, area.level, float(area.polygon.area)) for area in building.areas]
    taken = {room.level for room in rooms}
    floors = [level for level in building.levels if level.kind == "floor" and level.index not in taken]
    rooms += [Room("level", level.name, level.index, float(level.polygon.area)) for level in floors]
    return sorted(rooms, key=lambda room: (room.level, room.name))


def fill(building: Building, rooms: list[Room], people: int | None, density: float) -> tuple[list[Room], list[Finding]]:
    """Return the rooms with their numbers of people, 0 where no exit can be reached, and what was assumed.

    Parameters
    ----------
    building : Building
    rooms : list of Room
    people : int, optional
        Total number, divided among the rooms by area.
    density : float [1/m2]
        Used if `people` is not given.
    """
    open_levels = levels_reaching(building, building.exits) if building.exits else set(range(len(building.levels)))
    used = [room for room in rooms if room.level in open_levels]
    closed = [replace(room, number=0) for room in rooms if room not in used]
    if people is None:
        counts = [max(int(density * room.ground + 0.5), 1) for room in used]
        return [replace(room, number=count) for room, count in zip(used, counts, strict=True)] + closed, []
    areas = [room for room in used if room.key == "area"]
    around = _around(building, areas)
    if not around or people <= FULL * sum(room.ground for room in used):
        return _divided(people, used) + closed, []
    areas = [replace(room, number=int(FULL * room.ground)) for room in areas]
    held = sum(room.number for room in areas)
    text = f"{held} people start in areas, {FULL:g} per square metre; the other {people - held} start on the floors"
    note = Finding("assumed", text, building.levels[areas[0].level].name)
    return areas + _divided(people - held, [room for room in used if room.key == "level"] + around) + closed, [note]


def _around(building: Building, areas: list[Room]) -> list[Room]:
    """Return the floors around areas, without the areas."""
    floors = []
    for index in sorted({room.level for room in areas}):
        level = building.levels[index]
        ground = float(level.polygon.area) - sum(room.ground for room in areas if room.level == index)
        floors.append(Room("level", level.name, index, max(ground, 0.0)))
    return floors


def _divided(people: int, rooms: list[Room]) -> list[Room]:
    """Return rooms with people divided by area; the largest remainder method makes the numbers add up."""
    ground = np.array([room.ground for room in rooms])
    share = people * ground / max(ground.sum(), 1e-9)
    number = np.floor(share)
    rest = int(people - number.sum()) if len(rooms) else 0
    number[np.argsort(-(share - number), kind="stable")[:rest]] += 1.0
    return [replace(room, number=int(count)) for room, count in zip(rooms, number, strict=True)]
