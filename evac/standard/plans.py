"""Buildings of the standard tests."""

from collections.abc import Mapping, Sequence
from typing import Any

from shapely import box, union_all
from shapely.geometry.base import BaseGeometry

from evac.building.plan.plan import Plan

Row = dict[str, Any]  #: A table of the file of a case, such as a group of people.

Shape = Sequence[tuple[float, float]]

FLOOR = "floor"  #: Name of the storey of buildings with one storey.

#: Speed of the crowd where a test names none: men of 30 to 50 years (IMO MSC.1/Circ.1533, annex 3) [m/s].
CROWD_SPEED = {"uniform": [0.97, 1.62]}

COUNTERS = (0, 10, 50, 100)  #: Numbers of people who come towards the hundred of IMO 8.


def one_storey(
    *parts: BaseGeometry, exits: Mapping[str, Shape] | None = None, areas: Mapping[str, BaseGeometry] | None = None
) -> Plan:
    """Return a building with one storey at height 0."""
    plan = Plan()
    plan.storey(FLOOR, union_all(parts))
    for name, segment in (exits or {}).items():
        plan.exit(name, FLOOR, segment)
    for name, area in (areas or {}).items():
        plan.area(name, FLOOR, area)
    return plan


def across(x: float, y1: float, y2: float) -> Shape:
    """Return the segment at `x` from y1 to y2 [m]."""
    return [(x, y1), (x, y2)]


def crowd(number: int, area: str = "start", **keys: Any) -> Row:
    """Return a group of people in an area."""
    return {"area": area, "number": number, "speed": CROWD_SPEED, **keys}


def straight_stair(run: float, rise: float, landing: float = 5.0, width: float = 2.0) -> Plan:
    """Return a stair upwards along x from (0, 0), with a floor before and behind it [m]; exits are named up, down."""
    plan = Plan()
    plan.storey("lower", box(-landing, 0, 0, width), 0.0)
    plan.storey("upper", box(run, 0, run + landing, width), rise)
    plan.stair("stair", "lower", across(0, 0, width), "upper", across(run, 0, width))
    plan.exit("down", "lower", across(-landing, 0, width))
    plan.exit("up", "upper", across(run + landing, 0, width))
    return plan


def halls_and_stair(way: str, width: float, run: float, rise: float) -> Plan:
    """Return a flight along x from (0, 5) upwards, with a landing of 2 m and a hall of 10 x 10 m at either end [m].

    People start in one of the halls and leave at the far side of the other, on their way "up" or "down".
    """
    low, high, plan = 5.0 - width / 2, 5.0 + width / 2, Plan()
    plan.storey("lower", union_all([box(-12, 0, -2, 10), box(-2, low, 0, high)]), 0.0)
    plan.storey("upper", union_all([box(run + 2, 0, run + 12, 10), box(run, low, run + 2, high)]), rise)
    plan.stair("stair", "lower", across(0, low, high), "upper", across(run, low, high))
    foot, head = (("lower", box(-12, 0, -2, 10), -12.0), ("upper", box(run + 2, 0, run + 12, 10), run + 12.0))
    start, end = (foot, head) if way == "up" else (head, foot)
    plan.area("start", start[0], start[1])
    plan.exit("end", end[0], across(end[2], 0, 10))
    return plan


def room_corridor_stair() -> Plan:
    """Return RiMEA 13 (version 3): a room of 5 x 8 m, a corridor of 12 x 2 m, and a stair of 3 x 2 m, 1 m up."""
    plan = Plan()
    plan.storey("lower", union_all([box(0, 0, 5, 8), box(5, 3, 17, 5)]), 0.0)
    plan.storey("upper", box(20, 3, 24, 5), 1.0)
    plan.stair("stair", "lower", across(17, 3, 5), "upper", across(20, 3, 5))
    plan.exit("end", "upper", across(24, 3, 5))
    plan.area("start", "lower", box(0, 0, 5, 8))
    return plan


