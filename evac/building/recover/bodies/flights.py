"""Convert runs of treads and landings to stairs of a plan; each stair is built once as a test before it is used."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from evac.base.arrays import FloatArray, IndexArray
from evac.base.defaults import HEADROOM
from evac.base.errors import BuildingError
from evac.building.geometry.components import connected_components
from evac.building.geometry.overlays import common, cut, place_of, united
from evac.building.model.findings import Finding
from evac.building.plan import stairs
from evac.building.plan.outlines import normal, strip
from evac.building.plan.plan import Plan
from evac.building.recover.bodies.body import NOTCH, Body, snapped
from evac.building.recover.bodies.floors import Floor
from evac.building.recover.bodies.treads import SHORT, Landing, Run, treads_of
from evac.building.surface.checks import LEAST_DEPTH

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
class FoundStair:
    """A stair: flights, each given by its two ends, and the landings between them."""

    name: str
    bodies: str  # names of its parts in the file, for messages
    # list of (End, End): lower and upper end of each flight
    flights: list[tuple[End, End]] = field(default_factory=list)
    landings: list[tuple[BaseGeometry, float]] = field(default_factory=list)  # list of (polygon, float [m])
    # list of (Floor, polygon): ground by which floors are extended to meet the stair
    ground: list[tuple[Floor, BaseGeometry]] = field(default_factory=list)

    @property
    def floors(self) -> list[Floor]:
        """Floors that the stair joins."""
        floors = [end.floor for ends in self.flights for end in ends if end.floor is not None]
        return list({floor.name: floor for floor in floors}.values())

    @property
    def plan(self) -> BaseGeometry:
        """Union of its flights and landings in plan."""
        return united([*(_outline(*ends) for ends in self.flights), *(plan for plan, _ in self.landings)])

    def add_to(self, plan: Plan) -> None:
        """Add the stair to a plan that has its floors."""
        for lower, upper in self.flights:
            plan.flight(self.name, lower.edge, lower.z, upper.edge, upper.z)
        for landing, z in self.landings:
            plan.landing(self.name, landing, z)


class LeftOutError(ValueError):
    """A stair cannot be used; carries the reason, the floor and the place."""

    def __init__(self, text: str, floor: str | None, place: tuple[float, float]) -> None:
        super().__init__(text)
        self.finding = Finding("missing", text, floor, place)


def stairs_of(
    bodies: Sequence[Body], floors: Sequence[Floor], cut_slabs: bool, findings: list[Finding]
) -> list[FoundStair]:
    """Return the stairs that can be walked; a warning with its place is added for every other one.

    Parameters
    ----------
    bodies : sequence of Body
        Stairs, flights and landings.
    floors : sequence of Floor
        Floors with their doors opened; landings at the same height are added to them.
    cut_slabs : bool
        Whether slabs that block a stair are cut; otherwise such a stair is left out.
    findings : list of Finding
        To add to.
    """
    treads = treads_of([body for body in bodies if body.kind in ("stair", "landing")])
    for one in treads.turning:
        text = (
            f"{_names(one.names)} is left out: its treads turn by up to {one.degrees:.0f} degrees, as in a "
            "spiral or winding stair, so they do not form a plane flight"
        )
        findings.append(Finding("missing", text, _storey(floors, one.treads[0][1]), one.place))
    for body in treads.bare:
        text = f"{body.name!r} is left out: no row of treads was found in its shape"
        findings.append(Finding("missing", text, _storey(floors, body.z_min), body.place))
    for landing in treads.short:
        text = f"a landing less than {SHORT:g} m deep is treated as part of its flight"
        findings.append(Finding("assumed", text, _storey(floors, landing.z), place_of(landing.plan)))
    runs, landings = treads.runs, _free_landings(treads.landings, floors)
    ends: list[tuple[Run, tuple[End, End]]] = []
    for run in runs:
        try:
            ends.append((run, (_end(run, False, floors, landings), _end(run, True, floors, landings))))
        except LeftOutError as left:
            plan = united([tread for tread, _ in run.treads])
            if min(floor.ground.distance(plan) for floor in floors) > FAR:
                text = f"{_names(run.names)} is left out: it is outside of the building"
                findings.append(Finding("left out", text, None, run.place))
            else:
                findings.append(left.finding)
    stairs: list[FoundStair] = []
    for group in _groups([both for _, both in ends], len(landings)):
        names = tuple(dict.fromkeys(name for row in group for name in ends[row][0].names))
        stair = FoundStair(f"stair {len(stairs) + 1}", _names(names), [ends[row][1] for row in group])
        try:
            _complete(stair, landings)
            findings += _check_slabs(stair, floors, cut_slabs)
            _try([*stairs, stair], floors)
        except (LeftOutError, BuildingError, ValueError) as error:
            place = ends[group[0]][0].place
            text = f"{stair.bodies} is left out: {str(error).removeprefix('<plan>: ')}"
            at = (
                error.finding
                if isinstance(error, LeftOutError)
                else Finding("missing", text, stair.floors[0].name, place)
            )
            is_there = common(stair.plan, united([other.plan for other in stairs])).area > TWICE * stair.plan.area
            findings.append(replace(at, kind="left out") if is_there else at)
            continue
        stairs.append(stair)
        floor = ", ".join(repr(one.name) for one in sorted(stair.floors, key=lambda one: one.z))
        rise = max(upper.z for _, upper in stair.flights) - min(lower.z for lower, _ in stair.flights)
        text = f"{stair.name!r} of {stair.bodies}: {len(group)} flights, {rise:.2f} m high, joins {floor}"
        findings.append(Finding("found", text, stair.floors[0].name, ends[group[0]][0].place))
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
            floor.ground = snapped(united([floor.ground, landing.plan]))
        if not near:
            free.append(landing)
    return free


def _end(run: Run, is_upper: bool, floors: Sequence[Floor], landings: Sequence[Landing]) -> End:
    """Return the end of a run, with the floor or landing that it meets."""
    last = run.treads[-1 if is_upper else 0][1]
    reach = run.riser + OFF
    candidates: list[tuple[float, float, End]] = []
    for row, landing in enumerate(landings):
        edge = _edge(run, is_upper, landing.z)
        rise = landing.z - last if is_upper else last - landing.z
        away = float(landing.plan.distance(shapely.LineString(edge)))
        if -0.05 <= rise <= reach and away <= BESIDE:
            candidates.append((abs(rise - run.riser), away, End(edge, None, row, landing.z)))
    for floor in floors:
        edge = _edge(run, is_upper, floor.z)
        rise = floor.z - last if is_upper else last - floor.z
        away = float(floor.ground.distance(shapely.LineString(edge)))
        if -0.05 <= rise <= reach and away <= FAR:
            candidates.append((abs(rise - run.riser), away, End(edge, floor, None, floor.z)))
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
    is_flush = is_upper and z - run.treads[-1][1] < 0.5 * run.riser and len(run.treads) > 2
    return run.edge(is_upper, before_last=is_flush)


def _groups(ends: Sequence[tuple[End, End]], landings: int) -> list[IndexArray]:
    """Group the rows of runs that are joined by landings."""
    pairs = [(row, len(ends) + end.landing) for row, both in enumerate(ends) for end in both if end.landing is not None]
    part = connected_components(len(ends) + landings, np.array(pairs, dtype=np.int64).reshape(-1, 2))[: len(ends)]
    return [np.flatnonzero(part == label) for label in dict.fromkeys(part.tolist())]


def _outline(lower: End, upper: End) -> BaseGeometry:
    """Return the plan of a flight."""
    return shapely.convex_hull(shapely.multipoints(np.concatenate([lower.edge, upper.edge])))


def _complete(stair: FoundStair, landings: Sequence[Landing]) -> None:
    """Narrow the flights of a stair to the floors at their ends, and extend floors and landings up to the flights."""
    if not stair.floors:
        raise LeftOutError(f"{stair.bodies} is left out: it does not meet any floor", None, place_of(stair.plan))
    for row, given in enumerate(stair.flights):
        both = _lengthened(*given)
        lower, upper = _fitted(both[0], both), _fitted(both[1], both)
        for less in NARROWED:
            ends = (_narrowed(lower, less), _narrowed(upper, less))
            strips = [_strip(end, ends, landings) for end in ends]
            if all(each is not None for each in strips):
                break
        else:
            end = next(end for end in (lower, upper) if _strip(end, (lower, upper), landings) is None)
            x, y = end.edge.mean(axis=0).tolist()
            name = None if end.floor is None else end.floor.name
            text = f"{stair.bodies} is left out: no ground lies along the whole end of a flight at {end.z:.2f} m"
            raise LeftOutError(text, name, (x, y))
        stair.flights[row] = ends
        for end, ground in zip(ends, strips, strict=True):
            if ground is not None and not ground.is_empty and end.floor is not None:
                stair.ground.append((end.floor, ground))
    used = {end.landing for both in stair.flights for end in both if end.landing is not None}
    flights = united([_outline(*ends) for ends in stair.flights])
    for row in sorted(used):
        gaps = [_strip(end, both, landings) for both in stair.flights for end in both if end.landing == row]
        plan = united([landings[row].plan, *(gap for gap in gaps if gap is not None and not gap.is_empty)])
        stair.landings.append((snapped(cut(plan, flights)), landings[row].z))


def _narrowed(end: End, less: float) -> End:
    along = (end.edge[1] - end.edge[0]) / np.hypot(*(end.edge[1] - end.edge[0]))
    edge = np.round(np.array([end.edge[0] + less * along, end.edge[1] - less * along]), 3) + 0.0
    return End(edge, end.floor, end.landing, end.z)


def _lengthened(lower: End, upper: End) -> tuple[End, End]:
    """Return the ends of a flight of a few steps so far apart that it is a level: it reaches into the floor below."""
    way = _away(lower, _outline(lower, upper))
    lacks = LEAST_DEPTH + FIT - float((lower.edge.mean(axis=0) - upper.edge.mean(axis=0)) @ way)
    if lacks <= 0.0 or lower.floor is None:
        return lower, upper
    return replace(lower, edge=np.round(lower.edge + lacks * way, 3)), upper


def _fitted(end: End, both: tuple[End, End]) -> End:
    """Move the end of a flight to the outline of its floor where they overlap slightly."""
    if end.floor is None:
        return end
    outline = _outline(*both)
    way = _away(end, outline)
    parts = shapely.get_parts(common(end.floor.ground, outline))
    inside = shapely.get_coordinates(parts[shapely.dwithin(parts, shapely.LineString(end.edge), 1e-3)])
    depth = float(((end.edge[0] - inside) @ way).max()) if len(inside) else 0.0
    if not 0.0 < depth <= FIT:
        return end
    return End(np.round(end.edge - depth * way, 3) + 0.0, end.floor, end.landing, end.z)


def _away(end: End, outline: BaseGeometry) -> FloatArray:
    """Return the unit vector (2,) from a flight to the floor or landing at one of its ends."""
    way = normal(end.edge)
    return -way if (np.array(outline.centroid.coords[0]) - end.edge.mean(axis=0)) @ way > 0.0 else way


def _strip(end: End, both: tuple[End, End], landings: Sequence[Landing]) -> BaseGeometry | None:
    """Return the ground between an end of a flight and its floor or landing; None if they are too far apart."""
    outline = _outline(*both)
    way = _away(end, outline)
    ground = end.floor.ground if end.floor is not None else landings[end.landing or 0].plan
    landing = strip(cut(ground, outline), end.edge, way, FAR if end.floor is not None else BESIDE)
    return None if landing is None else landing.polygon


def _check_slabs(stair: FoundStair, floors: Sequence[Floor], cut_slabs: bool) -> list[Finding]:
    """Return a finding for each slab that is cut for a stair; refuse the stair if slabs must not be cut."""
    notes = []
    for lower, upper in stair.flights:
        for floor in (floor for floor in floors if floor.z > lower.z + 0.5):
            pieces = stairs.flight(lower.edge, lower.z, upper.edge, upper.z)
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
    ends = [end.edge for stair in stairs_there for both in stair.flights for end in both if end.floor is floor]
    ground = snapped(united([floor.ground, *more]))
    if not ends:
        return ground
    met = shapely.snap(ground, shapely.multipoints(np.concatenate(ends)), NOTCH)
    return met if met.is_valid else ground


def _try(stairs_there: Sequence[FoundStair], floors: Sequence[Floor]) -> None:
    """Build the last of some stairs together with its floors and the stairs beside it, as a test.

    Raises
    ------
    BuildingError
        The building is invalid, or the stair does not join its floors.
    """
    plan, stair = Plan(), stairs_there[-1]
    low, high = min(lower.z for lower, _ in stair.flights), max(upper.z for _, upper in stair.flights)
    near = [floor for floor in floors if low - HEADROOM < floor.z < high + HEADROOM]
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
