"""The scenes in which people were measured: geometry, number of people and walking speeds of the experiments.

Exits lie behind the place that is measured, so that people who leave do not vanish in front of others.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from shapely import Polygon, box, union_all

from evac.building.plan.plan import Plan
from evac.evidence.evidence import Row
from evac.evidence.people import measures
from evac.evidence.people.measures import Line, Track, Values
from evac.standard.plans import COUNTERS, across, one_storey, rooms_and_corridor

#: Walking speeds of the participants: corridor, two-way corridor, all others [m/s].
CORRIDOR_SPEED = {"normal": [1.40, 0.15], "minimum": 1.0, "maximum": 1.8}
TWO_WAY_SPEED = {"normal": [1.26, 0.15], "minimum": 0.9, "maximum": 1.7}
SPEED = {"normal": [1.34, 0.26], "minimum": 0.7, "maximum": 2.0}

#: Widths of doors, apart from the narrow one [m].
DOOR_WIDTHS = (0.6, 0.7, 0.8, 1.0, 1.2, 2.0, 2.5)

#: Length of the neck of these doors, other lengths, and the widths of doors with those [m].
NECK, NECKS, NECK_WIDTHS = 0.4, (0.25, 2.8), (0.8, 1.0, 1.2)

#: Widths of corridors with a corner [m], densities of crossing streams [1/m2], speeds of leaders in single file [m/s].
CORNER_WIDTHS, CROSSING_DENSITIES, FILE_SPEEDS = (1.2, 1.8, 2.4, 3.6), (1.5, 2.0), (0.24, 0.50, 0.79)

#: Entrance and exit of the corridor of 1.8 m, in the order of their measured densities [m].
CORRIDOR_ENDS = ((0.5, 1.8), (0.7, 1.8), (1.0, 1.8), (1.45, 1.8), (1.8, 1.8), (1.8, 1.2), (1.8, 0.95), (1.8, 0.7))


class Experiment(NamedTuple):
    """A building, its people, and what is measured there."""

    plan: Plan
    people: Sequence[Row]  # the groups, without names
    speed: Mapping[str, Any]  # distribution of walking speeds
    measure: Callable[[Track], Values]  # called with the track of a run in which everybody came through
    line: Line | None = None  # the run ends when everybody is beyond it; None if everybody must leave


def narrow_door_scene() -> Experiment:
    """Return the bottleneck 040_c_56_h-: a hall 5.6 m wide, and a neck of 0.5 m with a chamfered mouth."""
    neck = Polygon([(-0.25, -1.1), (0.25, -1.1), (0.25, -0.15), (0.4, 0), (-0.4, 0), (-0.25, -0.15)])
    parts, end = (box(-2.8, 0, 2.8, 6.7), neck, box(-3.5, -4, 3.5, -1.1)), [(-3.5, -4), (3.5, -4)]
    plan = one_storey(*parts, exits={"end": end}, areas={"start": box(-2.8, 0.6, 2.8, 5.6)})
    line = Line(1, 0.0, -1)
    return Experiment(plan, [{"area": "start", "number": 75}], SPEED, partial(measures.narrow_door, line=line), line)


def door_scene(width: float, neck: float = NECK) -> Experiment:
    """Return a hall with people at 3.3 per m2, and a door with a neck of the given length, with ground behind it."""
    number, half = (100, 2.5) if width < 1.8 else (180, 3.5)
    parts = box(-half, 0, half, 8), box(-0.5 * width, -neck, 0.5 * width, 0), box(-half, -neck - 2.6, half, -neck)
    start = box(-half, 0.5, half, 0.5 + number / 3.3 / (2.0 * half))
    exits = {"end": [(-half, -neck - 2.6), (half, -neck - 2.6)]}
    plan = one_storey(*parts, exits=exits, areas={"start": start})
    line = Line(1, -0.5 * neck, -1)
    measure = partial(measures.door_flow, line=line, width=width)
    return Experiment(plan, [{"area": "start", "number": number}], SPEED, measure, line)


def corridor_scene(entrance: float, way_out: float) -> Experiment:
    """Return the corridor of 1.8 m behind a hall, with an entrance and an exit of given widths."""
    mouth, end = 0.5 * entrance, 0.5 * way_out
    halls = box(-3, 4, 3, 10), box(-0.9, -4, 0.9, 3.8), box(-3, -8, 3, -4.2)
    doors = box(-mouth, 3.8, mouth, 4), box(-end, -4.2, end, -4)
    exits, areas = {"end": [(-3, -8), (3, -8)]}, {"start": box(-3, 4.6, 3, 10)}
    plan = one_storey(*halls, *doors, exits=exits, areas=areas)
    line = Line(1, -4.1, -1)
    shares = (0.3, 0.75) if way_out == 1.8 else (0.4, 0.75)  # the queue before a narrow exit has to form
    measure = partial(measures.corridor, area=(-2.0, 0.0), width=1.8, out=line, shares=shares)
    return Experiment(plan, [{"area": "start", "number": 110}], CORRIDOR_SPEED, measure, line)


def stair_scene(way: str) -> Experiment:
    """Return the stair of ISO 20414 test 12, 1.2 m wide, with a hall of 8 x 10 m and a landing at either end."""
    width, foot, head = 1.2, 13.0, 10.0
    low, high = 5.0 - 0.5 * width, 5.0 + 0.5 * width
    plan = Plan()
    plan.storey("upper", union_all([box(0, 0, 8, 10), box(8, low, head, high)]), z=3.0)
    plan.storey("lower", union_all([box(15, 0, 23, 10), box(foot, low, 15, high)]), z=0.0)
    plan.stair("stair", "lower", [(foot, low), (foot, high)], "upper", [(head, low), (head, high)])
    if way == "down":
        plan.exit("end", "lower", [(23, 0), (23, 10)])
        plan.area("start", "upper", box(1, 1, 7, 9))
    else:
        plan.exit("end", "upper", [(0, 0), (0, 10)])
        plan.area("start", "lower", box(16, 1, 22, 9))
    line = Line(0, 0.5 * (foot + head), 1 if way == "down" else -1)
    flight = (head + 0.2, foot - 0.2)
    cosine = math.cos(math.atan2(3.0, foot - head))
    measure = partial(measures.stair, line=line, flight=flight, width=width, cosine=cosine)
    return Experiment(plan, [{"area": "start", "number": 100}], SPEED, measure, line)


def two_way_scene(width: float, each: float) -> Experiment:
    """Return a corridor in which two crowds of `each` people per m2 walk towards each other."""
    end, half = 39.0, 0.5 * width
    plan = one_storey(box(-end, -half, end, half))
    people = []
    for side, name, other in ((-1, "left", "right"), (1, "right", "left")):
        plan.exit(name, "floor", [(side * end, -half), (side * end, half)])
        ends = sorted((side * 2.0, side * (end - 0.5)))
        plan.area(f"start {name}", "floor", box(ends[0], -half, ends[1], half))
        number = round(each * width * (end - 2.5))
        people.append({"area": f"start {name}", "number": number, "exits": [other]})
    sign = np.repeat([1, -1], number)
    measure = partial(measures.two_way, sign=sign, half=3.0, width=width, times=(12.0, 32.0))
    return Experiment(plan, people, TWO_WAY_SPEED, measure)


def imo_8_scene(counter: int) -> Experiment:
    """Return IMO 8: a hundred people cross from room to room through a corridor, and `counter` come towards them."""
    plan, people = rooms_and_corridor(counter)
    return Experiment(plan, people, SPEED, partial(measures.last_out, people=100))


def bend_scene() -> Experiment:
    """Return a bend to the left of a corridor of 4 m, with its inner corner at (0, 0), and 90 people before it."""
    exits, areas = {"end": [(0, 18), (4, 18)]}, {"start": box(-14.5, -4, -3, 0)}
    plan = one_storey(box(-15, -4, 4, 0), box(0, -4, 4, 18), exits=exits, areas=areas)
    return Experiment(plan, [{"area": "start", "number": 90, "strategy": "quickest"}], SPEED, measures.bend)


def two_exits_scene() -> Experiment:
    """Return a hall with 200 people near a door of 1 m, and a door of 2 m that is 12 m farther from them."""
    halls = [box(-3, 0, -0.2, 10), box(0, 0, 22, 10), box(22.2, 0, 25, 10)]
    doors = [box(-0.2, 4.5, 0, 5.5), box(22, 4, 22.2, 6)]
    exits = {"near": across(-3, 0, 10), "far": across(25, 0, 10)}
    plan = one_storey(*halls, *doors, exits=exits, areas={"start": box(0.5, 0, 9.5, 10)})
    plan.door("near door", "floor", across(-0.1, 4.5, 5.5))
    plan.door("far door", "floor", across(22.1, 4, 6))
    people = [{"area": "start", "number": 200, "strategy": "quickest"}]
    return Experiment(plan, people, SPEED, partial(measures.last_out, people=200))


def corner_scene(width: float) -> Experiment:
    """Return a corridor with a corner of 90 degrees, and a straight one beside it, each filled with 2.5 per m2."""
    end, up = 16.0, 40.0
    parts = box(-20, 0, width, width), box(0, 0, width, end), box(-20, up, end, up + width)
    exits = {"corner": [(0.0, end), (width, end)], "straight": across(end, up, up + width)}
    starts = {name: box(-19.7, y + 0.1, -3, y + width - 0.1) for name, y in (("corner", 0.0), ("straight", up))}
    plan = one_storey(*parts, exits=exits, areas=starts)
    number = round(2.5 * starts["corner"].area)
    people = [{"area": name, "number": number, "exits": [name]} for name in starts]
    lines = Line(1, width + 2.0, 1), Line(0, width + 2.0, 1)
    return Experiment(plan, people, SPEED, partial(measures.flow_beside, lines=lines))


def crossing_scene(density: float) -> Experiment:
    """Return two streams that cross in corridors of 4 m, and one stream alone in a corridor beside them."""
    parts = box(-16, -2, 16, 2), box(-2, -16, 2, 16), box(-16, 30, 16, 34)
    exits = {"east": across(16, -2, 2), "north": [(-2.0, 16.0), (2.0, 16.0)], "alone": across(16, 30, 34)}
    areas = {"east": box(-15.7, -2, -4, 2), "north": box(-2, -15.7, 2, -4), "alone": box(-15.7, 30, -4, 34)}
    plan = one_storey(*parts, exits=exits, areas=areas)
    number = round(density * areas["alone"].area)
    people = [{"area": name, "number": number, "exits": [name]} for name in areas]
    return Experiment(plan, people, SPEED, partial(measures.last_beside, alone=number))


def junction_scene() -> Experiment:
    """Return a T-junction: two corridors of 2.4 m that merge into one of 3 m, with people at 2.5 per m2 in both."""
    parts, end = (box(-16, 0, 16, 2.4), box(-1.5, -12, 1.5, 0)), [(-1.5, -12.0), (1.5, -12.0)]
    areas = {"left": box(-15.7, 0.1, -3, 2.3), "right": box(3, 0.1, 15.7, 2.3)}
    plan = one_storey(*parts, exits={"end": end}, areas=areas)
    number = round(2.5 * areas["left"].area)
    people = [{"area": name, "number": number} for name in areas]
    return Experiment(plan, people, SPEED, partial(measures.share_of_first, line=Line(1, -2.0, -1), first=number))


def file_scene(speed: float) -> Experiment:
    """Return a corridor of 0.5 m with 18 people behind one who walks at a given speed."""
    length, body = 80.0, {"number": 18, "speed": 1.24, "tau": 0.3, "radius": 0.15}
    areas = {"lead": box(18.2, 0.2, 18.8, 0.3), "start": box(1, 0.15, 18, 0.35)}
    plan = one_storey(box(0, 0, length, 0.5), exits={"end": across(length, 0, 0.5)}, areas=areas)
    people = [{**body, "area": "lead", "number": 1, "speed": speed}, {**body, "area": "start"}]
    return Experiment(plan, people, SPEED, partial(measures.distance_in_file, behind=10), Line(0, 40.0, 1))


NARROW_DOOR, BEND, TWO_EXITS = "door 0.5 m", "bend 4 m", "two exits"
STAIR_DOWN, STAIR_UP, TWO_WAY_4, TWO_WAY_2 = "stair down", "stair up", "two-way 4 m", "two-way 2 m"
IMO_8, JUNCTION = "IMO 8", "T-junction"


#: Names of doors by width [m], corridors by entrance and exit [m], and IMO 8 by the number of those who come towards.
door_name, corridor_name = "door {:g} m".format, "corridor {:g} to {:g} m".format
imo_8_name = f"{IMO_8} against {{}}".format
neck_name, corner_name = "door {:g} m, neck {:g} m".format, "corner {:g} m".format
crossing_name, file_name = "crossing at {:g} per m2".format, "single file at {:g} m/s".format

#: Scenes in which only the default movement model is measured.
OF_DEFAULT: Mapping[str, Callable[[], Experiment]] = {
    **{neck_name(width, neck): partial(door_scene, width, neck) for neck in NECKS for width in NECK_WIDTHS},
    **{corner_name(width): partial(corner_scene, width) for width in CORNER_WIDTHS},
    **{crossing_name(density): partial(crossing_scene, density) for density in CROSSING_DENSITIES},
    JUNCTION: junction_scene,
    **{file_name(speed): partial(file_scene, speed) for speed in FILE_SPEEDS},
}

#: All scenes by name.
SCENES: Mapping[str, Callable[[], Experiment]] = {
    NARROW_DOOR: narrow_door_scene,
    **{door_name(width): partial(door_scene, width) for width in DOOR_WIDTHS},
    **{corridor_name(*ends): partial(corridor_scene, *ends) for ends in CORRIDOR_ENDS},
    STAIR_DOWN: partial(stair_scene, "down"),
    STAIR_UP: partial(stair_scene, "up"),
    TWO_WAY_4: partial(two_way_scene, 4.0, 0.45),
    TWO_WAY_2: partial(two_way_scene, 2.0, 1.25),
    **{imo_8_name(counter): partial(imo_8_scene, counter) for counter in COUNTERS},
    BEND: bend_scene,
    TWO_EXITS: two_exits_scene,
    **OF_DEFAULT,
}
