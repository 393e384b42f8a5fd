"""Conversion of architectural drawings to plans: rooms between walls drawn as lines, doors, and stairs with treads."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray
from evac.base.errors import BuildingError
from evac.building.geometry import connected_components
from evac.building.plan.plan import Plan
from evac.building.recover.linework import PARALLEL, ahead, sides_of_walls

#: Spacing of treads, their length, and how far their middles are beside each other at most [m].
GOING, WIDTH, BESIDE = (0.2, 0.42), (0.7, 4.0), 0.15
#: Least number of lines of a flight, and the share by which their spacings may differ.
LEAST_LINES, REGULAR = 5, 0.12
#: Longest line of an arrowhead, and greatest distance of its lines from the tip [m].
HEAD, TIP = 0.6, 0.05
#: Widest gap between the two flights of a U-shaped stair [m].
BETWEEN = 0.6


@dataclass(frozen=True, eq=False)
class DrawnFlight:
    """A flight: its first and its last line (2, 2) [m], their number, and whether an arrow says which is which."""

    foot: FloatArray
    head: FloatArray
    lines: int
    is_directed: bool

    @property
    def way(self) -> FloatArray:
        """The vector (2,) from its foot to its head [m]."""
        way: FloatArray = (self.head - self.foot).mean(axis=0)
        return way

    @property
    def ground(self) -> BaseGeometry:
        """What it covers."""
        return shapely.MultiPoint([*self.foot, *self.head]).convex_hull

    def turned(self) -> "DrawnFlight":
        """Return the flight that ascends the other way."""
        return replace(self, foot=self.head, head=self.foot)


def flights_of(lines: Sequence[BaseGeometry]) -> list[DrawnFlight]:
    """Return the flights in a drawing: rows of parallel lines of equal length at the spacing of treads.

    `lines` [m].
    """
    ends = shapely.get_coordinates([*lines]).reshape(-1, 4)
    ends = np.sort(ends.view("f8,f8"), axis=1).view(np.float64)
    ends = ends[np.unique(np.round(ends, 2), axis=0, return_index=True)[1]]
    step = ends[:, 2:] - ends[:, :2]
    length = np.hypot(*step.T)
    is_tread = (length > WIDTH[0]) & (length < WIDTH[1])
    treads, way, wide = ends[is_tread], step[is_tread] / length[is_tread, None], length[is_tread]
    middle = (treads[:, :2] + treads[:, 2:]) / 2
    near = shapely.STRtree(shapely.points(middle)).query(shapely.points(middle), "dwithin", distance=2.0 * GOING[1])
    one, other = near[:, near[0] < near[1]]
    off = middle[other] - middle[one]
    apart = np.abs(way[one, 0] * off[:, 1] - way[one, 1] * off[:, 0])
    is_next = (np.abs((way[one] * way[other]).sum(axis=1)) > 0.999) & (np.abs((way[one] * off).sum(axis=1)) < BESIDE)
    is_next &= (apart > GOING[0]) & (apart < GOING[1]) & (np.abs(wide[one] - wide[other]) < 0.1 * wide[one])
    group = connected_components(len(treads), np.column_stack([one, other])[is_next])
    found = []
    for index in np.flatnonzero(np.bincount(group, minlength=1) >= LEAST_LINES).tolist():
        own = np.flatnonzero(group == index)
        along = (way[own] * np.sign(way[own] @ way[own[0]])[:, None]).sum(axis=0)
        along /= np.hypot(*along)
        across = np.array([-along[1], along[0]])
        place = np.sort(middle[own] @ across)
        place = place[np.append(True, np.diff(place) > GOING[0] / 2)]
        spacing = np.diff(place)
        if len(place) < LEAST_LINES or np.ptp(spacing) > 2.0 * REGULAR * spacing.mean():
            continue
        half, at = float(np.median(wide[own])) / 2, float(np.median(middle[own] @ along))
        foot, head = (
            np.round(np.stack([(at + side * half) * along + far * across for side in (-1, 1)]), 6)
            for far in place[[0, -1]].tolist()
        )
        arrow = _arrow(foot, head, ends)
        found.append(DrawnFlight(*((head, foot) if arrow < 0 else (foot, head)), len(place), arrow != 0))
    return found


@dataclass(frozen=True)
class DrawnStair:
    """A stair: its lowest and its highest line (2, 2) [m], and what makes it U-shaped."""

    foot: FloatArray
    head: FloatArray
    turn: dict[str, Any]  # arguments of `evac.building.plan.plan.Plan.stair` besides its edges
    is_directed: bool  # whether an arrow says that it ascends so
    ground: BaseGeometry

    @property
    def width(self) -> float:
        """The length of its lowest line [m]."""
        return float(np.hypot(*(self.foot[1] - self.foot[0])))

    def is_among(self, others: "Sequence[DrawnStair]") -> bool:
        """Return whether one of others is at the same place."""
        return any(self.ground.intersection(other.ground).area > 0.5 * self.ground.area for other in others)


def stairs_of(flights: Sequence[DrawnFlight], walls: Sequence[BaseGeometry]) -> list[DrawnStair]:
    """Return the stairs of flights: two that are side by side are one.

    `walls` [m]: the half landing is at the end of two flights that is nearer to one.
    """
    left, found = [*flights], list[DrawnStair]()
    tree = shapely.STRtree([*walls])
    while left:
        one = left.pop(0)
        other = next((other for other in left if _are_beside(one, other)), None)
        if other is None:
            found.append(DrawnStair(one.foot, one.head, {}, one.is_directed, one.ground))
            continue
        left.remove(other)
        first, second = (other, one) if other.is_directed and not one.is_directed else (one, other)
        second = second.turned() if first.way @ second.way > 0.0 else second
        far = [_room_ahead(first, second, tree), _room_ahead(second, first, tree)]
        if far[1] < far[0]:
            first, second = second, first
        run = float(np.hypot(*first.way))
        way = first.way / run
        across = np.array([-way[1], way[0]])
        head = (second.head @ way).mean() * way + (second.head @ across)[:, None] * across
        turn = {"length": round(run, 6), "direction": np.round(way, 9)}
        turn |= {"landing": round(min(far), 2)} if min(far) < WIDTH[1] else {}
        is_directed = one.is_directed or other.is_directed
        found.append(DrawnStair(first.foot, np.round(head, 6), turn, is_directed, first.ground | second.ground))
    return found


def add_fitting(plan: Plan, stairs: Mapping[str, Callable[[], None]]) -> dict[str, str]:
    """Add stairs to a plan that has none; return why some do not fit, which are left out, by name.

    `stairs`: functions that add them, by name.
    """
    if not stairs or not _fault(plan, [*stairs.values()]):
        return {}
    plan.stairs, plan.pieces, faults = [], [], {}
    for name, add in stairs.items():
        kept = [*plan.stairs], [*plan.pieces]
        if fault := _fault(plan, [add]):
            plan.stairs, plan.pieces = kept
            faults[name] = fault
    return faults


def _fault(plan: Plan, more: Sequence[Callable[[], None]]) -> str:
    """Return why the building cannot be made after more is added to its plan; empty if it can."""
    try:
        for add in more:
            add()
        plan.building(need_exit=False)
    except BuildingError as error:
        return str(error)
    return ""


def _are_beside(one: DrawnFlight, other: DrawnFlight) -> bool:
    """Return whether two flights are those of a U-shaped stair."""
    length = [float(np.hypot(*flight.way)) for flight in (one, other)]
    off = (other.foot + other.head - one.foot - one.head).mean(axis=0) / 2
    is_along = abs(float(one.way @ other.way)) > 0.99 * length[0] * length[1]
    is_level = abs(float(off @ one.way)) < 0.5 * length[0] * min(length)
    return is_along and is_level and one.ground.distance(other.ground) < BETWEEN and min(length) > 0.5 * max(length)


def _room_ahead(first: DrawnFlight, second: DrawnFlight, walls: shapely.STRtree) -> float:
    """Return how far the next wall is from the end of a first flight, ahead of it [m]; infinite if it is far away."""
    way = first.way / np.hypot(*first.way)
    ends = np.concatenate([first.head, second.foot])
    middle = ends.mean(axis=0)
    start = middle + (((ends - middle) @ way).max() + TIP) * way
    far = ahead(walls.geometries, walls, start, way, WIDTH[1])
    return math.inf if far is None else TIP + far


def _arrow(foot: FloatArray, head: FloatArray, ends: FloatArray) -> int:
    """Return 1 for an arrow that points from the foot of a flight to its head, -1 for one that points back."""
    run = (head - foot).mean(axis=0)
    body = shapely.convex_hull(shapely.MultiPoint([*foot, *head]))
    lines = shapely.linestrings(ends.reshape(-1, 2, 2))
    is_near = shapely.dwithin(lines, body, HEAD)
    ends, lines = ends[is_near], lines[is_near]
    step = ends[:, 2:] - ends[:, :2]
    length = np.hypot(*step.T)
    inside = shapely.length(shapely.intersection(lines, body))
    is_shaft = (np.abs(step @ run) > 0.95 * length * np.hypot(*run)) & (inside > 0.4 * np.hypot(*run))
    is_shaft &= (
        shapely.distance(shapely.boundary(body), shapely.line_interpolate_point(lines, 0.5, normalized=True)) > TIP
    )
    short = ends[length < HEAD]
    for shaft in ends[is_shaft]:
        for tip, tail in ((shaft[:2], shaft[2:]), (shaft[2:], shaft[:2])):
            barbs = 0
            for near, far in ((short[:, :2], short[:, 2:]), (short[:, 2:], short[:, :2])):
                is_at = np.hypot(*(near - tip).T) < TIP
                barbs += int((is_at & ((far - near) @ (tail - tip) > 0.0)).sum())
            if barbs >= 2:
                return 1 if (tip - tail) @ run > 0.0 else -1
    return 0


#: Beginnings or ends of words in names of layers and blocks, by use.
WORDS = {
    "left out": "dim bema massk cota cotes quot text txt note notiz anno beschr legend title iden foot found stem "
    "light lumi",
    "windows": "window wind windows fenster fenetre fenêtre ventana finestr janela glaz glass glas",
    "doors": "door tuer tür türen tueren porte puert porta menuis opening oeffnung öffnung jamb gate",
    "walls": "wall wand waende wände mauer mur murs porteur muro muri muros pared parete cloison partition concr beton "
    "column stuetze stütze säule saeule pillar pilar poteau colonn plaster putz facade fassade",
    "stairs": "stair strs trepp escal step tread",
}
#: Beginnings of words of layers that are left out, unless they are also named like one of these uses.
OTHERS = (
    "furn meub mobil moebel möbel muebl arred einricht plant tree veget landsc san sanit fixt plumb toilet wc equip "
    "appli case light lumi power switch elec hvac mech duct ceil decke roof dach toit truss overh beam balken slab "
    "joist rebar head hidden dashed hatch patt schraff grid axis achse axe center centre viewp defp raum space north "
    "symbol stair trepp escal step tread ramp site survey contour topo elev sect schnitt vehic chair table desk sofa "
    "bed sink lamp bath border rahmen frame tile area zone"
)
#: Usual radii of doors, from which units are known, the largest one [m], and the angle that they swing [rad].
RADII, LARGEST_SWING, SWING = (0.55, 1.3), 1.7, np.radians((20.0, 110.0))
#: Share of the lines of a layer with another side beside them from which it has walls.
PAIRED = 0.4
#: Greatest distance between a door and its wall [m]; that between the strikes of the two leaves of a door.
BESIDE_WALL, BETWEEN_LEAVES = 0.3, 0.15
#: Thickness of a leaf [m], and the share of it that must be drawn by one line.
LEAF, MOST_OF_LEAF = 0.08, 0.6
#: Plans are farther apart than this [m], and have at least this share of the lines of the largest.
APART, LEAST_PLAN = 2.5, 0.25


@cache
def use_of(name: str) -> str:
    """Return the use of a layer or block by likeness of its name: a key of `WORDS`; empty if it is not known.

    Words that are left out come first, then the longest, since a bearing wall is a "mur porteur".
    """
    words = [word for word in re.split(r"[\W\d_]+", re.split(r"[$|]", name.lower())[-1]) if word]
    length = {
        use: max(
            (len(end) for end in known.split() for word in words if word.startswith(end) or word.endswith(end)),
            default=0,
        )
        for use, known in WORDS.items()
    }
    if length["left out"] or not any(length.values()):
        is_other = any(word.startswith(tuple(OTHERS.split())) for word in words)
        return "left out" if length["left out"] or is_other else ""
    return max(length, key=lambda use: length[use])


def walls_by_spacing(layers: Mapping[str, Sequence[BaseGeometry]]) -> dict[str, str]:
    """Return the layers that have walls, and why: those of which most lines are the two sides of walls.

    `layers` [m].
    """
    total = {name: sum(line.length for line in lines) for name, lines in layers.items()}
    paired = {name: np.unique(sides_of_walls(lines)[:, 0]) for name, lines in layers.items()}
    double = {name: float(shapely.length([*lines])[paired[name]].sum()) for name, lines in layers.items()}
    least = 0.2 * max(double.values(), default=0.0)
    found = [name for name in layers if double[name] > max(PAIRED * total[name], least, 1e-9)]
    if found:
        return {
            name: f"walls, since {100.0 * double[name] / total[name]:.0f} % of its lines are in pairs" for name in found
        }
    longest = max(total, key=lambda name: total[name], default="")
    return {longest: "walls as single lines, since it has the longest lines"} if longest else {}


@dataclass(frozen=True)
class Swing:
    """The arc of a door: its hinge (2,), both its ends (2, 2), its radius, and the ground it sweeps."""

    hinge: FloatArray
    ends: FloatArray
    radius: float
    sector: BaseGeometry


def swing_of(curve: FloatArray) -> Swing | None:
    """Return the swing that a curve (n, 2) describes; None if it is not an arc of the angle that doors swing."""
    if len(curve) < 3:
        return None
    first, middle, last = curve[0], curve[len(curve) // 2], curve[-1]
    (ax, ay), (bx, by) = middle - first, last - first
    twice = 2.0 * (ax * by - ay * bx)
    if abs(twice) <= 1e-9 * (bx * bx + by * by):
        return None
    u, v = ax * ax + ay * ay, bx * bx + by * by
    hinge = first + np.array([by * u - ay * v, ax * v - bx * u]) / twice
    away = np.hypot(*(curve - hinge).T)
    radius = float(away.mean())
    angle = 2.0 * np.arcsin(min(1.0, float(np.hypot(bx, by)) / (2.0 * radius)))
    if np.ptp(away) > 0.02 * radius or not SWING[0] <= angle <= SWING[1]:
        return None
    return Swing(hinge, np.array([first, last]), radius, shapely.Polygon([hinge, *curve]))


def unit_of(radii: FloatArray, units: Sequence[float]) -> float | None:
    """Return the first unit with which the radii of most arcs are those of doors; None if there is none."""
    if not len(radii):
        return None
    fits = [float(np.mean((radii * unit > RADII[0]) & (radii * unit < RADII[1]))) for unit in units]
    return units[int(np.argmax(fits))] if max(fits) >= 0.5 else None


def doors_of(
    swings: Sequence[Swing], walls: Sequence[BaseGeometry], leaves: Sequence[BaseGeometry]
) -> tuple[FloatArray, list[Swing]]:
    """Return the doors (d, 4) of swings in walls, from the hinge to the strike, and the swings that are doors.

    The strike is that end of the arc to which no leaf leads, or else which is nearer to a wall or to the strike of
    another leaf. Two leaves that meet are one door.

    `swings` [m]; `walls` [m]; `leaves` [m]: lines that may be leaves.
    """
    drawn = shapely.STRtree([leaf for leaf in leaves if leaf.length < LARGEST_SWING + LEAF])
    ground = shapely.union_all([*walls])
    shapely.prepare(ground)
    swings = [_at_leaf(swing, drawn, ground) for swing in swings]
    own = [swing for swing in swings if RADII[0] * 0.9 <= swing.radius <= LARGEST_SWING]
    own = [one for one in own if ground.dwithin(shapely.Point(one.hinge), BESIDE_WALL)]
    tips = [shapely.MultiPoint(one.ends) for one in own]
    doors, used = [], []
    for k, one in enumerate(own):
        others = [tip for j, tip in enumerate(tips) if j != k and tip.distance(tips[k]) < BETWEEN_LEAVES]
        around = [ground, *others]
        far = [min(part.distance(shapely.Point(end)) for part in around) for end in one.ends]
        is_leaf = [_is_leaf(shapely.LineString([one.hinge, end]), drawn) for end in one.ends]
        strike = int(np.argmin(np.round(far, 2)))
        if is_leaf[0] != is_leaf[1]:
            strike = int(is_leaf[0])
        if far[strike] <= BESIDE_WALL:
            doors.append(np.concatenate([one.hinge, one.ends[strike]]))
            used.append(one)
    return _joined(np.round(np.array(doors).reshape(-1, 4), 6)), used


def _at_leaf(swing: Swing, leaves: shapely.STRtree, walls: BaseGeometry) -> Swing:
    """Return a swing with its hinge at the leaf to whose tip it is drawn, if that is not at its centre."""
    found = swing
    for end, strike in (swing.ends, swing.ends[::-1]):
        for leaf in leaves.geometries[leaves.query(shapely.Point(end), "dwithin", distance=LEAF)]:
            tip, hinge = sorted(shapely.get_coordinates(leaf), key=lambda corner: float(np.hypot(*(corner - end))))
            if np.hypot(*(hinge - swing.hinge)) < LEAF:
                return swing
            width = float(np.hypot(*(strike - hinge)))
            is_door = abs(leaf.length - width) < LEAF and RADII[0] <= width <= LARGEST_SWING
            if is_door and np.hypot(*(tip - end)) < LEAF and walls.dwithin(shapely.Point(strike), BESIDE_WALL):
                found = replace(swing, hinge=hinge, radius=width, sector=shapely.convex_hull(swing.sector | leaf))
    return found


def _is_leaf(line: BaseGeometry, leaves: shapely.STRtree) -> bool:
    """Return whether a leaf is drawn along most of a line."""
    body = line.buffer(LEAF, cap_style="flat")
    near = shapely.intersection(leaves.geometries[leaves.query(body, predicate="intersects")], body)
    return bool(shapely.length(near).max(initial=0.0) > MOST_OF_LEAF * line.length)


def _joined(doors: FloatArray) -> FloatArray:
    """Return doors of which two leaves whose strikes meet on one line are one door."""
    left, found = [*doors], []
    while left:
        one = left.pop(0)
        way = (one[2:] - one[:2]) / np.hypot(*(one[2:] - one[:2]))
        for k, other in enumerate(left):
            back = (other[2:] - other[:2]) / np.hypot(*(other[2:] - other[:2]))
            if np.hypot(*(other[2:] - one[2:])) < BETWEEN_LEAVES and way @ back < -PARALLEL:
                one = np.concatenate([one[:2], left.pop(k)[:2]])
                break
        found.append(one)
    distinct = {tuple(np.sort(np.round(one.reshape(2, 2), 2), axis=0).ravel()): one for one in found}
    return np.array([*distinct.values()]).reshape(-1, 4)


def plans_of(walls: Sequence[BaseGeometry], apart: float = APART) -> list[BaseGeometry]:
    """Return the ground of each plan in a drawing, from left to right in rows from the top down.

    `walls` [m]; `apart` [m]: plans are farther apart than this.
    """
    near = shapely.union_all(shapely.buffer([*walls], apart / 2, quad_segs=2))
    filled = shapely.union_all([shapely.Polygon(part.exterior) for part in shapely.get_parts(near)])
    parts = shapely.get_parts(filled)
    tree = shapely.STRtree(parts)
    length = np.zeros(len(parts))
    np.add.at(length, tree.query([*walls], predicate="intersects")[1], [line.length for line in walls])
    parts = parts[length >= LEAST_PLAN * length.max()]
    rows, bottom = list[list[BaseGeometry]](), math.inf
    for part in sorted(parts, key=lambda part: -part.bounds[3]):
        rows += [[]] if part.bounds[3] < bottom else []
        rows[-1].append(part)
        bottom = min(bottom, part.bounds[1])
    return [part for row in rows for part in sorted(row, key=lambda part: part.centroid.x)]
