"""Convert runs of treads and landings to stairs of a plan; each stair is built once as a test before it is used."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.base.defaults import HEADROOM
from evac.base.errors import BuildingError
from evac.building.geometry import common, connected_components, cut, place_of, united
from evac.building.model.findings import Finding
from evac.building.plan import stairs
from evac.building.plan.outlines import normal, strips
from evac.building.plan.plan import Plan
from evac.building.recover.bodies.body import NOTCH, Body, closed, snapped
from evac.building.recover.bodies.floors import Floor
from evac.building.recover.bodies.treads import LEAST_GOING, SHORT, SINGLE_FILE, Landing, Run, treads_of
from evac.building.surface.build import LEAST_DEPTH, ROUNDING

#: Largest gap in plan between the end of a flight and a floor [m].
FAR = 0.6
#: Largest gap in plan between the end of a flight and a landing [m].
BESIDE = 0.3
#: Largest offset in height of a floor below the first riser or above the last one, due to floor finishes [m].
OFF = 0.15
#: A flight that overlaps the edge of its floor by at most this is shortened [m].
FIT = 0.05
#: A landing whose height differs from that of a floor by at most this is part of the floor [m].
SAME_FLOOR = 0.1
#: Widths tried in turn by which each side of a flight is narrowed, until a floor lies along all of its end [m].
NARROWED = (0.0, 0.02, 0.05, 0.1)
#: Minimum height of a passage under a slab [m]; below the height of people, since slabs and flights are not exact.
PASSABLE = 1.5
#: A slab is taken as closed if it covers more than this share of the ground that a flight needs free.
CLOSED = 0.5
#: Steps before a door are lower than this [m].
STEPS = 2.0
#: Bodies that are nowhere wider than this are no stairs [m].
NARROWEST = 0.3
#: A stair that cannot be used is there twice if others cover more than this share of it.
TWICE = 0.8


@dataclass
class End:
    """One end of a flight: its edge (2, 2) [m], and the floor or landing that it meets."""

    edge: FloatArray
    floor: Floor | None = None
    landing: int | None = None
    z: float = 0.0


@dataclass
class Flight:
    """A flight: its ends, the edges between them if it winds, and the depth and height of its steps [m], for findings.

    All edges have their right end first on the way up.
    """

    lower: End
    upper: End
    between: FloatArray  # (e, 2, 2) float64 [m]
    going: float
    riser: float

    @property
    def ends(self) -> tuple[End, End]:
        """Lower and upper end."""
        return self.lower, self.upper

    @property
    def edges(self) -> FloatArray:
        """Edges (e, 2, 2) from the lower to the upper end [m]."""
        return np.array([self.lower.edge, *self.between, self.upper.edge])

    @property
    def steps(self) -> list[tuple[FloatArray, float, FloatArray, float]]:
        """Lower edge, its height, upper edge and its height of each plane, from bottom to top."""
        z = np.linspace(self.lower.z, self.upper.z, len(self.edges)).tolist()
        return [(*lower, *upper) for lower, upper in pairwise(zip(self.edges, z, strict=True))]

    @property
    def plan(self) -> BaseGeometry:
        """The flight in plan."""
        return united([_between(lower, upper) for lower, upper in pairwise(self.edges)])

    def near(self, z: float) -> BaseGeometry:
        """Return the part in plan that leaves no headroom above or below a height [m]."""
        steps = [step for step in self.steps if step[1] < z + HEADROOM and step[3] > z - HEADROOM]
        return united([_between(lower, upper) for lower, _, upper, _ in steps])

    def away(self, end: End) -> FloatArray:
        """Return the unit vector (2,) from the flight to the floor or landing at one of its ends."""
        way = normal(end.edge)
        beside = self.edges[1] if end is self.lower else self.edges[-2]
        return -way if (beside.mean(axis=0) - end.edge.mean(axis=0)) @ way > 0.0 else way

    def __str__(self) -> str:
        """Rise, risers, going and width, for findings."""
        rise, width = self.upper.z - self.lower.z, np.hypot(*(self.edges[:, 1] - self.edges[:, 0]).T).min()
        steps = f"{round(rise / self.riser)} risers, going {self.going:.2f} m" if self.riser else "without steps"
        winds = ", winding: the narrow ends of its treads are left out" if len(self.between) else ""
        return f"{rise:.2f} m high, {steps}, {width:.2f} m wide{winds}"


@dataclass
class FoundStair:
    """A stair: flights, and the landings between them."""

    name: str
    bodies: str  # names of its parts in the file, for messages
    flights: list[Flight] = field(default_factory=list)
    landings: list[tuple[BaseGeometry, float]] = field(default_factory=list)  # list of (polygon, float [m])
    # list of (Floor, polygon): ground by which floors are extended to meet the stair
    ground: list[tuple[Floor, BaseGeometry]] = field(default_factory=list)

    @property
    def floors(self) -> list[Floor]:
        """Floors that the stair joins."""
        floors = [end.floor for flight in self.flights for end in flight.ends if end.floor is not None]
        return list({floor.name: floor for floor in floors}.values())

    @property
    def plan(self) -> BaseGeometry:
        """Union of its flights and landings in plan."""
        return united([*(flight.plan for flight in self.flights), *(plan for plan, _ in self.landings)])

    def add_to(self, plan: Plan) -> None:
        """Add the stair to a plan that has its floors."""
        for flight in self.flights:
            for step in flight.steps:
                plan.flight(self.name, *step)
        for landing, z in self.landings:
            plan.landing(self.name, landing, z)


class LeftOutError(ValueError):
    """A stair cannot be used; carries the reason, the floor and the place."""

    def __init__(self, text: str, floor: str | None, place: tuple[float, float]) -> None:
        super().__init__(text)
        self.finding = Finding("missing", text, floor, place, element="stair")


def stairs_of(
    bodies: Sequence[Body],
    floors: Sequence[Floor],
    hulls: Mapping[str, BaseGeometry],
    cut_slabs: bool,
    findings: list[Finding],
) -> list[FoundStair]:
    """Return the stairs that can be walked; a finding with its place is added for every other one.

    `hulls`: each floor with its walls and without holes, by its name.
    """
    treads = treads_of([body for body in bodies if body.kind in ("stair", "landing")])
    for body in treads.bare:
        is_thin = shapely.is_empty(body.shadow.buffer(-NARROWEST / 2))
        what = "it is a handrail or a stringer" if is_thin else "neither treads nor an inclined face are in its shape"
        kind, text = "left out" if is_thin else "missing", f"{body.name!r} is left out: {what}"
        findings.append(Finding(kind, text, _storey(floors, body.z_min), body.place, element="stair"))
    for landing in treads.short:
        text = f"a landing less than {SHORT:g} m deep is treated as part of its flight"
        findings.append(Finding("assumed", text, _storey(floors, landing.z), place_of(landing.plan)))
    runs, landings = treads.runs, _free_landings(treads.landings, floors)
    made: list[tuple[Run, Flight]] = []
    for run in runs:
        try:
            made.append((run, _flight(run, floors, landings)))
            if run.width < SINGLE_FILE:
                text = (
                    f"{_names(run.names)} is {SINGLE_FILE:g} m wide, for people in single file: {run.width:.2f} m of "
                    f"its treads are as deep as {LEAST_GOING:g} m and their risers"
                )
                findings.append(Finding("assumed", text, _storey(floors, run.treads[0].z), run.place))
        except LeftOutError as left:
            plan = united([tread for tread, _ in run.treads])
            around = united([hulls[floor.name] for floor in floors if abs(floor.z - run.treads[-1].z) < STEPS])
            is_low = run.treads[-1].z - run.treads[0].z < STEPS
            is_beside = is_low and common(plan, around).area < (1.0 - TWICE) * plan.area
            if is_beside or min(floor.ground.distance(plan) for floor in floors) > FAR:
                text = f"{_names(run.names)} is left out: it is outside of the building"
                findings.append(Finding("left out", text, None, run.place, element="stair"))
            else:
                findings.append(left.finding)
    stairs: list[FoundStair] = []
    for group in _groups([flight for _, flight in made], len(landings)):
        names = tuple(dict.fromkeys(name for row in group for name in made[row][0].names))
        stair = FoundStair(f"stair {len(stairs) + 1}", _names(names), [made[row][1] for row in group])
        place = made[group[0]][0].place
        try:
            _complete(stair, landings)
            findings += _check_slabs(stair, floors, cut_slabs)
            _try([*stairs, stair], floors)
        except (LeftOutError, BuildingError, ValueError) as error:
            text = f"{stair.bodies} is left out: {str(error).removeprefix('<plan>: ')}"
            at = (
                error.finding
                if isinstance(error, LeftOutError)
                else Finding("missing", text, stair.floors[0].name, place, element="stair")
            )
            is_there = common(stair.plan, united([other.plan for other in stairs])).area > TWICE * stair.plan.area
            at = replace(at, number=len(names))
            findings.append(replace(at, kind="left out") if is_there else at)
            continue
        stairs.append(stair)
        floor = ", ".join(repr(one.name) for one in sorted(stair.floors, key=lambda one: one.z))
        text = f"{stair.name!r} of {stair.bodies} joins {floor}; its flights: {'; '.join(map(str, stair.flights))}"
        findings.append(Finding("found", text, stair.floors[0].name, place))
    return stairs


def _names(names: Sequence[str]) -> str:
    return " and ".join(repr(name) for name in names)


def _storey(floors: Sequence[Floor], z: float) -> str | None:
    """Return the name of the floor below a height, for findings."""
    below = [floor for floor in floors if floor.z <= z + OFF]
    return below[-1].name if below else None


def _free_landings(landings: Sequence[Landing], floors: Sequence[Floor]) -> list[Landing]:
    """Return the landings between floors; landings at the height of a floor become part of it."""
    free = []
    for landing in landings:
        near = [f for f in floors if abs(f.z - landing.z) <= SAME_FLOOR and f.ground.distance(landing.plan) < BESIDE]
        for floor in near[:1]:
            gap = common(closed(united([floor.ground, landing.plan]), BESIDE), landing.plan.buffer(BESIDE))
            floor.ground = snapped(united([floor.ground, landing.plan, gap]))
        if not near:
            free.append(landing)
    return free


def _flight(run: Run, floors: Sequence[Floor], landings: Sequence[Landing]) -> Flight:
    """Return the flight of a run, with the floors or landings that it meets."""
    lower, upper = (_end(run, is_upper, floors, landings) for is_upper in (False, True))
    edges = run.edges[:-1] if _is_flush(run, upper.z) else run.edges
    if np.hypot(*(edges[:, 1] - edges[:, 0]).T).min() < SINGLE_FILE - ROUNDING:
        text = f"{_names(run.names)} is left out: its treads wind, and they are too short to walk on"
        raise LeftOutError(text, _storey(floors, upper.z), run.place)
    going = float(np.hypot(*np.diff(edges.mean(axis=1), axis=0).T).sum()) / (len(edges) - 1)
    return Flight(lower, upper, edges[1:-1] if run.winds else edges[:0], going, run.riser)


def _end(run: Run, is_upper: bool, floors: Sequence[Floor], landings: Sequence[Landing]) -> End:
    """Return the end of a run, with the floor or landing that it meets."""
    last = run.treads[-1 if is_upper else 0][1]
    reach = run.riser + OFF
    candidates: list[tuple[float, float, End]] = []
    none = np.empty((0, 2))
    met = [(landing.plan, BESIDE, End(none, None, row, landing.z)) for row, landing in enumerate(landings)]
    met += [(floor.ground, FAR, End(none, floor, None, floor.z)) for floor in floors]
    for plan, farthest, end in met:
        edge = _edge(run, is_upper, end.z)
        rise = end.z - last if is_upper else last - end.z
        away = float(plan.distance(shapely.LineString(edge)))
        if -0.05 <= rise <= reach and away <= farthest:
            candidates.append((abs(rise - run.riser), away, replace(end, edge=edge)))
    if not candidates:
        z = last + run.riser if is_upper else last - run.riser
        what = "ends" if is_upper else "begins"
        text = (
            f"{_names(run.names)} is left out: it {what} at a height of {z:.2f} m, where there is no floor or landing"
        )
        x, y = _edge(run, is_upper, z).mean(axis=0).tolist()
        raise LeftOutError(text, _storey(floors, z), (x, y))
    return min(candidates, key=lambda candidate: candidate[:2])[2]


def _edge(run: Run, is_upper: bool, z: float) -> FloatArray:
    """Return the edge (2, 2) of a run at a height [m]; a last tread at the height of a floor is part of that floor."""
    edge: FloatArray = run.edges[0 if not is_upper else -2 if _is_flush(run, z) else -1]
    return edge


def _is_flush(run: Run, z: float) -> bool:
    return z - run.treads[-1][1] < 0.5 * run.riser and len(run.treads) > 2


def _groups(flights: Sequence[Flight], landings: int) -> list[IndexArray]:
    """Group the rows of flights that are joined by landings."""
    many = len(flights)
    pairs = [
        (row, many + end.landing) for row, one in enumerate(flights) for end in one.ends if end.landing is not None
    ]
    part = connected_components(many + landings, np.array(pairs, dtype=np.int64).reshape(-1, 2))[:many]
    return [np.flatnonzero(part == label) for label in dict.fromkeys(part.tolist())]


def _between(lower: FloatArray, upper: FloatArray) -> BaseGeometry:
    """Return the plan between two edges."""
    return shapely.convex_hull(shapely.multipoints(np.concatenate([lower, upper])))


def _complete(stair: FoundStair, landings: Sequence[Landing]) -> None:
    """Narrow the flights of a stair to the floors at their ends, and extend floors and landings up to the flights."""
    if not stair.floors:
        raise LeftOutError(f"{stair.bodies} is left out: it does not meet any floor", None, place_of(stair.plan))
    for row, given in enumerate(stair.flights):
        fitted = _fitted(_lengthened(given))
        for less in NARROWED:
            flight = replace(fitted, lower=_narrowed(fitted.lower, less), upper=_narrowed(fitted.upper, less))
            strips = [_strip(end, flight, landings) for end in flight.ends]
            if all(each is not None for each in strips):
                break
        else:
            end = next(end for end in fitted.ends if _strip(end, fitted, landings) is None)
            x, y = end.edge.mean(axis=0).tolist()
            name = None if end.floor is None else end.floor.name
            text = f"{stair.bodies} is left out: no floor adjoins the whole end of a flight at {end.z:.2f} m"
            raise LeftOutError(text, name, (x, y))
        stair.flights[row] = flight
        for end, ground in zip(flight.ends, strips, strict=True):
            if ground is not None and not ground.is_empty and end.floor is not None:
                stair.ground.append((end.floor, ground))
    used = {end.landing for flight in stair.flights for end in flight.ends if end.landing is not None}
    for row in sorted(used):
        flights = united([flight.near(landings[row].z) for flight in stair.flights])
        gaps = [_strip(end, one, landings) for one in stair.flights for end in one.ends if end.landing == row]
        plan = united([landings[row].plan, *(gap for gap in gaps if gap is not None and not gap.is_empty)])
        stair.landings.append((snapped(cut(plan, flights)), landings[row].z))


def _narrowed(end: End, less: float) -> End:
    along = (end.edge[1] - end.edge[0]) / np.hypot(*(end.edge[1] - end.edge[0]))
    edge = np.round(np.array([end.edge[0] + less * along, end.edge[1] - less * along]), 3) + 0.0
    return replace(end, edge=edge)


def _lengthened(flight: Flight) -> Flight:
    """Return a flight of a few steps so long that it is a level: it reaches into the floor below."""
    way = flight.away(flight.lower)
    lacks = LEAST_DEPTH + FIT - float((flight.edges[0].mean(axis=0) - flight.edges[-1].mean(axis=0)) @ way)
    if len(flight.between) or lacks <= 0.0 or flight.lower.floor is None:
        return flight
    return replace(flight, lower=replace(flight.lower, edge=np.round(flight.lower.edge + lacks * way, 3)))


def _fitted(flight: Flight) -> Flight:
    """Return a flight whose ends are moved to the outlines of their floors where they overlap slightly."""
    moved = []
    for end in flight.ends:
        way, depth = flight.away(end), 0.0
        if end.floor is not None:
            parts = shapely.get_parts(common(end.floor.ground, flight.near(end.z)))
            inside = shapely.get_coordinates(parts[shapely.dwithin(parts, shapely.LineString(end.edge), 1e-3)])
            depth = float(((end.edge[0] - inside) @ way).max()) if len(inside) else 0.0
        moved.append(replace(end, edge=np.round(end.edge - depth * way, 3) + 0.0) if 0.0 < depth <= FIT else end)
    return replace(flight, lower=moved[0], upper=moved[1])


def _strip(end: End, flight: Flight, landings: Sequence[Landing]) -> BaseGeometry | None:
    """Return the ground between an end of a flight and its floor or landing; None if they are too far apart."""
    ground = end.floor.ground if end.floor is not None else landings[end.landing or 0].plan
    reach = FAR if end.floor is not None else BESIDE
    (landing,) = strips(cut(ground, flight.near(end.z)), end.edge, flight.away(end)[None], reach)
    return None if landing is None else landing.polygon


def _check_slabs(stair: FoundStair, floors: Sequence[Floor], cut_slabs: bool) -> list[Finding]:
    """Return a finding for each slab that is cut for a stair; refuse the stair if slabs must not be cut."""
    notes = []
    for flight in stair.flights:
        pieces = [piece for step in flight.steps for piece in stairs.flight(*step)]
        for floor in (floor for floor in floors if floor.z > flight.lower.z + 0.5):
            needed = united([stairs.too_low(piece, floor.z, PASSABLE) for piece in pieces])
            covered = common(needed, floor.slabs)
            if needed.is_empty or covered.area < CLOSED * needed.area:
                continue
            what = f"{covered.area:.2f} m2 of slab at {floor.z:.2f} m block a flight of {stair.bodies}"
            if not cut_slabs:
                text = f"{what}; it is left out. If the slab should have an opening, set cut_slabs = true to cut it"
                raise LeftOutError(text, floor.name, place_of(covered))
            notes.append(Finding("assumed", f"{what} and are cut away (cut_slabs)", floor.name, place_of(covered)))
    return notes


def meeting(floor: Floor, stairs_there: Sequence[FoundStair]) -> BaseGeometry:
    """Return the ground of a floor with the extensions for its stairs, with corners at the ends of stair edges."""
    more = [polygon for stair in stairs_there for of, polygon in stair.ground if of is floor]
    ends = [end.edge for stair in stairs_there for flight in stair.flights for end in flight.ends if end.floor is floor]
    ground = snapped(united([floor.ground, *more]))
    if not ends:
        return ground
    met = shapely.snap(ground, shapely.multipoints(np.concatenate(ends)), NOTCH)
    return met if met.is_valid else ground


def _try(stairs_there: Sequence[FoundStair], floors: Sequence[Floor]) -> None:
    """Build the last of some stairs together with its floors and the stairs beside it, as a test."""
    plan, stair = Plan(), stairs_there[-1]
    met = {floor.name for floor in stair.floors}
    beside = [other for other in stairs_there if any(floor.name in met for floor in other.floors)]
    heights = [end.z for other in beside for flight in other.flights for end in flight.ends]
    near = [floor for floor in floors if min(heights) - HEADROOM < floor.z < max(heights) + HEADROOM]
    for floor in near:
        plan.storey(floor.name, meeting(floor, stairs_there), floor.z)
    for other in stairs_there:
        if all(floor in near for floor in other.floors):
            other.add_to(plan)
    building = plan.building(need_exit=False)
    for floor in stair.floors:
        joined = [
            building.levels[other].stair
            for portal in building.portals
            for own, other in (portal.levels, portal.levels[::-1])
            if building.levels[own].name.partition(" (")[0] == floor.name.partition(" (")[0]
        ]
        if stair.name not in joined:
            raise BuildingError(f"it does not meet the floor at {floor.z:.2f} m")