def rooms_and_bottlenecks(widths: Sequence[float], length: float, behind: float) -> Plan:
    """Return rooms of 10 x 10 m along x with bottlenecks between, the last with ground of a depth behind it [m].

    People start in the left half of the first room. With no ground, the exit is the end of the last bottleneck.
    """
    parts, x = [box(0, 0, 10, 10)], 10.0
    for number, width in enumerate(widths):
        depth = 10.0 if number < len(widths) - 1 else behind
        parts.append(box(x, 5 - width / 2, x + length, 5 + width / 2))
        if depth:
            parts.append(box(x + length, 0, x + length + depth, 10))
        x += length + depth
    end = across(x, 0, 10) if behind else across(x, 5 - widths[-1] / 2, 5 + widths[-1] / 2)
    return one_storey(*parts, exits={"end": end}, areas={"start": box(0, 0, 5, 10)})


def cabins() -> tuple[Plan, list[str]]:
    """Return RiMEA 10 and the names of its rooms: twelve rooms along a corridor, exits main and secondary.

    Rooms 0 to 5 lie below the corridor, 6 to 11 above; walls are 0.1 m thick, doors 0.9 m wide. The passage to the
    main exit takes the place of a part of the third room above.
    """
    parts, rooms = [box(0, 5, 18, 6), box(6, 6, 7.2, 11)], []
    for k in range(6):
        rooms.append(box(3 * k + 0.05, 0.0, 3 * k + 2.95, 4.8))
        parts.append(box(3 * k + 1.05, 4.8, 3 * k + 1.95, 5))
    for k in range(6):
        rooms.append(box(7.25 if k == 2 else 3 * k + 0.05, 6.2, 3 * k + 2.95, 11.0))
        door = 7.6 if k == 2 else 3 * k + 1.05
        parts.append(box(door, 6, door + 0.9, 6.2))
    areas = {f"room {number}": room for number, room in enumerate(rooms)}
    exits = {"main": [(6, 11), (7.2, 11)], "secondary": across(18, 5, 6)}
    return one_storey(*parts, *rooms, exits=exits, areas=areas), list(areas)


def rooms_and_corridor(counter: int) -> tuple[Plan, list[Row]]:
    """Return IMO 8: a hundred people cross from room to room through a corridor, and `counter` come towards them."""
    exits = {"right": across(30, 0, 10), "left": across(0, 0, 10)}
    areas = {"start left": box(0, 0, 4, 10), "start right": box(26, 0, 30, 10)}
    plan = one_storey(box(0, 0, 10, 10), box(10, 4, 20, 6), box(20, 0, 30, 10), exits=exits, areas=areas)
    people: list[Row] = [{"area": "start left", "number": 100, "exits": ["right"]}]
    if counter:
        people.append({"area": "start right", "number": counter, "exits": ["left"]})
    return plan, people


def detour_and_stairs() -> Plan:
    """Return RiMEA 14: two halls, a long way round on their storey, and a short one down and up two stairs."""
    plan = Plan()
    plan.storey("upper", union_all([box(0, 0, 5, 20), box(5, 15, 25, 20), box(25, 0, 30, 20)]), 0.0)
    plan.storey("lower", box(10, 3, 20, 7), -5.0)
    plan.stair("west", "lower", across(10, 4, 6), "upper", across(5, 4, 6))
    plan.stair("east", "lower", across(20, 4, 6), "upper", across(25, 4, 6))
    plan.exit("end", "upper", [(27, 0), (29, 0)])
    plan.area("start", "upper", box(0, 0, 4.7, 12))
    return plan


def ring_and_bridge() -> Plan:
    """Return ISO 17: corridors of 2 m round a block, 54 m from start to exit, and 30 m over a bridge upstairs.

    The stairs are 1.5 m wide and 6 m long in plan.
    """
    plan = Plan()
    plan.storey("ground", union_all([box(0, 0, 2, 19), box(0, 17, 18, 19), box(16, 0, 18, 19)]), 0.0)
    plan.storey("bridge", box(8, 6.25, 10, 7.75), 3.0)
    plan.stair("west", "ground", across(2, 6.25, 7.75), "bridge", across(8, 6.25, 7.75))
    plan.stair("east", "ground", across(16, 6.25, 7.75), "bridge", across(10, 6.25, 7.75))
    plan.exit("end", "ground", [(16, 0), (18, 0)])
    plan.area("start", "ground", box(0, 0, 2, 4))
    return plan
